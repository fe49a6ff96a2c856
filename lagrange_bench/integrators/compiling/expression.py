"""Formulas of + − × ÷, √, sin, cos, exp and log, evaluated on any kind of number.

A `Program` is a formula as a straight list of operations without repetitions; `tape` records it. It runs on floats, arrays,
mpmath numbers, heyoka expressions and, through `machine_code`, in compiled kernels. Its digest identifies the formula, wherever
the function stands. Bits are the same everywhere if the formula is algebraic; sin, cos, exp and log come from the C library.
"""

import hashlib
import math
from collections import Counter
from collections.abc import Callable
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.intrinsics import load_tuple
from lagrange_bench.integrators.compiling.unroll import FUNCTIONS, unrolled

PYTHON = {"add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}", "neg": "-{}"}
PYTHON |= {name: name + "({})" for name in FUNCTIONS}
WAVES = ("sin", "cos", "exp")
NESTED = 16  # the largest depth of nested terms in generated code; the parser takes some hundred


def sqrt(a: Any) -> Any:
    """Square root of whatever a formula is evaluated on.

    Parameters
    ----------
    a : number, array or symbol
        A symbol of a formula, a float, an array, an mpmath or a heyoka number.

    Returns
    -------
    same as a
        The root; NaN for a negative float.

    Raises
    ------
    TypeError
        A type without a square root.
    """
    return apply("sqrt", a)


def sin(a: Any) -> Any:
    """Sine of whatever a formula is evaluated on; as `sqrt`."""
    return apply("sin", a)


def cos(a: Any) -> Any:
    """Cosine of whatever a formula is evaluated on; as `sqrt`."""
    return apply("cos", a)


def exp(a: Any) -> Any:
    """Exponential of whatever a formula is evaluated on; as `sqrt`. Infinite where it overflows."""
    return apply("exp", a)


def log(a: Any) -> Any:
    """Natural logarithm of whatever a formula is evaluated on; as `sqrt`. NaN for a negative float, −∞ for 0."""
    return apply("log", a)


def apply(name: str, a: Any) -> Any:
    """One of FUNCTIONS of a number; TypeError for a type that does not have it."""
    if isinstance(a, (float, int)):
        try:
            return getattr(math, name)(a)
        except ValueError:
            return -math.inf if name == "log" and a == 0 else math.nan
        except OverflowError:
            return math.inf
    package = type(a).__module__.partition(".")[0]
    if package in ("mpmath", "heyoka"):  # first of all: `exp` of an mpmath number is its exponent
        return getattr(__import__(package), name)(a)
    if hasattr(a, name):
        return getattr(a, name)()
    if hasattr(a, "__array__"):
        return getattr(np, name)(a)
    raise TypeError(f"no {name} of a {type(a).__name__}")


class Program:
    """A recorded formula: `lines` of (operation, arguments), after the inputs; an argument is a place, or ("=", constant)."""

    def __init__(self, inputs: int, lines: tuple[tuple[Any, ...], ...], outputs: tuple[Any, ...]):
        self.inputs, self.lines, self.outputs = inputs, lines, outputs

    def __call__(self, *numbers: Any) -> tuple[Any, ...]:
        """The outputs for these inputs, by the operations of the numbers; constants stay floats."""
        if len(numbers) != self.inputs:
            raise TypeError(f"a formula of {self.inputs} numbers got {len(numbers)}")
        return self._function(*numbers)

    @cached_property
    def _function(self) -> Callable[..., Any]:
        return self.python()

    def python(self, constant: Callable[[float], Any] | None = None) -> Callable[..., Any]:
        """The lines as a Python function of the inputs, five times as fast as interpreting them.

        constant : a function that is applied to each constant.
        """
        room: dict[str, Any] = {name: partial(apply, name) for name in FUNCTIONS if name != "sqrt"}
        room |= {"sqrt": sqrt, "nan": math.nan, "inf": math.inf, "constant": constant}

        words = {i: f"v{i}" for i in range(self.inputs)}
        depths: Counter[int] = Counter()
        uses = Counter([*(place for line in self.lines for place in line[1:]), *self.outputs])

        def word(place: Any) -> str:
            if not isinstance(place, tuple):
                return words[place]
            return f"({place[1]!r})" if constant is None else f"constant({place[1]!r})"

        lines = []
        for place, (operation, *arguments) in enumerate(self.lines, self.inputs):
            term, depth = PYTHON[operation].format(*map(word, arguments)), 1 + max(depths[a] for a in arguments)
            if uses[place] == 1 and depth < NESTED:  # NumPy reuses the memory of a term without a name
                words[place], depths[place] = f"({term})", depth
            else:
                words[place] = f"v{place}"
                lines.append(f"    v{place} = {term}\n")
        inputs = "".join(f"v{i}, " for i in range(self.inputs))
        outputs = "".join(f"{word(place)}, " for place in self.outputs)
        exec(f"def function({inputs}):\n{''.join(lines)}    return ({outputs})\n", room)
        return room["function"]

    def corners(self, count: int) -> list[int]:
        """The numbers of the lines with a root that is |w|, or an odd power of it, and w may change its sign: no series goes on.

        w depends on one of the first `count` inputs. It is found among the factors under the root: there must be a w², not
        multiplied out.
        """
        moving, positive = set[Any](range(count)), set[Any]()
        powers: dict[Any, Counter[Any]] = {i: Counter({i: 1}) for i in range(self.inputs)}  # place → factor → power

        def factors(place: Any) -> Counter[Any]:
            return Counter({"sign": int(place[1] < 0)}) if isinstance(place, tuple) else powers[place]

        def keeps_sign(place: Any) -> bool:
            return all(n % 2 == 0 or base in positive for base, n in factors(place).items())

        for place, (operation, *arguments) in enumerate(self.lines, self.inputs):
            if moving.intersection(arguments):
                moving.add(place)
            factored: Counter[Any] = Counter({place: 1})
            if operation in ("mul", "div", "neg"):
                factored = factors(arguments[0]).copy()
                (factored.subtract if operation == "div" else factored.update)(
                    {"sign": 1} if operation == "neg" else factors(arguments[1])
                )
            elif operation == "sqrt" or (operation == "add" and all(map(keeps_sign, arguments))):
                positive.add(place)
            powers[place] = factored
        return [
            i
            for i, (operation, argument, *_) in enumerate(self.lines)
            if operation == "sqrt"
            and any(n % 4 == 2 and base in moving - positive for base, n in factors(argument).items())
        ]

    def __reduce__(self) -> tuple[Any, ...]:  # without the function, which cannot be pickled
        return Program, (self.inputs, self.lines, self.outputs)

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


@cache
def machine_code(program: Program) -> Any:
    """(x, q) → the outputs, for compiled kernels; the inputs are the tuples x and q, one after the other."""

    @unrolled
    def evaluate(x, q):
        return program(*x, *q)

    return evaluate


@cache
def tuple_loader(count: int) -> Any:
    """(c, first) → the tuple of `count` doubles that begins at c[first], for compiled kernels."""

    @jit(inline=True)
    def load(c, first):
        return load_tuple(c, first, count)

    return load
