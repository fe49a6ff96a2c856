"""What the commands of the command line do, but for `integrate`, which has a file of its own."""

from __future__ import annotations

import argparse
import difflib
import importlib
import json
import math
import shlex
import sys
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from integrators import Method

CONDA_NAMES = {"heyoka": "heyoka.py"}  # where conda-forge calls a package otherwise
YES_NO = {True: "yes", False: "no", None: "?"}


class Answer(NamedTuple):
    """What a command prints, as text or with --json as data, and the exit code."""

    text: str
    data: Any
    code: int = 0


# ---------------------------------------------------------------- methods and tops


def methods(options: argparse.Namespace) -> Answer:
    """Every method in legend order; one that cannot be loaded is listed with the reason."""
    from integrators import INVARIANTS, METHODS, available

    data: list[dict[str, Any]] = []
    for name in METHODS:
        try:
            method = METHODS[name]
        except Exception as error:  # somebody else's package: whatever is wrong with it, the others are still there
            data.append({"name": name, "error": f"{type(error).__name__}: {error}"})
            continue
        fields = ("label", "family", "order", "symmetric", "poisson", "control", "requires", "source")
        claims = {field: getattr(method, field) for field in fields}
        kept = [invariant for invariant in INVARIANTS if invariant in method.conserves]
        more = {"conserves": kept, "available": available(method), "options": list(method.options)}
        data.append({"name": name, **claims, **more})
    header = ("name", "label", "family", "order", "symmetric", "Poisson", "conserves", "control", "available")
    lines = [*table([header, *map(_method_row, data)]), *_method_notes(data)]
    if options.verbose:
        for claims in data:
            known = ", ".join(claims.get("options") or ["none"])
            lines += ["", claims["name"], f"  source:  {claims.get('source', '?')}", f"  options: {known}"]
    return Answer("\n".join(lines), data)


def _method_row(claims: dict[str, Any]) -> tuple[str, ...]:
    if "error" in claims:
        return (claims["name"], *"-------", "no")
    order = "exact" if claims["order"] is None else str(claims["order"])
    symmetric, poisson, here = (YES_NO[claims[field]] for field in ("symmetric", "poisson", "available"))
    kept = " ".join(claims["conserves"]) or "-"
    return claims["name"], claims["label"], claims["family"], order, symmetric, poisson, kept, claims["control"], here


def _method_notes(data: list[dict[str, Any]]) -> list[str]:
    """What is missing, once for each package, and how to get it."""
    missing: dict[str, list[str]] = {}
    for claims in data:
        if claims.get("available") is False:
            missing.setdefault(claims["requires"], []).append(claims["name"])
    notes = [f"{', '.join(names)}: {how_to_get(package)}" for package, names in missing.items()]
    return notes + [f"{claims['name']}: cannot be loaded: {claims['error']}" for claims in data if "error" in claims]


def how_to_get(package: str) -> str:
    """Where a package that is not installed here comes from."""
    command = f"conda install -c conda-forge {CONDA_NAMES.get(package, package)}"
    return f"{package} is not installed here; it comes with {command} (on Linux also with pip)"


def tops(options: argparse.Namespace) -> Answer:
    """The named tops."""
    from integrators import TOPS, exact

    data, rows = [], [("name", "alpha", "state J1,J2,J3,x1,x2,x3", "motion", "nutation", "note")]
    for named in TOPS.values():
        kind, period = exact.regime(named.top, named.state), exact.nutation_period(named.top, named.state)
        state = ",".join(f"{v:.10g}" for v in named.y0)
        rows.append((named.name, f"{named.alpha:g}", state, kind, f"{period:.4g}", named.note))
        facts = {"regime": kind, "nutation_period": plain(period), "label": named.label, "note": named.note}
        data.append({"name": named.name, "alpha": named.alpha, "state": list(named.y0), **facts})
    return Answer("\n".join(table(rows)), data)


# ---------------------------------------------------------------- run, report, check


def run(options: argparse.Namespace) -> Answer:
    """Compute what is missing, draw what a file of the user asked for, and say what to do next."""
    from experiments import EXPERIMENTS, SWEEP, engine
    from experiments.store import default_results

    if any("." in name for name in options.experiments):
        search_current_folder()
    names = [_sweep(name) for name in options.experiments] or EXPERIMENTS
    sweeps = [name for name in names if name.startswith(SWEEP)]
    own = len(sweeps) == len(names)  # a folder of its own: the page of a profile is not the place for it
    results = options.results or default_results(sweeps[0].removeprefix(SWEEP) if own else options.profile)
    where = {"shard": options.shard, "scheduler": options.scheduler, "timings": not options.no_timings}
    where["again"] = options.again
    limit, show = options.time_limit, not options.quiet
    summary = engine.run(names, options.profile, results, options.jobs, show, time_limit=limit, **where)
    drawn = [path for name in sweeps for path in _draw_sweep(name, results)]
    lines = [str(summary), *(f"drawn: {path}" for path in drawn if path.suffix == ".svg")]
    if summary.exit_code:
        lines.append(f"again, the failed cells only: {shlex.join(['lagrange-bench', *options.words])}")
    if summary.old and not options.again:
        lines.append(f"again, the old cells: {shlex.join(['lagrange-bench', *options.words, '--again'])}")
    report = f"lagrange-bench report --results {shlex.quote(str(results))}"
    report += "".join(f" --module {module}" for module in _own_modules(names))
    data = {**summary.as_dict(), "drawn": [str(path) for path in drawn], "next": report}
    return Answer("\n".join([*lines, f"next: {report}"]), data, summary.exit_code)


def _own_modules(experiments: Iterable[str]) -> list[str]:
    """What the user has named of their own: a report imports it only if it is named again."""
    from experiments import SWEEP, load

    modules = []
    for name in experiments:
        if name.startswith(SWEEP):
            methods = [cell["method"] for cell in load(name).cells("full")]
            modules += [method.partition(":")[0] for method in methods if ":" in method]
        elif "." in name:
            modules.append(name)
    return list(dict.fromkeys(modules))


def _sweep(name: str) -> str:
    """The experiment that a word on the command line means."""
    if not name.endswith(".toml"):
        return name
    from experiments import sweep

    return sweep.read(name)


def _draw_sweep(name: str, results: Path) -> list[Path]:
    """Figures and tables of a sweep, beside its journal; of a shard, or where all is skipped, perhaps none."""
    from experiments.store import Store
    from report import page

    return page.write_experiment(name, results, results) if Store(results).latest(name) else []


def merge(options: argparse.Namespace) -> Answer:
    """Append to one store what others have and it has not."""
    from experiments.store import Store, StoreError

    target = Store(options.results)
    for folder in options.folders:
        if not Store(folder).experiments():
            raise StoreError(f"no results in {folder}: give folders that lagrange-bench run wrote to")
    rows, data, damaged = [("from", "experiment", "records added", "damaged lines left out")], [], 0
    for folder in options.folders:
        for experiment, (added, torn) in target.merge(Store(folder)).items():
            rows.append((str(folder), experiment, str(added), str(torn)))
            data.append({"from": str(folder), "experiment": experiment, "added": added, "damaged": torn})
            damaged += torn
    note = "\nthe cells of damaged lines count as not computed: the run that made them computes them again"
    text = "\n".join([*table(rows), f"results: {options.results}"])
    return Answer(text + (note if damaged else ""), {"results": str(options.results), "merged": data})


def compare(options: argparse.Namespace) -> Answer:
    """What two stores differ in; exit code 1 if in anything."""
    from experiments import compare as stores

    import_modules(options.module)
    tolerance = {"rtol": options.rtol, "atol": options.atol}
    found = stores.compare(options.old, options.new, **tolerance, times=options.times, threshold=options.threshold)
    rows: list[tuple[str, ...]] = [("experiment", "cells old", "new", "same", "added", "removed", "changed")]
    for name, c in found.experiments.items():
        counts = (c.old, c.new, c.same, len(c.added), len(c.removed), len(c.changed))
        rows.append((name, *map(str, counts)))
    lines = table(rows)
    for name, c in found.experiments.items():
        for what, those in (("removed", c.removed), ("added", c.added)):
            lines += _listed(name, what, those, None) if options.verbose else _counted(name, what, those)
        lines += _changed(name, c.changed)
    if options.times:
        lines += ["", *_times(found.times, options.threshold)]
    lines += [*found.notes, "the same" if found.same else "not the same"]
    cells = {
        name: {**vars(c), "changed": [_change(cell, differing) for cell, differing in c.changed]}
        for name, c in found.experiments.items()
    }
    data = {"same": found.same, "experiments": cells, "times": [asdict(t) for t in found.times], "notes": found.notes}
    return Answer("\n".join(lines), plain(data), 0 if found.same else 1)


def verify(options: argparse.Namespace) -> Answer:
    """Compute stored cells again; exit code 1 if rows changed."""
    from experiments import compare as stores
    from experiments import sources
    from experiments.store import default_results

    import_modules(options.module)
    folder = options.folder or default_results()
    more = {"longest": options.longest, "jobs": options.jobs, "show": not options.quiet, "old": options.old}
    found = stores.verify(folder, options.sample, options.seed, **more)
    by_experiment: dict[str, list[Any]] = {}
    for name, cell, differing, _ in found.changed:
        by_experiment.setdefault(name, []).append((cell, differing))
    lines = [line for name, changed in by_experiment.items() for line in _changed(name, changed)]
    sum_up = f"{found.cells} cells computed again: {found.identical} identical, {found.close} within the tolerance of "
    sum_up += f"libraries, {len(found.changed)} changed"
    ages = Counter(age for *_, age in found.changed)
    told = {sources.OTHER: "other source code", sources.UNKNOWN: "source code that was not recorded"}
    words = [f"{ages[age]} of them stored with {text}" for age, text in told.items() if ages[age]]
    data = {
        **{name: getattr(found, name) for name in ("stored", "cells", "identical", "close", "notes")},
        "changed": [
            {"experiment": name, "sources": age, **_change(cell, differing)}
            for name, cell, differing, age in found.changed
        ],
    }
    sum_up = "; ".join([sum_up, *words])
    return Answer("\n".join([*lines, *found.notes, sum_up]), plain(data), 1 if found.changed else 0)


MOST = 10  # cells listed of a kind


def _listed(experiment: str, what: str, cells: Sequence[dict[str, Any]], most: int | None = MOST) -> list[str]:
    lines = [f"{what}: {experiment} {json.dumps(cell, ensure_ascii=False)}" for cell in cells[:most]]
    return lines + ([f"… and {len(cells) - len(lines)} more {what} in {experiment}"] if len(cells) > len(lines) else [])


def _counted(experiment: str, what: str, cells: Sequence[dict[str, Any]]) -> list[str]:
    """One line: how many, and of which parts."""
    if not cells:
        return []
    parts = Counter(str(cell["part"]) for cell in cells if "part" in cell)
    told = f" ({', '.join(f'{count} of {part}' for part, count in parts.items())})" if parts else ""
    return [f"{what}: {len(cells)} cell{'' if len(cells) == 1 else 's'} of {experiment}{told}; --verbose lists them"]


def _changed(experiment: str, changed: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> list[str]:
    """By how much, column by column; then the first few cells."""
    if not changed:
        return []
    rows: list[tuple[str, ...]] = [("column", "cells", "rows", "largest difference", "relative", "old", "new")]
    for column in dict.fromkeys(name for _, differing in changed for name in differing):
        found = [differing[column] for _, differing in changed if column in differing]
        worst = max(found, key=lambda difference: difference.relative)
        sizes = (f"{max(difference.absolute for difference in found):.1e}", f"{worst.relative:.1e}")
        counts = (str(len(found)), str(sum(difference.rows for difference in found)))
        rows.append((column, *counts, *sizes, _short(worst.old), _short(worst.new)))
    return [
        "",
        f"changed in {experiment}:",
        *table(rows),
        *_listed(experiment, "changed", [cell for cell, _ in changed]),
    ]


def _change(cell: dict[str, Any], differing: dict[str, Any]) -> dict[str, Any]:
    return {"cell": cell, "columns": {column: asdict(difference) for column, difference in differing.items()}}


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


def _times(tested: Sequence[Any], threshold: float) -> list[str]:
    if not tested:
        return ["no timing cells to compare"]
    different = [group for group in tested if group.verdict != "same"]
    rows: list[tuple[str, ...]] = [("times", "method", "column", "cells", "pairs", "new/old", "p", "verdict")]
    for g in different:
        counts = (str(g.cells), str(g.pairs), f"{g.ratio:.3f}", f"{g.p:.1e}")
        rows.append((g.experiment, g.method, g.column, *counts, g.verdict))
    sum_up = f"{len(tested)} groups of times, {len(different)} differ by more than {threshold:.0%} and significantly"
    return [*(table(rows) if different else []), sum_up]


def report(options: argparse.Namespace) -> Answer:
    """Build the page from stored results, and say what could not be drawn."""
    from report.__main__ import make

    show = not (options.quiet or options.json)
    made = make(options.results, options.output, show, options.module)
    for line in made.remarks if not options.quiet else ():
        print(line, file=sys.stderr)
    data = {"page": str(made.page), "results": str(made.results), "not_drawn": made.errors, "notes": made.notes}
    return Answer(str(made.page), data, made.exit_code)


def figure(options: argparse.Namespace) -> Answer:
    """Draw one stored figure, or all of them, as files."""
    from experiments import progress
    from report import export
    from report.__main__ import find

    if options.all == (options.name is not None):
        raise ValueError("give the name of a figure, as phase_h, or --all")
    import_modules(options.module)
    results, _ = find(options.results)
    with progress.drawing(results, show=not (options.quiet or options.json)) as drawn:
        if options.all:
            chosen = {"kinds": options.format, "widths": options.width}
            some = {name: (value,) for name, value in chosen.items() if value}
            written, unknown = export.export_all(results, options.output or Path("figures"), **some, drawn=drawn)
        else:
            unknown, written = (
                [],
                [export.export(options.name, results, options.output, options.format or "svg", options.width)],
            )
    for reason in unknown if not options.quiet else ():
        print(f"not drawn: {reason}", file=sys.stderr)
    data = {"written": [str(path) for path in written], "not_drawn": unknown, "results": str(results)}
    return Answer("\n".join(map(str, written)), data, 1 if unknown else 0)


def check(options: argparse.Namespace) -> Answer:
    """Test the claims of one method; one that fails makes exit code 1."""
    from experiments import check as checks

    method = find_method(options.method)
    verdicts = checks.check(method, quick=options.quick)
    rows = [("verdict", "claim", "measured", "bound", "how")]
    for verdict in verdicts:
        measured = "" if verdict.measured is None else f"{verdict.measured:.3g}"
        rows.append((verdict.word, verdict.claim, measured, verdict.bound, " ".join(verdict.how.split())))
    failed = [verdict.claim for verdict in verdicts if verdict.passed is False]
    held = sum(verdict.passed is True for verdict in verdicts)
    sum_up = f"{method.name} ({method.label}): {held} claims hold, {len(failed)} fail"
    sum_up += f": {', '.join(failed)}" if failed else ""
    notes = _name_taken(options.method, method)
    listed = [{**asdict(verdict), "verdict": verdict.word} for verdict in verdicts]
    data = {"method": method.name, "passed": not failed, "verdicts": plain(listed), "notes": notes}
    return Answer("\n".join([*table(rows), "", *notes, sum_up]), data, 1 if failed else 0)


def _name_taken(word: str, method: Method) -> list[str]:
    """What to tell who checks a method of their own that is called like one of the registry."""
    from integrators import METHODS

    if ":" not in word or method.name not in METHODS:
        return []
    try:
        taken = METHODS[method.name] != method
    except Exception:  # a plug-in that cannot be loaded has its name all the same
        taken = True
    return [f"the name {method.name} is taken: choose another for an entry point"] if taken else []


def errata(options: argparse.Namespace) -> Answer:
    """Every erratum of the paper with the residual of the statement as printed and as corrected."""
    from experiments import errata as paper

    found = paper.measure(options.points, options.seed)
    rows = [("section", "equation", "wrong", "residual", "", "statement")]
    for e in found:
        wrong = "sentence" if e.prose else "formula"
        rows.append((e.section, e.equation, wrong, f"{e.printed:.1e}", "printed", e.printed_text))
        rows.append(("", "", "", f"{e.corrected:.1e}", "corrected", e.corrected_text))
    sum_up = f"wrong: {paper.count(found)}; at {options.points} random points each: "
    sum_up += "the smallest residual as printed, the largest as corrected"
    return Answer("\n".join([*table(rows), "", sum_up]), plain([asdict(e) for e in found]))


def bits(options: argparse.Namespace) -> Answer:
    """Compare the bits of compiled kernels with those written down; exit code 1 if any differ."""
    from experiments import bits as machine
    from integrators import METHODS

    for name in options.kernels:
        if (method := name.removesuffix(" compensated")) not in METHODS:
            raise ValueError(f"unknown kernel {name!r}{closest(method, METHODS)} (see lagrange-bench methods)")
    golden, only = machine.golden(), options.kernels or None
    found = {"compiled": machine.measured(machine.COUNTS[1 if options.quick else -1], only)}
    if strange := set(only or ()) - {
        word for kernel in found["compiled"] for word in (kernel, kernel.partition(" ")[0])
    }:
        raise ValueError(f"{sorted(strange)[0]} has no kernel of its own whose bits could be compared")
    if options.python:
        found["interpreted"] = machine.in_python(only)
    verdicts = [(how, verdict) for how, hashes in found.items() for verdict in machine.compare(golden, hashes)]
    rows, counts = [("kernel", "run", "hashes", "verdict")], dict.fromkeys((True, False, None), 0)
    for how, verdict in verdicts:
        counts[verdict.passed] += 1
        word = {True: "same", False: f"differs at {verdict.first}", None: "not written down"}[verdict.passed]
        if not (options.quiet and verdict.passed):
            rows.append((verdict.kernel, how, str(verdict.compared), word))
    sum_up = f"{counts[True]} the same, {counts[False]} differ, {counts[None]} not written down"
    data = {"same": not counts[False], "verdicts": [{"run": how, **asdict(verdict)} for how, verdict in verdicts]}
    lines = [*table(rows), "", sum_up] if len(rows) > 1 else [sum_up]
    return Answer("\n".join(lines), data, 1 if counts[False] else 0)


# ---------------------------------------------------------------- shared


def find_method(name: str) -> Method:
    """The method of a registry name or of `package.module:METHOD`.

    Raises
    ------
    ValueError : there is none, or it cannot be loaded here; the message says why.
    """
    from integrators import METHODS, Method, available

    try:
        if ":" in name:
            search_current_folder()
            module, _, attribute = name.partition(":")
            method = getattr(importlib.import_module(module), attribute)
        else:
            method = METHODS[name]
    except KeyError as error:
        if Path(f"{name}.py").is_file():
            raise ValueError(
                f"no method is registered as {name!r}; for the one in {name}.py say {name}:METHOD"
            ) from None
        raise ValueError(str(error.args[0])) from None
    except Exception as error:  # importing somebody else's module may raise anything
        raise ValueError(f"method {name} cannot be loaded: {type(error).__name__}: {error}") from error
    if not isinstance(method, Method):
        raise ValueError(f"method {name} is a {type(method).__name__}, not an integrators.Method")
    if not available(method):
        raise ValueError(f"method {name}: {how_to_get(str(method.requires))}")
    return method


def find_stored_method(name: str) -> Method:
    """As `find_method`, of a name that results bring with them: no module is imported for `module:METHOD`."""
    module, colon, _ = name.partition(":")
    if colon and module not in sys.modules:
        raise ValueError(f"unknown method {name!r}; if it is your own, add --module {module}")
    return find_method(name)


def import_modules(names: Iterable[str]) -> None:
    """Imports the modules that the user names with --module, from the current folder too: results may name them then."""
    for name in names:
        search_current_folder()
        try:
            importlib.import_module(name)
        except Exception as error:  # somebody's own module may raise anything
            raise ValueError(f"--module {name} cannot be imported: {type(error).__name__}: {error}") from error


def search_current_folder() -> None:
    """Find modules in the current folder, as `python -m` does; after everything that is installed."""
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))


def closest(name: str, known: Iterable[str]) -> str:
    """A question for who mistyped a name; empty if nothing is near."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with aligned columns."""
    widths = [max(map(_width, column)) for column in zip(*rows, strict=True)]
    padded = ([cell + " " * (width - _width(cell)) for cell, width in zip(row, widths, strict=True)] for row in rows)
    return ["  ".join(row).rstrip() for row in padded]


def _width(text: str) -> int:
    """Columns of a terminal: the tilde of J̃ takes none."""
    return sum(not unicodedata.combining(character) for character in text)


def plain(value: Any) -> Any:
    """`value` for JSON: arrays become lists, NaN and infinities null."""
    if isinstance(value, dict):
        return {str(key): plain(content) for key, content in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(content) for content in value]
    if isinstance(value, complex):
        return str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value
