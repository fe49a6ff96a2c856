"""The exact motion of a top in a uniform field or in a vertical tide, and of free and symmetric bodies. It judges every method.

It is a closed form: doublings on an elliptic curve, in ball arithmetic, see `truth.curve`. No method of the bench is used. The
initial doubles are taken as they are; |x| is not normalised.

States with `digits`, and doubles at up to 30 times, are *proven*: each is rounded from a ball that contains the true motion. At
more times doubles come from a table of proven states (`truth.table`), and are *tested* to 5e-16 of the scales, at t = 1e6 as at
t = 1. For this, whole periods are first subtracted from t, without rounding.

On the separatrix all bits of a double are lost at late times. There states in doubles come from the table, too, and digits are
known until some 10,000 units of time.
"""

from __future__ import annotations

import random
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from flint import arb, fmpq
from mpmath import mp, mpf
from mpmath.libmp import from_man_exp
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import Array, check_count, check_state, check_times
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.truth.curve import FIRST_BITS, LOST, certified, rational
from lagrange_bench.integrators.truth.free_body import FreeBody
from lagrange_bench.integrators.truth.symmetric_body import SymmetricBody
from lagrange_bench.integrators.truth.table import LATE, TOO_LATE, Table, has_table, rounded_off
from lagrange_bench.integrators.truth.top import Top
from lagrange_bench.support.precision import workdps

__all__ = [
    "Enclosure",
    "after_steps",
    "enclosure",
    "nutation_period",
    "precession_per_nutation",
    "regime",
    "solution",
]

RATIONAL = {"add", "sub", "mul", "div", "neg"}  # operations of rational functions
FEW = 30  # times that are computed one by one; a table takes as long as these
PROVEN = fmpq(1, 10**17)  # radii of states that are rounded to doubles, relative to the scales
LATEST = 2**48  # times 1/rate; later, doubles differ by 1/32 of it and more
MOST_DIGITS = 1000  # they take a tenth of a second for each time


class Enclosure(NamedTuple):
    """Midpoints and radii, object arrays of mpf: each component of the true state is within its radius of its midpoint."""

    midpoints: NDArray[Any]
    radii: NDArray[Any]


def solution(problem: Any, y0: ArrayLike, t: Any, digits: int | None = None) -> NDArray[Any]:
    """States at times t of the motion that is at y0 at t = 0.

    A time takes about 1 ms, with digits=1000 some 10 ms. More than 30 times take 5 to 20 ms in all, and 3 μs each. Source:
    `truth.curve`, `truth.top`, `truth.free_body`, `truth.symmetric_body`.

    Parameters
    ----------
    problem, y0 : a top with a closed form, see `vertical_field`, and a state (6,) with x ≠ 0; or a free or symmetric RigidBody
        and a state (7,). Their doubles are taken as exact.
    t : a time or a sequence (N,) of times, of any sign, in any order; with `digits` also mpmath numbers.
    digits : None for doubles, or the number of decimal digits, up to 1000.

    Returns
    -------
    (N, n) for N times, (n,) for one; of a body (q, L), with q or −q, which are the same rotation. With `digits`: mpmath.mpf in
    an object array, proven to 10^-digits of the scales. Without: doubles, for up to 30 times proven to 1e-17 of the scales and
    rounded once; else tested at every t, to 5e-16 of the scales, of a free body to 2e-15, of a symmetric one to 1e-14. The
    scales are `problem.scales`, for J at least √|k| |x|; of a body |q| and |L|, of a symmetric one at least those of its weight.

    Raises
    ------
    ValueError
        There is no closed form, an argument is malformed, or the state overflows; without `digits`, doubles do not resolve the
        motion so late; with them, the separatrix loses too many bits.
    """
    motion = motion_of(problem, y0)
    if digits is None:
        times = check_times(t, single=True)
        states = in_doubles(motion, np.atleast_1d(times), np.zeros(times.size))
    else:
        times, digits = exact_times(t), check_digits(digits)
        mids = enclosed(motion, times, digits + 1).midpoints
        with workdps(digits + 3):
            states = +np.atleast_2d(mids)
    return states.reshape(*times.shape, states.shape[-1])


def enclosure(problem: Any, y0: ArrayLike, t: Any, digits: int = 17) -> Enclosure:
    """Intervals that contain the states at times t of the motion that is at y0 at t = 0: proven error bounds.

    Parameters
    ----------
    problem, y0, t : as in `solution` with digits.
    digits : radii are below 10^-digits of the scales of the motion.

    Returns
    -------
    Enclosure
        `midpoints` and `radii`, each (N, n), for one time (n,), of mpmath.mpf. The true state of exactly these doubles lies
        within the radii of the midpoints; of a body it is (q, L), where −q would be the same rotation.

    Raises
    ------
    ValueError
        There is no closed form, or an argument is malformed.
    """
    return enclosed(motion_of(problem, y0), exact_times(t), check_digits(digits))


def after_steps(problem: Any, y0: ArrayLike, h: float, counts: ArrayLike) -> Array:
    """States after `counts` steps of h: at the exact times n·h, not at the doubles next to them.

    Use this to judge methods that step by h. The double of n·h is rounded by up to half an ulp, which is 6e-11 at t = 10⁶: as
    much as the error of a good method there.

    Parameters
    ----------
    problem, y0, h : as in `solution`; h any finite double.
    counts : whole numbers n (N,) up to 2^53.

    Returns
    -------
    (N, n). ValueError as in `solution`.
    """
    n = np.asarray(counts)
    if n.ndim != 1 or n.dtype.kind not in "iu" or np.any(np.abs(n) > 2**53):
        raise ValueError("counts must be a sequence of whole numbers up to 2^53")
    n = n.astype(float)
    return in_doubles(motion_of(problem, y0), check_times(h * n), rounded_off(h, n))


# ---------------------------------------------------------------- motions with a closed form


def motion_of(problem: Any, y0: ArrayLike) -> Top:
    """The motion of a top or a body. ValueError if there is no closed form."""
    if kinds.rigid_body(problem):
        y, moments = problem.check_state(y0).tolist(), problem.inertia.tolist()
        if problem.is_free:
            return motion(FreeBody, *moments, *y)
        if problem.symmetry is None:
            raise ValueError(f"{problem}: a heavy body that is not symmetric has no closed form")
        along = moments[problem.symmetry]
        return motion(SymmetricBody, problem.across, along, *problem.weight.tolist(), *problem.up.tolist(), *y)
    known = vertical_field(problem) if isinstance(problem, Problem) else None
    if known is None:
        raise _refusal("a LagrangeTop, in a uniform field, or a top in alpha x3 + k x3²/2", problem)
    return motion(Top, *known, *check_state(y0).tolist())


@lru_cache(maxsize=1024)
def motion(kind: type[Top], *numbers: float | Fraction) -> Top:
    """The motion of exactly these numbers."""
    return kind(*map(rational, numbers))


@lru_cache(maxsize=256)
def vertical_field(problem: Any) -> tuple[Fraction, Fraction] | None:
    """alpha and k if the energy is |J|²/2 + alpha x3 + k x3²/2, up to a multiple of |x|² and a constant; else None.

    The formula is evaluated in rational numbers at five places. Four give the coefficients; the fifth has random integers, and
    shows whether the formula is this function.
    """
    if not kinds.top(problem):
        return None
    if kinds.uniform(problem):
        return Fraction(problem.require_single()), Fraction(0)
    U = problem.system.potential
    if not {operation for operation, *_ in U.lines} <= RATIONAL:
        return None
    energy, numbers = U.python(Fraction), [Fraction(v) for v in (problem.start, *problem.numbers)]
    draw = random.Random("a place")
    places = (0, 0, 0), (0, 0, 1), (0, 0, -1), (1, 0, 0), [draw.getrandbits(64) for _ in range(3)]
    try:
        base, up, down, aside, elsewhere = (energy(*map(Fraction, x), *numbers)[0] for x in places)
    except ZeroDivisionError:
        return None
    alpha, c, (x1, x2, x3) = (up - down) / 2, aside - base, places[-1]
    k = up + down - 2 * aside
    same = elsewhere == base + alpha * x3 + k * x3**2 / 2 + c * (x1**2 + x2**2 + x3**2)
    return (alpha, k) if same else None


def _refusal(wanted: str, top: Any) -> ValueError:
    attached = hasattr(top, "top") and not hasattr(top, "potential")
    advice = "take its .top" if attached else "a run's .error() compares it"
    return ValueError(f"top must be {wanted}; got a {type(top).__name__}: {advice}")


# ---------------------------------------------------------------- states


def in_doubles(motion: Top, times: Array, remainders: Array) -> Array:
    """States (N, n) at `times` + `remainders` (N,), with `remainders` below an ulp."""
    extremes = [abs(rational(t)) for t in (times.min(), times.max())] if len(times) else [fmpq(0)]
    if motion.node is not None:
        by_table = len(times) > FEW or float(max(extremes)) * motion.node.speed > LATE
    else:
        if not motion.steady and max(extremes) * motion.rate > LATEST:
            raise ValueError(TOO_LATE)
        by_table = len(times) > FEW and has_table(motion)
    if by_table:
        states = table(motion)(times, remainders)
    else:
        whens = [rational(t) + rational(rest) for t, rest in zip(times.tolist(), remainders.tolist(), strict=True)]
        rows = [[float(v) for v in proven(motion, t, PROVEN)] for t in whens]
        states = np.array(rows).reshape(len(times), len(motion.radii(PROVEN)))
    if not np.all(np.isfinite(states)):
        raise ValueError("the solution overflows: choose less extreme units of time and length")
    return states


@lru_cache(maxsize=64)
def table(motion: Top) -> Table:
    return Table(motion)


def enclosed(motion: Top, times: NDArray[Any], digits: int) -> Enclosure:
    """Balls (…, n) at `times`, with radii below 10^-digits of the scales."""
    balls = [proven(motion, rational(t), fmpq(1, 10**digits)) for t in times.ravel()]
    shape = *times.shape, len(motion.radii(PROVEN))
    mids, radii = ([[as_mpf(part(v)) for v in row] for row in balls] for part in (arb.mid, arb.rad))
    return Enclosure(*(np.array(rows, dtype=object).reshape(shape) for rows in (mids, radii)))


def proven(motion: Top, t: fmpq, tolerance: fmpq) -> list[arb]:
    """The state at a time, with radii below `tolerance` of the scales."""
    doublings = max(0, int(abs(t) * motion.rate).bit_length())
    bits = FIRST_BITS + int(tolerance.q).bit_length() + LOST * doublings
    return certified(lambda: motion.at(t), motion.radii(tolerance), bits)


def as_mpf(v: arb) -> mpf:
    """An exact number."""
    return mp.make_mpf(from_man_exp(*map(int, v.man_exp())))


def check_digits(digits: int) -> int:
    digits = check_count(digits, "digits", least=1)
    if digits > MOST_DIGITS:
        raise ValueError(f"digits must be at most {MOST_DIGITS}; got {digits}")
    return digits


def exact_times(t: Any) -> NDArray[Any]:
    """`t`, a time or a sequence of times, as an array of finite mpf without rounding; else ValueError."""
    try:
        objects = np.asarray(t, dtype=object)
        times = np.array(
            [v if isinstance(v, mpf) else mpf(v) for v in objects.ravel()], dtype=object
        )  # mpf(v) would round v
    except (TypeError, ValueError) as error:
        raise ValueError(f"t must be a time or a sequence of times, real numbers: {error}") from None
    if objects.ndim > 1 or not all(map(mp.isfinite, times)):
        raise ValueError(f"t must be a time or a sequence of finite times; got {t!r}")
    return times.reshape(objects.shape)


# ---------------------------------------------------------------- what kind of motion it is


def _in_uniform_field(top: LagrangeTop, y0: ArrayLike) -> Top:
    """The motion of a single LagrangeTop; else ValueError."""
    if not kinds.uniform(top):
        raise _refusal("a LagrangeTop, in a uniform field", top)
    return motion_of(top, y0)


def nutation_period(top: LagrangeTop, y0: ArrayLike) -> float:
    """The time in which x3 goes from its minimum to its maximum and back. Proven; relative error 1e-16.

    If x3 is constant, it is the period of small oscillations after a kick. It is inf for the unstable sleeping top, with
    J3² <= 4 alpha |x|, and on the separatrix. For alpha = 0 it is 2 pi/|J|, and inf at rest.
    """
    return _in_uniform_field(top, y0).nutation()[0]


def precession_per_nutation(top: LagrangeTop, y0: ArrayLike) -> float:
    """The angle (rad) about e3 by which the axis x turns in one `nutation_period`; nan if this is infinite.

    It is the whole angle, not reduced mod 2 pi: the time integral of the azimuth's rate, positive anticlockwise seen from above.
    y(t + nutation_period) is y(t), turned by this angle about e3. If x3 is constant, it is the rate of precession times the
    nutation period.

    The angle is continuous in the state, except if the orbit passes through a pole, |x3| = |x|. There the azimuth jumps by pi,
    and the limits from the two sides differ by 2 pi. On such orbits, and for the sleeping and the hanging top, the mean of the
    limits is returned: the angle without the jump. (No choice is continuous everywhere, because the top has monodromy: Cushman
    and Bates, Global Aspects of Classical Integrable Systems, chapter V.)
    """
    return _in_uniform_field(top, y0).nutation()[1]


def regime(top: LagrangeTop, y0: ArrayLike) -> str:
    """The kind of motion, decided in exact arithmetic.

    "elliptic": x3 oscillates. "homoclinic": x3 rises to the unstable sleeping top in infinite time, forward and backward.
    "precession": x3 is constant and the axis turns about e3 (regular precession). "equilibrium": nothing moves (sleeping,
    hanging). "free": alpha = 0, J is constant.
    """
    m = _in_uniform_field(top, y0)
    if m.alpha == 0:
        return "free"
    if m.steady:
        return "precession" if m.turn_rate() else "equilibrium"
    return "homoclinic" if m.node is not None else "elliptic"
