"""Old rows are never taken for new ones: whatever a cell runs is in the digest stored with it, and nothing else is."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import event as numba_event
from tiny import tiny

import integrators
from experiments import EXPERIMENTS
from experiments.catalogue import load
from integrators import METHODS
from results import sources
from results.store import Store

pytestmark = [pytest.mark.usefixtures("short_races"), pytest.mark.xdist_group("measured")]
ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("integrators", "experiments", "results", "report", "lagrange_bench")


# ---------------------------------------------------------------- all that runs is in the digest


def covered(monkeypatch, experiment, method):
    """File → ranges of the lines that the digest of a cell is made of."""
    lines = {}

    def read(module, unit, read=sources._read):
        first = min([unit.lineno, *(node.lineno for node in getattr(unit, "decorator_list", ()))])
        lines.setdefault(str(sources._file(module)), []).append((first, unit.end_lineno))
        return read(module, unit)

    with monkeypatch.context() as patched:
        patched.setattr(sources, "_read", read)
        assert sources._of.__wrapped__(experiment, method)
    return lines


def called(cell, experiment):
    """(file, first line, name) of every function of the bench that measuring a cell calls, in the interpreter."""
    seen, measure = {}, load(experiment).measure
    for name in integrators.__all__:  # imported when first asked for, and importing is not measuring
        getattr(integrators, name)

    def note(frame, event, _):
        if event == "call":
            seen[id(frame.f_code)] = frame.f_code

    class Compiling(numba_event.Listener):
        """Numba at work calls a million functions, none of which measures."""

        depth = 0

        def on_start(self, _):
            self.depth += 1
            sys.setprofile(None)

        def on_end(self, _):
            self.depth -= 1
            sys.setprofile(None if self.depth else note)

    with numba_event.install_listener("numba:compile", Compiling()):
        sys.setprofile(note)
        try:
            measure(cell)
        finally:
            sys.setprofile(None)
    places = {(code.co_filename, code.co_firstlineno, code.co_qualname) for code in seen.values()}
    ours = tuple(f"{ROOT / package}{os.sep}" for package in PACKAGES)
    index = str(sources._file(sources.INDEX))
    return {place for place in places if place[0].startswith(ours) and place[0] != index and place[2] != "<module>"}


def missing(lines, calls):
    return {call for call in calls if not any(a <= call[1] <= b for a, b in lines.get(call[0], ()))}


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_what_measuring_calls_is_in_the_digest(monkeypatch, experiment):
    done = set()
    for cell in tiny(experiment):
        method = cell.get("method")
        if (kind := (cell.get("part"), method)) in done:
            continue
        done.add(kind)
        calls = called(cell, experiment)
        assert calls
        assert not missing(covered(monkeypatch, experiment, method), calls), cell
    assert done


INTERPRETED = """
import pytest
from test_sources import called, covered, missing
from integrators import METHODS, available

tried = 0
for method in filter(lambda name: available(METHODS[name]), METHODS):
    calls = called({"part": "h", "method": method, "state": "generic", "span": 1, "h": 0.25}, "drift")
    assert not missing(covered(pytest.MonkeyPatch(), "drift", method), calls), method
    other = "rk4" if METHODS[method].family != "runge-kutta" else "kahan"
    assert missing(covered(pytest.MonkeyPatch(), "drift", other), calls), f"the digest of {other} would do for {method}"
    tried += 1
print(tried)
"""


def test_what_a_method_calls_is_in_the_digest():
    """With kernels in the interpreter, where it is seen what they call."""
    environment = {
        **os.environ,
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": f"{Path(__file__).parent}{os.pathsep}{ROOT / 'tests'}",
    }
    code, out, err = python(ROOT, environment, "-c", INTERPRETED)
    assert code == 0, err
    assert int(out) > 30


def python(folder, environment, *words):
    """(exit code, stdout, stderr)"""
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout, done.stderr


# ---------------------------------------------------------------- what an edit marks


def forget():
    """All that `sources` remembers: the syntax trees of one reading of the bench take 30 MB."""
    for function in vars(sources).values():
        if hasattr(function, "cache_clear") and function.__module__ == sources.__name__:
            function.cache_clear()


def digests():
    forget()
    return {(e, m): sources.of_cell(e, {"method": m}) for e in ("drift", "phase", "work_precision") for m in METHODS}


@pytest.fixture(scope="module")
def untouched():
    found = digests()
    assert None not in found.values()
    return found


@pytest.fixture
def marked(untouched, tree, monkeypatch):
    """marked((file, old, new), …) → the cells of an experiment and a method that these edits mark; edits add up."""
    find = sources._file
    monkeypatch.setattr(sources, "_file", lambda name: None if (path := find(name)) is None else _copied(path, tree))
    before = untouched

    def edit(*edits):
        nonlocal before
        for file, old, new in edits:
            text = (tree / file).read_text()
            assert re.search(old, text, re.M), f"the edit of {file} does not apply: {old}"
            (tree / file).write_text(re.sub(old, new, text, flags=re.M))
        before, old_ones = digests(), before
        return {cell for cell, digest in before.items() if digest != old_ones[cell]}

    yield edit
    monkeypatch.undo()
    forget()


def _copied(path, tree):
    ours = any(path.is_relative_to(ROOT / package) for package in PACKAGES)
    return tree / path.relative_to(ROOT) if ours else path


KAHAN = {(e, "kahan") for e in ("drift", "phase", "work_precision")}
EVERYTHING = {(e, m) for e in ("drift", "phase", "work_precision") for m in METHODS}


def test_an_edit_of_a_kernel_marks_its_method_only(marked):
    edit = ("integrators/methods/kahan.py", r"1\.0 - k \* \(kick \* x3\)", "1.0 - (k * kick) * x3")
    assert marked(edit) == KAHAN


UNITS = "from integrators.problem.units import Units\n"
NEW = '    "new": "integrators.methods.new:METHOD",\n'


OF_NO_ROW = (
    ("integrators/methods/kahan.py", "# a d1 [+] b d2 = h g1.*$", "# another comment"),
    ("integrators/methods/kahan.py", '\\A"""', '"""Another docstring. '),
    ("integrators/methods/kahan.py", r"    near = 1\.0 - k", "\n\n    near = 1.0 - \\\\\n        k"),
    ("integrators/methods/kahan.py", UNITS, f"from integrators import units\n{UNITS}import os\n"),
    ("integrators/methods/kahan.py", r"\Z", "\n\ndef of_no_use():\n    return 1\n"),
    ("integrators/problem/units.py", r"^class Units.*:$", r"\g<0>\n    # a comment"),
    ("integrators/registry.py", '^    "kahan": ', rf"{NEW}\g<0>"),
    ("experiments/drift.py", "16 [*] 2[.]0[*][*]-52", "32 * 2.0**-52"),  # of a table
    ("experiments/drift.py", "by_family", "by_kind"),  # of a figure
    ("lagrange_bench/__main__.py", "measure everything", "measure all"),
)


def test_what_changes_no_row_marks_nothing(marked):
    """All at once, for each digest takes seconds."""
    assert marked(*OF_NO_ROW) == set()


def test_an_edit_of_what_measures_marks_its_experiment_and_of_what_all_use_everything(marked):
    edit = ("experiments/drift.py", r"\(values\[1:\] - values\[0\]\) / size", "(values[1:] - values[0]) / -size")
    assert marked(edit) == {cell for cell in EVERYTHING if cell[0] == "drift"}
    attribute = r"\g<0>\n    unused = 1"
    assert marked(("integrators/problem/top.py", "^class LagrangeTop.*$", attribute)) == EVERYTHING
    splittings = {name for name, method in METHODS.items() if method.family == "splitting"}
    found = marked(("integrators/methods/splitting.py", "^class Scheme.*$", attribute))
    assert {method for _, method in found} == splittings


def test_another_function_from_outside_is_another_source(marked):
    edit = ("integrators/methods/kahan.py", "^import numpy as np$", "import autograd.numpy as np")
    assert marked(edit) == KAHAN


MOVE = """
import json
from experiments import EXPERIMENTS
from results import sources
from integrators import METHODS
print(json.dumps({f"{e} {m}": sources.of_cell(e, {"method": m}) for e in EXPERIMENTS for m in METHODS}))
"""


def script(tree, *words, **settings):
    return python(tree, {**os.environ, "PYTHONPATH": str(tree), **settings}, *words)


MOVED = {
    "integrators.problem.units": "integrators.units",
    "integrators.methods.kahan": "integrators.kahan",
    "experiments.measuring.states": "experiments.states",
    "experiments.measuring.metrics": "experiments.metrics",
}


def rooms(match):
    """`from package import …` once for what stayed and once for what moved."""
    package, names = match[1], match[2].split(", ")
    gone = [name for name in names if f"{package}.{name}" in MOVED]
    lines = {package: [name for name in names if name not in gone], package.partition(".")[0]: gone}
    return "\n".join(f"from {place} import {', '.join(some)}" for place, some in lines.items() if some)


def test_files_may_move(tree):
    before = {f"{e} {m}": sources.of_cell(e, {"method": m}) for e in EXPERIMENTS for m in METHODS}
    for old, new in MOVED.items():
        target = tree.joinpath(*new.split(".")).with_suffix(".py")
        tree.joinpath(*old.split(".")).with_suffix(".py").rename(target)
    for file in tree.rglob("*.py"):
        text = file.read_text()
        for old, new in MOVED.items():
            text = re.sub(rf"\b{re.escape(old)}\b", new, text)
        file.write_text(re.sub(r"^from (\w+\.\w+) import (\w.*)$", rooms, text, flags=re.M))
    code, out, err = script(tree, "-c", MOVE)
    assert code == 0, err
    assert json.loads(out) == before
    assert None not in before.values()


# ---------------------------------------------------------------- what is said and done about it

SWEEP = """
[[sweep]]
tops = ["generic"]
methods = ["kahan", "rk4"]
h = [0.25, 0.5]
time = 4.0
"""
INTERPRETER = {"NUMBA_DISABLE_JIT": "1"}  # there is nothing here to compile for
HOME = ("run", "mine.toml", "--jobs", "1", "--quiet", "--results", "out")


def test_run_says_what_is_old_and_again_computes_exactly_that(tree):
    def counts(*words):
        code, out, err = script(tree, "-W", "error", "-m", "lagrange_bench", *HOME, *words, "--json", **INTERPRETER)
        assert code == 0, err
        found = json.loads(out)["experiments"]["sweep_mine"]
        return found["computed"], found["stored"], found["other_sources"], found["unknown_sources"]

    (tree / "mine.toml").write_text(SWEEP)
    kernel, store = tree / "integrators" / "methods" / "kahan.py", Store(tree / "out")
    text = kernel.read_text()
    assert counts() == (4, 0, 0, 0)
    line = "k, kick = c[HALF], c[KICK]"
    assert line in text
    kernel.write_text(text.replace(line, "k, kick = c[HALF] * 1.5, c[KICK]"))
    code, out, _ = script(tree, "-m", "lagrange_bench", *HOME, **INTERPRETER)
    assert code == 0
    assert re.search(r"^sweep_mine +4 +0 +4 ", out, re.MULTILINE)
    assert "old: sweep_mine: 2 stored cells were computed with other source code than this\n" in out
    assert "again, the old cells: lagrange-bench run mine.toml --jobs 1 --quiet --results out --again\n" in out
    before = {json.dumps(r["cell"]): r["rows"] for r in store.latest("sweep_mine")}
    assert counts("--again") == (2, 2, 0, 0)
    after = {json.dumps(r["cell"]): r["rows"] for r in store.latest("sweep_mine")}
    changed = [json.loads(cell)["method"] for cell in before if before[cell] != after[cell]]
    assert changed == ["kahan", "kahan"]
    assert len(store.read("sweep_mine")[0]) == 6, "appended, not rewritten"
    kernel.write_text(kernel.read_text().replace("c[HALF] * 1.5, c[KICK]", "c[HALF] * 1.5, c[KICK]  # a comment"))
    assert counts("--again") == (0, 4, 0, 0)
