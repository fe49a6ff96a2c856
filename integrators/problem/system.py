"""Phase spaces and Hamiltonians as formulas: what kernels are made from.

A `Space` consists of vectors in three dimensions, with a Lie-Poisson bracket. In the rest frame, where the bracket is that of
the top (`top`),

    e3      J' = ∂H/∂J × J + ∂H/∂x × x,   x' = ∂H/∂J × x         Casimirs |x|² and x·J
    so3     J' = ∂H/∂J × J                                        |J|²
    so3**n  the same for each of n spins                          |s_j|²
    body    q' = ω q/2,   L' = ω × L + (g0 q − q0 g + g × q)/2,   ω = ∂H/∂L, (g0, g) = ∂H/∂q      |q|²

The whole body, seven numbers, is the quaternion q that turns its frame to that of the world, and its angular momentum L.
In the frame of the body the bracket has the other sign; there q' = q ω/2, and L has components along the body's axes. A
`System` is a space with H(t, y, p): its right-hand side, Jacobian and the formulas of kernels are recorded on a `Tape`.

Source: Marsden & Ratiu, Introduction to Mechanics and Symmetry (1999), chapters 13 and 14.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import Split, Tape, Term
from lagrange_bench.integrators.problem.field import cross, cross_in, dot


@dataclass(frozen=True)
class Space:
    """So many momenta in three dimensions; of e3 the second vector is x, on which the first acts."""

    name: str
    vectors: int
    affine: bool = False

    @property
    def size(self) -> int:
        """How many numbers a state has."""
        return 3 * self.vectors

    @property
    def momenta(self) -> slice:
        """Where the momenta are, of several spins the first."""
        return slice(0, 3)

    def rotations(self, g: Any, y: Any) -> list[tuple[Any, Any]]:
        """The vectors of y, each with the angular velocity at which it turns if g is ∇H."""
        return [(g[:3] if self.affine else g[i : i + 3], y[i : i + 3]) for i in range(0, self.size, 3)]

    def flow(self, g: Any, y: Any, turn: Callable[..., Any] = cross, scale: Any = 1.0) -> tuple[Any, ...]:
        """P(y) g, by which y changes if g is ∇H; with a product `turn` of vectors of g and y other than g × y.

        scale : a factor of all other products of g and y.
        """
        if self.affine:
            own, other = turn(g[:3], y[:3]), turn(g[3:], y[3:])
            return *(a + b for a, b in zip(own, other, strict=True)), *turn(g[:3], y[3:])
        parts = [turn(g[i : i + 3], y[i : i + 3]) for i in range(0, self.size, 3)]
        return tuple(rate for part in parts for rate in part)

    def casimirs(self, y: Sequence[Any]) -> dict[str, Any]:
        """What every Hamiltonian keeps."""
        if self.affine:
            return {"C1": dot(y[3:], y[3:]), "C2": dot(y[3:], y[:3])}
        squares = [dot(y[i : i + 3], y[i : i + 3]) for i in range(0, self.size, 3)]
        return {"C" if len(squares) == 1 else f"C{j}": square for j, square in enumerate(squares, 1)}


@dataclass(frozen=True)
class BodySpace(Space):
    """A quaternion, scalar first, and one momentum."""

    @property
    def size(self) -> int:
        return 7

    @property
    def momenta(self) -> slice:
        return slice(4, 7)

    def rotations(self, g: Any, y: Any) -> list[tuple[Any, Any]]:
        return [(g[4:], y[:4]), (g[4:], y[4:])]

    def flow(
        self, g: Any, y: Any, turn: Callable[..., Any] = cross, scale: Any = 1.0, relative: Any = None
    ) -> tuple[Any, ...]:
        """See `Space.flow`; `relative`: ∂H/∂L but for a multiple of L, which turns no L."""
        scalar, q = 0.5 * y[0], [0.5 * v for v in y[1:4]]
        (g0, *gq), omega = (scale * v for v in g[:4]), [scale * v for v in g[4:]]
        along = [scalar * w + v for w, v in zip(omega, turn(g[4:], q), strict=True)]
        own, pull = turn(relative or g[4:], y[4:]), turn(g[1:4], q)  # of which the second is −q × g/2
        torque = [g0 * v - scalar * w + u for v, w, u in zip(q, gq, pull, strict=True)]
        return -dot(omega, q), *along, *(a + b for a, b in zip(own, torque, strict=True))

    def casimirs(self, y: Sequence[Any]) -> dict[str, Any]:
        return {"C1": dot(y[1:4], y[1:4]) + y[0] * y[0]}


E3, SO3, BODY = Space("e3", 2, affine=True), Space("so3", 1), BodySpace("body", 1)


def find_space(space: Any) -> Space:
    """A space by its name: "e3", "so3", "so3**n", "body"; n alone stands for n spins. ValueError for anything else."""
    spins = re.fullmatch(r"so3\*\*([1-9]\d?)", space) if isinstance(space, str) else None
    if spins or (type(space) is int and 0 < space < 100):
        n = int(spins[1]) if spins else int(space)
        return Space(f"so3**{n}", n) if n > 1 else SO3
    for known in (E3, SO3, BODY):
        if isinstance(space, str) and space == known.name:
            return known
    raise ValueError(f"space must be 'e3', 'so3', 'so3**n', 'body' or a number of spins; got {space!r}")


@dataclass(frozen=True)
class System:
    """H(t, y, p) on a space, recorded; inputs of all programs are t, the numbers of y, those of p.

    gradient : ∂H/∂y, if it is not to be derived. constant : components of y that the motion keeps, as `symmetry` shows: their
    rates are 0, not round-off. body : the bracket is that of the body's frame. relative_omega : of a whole body ∂H/∂L minus a
    multiple of L, from (t, y, p): it alone turns L.
    """

    space: Space
    energy: Program
    gradient: Program
    body: bool = False
    constant: frozenset[int] = frozenset()
    relative_omega: Program | None = None

    @cached_property
    def digest(self) -> str:
        """Identity of the formulas, hexadecimal."""
        words: tuple[Any, ...] = (
            self.space.name,
            self.energy.digest,
            self.gradient.digest,
            self.body,
            sorted(self.constant),
        )
        words += (self.relative_omega.digest,) if self.relative_omega else ()
        return hashlib.sha256(repr(words).encode()).hexdigest()[:16]

    def __hash__(self) -> int:
        return hash(self.digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, System) and self.digest == other.digest

    @property
    def size(self) -> int:
        """How many numbers a state has."""
        return self.space.size

    @property
    def parameters(self) -> int:
        """How many parameters H has."""
        return self.energy.inputs - 1 - self.size

    def slopes(self, tape: Tape, t: Any, y: Sequence[Any], p: Sequence[Any]) -> tuple[Term, ...]:
        """∂H/∂y on a tape."""
        return tape.run(self.gradient, t, *y, *p)

    def rates(self, tape: Tape, t: Any, y: Sequence[Any], p: Sequence[Any], h: Any = 1.0) -> tuple[Term, ...]:
        """h times the right-hand side on a tape, products of h and parameters first; 0 where the motion keeps y."""
        product = cross_in(self.body)

        def turn(a: Sequence[Any], b: Sequence[Any]) -> list[Term]:
            """h a × b, nothing where a × b vanishes: (h J) × J would not show it."""
            scaled = product([h * v for v in a], b)
            plain = map(tape.constant, product(a, b))
            return [tape.constant(0.0 if tape.known(v) == 0.0 else w) for v, w in zip(plain, scaled, strict=True)]

        more = {"relative": tape.run(self.relative_omega, t, *y, *p)} if self.relative_omega else {}
        rates = map(tape.constant, self.space.flow(self.slopes(tape, t, y, p), y, turn, h, **more))
        return tuple(tape.constant(0.0) if i in self.constant else rate for i, rate in enumerate(rates))

    def record(self, formula: Callable[..., Iterable[Any]]) -> Program:
        """The program of `formula(tape, t, y, p)`."""
        tape, t, y, p = self._inputs(fixed=False)
        return tape.program(formula(tape, t, y, p))

    def split(self, formula: Callable[..., Iterable[Any]]) -> Split:
        """`formula(tape, t, y, h, p)` with all products of h and p taken out: fixed inputs are h and p."""
        tape, t, y, p = self._inputs(fixed=True)
        return tape.split(formula(tape, t, y, p[0], p[1:]))

    def _inputs(self, fixed: bool) -> tuple[Tape, Term, tuple[Term, ...], tuple[Term, ...]]:
        tape = Tape()
        t, y = tape.input(), tuple(tape.input() for _ in range(self.size))
        return tape, t, y, tuple(tape.input(fixed) for _ in range(self.parameters + fixed))

    @cached_property
    def rhs(self) -> Program:
        """y'."""
        return self.record(self.rates)

    @cached_property
    def jacobian(self) -> Program:
        """The columns ∂y'/∂y_k, one after the other."""

        def columns(tape: Tape, t: Term, y: Sequence[Term], p: Sequence[Term]) -> Iterable[Term]:
            rates = self.rates(tape, t, y, p)
            return (slope for direction in np.eye(self.size).tolist() for slope in tape.along(rates, y, direction))

        return self.record(columns)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """The components that change."""
        return tuple(i for i, rate in enumerate(self.rhs.known) if rate != 0.0)

    @cached_property
    def timed(self) -> bool:
        """Whether H depends on t."""
        return depends(self.energy, [0]) or depends(self.gradient, [0])

    @cached_property
    def smooth(self) -> bool:
        """Whether H has a Taylor series everywhere, except where it is infinite: no roots of squares that change sign."""
        return not self.energy.corners(1 + self.size)


class HasSystem:
    """What every kind of problem says of itself by its formulas; states are arrays (..., n), times count from the start.

    A kind has a `system`, its parameters as `arguments`, and `names` of its invariants, of which `extra` are formulas.
    """

    start = 0.0  # time at the initial state
    extra: tuple[tuple[str, Program], ...] = ()  # invariants with a formula of their own

    if TYPE_CHECKING:  # attributes or properties of each kind

        @property
        def arguments(self) -> tuple[Any, ...]: ...
        @property
        def names(self) -> tuple[str, ...]: ...
        @property
        def system(self) -> System: ...
        @property
        def offers(self) -> frozenset[str]: ...
        @property
        def conserved(self) -> frozenset[str]: ...

    @property
    def formulas(self) -> System:
        """What is evaluated."""
        return self.system

    def require_single(self) -> Any:
        """ValueError if a parameter is an array with a number for each of many motions."""

    def rhs(self, y: ArrayLike, t: Any = 0.0) -> Array:
        """Time derivative of states (..., n)."""
        return self._values(self.formulas.rhs, y, t)

    def jacobian(self, y: ArrayLike, t: float = 0.0) -> Array:
        """Derivative of `rhs`, shape (n, n), at one state (n,)."""
        self.require_single()
        n = self.formulas.size
        return self._values(self.formulas.jacobian, y, t).reshape(n, n).T

    def poisson(self, y: ArrayLike) -> Array:
        """The tensor P (n, n) with {f, g} = ∇f·P∇g and y' = P(y) ∇H at one state (n,)."""
        product, space, numbers = cross_in(self.formulas.body), self.formulas.space, np.asarray(y).tolist()
        return np.array([space.flow(e, numbers, product) for e in np.eye(space.size).tolist()], dtype=float).T

    def invariants(self, y: ArrayLike, t: Any = 0.0) -> Array:
        """Values of `names` at states (..., n) and times (...), whether they are conserved or not; shape (..., len(names))."""
        return self._values(invariants_of(self.formulas, self.names, self.extra), y, t)

    def gradients(self, y: ArrayLike, t: float = 0.0) -> Array:
        """Gradients of `names` as rows, at one state (n,)."""
        self.require_single()
        slopes = slopes_of(self.formulas, self.names, self.extra)
        return self._values(slopes, y, t).reshape(len(self.names), self.formulas.size)

    @property
    def vectors(self) -> tuple[int, ...]:
        """How many numbers each vector of a state has."""
        zeros = [0.0] * self.formulas.size
        return tuple(len(vector) for _, vector in self.formulas.space.rotations(zeros, zeros))

    def _values(self, program: Program, y: ArrayLike, t: Any) -> Array:
        states, n = np.asarray(y, dtype=float), self.formulas.size
        if states.shape[-1:] != (n,):
            raise ValueError(f"y must be states of {n} numbers, shape (..., {n}); got shape {states.shape}")
        with np.errstate(all="ignore"):
            # components of one state are plain numbers, several times as quick as arrays
            components = [states[..., i] for i in range(n)]
            values = program.on_arrays(np.float64(self.start) + t, *components, *map(np.float64, self.arguments))
        out = np.empty((*states.shape[:-1], len(values)))
        for i, value in enumerate(values):
            out[..., i] = value
        return out


@lru_cache(maxsize=256)
def invariants_of(system: System, names: tuple[str, ...], extra: tuple[tuple[str, Program], ...]) -> Program:
    """Values of invariants: H, Casimir functions, J3 of a top, and those of `extra`."""

    def values(tape: Tape, t: Any, y: Any, p: Any) -> list[Any]:
        known = {"H": tape.run(system.energy, t, *y, *p)[0], "J3": y[2], **system.space.casimirs(y)}
        known |= {name: tape.run(program, t, *y, *p)[0] for name, program in extra}
        return [known[name] for name in names]

    return system.record(values)


@lru_cache(maxsize=256)
def slopes_of(system: System, names: tuple[str, ...], extra: tuple[tuple[str, Program], ...]) -> Program:
    """Their gradients, one after the other."""

    def gradients(tape: Tape, t: Any, y: Any, p: Any) -> list[Any]:
        values = tape.run(invariants_of(system, names, extra), t, *y, *p)
        return [slope for value in values for slope in tape.gradient(value, y)]

    return system.record(gradients)


def depends(program: Program, inputs: Iterable[int]) -> bool:
    """Whether an output depends on one of the inputs."""
    reached = set(inputs)
    for place, (_, *arguments) in enumerate(program.lines, program.inputs):
        if reached.intersection(a for a in arguments if isinstance(a, int)):
            reached.add(place)
    return bool(reached.intersection(o for o in program.outputs if isinstance(o, int)))


def make_system(space: Space, energy: Program, *, body: bool = False, constant: Iterable[int] = ()) -> System:
    """The system of H(t, y, p), with its derived gradient."""
    tape = Tape()
    inputs = [tape.input() for _ in range(energy.inputs)]
    gradient = tape.gradient(tape.run(energy, *inputs)[0], inputs[1 : 1 + space.size])
    return System(space, energy, tape.program(gradient), body, frozenset(constant))


@lru_cache(maxsize=256)
def top_system(potential: Program, gradient: Program, conserves_J3: bool) -> System:
    """|J|²/2 + U(x) on e3, of programs U and ∇U of (x, p); `conserves_J3`: the motion keeps J3."""
    tape = Tape()
    tape.input()
    J, x = (tuple(tape.input() for _ in range(3)) for _ in range(2))
    p = [tape.input() for _ in range(potential.inputs - 3)]
    energy = tape.program((dot(J, J) / 2.0 + tape.run(potential, *x, *p)[0],))
    slopes = tape.program((*J, *tape.run(gradient, *x, *p)))
    return System(E3, energy, slopes, constant=frozenset({2} if conserves_J3 else ()))


@cache
def uniform_system() -> System:
    """|J|²/2 + alpha x3, the Lagrange top."""
    tape = Tape()
    x, alpha = [tape.input() for _ in range(3)], tape.input()
    return top_system(tape.program((alpha * x[2],)), tape.program((0.0, 0.0, alpha)), conserves_J3=True)
