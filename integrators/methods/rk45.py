"""The Runge-Kutta pair of Dormand and Prince: SciPy's RK45 on its natural steps, and the same formula at fixed h.

`rk45` is `scipy.integrate.RK45` as it stands; h is only the output grid, which its dense output fills. Of its 30 µs
per step nearly all is interpretation. `rk45_fixed` is the fifth-order formula of the pair in a compiled loop: SciPy
offers no fixed step (`max_step` limits a step, it does not fix one). Of the invariants only J3, which is constant in
every stage, is kept.

Source: Dormand & Prince, J. Comput. Appl. Math. 6 (1980) 19, table 2; error estimate and interpolant: Shampine, Math. Comp.
46 (1986) 135. The tableau is compared with SciPy's in the tests.
"""

from __future__ import annotations

import math
from fractions import Fraction as F

import numpy as np
from scipy.integrate import RK45

from integrators.compiled import jit
from integrators.dense import DenseStepper, Run, at_times
from integrators.interface import Array, Method, StepError, Work, check_real
from integrators.loops import FixedStepper
from integrators.top import LagrangeTop

# rows of the tableau, one for each stage after the first, and the weights of the fifth-order formula
A = (
    (F(1, 5),),
    (F(3, 40), F(9, 40)),
    (F(44, 45), F(-56, 15), F(32, 9)),
    (F(19372, 6561), F(-25360, 2187), F(64448, 6561), F(-212, 729)),
    (F(9017, 3168), F(-355, 33), F(46732, 5247), F(49, 176), F(-5103, 18656)),
)
B = (F(35, 384), F(0), F(500, 1113), F(125, 192), F(-2187, 6784), F(11, 84))

A2, A3, A4, A5, A6 = (tuple(float(a) for a in row) for row in A)
WEIGHTS = tuple(float(b) for b in B)

LEAST_RTOL = 100 * np.finfo(float).eps  # SciPy raises a smaller rtol to this


# ------------------------------------------------------------------------------------ natural steps, SciPy


@jit
def rhs(alpha, y):
    J1, J2, J3, x1, x2, x3 = y
    f = np.array((-alpha * x2, alpha * x1, 0.0, J2 * x3 - J3 * x2, J3 * x1 - J1 * x3, J1 * x2 - J2 * x1))
    if not math.isfinite(f.sum()):  # SciPy would try steps of NaN for ever
        raise OverflowError
    return f


def prepare(top: LagrangeTop, y0: Array, h: float, *, rtol: float = 1e-9, atol: float = 1e-12) -> DenseStepper:
    """Natural steps with the local error kept below atol + rtol |y_i|, root mean square over the components."""
    run = _runner(top, rtol, atol)
    rhs(0.0, np.zeros(6))  # compile
    return DenseStepper("rk45", h, run)


def evaluate(
    top: LagrangeTop, y0: Array, times: Array, *, rtol: float = 1e-9, atol: float = 1e-12
) -> tuple[Array, Work]:
    """Dense output at any times; options as in `prepare`."""
    return at_times("rk45", _runner(top, rtol, atol), y0, times)


def _runner(top: LagrangeTop, rtol: float, atol: float) -> Run:
    rtol, atol = check_real(rtol, "rtol"), check_real(atol, "atol")
    if not LEAST_RTOL <= rtol <= 1:
        raise ValueError(f"rtol must be between {LEAST_RTOL:.3g} (100 eps, SciPy's least) and 1; got {rtol:g}")
    if atol < 0:
        raise ValueError(f"atol must not be negative; got {atol:g}")

    def run(y: Array, grid: Array, work: Work) -> Array:
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                solver = RK45(lambda t, y: rhs(top.alpha, y), 0.0, y, grid[-1], rtol=rtol, atol=atol)
                return _integrate(solver, grid, work)
        except OverflowError:
            raise StepError("rk45", "the state left the range of floating-point numbers", step=work.steps) from None

    return run


def _integrate(solver: RK45, grid: Array, work: Work) -> Array:
    out = np.empty((len(grid), 6))
    size, done = np.abs(grid), 0
    while solver.status == "running":
        before = solver.nfev
        message = solver.step()
        work.rejected += (solver.nfev - before) // solver.n_stages - 1
        if solver.status == "failed":
            raise StepError("rk45", f"SciPy: {message} (t = {solver.t:g})", step=work.steps)
        work.steps += 1
        reached = int(np.searchsorted(size, abs(solver.t), side="right"))
        if reached > done:
            out[done:reached] = solver.dense_output()(grid[done:reached]).T
            done = reached
    out[-1] = solver.y  # the last step ends at the last time: no interpolation
    work.rhs_evals += solver.nfev
    return out


# ------------------------------------------------------------------------------------ fixed steps, compiled


@jit
def slope(s, alpha):
    J1, J2, J3, x1, x2, x3 = s
    return -alpha * x2, alpha * x1, J2 * x3 - J3 * x2, J3 * x1 - J1 * x3, J1 * x2 - J2 * x1


@jit
def combine(s, h, weights, slopes):
    d1 = d2 = e1 = e2 = e3 = 0.0
    for w, k in zip(weights, slopes):  # noqa: B905, compiled; unrolled, since the tuples' lengths are part of their types
        d1 += w * k[0]
        d2 += w * k[1]
        e1 += w * k[2]
        e2 += w * k[3]
        e3 += w * k[4]
    J1, J2, J3, x1, x2, x3 = s
    return J1 + h * d1, J2 + h * d2, J3, x1 + h * e1, x2 + h * e2, x3 + h * e3


@jit
def step(s, c, tally):
    alpha, h = c[0], c[1]
    k1 = slope(s, alpha)
    k2 = slope(combine(s, h, A2, (k1,)), alpha)
    k3 = slope(combine(s, h, A3, (k1, k2)), alpha)
    k4 = slope(combine(s, h, A4, (k1, k2, k3)), alpha)
    k5 = slope(combine(s, h, A5, (k1, k2, k3, k4)), alpha)
    k6 = slope(combine(s, h, A6, (k1, k2, k3, k4, k5)), alpha)
    return combine(s, h, WEIGHTS, (k1, k2, k3, k4, k5, k6))


def prepare_fixed(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """Six right-hand sides per step; the seventh stage of the pair only serves its error estimate."""
    return FixedStepper("rk45_fixed", h, np.array((top.alpha, h)), step, rhs_per_step=len(WEIGHTS))


SOURCE = "Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19"

NATURAL = Method(
    name="rk45",
    label="RK45 (SciPy)",
    family="runge-kutta",
    order=5,
    symmetric=False,
    poisson=False,
    conserves=frozenset({"J3"}),
    control="tolerance",
    source=f"scipy.integrate.RK45; {SOURCE}",
    prepare=prepare,
    evaluate=evaluate,
    engine="scipy",
)

FIXED = Method(
    name="rk45_fixed",
    label="RK45, fixed step",
    family="runge-kutta",
    order=5,
    symmetric=False,
    poisson=False,
    conserves=frozenset({"J3"}),
    control="step",
    source=SOURCE,
    prepare=prepare_fixed,
)
