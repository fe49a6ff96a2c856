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

from lagrange_bench.integrators.checks import Array, check_flag, check_real
from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import Tape, Term, record_own
from lagrange_bench.integrators.problem.symmetry import STATES, is_of_height, random_states, values_at, vanish
from lagrange_bench.integrators.problem.system import System, potential_system, top_system
from lagrange_bench.integrators.problem.top import LagrangeTop, Top

# relative difference between a gradient of the user and the derived one
SAME = 1e-8


class Potential:
    """A potential V(x1, x2, x3, p) of the axis x, p a tuple of parameters.

    Parameters
    ----------
    name : str
        Its name in messages and tables.
    value : callable
        (x1, x2, x3, p) → V, in the units of |J|².
    gradient : callable, optional
        (x1, x2, x3, p) → (∂V/∂x1, ∂V/∂x2, ∂V/∂x3). By default it is derived, and otherwise compared with the derived one.
    parameters : sequence of str, optional
        Names of the parameters; by default a top may have any number of them.
    note : str
        The meaning of the potential, in a line.

    Raises
    ------
    ValueError
        An argument of the wrong type. From `formulas` and `PerturbedTop`: a function that is no such formula, a gradient that is
        not V's, or another number of parameters.
    """

    def __init__(
        self,
        name: str,
        value: Callable[..., Any],
        gradient: Callable[..., Any] | None = None,
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
        self.name, self.value, self.gradient, self.note = name, value, gradient, note
        self.parameters = None if parameters is None else tuple(parameters)
        self._formulas: dict[int, tuple[Program, Program]] = {}

    def __repr__(self) -> str:
        return f"Potential({self.name!r})"

    def __getstate__(self) -> dict[str, Any]:
        # a function from a prompt cannot be pickled, but its recorded formula can
        return {**self.__dict__, "value": None, "gradient": None}

    def formulas(self, count: int) -> tuple[Program, Program]:
        """V and ∇V, the user's or derived, as programs of x and `count` parameters; ValueError as of the class."""
        if self.parameters is not None and count != len(self.parameters):
            names = ", ".join(self.parameters)
            needed = f"{len(self.parameters)} numbers ({names})"
            raise ValueError(f"parameters of the potential {self.name}: {needed}; got {count}")
        if count not in self._formulas:
            value = self._record("value", self.value, count, 1)
            tape = Tape()
            inputs = [tape.input() for _ in range(value.inputs)]
            gradient = derived = tape.program(tape.gradient(tape.run(value, *inputs)[0], inputs[:3]))
            if self.gradient is not None:
                gradient = self._record("gradient", self.gradient, count, 3)
                x_and_p = random_states(3 + count).T
                ours, theirs = values_at(derived, x_and_p), values_at(gradient, x_and_p)
                if not vanish(ours - theirs, np.hstack((ours, theirs)), SAME):
                    raise ValueError(f"potential {self.name}: gradient is not the derivative of value")
            self._formulas[count] = value, gradient
        return self._formulas[count]

    def _record(self, word: str, function: Callable[..., Any], count: int, outputs: int) -> Program:
        def plain(*numbers: Term) -> tuple[Any, ...]:
            result = function(*numbers[:3], numbers[3:])
            return tuple(result) if outputs > 1 else (result,)

        where = f"potential {self.name}: {word}"
        program = record_own(plain, 3 + count, where, "(x1, x2, x3, p)", f"{count} parameters")
        if len(program.outputs) != outputs:
            raise ValueError(f"potential {self.name}: {word} must return {outputs} numbers; got {len(program.outputs)}")
        return program


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
        self.top.require_single()
        checked = tuple(check_real(value, f"parameters[{i}]") for i, value in enumerate(parameters))
        object.__setattr__(self, "parameters", checked)
        self.potential.formulas(len(checked))  # or a ValueError
        if check_flag(self.axisymmetric, "axisymmetric") and not self._has_no_vertical_torque():
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
        """alpha and the parameters."""
        return self.alpha, *self.parameters

    @property
    def description(self) -> str:
        """The name of the problem in messages."""
        return f"the potential {self.potential.name}"

    @cached_property
    def system(self) -> System:  # type: ignore[override]
        """H and its bracket as formulas of `arguments`."""
        formulas = self.potential.formulas(len(self.parameters))
        return top_system(*formulas, frozenset({2} if "J3" in self.conserved else ()))

    @cached_property
    def alpha_and_rest(self) -> tuple[float, System]:
        """alpha and the system of V."""
        formulas = self.potential.formulas(len(self.parameters))
        return self.require_single(), potential_system(*formulas, self.system.constant)

    @cached_property
    def conserved(self) -> frozenset[str]:
        """H, C1, C2, and J3 if V depends on x3 only or the user says that it is axisymmetric."""
        V, _ = self.potential.formulas(len(self.parameters))
        is_round = self.axisymmetric or is_of_height(V, self.numbers[1:])
        return frozenset({"H", "C1", "C2", "J3"} if is_round else {"H", "C1", "C2"})

    @cached_property
    def offers(self) -> frozenset[str]:
        """What methods may rely on. "smooth" is among it unless V has corners, as √(w²) at w = 0."""
        return frozenset({"rhs", "parts", "kinetic"} | ({"smooth"} if self.system.smooth else set()))

    def check_state(self, y: Any, name: str = "y0") -> Array:
        """A state as a fresh array (6,). ValueError: `y` is no state, or V or the force is not finite there."""
        state = super().check_state(y, name)
        if not np.isfinite((self._V(state), *self.force(state))).all():
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
        return np.array((H + abs(self._V(y)), *others))

    def _V(self, y: ArrayLike) -> float:
        return float(self._values(self.alpha_and_rest[1].energy, y, 0.0)[0])
