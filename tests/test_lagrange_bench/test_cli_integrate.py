"""`lagrange-bench integrate`: one trajectory, summed up, kept to the last bit, and drawn."""

import errno
import importlib.util
import json
import os
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_cli import SHORT, examples

from lagrange_bench import HeavyTop, LagrangeTop, PerturbedTop, free_body, integrate
from lagrange_bench.commands import integrate as command
from lagrange_bench.integrators import PERTURBED_TOPS, POTENTIALS, TOPS
from lagrange_bench.integrators.truth import truths

IN_A_FIELD = ("integrate", "--method", "strang", "--h", "0.1")
GENERIC = TOPS["generic"]


@pytest.mark.parametrize("words", examples(command.__doc__), ids=" ".join)
def test_the_examples_of_integrate_run(run, words, folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "mine", SimpleNamespace(PROBLEM=free_body(1.0, 2.0, 3.0)))
    code, out, err = run(*words)
    assert code == 0, err
    assert re.search("against the (exact|reference) solution", out)
    for flag in {"--output", "--draw"} & set(words):
        assert Path(words[words.index(flag) + 1]).stat().st_size > 0


def test_summary(run, answer):
    code, out, err = run(*SHORT)
    assert (code, err) == (0, "")
    expected = integrate(GENERIC.top, GENERIC.state, 0.1, 20)
    shown = next(line for line in out.splitlines() if line.startswith("end")).split()[1:]
    assert [float(word) for word in shown] == expected.y[-1].tolist()
    data = answer(*SHORT)
    assert (data["y_final"], data["t"], data["work"]["steps"]) == (expected.y[-1].tolist(), [0.0, 2.0], 20)
    # 4e-15 is the exact solution's own accuracy, the map makes about 1e-16 a step
    assert data["error"]["final"] < 2e-14
    assert all(v["largest_drift"] < 1e-15 for v in data["invariants"].values())


def test_a_problem_of_ones_own(answer, run, folder):
    (folder / "posed.py").write_text(
        "from lagrange_bench import Problem\nP = Problem('own', 'so3', lambda t, y, p: y[0] ** 2 + y[2])\n"
    )
    words = ("integrate", "--problem", "posed:P", "--state", "0.3,-0.4,1.2", "--method", "rk4")
    data = answer(*words, "--h", "0.01", "--steps", "10")
    assert (set(data["invariants"]), len(data["y_final"]), data["error"]["final"] < 1e-9) == ({"H", "C"}, 3, True)
    assert "J1  " in run(*words, "--h", "0.01", "--steps", "10")[1]
    for more, said in (
        ("--draw x.svg", "no axis on a sphere"),
        ("--top slow", "--top: not allowed with argument --state"),
    ):
        code, _, err = run(*words, "--h", "0.01", "--steps", "10", *more.split())
        assert (code, said in err) == (2, True)
    code, _, err = run("integrate", "--problem", "posed:Q", "--state", "1,2,3", "--h", "1", "--steps", "1")
    assert (code, "--problem posed:Q cannot be loaded" in err) == (2, True)


def test_where_and_when_a_trajectory_is(answer):
    state = "-0.3,0.4,-1.2,-0.48,.6,64e-2"
    data = answer("integrate", "--state", state, "--alpha", "-2", "--h", "-1e-1", "--steps", "5", "--every", "1")
    assert (data["alpha"], data["y0"]) == (-2.0, [-0.3, 0.4, -1.2, -0.48, 0.6, 0.64])
    assert data["t"] == [-0.1 * n for n in range(6)]
    numbers = {"mass": 0.5, "distance": 0.04, "gravity": 1.62, "A": 1.2e-3, "C": 4e-4}
    angles, rates = (0.5, 0.1, 0.2), (0.3, 0.4, 200.0)
    names = [d + angle for d in ("", "d") for angle in ("theta", "phi", "psi")]
    words = ",".join(f"{k}={v!r}" for k, v in {**numbers, **dict(zip(names, (*angles, *rates), strict=True))}.items())
    data = answer("integrate", "--physical", words, "--times", "0,1e-3")
    heavy = HeavyTop(**numbers)
    assert (data["alpha"], data["y0"]) == (heavy.top.alpha, heavy.state(angles, rates).tolist())
    data = answer("integrate", "--times", "-1:0.1:12")
    assert np.allclose(data["t"], np.linspace(-1, 0.1, 12), rtol=1e-14)
    assert data["y"] == integrate(GENERIC.top, GENERIC.state, t=data["t"]).y.tolist()
    expected = integrate(GENERIC.top, GENERIC.state, 0.1, 20, lam=0.1 + 0.5j, pin=0)
    assert answer(*SHORT, "--option", "lam=0.1+0.5j", "--option", "pin=0")["y_final"] == expected.y[-1].tolist()


NOT_JUDGED = {  # and why
    "--h 1 --steps 1000 --option lam=0.02j": "lam given: one step is the flow over another time than h, and a turn",
    "--top weightless --method backlund_paper --h 1e13 --steps 10000": "periods",  # 1e16 and more: beyond doubles
    "--h 1 --steps 3000 --top axisymmetric --method strang": "longer than 2000 time scales",
    "--method strang --h 0.1 --steps 5 --top magnet": "chaotic",
}


@pytest.mark.parametrize("words", NOT_JUDGED)
def test_a_run_without_a_truth_is_not_judged(run, answer, monkeypatch, words):
    if NOT_JUDGED[words] == "chaotic":
        monkeypatch.setattr(truths, "LOST", 0.0)
    error = answer("integrate", *words.split())["error"]
    assert (error["final"], error["largest"], NOT_JUDGED[words] in error["note"]) == (None, None, True)
    out = run("integrate", *words.split())[1]
    assert not re.search("against the (exact|reference) solution", out)


def test_what_is_no_double_is_a_dash(run, answer, tmp_path):
    words = ("--steps", "10", "--state", "1,2,3,0,0,1e-200", "--h", "0.1")  # |x|² = 0 has no relative drift
    code, out, err = run("integrate", *words, "--draw", tmp_path / "axis.svg")
    assert (code, err) == (0, f"written: {tmp_path / 'axis.svg'}\n")
    table = out.split("largest recorded\n")[1].split("\n\n")[0].splitlines()
    assert {line.split()[0]: line.split().count("–") for line in table if "–" in line} == {"C1": 2}
    found = answer("integrate", *words)["invariants"]
    assert [name for name, v in found.items() if None in v.values()] == ["C1"]


def test_a_file_has_every_bit_and_what_made_it(run, tmp_path):
    """`test_files_have_every_bit` reads the other formats."""
    path = tmp_path / "run.csv"
    code, out, err = run(*SHORT, "--output", path, "--top", "figure2", "--option", "lam=0.1+0.5j")
    assert (code, err, str(path) in out) == (0, f"written: {path}\n", False)
    top = TOPS["figure2"]
    expected = integrate(top.top, top.state, 0.1, 20, every=1, lam=0.1 + 0.5j)
    rows = [line.split(",") for line in path.read_text("utf-8").splitlines() if line[0] in "-0123456789"]
    assert np.array_equal(np.array(rows, dtype=float), np.column_stack([expected.t, expected.y]))
    metadata = header(path)
    facts = {"top": "figure2", "alpha": 1.0, "y0": list(top.y0), "method": "backlund"}
    assert metadata.items() >= {**facts, "h": 0.1, "steps": 20, "every": 1}.items()
    assert complex(metadata["options"]["lam"]) == 0.1 + 0.5j
    assert metadata["numpy"] == np.__version__


def header(path):
    lines = (line[2:].partition(": ") for line in path.read_text("utf-8").splitlines() if line[0] == "#")
    return {key: json.loads(value) for key, _, value in lines}


def test_a_file_is_replaced_whole_and_not_in_silence(run, tmp_path, monkeypatch):
    path, link = tmp_path / "run.csv", tmp_path / "link.csv"
    link.symlink_to(path)
    assert run(*SHORT, "--output", path)[0] == 0
    assert run(*SHORT, "--output", link, "--every", "20")[2] == f"replaced: {link}\n"
    assert link.is_symlink()
    before = path.read_bytes()

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    code, _, err = run(*SHORT, "--output", path)
    assert (code, err) == (2, f"lagrange-bench: error: {path}: cannot be written: No space left on device\n")
    assert path.read_bytes() == before
    assert sorted(tmp_path.iterdir()) == [link, path]  # no pieces are left


def test_what_can_be_known_before_is_said_before(run, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(importlib.util, "find_spec", lambda name: None)
        code, _, err = run(*SHORT, "--output", tmp_path / "run.parquet")
        assert (code, "pip install pyarrow" in err) == (2, True)
    monkeypatch.setattr(os, "access", lambda *_: False)  # a read-only folder, also for root
    code, _, err = run(*SHORT, "--draw", tmp_path / "axis.svg")
    assert (code, "no permission" in err, list(tmp_path.iterdir())) == (2, True, [])


def test_a_named_top_in_a_potential(run, answer):
    words = (*IN_A_FIELD, "--steps", "20", "--top", "strong_tide")
    code, out, err = run(*words)
    assert (code, err) == (0, "")
    for said in ("tide (k = 0.1, n1 = 1, n2 = 0, n3 = 0)", "J3, not conserved", "the reference solution"):
        assert said in out
    assert not [wrong for wrong in ("nutation", "exact solution", "C1, not") if wrong in out]
    data, top = answer(*words), PERTURBED_TOPS["strong_tide"]
    assert data["y_final"] == integrate(top.top, top.state, 0.1, 20, "strang").y[-1].tolist()
    assert [data["invariants"][name]["conserved"] for name in ("H", "J3", "C1", "C2")] == [True, False, True, True]


def test_a_potential_on_any_top(answer, tmp_path):
    words, path = ("--potential", "charge", "--parameters", "-0.1,0,0,2", "--steps", "5"), tmp_path / "run.csv"
    data = answer(*IN_A_FIELD, *words, "--state", "0,1,2,0.6,0,0.8", "--alpha", "2", "--output", path)
    top = PerturbedTop(LagrangeTop(2.0), POTENTIALS["charge"], (-0.1, 0.0, 0.0, 2.0))
    assert data["y_final"] == integrate(top, data["y0"], 0.1, 5, "strang").y[-1].tolist()
    assert all(v["conserved"] for v in data["invariants"].values())
    for facts in (data, header(path)):
        assert (facts["potential"], facts["parameters"]) == ("charge", [-0.1, 0.0, 0.0, 2.0])
