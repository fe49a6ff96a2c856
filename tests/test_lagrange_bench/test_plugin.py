"""A method of somebody else's package, the one of the documentation: found, checked, measured, and drawn with the others."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.commands import one_by_one

pytestmark = pytest.mark.processes
ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs" / "example_plugin"

DRAW = """
import json
from matplotlib.text import Text
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.results.store import Store, make_record
from lagrange_bench.experiments.drawing import style
from lagrange_bench.report import page

store = Store("results")
listed = {}
for name in ("phase", "work_precision"):
    module = load(name)
    listed[name] = [cell for cell in module.cells("quick") if cell.get("method") == "suzuki4"]
    few = [cell for cell in listed[name] if cell.get("part") != "time" and cell.get("span", 100) == 100]
    for position, cell in enumerate(few):
        done = {"status": "done", "rows": module.measure(cell), "error": None, "warnings": [], "seconds": 0.0}
        store.append(make_record(name, module.VERSION, position, cell, **done))
    with style.apply():
        figures = module.draw(store.rows(name))
        texts = {text.get_text() for figure in figures.values() for text in figure.findobj(Text)}
    assert "Suzuki 4" in texts, texts
    assert figures
table = load("phase").tables(store.rows("phase"))["orders"].set_index("state")
report = page.assemble(store.folder)
print(json.dumps({
    "cells": {name: len(cells) for name, cells in listed.items()},
    "order": table.measured["single steps, 8 tops"],
    "colour": style.of("suzuki4")["color"],
    "family": style.family("suzuki4"),
    "fair": report.fairness.methods.set_index("method").engine["suzuki4"],
}))
"""


def install(project: Path, target: Path) -> Path:
    """What `pip install --target` would put there, without pip, build tools or a network."""
    about = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))
    name, version = about["project"]["name"], about["project"]["version"]
    for module in about["tool"]["setuptools"]["py-modules"]:
        shutil.copy(project / f"{module}.py", target)
    info = target / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = [
        line
        for group, entries in about["project"]["entry-points"].items()
        for line in (f"[{group}]", *(f"{key} = {value}" for key, value in entries.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return target


@pytest.fixture
def python(tmp_path):
    """python(*words) in an empty folder, with the example installed: (exit code, stdout, stderr)."""
    (tmp_path / "site").mkdir()
    path = os.pathsep.join((str(install(EXAMPLE, tmp_path / "site")), str(ROOT)))
    environment = {**os.environ, "PYTHONPATH": path}
    (tmp_path / "results").mkdir()

    def call(*words):
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout, done.stderr

    call.one_by_one = lambda *commands: [said[:3] for said in one_by_one(commands, tmp_path, environment)]
    return call


def test_found_and_checked(python):
    checked, listed = python.one_by_one(("check", "suzuki4", "--quick", "--json"), ("methods", "--json"))
    code, out, err = checked
    assert code == 0, err
    assert "suzuki4" in out
    code, out, err = listed
    assert code == 0, err
    (found,) = (method for method in json.loads(out) if method["name"] == "suzuki4")
    assert (found["order"], found["family"], found["available"]) == (4, "splitting", True)


def test_measured_and_drawn(python):
    code, out, err = python("-c", DRAW)
    assert code == 0, err
    said = json.loads(out.splitlines()[-1])
    assert all(said["cells"].values())
    assert said["order"] == pytest.approx(4, abs=0.15)
    assert (said["family"], said["colour"]) == ("splitting", "#000000"), "its own look"
    assert said["fair"].startswith("compiled")


def test_a_taken_name_is_left_out_with_one_warning(python, tmp_path):
    project = tmp_path / "project"
    project.mkdir()
    text = (EXAMPLE / "pyproject.toml").read_text(encoding="utf-8").replace("suzuki4 =", "rk4 =")
    (project / "pyproject.toml").write_text(text.replace('"suzuki-top"', '"taken-top"'), encoding="utf-8")
    shutil.copy(EXAMPLE / "suzuki_top.py", project)
    install(project, tmp_path / "site")
    code, out, err = python("-m", "lagrange_bench", "methods", "--json")
    assert code == 0, err
    names = [method["name"] for method in json.loads(out)]
    assert names.count("rk4") == 1
    assert "suzuki4" in names
    assert err.count("RuntimeWarning") == 1
    assert "give the method another name, or pip uninstall taken-top" in err
    code, out, err = python("-m", "lagrange_bench", "check", "rk4", "--quick")
    assert code == 0, err
    assert "order 4" in out
    assert out.splitlines()[-2].startswith("rk4 (")
    assert err.count("RuntimeWarning") == 1


def test_a_name_that_is_taken_and_a_name_without_a_colon(python, tmp_path):
    text = (EXAMPLE / "suzuki_top.py").read_text(encoding="utf-8")
    (tmp_path / "my_method.py").write_text(text.replace('name="suzuki4"', 'name="rk4"'), encoding="utf-8")
    names = ("my_method:METHOD", "my_method", "suzuki5", "suzuki_top:METHOD")
    taken, bare, unknown, own = python.one_by_one(*(("check", name, "--quick") for name in names))
    code, out, err = taken
    assert "the name rk4 is taken, by the bench: choose another for an entry point" in out, err
    code, out, err = bare
    assert (code, out) == (2, "")
    assert err.endswith("for the one in my_method.py use my_method:METHOD\n")
    code, out, err = unknown
    assert code == 2
    assert err.endswith("unknown method 'suzuki5'; did you mean 'suzuki4'? All: lagrange-bench methods\n")
    code, out, err = own
    assert "is taken" not in out, "its own entry point does not clash with it"


KEYS = """
import json, sys
from lagrange_bench.results import sources
from lagrange_bench.results.store import cell_key
cells = [dict([word.split("=")]) for word in sys.argv[1:]]
print(json.dumps([cell_key("drift", 1, cell, sources.of_cell("drift", cell)) for cell in cells]))
"""


def test_an_edit_of_ones_own_method_or_potential_is_another_key(python, well, tmp_path):
    """Whatever process asks; what they import counts, nothing else of the folder does, and nothing of it for ours."""
    names = ("method=rk4", "method=suzuki4", "method=mine:METHOD", "potential=tide", "potential=well")
    ours, package, mine, field, own_field = range(len(names))

    def changed(file, text):
        nonlocal before
        (tmp_path / file).write_text(text, encoding="utf-8")
        code, out, err = python("-c", KEYS, *names)
        assert code == 0, err
        before, old = json.loads(out), before
        return {i for i in range(len(names)) if not old or before[i] != old[i]}

    before = []
    (tmp_path / "mine.py").write_text("import helper\nfrom suzuki_top import METHOD\n", encoding="utf-8")
    changed("helper.py", "# one\n")
    assert changed("other.py", "# one\n") == set()
    assert changed("helper.py", "# two\n") == {mine}
    assert changed("depth.py", "DEPTH = 3\n") == {own_field}
    assert changed("site/suzuki_top.py", (EXAMPLE / "suzuki_top.py").read_text(encoding="utf-8") + "\n") == {package}


def test_built_in_methods_keep_their_keys(monkeypatch):
    """To the letter: what is stored stays valid."""
    from lagrange_bench.integrators.registry import BUILT_IN
    from lagrange_bench.results import store

    monkeypatch.setattr(store, "_packages", lambda: {"numpy": "2.0"})
    golden = {
        "rk4": "6d8442c1de6ff5ea2133bc23150e855a869c81875ae628560e5ff26e54e2ca84",
        "backlund": "f1ca553e558d5c6df57f18019433672e27472e89b505b113dfb6de80444d2edc",
    }
    assert {name: store.cell_key("drift", 3, {"method": name, "h": 0.125}) for name in golden} == golden
    for name in BUILT_IN:
        content = {"cell": {"method": name}, "experiment": "drift", "packages": {"numpy": "2.0"}, "version": 3}
        text = json.dumps(content, separators=(",", ":"))
        assert store.cell_key("drift", 3, {"method": name}) == hashlib.sha256(text.encode()).hexdigest()


# ---------------------------------------------------------------- potentials

WELL = """
from lagrange_bench.integrators import Potential
import depth
POTENTIAL = Potential("well", lambda x1, x2, x3, p: -p[0] / (depth.DEPTH + x1 * x1), parameters=("k",), note="a well")
"""


@pytest.fixture
def well(tmp_path):
    """A package with a potential, installed beside the example; and its folder."""
    site, info = tmp_path / "site", tmp_path / "site" / "well_top-1.0.dist-info"
    (tmp_path / "my_well.py").write_text(WELL, encoding="utf-8")
    (tmp_path / "depth.py").write_text("DEPTH = 2\n", encoding="utf-8")
    info.mkdir(parents=True, exist_ok=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: well-top\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[lagrange_bench.potentials]\nwell = my_well:POTENTIAL\n")
    return site


def test_a_potential_of_a_package(python, well):
    words = ("integrate", "--h", "0.1", "--steps", "5", "--method", "rk4", "--json", "--parameters", "0.1")
    in_it = [(*words, "--potential", name) for name in ("well", "my_well:POTENTIAL")]
    listed, *runs = python.one_by_one(("potentials", "--json"), *in_it)
    code, out, err = listed
    assert code == 0, err
    assert {"name": "well", "parameters": ["k"], "note": "a well"} in json.loads(out)
    assert [code for code, _, _ in runs] == [0, 0], runs
    assert len({str(json.loads(out)["y_final"]) for _, out, _ in runs}) == 1


def test_a_potential_of_a_taken_name_is_left_out(python, well):
    (entries,) = well.glob("well_top*/entry_points.txt")
    entries.write_text("[lagrange_bench.potentials]\ntide = my_well:POTENTIAL\n")
    code, out, err = python("-m", "lagrange_bench", "potentials", "--json")
    assert code == 0, err
    assert [potential["name"] for potential in json.loads(out)].count("tide") == 1
    assert "give the potential another name, or pip uninstall well-top" in err


def test_a_top_of_a_package(python, well, tmp_path):
    """It is listed, followed, and swept with its numbers; one whose name is taken is left out."""
    (tmp_path / "my_tops.py").write_text(
        "from lagrange_bench import NamedTop\nMINE = NamedTop('mine', 'my top', 2.0, (0.5, 0.0, 1.25, 0.5, 0.0, 1.0), 'a test')\n"
    )
    (entries,) = well.glob("well_top*/entry_points.txt")
    entries.write_text("[lagrange_bench.tops]\nmine = my_tops:MINE\nfast = my_tops:MINE\n")
    code, out, err = python("-m", "lagrange_bench", "tops", "--json")
    assert code == 0, err
    listed = [(top["name"], top["alpha"]) for top in json.loads(out)]
    assert listed.count(("mine", 2.0)) == listed.count(("fast", 1.0)) == 1
    assert "give the top another name, or pip uninstall well-top" in err
    entries.write_text("[lagrange_bench.tops]\nmine = my_tops:MINE\n")
    words = ("integrate", "--h", "0.5", "--steps", "20", "--json", "--top")
    for code, out, err in python.one_by_one((*words, "mine"), (*words, "my_tops:MINE")):
        assert code == 0, err
        assert json.loads(out)["error"]["final"] < 1e-13
    names_a_top = "from lagrange_bench.testing import assert_drift; assert_drift('rk4', tops=['mine'], steps=10, J3=0)"
    code, out, err = python("-c", names_a_top)
    assert code == 0, err
    sweep = tmp_path / "own.toml"
    sweep.write_text('[[sweep]]\ntops = ["mine"]\nmethods = ["rk4"]\nh = [0.5]\ntime = 2.0\n')
    code, out, err = python(
        "-m", "lagrange_bench", "run", sweep, "--results", tmp_path / "out", "--jobs", "1", "--quiet"
    )
    assert code == 0, err
    assert '"alpha": 2.0' in (tmp_path / "out" / "sweep_own.jsonl").read_text().replace('":2.0', '": 2.0')


def test_not_there_unless_installed():
    """The control: without its package the name is unknown."""
    from lagrange_bench.integrators import METHODS, POTENTIALS

    assert "suzuki4" not in METHODS
    assert "well" not in POTENTIALS


def test_the_documents_name_what_there_is():
    text = (ROOT / "docs" / "adding-a-method.md").read_text(encoding="utf-8")
    from dataclasses import fields

    from lagrange_bench.integrators.interface import FAMILIES, Method

    for name in (*FAMILIES, *(field.name for field in fields(Method))):
        assert name in text, name


def test_a_file_in_the_current_folder_joins_an_experiment(python, tmp_path):
    """And is used in place of an installed copy, by the workers too."""
    bench = ("-P", "-m", "lagrange_bench")  # like the command: Python itself does not look into the current folder
    text = (EXAMPLE / "suzuki_top.py").read_text(encoding="utf-8")
    (tmp_path / "site" / "mine.py").write_text("raise ImportError('the installed copy')\n", encoding="utf-8")
    file = tmp_path / "mine.py"
    file.write_text(text.replace('"Suzuki 4"', '"Suzuki, edited"'), encoding="utf-8")
    code, out, err = python(*bench, "check", "mine:METHOD", "--quick")
    assert code == 0, err
    summary, after = out.splitlines()[-2:]
    assert summary.startswith(f"suzuki4 (Suzuki, edited, {file}): ")
    chosen = ("--methods", "mine:METHOD,rk4")
    assert after.startswith("next: lagrange-bench run work_precision phase --methods mine:METHOD,rk4,")
    rows = ("--results", "rows")
    code, out, err = python(*bench, "run", "phase", *chosen, "--tops", "generic", *rows, "--quiet", "--json")
    assert code == 0, err + out
    tally = json.loads(out)["experiments"]["phase"]
    assert tally["computed"] == tally["cells"] > 0
    assert json.loads(out)["next"].endswith("--methods mine:METHOD,rk4 --tops generic")
    cells = [json.loads(line)["cell"] for line in (tmp_path / "rows" / "phase.jsonl").read_text().splitlines()]
    assert {cell["method"] for cell in cells} == {"mine:METHOD", "rk4"}
    code, out, err = python(*bench, "report", *rows, *chosen, "--json")
    assert code == 0, err
    page = Path(json.loads(out)["page"]).read_text(encoding="utf-8")
    assert re.search(r"Suzuki,\sedited", page), "its own label"
    command = "run phase --profile quick --results rows --methods mine:METHOD,rk4"
    assert " ".join(f"<span>{word}</span>" for word in command.split()) in page
    code, out, err = python(*bench, "run", "phase", "--methods", "mine", *rows)
    assert code == 2
    assert err.endswith("no cell here has the method 'mine'; for the one in mine.py use mine:METHOD\n")
