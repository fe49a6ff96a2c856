"""That the forms of a step that `drift` compares are one map; and bits written down in golden.json."""

from lagrange_bench.experiments import drift
from lagrange_bench.experiments.measuring import bits, metrics
from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators import METHODS
from lagrange_bench.integrators.truth import exact

STEPS = 200


def test_forms_are_one_map_but_for_round_off():
    for state, span in (("generic", 0.125), ("random003", 0.125)):
        top, y0 = find(state)
        h = span * top.scales(y0)[2]
        truth = exact.after_steps(top, y0, h, [STEPS])[0]
        ends = [form(top, y0, h).advance(y0, STEPS) for form in drift.FORMS.values()]
        assert max(metrics.scaled_error(top, y0, y, truth) for y in ends) < 1e-10
        assert len({y.tobytes() for y in ends}) > 1


def differing(found):
    """Where bits are not the golden ones, the constants of a state before its steps; of a new kernel there are none."""
    golden = bits.golden()
    places = [(name, where) for name in found if name in golden for where in found[name]]
    return [f"{name} {where}" for name, where in places if found[name][where] != golden[name][where]]


def test_compiled_kernels_have_the_golden_bits():
    found = bits.measured(bits.COUNTS[1])
    assert set(found) >= set(bits.golden())
    assert differing(found) == []
    assert {"backlund", "implicit_midpoint", "rk45_fixed"} <= set(found)
    assert {kernel.partition(" ")[0] for kernel in found} <= set(METHODS)
    assert {len(hashes) for hashes in found.values()} == {3 * len(bits.STATES)}
