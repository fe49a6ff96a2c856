"""The two-point Bäcklund transformation of Kuznetsov, Petrera and Ragnisco as a real, pole-free integrator.

The map conserves H, J3, C1 and C2, and is Poisson and symmetric; the formula is in `torus.real_map`. A step costs one division
and about eighty other operations. It adds increments of size O(h), so nothing cancels for small h. Where λ is large, or close to
a root of Q, the map is computed in another form.

There are three records. `backlund` takes λ(h) on the torus of the initial state, which makes the step the exact flow over h.
`backlund_unpinned` does the same without the correction below. `backlund_paper` takes λ = i h √C1/2, the paper's own time step.

Constants are computed in double-double and rounded once. What is left of round-off is a random walk. Every `pin` steps the state
is moved back onto its own H, C1 and C2 by the smallest correction, about 1e-16 in size.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lagrange_bench.integrators.checks import check_count
from lagrange_bench.integrators.compiling.lanes import run_lanes
from lagrange_bench.integrators.compiling.loops import NEVER, FixedStepper, Kernel
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Work
from lagrange_bench.integrators.methods.closed_body import BodyStepper, with_attitude
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus import real_map
from lagrange_bench.integrators.torus import time_step as ts
from lagrange_bench.integrators.torus.any_parameter import check_parameter, papers_parameter, plain_constants

PIN = 8  # steps between two pins, by default


def stepper(
    name: str, top: LagrangeTop, y0: Array, h: float, pin: int = PIN, lam: complex | None = None
) -> FixedStepper:
    """Steps of the time h; or, with `lam`, of the two-point map of that parameter."""
    units = Units(top, y0, h)
    state, turn = units.enter(y0), real_map.NO_TURN
    if lam is None:
        c, turn = real_map.exact_constants(units.alpha, tuple(state.tolist()), units.span(name, h))
    else:
        c = plain_constants(units.alpha, state, units.parameter(check_parameter(lam)), -1 if h < 0 else 1)
    real_map.check_constants(name, c, h)
    restore, block = (real_map.restore_invariants, pin) if pin else (None, NEVER)
    return real_map.TorusStepper(name, h, Kernel(real_map.KERNELS[real_map.form(c)], restore, block), c, units, turn)


def prepare_exact(top: LagrangeTop, y0: Array, h: float, *, pin: int = PIN, lam: complex | None = None) -> FixedStepper:
    """The exact step over h ≠ 0 of any length; or, with `lam`, the two-point map of that parameter.

    Parameters
    ----------
    pin : steps between two corrections onto the invariants, 0 for none.
    lam : λ with Im λ > 0. The map is then a step of the time T(λ) and a turn about e3, and h only labels the steps. h < 0
        takes the inverse map.
    """
    return stepper("backlund", top, y0, h, check_count(pin, "pin"), lam)


def prepare_unpinned(top: LagrangeTop, y0: Array, h: float) -> FixedStepper:
    """The exact step over h, never pinned: it shows what the map does by itself."""
    return stepper("backlund_unpinned", top, y0, h, 0)


def prepare_paper(top: LagrangeTop, y0: Array, h: float, *, pin: int = PIN) -> FixedStepper:
    """The two-point map with the paper's time step, λ = i h √C1/2: second order, T = h + O(h³)."""
    lam = papers_parameter("backlund_paper", y0, h)
    return stepper("backlund_paper", top, y0, h, check_count(pin, "pin"), lam)


def evaluate_exact(problem: LagrangeTop | RigidBody, y0: Array, times: Array) -> tuple[Array, Work]:
    """The states at any times: one two-point map from y0 to each time, whatever the distance."""
    if isinstance(problem, RigidBody):
        states, work = states_at("backlund", problem.top, problem.reduced(y0), times)
        return with_attitude("backlund", problem, y0, times, states), work
    return states_at("backlund", problem, y0, times)


def states_at(name: str, top: LagrangeTop, y0: Array, times: Array) -> tuple[Array, Work]:
    """The states of a top at any times. name : of the method, for messages."""
    units = Units(top, y0, float(np.max(np.abs(times), initial=0.0)) or 1.0)
    y = units.leave(ts.exact_flow(units.alpha, tuple(units.enter(y0)), units.spans(name, times)))
    y[times == 0.0] = y0
    if not np.all(np.isfinite(y)):
        raise StepError(name, "no Bäcklund parameter was found for one of the times")
    return y, Work(steps=len(times))


def record_tops(
    alphas: Array,
    Y0: Array,
    h: float,
    steps: int,
    every: int,
    out: Array,
    stopped: Callable[[], bool],
    *,
    pin: int = PIN,
    lam: complex | None = None,
) -> NDArray[np.bool_]:
    """Put the exact steps of many tops into `out`, each with its own λ(h) and constants; options and bits as of `prepare_exact`.

    Returns a mask of the tops that are done. The caller steps the others one by one.
    """
    pin, n = check_count(pin, "pin"), len(Y0)
    if lam is not None:  # λ is another number in the units of each top
        check_parameter(lam)
        return np.zeros(n, dtype=bool)
    states, units, c, turns = (np.empty((n, width)) for width in (6, 6, real_map.CONSTANTS, 4))
    is_done = np.zeros(n, dtype=bool)
    real_map.many_constants(alphas, Y0, h, states, c, units, is_done, turns)
    if np.any(is_done):
        kernel = (real_map.step, real_map.restore_invariants, pin) if pin else (real_map.step, None, NEVER)
        run_lanes(kernel, states, c, np.flatnonzero(is_done), steps, every, out, stopped)
    real_map.leave_many(out, is_done, turns, every, units)
    return is_done


def prepare_body(body: RigidBody, y0: Array, h: float, *, pin: int = PIN) -> BodyStepper:
    """The exact step of a symmetric body, `pin` as in `prepare_exact`: its top steps, and its attitude is the closed form."""
    pin = check_count(pin, "pin")
    prepare_exact(body.top, body.reduced(y0), h, pin=pin)  # fails here, and not in the first step

    def solution(body: RigidBody, y: Array, times: Array) -> Array:
        every, start = round(float(times[1]) / h) if len(times) > 1 else 1, body.reduced(y)
        states = prepare_exact(body.top, start, h, pin=pin).record(start, every * (len(times) - 1), every)
        return with_attitude("backlund", body, y, times, states)

    return BodyStepper(body, h, solution)


SOURCE = "Kuznetsov, Petrera, Ragnisco, J. Phys. A 37 (2004) 8495, arXiv nlin/0403028, section 5.5"


EXACT = Method(
    name="backlund",
    label="Bäcklund, exact λ(h)",
    family="backlund",
    order=None,
    claims=Claims(symmetric=True, poisson=True, conserves={"H", "J3", "C1", "C2"}),
    source=SOURCE + "; λ(h) by time doubling, this project",
    prepare=prepare_exact,
    evaluate=evaluate_exact,
    many=record_tops,
    kernels_for={kinds.symmetric_body: prepare_body},
)
UNPINNED = replace(
    EXACT,
    name="backlund_unpinned",
    label="Bäcklund, exact, not pinned",
    prepare=prepare_unpinned,
    evaluate=None,
    many=partial(record_tops, pin=0),
    kernels_for={},
)
PAPER = replace(
    UNPINNED,
    name="backlund_paper",
    label="Bäcklund, paper's λ",
    order=2,
    source=SOURCE,
    prepare=prepare_paper,
    many=None,
)
