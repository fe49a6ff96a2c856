"""From stored rows to one offline page, and to figures and tables as files. Nothing here integrates.

Only the errata of the paper are not stored: their formulas are evaluated while the page is built. The random points are fixed and
the results are printed as powers of ten, so that the same bytes come out every time.
"""

import re
import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup, escape

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.experiments.drawing import figures, tables
from lagrange_bench.experiments.measuring import errata
from lagrange_bench.report import chooser, claims, lists, live, origin, promises
from lagrange_bench.report.origin import PUBLISHED, Origin
from lagrange_bench.report.sections import OPENED, DrawnFigure, Section, described, draw, packed, read
from lagrange_bench.report.sections import write as write_section
from lagrange_bench.results import sources
from lagrange_bench.results.choice import ALL, Choice
from lagrange_bench.results.store import Store
from lagrange_bench.support.files import write_file

HERE = Path(__file__).parent
HEAVY = 400_000  # characters of packed rows beyond which they stay in their journal, for the page's sake
LONG = 14  # rows beyond which a table is folded
FACTS = ("commit", "cpu", "cores", "platform", "python")  # first in the table of the environment; then the packages
POWER = re.compile(r"(?<=\w)\^(?:(\w)\b|\(([^()]*)\))")  # t^p and t^(3/2)
PICTURE = "The axis of a top from above: the exact step is in every ring, Strang’s splitting is not"
OURS = "<title>Lagrange top benchmark</title>"  # in every page that was ever made
MEASURED_WHEN = ("key", "seconds", "utc", "dirty")


@dataclass
class Judged:
    claim: claims.Claim
    verdict: claims.ClaimVerdict
    command: str
    bounds_dates: str = ""  # when its bounds were set, and whether that was before its rows were measured


@dataclass
class Report:
    """Everything the page shows."""

    sections: list[Section]
    origin: str  # what it was drawn from
    whole: bool  # the bench's own page: with claims and errata
    errors: list[str]  # what could not be drawn or checked; the page shows each in its place
    old: str = ""  # how many cells are, and what to do about it
    claims: list[Judged] = field(default_factory=list)
    errata: pd.DataFrame = field(default_factory=pd.DataFrame)  # of the paper
    answers: pd.DataFrame = field(default_factory=pd.DataFrame)  # which method to take, see `chooser`
    engines: pd.DataFrame = field(default_factory=pd.DataFrame)  # of physics, and multibody programs


# ---------------------------------------------------------------- what others call


def in_brief(judged: list[Judged]) -> list[tuple[str, str, Judged]]:
    """Questions that claims answer, if all runs of the claim are stored: question, answer, the claim."""
    decided = (each for each in judged if each.verdict.word in (claims.CONFIRMED, claims.REFUTED))
    pairs = ((answer, each) for each in decided for answer in each.claim.answers)
    return [(a.question, text, each) for a, each in pairs if (text := a.filled(each.verdict))]


def assemble(results: Path, choice: Choice = ALL, followed: Callable[[list[str]], Iterable[str]] = iter) -> Report:
    """Everything the page shows, from the stored lines in `results`; never raises for a part that cannot be drawn.

    choice : of methods and tops. Where there are only experiments of the user's own, or a choice was made, the page has no
    claims, and what has no rows is left out. followed : goes through the names of the parts, and shows the progress.
    """
    stored, sections = Store(results, choice), list[Section]()
    for name in followed(list(dict.fromkeys((*stored.experiments(), *EXPERIMENTS)))):
        sections.append(read(name, stored))
        draw(sections[-1])
    only_own = stored.experiments() and not set(stored.experiments()) & set(EXPERIMENTS)
    whole = not choice and not only_own
    if not whole:
        sections = [section for section in sections if not section.absent]
    source = origin.find(results, choice)
    old = _old(sections)
    drawn_from = "; ".join(filter(None, (origin.described(source), old)))
    errors = [f"{section.experiment}: {error}" for section in sections for error in section.errors]
    report = Report(sections, drawn_from, whole, errors, old=old)
    rows = {section.experiment: section.rows for section in sections}
    if whole:
        _judge(report, rows, source)
    return report


def _judge(report: Report, rows: dict[str, pd.DataFrame], source: Origin) -> None:
    """Adds what only the bench's own page has."""
    report.claims = judge(rows, source)
    starts = {s.experiment: s.provenance["utc"].min() for s in report.sections if len(s.provenance)}
    for judged in report.claims:
        judged.bounds_dates = _bounds_dates(judged.claim, starts.get(judged.claim.experiment))
    findings = ((judged.claim, finding) for judged in report.claims for finding in judged.verdict.findings)
    report.errors += [f"claim {claim.id}: {finding.note}" for claim, finding in findings if finding.broken]
    if len(rows.get("paper", ())):
        _make(report, "errata", _errata)
    _make(report, "answers", lambda: chooser.answers(rows))
    _make(report, "engines", lambda: lists.programs(rows.get("engines", pd.DataFrame())))


def _bounds_dates(claim: claims.Claim, start: str | None) -> str:
    """When the bounds of a claim were set; and, if its rows were measured from `start` on (UTC), whether that was before them."""
    first, last = claim.bounds_set.isoformat(), f"{claim.bounds_changed:%Y-%m-%d}"
    when = f"bounds set on {first}" + (f", last changed on {last}" if last != first else "")
    if start is None:
        return when
    known = "before these rows were measured" if claim.bounds_changed.isoformat() < start else "with these rows known"
    return f"{when}, {known}"


def _make(report: Report, name: str, make: Callable[[], Any]) -> None:
    """Adds a part. Rows of another version cost that part, not the page."""
    try:
        setattr(report, name, make())
    except Exception as error:
        report.errors.append(f"{name}: cannot be made: {described(error)}")


def _old(sections: Sequence[Section]) -> str:
    """How many cells of all sections are old, and what to do about it."""
    old = sources.summary(sum((section.source_ages for section in sections), Counter[str]()))
    if not old:
        return ""
    names = ", ".join(section.experiment for section in sections if section.old)
    folder = shlex.quote(sections[0].origin.folder)
    return f"{old}: {names} (lagrange-bench verify {folder} compares a sample; the same run with --again computes all)"


def judge(rows: dict[str, pd.DataFrame], source: Origin = PUBLISHED) -> list[Judged]:
    """Every claim by the rows of its experiment."""
    judged = []
    for claim in promises.CLAIMS:
        verdict = claims.judge(claim, rows.get(claim.experiment, pd.DataFrame()))
        wanted = PUBLISHED if verdict.word in (claims.UNTESTED, claims.CONSISTENT) else source
        judged.append(Judged(claim, verdict, f"{wanted.run(claim.experiment)} && {wanted.report}"))
    return judged


def fare(judged: list[Judged]) -> str:
    """How claims fare, in words."""
    return ", ".join(f"{count} {word}" for word, count in _counts(judged).items())


def _counts(judged: list[Judged]) -> dict[str, int]:
    """How many claims have each verdict, in the order of a legend."""
    counts = Counter(j.verdict.word for j in judged)
    return {word: counts[word] for word in claims.WORDS if counts[word]}


def write(report: Report, output: Path) -> Path:
    """Writes a report, each file whole or not at all: figures and tables first, then index.html, which links to them.

    Raises
    ------
    ValueError : another's index.html is there. OSError : a file cannot be written.
    """
    output = Path(output)
    refuse_foreign(output)
    for section in report.sections:
        write_section(section, output)
    if len(report.answers):
        write_file(output / "tables" / "answers.csv", tables.csv(report.answers))
    return write_file(output / "index.html", html(report))


def refuse_foreign(output: Path) -> None:
    """ValueError: the index.html in a folder is not a page of the bench."""
    index = output / "index.html"
    if index.is_file() and OURS not in index.read_text(encoding="utf-8", errors="replace"):
        raise ValueError(f"{index} is not a page of lagrange-bench and stays: give another folder with --output")


def _errata() -> pd.DataFrame:
    """The errata of the paper with the magnitudes of their residuals."""
    names = ("section", "equation", "wrong", "as printed", "misses by", "corrected", "then misses by")
    rows = []
    for e in errata.measure():
        printed, corrected = errata.magnitude(e.printed), errata.magnitude(e.corrected)
        wrong = "sentence" if e.prose else "formula"
        rows.append((e.section, e.equation, wrong, e.printed_text, printed, e.corrected_text, corrected))
    return pd.DataFrame(rows, columns=names)


# ---------------------------------------------------------------- to HTML


def html(report: Report) -> str:
    """The page as text."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(show=tables.show, cells=tables.cells, heading=tables.heading, prose=prose)
    template = environment.get_template("template.html.j2")
    parts = {name: Markup((HERE / f"page.{name}").read_text(encoding="utf-8")) for name in ("css", "js")}
    parts["css"] += Markup((live.HERE / "live.css").read_text(encoding="utf-8"))
    pairs = opened(report.sections)
    brief = in_brief(report.claims)
    return template.render(
        report=report,
        in_brief=brief,
        unanswered=sum(len(judged.claim.answers) for judged in report.claims) - len(brief),
        open_pairs=pairs,
        open_figures=[figure for _, figure in pairs],
        picture=Markup(figures.inline((HERE / "exact-step.svg").read_text(encoding="utf-8"), "exact-step", PICTURE)),
        packed=packed,
        answers=Markup(report.answers.to_json(orient="split", index=False, force_ascii=False).replace("</", "<\\/")),
        counts=_counts(report.claims),
        claim_groups=list(claims.grouped(report.claims)),
        environment=environment_facts(report.sections),
        long=LONG,
        lists={"Methods": lists.methods(), "Tops": lists.tops()},
        points=errata.POINTS,
        seed=errata.SEED,
        svg=_inline,
        packed_rows={s.experiment: s.packed for s in report.sections if 0 < len(s.packed) < HEAVY},
        packed_phones=_packed_phones(pairs),
        live=live.script(),
        **parts,
    )


def prose(text: str) -> Markup:
    """A text of the sources as HTML: `words` of code, numbers and powers as in the tables."""
    parts = text.split("`")
    html = [Markup("<code>{}</code>").format(part) if i % 2 else _typeset(part) for i, part in enumerate(parts)]
    return Markup("").join(html)


def _typeset(text: str) -> Markup:
    return Markup(POWER.sub(r"<sup>\1\2</sup>", str(escape(tables.numbers_in(text)))))


def _inline(section: Section, figure: DrawnFigure) -> Markup:
    return Markup(figures.inline(figure.document, section.file(figure.name), figure.caption or section.title))


def _packed_phones(pairs: Sequence[tuple[Section, DrawnFigure]]) -> dict[str, Markup]:
    """The drawings for phones of the figures that are not folded, ready to be put into their cards."""
    drawn = ((section.file(f.name), f.phone, f.caption or section.title) for section, f in pairs if f.phone)
    return {name: packed(figures.inline(phone, f"{name}-phone", label)) for name, phone, label in drawn}


def opened(sections: Sequence[Section]) -> list[tuple[Section, DrawnFigure]]:
    """The figures that are not folded: those named in OPENED, or else the first of each section, as many at most."""
    drawn = {section.file(figure.name): (section, figure) for section in sections for figure in section.figures}
    firsts = [(section, section.figures[0]) for section in sections if section.figures]
    return [drawn[name] for name in OPENED if name in drawn] or firsts[: len(OPENED)]


def environment_facts(sections: list[Section]) -> list[tuple[str, str]]:
    """(fact, values) of where the rows come from."""
    facts: dict[str, list[str]] = {fact: [] for fact in FACTS}
    for section in sections:
        for fact in section.provenance.columns.drop(list(MEASURED_WHEN), errors="ignore"):
            facts.setdefault(fact, []).extend(section.provenance[fact].astype(object).map(tables.show).unique())
    return [(fact, "; ".join(dict.fromkeys(values))) for fact, values in facts.items() if values]
