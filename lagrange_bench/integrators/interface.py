"""The one contract between a method and everything that uses it.

A method is a record (`Method`) of claims and of a builder (`prepare`), which builds a `Stepper`. Tests check the claims;
experiments only ever see a `Stepper`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lagrange_bench.integrators.checks import Array, check_options, keyword_options

INVARIANTS = ("H", "J3", "C1", "C2")
ENGINES = ("numba", "heyoka", "scipy", "python")


class StepError(RuntimeError):
    """A method could not take a step.

    Parameters
    ----------
    method : str
        The method's name.
    reason : str
        What went wrong.
    h : float, optional
        The step, in the problem's own unit of time.
    step : int, optional
        Its number.
    """

    def __init__(self, method: str, reason: str, *, h: float | None = None, step: int | None = None) -> None:
        at = "" if h is None else f" at h = {h:g} (own unit)"
        where = "" if step is None else f", step {step}"
        super().__init__(f"{method}{at}{where}: {reason}")
        self.method, self.reason, self.h, self.step = method, reason, h, step

    def __reduce__(self) -> tuple[Any, ...]:  # keyword-only arguments do not survive the default pickling of exceptions
        return partial(StepError, h=self.h, step=self.step), (self.method, self.reason)


class StepWarning(RuntimeWarning):
    """Advice to a user, not a fault: another step or another method is better here."""


@dataclass
class Work:
    """What a stepper has done so far. Set-up is counted apart; it contains the compilation of kernels.

    Parameters
    ----------
    steps : int
        Internal steps: one per h for control "step", natural steps for control "tolerance".
    rhs_evals : int
        Evaluations of the right-hand side, or what a method does in their place.
    iterations : int
        Iterations of a nonlinear solver.
    rejected : int
        Steps tried and thrown away.
    setup_seconds : float
        Time of the set-up, s.
    notes : str
        What the method has chosen, such as its step.
    """

    steps: int = 0
    rhs_evals: int = 0
    iterations: int = 0
    rejected: int = 0
    setup_seconds: float = 0.0
    notes: str = ""


class Stepper(Protocol):
    """Advances states by multiples of the step h it was built for. A state of a `Problem` has as many numbers as its space.

    `from_start` is True where n steps are not n calls of one step: for a multistep method, or a closed form of the time.
    Such a run must not be continued from a state on the way, so the experiments start it again for every sample. It is
    False by default in the classes that derive from this one.
    """

    work: Work
    from_start: bool = False

    def advance(self, y: Array, n: int) -> Array:
        """State (6,) after time n*h. `y` (6,) is not modified. By default the last row of `record`."""
        return self.record(y, n, max(n, 1))[-1]

    def record(self, y: Array, n: int, every: int) -> Array:
        """States after 0, every, 2*every, … n steps, shape (n//every + 1, 6); row 0 is `y`."""
        ...


# what a method may need and a problem may offer (`Problem.offers`), and how messages name it
NEEDS = {
    "uniform": "a top in a uniform field, a LagrangeTop",
    "rhs": "a right-hand side",
    "parts": "a Hamiltonian of parts with closed flows",
    "kinetic": "a Hamiltonian c |J|² + U(t, x)",
    "smooth": "a Hamiltonian without corners",
    "body": "a rigid body in a uniform field, a RigidBody",
}
Need = str | Callable[[Any], bool]  # a word of NEEDS, or a predicate of problems whose docstring says the same


def meets(problem: Any, need: Need) -> bool:
    """Whether a problem offers what a method needs."""
    return need(problem) if callable(need) else need in problem.offers


def needed(need: Need) -> str:
    """What a method needs, in words."""
    return (need.__doc__ or need.__name__) if callable(need) else NEEDS[need]


Quantity = Callable[[Any, float, Array], tuple[Array, float]]
Builder = Callable[..., Stepper]


@dataclass(frozen=True)
class Claims:
    """What a method claims of its steps, besides their order. `lagrange-bench check` puts each claim to the test.

    Parameters
    ----------
    symmetric : bool
        step(-h) undoes step(h).
    poisson : bool
        One step is a Poisson map.
    conserves : set of str
        Names of INVARIANTS, or of a problem's own. The method keeps them at round-off, for every h that it takes, if the problem
        conserves them. Round-off may grow with the angle of a step: some ulps for each time scale of h.
    conserves_if_quadratic : set of str
        Names of further invariants that it keeps if H is quadratic.
    conserves_own : dict
        Other quantities, such as a modified energy, that it keeps at round-off for every h in a uniform field: name → function
        of (top, h, states (N, 6)) that returns the values (N,) and the size of their terms at the first state.

    Raises
    ------
    ValueError
        An invariant that is no word.
    """

    symmetric: bool = False
    poisson: bool = False
    conserves: Set[str] = frozenset()
    conserves_if_quadratic: Set[str] = frozenset()
    conserves_own: Mapping[str, Quantity] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        for name in ("conserves", "conserves_if_quadratic"):
            words = getattr(self, name)
            if isinstance(words, str) or not all(isinstance(word, str) and word.isidentifier() for word in words):
                raise ValueError(f"{name} names invariants by words, as {{'J3'}}; got {words!r}")
            object.__setattr__(self, name, frozenset(words))  # can be hashed


@dataclass(frozen=True)
class Method:
    """The record of a method. Every field is read by a test, a legend or a table; docs/adding-a-method.md explains each.

    Parameters
    ----------
    name : str
        Registry key, the name in every table.
    label : str
        The name in legends.
    family : str
        Colour and grouping, such as "splitting".
    order : int or None
        None: exact in time.
    source : str
        Citation, equation numbers.
    prepare : callable
        (problem, y0, h, **options) → Stepper: everything slow happens here, once.
    claims : Claims
        Whether it is symmetric or a Poisson map, and what it conserves; nothing by default.
    control : str
        "step": one internal step per h; "tolerance": h is the output grid, tol sets the accuracy.
    needs : str or callable
        What a problem must offer: a word of NEEDS; or a predicate, problem → bool, whose docstring says what it asks for.
    kernels_for : dict
        Need (a word of NEEDS or a predicate) → builder of another kernel, in place of `prepare`, for problems that meet it.
    evaluate : callable, optional
        (problem, y0, times, **options) → states and Work: dense output or jumps.
    many : callable, optional
        Many tops in a uniform field in one call, for `integrate_ensemble`: (alphas (n,), Y0 (n, 6), h, steps, every, out,
        stopped, **options) → a mask of the tops done. It fills `out` (steps // every, n, 6), and ends early once `stopped()`.
    requires : str, optional
        A package that may be missing on some platforms.
    engine : str
        It takes the steps: "numba", compiled here; "heyoka"; "scipy" and "python", interpreted.

    Raises
    ------
    ValueError
        An order that is none, no claims, or an unknown word.
    """

    name: str
    label: str
    family: str
    order: int | None
    source: str
    prepare: Builder
    claims: Claims = Claims()
    control: str = "step"
    needs: Need = "uniform"
    kernels_for: Mapping[Need, Builder] = field(default_factory=dict, hash=False)
    evaluate: Callable[..., tuple[Array, Work]] | None = None
    many: Callable[..., NDArray[np.bool_]] | None = None
    requires: str | None = None
    engine: str = "numba"

    def __post_init__(self) -> None:
        if self.order is not None and not (type(self.order) is int and self.order > 0):
            raise ValueError(f"order must be a whole number from 1 on, or None; got {self.order!r}")
        if not isinstance(self.claims, Claims):
            raise ValueError(f"claims must be a record such as Claims(conserves={{'J3'}}); got {self.claims!r}")
        words = [need for need in (self.needs, *self.kernels_for) if not callable(need)]
        for name, word, known in (
            *(("needs", word, tuple(NEEDS)) for word in words),
            ("control", self.control, ("step", "tolerance")),
            ("engine", self.engine, ENGINES),
        ):
            if word not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}; got {word!r}")

    @cached_property
    def options(self) -> tuple[str, ...]:
        """Keyword options of `prepare`."""
        return keyword_options(self.prepare)

    def takes(self, problem: Any) -> str | None:
        """None if the method can follow this problem, else the reason why not."""
        if self._builder(problem):
            return None
        return f"{self.name} needs {needed(self.needs)}, which {problem.description} is not"

    def _builder(self, problem: Any) -> Builder | None:
        """The kernel for this problem, the one place where kernels are chosen; None if the method does not take it."""
        special = next((build for need, build in self.kernels_for.items() if meets(problem, need)), None)
        return special or (self.prepare if meets(problem, self.needs) else None)

    def prepare_for(self, problem: Any, options: Mapping[str, Any] | None = None) -> Builder:
        """The builder of a stepper for this problem: (problem, y0, h, **options) → Stepper.

        ValueError if the method does not take the problem, or has no such option.
        """
        build = self._builder(problem)
        if build is None:
            raise ValueError(f"method: {self.takes(problem)}")
        check_options(self.name, build, options or {}, self.evaluate, "runs to given times t")
        return build

    def evaluate_for(self, problem: Any, options: Mapping[str, Any] | None = None) -> Callable[..., tuple[Array, Work]]:
        """Dense output for this problem: (problem, y0, times, **options) → states and work.

        ValueError if the method does not take the problem, or has no dense output, or this has no such option.
        """
        by_steps = self.prepare_for(problem)
        if self.evaluate is None:
            raise ValueError(f"t: {self.name} steps on a grid only; give h and steps")
        check_options(f"{self.name} at given times", self.evaluate, options or {}, by_steps, "runs by h and steps")
        return self.evaluate

    @property
    def accuracy_option(self) -> str:
        """The option that trades work for precision: "tol" or "rtol" for control "tolerance", else "h"."""
        return "h" if self.control == "step" else next(name for name in self.options if name in ("tol", "rtol"))
