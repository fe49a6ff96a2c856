"""A symmetric top in a field of your own: H = |J|²/2 + alpha x3 + V(x).

    J' = ∇U(x) × x        x' = J × x        U = alpha x3 + V(x)

Phase space and bracket are as in `top`: C1 = |x|² and C2 = x·J are constant for any V. J3 is constant if V does not change
when x turns about the vertical. In general there is no closed form and no torus, so an integrator is needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array, check_flag, check_one_or_many
from lagrange_bench.integrators.problem.potential import Potential
from lagrange_bench.integrators.problem.symmetry import STATES, is_of_height, random_states, values_at, vanish
from lagrange_bench.integrators.problem.system import System, potential_system, top_system
from lagrange_bench.integrators.problem.top import LagrangeTop, Top


@dataclass(frozen=True, eq=False)
class PerturbedTop(Top):
    """A Lagrange top in a potential. Hashable, picklable.

    Parameters
    ----------
    top : LagrangeTop
        The top and its uniform field.
    potential : Potential
        V(x, p), which is added to the energy.
    parameters : tuple of float
        The numbers p. For `integrate_ensemble` alone, these and `alpha` of the top may be arrays (n,), for n tops.
    axisymmetric : bool
        Whether V does not change when x turns about the vertical, so that J3 is conserved, and held fixed. A V of x3 alone needs
        no such word.

    Raises
    ------
    ValueError
        Parameters of the wrong number or kind; a potential that is no formula, or whose gradient is not V's, or that is said to
        be axisymmetric and is not.
    """

    top: LagrangeTop
    potential: Potential
    parameters: tuple[Any, ...] = ()
    axisymmetric: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.top, LagrangeTop):
            raise ValueError(f"top of a PerturbedTop must be a LagrangeTop; got {type(self.top).__name__}")
        if not isinstance(self.potential, Potential):
            raise ValueError(f"potential must be a Potential, such as POTENTIALS['tide']; got {self.potential!r}")
        parameters = self.parameters
        if isinstance(parameters, (str, bytes)) or not hasattr(parameters, "__iter__"):
            raise ValueError(f"parameters must be numbers, one for each parameter; got {parameters!r}")
        checked = tuple(check_one_or_many(value, f"parameters[{i}]") for i, value in enumerate(parameters))
        object.__setattr__(self, "parameters", checked)
        self.potential.formulas(len(checked))  # or a ValueError
        single = not any(isinstance(value, np.ndarray) for value in self.arguments)  # else `motion` checks each
        if check_flag(self.axisymmetric, "axisymmetric") and single and not self._has_no_vertical_torque():
            raise ValueError(f"axisymmetric: {self.description} changes when x turns about the vertical")

    def _has_no_vertical_torque(self) -> bool:
        """Whether (x × ∇V)₃ is round-off at random states."""
        x, p = random_states(3).T, [np.full(STATES, value) for value in self.numbers[1:]]
        slopes = values_at(self.potential.formulas(len(self.parameters))[1], (*x, *p)).T
        arms = np.column_stack((x[0] * slopes[1], -x[1] * slopes[0]))
        return vanish(arms.sum(axis=1, keepdims=True), arms)

    @property
    def alpha(self) -> Any:
        """The weight parameter of the top."""
        return self.top.alpha

    @property
    def arguments(self) -> tuple[Any, ...]:
        """alpha and the parameters; for many tops arrays."""
        return self.alpha, *self.parameters

    def motion(self, place: int) -> PerturbedTop:
        """One of many tops."""
        alpha, *parameters = self.numbers_of(place)
        return PerturbedTop(LagrangeTop(alpha), self.potential, tuple(parameters), self.axisymmetric)

    @property
    def description(self) -> str:
        """The name of the problem in messages."""
        return f"the potential {self.potential.name}"

    @cached_property
    def system(self) -> System:  # type: ignore[override]
        """H and its bracket as formulas of `arguments`. J3 is constant in them only if one top conserves it."""
        formulas = self.potential.formulas(len(self.parameters))
        many = any(isinstance(value, np.ndarray) for value in self.arguments)
        return top_system(*formulas, frozenset() if many or "J3" not in self.conserved else frozenset({2}))

    @cached_property
    def alpha_and_rest(self) -> tuple[float, System]:
        """alpha and the system of V."""
        formulas = self.potential.formulas(len(self.parameters))
        return self.require_single(), potential_system(*formulas, self.system.constant)

    @cached_property
    def conserved(self) -> frozenset[str]:
        """H, C1, C2, and J3 if V depends on x3 only or the user says that it is axisymmetric."""
        others = frozenset({"H", "C1", "C2"})
        V, _ = self.potential.formulas(len(self.parameters))
        return others | {"J3"} if self.axisymmetric or is_of_height(V, self.numbers[1:]) else others

    @cached_property
    def offers(self) -> frozenset[str]:
        """What methods may rely on. "smooth" is among it unless V has corners, as √(w²) at w = 0."""
        return frozenset({"rhs", "parts", "kinetic", *(("smooth",) * self.system.smooth)})

    def check_state(self, y: Any, name: str = "y0") -> Array:
        """A state as a fresh array (6,). ValueError: `y` is no state, or V or the force is not finite there."""
        state = super().check_state(y, name)
        numbers = state.tolist()
        if not all(map(math.isfinite, (self._V(numbers), *self._force_at(numbers)))):
            raise ValueError(f"{name}: {self.description} is not finite at x = {state[3:].tolist()}")
        return state

    def scales(self, y: ArrayLike) -> tuple[float, float, float]:
        """(r, |x|, 1/r), the scales of J, x and time at one state (6,); r is the larger of |J| + √(|alpha||x|) and √(|∇U||x|)."""
        rate, size, _ = self.top.scales(y)
        force = math.hypot(*self._force_at(np.asarray(y, dtype=float).tolist()))
        if math.isfinite(force):  # at a singularity it is not
            rate = max(rate, math.sqrt(force) * math.sqrt(size))
        return rate, size, (1.0 / rate if rate > 0 else math.inf)

    def invariant_scales(self, y: ArrayLike) -> Array:
        """Sizes (4,) of the terms in H, J3, C1, C2 at one state, for relative drift and ulps."""
        H, *others = super().invariant_scales(y)
        return np.array((H + abs(self._V(np.asarray(y, dtype=float).tolist())), *others))

    def _V(self, y: list[float]) -> float:
        return self._values_at(self.alpha_and_rest[1].energy, y)[0]

    def _force_at(self, y: list[float]) -> tuple[float, ...]:
        return self._values_at(self.system.gradient, y)[3:]
