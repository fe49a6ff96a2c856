"""Where formulas are recorded and differentiated.

`record` calls a function with symbols, and keeps the operations that it asks for as a `Program`, see `expression`. Derivatives
are programs too: `Tape` differentiates backwards (a gradient, for the price of a few evaluations) and forwards (along a
direction).

Source: Griewank & Walther, Evaluating Derivatives (2008), chapters 3 and 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.expression import WAVES, Program
from lagrange_bench.integrators.compiling.unroll import FUNCTIONS, Number

UFUNCS = {"add": "add", "subtract": "sub", "multiply": "mul", "divide": "div", "negative": "neg"}
UFUNCS |= {name: name for name in FUNCTIONS}
REFUSAL = "a formula may use + − × ÷, whole and half powers, and sqrt, sin, cos, exp, log of lagrange_bench only"


class Term(Number):
    """A number of a formula that is being recorded."""

    __slots__ = ("place", "tape")
    __hash__ = object.__hash__

    def __init__(self, tape: Tape, place: int):
        self.tape, self.place = tape, place

    def make(self, operation: str, *operands: Any) -> Any:
        """Record an operation. For an array, NumPy then asks for each of its numbers."""
        if any(isinstance(operand, np.ndarray) for operand in operands):
            return NotImplemented
        return self.tape.make(operation, *operands)

    def __pos__(self) -> Term:
        return self

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

    def __array_ufunc__(self, ufunc: Any, call: str, *inputs: Any, **options: Any) -> Any:
        if call != "__call__" or options or ufunc.__name__ not in (*UFUNCS, "power", "square"):
            raise TypeError(f"{REFUSAL}; got numpy's {ufunc.__name__}")
        if any(isinstance(operand, np.ndarray) for operand in inputs):
            return ufunc(*(np.array(operand, dtype=object) for operand in inputs))
        if ufunc.__name__ == "square":
            return self * self
        if ufunc.__name__ == "power":
            return inputs[0] ** inputs[1]
        return self.tape.make(UFUNCS[ufunc.__name__], *inputs)

    def _refuse(self, *_: Any) -> Any:
        raise TypeError(f"{REFUSAL}, and cannot branch on a number that is not known yet")

    __bool__ = __float__ = __int__ = __abs__ = __floordiv__ = __mod__ = __rpow__ = __index__ = _refuse
    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _refuse  # type: ignore[assignment]


Terms = Sequence[Term]


class Tape:
    """Where formulas are recorded and differentiated. Equal operations are recorded once, those with 0 and 1 not at all."""

    def __init__(self) -> None:
        self.lines: list[tuple[Any, ...]] = []
        self.places: dict[tuple[Any, ...], int] = {}
        self.inputs: list[Term] = []

    def _record(self, *line: Any) -> Term:
        key = (line[0], *sorted(line[1:])) if line[0] in ("add", "mul") else line  # a + b = b + a, to the last bit
        if key not in self.places:
            self.places[key] = len(self.lines)
            self.lines.append(line)
        return Term(self, self.places[key])

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
            if isinstance(value, (str, bytes, bytearray)):
                raise ValueError("float() would read it")
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
        if operation == "mul":
            for factor, other in (terms, terms[::-1]):
                c, (d, rest) = self.known(factor), self._factor(other)
                if c is not None and d is not None and (_exact(c) or _exact(d)):
                    return self.make("mul", c * d, rest)  # c (d m) as (c d) m, as nothing is rounded
        return self._record(operation, *(term.place for term in terms))

    def _factor(self, term: Term) -> tuple[float | None, Term]:
        """(d, m) of a term d·m with a constant d, or m/(1/d) with a power of two; d is None for any other term."""
        operation, *arguments = self.lines[term.place]
        if operation == "mul":
            for i in (0, 1):
                d = self.known(Term(self, arguments[i]))
                if d is not None:
                    return d, Term(self, arguments[1 - i])
        if operation == "div":
            divisor = self.known(Term(self, arguments[1]))
            if divisor is not None and _exact(divisor):
                return 1.0 / divisor, Term(self, arguments[0])
        return None, term

    def run(self, program: Program, *numbers: Any) -> tuple[Term, ...]:
        """A program's outputs as terms of this tape."""
        return tuple(map(self.constant, program(*map(self.constant, numbers))))

    def shares(self, place: int, rate_of: Callable[[int], Term | None]) -> Iterator[tuple[int, Term]]:
        """The places that a line depends on and that have a rate, with the rate times the line's derivative by the place.

        A derivative 1/b is a division by b: 1/b of a constant would be rounded once and for all.
        """
        operation, *arguments = self.lines[place]
        if operation in ("input", "constant"):
            return
        a, b, result = Term(self, arguments[0]), Term(self, arguments[-1]), Term(self, place)
        for i, argument in enumerate(arguments):
            rate = rate_of(argument)
            if rate is None:
                continue
            if operation == "mul":
                share = rate * (a if i else b)
            elif operation == "div":
                share = -(rate * result) / b if i else rate / b
            elif operation == "sqrt":
                share = rate / (2.0 * result)
            elif operation == "sin":
                share = rate * a.cos()
            elif operation == "cos":
                share = -(rate * a.sin())
            elif operation == "exp":
                share = rate * result
            elif operation == "log":
                share = rate / a
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
        """The program of these outputs, with all inputs and only the lines it needs."""
        terms = tuple(map(self.constant, outputs))
        new: dict[int, Any] = {term.place: i for i, term in enumerate(self.inputs)}
        lines: list[tuple[Any, ...]] = []
        for place in sorted(self.needed(terms) - set(new)):
            operation, *arguments = self.lines[place]
            if operation == "constant":
                new[place] = ("=", arguments[0])
            else:
                new[place] = len(self.inputs) + len(lines)
                lines.append((operation, *(new[a] for a in arguments)))
        return Program(len(self.inputs), tuple(lines), tuple(new[term.place] for term in terms))

    def needed(self, terms: Iterable[Term]) -> set[int]:
        """The places that terms depend on, their own included."""
        needed: set[int] = set()
        waiting = [term.place for term in terms]
        while waiting:
            place = waiting.pop()
            if place not in needed:
                needed.add(place)
                operation, *arguments = self.lines[place]
                waiting += [] if operation in ("input", "constant") else arguments
        return needed


def _exact(factor: float) -> bool:
    """Whether a product with it is not rounded: a power of two."""
    return abs(math.frexp(factor)[0]) == 0.5


def record(function: Callable[..., Any], inputs: int) -> Program:
    """The formula of a function of `inputs` numbers that returns a tuple of numbers; TypeError if it is no formula."""
    tape = Tape()
    return tape.program(function(*(tape.input() for _ in range(inputs))))


def record_own(function: Callable[..., Any], inputs: int, name: str, signature: str, known: str) -> Program:
    """`record` of somebody else's function, which may raise anything. ValueError with its name and the reason.

    name, signature : as in "problem mine: hamiltonian" and "(t, y, p)". known : what the function gets.
    """
    try:
        return record(function, inputs)
    except IndexError as error:
        raise ValueError(f"{name} asks for more than {known} ({error})") from None
    except (Exception, SystemExit) as error:
        reason = " ".join(str(error).split())  # in one line
        reason = f"it calls sys.exit({reason})" if isinstance(error, SystemExit) else reason
        raise ValueError(f"{name}{signature} fails: {reason}") from None


@cache
def with_slopes(program: Program, count: int) -> Program:
    """The outputs, then their derivatives by each of the first `count` inputs."""
    tape = Tape()
    inputs = [tape.input() for _ in range(program.inputs)]
    outputs, by = tape.run(program, *inputs), inputs[:count]
    columns = [tape.along(outputs, by, [float(i == k) for i in range(count)]) for k in range(count)]
    return tape.program((*outputs, *(slope for column in columns for slope in column)))


@cache
def phase_rates(program: Program, place: int) -> Program:
    """The derivatives, by one input, of the arguments of sin, cos and exp, in the order of the lines."""
    tape = Tape()
    inputs = [tape.input() for _ in range(program.inputs)]
    phases = tuple(line[1] for line in program.lines if line[0] in WAVES)
    terms = tape.run(Program(program.inputs, program.lines, phases), *inputs)
    return tape.program(tape.along(terms, [inputs[place]], [1.0]))


def bandwidth(program: Program, place: int, numbers: Sequence[Any]) -> float:
    """The highest angular frequency of the outputs as functions of one input, at these inputs: numbers, or arrays of them.

    Frequencies of factors add up. sin, cos and exp add the largest derivative of their argument to its own frequency, as in
    Carson's rule for the band of a modulated wave. A root, a quotient and an exponential have overtones, which do not count.
    """
    with np.errstate(all="ignore"):
        rates = iter(phase_rates(program, place)(*map(np.float64, numbers)))
    widths: dict[Any, float] = {}
    for line, (operation, *arguments) in enumerate(program.lines, program.inputs):
        sizes = [widths.get(argument, 0.0) for argument in arguments]
        widths[line] = sum(sizes) if operation in ("mul", "div") else max(sizes)
        if operation in WAVES:
            widths[line] += float(np.max(np.abs(next(rates))))
    return max(widths.get(output, 0.0) for output in program.outputs)
