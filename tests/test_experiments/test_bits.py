"""Every compiled kernel computes the bits written down in golden.json; test_contract.py compares with the interpreter."""

import json

import numpy as np

from lagrange_bench.experiments.measuring import bits
from lagrange_bench.integrators import METHODS


def test_compiled_kernels_have_the_golden_bits():
    verdicts = bits.compare(bits.golden(), bits.measured(bits.COUNTS[1]))
    assert [v for v in verdicts if not v.passed] == []
    assert {v.kernel for v in verdicts} == set(bits.golden()), "golden.json has every kernel and no other"
    assert {"backlund", "implicit_midpoint", "rk45_fixed"} <= {v.kernel for v in verdicts}
    assert {v.kernel.partition(" ")[0] for v in verdicts} <= set(METHODS)
    assert all(v.compared == 3 * len(bits.STATES) for v in verdicts)


def test_one_ulp_is_seen_and_what_nobody_wrote_down_is_not_judged(monkeypatch):
    """Negative control: of the constants, and of a state, in one of three states."""
    golden, find = bits.golden(), bits.find
    off = {"figure1": 1 + 2.0**-52}
    monkeypatch.setattr(bits, "find", lambda name: (find(name)[0], find(name)[1] * off.get(name, 1.0)))
    (verdict,) = bits.compare(golden, bits.measured(1000, ["kahan"]))
    assert verdict == bits.Verdict("kahan", False, verdict.first, 6)
    assert verdict.first.startswith("figure1")
    assert bits.digest(np.array((1.0, 2.0))) != bits.digest(np.array((1.0, np.nextafter(2.0, 3.0))))
    (verdict,) = bits.compare({}, {"new": {"generic 1000": "0"}})
    assert verdict.passed is None


def test_the_bits_of_a_new_method_are_written_and_no_others(monkeypatch, tmp_path):
    file, known = tmp_path / "golden.json", bits.golden()
    file.write_text(json.dumps({name: {"old": "0"} for name in known if name.partition(" ")[0] != "kahan"}))
    monkeypatch.setattr(bits, "GOLDEN", file)
    monkeypatch.setattr(bits, "COUNTS", bits.COUNTS[:2])
    bits.write(bits.measured(only=["kahan"]))
    written = json.loads(file.read_text())
    assert list(written) == list(known)
    assert {place: known["kahan"][place] for place in written["kahan"]} == written["kahan"]
    assert written["strang"] == {"old": "0"}
