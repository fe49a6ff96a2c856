"""Taylor series methods: heyoka on its natural steps, and a compiled fixed step of any order.

`taylor` is heyoka's adaptive integrator as it is meant to be used: natural steps, unrolled machine code
(`compact_mode=False`), one call for a whole run; h is only the output grid, which its dense output fills. A step
clamped to h would be unfair to heyoka: the order follows from the tolerance, and the step from the decay of the
coefficients. The tolerance is relative above norm 1 and absolute below, so a state smaller than 1 may need other
units. A top whose rate |J| + √(|alpha||x|) or |x| is beyond 2^±FAR is followed in units, powers of two, in which both are
of order one. Their twentieth powers would under- or overflow. alpha is a runtime parameter, so heyoka compiles once per
process for each tolerance and variant.

`taylor_accurate` adds compensated summation of the series, `taylor_compact` the machine code heyoka makes for large systems
(loops over tables instead of unrolled; slower here). `advance_many` runs many tops at once, one in each SIMD lane.

`taylor_fixed` sums the same series at a fixed h. It is a recurrence compiled here and not heyoka's `write_tc` with
`update_d_output`: that is a Python call per step, 1 µs against 0.3 µs of arithmetic, and heyoka is not to be had everywhere.
The tests compare the two.

Both keep J3, whose coefficients vanish; nothing else is built in. An evaluation of the right-hand side counts as one
Taylor coefficient of it: `order` for each step.

Source: Jorba & Zou, Exp. Math. 14 (2005) 99; Biscani & Izzo, MNRAS 504 (2021) 2614 (heyoka).
"""

from __future__ import annotations

import contextlib
import copy
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from integrators.checks import check_count, check_flag, check_real
from integrators.compiling.compiled import jit
from integrators.compiling.loops import FixedStepper
from integrators.compiling.numba_internals import stack
from integrators.interface import AnyField, Array, Method, StepError, Work
from integrators.methods.dense import DenseStepper, Problem, Run, at_times
from integrators.problem.field import Field
from integrators.problem.perturbed import PerturbedTop
from integrators.problem.top import LagrangeTop
from integrators.problem.units import Units, ldexp, units_of

EPS = float(np.finfo(float).eps)
FAR = 30  # powers of two
INTERRUPTIBLE = 1 << 20  # steps in one call of heyoka, at most: it does not see Ctrl-C
MAX_ORDER = 60
SCRATCH = 8 * (MAX_ORDER + 1)


# ------------------------------------------------------------------------------------ natural steps, heyoka


def prepare(top: Problem, y0: Array, h: float, *, tol: float = EPS, high_accuracy: bool = False) -> DenseStepper:
    """Natural steps with the local error kept below `tol` (relative above norm 1); `high_accuracy`: compensated sums."""
    return DenseStepper("taylor", top, y0, h, _runner("taylor", top, tol, high_accuracy))


def evaluate(
    top: Problem, y0: Array, times: Array, *, tol: float = EPS, high_accuracy: bool = False
) -> tuple[Array, Work]:
    """Dense output at any times; options as in `prepare`."""
    return at_times("taylor", top, _runner("taylor", top, tol, high_accuracy), y0, times)


def variant(name: str, high_accuracy: bool = False, compact_mode: bool = False) -> tuple[Callable, Callable]:
    """`prepare` and `evaluate` of a method that sets heyoka's switches for good."""

    def prepare(top: Problem, y0: Array, h: float, *, tol: float = EPS) -> DenseStepper:
        return DenseStepper(name, top, y0, h, _runner(name, top, tol, high_accuracy, compact_mode))

    def evaluate(top: Problem, y0: Array, times: Array, *, tol: float = EPS) -> tuple[Array, Work]:
        return at_times(name, top, _runner(name, top, tol, high_accuracy, compact_mode), y0, times)

    return prepare, evaluate


class Form(NamedTuple):
    """What equations depend on, besides numbers: the field, whether it keeps J3, and whether x and torque have units.

    Then these units are two more numbers, in front of the others.
    """

    field: Field
    level: bool
    units: bool = False


def form_of(top: Problem) -> Form | None:
    """None for a uniform field."""
    return None if isinstance(top, LagrangeTop) else Form(top.field, "J3" in top.conserved)


def equations(form: Form | None = None) -> list[Any]:
    """The equations of motion in heyoka's symbols; alpha and the parameters of a potential are its runtime parameters."""
    import heyoka as hy

    hy.set_logger_level_critical()  # its warnings about the disk cache go to stdout
    J1, J2, J3, x1, x2, x3 = hy.make_vars("J1", "J2", "J3", "x1", "x2", "x3")
    if form is None:
        alpha = hy.par[0]
        t1, t2, t3 = -alpha * x2, alpha * x1, 0.0
    else:
        first, n = 2 * form.units, form.field.parameters
        length, force = (hy.par[0], hy.par[1]) if form.units else (1.0, 1.0)
        torque = form.field.torque(
            *(length * v if form.units else v for v in (x1, x2, x3)), *(hy.par[first + i] for i in range(n))
        )
        t1, t2, t3 = (t / force for t in torque) if form.units else torque
        t3 = 0.0 if form.level else t3
    moments = [(J, t if isinstance(t, hy.expression) else hy.expression(t)) for J, t in ((J1, t1), (J2, t2), (J3, t3))]
    return [*moments, (x1, J2 * x3 - J3 * x2), (x2, J3 * x1 - J1 * x3), (x3, J1 * x2 - J2 * x1)]


def set_numbers(ta: Any, numbers: Any) -> None:
    """The runtime parameters, of which heyoka has only those that the equations contain, up to the last of them."""
    ta.pars[:] = numbers[: len(ta.pars)]


@lru_cache(maxsize=64)
def compile_integrator(tol: float, high_accuracy: bool, compact_mode: bool = False, form: Form | None = None) -> Any:
    """heyoka's integrator for one tolerance. It has a state: see `integrator_here`."""
    import heyoka as hy

    return hy.taylor_adaptive(
        equations(form), [1.0] * 6, tol=tol, high_accuracy=high_accuracy, compact_mode=compact_mode
    )


def integrator_here(*key: Any) -> Any:
    """The same, one for each thread: a copy takes 0.7 ms, as long as heyoka needs for 700 units of time.

    Steppers share it; nothing of a run is left in it that the next does not set.
    """
    kept: dict[Any, Any] = _here.__dict__.setdefault("integrators", {})
    if key not in kept:
        kept[key] = copy.deepcopy(compile_integrator(*key))
    return kept[key]


_here = threading.local()


def check_tolerance(tol: Any) -> float:
    tol = check_real(tol, "tol")
    if not EPS <= tol <= 1:
        raise ValueError(f"tol must be between {EPS:.3g} (machine epsilon) and 1; got {tol:g}")
    return tol


def far_units(name: str, top: Problem, y: Array, end: float) -> Units | None:
    """The units in which a state is to be followed; None for the user's."""
    size = math.hypot(*y[3:].tolist())
    rate = math.hypot(*y[:3].tolist()) + math.sqrt(abs(top.alpha) * size)
    if 2.0**-FAR < size < 2.0**FAR and 2.0**-FAR < rate < 2.0**FAR:
        return None
    units = units_of(name, top, y, end)
    return units if max(abs(units.rate), abs(units.length)) > FAR else None


def _runner(name: str, top: Problem, tol: float, high_accuracy: bool, compact_mode: bool = False) -> Run:
    tol = check_tolerance(tol)
    key = tol, check_flag(high_accuracy, "high_accuracy"), compact_mode, form_of(top)
    numbers = (top.alpha,) if isinstance(top, LagrangeTop) else top.numbers
    integrator_here(*key)

    def run(y: Array, grid: Array, work: Work) -> Array:
        if units := far_units(name, top, y, float(grid[-1])):
            scaled = np.array([units.time(t) for t in grid.tolist()])
            try:
                return units.leave(follow(units.enter(y), scaled, work, *in_units(units)))
            except StepError as error:
                raise StepError(name, f"{error.reason}, in units of 2^{-units.rate}", step=error.step) from None
        return follow(y, grid, work, key, numbers)

    def in_units(units: Units) -> tuple[Any, Any]:
        if isinstance(top, LagrangeTop):
            return key, (units.alpha,)
        form = Form(top.field, "J3" in top.conserved, units=True)
        return (*key[:3], form), (ldexp(1.0, units.length), ldexp(1.0, 2 * units.rate), *numbers)

    def follow(y: Array, grid: Array, work: Work, key: Any, numbers: Any) -> Array:
        ta = integrator_here(*key)  # of the thread that runs
        set_numbers(ta, numbers)
        ta.time = 0.0
        ta.state[:] = y
        try:
            out, steps = _until(ta, grid[0]) if len(grid) == 1 else _on_grid(ta, y, grid)
        except StepError as error:
            raise StepError(name, error.reason, step=error.step) from None
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
    at = f" at t = {ta.time:g}" if math.isfinite(ta.time) else ""
    raise StepError("taylor", f"heyoka: {outcome.name}{at}", step=steps)


@lru_cache(maxsize=8)
def compile_body(tol: float, high_accuracy: bool) -> Any:
    """heyoka's integrator for (J, x) and the quaternion g of the frame that turns with J, g' = J g/2."""
    import heyoka as hy

    system = equations()
    J1, J2, J3, a, b, c, d = hy.make_vars("J1", "J2", "J3", "a", "b", "c", "d")
    system += [(a, -0.5 * (J1 * b + J2 * c + J3 * d)), (b, 0.5 * (J1 * a + J2 * d - J3 * c))]
    system += [(c, 0.5 * (J2 * a + J3 * b - J1 * d)), (d, 0.5 * (J3 * a + J1 * c - J2 * b))]
    return hy.taylor_adaptive(system, [1.0] * 10, pars=[1.0], tol=tol, high_accuracy=high_accuracy, compact_mode=False)


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
    ta = copy.deepcopy(compile_body(check_tolerance(tol), bool(high_accuracy)))
    alpha, y, row = top.alpha, y0, h * every
    if units := far_units("taylor", top, y0, h):
        alpha, y, row = units.alpha, units.enter(y0), units.time(row)
    ta.pars[0] = alpha
    ta.state[:] = np.concatenate((y, g0))
    outcome, _, _, steps, _, out = ta.propagate_grid(row * np.arange(n // every + 1.0))
    try:
        _check(ta, outcome, steps)
    except StepError as error:
        raise StepError("taylor", error.reason, h=h, step=error.step) from None
    g = out[:, 6:]
    unit: Array = g / np.linalg.norm(g, axis=1, keepdims=True)
    return unit


# ------------------------------------------------------------------------------------ many tops at once, heyoka


def _batches(form: Form | None, numbers: Array, Y0: Array, times: Array, tol: float, width: int) -> Array:
    """States (len(times), n, 6) of n tops from Y0 (n, 6), each on natural steps of its own, `width` tops in one SIMD register.

    `numbers` (n, k) are alpha and the parameters of a potential; `times` lead away from 0 (which may be among them) in one
    direction. |J| and |x| should be between 2^-FAR and 2^FAR.
    """
    n, out = len(Y0), np.empty((len(times), len(Y0), 6))
    moving = times != 0.0
    out[~moving] = Y0
    if not np.any(moving) or n == 0:
        return out
    ta = copy.deepcopy(compile_batch(tol, width, form))
    for first in range(0, n, width):
        places = np.minimum(np.arange(first, first + width), n - 1)  # the last top fills up the last register
        ta.set_time(0.0)
        set_numbers(ta, numbers[places].T)
        ta.state[:] = Y0[places].T
        states = _batch_on_grid(ta, times[moving], first)
        out[moving, first : first + width] = states.transpose(0, 2, 1)[:, : n - first]
    if not np.all(np.isfinite(out)):
        raise StepError("taylor", "in a batch, a state left the range of floating-point numbers")
    return out


def advance_many(alphas: Array, *run: Any, **options: Any) -> NDArray[np.bool_]:
    """Natural steps of many tops, in heyoka's batch mode; what it refuses, and compensated sums, are taken one by one."""
    return _advance([(None, np.arange(len(alphas)), alphas[:, None])], *run, **options)


def advance_many_in_field(problems: Sequence[PerturbedTop], *run: Any, **options: Any) -> NDArray[np.bool_]:
    """As `advance_many`; tops that keep J3 and tops that do not are in batches of their own."""
    kinds: dict[Form | None, list[int]] = {}
    for i, problem in enumerate(problems):
        kinds.setdefault(form_of(problem), []).append(i)
    groups = [
        (form, np.array(places), np.array([problems[i].numbers for i in places])) for form, places in kinds.items()
    ]
    return _advance(groups, *run, **options)


def _advance(
    groups: Sequence[tuple[Form | None, NDArray[np.intp], Array]],
    Y0: Array,
    h: float,
    steps: int,
    every: int,
    out: Array,
    stopped: Callable[[], bool],
    *,
    tol: float = EPS,
    high_accuracy: bool = False,
) -> NDArray[np.bool_]:
    """For groups (form, places in Y0, numbers): rows of `out`, and which tops were done."""
    done, tol = np.zeros(len(Y0), dtype=bool), check_tolerance(tol)
    if high_accuracy or not math.isfinite(h * steps):
        return done
    times = h * every * np.arange(1.0, steps // every + 1)
    for form, places, numbers in groups:
        size = np.linalg.norm(Y0[places, 3:], axis=1)
        rate = np.linalg.norm(Y0[places, :3], axis=1) + np.sqrt(np.abs(numbers[:, 0]) * size)
        low, high = 2.0**-FAR, 2.0**FAR  # what is beyond needs units: see `far_units`
        near = (size > low) & (size < high) & (rate > low) & (rate < high)
        places, numbers = places[near], numbers[near]
        with contextlib.suppress(StepError):
            if not stopped():
                out[:, places] = _batches(form, numbers, Y0[places], times, tol, recommended_width())
                done[places] = True
    return done


def recommended_width() -> int:
    """Doubles in a SIMD register of this machine."""
    import heyoka as hy

    return int(hy.recommended_simd_size())


@lru_cache(maxsize=16)
def compile_batch(tol: float, width: int, form: Form | None = None) -> Any:
    """heyoka's integrator for `width` tops at once. It has a state: take a copy."""
    import heyoka as hy

    return hy.taylor_adaptive_batch(equations(form), np.ones((6, width)), tol=tol, compact_mode=False)


def _batch_on_grid(ta: Any, times: Array, first: int) -> Array:
    """States (len(times), 6, width) from the present one, at time 0; `first` is the number of the first top."""
    start = ta.state.copy()
    for limit in ({"max_steps": INTERRUPTIBLE}, {"callback": lambda ta: True}):  # as in `_on_grid`
        ta.set_time(0.0)
        ta.state[:] = start
        if len(times) == 1:
            ta.propagate_until(np.full(ta.batch_size, times[0]), **limit)
            states: Array = ta.state.copy()[None]
        else:
            grid = np.repeat(np.concatenate(((0.0,), times))[:, None], ta.batch_size, axis=1)
            states = ta.propagate_grid(grid, **limit)[1][1:]
        if not _limited(ta, first):
            break
    return states


def _limited(ta: Any, first: int) -> bool:
    """Whether a lane stopped for the limit of steps; StepError if one stopped for a reason of its own."""
    import heyoka as hy

    good = (hy.taylor_outcome.time_limit, hy.taylor_outcome.step_limit, hy.taylor_outcome.success)
    for lane, (outcome, _, _, steps) in enumerate(ta.propagate_res):
        if outcome not in good:
            raise StepError("taylor", f"heyoka: {outcome.name}, top {first + lane} of the batch", step=steps)
    return any(result[0] != hy.taylor_outcome.time_limit for result in ta.propagate_res)


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
    advance_many=advance_many,
    in_field=AnyField(
        prepare, conserves=frozenset({"J3"}), needs="smooth", evaluate=evaluate, advance_many=advance_many_in_field
    ),
)

ACCURATE_PREPARE, ACCURATE_EVALUATE = variant("taylor_accurate", high_accuracy=True)
ACCURATE = replace(
    NATURAL,
    name="taylor_accurate",
    label="Taylor (heyoka), compensated",
    prepare=ACCURATE_PREPARE,
    evaluate=ACCURATE_EVALUATE,
    attitude=None,
    advance_many=None,
    in_field=AnyField(ACCURATE_PREPARE, conserves=frozenset({"J3"}), needs="smooth", evaluate=ACCURATE_EVALUATE),
)

COMPACT_PREPARE, COMPACT_EVALUATE = variant("taylor_compact", compact_mode=True)
COMPACT = replace(
    NATURAL,
    name="taylor_compact",
    label="Taylor (heyoka), compact code",
    prepare=COMPACT_PREPARE,
    evaluate=COMPACT_EVALUATE,
    attitude=None,
    advance_many=None,
    in_field=AnyField(COMPACT_PREPARE, conserves=frozenset({"J3"}), needs="smooth", evaluate=COMPACT_EVALUATE),
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
    uniform_only="its recurrence is written for a uniform field; taylor takes any",
)
