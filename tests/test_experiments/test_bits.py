"""Every compiled kernel computes the bits written down in golden.json, and so does the interpreter."""

import json

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import bits
from lagrange_bench.integrators import METHODS


def test_compiled_kernels_have_the_golden_bits():
    verdicts = bits.compare(bits.golden(), bits.measured(bits.COUNTS[1]))
    assert [v for v in verdicts if not v.passed] == []
    assert {"backlund", "implicit_midpoint", "rk45_fixed"} <= {v.kernel for v in verdicts}
    assert all(v.compared == 3 * len(bits.STATES) for v in verdicts)


def test_python_floats_have_the_golden_bits():
    verdicts = bits.compare(bits.golden(), bits.in_python())
    assert [v for v in verdicts if not v.passed] == []
    assert {v.kernel for v in verdicts} == set(bits.golden())


def test_one_ulp_is_seen(monkeypatch):
    """Negative control: of the constants, and of a state, in one of three states."""
    golden = bits.golden()
    find = bits.find

    def nudged(name):
        top, y = find(name)
        return top, (y * (1 + 2.0**-52) if name == "figure1" else y)

    monkeypatch.setattr(bits, "find", nudged)
    (verdict,) = bits.compare(golden, bits.measured(1000, ["kahan"]))
    assert verdict == bits.Verdict("kahan", False, verdict.first, 6)
    assert verdict.first.startswith("figure1")
    assert bits.digest(np.array((1.0, 2.0))) != bits.digest(np.array((1.0, np.nextafter(2.0, 3.0))))


def test_a_kernel_nobody_wrote_down_is_not_judged():
    (verdict,) = bits.compare({}, {"new": {"generic 1000": "0"}})
    assert verdict.passed is None


def test_golden_has_every_kernel_and_no_other():
    assert set(bits.golden()) == {name for name, *_ in bits.kernels()}
    assert {name.partition(" ")[0] for name in bits.golden()} <= set(METHODS)


def test_a_failure_of_the_interpreted_run_is_told(monkeypatch):
    monkeypatch.setattr(bits.sys, "executable", "/bin/false")
    with pytest.raises(RuntimeError, match="interpreted run failed"):
        bits.in_python()


def test_the_bits_of_a_new_method_are_written_and_no_others(run, monkeypatch, tmp_path):
    file = tmp_path / "golden.json"
    known = bits.golden()
    file.write_text(json.dumps({name: {"old": "0"} for name in known if name.partition(" ")[0] != "kahan"}))
    monkeypatch.setattr(bits, "GOLDEN", file)
    monkeypatch.setattr(bits, "COUNTS", bits.COUNTS[:2])
    assert run("bits", "kahan", "--write")[0] == 0
    written = json.loads(file.read_text())
    assert list(written) == list(known)
    assert {place: known["kahan"][place] for place in written["kahan"]} == written["kahan"]
    assert written["strang"] == {"old": "0"}
    code, _, err = run("bits", "--write")
    assert (code, "--write goes with the names" in err) == (2, True)
