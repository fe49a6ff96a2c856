"""Somebody else's results run no code: names in journals and rows import nothing, and nothing in them stops a page."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.report import sections
from lagrange_bench.results import store
from lagrange_bench.results.store import Store
from tests.commands import one_by_one

pytestmark = pytest.mark.xdist_group("foreign")  # they share one process that imports nothing
ROOT = Path(__file__).resolve().parents[2]

MODULE = """
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from lagrange_bench.integrators import METHODS, Potential

Path(__file__).with_name("ran").touch()
VERSION = 1
POTENTIAL = Potential("evil", lambda x1, x2, x3, p: p[0] * x1)
METHOD = replace(METHODS["strang"], name="evil", label="Evil Strang")
def cells(profile): return [{"i": 0}]
def measure(cell): return [{"h": 0.1}]
def tables(rows): return {}
def draw(rows):
    from lagrange_bench import style
    figure, ax = style.figure("column")
    ax.plot(rows.h, rows.h)
    return {"figure": figure}
"""


def stored(folder, experiment, cell, rows=({"h": 0.1},), version=1):
    done = {"status": "done", "rows": list(rows), "error": None, "warnings": [], "seconds": 0.1}
    record = store.make_record("drift", version, 0, {}, **done)  # to make one of `experiment` would import it
    Store(folder).append({**record, "experiment": experiment, "cell": cell})


SWEPT = [{"t": t, "H": 1e-9, "J3": 0.0, "C1": 0.0, "C2": 0.0, "error": 1e-9, "seconds": 0.1} for t in (1.0, 2.0)]
START = {"top": "generic", "alpha": 1.0, "y0": "0.3,-0.4,1.2,0.48,0.6,0.64", "options": "", "h": 0.1, "steps": 2}


def made(place):
    """Results of somebody whose module can be imported from the current folder, as can any other."""
    (place / "evilpkg").mkdir()
    for name in ("exp", "method"):
        (place / "evilpkg" / f"{name}.py").write_text(MODULE)
    results, other, own = (place / name for name in ("results", "other", "own"))
    for store_folder in (results, other, own):
        store_folder.mkdir()
    stored(results, "evilpkg.exp", {"i": 0})
    stored(results, "unittest.__main__", {"i": 0})
    swept = {**START, "samples": 2}
    stored(results, "sweep_x", {"method": "evilpkg.method:METHOD", **swept}, SWEPT, load("sweep_x").VERSION)
    cell = {"method": "evilpkg.method:METHOD", "part": "longtime", "state": "generic", "h": 0.1}
    stored(results, "drift", cell, [{"t": 1.0, "n": 10, "H": 1e-9}], load("drift").VERSION)
    stored(other, "evilpkg.exp", {"i": 0}, [{"h": 0.2}])
    field = {"potential": "evilpkg.method:POTENTIAL", "parameters": "0.1"}
    stored(own, "sweep_x", {"method": "strang", **swept, **field}, SWEPT, load("sweep_x").VERSION)
    return place


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return made(tmp_path_factory.mktemp("foreign"))


def typed(folder, *words):
    """Of `lagrange-bench`, in a process of its own, in the folder: exit code, stdout and stderr; and what was imported."""
    ran = folder / "evilpkg" / "ran"
    ran.unlink(missing_ok=True)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "lagrange_bench", *words]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=300
    )
    return done.returncode, done.stdout, done.stderr, ran.exists()


COMMANDS = {  # and what they say
    "report": (
        "report --results results --output plain",
        1,
        "not drawn: evilpkg.exp: unknown experiment 'evilpkg.exp'",
    ),
    "one figure": ("figure sweep_x_time --results results --output plain.svg", 0, ""),
    "figures": ("figure --all --format svg --width page --results results", 1, "unknown experiment 'evilpkg.exp'"),
    "compare": ("compare results other --times", 1, "unknown experiment 'evilpkg.exp'"),
    "verify": ("verify results --quiet --longest 10", 2, "unknown experiment 'unittest.__main__'"),
    "a potential": ("verify own --quiet", 2, "not computed: evilpkg.method:POTENTIAL: not available here"),
    "its report": ("report --output field --results own", 0, ""),
    "an unknown figure": ("figure evilpkg.exp_figure --results results", 2, "unknown"),
}


@pytest.fixture(scope="module")
def unnamed(folder):
    """What commands say that name no module: all in one process, for there is nothing that they may leave in it."""
    words = [command.split() for command, *_ in COMMANDS.values()]
    found = one_by_one(words, folder, {**os.environ, "PYTHONPATH": str(ROOT)})
    ran = (folder / "evilpkg" / "ran").exists()  # or in a process that one of them started
    return {name: (*result[:3], ran or "evilpkg" in result[3]) for name, result in zip(COMMANDS, found, strict=True)}


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_imported_that_no_command_names(unnamed, command):
    code, out, err, ran = unnamed[command]
    assert (code, ran, "Traceback" in err) == (COMMANDS[command][1], False, False), err
    assert COMMANDS[command][2] in out + err


def test_a_module_is_imported_if_it_is_named_in_the_command(unnamed, folder):
    page = (folder / "plain" / "index.html").read_text(encoding="utf-8")
    assert "evilpkg.method:METHOD" in page  # the rows are shown, under the name they have
    assert "Evil Strang" not in page
    words = ("--module", "evilpkg.exp", "--module", "evilpkg.method")
    code, out, err, ran = typed(folder, "report", "--results", "results", "--output", "page", *words)
    assert ran
    assert "not drawn: evilpkg.exp" not in err
    assert "Evil Strang" in (folder / "page" / "index.html").read_text(encoding="utf-8")
    code, out, err, ran = typed(folder, *COMMANDS["a potential"][0].split(), "--module", "evilpkg.method")
    assert (code, ran, "not computed" in out + err) == (1, True, False)  # the stored rows are made up


def test_an_installed_experiment_needs_no_permission(tmp_path):
    folder = made(tmp_path)
    info = folder / "evil-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n")
    group = "[lagrange_bench.experiments]\n"
    (info / "entry_points.txt").write_text(f"{group}mine = evilpkg.exp\ndrift = evilpkg.exp\n")
    code, out, err, ran = typed(folder, "run", "mine", "--results", "mine", "--jobs", "1", "--quiet")
    assert (code, ran) == (0, True), err
    code, out, err, ran = typed(folder, "report", "--results", "mine", "--output", "page", "--quiet")
    assert (code, ran) == (0, True), err
    assert (folder / "page" / "figures" / "mine_figure.svg").exists()
    code, out, err, ran = typed(folder, "verify", "mine", "--quiet")
    assert (code, ran) == (0, True), err
    assert "1 identical" in out
    assert load("drift").__name__ == "lagrange_bench.experiments.drift"


# ---------------------------------------------------------------- what is in somebody else's folder


@pytest.fixture
def foreign(tmp_path):
    (tmp_path / "results").mkdir()
    stored(tmp_path / "results", "drift", {"state": "generic", "method": "rk4"})
    return tmp_path / "results"


@pytest.mark.parametrize("name", ["page", "page/index.html", "page/figures"])
def test_a_link_in_a_foreign_folder_is_not_followed(run, foreign, name):
    """What it points to is the reader's."""
    target = foreign.parent / "mine"
    target.write_text("mine") if name.endswith(".html") else target.mkdir()
    (foreign / name).parent.mkdir(exist_ok=True)
    (foreign / name).symlink_to(target)
    code, out, err = run("report", "--results", foreign, "--quiet")
    assert (code, out) == (2, "")
    assert f"{foreign / name} is a symbolic link: remove it, or give another folder with --output" in err
    assert target.read_text() == "mine" if target.is_file() else not list(target.iterdir())


def test_a_link_in_place_of_a_figure_is_not_followed(foreign, tmp_path):
    (foreign / "figures").mkdir()
    (tmp_path / "mine").write_text("mine")
    (foreign / "figures" / "drift_time.svg").symlink_to(tmp_path / "mine")
    section = sections.Section("drift", figures=[sections.DrawnFigure("time", "<svg/>", "")])
    with pytest.raises(ValueError, match=r"drift_time\.svg is a symbolic link"):
        sections.write(section, foreign)
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_journal_that_is_no_file_is_not_waited_for(run, foreign):
    os.mkfifo(foreign / "phase.jsonl")
    assert Store(foreign).experiments() == ["drift"]
    with pytest.raises(store.StoreError, match=r"cannot read .*phase\.jsonl: it is not a file"):
        Store(foreign).read("phase")


def test_messages_are_read_as_text_of_bounded_length(foreign):
    message = "\ud800" + "x" * 10_000_000
    failed = {
        "status": "failed",
        "rows": [],
        "error": {"type": "E", "message": message},
        "warnings": [],
        "seconds": 0.1,
    }
    Store(foreign).append(store.make_record("drift", load("drift").VERSION, 1, {"method": "rk4"}, **failed))
    (found,) = Store(foreign).open("drift").failures()["error_message"]
    assert len(found.encode()) < 2100
    stored(foreign, "drift", {"state": "generic", "method": "rk4"}, [{"note": "\ud800 λ"}], load("drift").VERSION)
    assert Store(foreign).rows("drift").note.dropna().tolist() == ["? λ"]
