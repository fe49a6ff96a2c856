"""A symmetric top in a field of your own: H = |J|²/2 + alpha x3 + V(x).

    J' = ∇U(x) × x        x' = J × x        U = alpha x3 + V(x)

on the phase space of `top`, with the same bracket: C1 = |x|² and C2 = x·J stay, whatever V is. J3 stays if V does not
change when x turns about the vertical. In general there is no closed form and no torus, and here an integrator is needed.

A `PerturbedTop` is a top in a potential (`field`), with numbers. Which methods apply its formula shows (`symmetry`).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array, check_one_or_many
from lagrange_bench.integrators.problem.field import Field, Formula, Potential, Vector
from lagrange_bench.integrators.problem.symmetry import are_polynomials, generic
from lagrange_bench.integrators.problem.system import System, top_system
from lagrange_bench.integrators.problem.top import LagrangeTop, Top


@dataclass(frozen=True, eq=False)
class PerturbedTop(Top):
    """A Lagrange top in a potential, with the numbers of its parameters. Hashable, picklable.

    For `integrate_ensemble` alone, `alpha` of the top and the parameters may be arrays (n,), a number for each of n tops.

    Parameters
    ----------
    top : LagrangeTop
        The top and its uniform field.
    potential : Potential
        V(x, p), which is added to the energy.
    parameters : tuple of float
        The numbers p.

    Raises
    ------
    ValueError
        Parameters of the wrong number or kind; a potential that is no formula, or whose gradient is not V's.
    """

    top: LagrangeTop
    potential: Potential
    parameters: tuple[Any, ...] = ()
    formula: Formula = dataclasses.field(init=False, repr=False, compare=False)  # V, recorded

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
        object.__setattr__(self, "formula", self.potential.formula(len(checked)))

    @property
    def identity(self) -> tuple[Any, ...]:
        """The field and the parameters."""
        return self.field, *super().identity

    # ------------------------------------------------------------------ what it is

    @property
    def field(self) -> Field:
        """The formulas of the whole potential alpha x3 + V."""
        return self.formula.field

    @cached_property
    def system(self) -> System:
        """H and its bracket as formulas; their parameters are `numbers`."""
        return top_system(self.field.potential, self.field.gradient, "J3" in self.conserved)

    @property
    def formulas(self) -> System:
        """The same, with the rate of J3 as it is computed: of many tops each may keep it or not."""
        return top_system(self.field.potential, self.field.gradient, False)

    @property
    def arguments(self) -> tuple[Any, ...]:
        """alpha and the parameters, of many tops arrays."""
        return self.alpha, *self.parameters

    @property
    def alpha(self) -> Any:
        """The weight parameter of the top."""
        return self.top.alpha

    @cached_property
    def offers(self) -> frozenset[str]:
        """What methods may rely on: "rhs", "parts", "kinetic", "top" and "force", always; "smooth", no corners; "quadratic", a
        linear force.

        A root of a square, √(w²), has a corner where w changes its sign.
        """
        quadratic = all(are_polynomials(self.field.gradient, 1, generic(self.numbers)))
        kinds = {"smooth": self.formulas.smooth, "quadratic": quadratic}
        always = ("rhs", "parts", "kinetic", "top", "force")
        return frozenset({*always, *(name for name, offered in kinds.items() if offered)})

    @property
    def conserves_J3(self) -> bool:
        """Whether it keeps J3."""
        return "J3" in self.conserved

    @cached_property
    def conserved(self) -> frozenset[str]:
        """Of H, J3, C1, C2 those that the exact motion keeps."""
        axisymmetric = are_polynomials(self.formulas.rhs, -1, generic(self.numbers))[2]
        return frozenset({"H", "C1", "C2", *(("J3",) * axisymmetric)})

    def check_state(self, y: Any, name: str = "y0") -> Array:
        """A state as a fresh array (6,). ValueError: it is none, or the force is not finite there."""
        state = super().check_state(y, name)
        x = state[3:].tolist()
        try:
            values = [*self.gradient(*x), self.energy(*x)]
        except (ZeroDivisionError, OverflowError):
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise ValueError(f"{name}: the potential {self.potential.name} is not finite at x = {x}")
        return state

    # ------------------------------------------------------------------ its functions, as those of LagrangeTop

    def gradient(self, x1: Any, x2: Any, x3: Any) -> Vector:
        """∇(alpha x3 + V), on whatever numbers x consists of."""
        g1, g2, g3 = self.field.gradient(x1, x2, x3, self.alpha, *self.parameters)
        return g1, g2, g3

    def energy(self, x1: Any, x2: Any, x3: Any) -> Any:
        """alpha x3 + V, on whatever numbers x consists of."""
        return self.field.potential(x1, x2, x3, self.alpha, *self.parameters)[0]

    def scales(self, y: ArrayLike) -> tuple[float, float, float]:
        """Scales of J, of x and of time that errors are judged by, at one state (6,).

        (r, |x|, 1/r) with r the larger of |J| + √(|alpha||x|) and √(|∇U||x|); the time is inf for r = 0.
        """
        rate, size, _ = self.top.scales(y)
        try:
            force = math.hypot(*map(float, self.gradient(*np.asarray(y, dtype=float)[3:].tolist())))
        except (ZeroDivisionError, OverflowError):  # at a singularity
            force = math.inf
        if math.isfinite(force):
            rate = max(rate, math.sqrt(force) * math.sqrt(size))
        return rate, size, (1.0 / rate if rate > 0 else math.inf)

    def invariant_scales(self, y: ArrayLike) -> Array:
        """Sizes of the terms in H, J3, C1, C2 at one state: what relative drift and ulps refer to; shape (4,)."""
        rate, size, _ = self.scales(y)
        *J, x1, x2, x3 = np.asarray(y, dtype=float).tolist()
        weight = self.alpha * x3
        H = math.hypot(*J) ** 2 / 2 + abs(self.alpha) * size + abs(float(self.energy(x1, x2, x3)) - weight)
        return np.array((H, rate, size * size, size * rate))
