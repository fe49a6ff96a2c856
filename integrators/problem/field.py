"""A potential V(x) of the axis x, and the formulas made from it: what methods compile.

A `Potential` is V with the names of its parameters. V is an ordinary Python function of + − × ÷, whole and half powers,
`sqrt`, `sin`, `cos`, `exp` and `log`. It is recorded once (`compiling.tape`) as a `Formula`: so the same formula serves
floats, mpmath, heyoka and the compiled kernels. A `Field` is alpha x3 + V with all derivatives, made from what was recorded.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import Tape, Term, record_own
from lagrange_bench.integrators.problem.symmetry import remainder

SAME = 1e-8  # relative difference between a gradient that is given and the one that is derived
Vector = tuple[Any, Any, Any]


class Potential:
    """A potential V(x1, x2, x3, p) of the axis x, p a tuple of parameters.

    Parameters
    ----------
    name : str
        What messages and tables call it.
    value : callable
        (x1, x2, x3, p) → V, in the units of |J|².
    gradient : callable, optional
        (x1, x2, x3, p) → (∂V/∂x1, ∂V/∂x2, ∂V/∂x3); by default it is derived. It is compared with the derived one, see `symmetry`.
    parameters : sequence of str, optional
        Names of the parameters; by default a top may give any number of them.
    note : str
        What the potential stands for, in a line.

    Raises
    ------
    ValueError
        From `formula` and from `PerturbedTop`, for a function that is no such formula, or a gradient that is not V's.
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
        for word, function in (("value", value), ("gradient", gradient)):
            if not callable(function) and not (word == "gradient" and function is None):
                raise ValueError(f"potential {name}: {word} must be a function of (x1, x2, x3, p); got {function!r}")
        self.name, self.value, self.given, self.note = name, value, gradient, note
        if parameters is not None:
            listed = isinstance(parameters, Iterable) and not isinstance(parameters, str)
            if not listed or not all(isinstance(word, str) and word for word in parameters):
                raise ValueError(f"potential {name}: parameters must be a sequence of names; got {parameters!r}")
        self.parameters = None if parameters is None else tuple(parameters)
        self._formulas: dict[int, Formula] = {}

    def __repr__(self) -> str:
        return f"Potential({self.name!r})"

    def __getstate__(self) -> dict[str, Any]:
        # functions typed at a prompt cannot be pickled, what was recorded of them can
        return {**self.__dict__, "value": None, "given": None}

    def formula(self, count: int) -> Formula:
        """V and its gradient with `count` parameters, recorded. ValueError if that cannot be done."""
        if self.parameters is not None and count != len(self.parameters):
            names = ", ".join(self.parameters)
            needed = f"{len(self.parameters)} numbers ({names})"
            raise ValueError(f"parameters of the potential {self.name}: {needed}; got {count}")
        if count not in self._formulas:
            value = self._record("value", self.value, count, 1)
            given = None if self.given is None else self._record("gradient", self.given, count, 3)
            formula = Formula(value, given)
            if not formula.gradient_error <= SAME:
                raise ValueError(f"potential {self.name}: gradient is not the derivative of value")
            self._formulas[count] = formula
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


@dataclass(frozen=True)
class Formula:
    """V as a program of (x1, x2, x3, *p), and its gradient if one was given."""

    value: Program
    given: Program | None = None

    def slopes(self, tape: Tape, x: Sequence[Term], p: Sequence[Term]) -> tuple[Term, ...]:
        """∇V on a tape: as it was given, or derived."""
        return tape.run(self.given or self.derived, *x, *p)

    @cached_property
    def field(self) -> Field:
        """The field of alpha x3 + V."""
        tape, x, (alpha, *p) = _inputs(self.value.inputs - 2)
        (V,) = tape.run(self.value, *x, *p)
        g1, g2, g3 = self.slopes(tape, x, p)
        return Field(tape.program((alpha * x[2] + V,)), tape.program((g1, g2, g3 + alpha)))

    @cached_property
    def perturbation(self) -> Field:
        """The field of V alone, with the same inputs."""
        tape, x, (_, *p) = _inputs(self.value.inputs - 2)
        return Field(tape.program(tape.run(self.value, *x, *p)), tape.program(self.slopes(tape, x, p)))

    @property
    def gradient_error(self) -> float:
        """By how much a gradient that was given differs from the derived one, relative to its terms."""
        if self.given is None:
            return 0.0
        tape, x, p = _inputs(self.value.inputs - 3)
        pairs = zip(*(tape.run(program, *x, *p) for program in (self.given, self.derived)), strict=True)
        differences = tape.program(given - derived for given, derived in pairs)
        return remainder(differences)

    @cached_property
    def derived(self) -> Program:
        """The gradient of V, derived."""
        tape, x, p = _inputs(self.value.inputs - 3)
        return tape.program(tape.gradient(tape.run(self.value, *x, *p)[0], x))


@dataclass(frozen=True)
class Field:
    """U = alpha x3 + V and its gradient g, programs of (x1, x2, x3, alpha, *p), and what follows from them."""

    potential: Program
    gradient: Program

    @property
    def parameters(self) -> int:
        """How many numbers follow x: alpha and those of V."""
        return self.potential.inputs - 3

    def _made(self, outputs: Callable[..., Iterable[Any]]) -> Program:
        """A program of x and the parameters, from x and g."""
        tape, x, q = _inputs(self.parameters)
        return tape.program(outputs(tape, x, tape.run(self.gradient, *x, *q)))

    @cached_property
    def torque(self) -> Program:
        """g × x, by which J changes."""
        return self._made(lambda tape, x, g: cross(g, x))

    @cached_property
    def commutator_torque(self) -> Program:
        """The torque of W = |x × g|², which the commutator [B,[A,B]] of kick and rotation amounts to."""
        return self._made(lambda tape, x, g: cross(_twist(tape, x, g)[1], x))

    @cached_property
    def second_commutator_torque(self) -> Program:
        """The torque of ∇W·(N × x), N = x × g, which [B,[B,[A,[A,B]]]] amounts to."""

        def outputs(tape: Tape, x: Vector, g: Vector) -> Vector:
            N, slope = _twist(tape, x, g)
            return cross(tape.gradient(dot(slope, cross(N, x)), x), x)

        return self._made(outputs)

    @cached_property
    def digest(self) -> str:
        """Identity of the formula, hexadecimal."""
        return hashlib.sha256((self.potential.digest + self.gradient.digest).encode()).hexdigest()[:16]

    def __hash__(self) -> int:
        return hash(self.digest)


def _inputs(parameters: int) -> tuple[Tape, tuple[Term, ...], tuple[Term, ...]]:
    tape = Tape()
    return tape, tuple(tape.input() for _ in range(3)), tuple(tape.input() for _ in range(parameters))


def cross(a: Any, b: Any) -> Vector:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def cross_in(body: bool) -> Callable[[Any, Any], Vector]:
    """a × b; in the frame of the body b × a, for the bracket has the other sign there."""
    return (lambda a, b: cross(b, a)) if body else cross


def dot(a: Any, b: Any) -> Any:
    """a·b."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def _twist(tape: Tape, x: Vector, g: Vector) -> tuple[Vector, Vector]:
    """N = x × g and ∇|N|² = 2 (g × N + U'' (N × x))."""
    N = cross(x, g)
    bend = tape.along(g, x, cross(N, x))
    return N, tuple(2.0 * (a + b) for a, b in zip(cross(g, N), bend, strict=True))  # type: ignore[return-value]
