"""A symmetric top in a field of your own: H = |J|²/2 + alpha x3 + V(x).

    J' = ∇U(x) × x        x' = J × x        U = alpha x3 + V(x)

Phase space and bracket are as in `top`: C1 = |x|² and C2 = x·J are constant for any V. J3 is constant if V does not change
when x turns about the vertical. In general there is no closed form and no torus, so an integrator is needed.

V is an ordinary Python function of + − × ÷, whole and half powers, `sqrt`, `sin`, `cos`, `exp` and `log`. It is recorded once
(`compiling.tape`). So one formula serves floats, mpmath, heyoka and the compiled kernels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array, check_flag, check_reals
from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import Term, record_own
from lagrange_bench.integrators.problem.symmetry import is_of_height, random_states, vanish
from lagrange_bench.integrators.problem.system import System, potential_system, top_system
from lagrange_bench.integrators.problem.top import LagrangeTop, Top


class Potential:
    """A potential V(x1, x2, x3, p) of the axis x, p a tuple of parameters.

    Parameters
    ----------
    name : str
        Its name in messages and tables.
    value : callable
        (x1, x2, x3, p) → V, in the units of |J|².
    parameters : sequence of str, optional
        Names of the parameters; by default a top may have any number of them.
    note : str
        The meaning of the potential, in a line.

    Raises
    ------
    ValueError
        An argument of the wrong type. From `formula` and `PerturbedTop`: a function that is no such formula, or another number of
        parameters.
    """

    def __init__(
        self,
        name: str,
        value: Callable[..., Any],
        *,
        parameters: Sequence[str] | None = None,
        note: str = "",
    ):
        if not isinstance(name, str) or not name:
            raise ValueError(f"name of a potential must be a word; got {name!r}")
        if not callable(value):
            raise ValueError(f"potential {name}: value must be a function of (x1, x2, x3, p); got {value!r}")
        if isinstance(parameters, str):
            raise ValueError(f"potential {name}: parameters must be a sequence of names; got {parameters!r}")
        self.name, self.value, self.note = name, value, note
        self.parameters = None if parameters is None else tuple(parameters)
        self._formulas: dict[int, Program] = {}

    def __repr__(self) -> str:
        return f"Potential({self.name!r})"

    def __getstate__(self) -> dict[str, Any]:
        # a function from a prompt cannot be pickled, but its recorded formula can
        return {**self.__dict__, "value": None}

    def formula(self, count: int) -> Program:
        """V as a program of x and `count` parameters; ValueError as of the class."""
        if self.parameters is not None and count != len(self.parameters):
            names = ", ".join(self.parameters)
            needed = f"{len(self.parameters)} numbers ({names})"
            raise ValueError(f"parameters of the potential {self.name}: {needed}; got {count}")
        if count not in self._formulas:

            def plain(*numbers: Term) -> tuple[Any, ...]:
                return (self.value(*numbers[:3], numbers[3:]),)

            where = f"potential {self.name}: value"
            self._formulas[count] = record_own(plain, 3 + count, where, "(x1, x2, x3, p)", f"{count} parameters")
        return self._formulas[count]


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
        The numbers p.
    axisymmetric : bool
        Whether V does not change when x turns about the vertical, so that J3 is conserved, and held fixed. A V of x3 alone needs
        no such word.

    Raises
    ------
    ValueError
        Parameters of the wrong number or kind; a potential that is no formula, or that is said to be axisymmetric and is not.
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
        self.top.require_single()
        object.__setattr__(self, "parameters", check_reals(self.parameters, "parameters"))
        _ = self._V  # or a ValueError
        if check_flag(self.axisymmetric, "axisymmetric") and not self._has_no_vertical_torque():
            raise ValueError(f"axisymmetric: {self.description} changes when x turns about the vertical")

    def _has_no_vertical_torque(self) -> bool:
        """Whether (x × ∇V)₃ is round-off at random states."""
        states = random_states(6)
        slopes = self._values(self.alpha_and_rest[1].gradient, states, 0.0)
        arms = np.column_stack((states[:, 3] * slopes[:, 4], -states[:, 4] * slopes[:, 3]))
        return vanish(arms.sum(axis=1, keepdims=True), arms)

    @property
    def alpha(self) -> Any:
        """The weight parameter of the top."""
        return self.top.alpha

    @property
    def description(self) -> str:
        """The name of the problem in messages."""
        return f"the potential {self.potential.name}"

    @cached_property
    def system(self) -> System:  # type: ignore[override]
        """H and its bracket as formulas of `arguments`."""
        return top_system(self._V, frozenset({2} if "J3" in self.conserved else ()))

    @cached_property
    def alpha_and_rest(self) -> tuple[float, System]:
        """alpha and the system of V."""
        return self.require_single(), potential_system(self._V, self.system.constant)

    @cached_property
    def conserved(self) -> frozenset[str]:
        """H, C1, C2, and J3 if V depends on x3 only or the user says that it is axisymmetric."""
        is_round = self.axisymmetric or is_of_height(self._V, self.numbers[1:])
        return frozenset({"H", "C1", "C2", "J3"} if is_round else {"H", "C1", "C2"})

    @cached_property
    def offers(self) -> frozenset[str]:
        """What methods may rely on. "smooth" is among it unless V has corners, as √(w²) at w = 0."""
        return frozenset({"rhs", "parts", "kinetic"} | ({"smooth"} if self.system.smooth else set()))

    def check_state(self, y: Any, name: str = "y0") -> Array:
        """A state as a fresh array (6,). ValueError: `y` is no state, or V or the force is not finite there."""
        state = super().check_state(y, name)
        if not np.isfinite((self._value(state), *self.force(state))).all():
            raise ValueError(f"{name}: {self.description} is not finite at x = {state[3:].tolist()}")
        return state

    def scales(self, y: ArrayLike) -> tuple[float, float, float]:
        """(r, |x|, 1/r), the scales of J, x and time at one state (6,); r is the larger of |J| + √(|alpha||x|) and √(|∇U||x|)."""
        rate, size, _ = self.top.scales(y)
        force = math.hypot(*self.force(y))
        if math.isfinite(force):  # at a singularity it is not
            rate = max(rate, math.sqrt(force) * math.sqrt(size))
        return rate, size, (1.0 / rate if rate > 0 else math.inf)

    def invariant_scales(self, y: ArrayLike) -> Array:
        """Sizes (4,) of the terms in H, J3, C1, C2 at one state, for relative drift and ulps."""
        H, *others = super().invariant_scales(y)
        return np.array((H + abs(self._value(y)), *others))

    @property
    def _V(self) -> Program:
        """V as a program of x and the parameters."""
        return self.potential.formula(len(self.parameters))

    def _value(self, y: ArrayLike) -> float:
        """V at one state."""
        return float(self._values(self.alpha_and_rest[1].energy, y, 0.0)[0])
