"""What the documents show is what happens: their code runs, their links resolve, their commands exist."""

from __future__ import annotations

import importlib.util
import inspect
import json
import math
import random
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot
from mpmath import mp
from packaging.requirements import Requirement
from packaging.version import Version
from scipy.integrate import solve_ivp

from lagrange_bench import __main__ as cli
from lagrange_bench import integrators
from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.experiments.measuring import states
from lagrange_bench.experiments.measuring.metrics import phase_split, poisson_defect, scaled_error
from lagrange_bench.integrators import PERTURBED_TOPS, TOPS, LagrangeTop, integrate, prepare, two_point
from lagrange_bench.integrators.methods import backlund_schemes
from lagrange_bench.integrators.paper import interpolating_flow, lax
from lagrange_bench.integrators.paper import two_point as paper_two_point
from lagrange_bench.integrators.torus import time_step
from lagrange_bench.integrators.truth import exact, reference
from tests.reference import largest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
NOTEBOOK = DOCS / "notebook" / "the-top.ipynb"


# ---------------------------------------------------------------- running a page


def script(path: Path):
    """A file of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = sys.modules[path.stem] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


outputs = script(DOCS / "outputs.py")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty current folder whose modules are found, and forgotten afterwards, as are figures that were left open."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield tmp_path
    for module in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[module], "__file__", "")):
            del sys.modules[module]
    pyplot.close("all")


@pytest.mark.parametrize("page", outputs.PAGES, ids=lambda page: page.stem)
def test_pages_print_what_they_show(page, folder):
    """If this fails: python docs/outputs.py, and read what changed."""
    for block, printed in outputs.execute(page):
        where = f"{page.name}, line {block.line}"
        if block.shown is not None:
            assert printed.rstrip() == block.shown.rstrip(), where
        elif block.kind == "python":
            assert bool(printed.strip()) == block.varies, f"{where}: prints what is not shown"


def test_a_page_that_lies_is_found_out(folder):
    page = folder / "page.md"
    page.write_text(
        "```python\nx = 1\nprint(x + 1)\n```\n\n```text\n3\n```\n\n```python\nx / 0\n```\n", encoding="utf-8"
    )
    (first, second) = outputs.blocks(page.read_text(encoding="utf-8"))
    assert (first.shown, second.shown, second.line) == ("3\n", None, 10)
    with pytest.raises(ZeroDivisionError) as caught:
        outputs.execute(page)
    assert caught.traceback[-1].lineno + 1 == 11
    page.write_text("```sh\nlagrange-bench methods --no-such-option\n```\n", encoding="utf-8")
    with pytest.raises(AssertionError, match="no-such-option"):
        outputs.execute(page)


def test_what_a_page_shows_is_written_anew(folder):
    page = folder / "page.md"
    shown = "```python\nprint({0})\n```\n\n```text{1}\n{2}\n```\n\nWords.\n\n"
    text = shown.format("'long, longer'", "", "old") + shown.format("2", " varies", "1") + "```python\nx = 1\n```\n"
    page.write_text(text, encoding="utf-8")
    assert outputs.refreshed(page) == text.replace("\nold\n", "\nlong, longer\n").replace("varies\n1\n", "varies\n2\n")


def test_the_table_of_published_references_is_computed():
    """If this fails: python docs/published.py, and read what changed."""
    published = script(DOCS / "published.py")
    assert published.written() == published.PAGE.read_text(encoding="utf-8")


# ---------------------------------------------------------------- links and commands


def slug(heading: str) -> str:
    """The anchor a forge makes of a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_resolve(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?:|mailto:", target):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.*)$", there.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in map(slug, headings), target


def commands() -> dict[str, set[str]]:
    """Every command with its options, as argparse knows them; "" for the program itself."""
    top = cli.parser()
    (sub,) = (action for action in top._actions if action.dest == "==SUPPRESS==" or hasattr(action, "_name_parser_map"))
    parsers = {"": top, **sub.choices}
    return {name: {o for action in p._actions for o in action.option_strings} for name, p in parsers.items()}


def unknown(text: str) -> list[str]:
    """What a page says of `lagrange-bench` that is not so."""
    known, wrong = commands(), []
    for mention in re.findall(r"lagrange-bench +([^`\n|&#…]*)", text):
        words = re.findall(r"\S+", mention)
        if not words or not re.fullmatch(r"-?-?[a-z]\w*", words[0]):
            continue  # no command: prose, or a placeholder
        command = words[0] if not words[0].startswith("-") else ""
        wrong += [] if command in known else [words[0]]
        for word in words:
            if re.match(r"--?[a-z]", word) and word.partition("=")[0].rstrip(".,;:)") not in known.get(command, ()):
                wrong.append(f"{command} {word}")
        if command == "run":
            named = [w for w in words[1:2] if re.fullmatch(r"[a-z_]+", w)]
            wrong += [f"run {w}" for w in named if w not in EXPERIMENTS and w not in ("my_study",)]
    everything = set().union(*known.values())
    for option in re.findall(r"`(--[a-z][\w-]*)[^`]*`", text):
        wrong += [] if option in everything else [option]
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_commands_exist(page):
    text = page.read_text(encoding="utf-8")
    assert unknown(text) == []
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"(?:`|^ +|^)make (\w+)(?:`| {2,}|$)", text, re.MULTILINE):
        assert f"\n{target}:" in makefile, target
    for test in re.findall(r"`(?:test_\w+\.)?(test_\w+)`", text):
        assert any(f"def {test}(" in code for code in sources()) or (ROOT / "tests" / f"{test}.py").exists(), test
    for file in re.findall(r"`((?:tests|experiments|integrators|report|docs)/[\w/.-]+)`", text):
        assert (ROOT / file).exists(), file


def sources() -> list[str]:
    return [path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")]


def test_an_unknown_command_is_found_out():
    assert unknown("`lagrange-bench run drift --profile full` and `lagrange-bench --version`") == []
    assert unknown(
        "    lagrange-bench dance\n`lagrange-bench run drift --fast`, `lagrange-bench run drfit`, `--no-such`"
    ) == [
        "dance",
        "run --fast",
        "run drfit",
        "--no-such",
    ]


# ---------------------------------------------------------------- reference


def public():
    """(name, thing) of every function, class and module a user imports, and of what is in them."""
    for name in integrators.__all__:
        thing = getattr(integrators, name)
        if not (inspect.isroutine(thing) or inspect.isclass(thing) or inspect.ismodule(thing)):
            continue  # a table
        yield name, thing
        inner = () if inspect.isroutine(thing) else getattr(thing, "__all__", vars(thing))
        for key in (key for key in inner if not key.startswith("_")):
            member = vars(thing)[key]
            member = member.fget if isinstance(member, property) else member
            if inspect.isroutine(member) or inspect.isclass(member):
                yield f"{name}.{key}", member


def test_everything_public_has_a_docstring():
    found = dict(public())
    assert len(found) > 30
    assert [name for name, thing in found.items() if not written(thing)] == []


def written(thing) -> bool:
    """Whether it has a docstring of its own, not the signature that dataclasses make up."""
    text = thing.__doc__ or ""
    return bool(text.strip()) and not text.startswith(f"{getattr(thing, '__name__', '')}(")


@pytest.mark.processes
@pytest.mark.skipif(importlib.util.find_spec("pdoc") is None, reason="needs pdoc: pip install 'lagrange-bench[docs]'")
@pytest.mark.slow
def test_the_reference_is_written_without_a_warning(tmp_path):
    """In a process of its own, in which kernels are Python functions. No page asks the network for anything."""
    words = [sys.executable, str(DOCS / "reference.py"), str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    pages = list(tmp_path.rglob("*.html"))
    assert {"integrators.html", "exact.html", "two_point.html", "drift.html"} <= {page.name for page in pages}
    for page in pages:
        fetched = re.findall(
            r"(?:src=|<link[^>]*href=|url\(|@import )[\"']?https?://[^\"')\s]+", page.read_text(encoding="utf-8")
        )
        assert fetched == [], page.name


# ---------------------------------------------------------------- the paper


def test_the_paper_names_figures_that_exist_and_programs_that_are_missing(monkeypatch, capsys):
    paper = script(DOCS / "paper.py")
    named = [name for name, _ in paper.FIGURE.findall(paper.PAGE.read_text(encoding="utf-8"))]
    assert len(named) > 3
    assert all(name.partition("_")[0] in EXPERIMENTS for name in named)
    monkeypatch.setattr(paper.shutil, "which", lambda program: None)
    monkeypatch.setattr(sys, "argv", ["paper.py"])
    with pytest.raises(SystemExit) as caught:
        paper.main()
    assert caught.value.code == 2
    assert re.search("not installed: apt-get install pandoc texlive-xetex", capsys.readouterr().err)


def test_the_paper_in_latex():
    """Formulas stay formulas, links into the repository become text, and no letter is left that the font lacks."""
    paper = script(DOCS / "paper.py")
    if paper.missing():
        pytest.skip("needs pandoc and xelatex")
    text = paper.latex("# Title\n\n(5) [λ(h)](a.md) and `test_a.b` with $\\lambda$ ∎\n")
    body = text.partition(r"\begin{document}")[2]
    assert (
        r"(5) {\ensuremath{\lambda}(h)} and \texttt{test\_\allowbreak{}a.\allowbreak{}b} with \(\lambda\)"
        in " ".join(body.split())
    )
    assert not set(body) & set(paper.LETTERS)


# ---------------------------------------------------------------- the notebook


def test_the_notebook_shows_what_its_source_does():
    """Cells as in the source, texts as when run, one picture for each figure. If not: python docs/notebook/build.py."""
    import matplotlib.pyplot as plt

    build = script(NOTEBOOK.with_name("build.py"))
    stored = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert NOTEBOOK.stat().st_size < 300_000
    assert (stored["nbformat"], stored["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in stored["cells"]}) == len(stored["cells"])
    assert [(cell["cell_type"], "".join(cell["source"])) for cell in stored["cells"]] == build.cells()
    try:
        fresh = build.notebook()
    finally:
        plt.close("all")
    for old, new in zip(stored["cells"], fresh["cells"], strict=True):
        kinds = [[o["output_type"] for o in cell.get("outputs", [])] for cell in (old, new)]
        assert kinds[0] == kinds[1]
        texts = [[o["text"] for o in cell.get("outputs", []) if "text" in o] for cell in (old, new)]
        assert texts[0] == texts[1]


# ---------------------------------------------------------------- what docs/exact-step.md says and no other test shows


def turned(y, angle):
    c, s = math.cos(angle), math.sin(angle)
    J1, J2, J3, x1, x2, x3 = y
    return np.array((c * J1 - s * J2, s * J1 + c * J2, J3, c * x1 - s * x2, s * x1 + c * x2, x3))


def read_off(top, y, image):
    """λ from two states, by linear equations; (3)."""
    d, s, moved = image[:3] - y[:3], image[:3] + y[:3], image[3:] - y[3:]
    w = np.array((d[1], -d[0], 0.0)) / (2 * top.alpha)
    rest = (moved - np.cross(s, w))[:2]
    R, w[2] = np.linalg.solve(((d[0], s[1]), (d[1], -s[0])), rest)
    return complex(R, np.linalg.norm(w))


def test_two_states_of_a_torus_are_one_step_apart():
    """Any translation (T, Θ) of any torus is one step, and the linear equations find it; on the other sheet it is not."""
    draw, sheets = random.Random(3), {1: 0, -1: 0}
    for _ in range(300):
        top, y = LagrangeTop(draw.uniform(-2, 2)), np.array([draw.gauss(0, 1) for _ in range(6)])
        T = draw.uniform(-1, 1) * exact.nutation_period(top, y)
        image = turned(exact.solution(top, y, T), draw.uniform(0, 2 * math.pi))
        lam = read_off(top, y, image)
        errors = {sheet: np.max(np.abs(two_point(top, y, lam, sheet) - image)) for sheet in sheets}
        found = min(errors, key=errors.get)
        assert errors[found] < 1e-10
        assert errors[-found] > 1e-4
        sheets[found] += 1
    assert min(sheets.values()) > 100


@pytest.mark.parametrize("sheet", [1, -1])
@pytest.mark.parametrize("angle", [0.3, 1.5, 2.5])
def test_far_away_a_step_is_a_turn(angle, sheet):
    """|λ| → ∞ with m ≈ ± alpha λ²: T = 0, Θ = ± 2 arg λ."""
    top, y = TOPS["generic"].top, TOPS["generic"].state
    image = two_point(top, y, 1e9 * complex(math.cos(angle), math.sin(angle)), sheet)
    assert np.max(np.abs(image - turned(y, sheet * 2 * angle))) < 1e-7


def test_what_one_long_step_rounds():
    """Tens of ulps of C1 at half a nutation period; at a tenth of it a few."""
    found = {0.499: [], 0.05: []}
    for name in (*TOPS, *states.RANDOM):
        top, y0 = states.find(name)
        period = exact.nutation_period(top, y0)
        for share in found if math.isfinite(period) else ():
            y = prepare(top, y0, share * period, pin=0).record(y0, 300, 1)
            steps = np.abs(np.diff(top.invariants(y)[:, 2])) / np.spacing(y0[3:] @ y0[3:])
            found[share].append(np.max(steps))
    assert 10 < np.max(found[0.499]) < 100
    assert np.max(found[0.05]) < 10


def clock(method, h):
    """T/h of single steps from 24 places of one torus: how far along the flow each goes, whatever it turns about e3."""
    top, y0 = TOPS["generic"].top, TOPS["generic"].state
    found = []
    for y in exact.solution(top, y0, exact.nutation_period(top, y0) * np.arange(24) / 24):
        image, T = prepare(top, y, h, method).advance(y, 1), h
        for _ in range(10):  # the phase error is linear in a small error only
            truth = exact.solution(top, y, [T])
            T += float(phase_split(top, truth, image - truth)["time"][0])
        found.append(T / h)
    return np.array(found)


def test_invariants_alone_do_not_make_a_clock():
    """The implicit midpoint rule keeps all four and is no Poisson map; the paper's λ makes one: T is that of the torus."""
    assert np.ptp(clock("implicit_midpoint", 0.25)) > 0.01
    paper = clock("backlund_paper", 0.25)
    assert np.ptp(paper) < 1e-13
    assert abs(paper[0] - 1) > 1e-3


def test_lambda_meets_a_real_double_root_only_where_the_flow_is_the_identity():
    """A regular precession that goes round in 2π, well before half a nutation period: λ(2π) is the double root 1."""
    top, s = LagrangeTop(1.0), math.sqrt(1 - 0.95**2)
    y = np.array([-s, 0.0, -1.95, s, 0.0, 0.95])
    assert exact.nutation_period(top, y) > 4 * math.pi
    for h in (6.0, 2 * math.pi, 6.5):
        (re, im), _, _ = time_step.time_step(*time_step.torus(top.alpha, tuple(y), h), h)
        assert (abs(complex(re[0], im[0]) - 1) < 1e-12) == (h == 2 * math.pi)
        assert np.max(np.abs(prepare(top, y, h).advance(y, 1) - turned(y, -h))) < 1e-14


def test_a_double_root_leads_to_the_sleeping_top():
    """λ at the complex double root of a homoclinic orbit: m = 0, every state of it has one image, and T is infinite."""
    with mp.workdps(60):
        top, lam, asleep = LagrangeTop(1.0), mp.mpc("-0.6", "0.8"), np.array([0, 0, mp.mpf("1.2"), 0, 0, 1])
        y = np.array([mp.mpf("0.6"), mp.sqrt(mp.mpf("0.44")), mp.mpf("1.2"), mp.mpf("0.8"), mp.mpf(0), mp.mpf("0.6")])
        assert largest(y[3:] + lam * y[:3] + np.array((0, 0, lam * lam))) > 0.5  # a(λ) is not 0

        def image(y, share=1):
            return paper_two_point.pole_free(top, y, share * lam, (share * lam).conjugate())

        for state in (y, y * (1, -1, 1, 1, 1, 1)):
            assert largest(image(state) - asleep) < 1e-28  # √Q(λ) halves the digits
            assert largest(image(state, mp.mpf("0.999")) - asleep) > 1e-4, "negative control"
        times = [interpolating_flow.time_and_turn(top, y, lam * (1 - mp.mpf(10) ** -k))[0] for k in (3, 4)]
    assert float(times[1] - times[0]) == pytest.approx(math.log(10) / 0.8, rel=1e-3)  # −ln δ/(alpha η) + …
    assert float(times[1] - 4 * math.log(10) / 0.8) == pytest.approx(0.5875, abs=1e-3)
    with pytest.raises(ValueError, match="a root of Q"):
        interpolating_flow.time_and_turn(top, y, complex(lam))


def random_steps(count=5):
    """Real tops and states, λ well inside the nearest root of Q, and a direction in which λ moves; 40 digits."""
    draw = random.Random(9)
    for _ in range(count):
        top, y = LagrangeTop(draw.choice((-1.5, 0.75))), np.array([mp.mpf(draw.gauss(0, 1)) for _ in range(6)])
        yield (
            top,
            y,
            mp.mpc(draw.uniform(-0.1, 0.1), draw.uniform(0.05, 0.1)),
            mp.mpc(draw.gauss(0, 1), draw.gauss(0, 1)),
        )


def test_the_residue_that_the_proof_takes():
    """Res_λ N = −(λ'/2)(1 − σ·ã(λ)/m), N = M'/M, against a difference quotient of M at λ; with the other sign not."""
    with mp.workdps(40):
        for top, y, lam, rate in random_steps():

            def dressing(s, u, top=top, y=y, lam=lam, rate=rate):
                z = lam + s * rate
                w = [v.real for v in paper_two_point.axis(top, y, z, z.conjugate())]
                return (u - z.real) * np.eye(2, dtype=int) + 1j * lax.pauli(np.array(w))

            d = mp.mpf(10) ** -15
            moved = (dressing(d, lam) - dressing(-d, lam)) / (2 * d)
            adjugate = 2 * (lam - lam.real) * np.eye(2, dtype=int) - dressing(0, lam)
            residue = moved @ adjugate / (lam - lam.conjugate())
            image = paper_two_point.pole_free(top, y, lam, lam.conjugate())
            a = lax.pauli(image[3:] + lam * image[:3] + np.array((0, 0, lam * lam * top.alpha)))
            for sign, right in ((1, True), (-1, False)):
                claimed = -rate / 2 * (np.eye(2, dtype=int) - sign * a / lax.root(top, y, lam))
                assert (largest(residue - claimed) < 1e-20) == right


def test_the_field_of_a_step_is_hamiltonian():
    """∂T/∂J3 = ∂Θ/∂H, both −2 alpha Im ∫ u³ du/m³: what makes the step a Poisson map."""
    with mp.workdps(30):
        for top, y, lam, _ in random_steps(2):
            q, d = [c.real for c in lax.spectral_polynomial(top, y + 0 * mp.mpc(1))], mp.mpf(10) ** -10

            def integral(H, J3, power, root, q=q, lam=lam, alpha=top.alpha):
                def f(u):
                    Q = q[0] + u * (q[1] + u * (q[2] + 2 * H + u * (q[3] + 2 * alpha * J3 + u * q[4])))
                    return u**power / mp.sqrt(Q) ** root

                return 2 * mp.quad(lambda t: lam * f(t * lam), [0, 1]).imag

            by_J3 = (integral(0, d, 0, 1) - integral(0, -d, 0, 1)) / (2 * d)
            by_H = top.alpha * (integral(d, 0, 1, 1) - integral(-d, 0, 1, 1)) / (2 * d)
            assert abs(by_J3 - by_H) < 1e-15 * (1 + abs(by_H))
            assert abs(by_J3 + top.alpha * integral(0, 0, 3, 3)) < 1e-15 * (1 + abs(by_H))
            assert abs(by_J3) > 1e-9


@pytest.mark.parametrize(("name", "back"), [("generic", False), ("inverted", False), (None, True)])
def test_where_lambda_goes_after_a_whole_nutation(name, back):
    """dλ/dh = −m λ̄/2η up to T_nut: to infinity, or, where kP is a multiple of 2π as in a plane, back to 0 on the other sheet."""
    if name:
        top, y = TOPS[name].top, TOPS[name].state
    else:  # over the top, in a plane
        top, y = LagrangeTop(1.0), np.array([3.0, 0.0, 0.0, 0.0, math.sin(1.0), math.cos(1.0)])
    q, end = [float(c) for c in lax.spectral_polynomial(top, y)], 0.999 * exact.nutation_period(top, y)
    slope = [k * c for k, c in enumerate(q)][1:]
    start, r = 1e-4, math.sqrt(q[0])

    def rhs(_, z):  # dm/dh = Q'(λ)/2m dλ/dh, regular at m = 0
        lam, m = complex(z[0], z[1]), complex(z[2], z[3])
        rates = -m * lam.conjugate(), -sum(c * lam**k for k, c in enumerate(slope)) * lam.conjugate() / 2
        return [part for rate in rates for part in ((rate / (2 * lam.imag)).real, (rate / (2 * lam.imag)).imag)]

    first = (0.0, start * r / 2, r, q[1] / (2 * r) * start * r / 2)
    found = solve_ivp(rhs, (start, end), first, "DOP853", rtol=1e-10, atol=1e-12).y
    size, unit = np.hypot(found[0], found[1]), top.scales(y)[1] / top.scales(y)[0]
    assert np.all(found[1] > 0)
    if back:
        assert size[-1] < 0.01 * size.max()
        assert found[2, -1] == pytest.approx(-r, rel=0.01)
    else:
        assert size[-1] > 50 * unit


# ---------------------------------------------------------------- what docs/perturbed.md says and no other test shows


def tide(name):
    named = PERTURBED_TOPS[name]
    return named.top, named.state, named.top.scales(named.state)[2]


def test_degrees_of_the_tables():
    text = (DOCS / "perturbed.md").read_text("utf-8")
    (shown,) = re.findall(r"^\| degree \| (.*) \|$", text, re.MULTILINE)
    found = []
    for name in ("tide_1e-6", "weak_tide", "moderate_tide", "strong_tide"):
        top, y0, unit = tide(name)
        found.append(prepare(top, y0, 0.5 * unit, "backlund_splitting").degree)
    assert [int(word) for word in shown.split(" | ")] == found


def test_kicks_of_the_schemes():
    shown = re.findall(r"^\| (\w+) \| (\d+) \|.*ε", (DOCS / "perturbed.md").read_text("utf-8"), re.MULTILINE)
    kicks = {name: len(scheme.b) for name, scheme in backlund_schemes.SCHEMES.items()}
    assert {name: int(number) for name, number in shown} == kicks


def test_a_smooth_lambda_is_not_enough_for_a_poisson_map():
    top, y0 = TOPS["generic"].top, TOPS["generic"].state

    def defect(of_H, of_J3):
        def step(y):
            H, J3 = (top.invariants(y) - top.invariants(y0))[:2]
            return two_point(top, y, 0.1 + 0.4j + of_H * H + of_J3 * J3)

        return poisson_defect(step, top, y0).defect

    assert defect(0, 0) < 1e-10
    assert min(defect(c, 0) for c in (0.1, 0.1j)) > 1e-2
    assert min(defect(0, c) for c in (0.1, 0.1j)) > 1e-2


def in_one_sweep(scheme):
    """The kicks of the corrector in one sweep on each side of the end."""
    out, kicks = backlund_schemes.SPACING, backlund_schemes.corrector_kicks(scheme)
    n = len(kicks)
    ahead = [(out, b) for b in kicks]
    behind = [(-(n + 1) * out, -kicks[0]), *((-out, -b) for b in kicks[1:])]
    return (*ahead, *behind, (n * out, 0.0))


@pytest.mark.parametrize("name", ["moderate_tide", "axisymmetric"])
@pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning")
def test_a_corrector_in_one_sweep_leaves_a_commutator(name, monkeypatch):
    top, y0, unit = tide(name)
    right = reference.solution(top, y0, [16 * unit]).states[0]

    def errors():
        ends = [prepare(top, y0, h * unit, "backlund_splitting").advance(y0, round(16 / h)) for h in (1 / 8, 1 / 16)]
        return [float(scaled_error(top, y0, end, right)) for end in ends]

    palindrome = errors()
    with monkeypatch.context() as patch:
        patch.setattr(backlund_schemes, "_corrector", in_one_sweep)
        backlund_schemes._ends.cache_clear()
        sweep = errors()
    backlund_schemes._ends.cache_clear()
    assert math.log2(palindrome[0] / palindrome[1]) == pytest.approx(4.0, abs=0.05)
    assert math.log2(sweep[0] / sweep[1]) < 3.6
    assert sweep[1] > 3 * palindrome[1]


@pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning")
def test_an_instability_that_comes_late():
    top, y0, unit = tide("triaxial")
    run = integrate(top, y0, t=[3000 * unit], method="backlund_splitting", tol=1e-6)
    assert scaled_error(top, y0, run.y[0], reference.solution(top, y0, run.t).states[0]) > 1e-5


def test_the_least_versions_are_those_that_are_tested():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    asked = [Requirement(text) for text in project["dependencies"]]
    asked += [Requirement(text) for texts in project["optional-dependencies"].values() for text in texts]
    lines = (ROOT / "tests" / "oldest.txt").read_text("utf-8").splitlines()
    pinned = dict(line.lower().split("==") for line in lines if not line.startswith("#"))
    least = {r.name.lower(): s.version for r in asked for s in r.specifier if s.operator == ">="}
    untested = {"ruff", "mypy", "import-linter", "mujoco", "exudyn"}  # `make lint` and `engines` take the newest
    assert least.keys() - untested == pinned.keys()
    for name, version in pinned.items():
        assert Version(least[name]) == Version(version), name
