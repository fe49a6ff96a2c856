"""A method and an experiment that are added to a copy of the repository: two files each, and all that is tested still holds."""

import os
import re
import shutil

import pytest
from faults import python

from tests.mutants import ROOT

METHOD = ROOT / "docs" / "example_plugin" / "suzuki_top.py"
PAGE = (ROOT / "docs" / "adding-an-experiment.md").read_text(encoding="utf-8")
EDITS = {  # of the experiment of that page
    "rk45_fixed": "suzuki4",
    '10_000 if profile == "full" else 1_000': "1_000",
    "\n\ndef cells": 'MEASURED = {"": ("one step", "many steps")}\n\n\ndef cells',
}
LINES = {  # file → where a line goes, and the line
    "lagrange_bench/integrators/registry.py": (
        "    # splitting\n",
        '    "suzuki4": "lagrange_bench.integrators.methods.suzuki_top:METHOD",\n',
    ),
    "lagrange_bench/experiments/__init__.py": ('    "drift", ', '"ends", '),
}
CHECKS = [  # that name every method or every experiment
    *("test_docs", "test_integrators/test_contract", "test_experiments/test_drift"),
    *("test_experiments/test_experiments", "test_report/test_claims", "test_report/test_readme"),
]
CHOSEN = ("suzuki4", "golden", "ends", "confirmed_by", "documents")


@pytest.mark.slow
@pytest.mark.processes
def test_an_addition_is_a_file_and_a_line(tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(ROOT, copy, symlinks=True, ignore=shutil.ignore_patterns(".*", "local", "build", "__pycache__"))
    shutil.copy(METHOD, copy / "lagrange_bench" / "integrators" / "methods")
    experiment = re.search(r"```python\n(# my_study/energy.*?)```", PAGE, re.DOTALL)[1]
    for old, new in EDITS.items():
        assert experiment.count(old) == 1
        experiment = experiment.replace(old, new)
    (copy / "lagrange_bench" / "experiments" / "ends.py").write_text(experiment)
    for name, (place, line) in LINES.items():
        text = (copy / name).read_text(encoding="utf-8")
        assert text.count(place) == 1
        (copy / name).write_text(text.replace(place, line + place), encoding="utf-8")
    here = {"cwd": copy, "env": {**os.environ, "PYTHONPATH": str(copy)}, "timeout": 1800}
    done = python("-m", "lagrange_bench", "run", "ends", "--results", "out", "--jobs", "1", "--quiet", **here)
    assert done.returncode == 0, done.stderr
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-n0", "-rp", "-k", " or ".join(CHOSEN))
    words += tuple(f"tests/{name}.py" for name in CHECKS)
    done = python(*words, **here)
    assert done.returncode == 0, done.stdout[-5000:]
    passed = [line for line in done.stdout.splitlines() if line.startswith("PASSED")]
    assert [word for word in CHOSEN if not any(word in line for line in passed)] == []
