"""The folders: scripts do what the command line does, and a visitor's own names hide nothing."""

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import lagrange_bench
from lagrange_bench.experiments import script

ROOT = Path(__file__).resolve().parents[2]


def python(*words, **settings):
    return subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True, check=False, **settings)


def test_a_script_does_what_the_command_line_does(monkeypatch):
    asked = []
    monkeypatch.setattr(sys, "argv", ["paper.py", "--help"])
    monkeypatch.setattr(runpy, "run_module", lambda name, **_: asked.append([name, *sys.argv]))
    script.run("paper")
    assert asked == [["lagrange_bench", "lagrange-bench", "run", "paper", "--help"]]


def test_every_experiment_is_a_script(monkeypatch):
    """Negative control: a name that is not that of the file would run another experiment."""
    from lagrange_bench.experiments import EXPERIMENTS

    run = []
    monkeypatch.setattr(script, "run", run.append)
    for name in EXPERIMENTS:
        runpy.run_path(str(ROOT / "experiments" / f"{name}.py"), run_name="__main__")  # pytest loads modules by itself
    assert tuple(run) == EXPERIMENTS


def test_every_package_is_installed_below_lagrange_bench(monkeypatch):
    """So that a visitor's own integrators/ or report.py hides nothing, and is not hidden."""
    monkeypatch.chdir(ROOT)
    installed = {}
    monkeypatch.setattr("setuptools.setup", lambda **settings: installed.update(settings))
    runpy.run_path(str(ROOT / "setup.py"))
    assert len(installed["packages"]) > 10
    assert all(f"{name}.".startswith("lagrange_bench.") for name in (*installed["packages"], *installed["package_dir"]))


@pytest.mark.slow
def test_the_wheel_meets_a_visitors_own_names(tmp_path):
    """A repository with its own integrators/, experiments/, results/ and report.py: neither hides the other's."""
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input", "install", "--quiet", "--no-deps")
    source = tmp_path / "source"  # setuptools builds beside the sources
    ignored = shutil.ignore_patterns(".*", "build", "*.jsonl", "__pycache__", "*.egg-info", "local", "tests")
    shutil.copytree(ROOT, source, ignore=ignored)
    subprocess.run([*pip, "--no-build-isolation", "--target", str(tmp_path / "site"), str(source)], check=True)
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
    for name in lagrange_bench.__all__:
        assert getattr(lagrange_bench, name) is not None
    assert {"integrate", "METHODS", "LagrangeTop", "metrics", "check"} <= set(dir(lagrange_bench))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        lagrange_bench.nothing  # noqa: B018
