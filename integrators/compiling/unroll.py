"""Straight-line machine code from an ordinary Python function, by running the function once on symbols.

`@unrolled` turns a function of doubles and tuples of doubles into one that compiled code can call. Its loops, tuples and
tests are those of Python and happen while compiling; what is left are the operations it asks for, in its order: + − × ÷ of
doubles and `.sqrt()`, `.sin()`, `.cos()`, `.exp()`, `.log()`. So a formula may be written as a loop over a table of
coefficients, zeros left out, and costs what it would cost written out by hand. Without compilation (NUMBA_DISABLE_JIT) the
function is simply called, and computes the same bits.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from numba import types
from numba.extending import intrinsic

from lagrange_bench.integrators.compiling.numba_internals import config, set_name

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


def unrolled(name: str) -> Callable[[Callable[..., Any]], Any]:
    """The decorator; `name` tells the function from others of its module, also from its siblings if a factory makes it."""

    def decorate(function: Callable[..., Any]) -> Any:
        if config.DISABLE_JIT:
            return function

        def typed(typingctx, *arguments):
            result = function(*map(example, arguments))

            def generate(context, builder, signature, values):
                symbols = (wrap(builder, t, v) for t, v in zip(arguments, values, strict=True))
                return unwrap(context, builder, result_type, function(*symbols))

            result_type = type_of(result)
            return result_type(*arguments), generate

        own = inspect.Parameter("typingctx", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        typed.__signature__ = inspect.Signature([own, *inspect.signature(function).parameters.values()])  # type: ignore
        made = set_name(intrinsic(typed), f"{function.__module__}.{name}")
        made.py_func = function  # as of a dispatcher: the function itself
        return made

    return decorate


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
