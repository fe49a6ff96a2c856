"""The house: scripts do what the command line does, a folder that hides a room is named, the picture is of today's rooms."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import lagrange_bench
from experiments import script

ROOT = Path(__file__).resolve().parents[2]


def python(*words, **settings):
    return subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True, check=False, **settings)


@pytest.mark.parametrize("words", [["--help"], ["--profile", "none"], ["--results", "/dev/null/x"]])
def test_a_script_does_what_the_command_line_does(words):
    ours = python("-m", "experiments.paper", *words, cwd=ROOT)
    theirs = python("-m", "lagrange_bench", "run", "paper", *words, cwd=ROOT)
    assert (ours.returncode, ours.stdout, ours.stderr) == (theirs.returncode, theirs.stdout, theirs.stderr)
    assert ours.returncode == (0 if words == ["--help"] else 2)


def test_every_experiment_is_a_script(monkeypatch):
    """Negative control: a name that is not that of the file would run another experiment."""
    from experiments import EXPERIMENTS

    run = []
    monkeypatch.setattr(script, "run", run.append)
    for name in EXPERIMENTS:
        runpy.run_path(str(ROOT / "experiments" / f"{name}.py"), run_name="__main__")  # pytest loads modules by itself
    assert tuple(run) == EXPERIMENTS


@pytest.mark.parametrize("room", lagrange_bench.ROOMS)
def test_a_folder_that_hides_a_room_is_named(tmp_path, room):
    (tmp_path / room).mkdir()
    (tmp_path / room / "__init__.py").write_text("")
    found = python("-m", "lagrange_bench", "--help", cwd=tmp_path)
    assert found.returncode == 1
    assert f"ImportError: {tmp_path.resolve() / room} hides the package '{room}' of lagrange-bench: " in found.stderr
    assert "rename it" in found.stderr


def test_a_folder_without_python_hides_nothing(tmp_path):
    """Negative control for the test above, and what nearly every user has: a folder of results."""
    for room in lagrange_bench.ROOMS:
        (tmp_path / room).mkdir()
    assert python("-m", "lagrange_bench", "--help", cwd=tmp_path).returncode == 0


def test_public_names():
    for name in lagrange_bench.__all__:
        assert getattr(lagrange_bench, name) is not None
    assert {"integrate", "METHODS", "LagrangeTop", "metrics", "check"} <= set(dir(lagrange_bench))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        lagrange_bench.nothing  # noqa: B018


def test_the_picture_shows_the_rooms(tmp_path):
    house = runpy.run_path(str(ROOT / "docs" / "house.py"))
    arrows, level = house["arrows"](), {}
    for floor, rooms in enumerate(house["FLOORS"]):
        level |= {label: floor for label, _ in rooms}
    assert arrows
    assert all(level[a] < level[b] for a, b in arrows), "an arrow leads up"
    house["draw"](tmp_path / "house.svg")
    text = (ROOT / "docs" / "house.svg").read_text(encoding="utf-8")
    assert all(label in text for label in level), "python docs/house.py"
    assert os.path.getsize(tmp_path / "house.svg") > 1000
