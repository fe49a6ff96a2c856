"""How this project compiles: one decorator, and a cache of machine code that cannot go stale.

Fused multiply-add contraction and fastmath are off: the same bits on every IEEE machine. Numba's own cache only
notices a change in the file of the function itself, not in the functions it calls; so ours lives in a folder named by
a digest of all compiled sources, in the user's cache directory (LAGRANGE_BENCH_CACHE moves it, empty switches it off).
"""

from __future__ import annotations

import contextlib
import hashlib
import operator
import os
import uuid
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

config: Any = numba.config  # its attributes are made at run time
njit: Any = numba.njit  # its types know fewer options than it has
OPTIONS = {"error_model": "numpy", "nogil": True, "fastmath": False, "no_cfunc_wrapper": True}


@cache
def _folder() -> str | None:
    home = os.environ.get("LAGRANGE_BENCH_CACHE")
    if home is None:
        home = os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "lagrange-bench")
    if not home:
        return None
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(source.read_bytes())
    folder = os.path.join(home, digest.hexdigest()[:16])
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def compiled(function: Callable[..., Any], **more: Any) -> Any:
    """Compile without caching."""
    return njit(**OPTIONS, **more)(function)


def jit(function: Callable[..., Any], **more: Any) -> Any:
    """Compile a function of this package; its machine code is kept for the next process.

    With NUMBA_DISABLE_JIT=1 in the environment it stays a Python function, and computes the same bits.
    """
    folder = None if config.DISABLE_JIT else _folder()
    if folder is None:
        return compiled(function, **more)
    before = config.CACHE_DIR
    config.CACHE_DIR = folder  # read while decorating, so other packages keep their own place
    try:
        dispatcher = njit(**OPTIONS, **more, cache=True)(function)
    finally:
        config.CACHE_DIR = before
    _forgive_full_disk(dispatcher._cache)
    if function.__closure__ is None:
        # Numba's random name for a function is part of the key of every closure over it: one name for all processes
        dispatcher._set_uuid(lasting_name(f"{folder} {function.__module__}.{function.__qualname__}"))
    return dispatcher


def inlined(function: Callable[..., Any]) -> Any:
    """`jit`, and the code goes wherever it is called: for short kernels, where a call costs as much as the work."""
    return jit(function, forceinline=True)


def lasting_name(text: str) -> str:
    return str(uuid.uuid5(uuid.NAMESPACE_OID, text))


def jit_as(name: str) -> Callable[[Callable[..., Any]], Any]:
    """The decorator `jit` for a function that a factory makes; `name` tells it from its siblings, in all processes."""

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = jit(function)
        if not config.DISABLE_JIT:
            dispatcher._set_uuid(lasting_name(f"{_folder()} {function.__module__}.{name}"))
        return dispatcher

    return decorate


def jit_over(*kernels: Any) -> Callable[[Callable[..., Any]], Any]:
    """The decorator for a function that closes over `kernels`: cached if they all are this package's own.

    Of another package's functions the digest knows nothing: what closes over them is compiled in every process.
    """
    if config.DISABLE_JIT:
        return compiled
    ours = all(k is None or k.py_func.__module__.startswith("integrators.") for k in kernels)
    return jit if ours else compiled


def inlined_copy(kernel: Any) -> Any:
    """A compiled function once more, as `inlined` would have it: a loop around the call of a long kernel is never SIMD code.

    Not cached: what closes over it is.
    """
    if config.DISABLE_JIT:
        return kernel
    copy = compiled(kernel.py_func, forceinline=True)
    copy._set_uuid(lasting_name(f"{kernel._uuid} inlined"))
    return copy


def _forgive_full_disk(cached: Any) -> None:
    """What cannot be kept for the next process is compiled there again: no reason for this one to fail."""
    save = cached.save_overload

    def save_if_possible(signature: Any, data: Any) -> None:
        with contextlib.suppress(OSError):
            save(signature, data)

    cached.save_overload = save_if_possible


def named_intrinsic(function: Callable[..., Any]) -> Any:
    """An intrinsic whose name is the same in all processes, as `jit` has it."""
    made: Any = intrinsic(function)
    made._set_uuid(lasting_name(f"{function.__module__}.{function.__qualname__}"))
    return made


if config.DISABLE_JIT:

    def stack(size):
        return [0.0] * size

    def column(array, place, count, stride):
        return tuple(array[place + k * stride] for k in range(count))

    def put_column(array, place, values, stride):
        for k, value in enumerate(values):
            array[place + k * stride] = value

    class StridedView:
        def __init__(self, array, place, stride):
            self.array, self.place, self.stride = array, place, stride

        def __getitem__(self, k):
            return self.array[self.place + k * self.stride]

        def __setitem__(self, k, value):
            self.array[self.place + k * self.stride] = value

    def strided(array, place, stride):
        return StridedView(array, place, stride)

else:

    @named_intrinsic
    def stack(typingctx, size):
        """An uninitialised array of float64 on the stack, for a kernel's scratch: `size` is a literal, indices unchecked.

        Not in the constants of a kernel: two threads may share those.
        """
        if not isinstance(size, types.IntegerLiteral):
            raise numba.errors.TypingError("the size of a stack array must be a constant")
        count = size.literal_value

        def generate(context, builder, signature, args):
            return cgutils.alloca_once(builder, context.get_value_type(types.float64), size=count)

        return types.CPointer(types.float64)(size), generate

    @named_intrinsic
    def column(typingctx, array, place, count, stride):
        """array[place], array[place + stride], … as a tuple; `count` and `stride` are literals, places unchecked.

        Between these loads and the stores below LLVM sees constant distances only: a loop over neighbouring places
        becomes SIMD code without any test for overlaps.
        """
        if not (isinstance(count, types.IntegerLiteral) and isinstance(stride, types.IntegerLiteral)):
            raise numba.errors.TypingError("count and stride must be constants")
        number, distance = count.literal_value, stride.literal_value

        def generate(context, builder, signature, args):
            data = context.make_array(signature.args[0])(context, builder, args[0]).data
            places = [builder.add(args[1], args[1].type(k * distance)) for k in range(number)]
            loaded = [builder.load(builder.gep(data, [place])) for place in places]
            return context.make_tuple(builder, signature.return_type, loaded)

        return types.UniTuple(array.dtype, number)(array, types.int64, count, stride), generate

    @named_intrinsic
    def put_column(typingctx, array, place, values, stride):
        """array[place], array[place + stride], … = values, a tuple; see `column`."""
        if not isinstance(stride, types.IntegerLiteral):
            raise numba.errors.TypingError("stride must be a constant")
        distance = stride.literal_value

        def generate(context, builder, signature, args):
            data = context.make_array(signature.args[0])(context, builder, args[0]).data
            for k in range(len(signature.args[2])):
                place = builder.add(args[1], args[1].type(k * distance))
                builder.store(builder.extract_value(args[2], k), builder.gep(data, [place]))
            return context.get_dummy_value()

        return types.none(array, types.int64, values, stride), generate

    class Strided(types.Type):
        """array[place], array[place + stride], … to be read and written one by one, indices unchecked."""

        def __init__(self, dtype, stride):
            self.dtype, self.stride = dtype, stride
            super().__init__(name=f"Strided({dtype}, {stride})")

    @register_model(Strided)
    class StridedModel(models.PrimitiveModel):
        def __init__(self, manager, kind):
            super().__init__(manager, kind, manager.lookup(types.CPointer(kind.dtype)).get_value_type())

    @named_intrinsic
    def strided(typingctx, array, place, stride):
        """The numbers of `column` as something that a kernel may write into; `stride` is a literal."""
        if not isinstance(stride, types.IntegerLiteral):
            raise numba.errors.TypingError("stride must be a constant")

        def generate(context, builder, signature, args):
            return builder.gep(context.make_array(signature.args[0])(context, builder, args[0]).data, [args[1]])

        return Strided(array.dtype, stride.literal_value)(array, types.int64, stride), generate

    @infer_global(operator.getitem)
    class ReadStrided(AbstractTemplate):
        def generic(self, args, kws):
            if isinstance(args[0], Strided) and isinstance(args[1], types.Integer):
                return args[0].dtype(args[0], types.intp)
            return None

    @infer_global(operator.setitem)
    class WriteStrided(AbstractTemplate):
        def generic(self, args, kws):
            if isinstance(args[0], Strided) and isinstance(args[1], types.Integer):
                return types.none(args[0], types.intp, args[0].dtype)
            return None

    def _place(builder, kind, args):
        return builder.gep(args[0], [builder.mul(args[1], args[1].type(kind.stride))])

    @lower_builtin(operator.getitem, Strided, types.intp)
    def read_strided(context, builder, signature, args):
        return builder.load(_place(builder, signature.args[0], args))

    @lower_builtin(operator.setitem, Strided, types.intp, types.Any)
    def write_strided(context, builder, signature, args):
        builder.store(args[2], _place(builder, signature.args[0], args))
        return context.get_dummy_value()
