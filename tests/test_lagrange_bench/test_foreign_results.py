"""Somebody else's packages join; somebody else's results run no code, and are never shown in silence."""

import json
import os
import shutil
import sys
import tomllib
from pathlib import Path

import pytest
from faults import python
from test_cli import STUDY

from lagrange_bench.experiments import catalogue
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.integrators import INVARIANTS, METHODS
from lagrange_bench.results.store import Store, make_record

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "example_plugin"
OWN = """
from lagrange_bench import NamedTop, Potential
WELL = Potential("well", lambda x1, x2, x3, p: -p[0] / (2 + x1 * x1), parameters=("k",), note="a well")
MINE = NamedTop("mine", "my top", 2.0, (0.5, 0.0, 1.25, 0.5, 0.0, 1.0), "a test")
"""
GROUPS = {
    "methods": {"rk4": "suzuki_top:METHOD", "broken": "leaves:METHOD"},
    "potentials": {"well": "my_own:WELL", "tide": "my_own:WELL"},
    "tops": {"mine": "my_own:MINE", "fast": "my_own:MINE"},
}


def install(site: Path, name: str, groups: dict[str, dict[str, str]]) -> None:
    """What `pip install --target` would put there beside the modules, without pip, build tools or a network."""
    info = site / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in e.items()) for group, e in groups.items()]
    (info / "entry_points.txt").write_text("\n".join(lines))


@pytest.mark.processes
def test_packages_join(tmp_path):
    """Their names are known, but for those that are taken. What cannot be loaded is listed with the reason."""
    about = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))
    shutil.copy(EXAMPLE / "suzuki_top.py", tmp_path)
    (tmp_path / "my_own.py").write_text(OWN)
    (tmp_path / "leaves.py").write_text("raise SystemExit('no')\n")
    install(tmp_path, about["project"]["name"], about["project"]["entry-points"])
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{EXAMPLE.parents[1]}"}

    def answer(*words):
        done = python("-m", "lagrange_bench", *words, "--json", env=environment)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout), done.stderr

    assert answer("check", "suzuki4", "--quick")[0]["passed"]
    install(tmp_path, "well-top", {f"lagrange_bench.{group}": entries for group, entries in GROUPS.items()})
    errors = {}
    for word, joined in (("method", "suzuki4"), ("potential", "well"), ("top", "mine")):
        listed, said = answer(f"{word}s")
        assert all(line.startswith("lagrange-bench: warning: ") for line in said.splitlines())
        assert "is left out, for its name is taken" in said
        names = [each["name"] for each in listed]
        assert (names.count(joined), len(names)) == (1, len(set(names)))
        errors |= {each["name"]: each["error"] for each in listed if "error" in each}
    assert errors == {"broken": "ImportError: it calls sys.exit('no')"}
    words = ("integrate", "--h", "0.1", "--steps", "5", "--method", "rk4", "--potential", "well")
    assert answer(*words, "--parameters", "0.1")[0]["potential"] == "well"


MODULE = f"""
from dataclasses import replace
from pathlib import Path
from lagrange_bench.integrators import METHODS

Path(__file__).with_name("ran").touch()
METHOD = replace(METHODS["strang"], name="evil", label="Evil Strang")
{STUDY}"""


def test_rows_never_choose_code(run, folder, monkeypatch):
    """Modules that results name are not imported, though they could be, until the user names them."""
    monkeypatch.setitem(vars(METHODS), "_entries", METHODS._entries)
    (folder / "evilpkg").mkdir()
    for name in ("exp", "method"):
        (folder / "evilpkg" / f"{name}.py").write_text(MODULE)
    cell = {"part": "time", "state": "generic", "h": 0.1, "steps": 10, "method": "evilpkg.method:METHOD"}
    row = dict.fromkeys(INVARIANTS, 1e-9)
    for results, experiment, version, fields, measured in (
        ("results", "evilpkg.exp", 1, {"i": 0}, {"square": 0.1}),
        ("results", "drift", load("drift").VERSION, cell, row),
        ("other", "evilpkg.exp", 1, {"i": 0}, {"square": 0.2}),
        ("own", "drift", load("drift").VERSION, cell, row),
    ):
        (folder / results).mkdir(exist_ok=True)
        rows = [{**measured, "t": t} for t in (1.0, 2.0, 4.0, 8.0)]  # enough for a line, which its label names
        Store(results).append(make_record(experiment, version, 0, fields, rows=rows))
    for words, code, said in (
        ("report --results results --output plain", 1, "not drawn: evilpkg.exp: unknown experiment 'evilpkg.exp'"),
        ("figure evilpkg.exp_squares --results results", 2, "unknown"),
        ("compare results other", 1, "changed in evilpkg.exp"),
        ("verify results --quiet", 2, "unknown experiment 'evilpkg.exp'"),
        ("verify own --quiet", 2, "not computed: 1 cells: evilpkg.method:METHOD: not available here"),
    ):
        found, out, err = run(*words.split())
        assert (found, said in out + err) == (code, True), err
        assert not (folder / "evilpkg" / "ran").exists(), words
        assert "evilpkg" not in sys.modules
    text = (folder / "plain" / "index.html").read_text(encoding="utf-8")
    assert "evilpkg.method:METHOD" in text  # the rows are shown, under the name they have
    assert "Evil Strang" not in text
    words = ("--module", "evilpkg.exp", "--module", "evilpkg.method")
    assert "not drawn: evilpkg.exp" not in run("report", "--results", "results", "--output", "page", *words)[2]
    assert (folder / "evilpkg" / "ran").exists()
    assert "Evil Strang" in (folder / "page" / "index.html").read_text(encoding="utf-8")
    code, out, err = run("verify", "own", "--quiet", "--module", "evilpkg.method")
    assert (code, "not computed" in out + err) == (1, False)  # the stored rows are made up
    catalogue.installed.cache_clear()
