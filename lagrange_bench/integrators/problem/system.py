"""Phase spaces and Hamiltonians as formulas, from which kernels are made.

A `Space` consists of vectors in three dimensions, with a Lie-Poisson bracket. In the rest frame this is the bracket of the top
(`top`):

    e3      J' = ∂H/∂J × J + ∂H/∂x × x,   x' = ∂H/∂J × x         Casimirs |x|² and x·J
    so3     J' = ∂H/∂J × J                                        |J|²
    so3**n  the same for each of n spins                          |s_j|²
    body    q' = ω q/2,   L' = ω × L + (g0 q − q0 g + g × q)/2,   ω = ∂H/∂L, (g0, g) = ∂H/∂q      |q|²

The state of a whole body has seven numbers: the quaternion q that turns its frame to the world's, and its angular momentum L. In
the frame of the body the bracket has the other sign: q' = q ω/2, and L has components along the body's axes.

A `System` is a space with H(t, y, p). Its right-hand side, its Jacobian and the formulas of kernels are recorded on a `Tape`.

Source: Marsden & Ratiu, Introduction to Mechanics and Symmetry (1999), chapters 13 and 14.
"""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import Tape, Term
from lagrange_bench.integrators.problem.vectors import Vector, cross, cross_in, dot


@dataclass(frozen=True)
class Space:
    """`vectors` momenta in three dimensions. If `affine` (e3), the second vector is x, on which the first acts."""

    name: str
    vectors: int
    affine: bool = False

    @property
    def size(self) -> int:
        """The length n of a state."""
        return 3 * self.vectors

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the numbers of a state."""
        if self.affine:
            return "J1", "J2", "J3", "x1", "x2", "x3"
        if self.vectors == 1:
            return "J1", "J2", "J3"
        return tuple(f"s{j}_{i}" for j in range(1, self.vectors + 1) for i in (1, 2, 3))

    @property
    def momenta(self) -> slice:
        """The places of the momenta in a state; of several spins only the first."""
        return slice(0, 3)

    def rotations(self, g: Any, y: Any) -> list[tuple[Any, Any]]:
        """Pairs of angular velocity and vector: how each vector of y turns if g is ∇H."""
        return [(g[:3] if self.affine else g[i : i + 3], y[i : i + 3]) for i in range(0, self.size, 3)]

    def flow(self, g: Any, y: Any, turn: Callable[..., Any] = cross, scale: Any = 1.0) -> tuple[Any, ...]:
        """P(y) g, the rate of y if g is ∇H.

        turn : the product of vectors of g and y, if it is not g × y. scale : a factor of all other products of g and y.
        """
        if self.affine:
            of_first, of_second = turn(g[:3], y[:3]), turn(g[3:], y[3:])
            return *(a + b for a, b in zip(of_first, of_second, strict=True)), *turn(g[:3], y[3:])
        parts = [turn(g[i : i + 3], y[i : i + 3]) for i in range(0, self.size, 3)]
        return tuple(rate for part in parts for rate in part)

    def casimirs(self, y: Sequence[Any]) -> dict[str, Any]:
        """Name → Casimir function: every Hamiltonian conserves it."""
        if self.affine:
            return {"C1": dot(y[3:], y[3:]), "C2": dot(y[3:], y[:3])}
        squares = [dot(y[i : i + 3], y[i : i + 3]) for i in range(0, self.size, 3)]
        return {"C" if len(squares) == 1 else f"C{j}": square for j, square in enumerate(squares, 1)}

    @property
    def casimir_names(self) -> tuple[str, ...]:
        """The names of the Casimir functions."""
        return tuple(self.casimirs(range(self.size)))


@dataclass(frozen=True)
class BodySpace(Space):
    """A quaternion, scalar first, and one momentum."""

    @property
    def size(self) -> int:
        return 7

    @property
    def columns(self) -> tuple[str, ...]:
        return "q0", "q1", "q2", "q3", "L1", "L2", "L3"

    @property
    def momenta(self) -> slice:
        return slice(4, 7)

    def rotations(self, g: Any, y: Any) -> list[tuple[Any, Any]]:
        return [(g[4:], y[:4]), (g[4:], y[4:])]

    def flow(
        self, g: Any, y: Any, turn: Callable[..., Any] = cross, scale: Any = 1.0, relative: Any = None
    ) -> tuple[Any, ...]:
        """See `Space.flow`. relative : replaces ∂H/∂L in L', from which it differs by a multiple of L: this changes no L."""
        scalar, q = 0.5 * y[0], [0.5 * v for v in y[1:4]]
        (g0, *gq), omega = (scale * v for v in g[:4]), [scale * v for v in g[4:]]
        along = [scalar * w + v for w, v in zip(omega, turn(g[4:], q), strict=True)]
        spin, pull = turn(relative or g[4:], y[4:]), turn(g[1:4], q)  # pull = −q × g/2
        torque = [g0 * v - scalar * w + u for v, w, u in zip(q, gq, pull, strict=True)]
        return -dot(omega, q), *along, *(a + b for a, b in zip(spin, torque, strict=True))

    def casimirs(self, y: Sequence[Any]) -> dict[str, Any]:
        return {"C1": dot(y[1:4], y[1:4]) + y[0] * y[0]}


E3, SO3, BODY = Space("e3", 2, affine=True), Space("so3", 1), BodySpace("body", 1)


def find_space(space: Any) -> Space:
    """The space of a name: "e3", "so3", "body", or n for n spins. ValueError for anything else."""
    if type(space) is int and 0 < space < 100:
        return Space(f"so3**{space}", space) if space > 1 else SO3
    for known in (E3, SO3, BODY):
        if space == known.name:
            return known
    raise ValueError(f"space must be 'e3', 'so3', 'body' or a number of spins; got {space!r}")


@dataclass(frozen=True)
class System:
    """H(t, y, p) on a space, recorded. The inputs of all programs are t, the numbers of y and the numbers of p.

    gradient : ∂H/∂y. body : whether the bracket is that of the body's frame. constant : components of y that the motion keeps, as
    `symmetry` shows: their rates are 0, not round-off. relative_omega : for a whole body, ∂H/∂L minus a multiple of L, from which
    L' is computed.
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
        """The length n of a state."""
        return self.space.size

    @property
    def parameters(self) -> int:
        """The number of parameters of H."""
        return self.energy.inputs - 1 - self.size

    def slopes(self, tape: Tape, t: Any, y: Sequence[Any], p: Sequence[Any]) -> tuple[Term, ...]:
        """∂H/∂y on a tape."""
        return tape.run(self.gradient, t, *y, *p)

    def rates(self, tape: Tape, t: Any, y: Sequence[Any], p: Sequence[Any], h: Any = 1.0) -> tuple[Term, ...]:
        """h y' on a tape, with products of h and parameters first; 0 for components that the motion keeps."""
        product = cross_in(self.body)

        def turn(a: Sequence[Any], b: Sequence[Any]) -> list[Term]:
            """h a × b, and 0 if a × b vanishes on the tape: (h J) × J does not show that."""
            scaled = product([h * v for v in a], b)
            plain = map(tape.constant, product(a, b))
            return [tape.constant(0.0 if tape.known(v) == 0.0 else w) for v, w in zip(plain, scaled, strict=True)]

        options = {"relative": tape.run(self.relative_omega, t, *y, *p)} if self.relative_omega else {}
        rates = map(tape.constant, self.space.flow(self.slopes(tape, t, y, p), y, turn, h, **options))
        return tuple(tape.constant(0.0) if i in self.constant else rate for i, rate in enumerate(rates))

    def record(self, formula: Callable[..., Iterable[Any]]) -> Program:
        """The program of `formula(tape, t, y, p)`."""
        tape, t, y, p = self._inputs(self.parameters)
        return tape.program(formula(tape, t, y, p))

    def record_step(self, formula: Callable[..., Iterable[Any]]) -> Program:
        """The program of `formula(tape, t, y, h, p)`. The compiler takes products of h and p out of the loop."""
        tape, t, y, (h, *p) = self._inputs(1 + self.parameters)
        return tape.program(formula(tape, t, y, h, p))

    def _inputs(self, numbers: int) -> tuple[Tape, Term, tuple[Term, ...], tuple[Term, ...]]:
        tape = Tape()
        t, y = tape.input(), tuple(tape.input() for _ in range(self.size))
        return tape, t, y, tuple(tape.input() for _ in range(numbers))

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

    # ------------------------------------------------------------------ for |J|²/2 + U(t, x), g = ∂U/∂x: inputs are x, t and p

    def _of_position(self, formula: Callable[[Tape, Any, Any, Any], Iterable[Any]]) -> Program:
        """The program of `formula(tape, t, x, p)`."""
        tape = Tape()
        x, t = tuple(tape.input() for _ in range(3)), tape.input()
        return tape.program(formula(tape, t, x, [tape.input() for _ in range(self.parameters)]))

    def _of_force(self, formula: Callable[[Tape, Any, Any], Iterable[Any]]) -> Program:
        """The program of `formula(tape, x, g)`."""
        return self._of_position(lambda tape, t, x, p: formula(tape, x, self.force(tape, t, x, p)))

    def force(self, tape: Tape, t: Any, x: Sequence[Any], p: Sequence[Any]) -> tuple[Term, ...]:
        """g on a tape."""
        return self.slopes(tape, t, (*(0.0,) * 3, *x), p)[3:]

    @cached_property
    def potential(self) -> Program:
        """U."""
        return self._of_position(lambda tape, t, x, p: tape.run(self.energy, t, *(0.0,) * 3, *x, *p))

    @cached_property
    def torque(self) -> Program:
        """g × x, the rate of J."""
        return self._of_force(lambda tape, x, g: cross(g, x))

    @cached_property
    def commutator_torque(self) -> Program:
        """∇W × x, the torque of W = |x × g|², the commutator [B,[A,B]] of kick and rotation."""
        return self._of_force(lambda tape, x, g: cross(_gradient_of_W(tape, x, g)[1], x))

    @cached_property
    def second_commutator_torque(self) -> Program:
        """The torque of ∇W·(N × x), N = x × g, the commutator [B,[B,[A,[A,B]]]]."""

        def torque(tape: Tape, x: Vector, g: Vector) -> Vector:
            N, slope = _gradient_of_W(tape, x, g)
            return cross(tape.gradient(dot(slope, cross(N, x)), x), x)

        return self._of_force(torque)

    @cached_property
    def timed(self) -> bool:
        """Whether H depends on t."""
        return depends(self.energy, [0]) or depends(self.gradient, [0])

    @cached_property
    def smooth(self) -> bool:
        """Whether H has a Taylor series wherever it is finite: it has no √(w²) with w of either sign."""
        return not self.energy.corners(1 + self.size)


def _gradient_of_W(tape: Tape, x: Vector, g: Vector) -> tuple[Vector, Vector]:
    """N = x × g and ∇W = ∇|N|² = 2 (g × N + U'' (N × x))."""
    N = cross(x, g)
    change = tape.along(g, x, cross(N, x))
    return N, tuple(2.0 * (a + b) for a, b in zip(cross(g, N), change, strict=True))


@lru_cache(maxsize=256)
def invariants_of(system: System, names: tuple[str, ...], extra: tuple[tuple[str, Program], ...]) -> Program:
    """The values of invariants, each H, a Casimir function, J3 of a top, or one of `extra`."""

    def values(tape: Tape, t: Any, y: Any, p: Any) -> list[Any]:
        known = {"H": tape.run(system.energy, t, *y, *p)[0], "J3": y[2], **system.space.casimirs(y)}
        known |= {name: tape.run(program, t, *y, *p)[0] for name, program in extra}
        return [known[name] for name in names]

    return system.record(values)


@lru_cache(maxsize=256)
def gradients_of(system: System, program: Program, by_time: bool = False) -> Program:
    """The gradients of all outputs of a program of (t, y, p), one after the other; with `by_time` each begins with ∂/∂t."""

    def gradients(tape: Tape, t: Any, y: Any, p: Any) -> list[Any]:
        variables = (t, *y) if by_time else y
        return [slope for value in tape.run(program, t, *y, *p) for slope in tape.gradient(value, variables)]

    return system.record(gradients)


def depends(program: Program, inputs: Iterable[int]) -> bool:
    """Whether an output depends on one of the inputs."""
    reached = set(inputs)
    for place, (_, *arguments) in enumerate(program.lines, program.inputs):
        if reached.intersection(a for a in arguments if isinstance(a, int)):
            reached.add(place)
    return bool(reached.intersection(o for o in program.outputs if isinstance(o, int)))


def make_system(space: Space, energy: Program, *, body: bool = False, constant: Iterable[int] = ()) -> System:
    """The system of H(t, y, p) = `energy`, with a derived gradient."""
    tape = Tape()
    inputs = [tape.input() for _ in range(energy.inputs)]
    gradient = tape.gradient(tape.run(energy, *inputs)[0], inputs[1 : 1 + space.size])
    return System(space, energy, tape.program(gradient), body, frozenset(constant))


@lru_cache(maxsize=256)
def top_system(V: Program, constant: frozenset[int] = frozenset()) -> System:
    """|J|²/2 + alpha x3 + V(x) on e3, from a program V of (x, *p); the parameters are alpha and p."""
    return _with_potential(V, constant, lambda J, x, alpha, value: dot(J, J) / 2.0 + (alpha * x[2] + value))


@lru_cache(maxsize=256)
def potential_system(V: Program, constant: frozenset[int] = frozenset()) -> System:
    """V(x) alone, with the inputs of `top_system`."""
    return _with_potential(V, constant, lambda J, x, alpha, value: value)


def _with_potential(V: Program, constant: frozenset[int], energy: Callable[..., Any]) -> System:
    """The system of H = `energy(J, x, alpha, V)` on e3."""
    tape = Tape()
    _, *J = (tape.input() for _ in range(4))
    x, alpha = [tape.input() for _ in range(3)], tape.input()
    p = [tape.input() for _ in range(V.inputs - 3)]
    (value,) = tape.run(V, *x, *p)
    return make_system(E3, tape.program((energy(J, x, alpha, value),)), constant=constant)


@cache
def uniform_system() -> System:
    """|J|²/2 + alpha x3, the Lagrange top."""
    return top_system(Program(3, (), (("=", 0.0),)), frozenset({2}))
