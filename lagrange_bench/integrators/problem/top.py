"""The symmetric Lagrange top: equations, Poisson structure, invariants, named initial states.

The state y = (J1, J2, J3, x1, x2, x3) holds angular momentum and axis in the rest frame, in units of the user's choice. alpha has
the units of J²/x. If e3 points up and alpha > 0, the weight of the top acts along −e3:

    J' = alpha e3 × x        x' = J × x                                        (paper, equation 1.1)
    H = |J|²/2 + alpha x3,   J3,   C1 = |x|²,   C2 = x·J

This is f' = {f, H} with the Lie-Poisson bracket of e(3): {J1,J2} = J3, {J1,x2} = x3, {x,x} = 0 (cyclic).
`alpha` is any real number and |x| any positive one: |x| need not be 1.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lagrange_bench.integrators.checks import Array, check_one_or_many, check_state
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import E3, uniform_system

LARGEST = sys.float_info.max


class Top(Problem):
    """A top in a potential, H = |J|²/2 + alpha x3 + V(x) on e3; or many tops, with an array of alpha."""

    space = E3
    timed = False
    is_top = True
    names = INVARIANTS  # J3 among them, conserved or not
    alpha: Any

    @property
    def arguments(self) -> tuple[Any, ...]:
        """alpha, for many tops an array, then the parameters of a potential."""
        return self.alpha, *self.parameters

    def require_single(self) -> float:
        """alpha; ValueError if there are many tops."""
        return float(self.numbers[0])

    @cached_property
    def numbers(self) -> tuple[float, ...]:  # type: ignore[override]
        """`arguments`; ValueError if there are many tops."""
        if isinstance(self.alpha, np.ndarray):
            raise ValueError(f"top holds {len(self.alpha)} values of alpha, which only integrate_ensemble takes")
        return self.arguments

    def check_state(self, y: Any, name: str = "y0") -> Array:
        """A state as a fresh array (6,). ValueError: `y` is no state."""
        return check_state(y, name)

    def conserved_by(self, method: Any) -> frozenset[str]:
        """The invariants of `conserved` that a method conserves up to round-off, by its claims."""
        quadratic = method.claims.conserves_if_quadratic if self.quadratic else frozenset()
        return frozenset((method.claims.conserves | quadratic) & self.conserved)

    def scales(self, y: ArrayLike) -> tuple[float, float, float]:
        """(r, |x|, 1/r), the scales of J, x and time for errors at one state (6,), with r = |J| + √(|alpha||x|); 1/0 is inf.

        They are finite, and no time is 0: lengths beyond the largest double count as that.
        """
        numbers = np.asarray(y, dtype=float).tolist()
        size = min(math.hypot(*numbers[3:]), LARGEST)
        rate = min(math.hypot(*numbers[:3]) + math.sqrt(abs(self.require_single())) * math.sqrt(size), LARGEST)
        return rate, size, (1.0 / rate if rate > 0 else math.inf)

    def sizes(self, y: ArrayLike) -> Array:
        """The scale for errors of each component, (6,), at one state (6,)."""
        return np.repeat(self.scales(y)[:2], 3)

    def invariant_scales(self, y: ArrayLike) -> Array:
        """Sizes (4,) of the terms in H, J3, C1, C2 at one state, for relative drift and ulps."""
        rate, size, _ = self.scales(y)
        J = math.hypot(*np.asarray(y, dtype=float)[:3])
        return np.array((J * J / 2 + abs(self.alpha) * size, rate, size * size, size * rate))


@dataclass(frozen=True, eq=False)
class LagrangeTop(Top):
    """A symmetric heavy top with weight parameter `alpha` (m g l / A for a real one). Hashable, picklable.

    Source: paper, (1.1).

    Parameters
    ----------
    alpha : float
        Any finite number, in units of J²/x. For `integrate_ensemble` alone an array (n,), one number for each of n tops. Then
        `rhs` and `invariants` take states (..., n, 6), and everything else raises a ValueError.

    Raises
    ------
    ValueError
        alpha is not real or not finite.
    """

    alpha: float = 1.0
    system = uniform_system()
    parameters = ()  # of a potential
    conserved: ClassVar[frozenset[str]] = frozenset(INVARIANTS)
    offers: ClassVar[frozenset[str]] = frozenset({"uniform", "kinetic", "parts", "smooth", "rhs"})
    quadratic: ClassVar[bool] = True
    description: ClassVar[str] = "a LagrangeTop"

    if TYPE_CHECKING:

        def __init__(self, alpha: float | NDArray[Any] = 1.0) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", check_one_or_many(self.alpha, "alpha"))

    def motion(self, place: int) -> LagrangeTop:
        """One of many tops."""
        return LagrangeTop(self.alpha[place] if isinstance(self.alpha, np.ndarray) else self.alpha)


@dataclass(frozen=True)
class NamedTop:
    """A top with a name and an initial state.

    Parameters
    ----------
    name : str
        Its name in tables, lower case.
    label : str
        Its name in legends.
    alpha : float
        In units of J²/x.
    y0 : tuple of 6 floats
        (J1, J2, J3, x1, x2, x3).
    note : str
        What is special about it.
    field : callable, optional
        LagrangeTop → the top in a potential.
    """

    name: str
    label: str
    alpha: float
    y0: tuple[float, float, float, float, float, float]
    note: str
    field: Callable[[LagrangeTop], Top] | None = None

    @property
    def top(self) -> Any:
        """The top."""
        top = LagrangeTop(self.alpha)
        return self.field(top) if self.field else top

    @property
    def state(self) -> Array:
        """The initial state (6,), a fresh array."""
        return np.array(self.y0)


# A state on a special orbit consists of short binary fractions: so the identity that defines the orbit holds without rounding.
# There |x| is 5/4 or 1.
TOPS = {
    top.name: top
    for top in (
        NamedTop("figure1", "paper, Figure 1", 3.345, (2.34, 6.4, 8.0, 1.219, -0.78, 6.77),
                 "alpha and initial data of the paper's Figure 1; |x| = 6.92"),
        NamedTop("figure2", "paper, Figure 2", 1.0, (3.4, -4.6, -6.2, -2.19, 0.89, 0.77),
                 "alpha and initial data of the paper's Figure 2; |x| = 2.49"),
        NamedTop("generic", "generic unit top", 1.0, (0.3, -0.4, 1.2, 0.48, 0.6, 0.64),
                 "|x| = 1 up to round-off, all four invariants of the same size"),
        NamedTop("fast", "fast top", 1.0, (3.0, -4.0, 12.0, 0.48, 0.6, 0.64),
                 "|J|² = 169 alpha |x|: small, rapid nutation"),
        NamedTop("slow", "slow top", 1.0, (0.05, -0.0625, 0.1, 0.8, 0.36, -0.48),
                 "|J|² = 0.02 alpha |x|: nearly a spherical pendulum"),
        NamedTop("near_regular", "near regular precession", 1.0, (1.5, 0.0009765625, 2.5, 0.75, 0.0, 1.0),
                 "regular precession with a kick of 2^-10"),
        NamedTop("regular", "regular precession", 1.0, (1.5, 0.0, 2.5, 0.75, 0.0, 1.0),
                 "J = e3/2 + 2x: the axis turns about e3 at rate 1/2 without nutation, exactly"),
        NamedTop("sleeping_stable", "sleeping, stable", 1.0, (0.0, 0.0, 3.0, 0.0, 0.0, 1.0),
                 "upright, J3² = 9 > 4 alpha |x|: an equilibrium"),
        NamedTop("sleeping_unstable", "sleeping, unstable", 1.0, (0.0, 0.0, 1.0, 0.0, 0.0, 1.0),
                 "upright, J3² = 1 < 4 alpha |x|: an unstable equilibrium"),
        NamedTop("hanging", "hanging", 1.0, (0.0, 0.0, 1.0, 0.0, 0.0, -1.0),
                 "straight down: a stable equilibrium"),
        NamedTop("near_separatrix", "near the separatrix", 1.0, (2.0009765625, 0.0, 1.0, 1.0, 0.0, -0.75),
                 "the homoclinic state with a kick of 2^-10"),
        NamedTop("homoclinic", "homoclinic", 1.0, (2.0, 0.0, 1.0, 1.0, 0.0, -0.75),
                 "H = J3²/2 + alpha |x| and C2 = J3 |x| exactly: falls back to the unstable sleeping top"),
        NamedTop("planar", "planar pendulum, swinging", 1.0, (1.0, 0.0, 0.0, 0.0, 0.6, -0.8),
                 "J3 = C2 = 0, swings in a plane"),
        NamedTop("planar_rotation", "planar pendulum, rotating", 1.0, (2.5, 0.0, 0.0, 0.0, 0.6, -0.8),
                 "J3 = C2 = 0, goes over the top, through both poles"),
        NamedTop("through_pole", "through the pole", 1.0, (0.5, 1.0, 1.0, 1.0, 0.0, 0.75),
                 "C2 = J3 |x| exactly: the axis passes through the upper pole"),
        NamedTop("weightless", "no gravity", 0.0, (0.3, -0.4, 1.2, 0.48, 0.6, 0.64),
                 "alpha = 0: x turns uniformly about the constant J"),
        NamedTop("inverted", "negative alpha", -1.0, (0.3, -0.4, 1.2, 0.48, 0.6, 0.64),
                 "the generic unit top with gravity reversed"),
    )
}  # fmt: skip
