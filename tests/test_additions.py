"""A method and an experiment that are added to a copy of the repository: two files each, and all that is tested still holds."""

import os
import shutil

import pytest
from faults import python

from tests.mutants import ROOT

METHOD = ROOT / "docs" / "example_plugin" / "suzuki_top.py"
EXPERIMENT = '''"""Ends: where is a method after a few steps?"""

from lagrange_bench.experiments.drawing.shown import drawn, of_part, tabulated
from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators import prepare

VERSION = 1
SCALED_TIMES = True
MEASURED = {"": ("error",)}


def cells(profile):
    return [{"method": name, "state": "generic", "h": 0.1, "steps": 8} for name in ("backlund", "suzuki4")]


def measure(cell):
    top, y0 = find(cell["state"])
    y = prepare(top, y0, method=cell["method"], h_scaled=cell["h"]).advance(y0, cell["steps"])
    return [{"error": float(abs(top.invariants(y) - top.invariants(y0)).max())}]


@of_part("", "The largest change of an invariant")
def ends(rows):
    return rows[["method", "error"]]


@of_part()
def picture(rows, style):
    fig, ax = style.figure("column")
    ax.plot(rows.error)
    fig.caption = "Errors."
    return fig


tables, draw = tabulated(ends), drawn(picture=picture)
'''
LINES = {  # file → where a line goes, and the line
    "integrators/registry.py": (
        "    # splitting\n",
        '    "suzuki4": "lagrange_bench.integrators.methods.suzuki_top:METHOD",\n',
    ),
    "experiments/__init__.py": ('    "drift", ', '"ends", '),
}
CHECKS = [  # that name every method or every experiment
    *("test_docs", "test_integrators/test_contract", "test_experiments/test_round_off"),
    *("test_experiments/test_experiments", "test_report/test_claims", "test_report/test_readme"),
]
CHOSEN = ("suzuki4", "golden", "ends", "confirmed_by", "documents", "changes_no_verdict")


@pytest.mark.slow
@pytest.mark.processes
def test_an_addition_is_a_file_and_a_line(tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(ROOT, copy, symlinks=True, ignore=shutil.ignore_patterns(".*", "local", "build", "__pycache__"))
    shutil.copy(METHOD, copy / "integrators" / "methods")
    (copy / "experiments" / "ends.py").write_text(EXPERIMENT)
    for name, (place, line) in LINES.items():
        text = (copy / name).read_text(encoding="utf-8")
        assert text.count(place) == 1
        (copy / name).write_text(text.replace(place, line + place), encoding="utf-8")
    here = {"cwd": copy, "env": {**os.environ, "PYTHONPATH": str(copy)}, "timeout": 1800}
    done = python("-m", "lagrange_bench", "run", "ends", "--results", "out", "--jobs", "1", "--quiet", **here)
    assert done.returncode == 0, done.stderr
    units = "from lagrange_bench import load; f = load('out')['ends']; print(set(f.h_scaled), len(set(f.h)))"
    assert python("-c", units, **here).stdout.split() == ["{0.1}", "1"]
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-n0", "-rp", "-k", " or ".join(CHOSEN))
    words += tuple(f"tests/{name}.py" for name in CHECKS)
    done = python(*words, **here)
    assert done.returncode == 0, done.stdout[-5000:]
    passed = [line for line in done.stdout.splitlines() if line.startswith("PASSED")]
    assert [word for word in CHOSEN if not any(word in line for line in passed)] == []
