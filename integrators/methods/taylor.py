"""Taylor series methods: heyoka on its natural steps, and a compiled fixed step of any order.

`taylor` is heyoka's adaptive integrator as it is meant to be used: natural steps, unrolled machine code
(`compact_mode=False`), one call for a whole run; h is only the output grid, which its dense output fills. A step clamped to
h would be a straw man: the order follows from the tolerance, the step from the decay of the coefficients.
heyoka's tolerance is relative above norm 1 and absolute below: a state much smaller than 1 wants other units. A state so
large that its twentieth power overflows ends in a StepError (not in `taylor_fixed`, whose coefficients carry powers of h).
alpha is a runtime parameter, so heyoka compiles once per (tol, high_accuracy) and process.

`taylor_fixed` sums the same series at a fixed h. It is a recurrence compiled here and not heyoka's `write_tc` with
`update_d_output`: that is a Python call per step, 1 µs against 0.3 µs of arithmetic, and heyoka is not to be had everywhere.
The tests compare the two.

Both keep J3, whose coefficients vanish; nothing else is built in. An evaluation of the right-hand side counts as one
Taylor coefficient of it: `order` for each step.

Source: Jorba & Zou, Exp. Math. 14 (2005) 99; Biscani & Izzo, MNRAS 504 (2021) 2614 (heyoka).
"""

from __future__ import annotations

import copy
from functools import lru_cache
from typing import Any

import numpy as np

from integrators.compiled import jit, stack
from integrators.dense import DenseStepper, Run, at_times
from integrators.interface import Array, Method, StepError, Work, check_count, check_real
from integrators.loops import FixedStepper
from integrators.top import LagrangeTop

EPS = float(np.finfo(float).eps)
INTERRUPTIBLE = 1 << 20  # steps in one call of heyoka, at most: it does not see Ctrl-C
MAX_ORDER = 60
SCRATCH = 8 * (MAX_ORDER + 1)


# ------------------------------------------------------------------------------------ natural steps, heyoka


def prepare(top: LagrangeTop, y0: Array, h: float, *, tol: float = EPS, high_accuracy: bool = False) -> DenseStepper:
    """Natural steps with the local error kept below `tol` (relative above norm 1); `high_accuracy`: compensated sums."""
    return DenseStepper("taylor", h, _runner(top, tol, high_accuracy))


def evaluate(
    top: LagrangeTop, y0: Array, times: Array, *, tol: float = EPS, high_accuracy: bool = False
) -> tuple[Array, Work]:
    """Dense output at any times; options as in `prepare`."""
    return at_times("taylor", _runner(top, tol, high_accuracy), y0, times)


@lru_cache(maxsize=64)
def compile_integrator(tol: float, high_accuracy: bool) -> Any:
    """heyoka's integrator for one tolerance. It has a state: take a copy."""
    import heyoka as hy

    hy.set_logger_level_critical()  # its warnings about the disk cache go to stdout
    J1, J2, J3, x1, x2, x3 = hy.make_vars("J1", "J2", "J3", "x1", "x2", "x3")
    alpha = hy.par[0]
    equations = [(J1, -alpha * x2), (J2, alpha * x1), (J3, hy.expression(0.0))]
    equations += [(x1, J2 * x3 - J3 * x2), (x2, J3 * x1 - J1 * x3), (x3, J1 * x2 - J2 * x1)]
    return hy.taylor_adaptive(
        equations, [1.0] * 6, pars=[1.0], tol=tol, high_accuracy=high_accuracy, compact_mode=False
    )


def _runner(top: LagrangeTop, tol: float, high_accuracy: bool) -> Run:
    tol = check_real(tol, "tol")
    if not EPS <= tol <= 1:
        raise ValueError(f"tol must be between {EPS:.3g} (machine epsilon) and 1; got {tol:g}")
    if not isinstance(high_accuracy, (bool, np.bool_)):
        raise ValueError(f"high_accuracy must be True or False; got {high_accuracy!r}")
    ta = copy.deepcopy(compile_integrator(tol, bool(high_accuracy)))
    ta.pars[0] = top.alpha

    def run(y: Array, grid: Array, work: Work) -> Array:
        ta.time = 0.0
        ta.state[:] = y
        out, steps = _until(ta, grid[0]) if len(grid) == 1 else _on_grid(ta, y, grid)
        work.steps += steps
        work.rhs_evals += steps * ta.order
        return out

    return run


def _until(ta: Any, end: float) -> tuple[Array, int]:
    """The state at one time: natural steps up to it, the last one shortened."""
    steps, limited = 0, True
    while limited:  # resuming at a limit of steps changes no bit
        outcome, _, _, taken, *_ = ta.propagate_until(end, max_steps=INTERRUPTIBLE)
        steps += taken
        limited = _check(ta, outcome, steps)
    return ta.state.copy().reshape(1, 6), steps


def _on_grid(ta: Any, y: Array, grid: Array) -> tuple[Array, int]:
    """The states on a grid, by dense output."""
    grid = np.concatenate(((0.0,), grid))
    outcome, _, _, steps, _, out = ta.propagate_grid(grid, max_steps=INTERRUPTIBLE)
    if _check(ta, outcome, steps):
        # A run on a grid cannot be resumed without shortening a step. A callback lets Ctrl-C in after each step and
        # changes no bit, but costs half as much as the step: only long runs start again with one.
        ta.time = 0.0
        ta.state[:] = y
        outcome, _, _, steps, _, out = ta.propagate_grid(grid, callback=lambda ta: True)
        _check(ta, outcome, steps)
    return out[1:], steps


def _check(ta: Any, outcome: Any, steps: int) -> bool:
    """Whether heyoka stopped for its limit of steps; StepError unless that or the end of the run is the reason."""
    import heyoka as hy

    if outcome == hy.taylor_outcome.time_limit:
        return False
    if outcome == hy.taylor_outcome.step_limit:
        return True
    raise StepError("taylor", f"heyoka: {outcome.name} at t = {ta.time:g}", step=steps)


@lru_cache(maxsize=8)
def compile_body(tol: float, high_accuracy: bool) -> Any:
    """heyoka's integrator for (J, x) and the quaternion g of the frame that turns with J, g' = J g/2."""
    import heyoka as hy

    hy.set_logger_level_critical()
    J1, J2, J3, x1, x2, x3, a, b, c, d = hy.make_vars("J1", "J2", "J3", "x1", "x2", "x3", "a", "b", "c", "d")
    equations = [(J1, -hy.par[0] * x2), (J2, hy.par[0] * x1), (J3, hy.expression(0.0))]
    equations += [(x1, J2 * x3 - J3 * x2), (x2, J3 * x1 - J1 * x3), (x3, J1 * x2 - J2 * x1)]
    equations += [(a, -0.5 * (J1 * b + J2 * c + J3 * d)), (b, 0.5 * (J1 * a + J2 * d - J3 * c))]
    equations += [(c, 0.5 * (J2 * a + J3 * b - J1 * d)), (d, 0.5 * (J3 * a + J1 * c - J2 * b))]
    return hy.taylor_adaptive(
        equations, [1.0] * 10, pars=[1.0], tol=tol, high_accuracy=high_accuracy, compact_mode=False
    )


def attitude(
    top: LagrangeTop,
    y0: Array,
    h: float,
    n: int,
    every: int,
    g0: Array,
    *,
    tol: float = EPS,
    high_accuracy: bool = False,
) -> Array:
    """Attitude of the frame that turns with J at 0, every·h, …, n·h, (n//every + 1, 4): integrated alongside."""
    ta = copy.deepcopy(compile_body(tol, bool(high_accuracy)))
    ta.pars[0] = top.alpha
    ta.state[:] = np.concatenate((y0, g0))
    outcome, _, _, steps, _, out = ta.propagate_grid(h * every * np.arange(n // every + 1.0))
    _check(ta, outcome, steps)
    g = out[:, 6:]
    unit: Array = g / np.linalg.norm(g, axis=1, keepdims=True)
    return unit


# ------------------------------------------------------------------------------------ fixed steps, compiled


@jit
def step(s, c, tally):
    """The Taylor polynomial of one step, in powers of t/h; z[8k … 8k+4] holds coefficient k of h J1, h J2, x1, x2, x3."""
    J1, J2, J3, x1, x2, x3 = s
    h, alpha_h, order = c[0], c[1], int(c[2])
    spin, kick = h * J3, h * alpha_h
    z = stack(SCRATCH)
    z[0], z[1], z[2], z[3], z[4] = h * J1, h * J2, x1, x2, x3
    for k in range(order):
        a = b = d = e = 0.0
        for j in range(k + 1):  # Cauchy products
            p, q = 8 * j, 8 * (k - j)
            a += z[p + 1] * z[q + 4]
            b += z[p] * z[q + 4]
            d += z[p] * z[q + 3]
            e += z[p + 1] * z[q + 2]
        r, p = c[3 + k], 8 * k
        z[p + 8] = -kick * z[p + 3] * r
        z[p + 9] = kick * z[p + 2] * r
        z[p + 10] = (a - spin * z[p + 3]) * r
        z[p + 11] = (spin * z[p + 2] - b) * r
        z[p + 12] = (d - e) * r
    d1 = d2 = e1 = e2 = e3 = 0.0
    for k in range(order, 0, -1):  # small terms first
        p = 8 * k
        d1 -= z[p - 5] * c[2 + k]
        d2 += z[p - 6] * c[2 + k]
        e1 += z[p + 2]
        e2 += z[p + 3]
        e3 += z[p + 4]
    return J1 + alpha_h * d1, J2 + alpha_h * d2, J3, x1 + e1, x2 + e2, x3 + e3


def prepare_fixed(top: LagrangeTop, y0: Array, h: float, *, order: int = 20) -> FixedStepper:
    """The Taylor polynomial of degree `order`, at most 60, in every step."""
    if check_count(order, "order", least=1) > MAX_ORDER:
        raise ValueError(f"order must be at most {MAX_ORDER}; got {order}")
    c = np.concatenate(((h, h * top.alpha, order), 1 / np.arange(1.0, order + 1)))
    return FixedStepper("taylor_fixed", h, c, step, rhs_per_step=order)


NATURAL = Method(
    name="taylor",
    label="Taylor (heyoka)",
    family="taylor",
    order=20,
    symmetric=False,
    poisson=False,
    conserves=frozenset({"J3"}),
    control="tolerance",
    source="heyoka.taylor_adaptive; Biscani and Izzo, MNRAS 504 (2021) 2614",
    prepare=prepare,
    evaluate=evaluate,
    attitude=attitude,
    requires="heyoka",
    engine="heyoka",
)

FIXED = Method(
    name="taylor_fixed",
    label="Taylor 20, fixed step",
    family="taylor",
    order=20,
    symmetric=False,
    poisson=False,
    conserves=frozenset({"J3"}),
    control="step",
    source="Jorba and Zou, Exp. Math. 14 (2005) 99, section 2",
    prepare=prepare_fixed,
)
