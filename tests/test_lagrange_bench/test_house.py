"""The folders: scripts do what the command line does, and a visitor's own names hide nothing."""

import os
import runpy
import shutil
import sys
from pathlib import Path

import pytest
from faults import python

import lagrange_bench
from lagrange_bench.experiments import EXPERIMENTS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_is_a_script_that_does_what_the_command_line_does(name, monkeypatch):
    asked = []
    monkeypatch.setattr(sys, "argv", ["script.py", "--help"])
    monkeypatch.setattr(runpy, "run_module", lambda module, **_: asked.append([module, *sys.argv]))
    runpy.run_path(str(ROOT / "experiments" / f"{name}.py"), run_name="__main__")
    assert asked == [["lagrange_bench", "lagrange-bench", "run", name, "--help"]]


@pytest.mark.slow
def test_the_wheel_meets_a_visitors_own_names(tmp_path):
    """A repository with its own integrators/, experiments/, results/ and report.py: neither hides the other's."""
    pip = ("-m", "pip", "--disable-pip-version-check", "--no-input", "install", "--quiet", "--no-deps")
    source = tmp_path / "source"  # setuptools builds beside the sources
    ignored = shutil.ignore_patterns(".*", "build", "*.jsonl", "__pycache__", "*.egg-info", "local", "tests")
    shutil.copytree(ROOT, source, ignore=ignored)
    done = python(*pip, "--no-build-isolation", "--target", tmp_path / "site", source)
    assert done.returncode == 0, done.stderr
    top = {path.name for path in (tmp_path / "site").iterdir() if not path.name.endswith(".dist-info")}
    assert top <= {"lagrange_bench", "bin", "__pycache__"}
    theirs = tmp_path / "theirs"
    for name in ("integrators", "experiments", "results"):
        (theirs / name).mkdir(parents=True)
        (theirs / name / "__init__.py").write_text("OWN = True\n")
    (theirs / "report.py").write_text("OWN = True\n")
    script = (
        "import integrators, experiments, results, report, lagrange_bench\n"
        "from lagrange_bench import METHODS, TOPS, exact\n"
        "assert integrators.OWN and experiments.OWN and results.OWN and report.OWN\n"
        "top = TOPS['generic']\n"
        "print(len(METHODS), exact.solution(top.top, top.state, 1.0).shape, lagrange_bench.__file__)\n"
    )
    settings = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    found = python("-c", script, cwd=theirs, env=settings)
    assert found.returncode == 0, found.stderr
    assert found.stdout.startswith(f"{len(lagrange_bench.METHODS)} (6,)")
    assert str(tmp_path / "site") in found.stdout
    found = python("-m", "lagrange_bench", "run", "paper", "--results", "rows", "--quiet", cwd=theirs, env=settings)
    assert found.returncode == 0, found.stderr


def test_public_names():
    assert all(getattr(lagrange_bench, name) is not None for name in lagrange_bench.__all__)
    assert {"integrate", "METHODS", "LagrangeTop", "metrics", "check"} <= set(dir(lagrange_bench))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        lagrange_bench.nothing  # noqa: B018
