"""Straight-line machine code from an ordinary Python function, by running the function once on symbols.

`@unrolled` turns a function of doubles and tuples of doubles into one that compiled code can call. Python runs its loops,
tuples and tests while compiling. The machine code contains only its operations, in their order: + − × ÷ of doubles and
`.sqrt()`, `.sin()`, `.cos()`, `.exp()`, `.log()`. So a formula may be a loop over a table of coefficients that skips zeros,
and costs as much as if written out by hand. Without compilation (NUMBA_DISABLE_JIT) the function is simply called, and
computes the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, update_wrapper, wraps
from typing import Any

from lagrange_bench.integrators.compiling.compiled import COMPILED, digest_of

if COMPILED:
    from llvmlite import ir
    from numba import types
    from numba.extending import lower_builtin, type_callable

    from lagrange_bench.integrators.compiling.machine_code import IDENTIFIED, identified

FUNCTIONS = ("sqrt", "sin", "cos", "exp", "log")


def _operators(name: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """a ∘ b and b ∘ a, as methods of a."""
    return lambda a, b: a.make(name, a, b), lambda a, b: a.make(name, b, a)


def _function(name: str) -> Callable[..., Any]:
    return lambda a: a.make(name, a)


class Number:
    """The base of all kinds of unknown numbers in formulas: operators and functions, which call `make`."""

    __slots__ = ()

    def make(self, operation: str, *operands: Any) -> Any:
        """The result of an operation."""
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
    """A double that is known only when the compiled code runs."""

    def __init__(self, emit: Any, value: Any):
        self.emit, self.value = emit, value

    def make(self, operation: str, *operands: Any) -> Symbol:
        """Emit the instruction of an operation."""
        values = [x.value if isinstance(x, Symbol) else self.value.type(float(x)) for x in operands]
        if operation in FUNCTIONS:
            function = self.emit.module.declare_intrinsic(f"llvm.{operation}", [self.value.type])
            return Symbol(self.emit, self.emit.call(function, values))
        return Symbol(self.emit, getattr(self.emit, f"f{operation}")(*values))


class Unknown(Number):
    """Any double. Every operation returns it."""

    def make(self, operation: str, *operands: Any) -> Unknown:
        """The same number, since any double may come out."""
        return self


class Unrolled:
    """An unrolled function. Called from Python, it runs the function itself.

    `digest` identifies it in all processes, as for a kernel.
    """

    def __init__(self, function: Callable[..., Any]):
        self.py_func, self.digest = function, digest_of(function)
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)

    def __reduce__(self) -> Any:
        return identified, (self.digest,)


def unrolled(function: Callable[..., Any] | None = None, *, inline: bool = True) -> Any:
    """The decorator. The function may close over all that `jit` takes, plain functions, and objects with a `digest`.

    inline : whether its operations are put into each caller. If not, callers share one copy: that compiles quicker, for what runs
    once.
    """
    if function is None:
        return partial(unrolled, inline=inline)
    if not COMPILED:
        return function
    result = Unrolled(function)
    IDENTIFIED[result.digest] = result

    @type_callable(result)
    def typed(context):
        @wraps(function)
        def type_of_call(*arguments):
            return type_of(function(*map(example, arguments)))

        return type_of_call

    @lower_builtin(result, types.VarArg(types.Any))
    def generate(context, builder, signature, values):
        if inline:
            return emit(context, builder, signature, values)
        name, kinds = f"{function.__name__}_{result.digest}", [value.type for value in values]
        copy = builder.module.globals.get(name)
        if copy is None:
            returned = context.get_value_type(signature.return_type)
            copy = ir.Function(builder.module, ir.FunctionType(returned, kinds), name)
            copy.linkage = "linkonce_odr"
            copy.attributes.add("noinline")
            inside = ir.IRBuilder(copy.append_basic_block())
            inside.ret(emit(context, inside, signature, copy.args))
        return builder.call(copy, values)

    def emit(context, builder, signature, values):
        symbols = (wrap(builder, kind, value) for kind, value in zip(signature.args, values, strict=True))
        return unwrap(context, builder, signature.return_type, function(*symbols))

    return result


def _is_tuple(kind: Any) -> bool:
    return isinstance(kind, types.BaseTuple)


def example(kind: Any) -> Any:
    """A value of a type, to find the type that a function returns."""
    return tuple(map(example, kind.types)) if _is_tuple(kind) else Unknown()


def type_of(value: Any) -> Any:
    return types.Tuple([type_of(v) for v in value]) if isinstance(value, tuple) else types.float64


def wrap(builder: Any, kind: Any, value: Any) -> Any:
    if _is_tuple(kind):
        return tuple(wrap(builder, t, builder.extract_value(value, i)) for i, t in enumerate(kind.types))
    return Symbol(builder, value)


def unwrap(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if _is_tuple(kind):
        parts = [unwrap(context, builder, t, v) for t, v in zip(kind.types, value, strict=True)]
        return context.make_tuple(builder, kind, parts)
    return value.value if isinstance(value, Symbol) else context.get_constant(kind, value)
