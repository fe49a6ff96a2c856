"""Loads and stores without checks, for kernels. Sizes and strides must be literals.

They use only Numba's public interface (`numba.extending`). Each has a Python function that does the same without compilation.
"""

import operator
from collections.abc import Callable
from typing import Any

from lagrange_bench.integrators.compiling.compiled import COMPILED

if COMPILED:
    from numba import TypingError, types
    from numba.core import cgutils
    from numba.extending import intrinsic


def as_python(function: Callable[..., Any]) -> Callable[[Callable[..., Any]], Any]:
    """A decorator for an intrinsic that does the same as a Python function."""

    def decorate(typed: Callable[..., Any]) -> Any:
        if not COMPILED:
            return function
        result: Any = intrinsic(typed)
        result.py_func = function  # like a kernel
        return result

    return decorate


def literals(*numbers):
    """The values of literals. Numba first passes plain integers, and literals after this error."""
    if not all(isinstance(number, types.IntegerLiteral) for number in numbers):
        raise TypingError("sizes and strides must be constants")
    return [number.literal_value for number in numbers]


@as_python(lambda size: [0.0] * size)
def stack(typingctx, size):
    """An uninitialised array of float64 on the stack, as scratch space of a kernel; `size` is a literal, indices are unchecked.

    (The constants of a kernel cannot serve as scratch space, since two threads may share them.)
    """
    (count,) = literals(size)

    def generate(context, builder, signature, args):
        return cgutils.alloca_once(builder, context.get_value_type(types.float64), size=count)

    return types.CPointer(types.float64)(size), generate


@as_python(lambda numbers, first, count: tuple(numbers[k] for k in range(first, first + count)))
def load_tuple(typingctx, numbers, first, count):
    """numbers[first], numbers[first + 1], … as a tuple, from an array, a pointer or a tuple; `count` is a literal."""
    (size,) = literals(count)
    item = typingctx.resolve_function_type(operator.getitem, (numbers, types.intp), {})

    def generate(context, builder, signature, args):
        get = context.get_function(operator.getitem, item)
        places = [builder.add(args[1], args[1].type(k)) for k in range(size)]
        return context.make_tuple(builder, signature.return_type, [get(builder, (args[0], place)) for place in places])

    return types.Tuple([item.return_type] * size)(numbers, types.intp, count), generate


def _store(numbers: Any, first: int, values: tuple[Any, ...]) -> None:
    for k, value in enumerate(values, first):
        numbers[k] = value


@as_python(_store)
def store_tuple(typingctx, numbers, first, values):
    """numbers[first], numbers[first + 1], … = values, a tuple of one number or more; `numbers` is as in `load_tuple`."""
    item = typingctx.resolve_function_type(operator.setitem, (numbers, types.intp, numbers.dtype), {})

    def generate(context, builder, signature, args):
        set_item = context.get_function(operator.setitem, item)
        for k in range(len(values)):
            place = builder.add(args[1], args[1].type(k))
            set_item(builder, (args[0], place, builder.extract_value(args[2], k)))
        return context.get_dummy_value()

    return types.none(numbers, types.intp, values), generate


def _column(array: Any, place: int, count: int, stride: int) -> tuple[Any, ...]:
    return tuple(array.reshape(-1)[place : place + count * stride : stride])


@as_python(_column)
def column(typingctx, array, place, count, stride):
    """array[place], array[place + stride], … as a tuple; `count` and `stride` are literals, places are unchecked.

    The array is stored row by row, as in C. Between these loads and the stores of `put_column` LLVM sees only constant distances,
    so a loop over neighbouring places becomes SIMD code without any test for overlaps.
    """
    number, distance = literals(count, stride)

    def generate(context, builder, signature, args):
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        places = [builder.add(args[1], args[1].type(k * distance)) for k in range(number)]
        loaded = [builder.load(builder.gep(data, [place])) for place in places]
        return context.make_tuple(builder, signature.return_type, loaded)

    return types.UniTuple(array.dtype, number)(array, types.int64, count, stride), generate


def _put_column(array: Any, place: int, values: tuple[Any, ...], stride: int) -> None:
    array.reshape(-1)[place : place + len(values) * stride : stride] = values


@as_python(_put_column)
def put_column(typingctx, array, place, values, stride):
    """array[place], array[place + stride], … = values, a tuple; see `column`."""
    (distance,) = literals(stride)

    def generate(context, builder, signature, args):
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        for k in range(len(signature.args[2])):
            place = builder.add(args[1], args[1].type(k * distance))
            builder.store(builder.extract_value(args[2], k), builder.gep(data, [place]))
        return context.get_dummy_value()

    return types.none(array, types.int64, values, stride), generate
