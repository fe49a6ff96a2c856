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


class Symbol:
    """A double that compiled code will know."""

    def __init__(self, emit: Any, value: Any):
        self.emit, self.value = emit, value

    def __add__(self, other: Any) -> Symbol:
        return self._of("fadd", self, other)

    def __sub__(self, other: Any) -> Symbol:
        return self._of("fsub", self, other)

    def __mul__(self, other: Any) -> Symbol:
        return self._of("fmul", self, other)

    def __truediv__(self, other: Any) -> Symbol:
        return self._of("fdiv", self, other)

    def __radd__(self, other: Any) -> Symbol:
        return self._of("fadd", other, self)

    def __rsub__(self, other: Any) -> Symbol:
        return self._of("fsub", other, self)

    def __rmul__(self, other: Any) -> Symbol:
        return self._of("fmul", other, self)

    def __neg__(self) -> Symbol:
        return Symbol(self.emit, self.emit.fneg(self.value))

    def sqrt(self) -> Symbol:
        return self._call("llvm.sqrt")

    def sin(self) -> Symbol:
        return self._call("llvm.sin")

    def cos(self) -> Symbol:
        return self._call("llvm.cos")

    def exp(self) -> Symbol:
        return self._call("llvm.exp")

    def log(self) -> Symbol:
        return self._call("llvm.log")

    def __rtruediv__(self, other: Any) -> Symbol:
        return self._of("fdiv", other, self)

    def __bool__(self) -> bool:
        raise TypeError("an unrolled function cannot branch on a number that is not known yet")

    def _call(self, name: str) -> Symbol:
        function = self.emit.module.declare_intrinsic(name, [self.value.type])
        return Symbol(self.emit, self.emit.call(function, [self.value]))

    def _of(self, operation: str, a: Any, b: Any) -> Symbol:
        a, b = (x.value if isinstance(x, Symbol) else self.value.type(float(x)) for x in (a, b))
        return Symbol(self.emit, getattr(self.emit, operation)(a, b))


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


class Unknown:
    """Any double: whatever is done with it gives one again."""

    def __add__(self, other: Any = None) -> Unknown:
        return self

    __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = __neg__ = __add__
    sqrt = sin = cos = exp = log = __add__
    __bool__ = Symbol.__bool__


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
