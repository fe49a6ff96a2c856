"""Bits written down in golden.json."""

from lagrange_bench.experiments.measuring import bits
from lagrange_bench.integrators import METHODS


def differing(found):
    """Where bits are not the golden ones, the constants of a state before its steps; of a new kernel there are none."""
    golden = bits.golden()
    places = [(name, where) for name in found if name in golden for where in found[name]]
    return [f"{name} {where}" for name, where in places if found[name][where] != golden[name][where]]


def test_compiled_kernels_have_the_golden_bits():
    found = bits.measured()
    assert set(found) >= set(bits.golden())
    assert differing(found) == []
    assert {"backlund", "implicit_midpoint", "rk45_fixed"} <= set(found)
    assert {kernel.partition(" ")[0] for kernel in found} <= set(METHODS)
    assert {len(hashes) for hashes in found.values()} == {2 * len(bits.STATES)}
