"""Problems and tops by name that have no entry in NAMED_TOPS: four problems, and tops that a generator draws.

Drawn tops, such as "random000", are the same on every machine: Python's own generator draws them, and its `random()` never
changes. They have alpha in [0.3, 2], each J in [-2, 2] and |x| in [0.5, 2]. "wide", "released" and "spinning" tops have either
sign of alpha. For "wide" tops |J|²/(|alpha||x|) is from 1e-3 to 1e3. "released" and "spinning" tops have J parallel or
antiparallel to x, and |J|²/(|alpha||x|) from 1e-3 to 100 and from 100 to 1e3. For "close" tops J misses the separatrix by a
part of 1e-1 to 1e-8.
"""

import math
import random
import re
from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.problem.kirchhoff import kirchhoff_body
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.vibrating_pivot import vibrating_pivot

PROBLEMS = ("free_body", "vibrating_pivot", "kirchhoff_body", "central_spin")
DRAWN = ("random", "wide", "released", "spinning", "close")  # kinds of drawn tops: any three digits follow
SPINS = {"wide": (-3, 3), "released": (-3, 2), "spinning": (2, 3)}  # least and largest log10 of |J|²/(|alpha||x|)


def is_drawn(name: str) -> bool:
    """Whether this is the name of a drawn top."""
    return re.fullmatch(rf"({'|'.join(DRAWN)})\d{{3}}", name) is not None


@cache
def problem(name: str) -> tuple[Any, Array]:
    """The problem and the initial state of a name in PROBLEMS."""
    if name == "free_body":
        return Problem("free_body", "so3", free_body, (1.0, 2.0, 3.0), frame="body"), np.array([0.3, -0.4, 1.2])
    if name == "vibrating_pivot":
        return vibrating_pivot(1.0, 0.5, 2.0), np.array([0.3, -0.2, 0.8, 0.6, 0.0, 0.8])
    if name == "kirchhoff_body":
        body = kirchhoff_body((1.0, 0.7, 0.4), (0.1, 0.2, -0.1), (0.5, 0.6, 0.9))
        return body, np.array([0.3, -0.2, 0.8, 0.6, 0.0, 0.8])
    spins = np.array([(0.6, 0.0, 0.8), (0.0, 1.0, 0.0), (0.8, 0.6, 0.0), (-0.48, 0.64, 0.6)])
    return Problem("central_spin", 4, central_spin, (0.8, 0.5, 0.3)), spins.ravel()


def free_body(t: Any, y: Any, p: Any) -> Any:
    """Euler's free body: H of the angular momentum in its frame, with moments of inertia p."""
    return (y[0] * y[0] / p[0] + y[1] * y[1] / p[1] + y[2] * y[2] / p[2]) / 2.0


def central_spin(t: Any, y: Any, p: Any) -> Any:
    """A spin s_1 in a field along e3, coupled with the strengths p to spins without a field: H = s_1³ + Σ p_k s_1·s_{k+1}."""
    return y[2] + sum(A * (y[:3] @ y[3 * k : 3 * k + 3]) for k, A in enumerate(p, start=1))


def drawn_top(name: str) -> tuple[LagrangeTop, Array]:
    """The top and the initial state (6,) of the name of a drawn top."""
    draw = random.Random(name)  # seeded by the text itself, through SHA-512
    J = [draw.uniform(-2, 2) for _ in range(3)]
    x = np.array([draw.uniform(-1, 1) for _ in range(3)])
    alpha, size = draw.uniform(0.3, 2), draw.uniform(0.5, 2)
    x *= size / math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    if name.startswith("close"):
        J = _near_separatrix(alpha, x, J[2] / 2, 10 ** draw.uniform(-8, -1) * draw.choice((-1, 1)))
    kind = name[:-3]
    if kind in ("released", "spinning"):
        J = list(draw.choice((-1, 1)) * x)
    if kind in SPINS:
        long = math.sqrt(10 ** draw.uniform(*SPINS[kind]) * alpha * size) / math.hypot(*J)
        J, alpha = [long * component for component in J], alpha * draw.choice((-1, 1))
    return LagrangeTop(alpha), np.array([*J, *x])


def _near_separatrix(alpha: float, x: Array, share: float, off: float) -> list[float]:
    """A J near the separatrix J·x = J3 |x|, H = J3²/2 + alpha |x|. share : J3 over its maximum. off : relative, of J1 and J2."""
    size, flat = math.hypot(*x), math.hypot(x[0], x[1])
    J3 = share * math.sqrt(2 * alpha * (size + x[2]))
    along = J3 * (size - x[2]) / flat
    across = math.sqrt(2 * alpha * (size - x[2]) - along * along)
    along, across = along * (1 + off), across * (1 + off)
    return [(along * x[0] - across * x[1]) / flat, (along * x[1] + across * x[0]) / flat, J3]
