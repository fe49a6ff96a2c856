"""Straight-line machine code from an ordinary Python function, by running the function once on symbols.

`@unrolled` turns a function of doubles and tuples of doubles into one that compiled code can call. Its loops, tuples and
tests are those of Python and happen while compiling; what is left are the operations it asks for, in its order: + − × ÷ of
doubles and `.sqrt()`, `.sin()`, `.cos()`, `.exp()`, `.log()`. So a formula may be written as a loop over a table of
coefficients, zeros left out, and costs what it would cost written out by hand. Without compilation (NUMBA_DISABLE_JIT) the
function is simply called, and computes the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper, wraps
from typing import Any

from numba import types
from numba.extending import lower_builtin, type_callable

from lagrange_bench.integrators.compiling.compiled import COMPILED, IDENTIFIED, digest_of, identified

TUPLE: Any = types.BaseTuple
FUNCTIONS = ("sqrt", "sin", "cos", "exp", "log")


def _operators(name: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """a ∘ b and b ∘ a, as methods of a."""
    return lambda a, b: a.make(name, a, b), lambda a, b: a.make(name, b, a)


def _function(name: str) -> Callable[..., Any]:
    return lambda a: a.make(name, a)


class Number:
    """What formulas reckon with: operators and functions of all kinds of unknown numbers, each of which says what it makes."""

    __slots__ = ()

    def make(self, operation: str, *operands: Any) -> Any:
        """The number that an operation gives."""
        raise NotImplementedError

    __add__, __radd__ = _operators("add")
    __sub__, __rsub__ = _operators("sub")
    __mul__, __rmul__ = _operators("mul")
    __truediv__, __rtruediv__ = _operators("div")
    __neg__ = _function("neg")
    sqrt, sin, cos, exp, log = map(_function, FUNCTIONS)

    def __bool__(self) -> bool:
        raise TypeError("an unrolled function cannot branch on a number that is not known yet")


class Symbol(Number):
    """A double that compiled code will know."""

    def __init__(self, emit: Any, value: Any):
        self.emit, self.value = emit, value

    def make(self, operation: str, *operands: Any) -> Symbol:
        """The instruction, emitted."""
        values = [x.value if isinstance(x, Symbol) else self.value.type(float(x)) for x in operands]
        if operation in FUNCTIONS:
            function = self.emit.module.declare_intrinsic(f"llvm.{operation}", [self.value.type])
            return Symbol(self.emit, self.emit.call(function, values))
        return Symbol(self.emit, getattr(self.emit, f"f{operation}")(*values))


class Unknown(Number):
    """Any double: whatever is done with it gives one again."""

    def make(self, operation: str, *operands: Any) -> Unknown:
        """Itself."""
        return self


class Unrolled:
    """What `unrolled` makes of a function. Called from Python it is that function.

    `digest` identifies it in all processes, as that of a kernel does.
    """

    def __init__(self, function: Callable[..., Any]):
        self.py_func, self.digest = function, digest_of(function)
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)

    def __reduce__(self) -> Any:
        return identified, (self.digest,)


def unrolled(function: Callable[..., Any]) -> Any:
    """The decorator. The function may close over what `jit` takes, and over plain functions and what has a `digest`."""
    if not COMPILED:
        return function
    made = Unrolled(function)
    IDENTIFIED[made.digest] = made

    @type_callable(made)
    def typed(context):
        @wraps(function)
        def result(*arguments):
            return type_of(function(*map(example, arguments)))

        return result

    @lower_builtin(made, types.VarArg(types.Any))
    def generate(context, builder, signature, values):
        symbols = (wrap(builder, kind, value) for kind, value in zip(signature.args, values, strict=True))
        return unwrap(context, builder, signature.return_type, function(*symbols))

    return made


def example(kind: Any) -> Any:
    """Any value of a type: what a function returns for it shows what it returns for all."""
    return tuple(map(example, kind.types)) if isinstance(kind, TUPLE) else Unknown()


def type_of(value: Any) -> Any:
    return types.Tuple([type_of(v) for v in value]) if isinstance(value, tuple) else types.float64


def wrap(builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, TUPLE):
        return tuple(wrap(builder, t, builder.extract_value(value, i)) for i, t in enumerate(kind.types))
    return Symbol(builder, value)


def unwrap(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, TUPLE):
        parts = [unwrap(context, builder, t, v) for t, v in zip(kind.types, value, strict=True)]
        return context.make_tuple(builder, kind, parts)
    return value.value if isinstance(value, Symbol) else context.get_constant(kind, value)
