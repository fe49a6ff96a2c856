"""DOP853 on its natural steps, compiled: the explicit Runge-Kutta pair of order 8 with error estimates of orders 5 and 3.

It shows what the strongest explicit Runge-Kutta method with step control costs without an interpreter. h is only the output grid.
The step control, the first step and the interpolant of order 7 are those of Hairer's program, with its defaults: safety 0.9, no
stabilization, each step between a third and six times the one before. The exponent 1/8 of the control is three square roots.

A step takes 12 right-hand sides, with the slope at its start, and 4 more if it is interpolated. Hairer's program keeps that
slope: it saves one right-hand side at a rejected step and one at an interpolated step.

Source: Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I (1993), sections II.4 (first step), II.5, II.6, and
the program DOP853.
"""

import math
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import check_real
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import Program, machine_code, tuple_loader
from lagrange_bench.integrators.compiling.intrinsics import column, put_column
from lagrange_bench.integrators.compiling.loops import INTERRUPTIBLE
from lagrange_bench.integrators.compiling.tape import Tape
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Work
from lagrange_bench.integrators.methods.dense import Problem, Run, dense
from lagrange_bench.integrators.methods.runge_kutta import floats, stages, weigh
from lagrange_bench.integrators.methods.tableaux import DOP853
from lagrange_bench.integrators.problem.system import System

RTOL, ATOL, START, NUMBERS = range(4)  # places of the constants; START is the time at the start
# Places in `walk`: where a run on natural steps is, so that it can be resumed, and what it has done. WALK is their number.
TIME, STEP, ROW, TAKEN, REJECTED, INTERPOLATED, STUCK, WALK = range(8)
SHRINK, GROW = 1.0 / 3.0, 6.0  # least and largest quotient of a step and the one before
LEAST_RTOL = 100 * float(np.finfo(float).eps)  # as SciPy's
LEAST_SCALE = 2.0**-1022
SAFETY = 0.9
NEGLIGIBLE = 1e-16  # an error that lets the step grow as much as it may

A = tuple(map(floats, DOP853.a))
B = floats(DOP853.b)


@cache
def more() -> tuple[tuple[float, ...], tuple[float, ...], tuple[tuple[float, ...], ...], tuple[tuple[float, ...], ...]]:
    """The error estimates of orders 5 and 3, stages 13 to 16, and the weights d4 … d7 of the interpolant, from SciPy."""
    import scipy.integrate  # imported here, so that other methods that import this module need not wait for it

    program = scipy.integrate.DOP853
    ahead = tuple(tuple(row[: 13 + i].tolist()) for i, row in enumerate(program.A_EXTRA))
    return (
        tuple(program.E5[:12].tolist()),
        tuple(program.E3[:12].tolist()),
        (B, *ahead),
        tuple(map(tuple, program.D.tolist())),
    )


@unrolled
def nested(f, theta):
    total = f[7]
    for power, coefficients in enumerate(f[6::-1]):
        factor = 1.0 - theta if power % 2 else theta
        total = tuple(c + factor * v for c, v in zip(coefficients, total, strict=True))
    return total


@jit
def eighth_root(a):
    return math.sqrt(math.sqrt(math.sqrt(a)))


@cache
def kernels(system: System) -> tuple[Callable[..., Any], ...]:
    """For any system: trial, interpolant and value, which `compile_loop` takes, and first_step(s, end, c).

    Constants: RTOL, ATOL, the time at the start, parameters.
    """
    moving, n, numbers, (E5, E3, AHEAD, D) = system.moving, system.size, tuple_loader(system.parameters), more()

    def recorded(formula: Callable[..., Any], slopes: int = 0) -> Program:
        """`formula(follow, slopes, increment)` as a program of t, s, these, h and the parameters."""
        tape = Tape()
        t, s, *vectors = tape.input(), *([tape.input() for _ in range(n)] for _ in range(1 + slopes + bool(slopes)))
        h = tape.input()
        p = [tape.input() for _ in range(system.parameters)]
        follow = partial(stages, system, tape=tape, t=t, y=s, h=h, p=p)
        return tape.program([v for part in formula(follow, *vectors) for v in part])

    def minus(a: Any, b: Any) -> tuple[Any, ...]:
        return tuple(p - q for p, q in zip(a, b, strict=True))

    def attempt_of(follow: Any) -> Any:
        """Increment, both errors, and all twelve slopes."""
        slopes = follow(A)
        return weigh(B, slopes), weigh(E5, slopes), weigh(E3, slopes), *slopes

    def polynomial_of(follow: Any, *made: Any) -> Any:
        """Coefficients of the interpolant in its own nested form, without the state. made : twelve slopes and the increment."""
        *slopes, increment = made
        slopes = follow(AHEAD, slopes=slopes)
        bend = minus(slopes[0], increment)
        twist = minus(minus(increment, slopes[12]), bend)
        return bend, twist, *(weigh(d, slopes) for d in D)

    attempt_program, polynomial_program = recorded(attempt_of), recorded(polynomial_of, 12)
    slope = machine_code(system.rhs)

    def in_rows(flat: Any) -> Any:
        return tuple(flat[i : i + n] for i in range(0, len(flat), n))

    @unrolled
    def attempt(s, t, q, h):
        d, e, f, *slopes = in_rows(attempt_program(t, *s, h, *q))
        return d, e, f, tuple(slopes)

    @unrolled
    def polynomial(s, increment, t, q, h, slopes):
        made = (v for slope in slopes for v in slope)
        return s, increment, *in_rows(polynomial_program(t, *s, *made, *increment, h, *q))

    @unrolled
    def moved(s, h, d):
        """s + h d"""
        return tuple(a + h * b for a, b in zip(s, d, strict=True))

    difference = unrolled(minus)

    @jit
    def trial(s, t, h, c):
        d, e, f, slopes = attempt(s, c[START] + t, numbers(c, NUMBERS), h)
        new = moved(s, 1.0, d)
        fifth = third = 0.0
        for i in moving:
            r = 1.0 / max(c[ATOL] + c[RTOL] * max(abs(s[i]), abs(new[i])), LEAST_SCALE)
            p, q = e[i] * r, f[i] * r
            fifth += p * p
            third += q * q
        both = fifth + 0.01 * third
        error = fifth / math.sqrt(n * both) if both > 0.0 else both  # all components share it; or NaN
        growth = SAFETY / eighth_root(max(error, NEGLIGIBLE))
        return new, error, growth, (d, slopes)

    @jit
    def interpolant(s, new, t, h, c, made):
        d, slopes = made
        return polynomial(s, d, c[START] + t, numbers(c, NUMBERS), h, slopes)

    @jit
    def size(v, s, c):
        """The largest component, in units of its tolerance. A root mean square might overflow."""
        largest = 0.0
        for i in moving:
            largest = max(largest, abs(v[i]) / max(c[ATOL] + c[RTOL] * abs(s[i]), LEAST_SCALE))
        return largest

    @jit
    def first_step(s, end, c):
        """A step whose error should be a hundredth of the tolerance, from f and its change along an Euler step."""
        q = numbers(c, NUMBERS)
        f = slope((c[START],) + s, q)  # noqa: RUF005 - compiled code does not unpack
        d0, d1 = size(s, s, c), size(f, s, c)
        h = 0.01 * d0 / d1 if min(d0, d1) > 1e-5 else 1e-6
        h = math.copysign(min(h, abs(end)), end)
        if h != 0.0:
            g = slope((c[START] + h,) + moved(s, h, f), q)  # noqa: RUF005
            d2 = size(difference(g, f), s, c) / abs(h)
            steepest = max(d1, d2)
            best = eighth_root(0.01 / steepest) if steepest > 1e-15 else max(1e-6, 1e-3 * abs(h))
            h = math.copysign(min(100.0 * abs(h), best, abs(end)), end)
        return h if h != 0.0 else 1e-6 * end  # the control finds its step from anywhere

    return trial, interpolant, nested, first_step


@cache
def compile_loop(trial: Callable, interpolant: Callable, value: Callable, size: int) -> Callable:
    """The time loop of a kernel of `size` numbers that controls its own error: natural steps, and rows at the times of `grid`.

    `trial(s, t, h, c) -> (new, error, growth, slopes)`: a step with error ≤ 1 is taken, and the next is growth·h.
    `interpolant(s, new, t, h, c, slopes)` prepares what `value(interpolant, theta)` evaluates at t + theta h, 0 < theta < 1.
    """

    @jit
    def run(y, grid, most, c, walk, out):
        # Up to `most` natural steps towards the last time of `grid`. A step fills the rows of `out` whose times it passes. Every
        # h is the difference of two times, so that no rounding adds up.
        s = column(y, 0, size, 1)
        t, h, row, end = walk[TIME], walk[STEP], int(walk[ROW]), grid[-1]
        fresh = True  # not the repetition of a rejected step
        while row < len(grid) and (most > 0 or not fresh):
            most -= 1
            last = abs(1.01 * h) >= abs(end - t)  # no tiny step at the end
            ahead = end if last else t + h
            h = ahead - t
            if abs(h) <= 2.0**-50 * abs(t):
                walk[STUCK] = 1.0
                break
            new, error, growth, slopes = trial(s, t, h, c)
            if error <= 1.0:
                if abs(grid[row]) < abs(ahead):
                    walk[INTERPOLATED] += 1.0
                    f = interpolant(s, new, t, h, c, slopes)
                    while abs(grid[row]) < abs(ahead):
                        put_column(out, row * size, value(f, (grid[row] - t) / h), 1)
                        row += 1
                s, t = new, ahead
                if grid[row] == t:
                    put_column(out, row * size, s, 1)
                    row += 1
                walk[TAKEN] += 1.0
                h *= min(growth, GROW) if fresh else min(growth, 1.0)
                fresh = True
            else:
                walk[REJECTED] += 1.0
                h *= growth if SHRINK < growth < 1.0 else SHRINK  # SHRINK also if the error is not a number
                fresh = False
        walk[TIME], walk[STEP], walk[ROW] = t, h, row
        put_column(y, 0, s, 1)

    return run


def runner(top: Problem, *, rtol: float = 1e-9, atol: float = 1e-12) -> Run:
    """Natural steps with the local error below atol + rtol |y_i|, as a root mean square over the components."""
    rtol, atol = check_tolerances(rtol, atol)
    (*made, first_step), n = kernels(top.system), top.system.size
    c, loop = np.array((rtol, atol, top.start, *top.numbers)), compile_loop(*made, n)
    loop(np.zeros(n), np.zeros(1), 0, c, np.zeros(WALK), np.zeros((1, n)))  # compile
    first_step((0.0,) * n, 1.0, c)

    def run(y: Array, grid: Array, work: Work) -> Array:
        state, out, walk = y.copy(), np.empty((len(grid), n)), np.zeros(WALK)
        walk[STEP] = first_step(tuple(y.tolist()), float(grid[-1]), c)
        length = math.hypot(*y[-3:])  # a Casimir function
        while walk[ROW] < len(grid) and not walk[STUCK]:
            # without this check it may spin ever faster, in ever smaller steps
            if not 0.5 * length <= math.hypot(*state[-3:]) <= 2.0 * length:
                reason = (
                    f"rtol and atol do not hold this state: a length is off by a factor over 2 at t = {walk[TIME]:g}"
                )
                raise StepError("dop853", reason, step=int(walk[TAKEN]))
            loop(state, grid, INTERRUPTIBLE, c, walk, out)
        taken, rejected, interpolated = map(int, walk[[TAKEN, REJECTED, INTERPOLATED]])
        work.steps += taken
        work.rejected += rejected
        work.rhs_evals += 2 + 12 * (taken + rejected) + 4 * interpolated
        if walk[STUCK]:
            reason = f"the step fell below the spacing of doubles (t = {walk[TIME]:g})"
            raise StepError("dop853", reason, step=taken)
        return out

    return run


def check_tolerances(rtol: float, atol: float) -> tuple[float, float]:
    rtol, atol = check_real(rtol, "rtol"), check_real(atol, "atol")
    if not LEAST_RTOL <= rtol <= 1:
        raise ValueError(f"rtol must be between {LEAST_RTOL:.3g} (100 eps) and 1; got {rtol:g}")
    if atol < 0:
        raise ValueError(f"atol must not be negative; got {atol:g}")
    return rtol, atol


PREPARE, EVALUATE = dense("dop853", runner)
METHOD = Method(
    name="dop853",
    label="DOP853",
    family="runge-kutta",
    order=8,
    claims=Claims(conserves={"J3"}),
    control="tolerance",
    source="Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I (1993), II.5 and II.6; program DOP853",
    prepare=PREPARE,
    evaluate=EVALUATE,
    needs="rhs",
)
