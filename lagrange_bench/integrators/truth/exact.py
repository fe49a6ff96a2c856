"""The exact motion of a top in a uniform field or in a vertical tide. It judges every method.

It is a closed form in theta functions, for every alpha, k, |x| > 0, initial state and time. `truth.orbit` has the formulas for
alpha x3, and `truth.tide` those for alpha x3 + k x3²/2. mpmath computes their constants once for each (alpha, k, y0). No
method of the bench is used. The initial doubles are taken as they are; |x| is not normalised.

In doubles the error is below 4e-15 of `LagrangeTop.scales`, at t = 1e6 as at t = 1. For this, whole periods are first subtracted
from t, without rounding. The period is known to twice the precision of a double.
"""

from __future__ import annotations

import math
import random
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from mpmath import mp, mpf
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import check_count, check_state
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.truth import orbit as uniform
from lagrange_bench.integrators.truth import tide
from lagrange_bench.integrators.truth.orbit import Nutation, Orbit, Rotation
from lagrange_bench.support.precision import workdps

__all__ = ["after_steps", "nutation_period", "precession_per_nutation", "regime", "roots", "solution"]

Array = NDArray[np.float64]
Pieces = tuple[float, float, float]  # a number as a sum of three doubles; the first two have at most 27 bits

DIGITS = 40  # of the constants behind the doubles: periods to 105 bits, with a margin
MOST_DIGITS = 1000  # they take seconds; ten times as many would take minutes
MOST_PERIODS = 2.0**45  # up to here a double t resolves 1/256 of a period
RATIONAL = {"add", "sub", "mul", "div", "neg"}  # operations of rational functions
LONGEST = 2.0**900  # in units of the orbit; longer periods count as infinite


def solution(top: Any, y0: ArrayLike, t: Any, digits: int | None = None) -> NDArray[Any]:
    """States at times t of the motion that is at y0 at t = 0.

    The first call for a (top, y0) takes about 5 ms, in a tide 30 ms, and far more if the sizes in y0 differ enormously. Later
    calls take 0.3 ms and some μs for each time; with digits=30 some ms for each time. Source: `truth.orbit`, `truth.tide`.

    Parameters
    ----------
    top, y0 : a top with a closed form, see `vertical_field`, and a state (6,) with x ≠ 0. Their doubles are taken as exact.
    t : a time or a sequence (n,) of times, of any sign, in any order; with `digits` also mpmath numbers.
    digits : None for doubles, or the number of decimal digits, up to 1000.

    Returns
    -------
    (n, 6) for n times, (6,) for one. Without `digits`: doubles, with errors below 4e-15 of the scales of J and x at every t; in a
    tide, below 2e-14 if the state is closer to a separatrix than 1e-20 of the scales. With `digits`: mpmath.mpf in an object
    array, with errors below 10^-digits of the scales. The scales are `top.scales`, for J at least √|k| |x|.

    Raises
    ------
    ValueError : an argument is malformed, the state overflows, or, without `digits`, |t| exceeds 2^45 periods.
    """
    key = _key(top, y0)
    if digits is None:
        times = check_times(t)
        y = in_doubles(*prepared(*key), np.atleast_1d(times))
        return y[0] if times.ndim == 0 else y
    digits, times = check_digits(digits), check_times(t, exact=True)
    states = in_mpmath(*key, list(times.ravel()), digits)
    return np.array(states, dtype=object).reshape(*times.shape, 6)


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


def _key(top: Any, y0: ArrayLike) -> tuple[Fraction, Fraction, tuple[float, ...]]:
    """alpha, k and the state, by which orbits are cached. ValueError if there is no closed form."""
    known = vertical_field(top) if isinstance(top, Problem) else None
    if known is None:
        raise _refusal("a LagrangeTop, in a uniform field, or a top in alpha x3 + k x3²/2", top)
    return *known, tuple(check_state(y0).tolist())


def _refusal(wanted: str, top: Any) -> ValueError:
    attached = hasattr(top, "top") and not hasattr(top, "potential")
    advice = "take its .top" if attached else "a run's .error() compares it"
    return ValueError(f"top must be {wanted}; got a {type(top).__name__}: {advice}")


def _alpha_of(top: LagrangeTop) -> float:
    """The alpha of a single LagrangeTop; else ValueError."""
    if not kinds.uniform(top):
        raise _refusal("a LagrangeTop, in a uniform field", top)
    return top.require_single()


def after_steps(top: Any, y0: ArrayLike, h: float, counts: ArrayLike) -> Array:
    """States after `counts` steps of h: at the exact times n·h, not at the doubles next to them.

    Use this to judge methods that step by h. The double of n·h is rounded by up to half an ulp, which is 6e-11 at t = 10⁶: as
    much as the error of a good method there.

    Parameters
    ----------
    top, y0, h : as in `solution`; h any finite double.
    counts : whole numbers n (N,) up to 2^53.

    Returns
    -------
    (N, 6). ValueError as in `solution`.
    """
    n = np.asarray(counts)
    if n.ndim != 1 or n.dtype.kind not in "iu" or np.any(np.abs(n) > 2**53):
        raise ValueError("counts must be a sequence of whole numbers up to 2^53")
    times = check_times(h * n.astype(float))
    orbit, clock = prepared(*_key(top, y0))
    return in_doubles(orbit, clock, times, rounded_off(h, n.astype(float)))


def rounded_off(h: float, n: Array) -> Array:
    """The exact n·h minus its double. n and h are split into parts of at most 27 bits, so products are exact (Dekker, 1971)."""
    mantissa, exponent = math.frexp(h)
    first, (high, low) = round(mantissa * 2**26) / 2**26, halves(n)
    second = mantissa - first
    product = n * mantissa
    return np.ldexp(((high * first - product) + low * first + high * second) + low * second, exponent)


def nutation_period(top: LagrangeTop, y0: ArrayLike) -> float:
    """The time in which x3 goes from its minimum to its maximum and back. Relative error 1e-16.

    If x3 is constant, it is the period of small oscillations after a kick. It is inf for the unstable sleeping top, with
    J3² <= 4 alpha |x|, and on the separatrix. For alpha = 0 it is 2 pi/|J|, and inf at rest.
    """
    orbit = orbit_of(top, y0)
    return float(mp.ldexp(orbit.nutation_period, -orbit.rate))


def precession_per_nutation(top: LagrangeTop, y0: ArrayLike) -> float:
    """The angle (rad) about e3 by which the axis x turns in one `nutation_period`; nan if this is infinite.

    It is the whole angle, not reduced mod 2 pi: the time integral of the azimuth's rate, positive anticlockwise seen from above.
    y(t + nutation_period) is y(t), turned by this angle about e3. If x3 is constant, it is the rate of precession times the
    nutation period.

    The angle is continuous in the state, except if the orbit passes through a pole, |x3| = |x|. There the azimuth jumps by pi,
    and the limits from the two sides differ by 2 pi. On such orbits, and for the sleeping and the hanging top, the smaller limit
    is returned; of a pair ±pi the positive one. (No choice is continuous everywhere, because the top has monodromy: Cushman and
    Bates, Global Aspects of Classical Integrable Systems, chapter V.)
    """
    return float(orbit_of(top, y0).precession)


def regime(top: LagrangeTop, y0: ArrayLike) -> str:
    """The kind of motion, decided in exact arithmetic.

    "elliptic": x3 oscillates. "homoclinic": x3 rises to the unstable sleeping top in infinite time, forward and backward.
    "precession": x3 is constant and the axis turns about e3 (regular precession). "equilibrium": nothing moves (sleeping,
    hanging). "free": alpha = 0, J is constant.
    """
    return orbit_of(top, y0).regime


def roots(top: LagrangeTop, y0: ArrayLike) -> tuple[float, float, float]:
    """Roots e1 >= e2 >= e3 of f in x3'² = f(x3).

    f = (2H - J3² - 2 alpha x3)(C1 - x3²) - (C2 - J3 x3)². x3 moves between e3 and e2 if alpha >= 0, and between e2 and e1 if
    alpha < 0. The third root is never reached. It is inf for alpha = 0, and overflows to ±inf close to that.
    """
    orbit = orbit_of(top, y0)
    e1, e2, e3 = (float(mp.ldexp(e, orbit.size)) * orbit.sign for e in orbit.roots)
    return (e1, e2, e3) if orbit.sign > 0 else (e3, e2, e1)


# ---------------------------------------------------------------- constants, cached


@lru_cache(maxsize=1024)
def find(alpha: float | Fraction, y0: tuple[float, ...], digits: int, k: float | Fraction = 0) -> Orbit:
    return tide.find_orbit(alpha, k, y0, digits) if k else uniform.find_orbit(alpha, y0, digits)


def orbit_of(top: LagrangeTop, y0: ArrayLike) -> Orbit:
    return find(_alpha_of(top), tuple(check_state(y0).tolist()), DIGITS)


class Clock(NamedTuple):
    """Constants that split a time into n periods + r, and give the turn about e3 after n periods, with hardly any rounding."""

    period: Pieces
    t0: Pieces
    turns: Pieces  # per period, mod 1
    offset: float  # turns at n = 0
    around: Pieces  # period of an additional uniform turn about e3


NOTHING, NEVER = (0.0, 0.0, 0.0), (math.inf, 0.0, 0.0)


@lru_cache(maxsize=1024)
def prepared(alpha: Fraction, k: Fraction, y0: tuple[float, ...]) -> tuple[Orbit, Clock]:
    """The orbit with its constants rounded to doubles, and its clock."""
    orbit = find(alpha, y0, DIGITS, k)
    motion = orbit.motion
    with workdps(DIGITS + 15):
        t0 = turns = phase = mpf(0)
        around = NEVER
        if not isinstance(motion, Rotation):
            t0, phase = motion.t0, motion.phase / (2 * mp.pi)
        if isinstance(motion, tide.Tide) and abs(motion.turn) * LONGEST > 1:
            around = split(2 * mp.pi / motion.turn, 2 * mp.pi / motion.turn)
        if motion.period > LONGEST:
            period, unit = NEVER, t0
        else:
            period, unit = split(motion.period, motion.period), motion.period
            turns = motion.advance / (2 * mp.pi) if isinstance(motion, Nutation) else turns
        clock = Clock(period, split(t0, unit), split(turns - mp.nint(turns), mpf(1)), float(phase), around)
    return orbit._replace(motion=rounded(motion)), clock


def split(value: mpf, unit: mpf) -> Pieces:
    """`value` as a sum of multiples of 2^-26 and of 2^-52 of the binade of `unit`, and a rest; to 105 bits of `unit`."""
    exponent = mp.frexp(unit)[1]
    first = mp.ldexp(mp.nint(mp.ldexp(value, 26 - exponent)), exponent - 26)
    second = mp.ldexp(mp.nint(mp.ldexp(value - first, 52 - exponent)), exponent - 52)
    return float(first), float(second), float(value - first - second)


def rounded(value: Any) -> Any:
    """Constants rounded to float and complex."""
    if isinstance(value, tuple):
        parts = map(rounded, value)
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if isinstance(value, mp.mpc):
        return complex(value)
    return value if value is None else float(value)


# ---------------------------------------------------------------- evaluation


def in_doubles(orbit: Orbit, clock: Clock, times: Array, more: Array | float = 0.0) -> Array:
    """States (n, 6) at `times` + `more` (n,), with `more` below an ulp, from constants rounded to doubles."""
    motion, y = orbit.motion, np.empty((len(times), 6))
    with np.errstate(over="ignore", under="ignore"):
        n, r = reduced(clock, np.ldexp(times, orbit.rate))
        r = r + np.ldexp(more, orbit.rate)
        if isinstance(motion, Rotation):
            angle = motion.rate * r[:, None]
            y[:] = motion.centre + np.cos(angle) * motion.cosine + np.sin(angle) * motion.sine
        else:
            turn = np.exp(2j * np.pi * turned(clock, n))
            if isinstance(motion, tide.Tide):
                J, x, x3 = tide.position(motion, r, np)
                _, since = reduced(clock._replace(period=clock.around, t0=NOTHING), np.ldexp(times, orbit.rate))
                turn *= np.exp(1j * motion.turn * (since + np.ldexp(more, orbit.rate)))
            else:
                J, x, x3 = uniform.position(motion, r, np.exp)
            J, x = J * turn, x * turn
            y[:] = np.stack((J.real, J.imag, np.full(x3.shape, motion.J3), x.real, x.imag, x3), axis=-1)
        y[:, :3] = np.ldexp(y[:, :3], orbit.rate)
        y[:, 3:] = orbit.sign * np.ldexp(y[:, 3:], orbit.size)
    if not np.all(np.isfinite(y)):
        raise ValueError("the solution overflows: choose less extreme units of time and length")
    return y


def reduced(clock: Clock, t: Array) -> tuple[Array, Array]:
    """n and r with t - t0 = n period + r, |r| <= period/2 to within the rounding of n (1/64 of a period at worst).

    n and the period are split into parts of 26 bits (Dekker, 1971). So their products are exact, and the differences, too, while
    they cancel. The rest is rounded once or twice.
    """
    first, second, third = clock.period
    n = np.rint((t - clock.t0[0]) / sum(clock.period))
    if not np.all(np.isfinite(t) & (np.abs(n) <= MOST_PERIODS)):
        raise ValueError("t exceeds 2^45 periods of the motion, which doubles hardly resolve: pass digits=")
    if math.isinf(first):
        return n, (t - clock.t0[0]) - clock.t0[1] - clock.t0[2]
    high, low = halves(n)
    r = t - high * first - (low * first + clock.t0[0])
    r = r - high * second - (low * second + clock.t0[1])
    return n, r - (n * third + clock.t0[2])


def turned(clock: Clock, n: Array) -> Array:
    """Turns about e3 after n periods, in [-1/2, 1/2]. All products but the last are exact."""
    first, second, third = clock.turns
    high, low = halves(n)  # high * first is whole
    parts = fraction(low * first) + fraction(high * second) + low * second
    return fraction(fraction(parts) + n * third + clock.offset)


def halves(n: Array) -> tuple[Array, Array]:
    high = np.rint(n * 2.0**-26) * 2.0**26
    return high, n - high


def fraction(a: Array) -> Array:
    return np.asarray(a - np.rint(a))


def in_mpmath(alpha: Fraction, k: Fraction, y0: tuple[float, ...], times: list[Any], digits: int) -> list[list[mpf]]:
    """States at `times`, to `digits` digits."""
    with workdps(digits + 10):
        rate = find(alpha, y0, DIGITS, k).rate
        latest = max((abs(mp.ldexp(mpf(t), rate)) for t in times), default=mpf(0))
        guard = 10 + max(0, int(mp.log10(latest + 1)))  # periods and phases grow with t
    needed = -(-(digits + guard) // 16) * 16  # rounded up, so that cached orbits are used
    orbit = find(alpha, y0, needed, k)
    with workdps(needed + 15):
        states = [in_mpmath_at(orbit, mp.ldexp(mpf(t), rate)) for t in times]
    with workdps(digits):
        return [[+v for v in state] for state in states]


def in_mpmath_at(orbit: Orbit, t: mpf) -> list[mpf]:
    motion = orbit.motion
    if isinstance(motion, Rotation):
        cosine, sine = mp.cos_sin(motion.rate * t)
        parts = zip(motion.centre, motion.cosine, motion.sine, strict=True)
        y = [a + b * cosine + c * sine for a, b, c in parts]
    else:
        n = 0 if mp.isinf(motion.period) else mp.nint((t - motion.t0) / motion.period)
        r = t - motion.t0 - (n * motion.period if n else 0)
        if isinstance(motion, tide.Tide):
            (J, x, x3), angle = tide.position(motion, r, mp), motion.turn * t
        else:
            (J, x, x3), angle = uniform.position(motion, r, mp.exp), n * motion.advance if n else 0
        turn = mp.expj(motion.phase + angle)
        J, x = J * turn, x * turn
        y = [J.real, J.imag, motion.J3, x.real, x.imag, x3]
    return [mp.ldexp(v, orbit.rate) for v in y[:3]] + [orbit.sign * mp.ldexp(v, orbit.size) for v in y[3:]]


# ---------------------------------------------------------------- checks of arguments


def check_digits(digits: int) -> int:
    digits = check_count(digits, "digits", least=1)
    if digits > MOST_DIGITS:
        raise ValueError(f"digits must be at most {MOST_DIGITS}; got {digits}")
    return digits


def check_times(t: Any, exact: bool = False) -> NDArray[Any]:
    """`t` as an array with 0 or 1 axes, of doubles or, if `exact`, of mpf; else ValueError."""
    try:
        times = np.asarray(t)
        if times.ndim > 1 or (times.size and times.dtype.kind not in ("iufO" if exact else "iuf")):
            raise ValueError(f"got shape {times.shape}, dtype {times.dtype}")
        if not exact:
            times = times.astype(np.float64)
        else:
            exact_times = [v if isinstance(v, mpf) else mpf(v) for v in times.ravel().tolist()]  # mpf(v) would round v
            times = np.array(exact_times, dtype=object).reshape(times.shape)
    except (TypeError, ValueError) as error:
        raise ValueError(f"t must be a time or a sequence of times, real numbers: {error}") from None
    if not (all(map(mp.isfinite, times.flat)) if exact else np.all(np.isfinite(times))):
        raise ValueError(f"t must be finite; got {t!r}")
    return times
