"""Formulas of + − × ÷ and √: an ordinary Python function, recorded once, and evaluated on any kind of number.

`record` calls a function with symbols and keeps the operations it asks for as a `Program`, a straight list without
repetitions. A program runs on floats, arrays, mpmath numbers, heyoka expressions and, through `machine_code`, in compiled
kernels; its digest identifies the formula, wherever the function stands. Derivatives are programs too: `Tape` differentiates
backwards (a gradient, for the price of a few evaluations) and forwards (along a direction).

Source: Griewank & Walther, Evaluating Derivatives (2008), chapters 3 and 4.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import cache, cached_property
from typing import Any

from integrators.compiling.compiled import inlined, jit_as
from integrators.compiling.unroll import unrolled

PYTHON = {"add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}", "neg": "-{}", "sqrt": "sqrt({})"}
UFUNCS = {"add": "add", "subtract": "sub", "multiply": "mul", "divide": "div", "negative": "neg", "sqrt": "sqrt"}
REFUSAL = "a formula may use + − × ÷, whole and half powers, and sqrt of integrators only"


def sqrt(a: Any) -> Any:
    """Square root of whatever a formula is evaluated on: a symbol, a float, an array, an mpmath or a heyoka number.

    NaN for a negative float. TypeError : a type without a square root.
    """
    if isinstance(a, (float, int)):
        return math.sqrt(a) if a >= 0 else math.nan
    if hasattr(a, "sqrt"):
        return a.sqrt()
    if hasattr(a, "__array__"):
        import numpy as np

        return np.sqrt(a)
    package = type(a).__module__.partition(".")[0]
    if package in ("mpmath", "heyoka"):
        return __import__(package).sqrt(a)
    raise TypeError(f"no square root of a {type(a).__name__}")


class Term:
    """A number of a formula that is being recorded."""

    __slots__ = ("place", "tape")
    __hash__ = object.__hash__

    def __init__(self, tape: Tape, place: int):
        self.tape, self.place = tape, place

    def __add__(self, other: Any) -> Term:
        return self.tape.make("add", self, other)

    def __radd__(self, other: Any) -> Term:
        return self.tape.make("add", other, self)

    def __sub__(self, other: Any) -> Term:
        return self.tape.make("sub", self, other)

    def __rsub__(self, other: Any) -> Term:
        return self.tape.make("sub", other, self)

    def __mul__(self, other: Any) -> Term:
        return self.tape.make("mul", self, other)

    def __rmul__(self, other: Any) -> Term:
        return self.tape.make("mul", other, self)

    def __truediv__(self, other: Any) -> Term:
        return self.tape.make("div", self, other)

    def __rtruediv__(self, other: Any) -> Term:
        return self.tape.make("div", other, self)

    def __neg__(self) -> Term:
        return self.tape.make("neg", self)

    def __pos__(self) -> Term:
        return self

    def sqrt(self) -> Term:
        return self.tape.make("sqrt", self)

    def __pow__(self, power: Any) -> Term:
        twice = 2 * power if isinstance(power, (int, float)) else 0.5
        if twice != int(twice):
            raise TypeError(f"{REFUSAL}; got the power {power!r}")
        whole, half = divmod(abs(int(twice)), 2)
        result = self.sqrt() if half else self.tape.constant(1.0)
        base = self
        while whole:
            if whole % 2:
                result = base * result
            whole //= 2
            base = base * base if whole else base
        return 1.0 / result if twice < 0 else result

    def __array_ufunc__(self, ufunc: Any, call: str, *inputs: Any, **options: Any) -> Term:
        if call != "__call__" or options or ufunc.__name__ not in (*UFUNCS, "power", "square"):
            raise TypeError(f"{REFUSAL}; got numpy's {ufunc.__name__}")
        if ufunc.__name__ == "square":
            return self * self
        if ufunc.__name__ == "power":
            return inputs[0] ** inputs[1]
        return self.tape.make(UFUNCS[ufunc.__name__], *inputs)

    def _refuse(self, *_: Any) -> Any:
        raise TypeError(f"{REFUSAL}, and cannot branch on a number that is not known yet")

    __bool__ = __float__ = __int__ = __abs__ = __floordiv__ = __mod__ = __rpow__ = __index__ = _refuse
    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _refuse  # type: ignore[assignment]


class Program:
    """A recorded formula: `lines` of (operation, arguments), after the inputs; an argument is a place, or ("=", constant)."""

    def __init__(self, inputs: int, lines: tuple[tuple[Any, ...], ...], outputs: tuple[Any, ...]):
        self.inputs, self.lines, self.outputs = inputs, lines, outputs

    def __call__(self, *numbers: Any) -> tuple[Any, ...]:
        """The outputs for these inputs, in the operations of the numbers; constants stay floats."""
        if len(numbers) != self.inputs:
            raise TypeError(f"a formula of {self.inputs} numbers got {len(numbers)}")
        return self._function(*numbers)  # type: ignore[no-any-return]

    def with_constants(self, constant: Callable[[float], Any]) -> Callable[..., tuple[Any, ...]]:
        """The program as a function of its inputs, each constant turned into a number of another type."""
        return self._python(constant)

    @cached_property
    def _function(self) -> Callable[..., Any]:
        return self._python(None)

    def _python(self, constant: Callable[[float], Any] | None) -> Callable[..., Any]:
        """The lines as a Python function: five times as quick as going through them."""
        room: dict[str, Any] = {"sqrt": sqrt, "nan": math.nan, "inf": math.inf, "constant": constant}

        def word(place: Any) -> str:
            if not isinstance(place, tuple):
                return f"v{place}"
            return f"({place[1]!r})" if constant is None else f"constant({place[1]!r})"

        inputs = "".join(f"v{i}, " for i in range(self.inputs))
        lines = [
            f"    v{self.inputs + i} = {PYTHON[operation].format(*map(word, arguments))}\n"
            for i, (operation, *arguments) in enumerate(self.lines)
        ]
        outputs = "".join(f"{word(place)}, " for place in self.outputs)
        exec(f"def function({inputs}):\n{''.join(lines)}    return ({outputs})\n", room)
        return room["function"]  # type: ignore[no-any-return]

    def roots(self, count: int) -> list[int]:
        """Numbers of the lines that take a root of something that depends on one of the first `count` inputs."""
        moving = self._moving(count)
        return [i for i, line in enumerate(self.lines) if line[0] == "sqrt" and self.inputs + i in moving]

    def _moving(self, count: int) -> set[int]:
        """Places of what depends on one of the first `count` inputs."""
        moving = set(range(count))
        for place, (_, *arguments) in enumerate(self.lines, self.inputs):
            if moving.intersection(argument for argument in arguments if isinstance(argument, int)):
                moving.add(place)
        return moving

    def corners(self, count: int) -> list[int]:
        """Of `roots` those that are |w| or an odd power of it, where w may change its sign: no series goes on there.

        Found by the factors of what the root is taken of: w must be squared as it stands, not multiplied out.
        """
        moving, positive = self._moving(count), set[Any]()
        powers: dict[Any, Counter[Any]] = {
            i: Counter({i: 1}) for i in range(self.inputs)
        }  # of the factors of each place

        def factors(place: Any) -> Counter[Any]:
            return Counter({"sign": int(place[1] < 0)}) if isinstance(place, tuple) else powers[place]

        def keeps_sign(place: Any) -> bool:
            return all(n % 2 == 0 or base in positive for base, n in factors(place).items())

        for place, (operation, *arguments) in enumerate(self.lines, self.inputs):
            found: Counter[Any] = Counter({place: 1})
            if operation in ("mul", "div", "neg"):
                found = factors(arguments[0]).copy()
                (found.subtract if operation == "div" else found.update)(
                    {"sign": 1} if operation == "neg" else factors(arguments[1])
                )
            elif operation == "sqrt" or (operation == "add" and all(map(keeps_sign, arguments))):
                positive.add(place)
            powers[place] = found
        return [
            i
            for i in self.roots(count)
            if any(n % 4 == 2 and base in moving - positive for base, n in factors(self.lines[i][1]).items())
        ]

    def branch(self, flipped: Collection[int]) -> Program:
        """The same formula with the other sign of the roots in these lines: another branch of the same analytic function."""
        new: dict[Any, Any] = {i: i for i in range(self.inputs)}
        lines: list[tuple[Any, ...]] = []
        for i, (operation, *arguments) in enumerate(self.lines):
            lines.append((operation, *(new.get(argument, argument) for argument in arguments)))
            if i in flipped:
                lines.append(("neg", self.inputs + len(lines) - 1))
            new[self.inputs + i] = self.inputs + len(lines) - 1
        return Program(self.inputs, tuple(lines), tuple(new.get(place, place) for place in self.outputs))

    def __getstate__(self) -> tuple[Any, ...]:  # without the function, which cannot be pickled
        return self.inputs, self.lines, self.outputs

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.inputs, self.lines, self.outputs = state

    @cached_property
    def digest(self) -> str:
        """Identity of the formula, hexadecimal."""
        return hashlib.sha256(repr((self.inputs, self.lines, self.outputs)).encode()).hexdigest()[:16]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Program) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    @property
    def known(self) -> tuple[float | None, ...]:
        """The outputs that are constants, None for the others."""
        return tuple(place[1] if isinstance(place, tuple) else None for place in self.outputs)


class Tape:
    """Where formulas are recorded and differentiated. Equal operations are recorded once, those with 0 and 1 not at all."""

    def __init__(self) -> None:
        self.lines: list[tuple[Any, ...]] = []
        self.places: dict[tuple[Any, ...], int] = {}
        self.inputs: list[Term] = []

    def _record(self, *line: Any) -> Term:
        if line not in self.places:
            self.places[line] = len(self.lines)
            self.lines.append(line)
        return Term(self, self.places[line])

    def input(self) -> Term:
        """One more unknown number."""
        self.inputs.append(self._record("input", len(self.inputs)))
        return self.inputs[-1]

    def constant(self, value: Any) -> Term:
        """A known number, as a double."""
        if isinstance(value, Term):
            if value.tape is not self:
                raise TypeError("a formula must not keep numbers of another call")
            return value
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            raise TypeError(f"{REFUSAL}; got {value!r}") from None
        return self._record("constant", number + 0.0)  # -0.0 is 0.0

    def known(self, term: Term) -> float | None:
        line = self.lines[term.place]
        return line[1] if line[0] == "constant" else None

    def make(self, operation: str, *arguments: Any) -> Term:
        terms = [self.constant(argument) for argument in arguments]
        a, b = self.known(terms[0]), self.known(terms[-1])
        if a is not None and b is not None:
            if operation == "div" and b == 0.0:
                return self.constant(math.nan)
            constants = tuple(("=", value) for value in (a, b)[: len(terms)])
            return self.constant(Program(0, ((operation, *constants),), (0,))()[0])
        if operation == "add" and 0.0 in (a, b):
            return terms[1] if a == 0.0 else terms[0]
        if operation == "sub" and b == 0.0:
            return terms[0]
        if operation == "sub" and a == 0.0:
            return self.make("neg", terms[1])
        if (operation in ("mul", "div") and a == 0.0) or (operation == "mul" and b == 0.0):
            return self.constant(0.0)
        if operation in ("mul", "div") and b == 1.0:
            return terms[0]
        if operation == "mul" and a == 1.0:
            return terms[1]
        if operation == "neg" and self.lines[terms[0].place][0] == "neg":
            return Term(self, self.lines[terms[0].place][1])
        if operation in ("add", "sub", "mul") and terms[0].place == terms[1].place:
            if operation == "sub":
                return self.constant(0.0)
            if operation == "add":
                return self.make("mul", 2.0, terms[0])
        return self._record(operation, *(term.place for term in terms))

    def run(self, program: Program, *numbers: Any) -> tuple[Term, ...]:
        """A program's outputs as terms of this tape."""
        return tuple(map(self.constant, program(*map(self.constant, numbers))))

    def shares(self, place: int, rate_of: Callable[[int], Term | None]) -> Iterator[tuple[int, Term]]:
        """The places a line depends on, with their rates (if they have one) times the line's derivative by them.

        Divided by b where the derivative is 1/b: of a constant b, 1/b would be rounded once and for all.
        """
        operation, *arguments = self.lines[place]
        if operation in ("input", "constant"):
            return
        a, b, here = Term(self, arguments[0]), Term(self, arguments[-1]), Term(self, place)
        for i, argument in enumerate(arguments):
            rate = rate_of(argument)
            if rate is None:
                continue
            if operation == "mul":
                share = rate * (a if i else b)
            elif operation == "div":
                share = -(rate * here) / b if i else rate / b
            elif operation == "sqrt":
                share = rate / (2.0 * here)
            else:
                share = -rate if operation == "neg" or (operation == "sub" and i) else rate
            yield argument, share

    def gradient(self, of: Term, by: Sequence[Term]) -> tuple[Term, ...]:
        """Derivatives of one number by several, backwards."""
        weights: dict[int, Term] = {of.place: self.constant(1.0)}
        for place in range(of.place, -1, -1):
            if place in weights:
                weight = weights[place]
                for argument, share in self.shares(place, lambda _, weight=weight: weight):  # type: ignore[misc]
                    weights[argument] = weights[argument] + share if argument in weights else share
        return tuple(weights.get(term.place, self.constant(0.0)) for term in by)

    def along(self, of: Iterable[Term], by: Sequence[Term], direction: Sequence[Any]) -> tuple[Term, ...]:
        """Derivatives of several numbers along one direction, forwards."""
        of = tuple(of)
        rates: dict[int, Term] = {t.place: self.constant(d) for t, d in zip(by, direction, strict=True)}
        for place in range(max((term.place for term in of), default=-1) + 1):
            for _, share in self.shares(place, rates.get):
                rates[place] = rates[place] + share if place in rates else share
        return tuple(rates.get(term.place, self.constant(0.0)) for term in of)

    def program(self, outputs: Iterable[Any]) -> Program:
        """What these outputs need, as a program of all inputs."""
        terms = tuple(map(self.constant, outputs))
        needed, waiting = set(), [term.place for term in terms]
        while waiting:
            place = waiting.pop()
            if place not in needed:
                needed.add(place)
                operation, *arguments = self.lines[place]
                waiting += arguments if operation not in ("input", "constant") else []
        new: dict[int, Any] = {term.place: i for i, term in enumerate(self.inputs)}
        lines: list[tuple[Any, ...]] = []
        for place in sorted(needed - set(new)):
            operation, *arguments = self.lines[place]
            if operation == "constant":
                new[place] = ("=", arguments[0])
            else:
                new[place] = len(self.inputs) + len(lines)
                lines.append((operation, *(new[argument] for argument in arguments)))
        return Program(len(self.inputs), tuple(lines), tuple(new[term.place] for term in terms))


def record(function: Callable[..., Any], inputs: int) -> Program:
    """The formula of a function of so many numbers that returns a tuple of numbers. TypeError if it is none."""
    tape = Tape()
    return tape.program(function(*(tape.input() for _ in range(inputs))))


@cache
def with_slopes(program: Program, count: int) -> Program:
    """The outputs, then their derivatives by each of the first `count` inputs."""
    tape = Tape()
    inputs = [tape.input() for _ in range(program.inputs)]
    outputs, by = tape.run(program, *inputs), inputs[:count]
    columns = [tape.along(outputs, by, [float(i == k) for i in range(count)]) for k in range(count)]
    return tape.program((*outputs, *(slope for column in columns for slope in column)))


@cache
def machine_code(program: Program) -> Any:
    """(x, q) → the outputs, for compiled kernels: two tuples of doubles that make up the inputs."""

    @unrolled(f"program {program.digest}")
    def evaluate(x, q):
        return program(*x, *q)

    return evaluate


@inlined
def one(c, first):
    return (c[first],)


@cache
def take(count: int) -> Any:
    """(c, first) → the tuple of `count` ≥ 1 doubles that begins at c[first], for compiled kernels."""
    if count == 1:
        return one
    rest = take(count - 1)

    @jit_as(f"take {count}", forceinline=True)
    def some(c, first):
        return (c[first],) + rest(c, first + 1)  # noqa: RUF005 - compiled code does not unpack

    return some
