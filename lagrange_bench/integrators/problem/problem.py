"""A problem of your own: a phase space and a Hamiltonian, written in a line.

    from lagrange_bench.integrators import Problem, integrate
    body = Problem("body", "so3", lambda t, y, p: (y[0]**2/p[0] + y[1]**2/p[1] + y[2]**2/p[2])/2, (1.0, 2.0, 3.0), frame="body")
    integrate(body, (0.3, -0.4, 1.2), h=0.05, steps=1000, method="gauss6").invariants()

H is recorded once (`compiling.tape`). The right-hand side, its Jacobian and the kernels of methods are derived from the record.
The brackets are in `system`, and `parts` splits H into parts with closed flows.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array, check_numbers, check_real, check_reals
from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import record_own
from lagrange_bench.integrators.problem.parts import Part, find_parts, is_top, weight_and_rest
from lagrange_bench.integrators.problem.symmetry import are_affine, random_states, vanish
from lagrange_bench.integrators.problem.system import (
    Space,
    System,
    find_space,
    gradients_of,
    invariants_of,
    make_system,
)
from lagrange_bench.integrators.problem.vectors import cross_in

Formula = Callable[..., Any]


class Problem:
    """A Hamiltonian system on "e3", "so3", n spins, or of a whole "body". Picklable, hashable.

    Parameters
    ----------
    name : str
        Its name in messages and tables.
    space : str or int
        "e3": six numbers (J, x). "so3": three. n: n spins, 3n numbers. "body": seven, (q, L), a quaternion, scalar
        first, that takes vectors of the body to the world, and the angular momentum.
    hamiltonian : callable
        (t, y, p) → H, a function of + − × ÷, whole and half powers, and sqrt, sin, cos, exp, log of `lagrange_bench`. y and p are
        arrays of the numbers of the state and of the parameters.
    parameters : sequence of float
        The numbers p.
    invariants : dict, optional
        Name → function as `hamiltonian`: conserved quantities besides H and the Casimir functions. They are refused if they
        change at a random state. A component of y that is named here is held fixed.
    frame : str
        "space", with the bracket of the top, J' = ∂H/∂J × J + ∂H/∂x × x, x' = ∂H/∂J × x; or "body", with the other sign.

    Raises
    ------
    ValueError
        A function that is no formula, or an invariant that is not conserved. The message names the argument.
    """

    # H and its bracket as formulas, and the values of their parameters
    name: str
    space: Space
    system: System
    numbers: tuple[float, ...]
    start = 0.0  # time at the initial state
    extra_invariants: tuple[tuple[str, Program], ...] = ()  # (name, formula), besides H and the Casimir functions

    def __init__(
        self,
        name: str,
        space: str | int,
        hamiltonian: Formula,
        parameters: Sequence[float] = (),
        invariants: Mapping[str, Formula] | None = None,
        frame: str = "space",
    ):
        if not isinstance(name, str) or not name:
            raise ValueError(f"name of a problem must be a word; got {name!r}")
        if frame not in ("space", "body"):
            raise ValueError(f"problem {name}: frame must be 'space' or 'body'; got {frame!r}")
        self.name, self.space = name, find_space(space)
        self.numbers = check_reals(parameters, f"problem {name}: parameters")
        energy = self._record("hamiltonian", hamiltonian)
        self.extra_invariants = tuple(
            (word, self._record(f"invariants[{word!r}]", formula)) for word, formula in (invariants or {}).items()
        )
        for word, _ in self.extra_invariants:
            if word in ("t", "H", *self.space.casimir_names):
                raise ValueError(f"problem {name}: invariants[{word!r}]: this name is taken; choose another")
        self.system = make_system(self.space, energy, body=frame == "body")
        self._check_invariants()
        places = [program.outputs[0] for _, program in self.extra_invariants]
        constant = frozenset(place - 1 for place in places if self._is_component(place))
        self.system = dataclasses.replace(self.system, constant=constant)

    def _is_component(self, place: Any) -> bool:
        return isinstance(place, int) and 1 <= place <= self.space.size

    def _record(self, word: str, formula: Formula) -> Program:
        size = self.space.size
        if not callable(formula):
            raise ValueError(f"problem {self.name}: {word} must be a function of (t, y, p); got {formula!r}")
        count, where = len(self.numbers), f"problem {self.name}: {word}"
        known = f"{size} numbers of y and {count} parameters"

        def plain(t: Any, *n: Any) -> tuple[Any]:
            y, parameters = (np.array(part, dtype=object) for part in (n[:size], n[size:]))
            value = formula(t, y, parameters)
            if np.ndim(value):
                raise TypeError(f"it returns {np.size(value)} numbers, not one")
            return (value,)

        return record_own(plain, 1 + size + count, where, "(t, y, p)", known)

    def __repr__(self) -> str:
        return f"Problem({self.name!r})"

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.identity == other.identity

    def __hash__(self) -> int:
        return hash((self.system, self.identity[1]))

    @property
    def identity(self) -> tuple[Any, ...]:
        """Formulas and numbers: two problems with equal ones are equal."""
        numbers = tuple(v.tobytes() if isinstance(v, np.ndarray) else v for v in self.arguments)
        return self.system, numbers, self.start, self.extra_invariants

    @property
    def arguments(self) -> tuple[Any, ...]:
        """The parameters of `system`; for many tops arrays."""
        return self.numbers

    @property
    def parameters(self) -> tuple[float, ...]:
        """The numbers p."""
        return self.numbers

    @property
    def description(self) -> str:
        """The name of the problem in messages."""
        return f"the problem {self.name}"

    def starting_at(self, t: float) -> Problem:
        """The same problem with the time t at the initial state. Times of a trajectory are counted from there."""
        other = object.__new__(type(self))
        other.__dict__ |= {**self.__dict__, "start": check_real(t, "t")}
        return other

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Parts of H with closed flows; () if it cannot be taken apart."""
        return tuple(find_parts(self.system, self.numbers))

    @property
    def timed(self) -> bool:
        """Whether H depends on t."""
        return self.system.timed

    @cached_property
    def offers(self) -> frozenset[str]:
        """The words of `interface.NEEDS` on which methods may rely."""
        kinds = [part.kind for part in self.parts]
        kinetic = kinds in (["square", "kick"], ["free", "kick"]) and not self.parts[0].timed
        words = {"rhs": True, "smooth": self.system.smooth, "parts": bool(self.parts), "kinetic": kinetic}
        return frozenset(word for word, is_offered in words.items() if is_offered)

    @cached_property
    def is_top(self) -> bool:
        """Whether H is |J|²/2 + U(t, x)."""
        return is_top(self.parts, self.numbers)

    @cached_property
    def quadratic(self) -> bool:
        """Whether H is of degree 2 at most, in t and y together."""
        return all(are_affine(self.system.gradient, self.numbers))

    @cached_property
    def alpha_and_rest(self) -> tuple[float, System]:
        """alpha and the system of V, for H = |J|²/2 + alpha x3 + V(t, x). alpha is the sum of all constant factors of x3."""
        weight, rest = weight_and_rest(self.parts, len(self.numbers))
        V = make_system(self.space, rest, constant=self.system.constant)
        return float(weight(*(0.0,) * 7, *self.numbers)[0]), V

    def check_state(self, y: Any, name: str = "y0") -> Array:
        """A state of any shape with n numbers as a fresh array (n,). ValueError: it is no state, or H or y' is not finite."""
        state = check_numbers(y, name, self.space.size)
        if not np.isfinite((self.energy(state), *self.rhs(state))).all():
            raise ValueError(f"{name}: the problem {self.name} is not finite at {state.tolist()}")
        return state

    # ------------------------------------------------------------------ functions of states (..., n) and of times since the start

    def rhs(self, y: ArrayLike, t: Any = 0.0) -> Array:
        """Time derivative of states (..., n)."""
        return self._values(self.system.rhs, y, t)

    def jacobian(self, y: ArrayLike, t: float = 0.0) -> Array:
        """Derivative of `rhs`, shape (n, n), at one state (n,)."""
        self.require_single()
        n = self.system.size
        return self._values(self.system.jacobian, y, t).reshape(n, n).T

    def poisson(self, y: ArrayLike) -> Array:
        """The tensor P (n, n) with {f, g} = ∇f·P∇g and y' = P(y) ∇H at one state (n,)."""
        product, space, numbers = cross_in(self.system.body), self.space, np.asarray(y).tolist()
        return np.array([space.flow(e, numbers, product) for e in np.eye(space.size).tolist()], dtype=float).T

    def invariants(self, y: ArrayLike, t: Any = 0.0) -> Array:
        """Values of `names` at states (..., n) and times (...), whether they are conserved or not; shape (..., len(names))."""
        return self._values(self._invariants, y, t)

    @property
    def _invariants(self) -> Program:
        return invariants_of(self.system, self.names, self.extra_invariants)

    def gradients(self, y: ArrayLike, t: float = 0.0) -> Array:
        """Gradients of `names` as rows, at one state (n,)."""
        self.require_single()
        slopes = gradients_of(self.system, self._invariants)
        return self._values(slopes, y, t).reshape(len(self.names), self.system.size)

    def force(self, y: ArrayLike, t: Any = 0.0) -> Array:
        """∂H/∂x at states (..., 6) of e3, shape (..., 3)."""
        return self._values(self.system.gradient, y, t)[..., 3:]

    def require_single(self) -> Any:
        """ValueError if a parameter is an array, with a number for each of many motions."""

    def motion(self, place: int) -> Problem:
        """The problem of one of many motions, with its own numbers."""
        return self

    @property
    def vectors(self) -> tuple[int, ...]:
        """The number of components of each vector of a state."""
        zeros = [0.0] * self.system.size
        return tuple(len(vector) for _, vector in self.space.rotations(zeros, zeros))

    @cached_property
    def _single(self) -> bool:
        """Whether each parameter is one number."""
        return all(isinstance(v, float) for v in self.arguments)

    def _values(self, program: Program, y: ArrayLike, t: Any) -> Array:
        states, n = np.asarray(y, dtype=float), self.space.size
        if states.shape[-1:] != (n,):
            raise ValueError(f"y must be states of {n} numbers, shape (..., {n}); got shape {states.shape}")
        if states.ndim == 1 and isinstance(t, float) and self._single:  # plain numbers are several times as quick
            with suppress(ZeroDivisionError):  # arrays have an infinity there
                return np.array(program(self.start + t, *states.tolist(), *self.numbers), dtype=float)
        with np.errstate(all="ignore"):
            components = [states[..., i] for i in range(n)]
            values = program(np.float64(self.start) + t, *components, *map(np.float64, self.arguments))
        out = np.empty((*states.shape[:-1], len(values)))
        for i, value in enumerate(values):
            out[..., i] = value
        return out

    def energy(self, y: ArrayLike, t: Any = 0.0) -> Any:
        """H of states (..., n), at times t since the start."""
        return self._values(self.system.energy, y, t)[..., 0]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The invariants: H, unless it depends on t, Casimir functions, and the names in the argument `invariants`."""
        energy = () if self.timed else ("H",)
        return (*energy, *self.space.casimir_names, *(name for name, _ in self.extra_invariants))

    @property
    def conserved(self) -> frozenset[str]:
        """`names`, as a set."""
        return frozenset(self.names)

    def sizes(self, y: ArrayLike) -> Array:
        """The scale for errors of each component of one state (n,): the length of its vector.

        On e3, J has √(|∂H/∂x||x|) more: the force adds as much to J within the time scale of the motion. On "body" so has L.
        """
        vectors = [vector for _, vector in self.space.rotations(np.zeros(self.space.size), np.asarray(y, dtype=float))]
        lengths = np.array([np.linalg.norm(vector[None], axis=1)[0] for vector in vectors])
        if self.space.affine:
            lengths[0] += math.sqrt(float(np.linalg.norm(self.force(y))) * lengths[1])
        elif self.space.momenta.start:
            at_rest = np.concatenate((vectors[0], np.zeros(3)))
            torque, lightness = self.rhs(at_rest)[4:], np.linalg.norm(self.jacobian(at_rest)[:4, 4:], 2)
            lengths[1] += math.sqrt(float(np.linalg.norm(torque) / lightness) * lengths[0] / 2) if lightness else 0.0
        return np.repeat(lengths, [len(vector) for vector in vectors])

    def scales(self, y: ArrayLike) -> tuple[float, float, float]:
        """Scales of momenta, x (1 without x) and time, at one state (n,). The time is inf for a state that stays at rest.

        1/time is the largest rate at which a vector turns, or the largest rate of the linearised motion if this is larger.
        """
        sizes, slopes = self.sizes(y), self._values(self.system.gradient, y, 0.0)
        omegas = np.array([omega for omega, _ in self.space.rotations(slopes, sizes)])
        fastest = np.max(np.abs(np.linalg.eigvals(self.jacobian(y))))
        rate = float(max(np.max(np.linalg.norm(omegas, axis=1)), fastest))
        momenta, x = float(np.max(sizes[self.space.momenta])), float(sizes[-1]) if self.space.affine else 1.0
        return momenta, x, 1.0 / rate if rate else math.inf

    def invariant_scales(self, y: ArrayLike) -> Array:
        """Sizes of the terms of the invariants `names` at one state, for relative drift and ulps."""
        return np.maximum(np.abs(self.gradients(y)) @ self.sizes(y), np.abs(self.invariants(y)))

    def conserved_by(self, method: Any) -> frozenset[str]:
        """The invariants of `names` that a method conserves up to round-off, derived from its claims for tops.

        A method that conserves C1 and C2 conserves all Casimir functions. A method that conserves J3 conserves every constant
        component, but a splitting does so only if all parts conserve it. A method that conserves H in quadratic fields conserves
        all quadratic functions. Other words of a claim are names of the problem's own invariants.
        """
        conserves = method.claims.conserves
        if method.needs in ("body", "uniform"):  # "uniform": some of these methods take symmetric bodies
            return frozenset(conserves & self.conserved)
        casimirs = frozenset(self.space.casimir_names)
        conserved = (conserves - {"H", "J3", "C1", "C2"}) & self.conserved
        conserved |= casimirs if {"C1", "C2"} <= conserves else frozenset()
        if "J3" in conserves:
            splits = method.needs in ("parts", "kinetic") and (self.timed or not self.is_top)
            flows = [part.flow.outputs for part in self.parts] if splits else []
            for name, program in self.extra_invariants:
                (place,) = program.outputs
                if self._is_component(place) and all(flow[place - 1] == place for flow in flows):
                    conserved |= {name}
        if "H" in conserves:
            conserved |= {"H"} & self.conserved
        return conserved | self._quadratic if "H" in method.claims.conserves_if_quadratic else conserved

    @cached_property
    def _quadratic(self) -> frozenset[str]:
        """The invariants of `names` that are of degree 2 at most, in t and y together."""
        slopes, count = gradients_of(self.system, self._invariants, by_time=True), 1 + self.space.size
        affine = are_affine(slopes, self.numbers)
        return frozenset(name for i, name in enumerate(self.names) if all(affine[i * count : (i + 1) * count]))

    # ------------------------------------------------------------------ checks of the arguments, at random states

    def _check_invariants(self) -> None:
        """ValueError if {I, H} + ∂I/∂t of an invariant I is more than round-off."""
        t, *y = random_states(1 + self.space.size).T
        states = np.transpose(y)
        turning = np.linalg.norm(self._values(self.system.gradient, states, t), axis=1)
        for word, program in self.extra_invariants:
            by_t, *by_y = self._values(gradients_of(self.system, program, by_time=True), states, t).T
            across = np.transpose(by_y)
            change = by_t + np.sum(across * self.rhs(states, t), axis=1)
            term = np.linalg.norm(across, axis=1) * turning * np.linalg.norm(states, axis=1)
            if not vanish(change[:, None], np.column_stack((by_t, term))):
                raise ValueError(f"problem {self.name}: invariants[{word!r}] is not conserved at some states")
