"""Methods, potentials and tops of somebody else's package: found, checked, measured, and drawn with the others."""

import json
import shutil
import sys
import tomllib
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path

import pytest
from matplotlib.text import Text

from lagrange_bench.experiments import sweep
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.drawing import style
from lagrange_bench.integrators import METHODS, POTENTIALS
from lagrange_bench.integrators.interface import FAMILIES, Method
from lagrange_bench.integrators.registry import NAMED_TOPS
from lagrange_bench.results import store
from lagrange_bench.testing import assert_drift

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "docs" / "example_plugin"
OWN = """
from lagrange_bench import NamedTop, Potential
WELL = Potential("well", lambda x1, x2, x3, p: -p[0] / (2 + x1 * x1), parameters=("k",), note="a well")
MINE = NamedTop("mine", "my top", 2.0, (0.5, 0.0, 1.25, 0.5, 0.0, 1.0), "a test")
"""
GROUPS = {
    "methods": {"rk4": "suzuki_top:METHOD"},
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


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """The example of the documents, and a package with names that are taken: it is left out with one warning."""
    site, registries = tmp_path_factory.mktemp("site"), (METHODS, POTENTIALS, NAMED_TOPS)
    before = [registry._entries for registry in registries]
    about = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))
    shutil.copy(EXAMPLE / "suzuki_top.py", site)
    (site / "my_own.py").write_text(OWN)
    install(site, about["project"]["name"], about["project"]["entry-points"])
    install(site, "well-top", {f"lagrange_bench.{group}": entries for group, entries in GROUPS.items()})
    with pytest.MonkeyPatch.context() as patch, ExitStack() as stack:
        patch.syspath_prepend(str(site))
        for module in ("suzuki_top", "my_own"):
            stack.callback(sys.modules.pop, module, None)
        for registry, entries in zip(registries, before, strict=True):
            stack.callback(vars(registry).__setitem__, "_entries", entries)
            del vars(registry)["_entries"]
            stack.callback(setattr, registry, "changes", registry.changes + 2)
            registry.changes += 1
            with pytest.warns(RuntimeWarning) as warned:
                list(registry)
            (message,) = (str(warning.message) for warning in warned)
            assert f"give the {registry.word} another name, or pip uninstall well-top" in message
        yield site


@pytest.mark.usefixtures("packages")
def test_found_and_checked(run, answer):
    assert answer("check", "suzuki4", "--quick")["passed"]
    (method,) = (method for method in answer("methods") if method["name"] == "suzuki4")
    assert (method["order"], method["family"], method["available"]) == (4, "splitting", True)
    assert METHODS.module("rk4").startswith("lagrange_bench.")
    assert "did you mean 'suzuki4'?" in run("check", "suzuki5")[2]


@pytest.mark.usefixtures("packages")
def test_measured_and_drawn(tmp_path):
    module, rows = load("phase"), store.Store(tmp_path)
    cells = [cell for cell in module.cells("quick") if cell.get("method") == "suzuki4" and cell.get("span", 100) == 100]
    for position, cell in enumerate(cells):
        rows.append(store.make_record("phase", module.VERSION, position, cell, rows=module.measure(cell)))
    with style.apply():
        figures = module.draw(rows.rows("phase"))
    assert "Suzuki 4" in {text.get_text() for figure in figures.values() for text in figure.findobj(Text)}
    table = module.tables(rows.rows("phase"))["orders"].set_index("state")
    assert table.measured["single steps, 8 tops"] == pytest.approx(4, abs=0.15)
    assert (style.family("suzuki4"), style.of("suzuki4")["color"]) == ("splitting", "#000000"), "its own look"


@pytest.mark.usefixtures("packages")
def test_potentials_and_tops(answer, tmp_path):
    """Listed, followed, and swept with their numbers, by name or as module:NAME."""
    assert {"name": "well", "parameters": ["k"], "note": "a well"} in answer("potentials")
    assert [potential["name"] for potential in answer("potentials")].count("tide") == 1
    listed = [(top["name"], top["alpha"]) for top in answer("tops")]
    assert listed.count(("mine", 2.0)) == listed.count(("fast", 1.0)) == 1
    words = ("integrate", "--h", "0.1", "--steps", "5", "--method", "rk4")
    for option, names in (("--potential", ("well", "my_own:WELL")), ("--top", ("mine", "my_own:MINE"))):
        more = ("--parameters", "0.1") if option == "--potential" else ()
        one, other = (answer(*words, option, name, *more)["y_final"] for name in names)
        assert one == other
    assert_drift("rk4", tops=["mine"], steps=10, J3=0)
    file = tmp_path / "own.toml"
    file.write_text('[[sweep]]\ntops = ["mine"]\nmethods = ["rk4"]\nh = [0.5]\ntime = 2.0\n')
    assert [cell["alpha"] for cell in load(sweep.read(str(file))).cells("quick")] == [2.0]


def test_a_file_in_the_current_folder_joins_an_experiment(run, folder, monkeypatch):
    """And is used in place of an installed copy, by the workers too."""
    (folder / "site").mkdir()
    (folder / "site" / "mine.py").write_text("raise ImportError('the installed copy')\n")
    monkeypatch.syspath_prepend(str(folder / "site"))
    monkeypatch.setitem(vars(METHODS), "_entries", METHODS._entries)
    text = (EXAMPLE / "suzuki_top.py").read_text(encoding="utf-8")
    (folder / "mine.py").write_text(text.replace('name="suzuki4"', 'name="rk4"'), encoding="utf-8")
    code, out, err = run("check", "mine:METHOD", "--quick")
    assert code == 0, err
    *_, summary, after = out.splitlines()
    assert summary.startswith(f"rk4 (Suzuki 4, {folder / 'mine.py'}): ")
    assert after.startswith("next: lagrange-bench run work_precision phase --methods mine:METHOD,")
    chosen = ("--methods", "mine:METHOD,strang", "--tops", "generic", "--results", "rows", "--no-timings")
    code, out, err = run("run", "phase", *chosen, "--jobs", "1", "--quiet", "--json")
    assert code == 0, err + out
    cells = [json.loads(line)["cell"] for line in (folder / "rows" / "phase.jsonl").read_text().splitlines()]
    assert {(cell["method"], cell["state"]) for cell in cells} == {(m, "generic") for m in ("mine:METHOD", "strang")}
    assert json.loads(out)["next"].endswith("--methods mine:METHOD,strang --tops generic")
    for words in (("check", "mine", "--quick"), ("run", "phase", "--methods", "mine", "--results", "rows")):
        code, _, err = run(*words)
        assert (code, err.endswith("for the one in mine.py use mine:METHOD\n")) == (2, True)


def test_built_in_methods_keep_their_keys(monkeypatch):
    """To the letter: what is stored stays valid."""
    monkeypatch.setattr(store, "_packages", lambda: {"numpy": "2.0"})
    golden = {
        "rk4": "6d8442c1de6ff5ea2133bc23150e855a869c81875ae628560e5ff26e54e2ca84",
        "backlund": "f1ca553e558d5c6df57f18019433672e27472e89b505b113dfb6de80444d2edc",
    }
    assert {name: store.cell_key("drift", 3, {"method": name, "h": 0.125}) for name in golden} == golden


def test_the_documents_name_what_there_is():
    text = (ROOT / "docs" / "adding-a-method.md").read_text(encoding="utf-8")
    for name in (*FAMILIES, *(field.name for field in fields(Method))):
        assert name in text, name
