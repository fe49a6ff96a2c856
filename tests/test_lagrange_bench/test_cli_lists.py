"""`lagrange-bench methods`, `tops` and `potentials`: all there is is listed, and what cannot be loaded, with the reason."""

from __future__ import annotations

import pytest

from lagrange_bench import text
from lagrange_bench.integrators import METHODS, PERTURBED_TOPS, POTENTIALS, TOPS, LagrangeTop, registry
from lagrange_bench.integrators.registry import NAMED_TOPS


@pytest.mark.parametrize("command", [("methods",), ("tops", "--verbose"), ("potentials",)])
def test_tables_fit_a_terminal(run, command, monkeypatch):
    wide = run(*command)[1]
    assert max(map(len, wide.splitlines())) > 80
    monkeypatch.setattr(text, "terminal_width", lambda: 80)
    narrow = run(*command)[1]
    assert max(map(len, narrow.splitlines())) <= 80
    assert sorted("".join(narrow.split())) == sorted("".join(wide.split())), "wrapped, and nothing is lost"


def test_methods(run, answer):
    code, out, err = run("methods", "--verbose")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert [line.split()[0] for line in lines[1 : len(METHODS) + 1]] == list(METHODS)
    assert METHODS["backlund"].source in out
    data = {method["name"]: method for method in answer("methods")}
    assert list(data) == list(METHODS)
    for name, method in METHODS.items():
        accepted = method.takes(LagrangeTop()) is None
        assert data[name]["order"] == (method.order_for(LagrangeTop()) if accepted else method.order)
        assert set(data[name]["conserves"]) == (method.kept(LagrangeTop()) if accepted else method.conserves)
        assert data[name]["options"] == list(method.options)


@pytest.mark.parametrize(
    ("module", "why"), [("no_such_module", "ModuleNotFoundError: "), ("leaves", "ImportError: it calls sys.exit('no')")]
)
@pytest.mark.parametrize("known", [METHODS, POTENTIALS, NAMED_TOPS], ids=lambda known: known.word)
def test_a_plug_in_that_cannot_be_loaded_is_listed(run, answer, tmp_path, monkeypatch, known, module, why):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "leaves.py").write_text("raise SystemExit('no')\n")
    broken = registry.EntryPoint("broken", f"{module}:IT", known.group)
    monkeypatch.setitem(vars(known), "_entries", {**known._entries, "broken": broken})
    code, out, _ = run(f"{known.word}s")
    assert code == 0
    assert f"broken: cannot be loaded: {why}" in out
    listed = answer(f"{known.word}s")
    assert len(listed) == len(known)
    assert listed[-1]["error"].startswith(why)


def test_tops(run, answer):
    code, out, _ = run("tops")
    assert code == 0
    above, below = out.split("\n\nin a potential:\n")
    assert TOPS["figure2"].note not in out
    assert TOPS["figure2"].note in run("tops", "--verbose")[1]
    assert [line.split()[0] for line in above.splitlines()[1:]] == list(TOPS)
    assert [line.split()[0] for line in below.splitlines()[1:]] == list(PERTURBED_TOPS)
    data = {top["name"]: top for top in answer("tops")}
    assert data["generic"]["nutation_period"] == pytest.approx(4.22213, abs=1e-5)
    assert data["homoclinic"]["nutation_period"] is None
    top = PERTURBED_TOPS["magnet"]
    facts = {"alpha": top.alpha, "state": list(top.y0), "potential": "charge", "parameters": list(top.parameters)}
    assert data["magnet"].items() >= {**facts, "conserves": ["H", "C1", "C2"]}.items()


UNITS = {  # so that V has those of J²
    "quadratic": "S in units of J²/x²",
    "axisymmetric": "ck in units of J²/x^k",
    "charge": "k in units of J² x",
    "dipole": "b in units of J²/x",
    "tide": "k = 3 (GM/r³)(C − A)/A, in units of J²/x²",
}


def test_potentials(run, answer):
    code, out, _ = run("potentials")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()[1:]] == list(POTENTIALS)
    data = {potential["name"]: potential for potential in answer("potentials")}
    assert data["tide"]["parameters"] == ["k", "n1", "n2", "n3"]
    assert data["axisymmetric"]["parameters"] is None
    assert all(potential["note"].endswith(UNITS[name]) for name, potential in data.items())


def test_methods_of_a_top(run, answer):
    """Which take it, what they keep of it, and why the others do not."""
    code, out, err = run("methods", "--top", "magnet")
    assert (code, err) == (0, "")
    table, left_out = out.split("\nleft out: ", 1)
    taken = [line.split()[0] for line in table.splitlines()[1:]]
    top = PERTURBED_TOPS["magnet"].top
    assert taken == [name for name, method in METHODS.items() if method.takes(top) is None]
    assert "strang" in taken
    assert "theta_functions: does not take the potential charge: it is the closed form" in left_out
    data = {method["name"]: method for method in answer("methods", "--top", "magnet")}
    assert data["theta_functions"]["refuses"] == METHODS["theta_functions"].takes(top)
    assert (data["strang"]["refuses"], data["strang"]["conserves"]) == (None, ["C1", "C2"])
    words = ("methods", "--potential", "charge", "--parameters", "0.1,0,0,2")  # on the vertical: J3 stays
    assert {m["name"]: m for m in answer(*words)}["strang"]["conserves"] == ["J3", "C1", "C2"]
    refused = {method["name"] for method in answer("methods", "--top", "generic") if method["refuses"]}
    assert refused == {name for name, method in METHODS.items() if method.needs in ("body", "spins")}
    assert "refuses" not in answer("methods")[0]
