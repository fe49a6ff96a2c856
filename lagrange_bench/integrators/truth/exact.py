"""The exact motion of a top in a uniform field or in a vertical tide, and of free and symmetric bodies. It judges every method.

It is a closed form, for every alpha, k, |x| > 0, initial state and time: doublings on an elliptic curve, in ball arithmetic, see
`truth.curve`. No method of the bench is used. The initial doubles are taken as they are; |x| is not normalised.

States with `digits`, and doubles at up to 30 times, are *proven*: each is rounded from a ball that contains the true motion. At
more times doubles come from a table of proven states (`truth.table`), and are *tested* to 5e-16 of the scales, at t = 1e6 as at
t = 1. For this, whole periods are first subtracted from t, without rounding.
"""

from __future__ import annotations

import math
import random
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import Array, check_state
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.truth import free_body, states, symmetric_body
from lagrange_bench.integrators.truth.curve import rational
from lagrange_bench.integrators.truth.states import Enclosure
from lagrange_bench.integrators.truth.table import rounded_off
from lagrange_bench.integrators.truth.top import Top

__all__ = [
    "Enclosure",
    "after_steps",
    "enclosure",
    "nutation_period",
    "precession_per_nutation",
    "regime",
    "roots",
    "solution",
]

RATIONAL = {"add", "sub", "mul", "div", "neg"}  # operations of rational functions


def solution(top: Any, y0: ArrayLike, t: Any, digits: int | None = None) -> NDArray[Any]:
    """States at times t of the motion that is at y0 at t = 0.

    A time takes about 1 ms, with digits=1000 some 10 ms. More than 30 times take 5 to 20 ms in all, and 1 μs each. Source:
    `truth.curve`, `truth.top`.

    Parameters
    ----------
    top, y0 : a top with a closed form, see `vertical_field`, and a state (6,) with x ≠ 0. Their doubles are taken as exact.
    t : a time or a sequence (n,) of times, of any sign, in any order; with `digits` also mpmath numbers.
    digits : None for doubles, or the number of decimal digits, up to 1000.

    Returns
    -------
    (n, 6) for n times, (6,) for one. With `digits`: mpmath.mpf in an object array, proven to 10^-digits of the scales. Without:
    doubles, for up to 30 times proven to 1e-17 of the scales and rounded once; else tested to 5e-16 of the scales at every t. The
    scales are `top.scales`, for J at least √|k| |x|.

    Raises
    ------
    ValueError : an argument is malformed, the state overflows, or, without `digits`, doubles do not resolve the motion so late.
    """
    return states.solution(_motion(top, y0), t, digits)


def enclosure(problem: Any, y0: ArrayLike, t: Any, digits: int = 17) -> Enclosure:
    """Intervals that contain the states at times t of the motion that is at y0 at t = 0: proven error bounds.

    Parameters
    ----------
    problem, y0 : a top with a closed form, see `solution`, or a free or symmetric RigidBody, and a state (6,) or (7,).
    t : a time or a sequence (N,) of times; doubles or mpmath numbers.
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
    if kinds.free_body(problem):
        followed: Top = free_body.motion_of(problem, y0)
    elif kinds.symmetric_body(problem):
        followed = symmetric_body.motion_of(problem, y0)
    elif kinds.rigid_body(problem):
        raise ValueError(f"{problem}: a heavy body that is not symmetric has no closed form")
    else:
        followed = _motion(problem, y0)
    return states.enclosure(followed, states.check_times(t, exact=True), states.check_digits(digits))


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


def _motion(top: Any, y0: ArrayLike) -> Top:
    """The motion of a top. ValueError if there is no closed form."""
    known = vertical_field(top) if isinstance(top, Problem) else None
    if known is None:
        raise _refusal("a LagrangeTop, in a uniform field, or a top in alpha x3 + k x3²/2", top)
    return motion(*known, tuple(check_state(y0).tolist()))


@lru_cache(maxsize=1024)
def motion(alpha: Fraction, k: Fraction, y0: tuple[float, ...]) -> Top:
    numbers = [rational(v) for v in y0]
    return Top(rational(alpha), rational(k), numbers[:3], numbers[3:])


def _refusal(wanted: str, top: Any) -> ValueError:
    attached = hasattr(top, "top") and not hasattr(top, "potential")
    advice = "take its .top" if attached else "a run's .error() compares it"
    return ValueError(f"top must be {wanted}; got a {type(top).__name__}: {advice}")


def _in_uniform_field(top: LagrangeTop, y0: ArrayLike) -> Top:
    """The motion of a single LagrangeTop; else ValueError."""
    if not kinds.uniform(top):
        raise _refusal("a LagrangeTop, in a uniform field", top)
    return motion(Fraction(top.require_single()), Fraction(0), tuple(check_state(y0).tolist()))


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
    times = states.check_times(h * n.astype(float))
    return states.in_doubles(_motion(top, y0), times, rounded_off(h, n.astype(float)))


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
    and the limits from the two sides differ by 2 pi. On such orbits, and for the sleeping and the hanging top, the smaller limit
    is returned; of a pair ±pi the positive one. (No choice is continuous everywhere, because the top has monodromy: Cushman and
    Bates, Global Aspects of Classical Integrable Systems, chapter V.)
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


def roots(top: LagrangeTop, y0: ArrayLike) -> tuple[float, float, float]:
    """Roots e1 >= e2 >= e3 of f in x3'² = f(x3).

    f = (2H - J3² - 2 alpha x3)(C1 - x3²) - (C2 - J3 x3)². x3 moves between e3 and e2 if alpha >= 0, and between e2 and e1 if
    alpha < 0. The third root is never reached. It is inf for alpha = 0, and overflows to ±inf close to that.
    """
    found = _in_uniform_field(top, y0).real_roots()
    e1, e2, e3 = sorted([*found, *[math.inf] * (3 - len(found))], reverse=True)
    return e1, e2, e3
