"""A symmetric top in a field of your own: H = |J|²/2 + alpha x3 + V(x).

    J' = ∇U(x) × x        x' = J × x        U = alpha x3 + V(x)

on the phase space of `top`, with the same bracket: C1 = |x|² and C2 = x·J stay, whatever V is. J3 stays if V does not
change when x turns about the vertical. In general there is no closed form and no torus, and here an integrator is needed.

A `Potential` is V with the names of its parameters; a `PerturbedTop` is a top in it, with numbers. V is an ordinary Python
function of + − × ÷, whole and half powers, and `sqrt`. It is recorded once (`compiling.expression`): so the same formula serves
floats, mpmath, heyoka and the compiled kernels, and all derivatives are made from it.
"""

from __future__ import annotations

import hashlib
import math
import random
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from itertools import chain, combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from integrators.checks import check_real
from integrators.compiling.compiled import jit_as
from integrators.compiling.expression import Program, Tape, Term, record, take
from integrators.compiling.unroll import unrolled
from integrators.precision import workdps
from integrators.problem.top import Array, LagrangeTop, hat

POINTS = 6  # random points at which two formulas that are not the same are told apart
DIGITS = 50
ROOTS = 6  # at most: each combination of their signs is tried
FAR = (1 / 16, -1 / 4, 4, -4, 16, -16)  # where gradients are compared too: a wall may stand there
SAME = 1e-8  # relative difference between a gradient that is given and the one that is derived
Vector = tuple[Any, Any, Any]
Point = tuple[float, float, float]


class Potential:
    """A potential V(x1, x2, x3, p) of the axis x, p a tuple of parameters.

    Parameters
    ----------
    name : what messages and tables call it. value : (x1, x2, x3, p) → V, in the units of |J|².
    gradient : (x1, x2, x3, p) → (∂V/∂x1, ∂V/∂x2, ∂V/∂x3); by default it is derived. It is compared with the derived one.
    parameters : names of the parameters; by default a top may give any number of them.
    note : what the potential stands for, in a line.

    Raises
    ------
    ValueError : from `formula` and from `PerturbedTop`, for a function of more than + − × ÷, whole and half powers, and sqrt.
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
        self.parameters = None if parameters is None else tuple(parameters)
        self._formulas: dict[int, Formula] = {}

    def __repr__(self) -> str:
        return f"Potential({self.name!r})"

    def formula(self, count: int) -> Formula:
        """V and its gradient with `count` parameters, recorded. ValueError if that cannot be done."""
        if self.parameters is not None and count != len(self.parameters):
            names = ", ".join(self.parameters)
            raise ValueError(
                f"parameters of the potential {self.name}: {len(self.parameters)} numbers ({names}); got {count}"
            )
        if count not in self._formulas:
            value = self._record("value", self.value, count, 1)
            given = None if self.given is None else self._record("gradient", self.given, count, 3)
            self._formulas[count] = Formula(value, given)
        return self._formulas[count]

    def _record(self, word: str, function: Callable[..., Any], count: int, outputs: int) -> Program:
        def plain(*numbers: Term) -> tuple[Any, ...]:
            result = function(*numbers[:3], numbers[3:])
            return tuple(result) if outputs > 1 else (result,)

        try:
            program = record(plain, 3 + count)
        except IndexError as error:
            raise ValueError(f"potential {self.name}: {word} asks for more than {count} parameters ({error})") from None
        except Exception as error:  # somebody else's function may raise anything
            reason = " ".join(str(error).split())  # in one line
            raise ValueError(f"potential {self.name}: {word}(x1, x2, x3, p) fails: {reason}") from None
        if len(program.outputs) != outputs:
            raise ValueError(f"potential {self.name}: {word} must return {outputs} numbers; got {len(program.outputs)}")
        return program


@dataclass(frozen=True)
class Formula:
    """V as a program of (x1, x2, x3, *p), and its gradient if one was given."""

    value: Program
    given: Program | None = None

    @cached_property
    def field(self) -> Field:
        """The field of alpha x3 + V."""
        tape, x, q = _inputs(self.value.inputs - 2)
        (V,) = tape.run(self.value, *x, *q[1:])
        gradient = tape.run(self.given, *x, *q[1:]) if self.given else tape.gradient(V, x)
        return Field(
            tape.program((q[0] * x[2] + V,)),
            tape.program((gradient[0], gradient[1], gradient[2] + q[0])),
        )

    @cached_property
    def perturbation(self) -> Field:
        """The field of V alone, with the same inputs."""
        tape, x, q = _inputs(self.value.inputs - 2)
        (V,) = tape.run(self.value, *x, *q[1:])
        gradient = tape.run(self.given, *x, *q[1:]) if self.given else tape.gradient(V, x)
        return Field(tape.program((V,)), tape.program(gradient))

    @cached_property
    def bends(self) -> Program:
        """(x, p) → ∇V and the nine entries of V''."""
        tape, x, p = _inputs(self.value.inputs - 3)
        g = tape.run(self.derived if self.given is None else self.given, *x, *p)
        columns = [tape.along(g, x, e) for e in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        return tape.program((*g, *(entry for column in columns for entry in column)))

    @cached_property
    def branches(self) -> list[Program] | None:
        """`bends` with other signs of its roots; of those that have a corner if there are many; None if of these, too."""
        for roots in (self.bends.roots(3), self.bends.corners(3)):
            if len(roots) <= ROOTS:
                flips = chain.from_iterable(combinations(roots, n) for n in range(1, len(roots) + 1))
                return [self.bends.branch(flipped) for flipped in flips]
        return None

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

    def _made(self, outputs: Callable[..., Iterable[Any]], vectors: int = 0) -> Program:
        """A program of x, of more vectors, and of the parameters, from x and g."""
        tape = Tape()
        x = [tape.input() for _ in range(3)]
        more = [tuple(tape.input() for _ in range(3)) for _ in range(vectors)]
        q = [tape.input() for _ in range(self.parameters)]
        g = tape.run(self.gradient, *x, *q)
        return tape.program(outputs(tape, x, g, *more))

    @cached_property
    def torque(self) -> Program:
        """g × x, by which J changes."""
        return self._made(lambda tape, x, g: cross(g, x))

    @cached_property
    def hessian_times(self) -> Program:
        """(x, v, q) → U''(x) v."""
        return self._made(lambda tape, x, g, v: tape.along(g, x, v), vectors=1)

    @cached_property
    def torque_along(self) -> Program:
        """(x, v, q) → the derivative of g × x along v."""
        return self._made(lambda tape, x, g, v: tape.along(cross(g, x), x, v), vectors=1)

    @cached_property
    def twist(self) -> Program:
        """The torque of W = |x × g|², which the commutator [B,[A,B]] of kick and rotation amounts to."""
        return self._made(lambda tape, x, g: cross(_twist(tape, x, g)[1], x))

    @cached_property
    def second_twist(self) -> Program:
        """The torque of ∇W·(N × x), N = x × g, which [B,[B,[A,[A,B]]]] amounts to."""

        def outputs(tape: Tape, x: Vector, g: Vector) -> Vector:
            N, slope = _twist(tape, x, g)
            return cross(tape.gradient(dot(slope, cross(N, x)), x), x)

        return self._made(outputs)

    def compiled_rhs(self, first: int = 1) -> Callable[..., Any]:
        """(s, c) → the time derivative of the state s, six numbers, for compiled kernels.

        The constants c are an array or a tuple of doubles; from c[first] on they are `PerturbedTop.numbers`.
        """
        return _compiled_rhs(self, first)

    @cached_property
    def digest(self) -> str:
        """Identity of the formula, hexadecimal."""
        return hashlib.sha256((self.potential.digest + self.gradient.digest).encode()).hexdigest()[:16]

    def __hash__(self) -> int:
        return hash(self.digest)


@cache
def _compiled_rhs(field: Field, first: int) -> Callable[..., Any]:
    torque, numbers = field.torque, take(field.parameters)

    @unrolled(f"rates {field.digest}")
    def rates(J, x, q):
        return (*torque(*x, *q), *cross(J, x))

    @jit_as(f"rhs {field.digest} {first}")
    def rhs(s, c):
        return rates((s[0], s[1], s[2]), (s[3], s[4], s[5]), numbers(c, first))

    return rhs


def _inputs(parameters: int) -> tuple[Tape, tuple[Term, ...], tuple[Term, ...]]:
    tape = Tape()
    return tape, tuple(tape.input() for _ in range(3)), tuple(tape.input() for _ in range(parameters))


def cross(a: Any, b: Any) -> Vector:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Any, b: Any) -> Any:
    """a·b."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def _twist(tape: Tape, x: Vector, g: Vector) -> tuple[Vector, Vector]:
    """N = x × g and ∇|N|² = 2 (g × N + U'' (N × x))."""
    N = cross(x, g)
    bend = tape.along(g, x, cross(N, x))
    return N, tuple(2.0 * (a + b) for a, b in zip(cross(g, N), bend, strict=True))  # type: ignore[return-value]


# ------------------------------------------------------------------------------------ the problem


@dataclass(frozen=True)
class PerturbedTop:
    """A Lagrange top in a potential, with the numbers of its parameters. Hashable, picklable.

    For `integrate_ensemble` alone, `alpha` of the top and the parameters may be arrays (n,), a number for each of n tops.

    Raises
    ------
    ValueError : parameters of the wrong number or kind; a potential that is no formula; a gradient that is not V's.
    """

    top: LagrangeTop
    potential: Potential
    parameters: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.top, LagrangeTop):
            raise ValueError(f"top of a PerturbedTop must be a LagrangeTop; got {type(self.top).__name__}")
        if not isinstance(self.potential, Potential):
            raise ValueError(f"potential must be a Potential; got {type(self.potential).__name__}")
        parameters = self.parameters
        if isinstance(parameters, (str, bytes)) or not hasattr(parameters, "__iter__"):
            raise ValueError(f"parameters must be numbers, one for each parameter; got {parameters!r}")
        checked = tuple(_check(value, f"parameters[{i}]") for i, value in enumerate(parameters))
        object.__setattr__(self, "parameters", checked)
        formula = self.potential.formula(len(checked))
        object.__setattr__(self, "_formula", formula)
        if formula.given and all(map(np.size, checked)) and (where := _wrong(formula, self.first())):
            raise ValueError(f"potential {self.potential.name}: gradient is not the derivative of value at {where}")

    def __hash__(self) -> int:
        return hash(self.identity)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PerturbedTop) and self.identity == other.identity

    @property
    def identity(self) -> tuple[Any, ...]:
        """Top, field and parameters; of many their bytes."""
        return self.top, self.field, *(v.tobytes() if isinstance(v, np.ndarray) else v for v in self.parameters)

    def __reduce__(self) -> Any:  # functions typed at a prompt cannot be pickled, what was recorded of them can
        formula, potential = self.formula, self.potential
        return _rebuild, (self.top, potential.name, formula.value, formula.given, potential.parameters, self.parameters)

    # ------------------------------------------------------------------ what it is

    @property
    def formula(self) -> Formula:
        """V, recorded."""
        return self._formula  # type: ignore[attr-defined, no-any-return]

    @property
    def field(self) -> Field:
        """The formulas of the whole potential alpha x3 + V."""
        return self.formula.field

    @property
    def alpha(self) -> Any:
        """The weight parameter of the top."""
        return self.top.alpha

    @cached_property
    def many(self) -> int | None:
        """The number of tops, if alpha or a parameter is an array."""
        return next((len(v) for v in (self.alpha, *self.parameters) if isinstance(v, np.ndarray)), None)

    def first(self) -> tuple[float, ...]:
        """The parameters, of many tops those of the first."""
        return tuple(float(v[0]) if isinstance(v, np.ndarray) else v for v in self.parameters)

    def like(self, alpha: float, parameters: tuple[float, ...], nature: Nature | None) -> PerturbedTop:
        """A top in the same potential with other numbers, which are taken as checked; its nature if that is known."""
        other = object.__new__(PerturbedTop)
        for name, value in (("top", LagrangeTop(alpha)), ("potential", self.potential), ("parameters", parameters)):
            object.__setattr__(other, name, value)
        object.__setattr__(other, "_formula", self.formula)
        if nature is not None:
            object.__setattr__(other, "nature", nature)
        return other

    def single(self) -> float:
        """alpha; ValueError if there are many tops."""
        if self.many is not None:
            raise ValueError(f"top holds {self.many} values of a parameter, which only integrate_ensemble takes")
        return self.top.single()

    @cached_property
    def numbers(self) -> tuple[float, ...]:
        """alpha and the parameters: what the programs of `field` take after x. ValueError if there are many tops."""
        return self.single(), *self.parameters

    @cached_property
    def digest(self) -> str:
        """Identity of the problem: formula and numbers, hexadecimal."""
        text = self.field.digest + repr(tuple(map(float, self.numbers)))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @cached_property
    def nature(self) -> Nature:
        """What kind of field it is, found from its values at random points."""
        return _nature(self.formula, self.numbers[1:])

    @cached_property
    def offers(self) -> frozenset[str]:
        """What methods may rely on: "force", always; "smooth", no corners; "quadratic", a linear force; "linear", a uniform one.

        A root of a square, √(w²), has a corner where w changes its sign.
        """
        nature, smooth = self.nature, not self.field.potential.corners(3)
        kinds = {"smooth": smooth or nature.quadratic, "quadratic": nature.quadratic, "linear": nature.linear}
        return frozenset({"force", *(name for name, offered in kinds.items() if offered)})

    @cached_property
    def conserved(self) -> frozenset[str]:
        """Of H, J3, C1, C2 those that the exact motion keeps."""
        return frozenset({"H", "C1", "C2", *(("J3",) * self.nature.axisymmetric)})

    def uniform(self) -> tuple[LagrangeTop, Array] | None:
        """If V = b·x: the Lagrange top that this is, and the rotation R (3, 3) to its frame, R (alpha e3 + b) upward."""
        if not self.nature.linear:
            return None
        g = self._anywhere()
        alpha = math.hypot(*g)
        if alpha == 0.0 or (g[0] == 0.0 and g[1] == 0.0):
            return LagrangeTop(float(g[2])), np.eye(3)
        axis = g / alpha
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        side /= np.linalg.norm(side)
        return LagrangeTop(alpha), np.array((side, np.cross(axis, side), axis))

    def _anywhere(self) -> Array:
        """The gradient (3,) of a uniform field, where the formula gives one."""
        for point in ((1.0, 0.0, 0.0), *_points()):
            try:
                g = np.array(self.gradient(*point), dtype=float)
            except (ZeroDivisionError, OverflowError):
                continue
            if np.isfinite(g).all():
                return g
        raise ValueError(f"the potential {self.potential.name} is finite at none of the points tried")

    def check_state(self, y: Array) -> None:
        """ValueError, naming the potential, if the force is not finite at a state (6,)."""
        x = y[3:].tolist()
        try:
            values = [*self.gradient(*x), self.energy(*x)]
        except (ZeroDivisionError, OverflowError):
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise ValueError(f"y0: the potential {self.potential.name} is not finite at x = {x}")

    # ------------------------------------------------------------------ its functions, as those of LagrangeTop

    def gradient(self, x1: Any, x2: Any, x3: Any) -> Vector:
        """∇(alpha x3 + V), on whatever numbers x consists of."""
        g1, g2, g3 = self.field.gradient(x1, x2, x3, self.alpha, *self.parameters)
        return g1, g2, g3

    def energy(self, x1: Any, x2: Any, x3: Any) -> Any:
        """alpha x3 + V, on whatever numbers x consists of."""
        return self.field.potential(x1, x2, x3, self.alpha, *self.parameters)[0]

    def hessian_times(self, x1: Any, x2: Any, x3: Any, v1: Any, v2: Any, v3: Any) -> Vector:
        """U''(x) v, on whatever numbers x and v consist of."""
        a, b, c = self.field.hessian_times(x1, x2, x3, v1, v2, v3, self.alpha, *self.parameters)
        return a, b, c

    def rhs(self, y: ArrayLike) -> Array:
        """Time derivative of states (..., 6)."""
        J, x = _parts(y)
        with np.errstate(all="ignore"):
            rates = (*cross(self.gradient(*x), x), *cross(J, x))
        return np.stack(np.broadcast_arrays(*rates), axis=-1)

    def jacobian(self, y: ArrayLike) -> Array:
        """Derivative of `rhs`, shape (6, 6), at one state (6,)."""
        y = np.asarray(y, dtype=float)
        D = np.zeros((6, 6))
        columns = [self.field.torque_along(*y[3:], *e, *self.numbers) for e in np.eye(3)]
        D[:3, 3:] = np.array(columns, dtype=float).T
        D[3:, :3], D[3:, 3:] = -hat(y[3:]), hat(y[:3])
        return D

    def poisson(self, y: ArrayLike) -> Array:
        """The tensor P (6, 6) with {f, g} = ∇f·P∇g at one state (6,)."""
        return self.top.poisson(y)

    def invariants(self, y: ArrayLike) -> Array:
        """H, J3, C1 = |x|², C2 = x·J of states (..., 6); shape (..., 4). J3 need not be conserved."""
        J, x = _parts(y)
        with np.errstate(all="ignore"):
            H = dot(J, J) / 2 + self.energy(*x)
        return np.stack(np.broadcast_arrays(H, J[2], dot(x, x), dot(x, J)), axis=-1)

    def gradients(self, y: ArrayLike) -> Array:
        """Gradients of H, J3, C1, C2 as rows, shape (4, 6), at one state (6,)."""
        G = self.top.gradients(y)
        G[0, 3:] = self.gradient(*np.asarray(y, dtype=float)[3:])
        return G

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


def _rebuild(
    top: LagrangeTop,
    name: str,
    value: Program,
    given: Program | None,
    parameters: tuple[str, ...] | None,
    numbers: tuple[float, ...],
) -> PerturbedTop:
    gradient = None if given is None else lambda x1, x2, x3, p: given(x1, x2, x3, *p)
    potential = Potential(name, lambda x1, x2, x3, p: value(x1, x2, x3, *p)[0], gradient, parameters=parameters)
    return PerturbedTop(top, potential, numbers)


def _parts(y: ArrayLike) -> tuple[Array, Array]:
    """J and x of states (..., 6), components in front."""
    states = np.asarray(y, dtype=float)
    if states.shape[-1:] != (6,):
        raise ValueError(f"y must be states (J1, J2, J3, x1, x2, x3), shape (..., 6); got shape {states.shape}")
    parts = np.moveaxis(states, -1, 0)
    return parts[:3], parts[3:]


def _check(value: Any, name: str) -> Any:
    if isinstance(value, np.ndarray) and value.ndim == 1:
        numbers: NDArray[np.float64] = np.array(value, dtype=np.float64)
        if value.dtype.kind not in "iuf" or not np.isfinite(numbers).all():
            raise ValueError(f"{name} must be finite real numbers")
        numbers.flags.writeable = False
        return numbers
    return check_real(value, name)


# ------------------------------------------------------------------------------------ kinds of fields


@dataclass(frozen=True)
class Nature:
    """What a field is, with its numbers."""

    linear: bool  # ∇V is the same everywhere
    quadratic: bool  # V'' is
    axisymmetric: bool  # V keeps J3


PLAIN = Nature(False, False, False)


@cache
def _points() -> list[Point]:
    draw = random.Random("points of comparison")
    return [(draw.uniform(-1, 1), draw.uniform(-1, 1), draw.uniform(-1, 1)) for _ in range(POINTS)]


@lru_cache(maxsize=4096)
def _nature(formula: Formula, parameters: tuple[float, ...]) -> Nature:
    return natures(formula, np.array([parameters]))[0] or _looks(formula, parameters) or PLAIN


def natures(formula: Formula, parameters: Array) -> list[Nature | None]:
    """Those of many rows of parameters (n, k) at once, from doubles; None where it takes more digits to tell.

    What a formula is with random parameters it is with all. So digits are needed only for what parameters of their own do.
    """
    n, k = parameters.shape
    generic, found = _generic(formula, k), np.empty((POINTS, 12, n))
    with np.errstate(all="ignore"):
        for values, point in zip(found, _points(), strict=True):
            for i, value in enumerate(formula.bends(*map(np.float64, point), *parameters.T)):
                values[i] = value
        slope, bend, (x1, x2, _) = found[:, :3], found[:, 3:], np.array(_points()).T[..., None]
        least = 1e-6 * np.max(np.abs(found), axis=(0, 1))
        linear = (np.abs(bend) <= least).all(axis=(0, 1))
        quadratic = (np.abs(bend - bend[0]) <= least).all(axis=(0, 1))
        axisymmetric = (np.abs(slope[:, 0] * x2 - slope[:, 1] * x1) <= least).all(axis=0)
        finite = np.isfinite(least)
    rough = [Nature(*flags) for flags in np.transpose((linear, quadratic, axisymmetric)).tolist()]
    return [kind if good and kind in (PLAIN, generic) else None for kind, good in zip(rough, finite, strict=True)]


@cache
def _generic(formula: Formula, count: int) -> Nature | None:
    """What the field is with random parameters; None if they do not tell."""
    draw = random.Random("generic parameters")
    return _looks(formula, tuple(draw.uniform(0.1, 1) for _ in range(count)))


def _looks(formula: Formula, parameters: tuple[float, ...]) -> Nature | None:
    """What the field is at random points, in 50 digits; None if it is finite at less than two of them.

    Formulas that are the same everywhere are so there, and others differ there. But a root of a square is a formula on one
    side of a plane and another one on the other. So a field is only what it is with either sign of its roots, too.
    """

    with workdps(DIGITS):
        found = [
            values for values in _values(formula.bends, parameters, _points()) if not any(map(_imaginary, values[1]))
        ]
        if len(found) < 2:
            return None
        kind = _kind(found)
        if kind != PLAIN:
            if formula.branches is None:
                return PLAIN
            for branch in formula.branches:
                found += _values(branch, parameters, _points()[:2])
            kind = _kind(found)
        return kind


def _imaginary(number: Any) -> bool:
    return bool(getattr(number, "imag", 0))


def _values(bends: Program, parameters: tuple[float, ...], points: Sequence[Point]) -> list[tuple[Point, list[Any]]]:
    """∇V and V'' at these points, in mpmath's digits, where they are finite."""
    import mpmath

    found = []
    for point in points:
        try:
            values = bends(*map(mpmath.mpf, point), *map(mpmath.mpf, parameters))
        except (ZeroDivisionError, OverflowError, ValueError):
            continue
        if all(v - v == 0 for v in values):
            found.append((point, list(values)))
    return found


def _kind(found: Sequence[tuple[Point, list[Any]]]) -> Nature:
    """The field with these values at random points."""
    least = 10.0 ** (10 - DIGITS) * max(abs(v) for _, values in found for v in values)
    first = found[0][1]

    def same(part: slice) -> bool:
        return all(abs(v - w) <= least for _, values in found for v, w in zip(values[part], first[part], strict=True))

    def offset(x: Point, values: list[Any]) -> list[Any]:
        """∇V − V'' x, the same everywhere only if ∇V does not jump."""
        return [values[i] - dot(values[3 + i :: 3], x) for i in range(3)]

    ends = [offset(*one) for one in found]
    return Nature(
        linear=same(slice(3)) and all(abs(v) <= least for _, values in found for v in values[3:]),
        quadratic=same(slice(3, None))
        and all(abs(v - w) <= least for end in ends for v, w in zip(end, ends[0], strict=True)),
        axisymmetric=all(abs(values[0] * x[1] - values[1] * x[0]) <= least for x, values in found),
    )


@lru_cache(maxsize=4096)
def _wrong(formula: Formula, parameters: tuple[float, ...]) -> str:
    """Where a given gradient is not the derivative of the value, "" if it is, at random points near and far.

    With these parameters and with random ones: a mistake in a term shows only where its parameter is not 0.
    """
    import mpmath

    assert formula.given is not None
    draw = random.Random("generic parameters")
    points = [*_points(), *((r * x1, r * x2, r * x3) for r in FAR for x1, x2, x3 in _points())]
    with workdps(DIGITS):
        for numbers in (parameters, tuple(draw.uniform(0.1, 1) for _ in parameters)):
            for point in points:
                found = []
                for program in (formula.given, formula.derived):
                    found += [values[:3] for _, values in _values(program, numbers, [point])]
                if len(found) < 2 or any(map(_imaginary, (*found[0], *found[1]))):
                    continue
                size = max(map(abs, (*found[0], *found[1])))
                if any(mpmath.mpf(abs(a - b)) > SAME * size for a, b in zip(*found, strict=True)):
                    return f"x = {point}" + (f", parameters {numbers}" if numbers else "")
    return ""
