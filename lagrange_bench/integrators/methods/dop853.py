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
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import check_real
from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import Program, machine_code, tuple_loader
from lagrange_bench.integrators.compiling.intrinsics import column, put_column
from lagrange_bench.integrators.compiling.loops import INTERRUPTIBLE
from lagrange_bench.integrators.compiling.tape import Tape, Term
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Work
from lagrange_bench.integrators.methods.dense import Run, dense
from lagrange_bench.integrators.methods.runge_kutta import Weights, floats, stages, weigh
from lagrange_bench.integrators.methods.tableaux import DOP853
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System

RTOL, ATOL, START, NUMBERS = range(4)  # places of the constants; START is the time at the start
# Places in `walk`: the state of a run on natural steps, so that it can be resumed, and its work. WALK is their number.
TIME, STEP, ROW, ACCEPTED, REJECTED, INTERPOLATED, STUCK, WALK = range(8)
SHRINK = 1.0 / 3.0  # least quotient of a step and the one before
GROW = 6.0  # largest quotient
LEAST_RTOL = 100 * float(np.finfo(float).eps)  # as SciPy's
LEAST_SCALE = 2.0**-1022  # of a component: its tolerance may be 0
SAFETY = 0.9  # factor of the step that the error estimate allows
NEGLIGIBLE = 1e-16  # an error that lets the step grow as much as it may

A = tuple(map(floats, DOP853.a))
B = floats(DOP853.b)


@cache
def extra_coefficients() -> tuple[Weights, Weights, tuple[Weights, ...], tuple[Weights, ...]]:
    """The error estimates of orders 5 and 3, stages 13 to 16, and the weights d4 … d7 of the interpolant, from SciPy."""
    import scipy.integrate  # imported here, so that other methods that import this module need not wait for it

    program = scipy.integrate.DOP853
    extra_stages = tuple(tuple(row[: 13 + i].tolist()) for i, row in enumerate(program.A_EXTRA))
    E5, E3 = (tuple(row[:12].tolist()) for row in (program.E5, program.E3))
    return E5, E3, (B, *extra_stages), tuple(map(tuple, program.D.tolist()))


@unrolled
def evaluate_nested(f, theta):
    total = f[7]
    for power, coefficients in enumerate(f[6::-1]):
        factor = 1.0 - theta if power % 2 else theta
        total = tuple(c + factor * v for c, v in zip(coefficients, total, strict=True))
    return total


@jit
def eighth_root(a):
    return math.sqrt(math.sqrt(math.sqrt(a)))


@cache
def kernels(system: System) -> tuple[Compiled, ...]:
    """For any system: trial, interpolant and value, which `compile_loop` takes, and first_step(s, end, c).

    Constants: RTOL, ATOL, the time at the start, parameters.
    """
    moving, n, numbers = system.moving, system.size, tuple_loader(system.parameters)
    E5, E3, EXTRA_STAGES, D = extra_coefficients()

    def record(formula: Callable[..., Any], slopes: int = 0) -> Program:
        """`formula(follow, *slopes, increment)` as a program of t, s, slopes, increment, h and the parameters."""
        tape = Tape()
        t, s, *vectors = tape.input(), *([tape.input() for _ in range(n)] for _ in range(1 + slopes + bool(slopes)))
        h = tape.input()
        p = [tape.input() for _ in range(system.parameters)]
        follow = partial(stages, system, tape=tape, t=t, y=s, h=h, p=p)
        return tape.program([v for part in formula(follow, *vectors) for v in part])

    def minus(a: Sequence[Any], b: Sequence[Any]) -> tuple[Any, ...]:
        return tuple(p - q for p, q in zip(a, b, strict=True))

    def attempt_of(follow: Callable[..., Any]) -> tuple[Any, ...]:
        """The increment, both errors, and all twelve slopes."""
        slopes = follow(A)
        return weigh(B, slopes), weigh(E5, slopes), weigh(E3, slopes), *slopes

    def polynomial_of(follow: Callable[..., Any], *slopes_and_increment: list[Term]) -> tuple[Any, ...]:
        """Coefficients of the interpolant in its own nested form, without the state."""
        *slopes, increment = slopes_and_increment
        slopes = follow(EXTRA_STAGES, slopes=slopes)
        bend = minus(slopes[0], increment)
        twist = minus(minus(increment, slopes[12]), bend)
        return bend, twist, *(weigh(d, slopes) for d in D)

    attempt_program, polynomial_program = record(attempt_of), record(polynomial_of, 12)
    slope = machine_code(system.rhs)

    def in_rows(flat: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(flat[i : i + n] for i in range(0, len(flat), n))

    @unrolled
    def attempt(s, t, q, h):
        d, e, f, *slopes = in_rows(attempt_program(t, *s, h, *q))
        return d, e, f, tuple(slopes)

    @unrolled
    def polynomial(s, increment, t, q, h, slopes):
        flat_slopes = (v for slope in slopes for v in slope)
        return s, increment, *in_rows(polynomial_program(t, *s, *flat_slopes, *increment, h, *q))

    @unrolled
    def shift(s, h, d):
        """s + h d."""
        return tuple(a + h * b for a, b in zip(s, d, strict=True))

    difference = unrolled(minus)

    @jit
    def trial(s, t, h, c):
        d, e, f, slopes = attempt(s, c[START] + t, numbers(c, NUMBERS), h)
        new = shift(s, 1.0, d)
        fifth = third = 0.0
        for i in moving:
            r = 1.0 / max(c[ATOL] + c[RTOL] * max(abs(s[i]), abs(new[i])), LEAST_SCALE)
            p, q = e[i] * r, f[i] * r
            fifth += p * p
            third += q * q
        square = fifth + 0.01 * third
        error = fifth / math.sqrt(n * square) if square > 0.0 else square  # all components share it; or NaN
        growth = SAFETY / eighth_root(max(error, NEGLIGIBLE))
        return new, error, growth, (d, slopes)

    @jit
    def interpolant(s, new, t, h, c, increment_and_slopes):
        d, slopes = increment_and_slopes
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
        f = slope((c[START], *s), q)
        d0, d1 = size(s, s, c), size(f, s, c)
        h = 0.01 * d0 / d1 if min(d0, d1) > 1e-5 else 1e-6
        h = math.copysign(min(h, abs(end)), end)
        if h != 0.0:
            g = slope((c[START] + h, *shift(s, h, f)), q)
            d2 = size(difference(g, f), s, c) / abs(h)
            steepest = max(d1, d2)
            best = eighth_root(0.01 / steepest) if steepest > 1e-15 else max(1e-6, 1e-3 * abs(h))
            h = math.copysign(min(100.0 * abs(h), best, abs(end)), end)
        return h if h != 0.0 else 1e-6 * end  # the control finds its step from anywhere

    return trial, interpolant, evaluate_nested, first_step


@cache
def compile_loop(trial: Compiled, interpolant: Compiled, value: Compiled, size: int) -> Compiled:
    """The time loop of a kernel of `size` numbers that controls its own error: natural steps, and rows at the times of `grid`.

    `trial(s, t, h, c) -> (new, error, growth, slopes)`: a step with error ≤ 1 is accepted, and the next is growth·h.
    `interpolant(s, new, t, h, c, slopes)` prepares what `value(interpolant, theta)` evaluates at t + theta h, 0 < theta < 1.
    """

    @jit
    def run(y, grid, budget, c, walk, out):
        # At most `budget` natural steps towards the last time of `grid`. A step fills the rows of `out` whose times it passes.
        # Every h is the difference of two times, so that no rounding adds up.
        s = column(y, 0, size, 1)
        t, h, row, end = walk[TIME], walk[STEP], int(walk[ROW]), grid[-1]
        is_fresh = True  # not the repetition of a rejected step
        while row < len(grid) and (budget > 0 or not is_fresh):
            budget -= 1
            is_last = abs(1.01 * h) >= abs(end - t)  # no tiny step at the end
            new_t = end if is_last else t + h
            h = new_t - t
            if abs(h) <= 2.0**-50 * abs(t):
                walk[STUCK] = 1.0
                break
            new, error, growth, slopes = trial(s, t, h, c)
            if error <= 1.0:
                if abs(grid[row]) < abs(new_t):
                    walk[INTERPOLATED] += 1.0
                    f = interpolant(s, new, t, h, c, slopes)
                    while abs(grid[row]) < abs(new_t):
                        put_column(out, row * size, value(f, (grid[row] - t) / h), 1)
                        row += 1
                s, t = new, new_t
                if grid[row] == t:
                    put_column(out, row * size, s, 1)
                    row += 1
                walk[ACCEPTED] += 1.0
                h *= min(growth, GROW) if is_fresh else min(growth, 1.0)
                is_fresh = True
            else:
                walk[REJECTED] += 1.0
                h *= growth if SHRINK < growth < 1.0 else SHRINK  # SHRINK also if the error is not a number
                is_fresh = False
        walk[TIME], walk[STEP], walk[ROW] = t, h, row
        put_column(y, 0, s, 1)

    return run


def runner(top: Problem, *, rtol: float = 1e-9, atol: float = 1e-12) -> Run:
    """Natural steps with the local error below atol + rtol |y_i|, as a root mean square over the components."""
    rtol, atol = check_tolerances(rtol, atol)
    (*loop_parts, first_step), n = kernels(top.system), top.system.size
    c, loop = np.array((rtol, atol, top.start, *top.numbers)), compile_loop(*loop_parts, n)
    loop(np.zeros(n), np.zeros(1), 0, c, np.zeros(WALK), np.zeros((1, n)))  # compile
    first_step((0.0,) * n, 1.0, c)

    def run(y: Array, grid: Array, work: Work) -> Array:
        state, out, walk = y.copy(), np.empty((len(grid), n)), np.zeros(WALK)
        walk[STEP] = first_step(tuple(y.tolist()), float(grid[-1]), c)
        length = math.hypot(*y[-3:])  # a Casimir function
        while walk[ROW] < len(grid) and not walk[STUCK]:
            # without this check the state may spin ever faster, in ever smaller steps
            if not 0.5 * length <= math.hypot(*state[-3:]) <= 2.0 * length:
                reason = (
                    f"rtol and atol do not hold this state: a length is off by a factor over 2 at t = {walk[TIME]:g}"
                )
                raise StepError("dop853", reason, step=int(walk[ACCEPTED]))
            loop(state, grid, INTERRUPTIBLE, c, walk, out)
        steps, rejections, interpolations = map(int, walk[[ACCEPTED, REJECTED, INTERPOLATED]])
        work.steps += steps
        work.rejected += rejections
        work.rhs_evals += 2 + 12 * (steps + rejections) + 4 * interpolations
        if walk[STUCK]:
            reason = f"the step fell below the spacing of doubles (t = {walk[TIME]:g})"
            raise StepError("dop853", reason, step=steps)
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
