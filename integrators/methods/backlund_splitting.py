"""The exact step inside a splitting: for a top in a weak potential V beside its weight.

    H = A + B,    A = |J|²/2 + alpha x3,    B = V(x)

The flow of A is a Bäcklund step, exact for any length; the flow of B is a kick, x being constant. As with Kepler's motion in the
maps of Wisdom and Holman, the step follows what perturbs the top, not the top, and errors come with a factor ε, the size of V.
A kick leaves the torus, so λ(h) is another at every step: a function of (H, J3) of A, which move in a small box. Four polynomials
in them, a table made once, give λ and m; one step of Newton's method puts m on the curve m² = Q(λ), on which the map keeps the
invariants to round-off. Outside of the box, and where no table of degree 12 has all digits, λ(h) is computed in place
(`torus.plain_step`), and where that does not reach, in double-double.

Schemes, A B A … B A, and the errors they leave, where the frequencies of V along the motion are well below 2π/h:

strang      one flow a step, with a `modified_kick` and a `corrector` at both ends of the run and at every recorded row: ε²h⁴
processed6  two kicks and a flow back between them, with both corrections too, and one more of each: ε²h⁶
aba864      seven kicks and nothing at the ends, for states that are recorded often: εh⁸ + ε²h⁶ + ε³h⁴

V may depend on t: a kick takes it at the time of the flows before. With `tol` in place of h the step is halved until two runs
agree (`step_halving`).

Every map here is Poisson and symmetric, and C1 and C2 are pinned. Only a table with all digits makes it so, not any smooth one: a
step of time T(H, J3) and turn Θ(H, J3) is Poisson only if ∂T/∂J3 = ∂Θ/∂H. docs/perturbed.md derives all of it.

Sources: Wisdom & Holman, Astron. J. 102 (1991) 1528; Wisdom, Holman & Touma, Fields Inst. Commun. 10 (1996) 217 (correctors);
Blanes, Casas, Farrés, Laskar, Makazaga & Murua, Appl. Numer. Math. 68 (2013) 58 (aba864). The exact step as the flow of A, its
table, this corrector: this project.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial
from itertools import chain, pairwise
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import check_choice, check_flag, warn_caller
from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import tuple_loader, tuple_storer
from lagrange_bench.integrators.compiling.interpreted import at_first_interpreted
from lagrange_bench.integrators.compiling.tape import bandwidth, phase_rates
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Stepper, StepWarning, Work
from lagrange_bench.integrators.methods import backlund, step_halving
from lagrange_bench.integrators.methods.backlund_schemes import PROCESSED, SCHEMES, WIDEST, Scheme, ends_of
from lagrange_bench.integrators.methods.dense import at_times
from lagrange_bench.integrators.methods.splitting import torques
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System, depends
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.torus import time_step
from lagrange_bench.integrators.torus.plain_step import invariants, move, parameter
from lagrange_bench.integrators.torus.real_map import OFF_TORUS
from lagrange_bench.integrators.torus.step_table import look_up, table_size, tables

# places of the constants: those of the top, of the box, of the field, then of each group its own and its table
ALPHA, C1, C2, GROUPS, STEP, CENTRE_H, SCALE_H, CENTRE_J, SCALE_J, NUMBERS = range(10)
# of one flow and one kick: its time from that of the step; 1/(2|m|²) in the middle of the box
TIME, KICK, TWIST, SECOND, WHEN, INVERSE, GROUP = range(7)

NAME = "backlund_splitting"
first_nutation_period = at_first_interpreted(time_step.nutation_period)
LOST = 1
MOST_PARTS = 2**16  # of an exact step that is too long for one; its kicks are too far from one another long before
FAILURES = {LOST: "no exact step over this time was found; take a smaller |h|"}


@jit
def exact_flow(s, alpha, h):
    """The exact step over h, λ(h) computed in place, and whether one was found: in equal parts where h is too long for that."""
    torus, parts = invariants(s, alpha), 1
    R, eta, mr, mi, ok = parameter(torus, s[2], alpha, h)
    while not ok and parts < MOST_PARTS:
        parts *= 2
        R, eta, mr, mi, ok = parameter(torus, s[2], alpha, h / parts)
    for _ in range(parts if ok else 0):
        s = move(s, alpha, (R, eta, mr, mi))
    return s, ok


@unrolled
def tabled_flow(s, torus, alpha, R, eta, mr, mi, inverse):
    """The exact step with λ and m of a table, and one step of Newton's method for m on the curve m² = Q(λ).

    It is `plain_step.move`, arranged for a short chain of operations. The m of the table has all its digits but the
    last. So the division by n need not wait for the correction d of m: 1/(n + δ) is 1/n − δ/n². For the same reason
    1/(2|m|²) may be that of another torus of the box.
    """
    J1, J2, J3, x1, x2, x3 = s
    double = 2.0 * alpha
    l2, i2 = R * R - eta * eta, 2.0 * (R * eta)  # λ²
    ee, mm = eta * eta, mr * mr + mi * mi
    q3 = eta * (J3 + double * R)
    p1, p2, p3 = x1 + R * J1, x2 + R * J2, x3 + (R * J3 + alpha * l2)
    n = (p1 * p1 + p2 * p2) + (((mm + q3 * q3) + p3 * p3) + ee * (J1 * J1 + J2 * J2))
    over = 1.0 / n
    c3, c4 = double * J3, alpha * alpha
    re = ((torus[0] - (mr * mr - mi * mi)) + torus[1] * R) + (l2 * (torus[2] + c3 * R) - i2 * (c3 * eta))
    im = (torus[1] * eta - 2.0 * (mr * mi)) + (i2 * (torus[2] + c3 * R) + l2 * (c3 * eta))
    re, im = re + c4 * (l2 * l2 - i2 * i2), im + c4 * (2.0 * (l2 * i2))
    d, e = inverse * (re * mr + im * mi), inverse * (im * mr - re * mi)
    f = 2.0 * (mr * d + mi * e)
    mr, mi = mr + d, mi + e
    r = 2.0 * eta * over
    r -= r * (f * over)
    me = mi * eta
    z = eta * x3 - eta * (alpha * (R * R + ee))
    u1 = (mr * p1 + me * J1) - (q3 * x2 - z * J2)
    u2 = (mr * p2 + me * J2) + (q3 * x1 - z * J1)
    u3 = (mr * p3 + mi * q3) - eta * (x1 * J2 - x2 * J1)
    v1, v2 = double * u1, double * u2
    K1, K2 = J1 + J1, J2 + J2
    w = 2.0 * J3
    y1 = K2 * u3 - (R * v2 + w * u2)
    y2 = (R * v1 + w * u1) - K1 * u3
    y3 = K1 * u2 - K2 * u1
    return (
        J1 - r * v2,
        J2 + r * v1,
        J3,
        x1 + r * (y1 + r * (v1 * u3)),
        x2 + r * (y2 + r * (v2 * u3)),
        x3 + r * (y3 - r * (v1 * u1 + v2 * u2)),
    )


@cache
def kick_of(V: System, gradients: int) -> Any:
    """(s, q, weights) → the state after kicks by V and as many of W and Z as `gradients` says; q = (t, *p)."""
    total, conserves_J3 = torques(V, gradients), 2 in V.constant

    @jit(inline=True)
    def kicked(s, q, weights):
        t = total((s[3], s[4], s[5]), q, weights)
        return s[0] + t[0], s[1] + t[1], s[2] if conserves_J3 else s[2] + t[2], s[3], s[4], s[5]

    return kicked


@cache
def numbers_of(V: System) -> Any:
    """(c, first, t) → t and the parameters; in c from `first` on they follow the time at the start."""
    at_start, parameters, timed = tuple_loader(1 + V.parameters), tuple_loader(V.parameters), V.timed

    @jit
    def run(c, first, t):
        return (t,) + parameters(c, first + 1) if timed else at_start(c, first)  # noqa: RUF005 - as elsewhere

    return run


@cache
def kernel(V: System, gradients: int, degree: int, single: bool) -> Any:
    """The step; `degree` of the tables, 0 for none; `single`: of one flow and one kick, at places that the compiler knows."""
    conserves_J3, timed = 2 in V.constant, V.timed
    kicked, numbers, look = kick_of(V, gradients), numbers_of(V), look_up(degree or 1, conserves_J3)
    first, stride = NUMBERS + 1 + V.parameters, GROUP + table_size(degree, conserves_J3)

    @jit(inline=True)
    def step(s, c, counters):
        alpha = c[ALPHA]
        for g in range(1 if single else int(c[GROUPS])):
            place = first + g * stride
            torus = invariants(s, alpha)
            u, v = (torus[2] - c[CENTRE_H]) * c[SCALE_H], (s[2] - c[CENTRE_J]) * c[SCALE_J]
            if degree > 0 and abs(u) <= 1.0 and abs(v) <= 1.0:
                R, eta, mr, mi = look(c, place + GROUP, u, v)
                s = tabled_flow(s, torus, alpha, R, eta, mr, mi, c[place + INVERSE])
            else:
                counters[loops.ITERATIONS] += 1.0 if degree > 0 else 0.0
                s, ok = exact_flow(s, alpha, c[place + TIME])
                if not ok:
                    counters[loops.FAILURE] = LOST
            t = c[NUMBERS] + (c[STEP] * counters[loops.CLOCK] + c[place + WHEN]) if timed else 0.0
            s = kicked(s, numbers(c, NUMBERS, t), (c[place + KICK], c[place + TWIST], c[place + SECOND]))
        return s

    return step


@jit
def restore_casimirs(s, c):
    """Back onto C1 and C2: x along itself, then J along x."""
    J1, J2, J3, x1, x2, x3 = s
    f = 0.5 * (c[C1] - ((x1 * x1 + x2 * x2) + x3 * x3)) / c[C1]
    x1, x2, x3 = x1 + f * x1, x2 + f * x2, x3 + f * x3
    p = (c[C2] - ((x1 * J1 + x2 * J2) + x3 * J3)) / c[C1]
    return J1 + p * x1, J2 + p * x2, J3 + p * x3, x1, x2, x3


@jit
def restore_casimirs_at_fixed_J3(s, c):
    """The same where J3 is kept: J moves within the horizontal plane, and not at all where x is vertical."""
    J1, J2, J3, x1, x2, x3 = s
    f = 0.5 * (c[C1] - ((x1 * x1 + x2 * x2) + x3 * x3)) / c[C1]
    x1, x2, x3 = x1 + f * x1, x2 + f * x2, x3 + f * x3
    p = (c[C2] - ((x1 * J1 + x2 * J2) + x3 * J3)) / ((x1 * x1 + x2 * x2) + 2.0**-10 * c[C1])
    return J1 + p * x1, J2 + p * x2, J3, x1, x2, x3


RESTORE_EVERY = 16


@cache
def map_over(V: System) -> Any:
    """Of each row, in place: flows and kicks of the lengths in `parts`, one after the other.

    given : alpha, t at the start and the parameters. times : t, dt, n: the time of the first row is t + n dt, and so on.
    """
    kicked, numbers = kick_of(V, 0), numbers_of(V)
    get, write = tuple_loader(6), tuple_storer(6)

    @jit
    def run(rows, given, parts, times, counters):
        alpha, count = given[0], times[2]
        for row in rows:
            s = get(row, 0)
            t = times[0] + count * times[1]
            count += 1.0
            for k in range(len(parts)):
                t += parts[k, 0]
                if parts[k, 0] != 0.0:
                    s, ok = exact_flow(s, alpha, parts[k, 0])
                    if not ok:
                        counters[loops.FAILURE] = LOST
                if parts[k, 1] != 0.0:
                    s = kicked(s, numbers(given, 1, t), (parts[k, 1],))
            write(row, 0, s)

    return at_first_interpreted(run)


# ------------------------------------------------------------------------------------ the box of the tables

# steps that show where (H, J3) go, and their length in time scales of the top: they need not be exact
PILOT, STRIDE = 96, 1.2
MARGIN = 8.0  # the box is so many times as wide: a slow motion goes further than the trial run, and a table is cheap


@cache
def pilot(V: System) -> Any:
    """(y, c, h, steps) → the least and the largest 2H and J3 of the top without V, along so many steps of one flow and kick."""
    kicked, numbers = kick_of(V, 0), numbers_of(V)

    @jit
    def run(y, c, h, steps):
        alpha = c[ALPHA]
        s = (y[0], y[1], y[2], y[3], y[4], y[5])
        low_h = high_h = invariants(s, alpha)[2]
        low_j = high_j = s[2]
        for k in range(steps):
            s, ok = exact_flow(s, alpha, h)
            if not ok:
                break
            s = kicked(s, numbers(c, NUMBERS, c[NUMBERS] + (k + 1) * h), (h,))
            h2 = invariants(s, alpha)[2]
            low_h, high_h = min(low_h, h2), max(high_h, h2)
            low_j, high_j = min(low_j, s[2]), max(high_j, s[2])
        return low_h, high_h, low_j, high_j

    return at_first_interpreted(run)


STRONG = 0.05  # of the range of V to the energy of the top, from which other methods are better
RESONANT = 0.125  # of the nutation period, a step from which harmonics of the motion come near the step's own frequency
SHORTEST = math.pi  # nutation period there is, in time scales of the top
TOLERANCE = 1e-9


class ExactSplittingStepper(loops.ConjugateStepper):
    """Runs over the conjugate of a scheme; states enter and leave through its first flow and its corrector.

    `after`: how much later than the problem it starts, if V depends on time.
    """

    def __init__(
        self, problem: Problem, y0: Array, h: float, chosen: Scheme, corrected: bool, twisted: bool, tabled: bool,
        after: float = 0.0,
    ):  # fmt: skip
        (alpha, V), start, n = problem.alpha_and_rest, problem.start + after, len(chosen.b)
        conserves_J3, timed, given = 2 in V.constant, V.timed, np.array((alpha, start, *problem.numbers))
        J, x = y0[:3], y0[3:]
        times = ((chosen.a[0] + chosen.a[-1]) * h, *(a * h for a in chosen.a[1:-1]))
        gradients = (1 + bool(chosen.d)) if twisted else 0
        groups = [[0.0] * GROUP for _ in range(n)]
        for g, group in enumerate(groups):
            group[TIME], group[KICK] = times[g], chosen.b[g] * h
            if gradients > 0:
                group[TWIST] = chosen.c[g] * -(h * h * h)
            if gradients > 1:
                group[SECOND] = chosen.d[g] * (h * h * h * h * h)
            if timed:
                group[WHEN] = sum(chosen.a[1 : g + 1], chosen.a[0]) * h
        head = np.array((alpha, x @ x, x @ J, n, h, 0.0, 1.0, 0.0, 1.0, *given[1:]))
        degree, made = 0, []
        if tabled and _set_box(head, _top_of(problem).scales(y0), y0, pilot(V), h):
            different = tuple(dict.fromkeys(times))
            degree, listed = tables(head[ALPHA : C2 + 1], head[CENTRE_H:NUMBERS], different, conserves_J3)
            if degree:
                made = [listed[different.index(time)] for time in times]
                for group, table in zip(groups, made, strict=True):  # of the constant term
                    group[INVERSE] = 0.5 / (table[-2] * table[-2] + table[-1] * table[-1])
        c = np.concatenate([head, *chain.from_iterable((groups[g], *made[g : g + 1]) for g in range(n))])
        if not loops.finite(c):
            raise StepError(NAME, "the coefficients of the step are beyond the range of doubles", h=h)
        self.degree = degree  # of the tables, 0 for none
        self.sweep: Problem | None = None  # if its frequencies in time change: then the end of a run counts, too
        preprocess, postprocess = ends_of(chosen, h, corrected)
        step = kernel(V, gradients, degree, n == 1 and degree > 0)
        super().__init__(
            NAME, h, c, step, restore_casimirs_at_fixed_J3 if conserves_J3 else restore_casimirs, RESTORE_EVERY,
            map_rows=map_over(V), preprocess=(given, preprocess, (start, 0.0, 0.0)),
            postprocess=(given, postprocess, (start - chosen.a[0] * h, 0.0, 0.0)),
            rhs_per_step=n, failures=FAILURES, timed=timed,
        )  # fmt: skip

    def rows(self, out: Array, every: int) -> Array:
        given, parts, (start, *_) = self._postprocess
        self._map(out[1:], (given, parts, (start, every * self.h, 1.0)))
        return out

    def record(self, y: Array, n: int, every: int) -> Array:
        if self.sweep:
            _warn_long(self.sweep, np.asarray(y, dtype=float), self.h, n * self.h)
        return super().record(y, n, every)

    def enter(self, y: Array) -> Array:
        J1, J2, J3, x1, x2, x3 = y.tolist()
        c1, c2 = self.constants[C1 : C2 + 1].tolist()
        size = math.sqrt(c1) * math.hypot(J1, J2, J3)
        near = abs(x1 * x1 + x2 * x2 + x3 * x3 - c1) <= OFF_TORUS * c1
        if not (near and abs(x1 * J1 + x2 * J2 + x3 * J3 - c2) <= OFF_TORUS * size):
            raise StepError(NAME, "C1 or C2 of the state is not that of the state this step was prepared for", h=self.h)
        return super().enter(y)


def _set_box(
    c: Array, scales: tuple[float, float, float], y0: Array, run: Callable[..., tuple[float, ...]], h: float
) -> bool:
    """Sets the box of the tables, from a run with long steps; False if that does not get through."""
    rate, _, unit = scales
    if not math.isfinite(unit):  # without V nothing moves
        return False
    low_h, high_h, low_j, high_j = run(y0, c, math.copysign(STRIDE * unit, h), PILOT)
    for place, low, high, size in ((CENTRE_H, low_h, high_h, rate * rate), (CENTRE_J, low_j, high_j, rate)):
        width = 0.5 * MARGIN * (high - low) + 2.0**-40 * size
        if not 0.0 < width < math.inf or 1.0 / width == math.inf:
            return False
        c[place], c[place + 1] = 0.5 * (low + high), 1.0 / width
    return True


def prepare(
    top: LagrangeTop, y0: Array, h: float, *, scheme: str = "strang", corrector: bool | None = None,
    modified_kick: bool | None = None, table: bool = True,
) -> Stepper:  # fmt: skip
    """Without V every scheme is the exact step."""
    _check(scheme, corrector, modified_kick, table)
    try:
        stepper = backlund.EXACT.prepare(top, y0, h)
    except StepError as error:
        raise StepError(NAME, error.reason, h=h) from None
    stepper.name = NAME  # type: ignore[attr-defined]
    return stepper


def prepare_in_field(
    problem: Problem, y0: Array, h: float, *, scheme: str = "strang", corrector: bool | None = None,
    modified_kick: bool | None = None, table: bool = True,
) -> ExactSplittingStepper:  # fmt: skip
    """Kicks by V, exact flows of the top without it.

    Parameters
    ----------
    scheme : of SCHEMES. corrector, modified_kick : on by default for "strang" and "processed6", and possible for these only.
    table : λ from a table in (H, J3); False: computed at every flow.
    """
    corrected, twisted = _check(scheme, corrector, modified_kick, table)
    _warn_strong(problem, y0)
    _warn_long(problem, y0, h)
    stepper = ExactSplittingStepper(problem, y0, h, SCHEMES[scheme], corrected, twisted, bool(table))
    V = problem.alpha_and_rest[1]
    if V.timed and depends(phase_rates(V.energy, 0), [0]):
        stepper.sweep = problem
    return stepper


def _check(scheme: str, corrector: Any, modified_kick: Any, table: Any) -> tuple[bool, bool]:
    check_choice(scheme, "scheme", SCHEMES)
    chosen = []
    for name, value in (("corrector", corrector), ("modified_kick", modified_kick)):
        flag = scheme in PROCESSED if value is None else check_flag(value, name)
        if flag and scheme not in PROCESSED:
            raise ValueError(f"{name} belongs to scheme={' or '.join(map(repr, PROCESSED))}; got scheme={scheme!r}")
        chosen.append(flag)
    check_flag(table, "table")
    return chosen[0], chosen[1]


def evaluate(problem: Any, y0: Array, times: Array, *, tol: float = TOLERANCE) -> tuple[Array, Work]:
    """The step is halved until two runs agree to `tol`, relative to the scales of J and x: see `step_halving`.

    In a uniform field one exact step to each time, whatever `tol`.
    """
    tol, notes = step_halving.check_tolerance(tol), []
    if kinds.uniform(problem):
        try:
            states, work = backlund.evaluate_exact(problem, y0, times)
        except StepError as error:
            raise StepError(NAME, error.reason) from None
        work.notes = "one exact step to each time"
        return states, work
    _warn_strong(problem, y0)

    def run(y: Array, grid: Array, work: Work) -> Array:
        if not (problem.timed or np.any(problem.rhs(y))):
            notes.append("an equilibrium: no step is needed")
            return np.tile(y, (len(grid), 1))
        rate, size, unit = problem.scales(y)
        last, parts = float(grid[-1]), math.ceil(step_halving.PLACES / len(grid))
        frequency = _frequency(problem, y, np.linspace(0.0, last, step_halving.PLACES))
        longest = 2.0 * min(_longest(nutation_period(problem, y), frequency), unit)
        track = partial(_track, problem, y, grid, parts, longest, work)
        rows, halved, difference = step_halving.agreeing(NAME, track, tol, (rate, size))
        largest = longest / 2**halved
        notes.append(
            f"strang, h ≤ {largest:.3g} to t = {last:g}; twice the step makes a difference of {difference:.1e}"
        )
        return rows[parts - 1 :: parts]

    states, work = at_times(NAME, problem, run, y0, times)
    work.notes = "; ".join(notes)
    return states, work


def _track(problem: Problem, y: Array, grid: Array, parts: int, longest: float, work: Work, finer: int) -> Array:
    """States at the times of `grid` and, with equal distances, at parts − 1 before each; steps of at most longest/finer.

    A uniform grid is one run. Otherwise a run goes from each time to the next.
    """
    n, last, tracks = len(grid), float(grid[-1]), []
    uniform = np.allclose(grid, last * np.arange(1, n + 1) / n, rtol=4 * 2.0**-52, atol=0.0)
    for start, end in [(0.0, last)] if uniform else pairwise((0.0, *grid.tolist())):
        rows = (n if uniform else 1) * parts
        every = finer * max(1, math.ceil(abs(end - start) / rows / longest))
        h = (end - start) / (rows * every)
        if h == 0.0:  # it underflows: nothing moves in so short a time
            tracks.append(np.tile(y, (rows, 1)))
            continue
        stepper = ExactSplittingStepper(problem, y, h, SCHEMES["strang"], True, True, True, start)
        tracks.append(stepper.record(y, rows * every, every)[1:])
        y = tracks[-1][-1]
        for name in ("steps", "rhs_evals", "iterations"):
            setattr(work, name, getattr(work, name) + getattr(stepper.work, name))
    return np.concatenate(tracks)


def _warn_strong(problem: Problem, y0: Array) -> None:
    rate, length, _ = _top_of(problem).scales(y0)
    V = problem.alpha_and_rest[1]
    strength = length * math.hypot(*map(float, V.gradient(problem.start, *y0.tolist(), *problem.numbers)))
    if strength > STRONG * rate * rate:
        share = strength / rate / rate if rate > 0 else math.inf
        text = f"V is strong here, {share:.2g} of the top's own scale: blanes_moan6 costs less"
        warn_caller(text, StepWarning)


def _warn_long(problem: Problem, y0: Array, h: float, span: float = 0.0) -> None:
    """A warning, or a StepError, where the step is in resonance with V along the motion from y0 on, over a time `span`."""
    h, frequency, unit = abs(h), _frequency(problem, y0, np.array((0.0, span))), _top_of(problem).scales(y0)[2]
    if h <= RESONANT * SHORTEST * unit * (1.0 - h * frequency / WIDEST):
        return
    period = nutation_period(problem, y0)
    if h >= 0.5 * period:
        reason = f"h is {h / period:.2g} of the nutation period, in resonance with it; take less than a half"
        raise StepError(NAME, reason, h=h)
    if h > (longest := _longest(period, frequency)):
        drive = f" and {h * frequency / math.tau:.2g} of the shortest period of H in time" if frequency else ""
        text = f"h is {h / period:.2g} of the nutation period{drive}: V's harmonics are near resonance with it; take less than"
        warn_caller(f"{text} {longest:.3g}", StepWarning)


def _top_of(problem: Problem) -> LagrangeTop:
    """The top without V."""
    return LagrangeTop(problem.alpha_and_rest[0])


def _longest(period: float, frequency: float) -> float:
    """The step from which V along the motion has harmonics near 2π/h: of the nutation, of H in time, and of both together."""
    share = 1.0 / (RESONANT * period) + frequency / WIDEST
    return 1.0 / share if share > 0.0 else math.inf


def _frequency(problem: Problem, y0: Array, after: Array) -> float:
    """The highest angular frequency of V in time, at these times after the start: what sin, cos and exp in its formula show."""
    V = problem.alpha_and_rest[1]
    return bandwidth(V.energy, 0, (problem.start + after, *y0, *problem.numbers)) if V.timed else 0.0


def nutation_period(problem: Problem, y0: Array) -> float:
    """Of the top without V, to 1e-15; where nothing oscillates inf, or a long time."""
    top = _top_of(problem)
    rate, size, unit = top.scales(y0)
    if not 0.0 < rate < math.inf:
        return math.inf
    y = np.concatenate((y0[:3] / rate, y0[3:] / size if size > 0.0 else y0[3:]))
    return unit * first_nutation_period(top.alpha / rate * (size / rate), tuple(y.tolist()))[0]  # type: ignore[no-any-return]


METHOD = Method(
    name="backlund_splitting", label="Bäcklund splitting", family="backlund", order=4,
    claims=Claims(symmetric=True, poisson=True, conserves={"J3", "C1", "C2"}),
    source="this project; Wisdom and Holman, Astron. J. 102 (1991) 1528; corrector and modified kick: see the module",
    prepare=prepare_in_field, needs=kinds.driven_top, kernels_for={"uniform": prepare}, evaluate=evaluate,
)  # fmt: skip
