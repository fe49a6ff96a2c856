"""How far the invariants may wander, in one table: method, invariant, step, number of steps, bound, and why that bound.

u = 2⁻⁵³ is half an ulp of 1. Errors are relative to the size of the terms in each invariant. Steps are in units of the top's
own time scale 1/(|J| + √(|alpha||x|)). The largest error is taken over 20 samples and the states of each row.
"""

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.integrators import METHODS, prepare
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.methods import implicit_midpoint
from tests.installed import FOR_TOPS, installed

U = 2.0**-53
FEW = ("generic", "figure1", "fast", "slow")

ULPS = "pinned: what eight steps round, for ever"
WALK = "random walk of roundings of u or less: 3 σ of √n u, over four states"
LINEAR = "constants rounded once push the same way in every step"
TRUNCATION = "truncation error of one step, times n"

TABLE = [
    # method, options, invariants, h, n, bound, why
    ("backlund", {}, "H C1 C2", 0.1, 10**6, 16 * U, ULPS),
    ("backlund", {}, "H C1 C2", 2.0, 10**6, 16 * U, ULPS),
    ("backlund_paper", {}, "H C1 C2", 0.1, 10**6, 16 * U, ULPS),
    ("backlund_paper", {}, "H C1 C2", 2.0, 10**6, 16 * U, ULPS),
    ("backlund", {"pin": 0}, "H C1 C2", 0.1, 10**6, U / 64 * 10**6, LINEAR),
    ("backlund_textbook", {}, "H C1 C2", 0.1, 10**6, U / 16 * 10**6, LINEAR + ", and its divisions lose digits"),
    ("implicit_midpoint", {}, "H C1 C2", 0.1, 10**6, 3 * U * 1e3, WALK),
    ("implicit_midpoint", {}, "H C1 C2", 0.5, 10**6, 6 * U * 1e3, WALK + "; larger steps round more"),
    ("implicit_midpoint", {"solver": "newton"}, "H C1 C2", 0.1, 10**6, 3 * U * 1e3, WALK),
    ("implicit_midpoint", {"solver": "fixed_point"}, "H C1 C2", 0.1, 10**6, 3 * U * 1e3, WALK),
    ("implicit_midpoint", {}, "H C1 C2", 0.1, 10**7, 5 * U * 3162, WALK),
    ("taylor_fixed", {}, "H C1 C2", 0.25, 10**5, 4 * U * 316, WALK + "; the series has converged"),
    ("taylor", {}, "H C1 C2", 10.0, 10**3, 4 * U * 300, WALK + "; 10 natural steps to each h"),
    ("rk45_fixed", {}, "H C1 C2", 0.1, 10**5, 1e-9 * 10**5, TRUNCATION + ": h⁶/1000"),
    ("rk45", {}, "H C1 C2", 1.0, 200, 1e-10 * 2000, "rtol / 10, times natural steps"),
    *(
        (name, {}, "J3", 0.3, 2000, 0.0, "J3' = 0: never touched")
        for name in FOR_TOPS
        if "J3" in METHODS[name].conserves
    ),
]


@pytest.mark.parametrize(("method", "options", "invariants", "h", "n", "bound", "why"), TABLE)
def test_drift(method, options, invariants, h, n, bound, why):
    installed(method)
    if METHODS[method].control == "tolerance":
        n = min(n, 200 if METHODS[method].engine == "scipy" else 1000)
    for name in FEW:
        top, y0 = states.find(name)
        rows = prepare(top, y0, h * top.scales(y0)[2], method, **options).record(y0, n, n // 20)
        drift = np.abs(metrics.relative_drift(top.invariants(rows), top.invariant_scales(y0)))
        for k, invariant in enumerate(("H", "J3", "C1", "C2")):
            if invariant in invariants.split():
                assert np.max(drift[:, k]) <= bound, f"{name}: {invariant}, {np.max(drift[:, k]) / U:.1f} u; {why}"


# ---------------------------------------------------------------- growth


def growth(prepare_stepper, n):
    """Exponents of the growth of H, C1, C2 over the last two decades, 16 random states."""
    errors = []
    for name in states.RANDOM:
        top, y0 = states.find(name)
        rows = prepare_stepper(top, y0, 0.25 * top.scales(y0)[2]).record(y0, n, n // 1000)
        errors.append(metrics.relative_drift(top.invariants(rows), top.invariant_scales(y0)))
    return [metrics.growth_exponent(np.arange(1001.0), np.array(errors)[:, :, k]) for k in (0, 2, 3)]


def test_midpoint_errors_walk_at_random():
    """Brouwer's law: ½, not 1. Over 10⁷ steps of h = 0.1 and 0.3 the exponents are 0.46 … 0.70."""
    for found in growth(METHODS["implicit_midpoint"].special["uniform"], 1_000_000):
        assert found.p < 0.75


@jit
def tolerant_step(s, c, tally):
    """The midpoint rule by the plain iteration, ended by a tolerance of 1e-12."""
    J1, J2, J3, x1, x2, x3 = s
    y1, y2, y3 = x1, x2, x3
    for _ in range(100):
        K1 = J1 - 0.5 * c[1] * c[0] * y2
        K2 = J2 + 0.5 * c[1] * c[0] * y1
        z1 = x1 + 0.5 * c[1] * (K2 * y3 - J3 * y2)
        z2 = x2 + 0.5 * c[1] * (J3 * y1 - K1 * y3)
        z3 = x3 + 0.5 * c[1] * (K1 * y2 - K2 * y1)
        change = abs(z1 - y1) + abs(z2 - y2) + abs(z3 - y3)
        y1, y2, y3 = z1, z2, z3
        if change < 1e-12:
            break
    return J1 - c[1] * c[0] * y2, J2 + c[1] * c[0] * y1, J3, 2 * y1 - x1, 2 * y2 - x2, 2 * y3 - x3


def test_a_tolerance_would_drift():
    """Negative control of the exponent: what the iteration leaves has a direction."""
    found = growth(lambda top, y0, h: FixedStepper("tolerant", h, np.array((top.alpha, h)), tolerant_step), 200_000)
    assert max(g.p for g in found) > 0.9


def test_newton_and_fixed_point_take_the_same_step():
    top, y0 = states.find("generic")
    a, b = (
        implicit_midpoint.prepare(top, y0, 0.1, solver=solver).advance(y0, 1000) for solver in ("newton", "fixed_point")
    )
    assert metrics.scaled_error(top, y0, a, b) < 1e-12  # 1000 steps of a few ulp, phases growing linearly
