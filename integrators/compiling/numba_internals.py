"""All that rests on Numba's insides: how callees are linked, its cache, its names for functions, loads and stores without checks.

Numba may change these in any minor version and does not announce it. So pyproject.toml admits none above the newest that was
tested. Sizes and strides of what is here must be literals.
"""

from __future__ import annotations

import contextlib
import operator
import os
import re
import secrets
import uuid
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numba
from numba import TypingError, types
from numba.extending import intrinsic, lower_builtin, models, register_model

config: Any = numba.config  # its attributes are made at run time
core: Any = numba.core
cgutils = core.cgutils
NumbaError: Any = core.errors.NumbaError


def useful_lines(error: Any) -> str:
    """Of an error of Numba, in one line: what is wrong, and the innermost place that is not in this folder."""
    words = []
    for line in str(error).splitlines():
        if line.startswith(("During:", "There are", 'File "')):
            break
        if line.strip() and not line.startswith("Failed in"):
            words.append(line.strip())
    places = re.findall(r'^(?:During: .* at|File) "?(.+?)"?,? (?:\(|line )(\d+)[):]$', str(error), re.MULTILINE)
    here = os.path.dirname(__file__)
    where = [f" ({file}:{line})" for file, line in places if os.path.dirname(os.path.abspath(file)) != here]
    return f"{' '.join(words)[:300]}{''.join(where[:1])}"


# A function's number is part of the names of its machine code. Numba counts from 1 in every process: of two functions with one
# source and one number, cached by two processes, a third that loads both would run the first in place of the second. Random
# numbers are the same in no two processes, forked ones included.
core.bytecode.FunctionIdentity._unique_ids = iter(lambda: secrets.randbits(62), None)


class _LibraryToLink(core.codegen.JITCodeLibrary):
    """The code of a function that is only ever called by compiled code: LLVM optimises and emits it with its caller.

    Numba would optimise and emit every callee by itself as well, which takes half of the time of a compilation.
    """

    codegen = SimpleNamespace(set_env=lambda name, environment: None)  # nothing is emitted; see `_set_environments`

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name):
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self):
        return self.name, "to link", self._get_module_for_linking().as_bitcode()


def _load_library(
    kind: Any, codegen: Any, state: Any, others: Any = core.codegen.JITCodeLibrary._unserialize.__func__
) -> Any:
    """What Numba does to read a library from its cache, for ours as well."""
    name, form, code = state
    if form != "to link":
        return others(kind, codegen, state)
    library = _LibraryToLink(codegen, name)
    library._final_module = core.codegen.ll.parse_bitcode(code)
    library._finalize_final_module()
    return library


def _set_environments(library: Any, finish: Any = core.codegen.JITCodeLibrary._finalize_specific) -> None:
    """What Numba does when it has emitted a function, for the callees linked into it as well: `print` in one needs it."""
    finish(library)
    for variable in library._final_module.global_variables:
        environment = core.environment.lookup_environment(variable.name)
        if environment is not None and not variable.is_declaration:
            library._codegen.set_env(variable.name, environment)


core.codegen.JITCodeLibrary._unserialize = classmethod(_load_library)
core.codegen.JITCodeLibrary._finalize_specific = _set_environments


@core.compiler_machinery.register_pass(mutates_CFG=True, analysis_only=False)
class _LoweringToLink(core.typed_passes.NativeLowering):
    _name = "lowering_to_link"

    def run_pass(self, state):
        state.library = _LibraryToLink(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().run_pass(state)


class CompilerToLink(core.compiler.CompilerBase):
    """Numba's compiler, for functions that only compiled code calls."""

    def define_pipelines(self):
        passes = core.compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        plain = core.typed_passes.NativeLowering
        passes.passes = [(_LoweringToLink if kind is plain else kind, text) for kind, text in passes.passes]
        passes._finalized = False
        passes.finalize()
        return [passes]


LINKED = ("get_call_template", "get_overload")  # what Numba asks a function for when a caller of it is compiled


def link(dispatcher: Any, make: Callable[[], Any]) -> Any:
    """`dispatcher` for callers in Python; for compiled ones what `make` makes of the same function with `CompilerToLink`."""
    callee = cache(make)
    for name in LINKED:
        setattr(dispatcher, name, lambda *given, name=name: getattr(callee(), name)(*given))
    return dispatcher


def unlink(dispatcher: Any) -> Any:
    """Undo `link`: compiled callers get the function as LLVM optimised it by itself."""
    for name in LINKED:
        vars(dispatcher).pop(name, None)
    return dispatcher


def keep_code(decorator: Callable[..., Any], function: Callable[..., Any], folder: str) -> Any:
    """`decorator(function)`, a decorator of Numba with a cache, which is in `folder`."""
    before = config.CACHE_DIR
    config.CACHE_DIR = folder  # read while decorating, so other packages keep their own place
    try:
        dispatcher = decorator(function)
    finally:
        config.CACHE_DIR = before
    kept = dispatcher._cache
    files = kept._cache_file
    # Numba counts its files: two processes that save at once would take one file for two variants
    files._data_name = lambda number: f"{kept._impl.filename_base}.{uuid.uuid4().hex}.nbc"
    save = kept.save_overload

    def save_if_possible(signature: Any, data: Any) -> None:
        # what cannot be kept for the next process is compiled there again: no reason for this one to fail
        with contextlib.suppress(OSError):
            save(signature, data)

    kept.save_overload = save_if_possible
    return dispatcher


def set_name(thing: Any, text: str) -> Any:
    """A dispatcher or intrinsic with a name made of `text`, the same in all processes: Numba's own is random."""
    thing._set_uuid(str(uuid.uuid5(uuid.NAMESPACE_OID, text)))
    return thing


def name_of(dispatcher: Any) -> str:
    return str(dispatcher._uuid)


def is_kept(dispatcher: Any) -> bool:
    """Whether the cache has machine code of a function, of whatever types."""
    kept = dispatcher._cache
    files = getattr(kept, "_cache_file", None)
    if files is None or not os.path.exists(files._index_path):
        return False
    own = kept._index_key(None, dispatcher.targetctx.codegen())[-1]  # functions of a factory share a file
    return any(key[-1] == own for key in files._load_index())


def named_intrinsic(function: Callable[..., Any]) -> Any:
    """An intrinsic whose name is the same in all processes."""
    return set_name(intrinsic(function), f"{function.__module__}.{function.__qualname__}")


def address_of(dispatcher: Any) -> int:
    """Where the machine code is of a function of a pointer to doubles that gives an int; compiles it."""
    dispatcher.compile((types.CPointer(types.float64),))
    (made,) = dispatcher.overloads.values()
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name))


def call_by_name(address: int, name: str) -> Any:
    """A function of a pointer to doubles that gives an int, as LLVM finds it by that name from now on."""
    core.codegen.ll.add_symbol(name, address)

    def call(typingctx, numbers):  # closes over no type of Numba: these have other numbers in each process
        def generate(context, builder, signature, args):
            kind = cgutils.ir.FunctionType(context.get_value_type(signature.return_type), [args[0].type])
            return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

        return types.int64(numbers), generate

    return set_name(intrinsic(call), f"call {name}")


if config.DISABLE_JIT:

    def stack(size):
        return [0.0] * size

    def column(array, place, count, stride):
        return tuple(array.reshape(-1)[place : place + count * stride : stride])

    def put_column(array, place, values, stride):
        array.reshape(-1)[place : place + len(values) * stride : stride] = values

    def strided(array, place, stride):
        return array[place::stride]

else:

    def literals(*numbers):
        """Their values; Numba tries any integers first, and after this error constants."""
        if not all(isinstance(number, types.IntegerLiteral) for number in numbers):
            raise TypingError("sizes and strides must be constants")
        return [number.literal_value for number in numbers]

    @named_intrinsic
    def stack(typingctx, size):
        """An uninitialised array of float64 on the stack, for a kernel's scratch: `size` is a literal, indices unchecked.

        Not in the constants of a kernel: two threads may share those.
        """
        (count,) = literals(size)

        def generate(context, builder, signature, args):
            return cgutils.alloca_once(builder, context.get_value_type(types.float64), size=count)

        return types.CPointer(types.float64)(size), generate

    @named_intrinsic
    def column(typingctx, array, place, count, stride):
        """array[place], array[place + stride], … as a tuple; `count` and `stride` are literals, places unchecked.

        Rows of the array lie one after the other, as in C.

        Between these loads and the stores below LLVM sees constant distances only: a loop over neighbouring places
        becomes SIMD code without any test for overlaps.
        """
        number, distance = literals(count, stride)

        def generate(context, builder, signature, args):
            data = context.make_array(signature.args[0])(context, builder, args[0]).data
            places = [builder.add(args[1], args[1].type(k * distance)) for k in range(number)]
            loaded = [builder.load(builder.gep(data, [place])) for place in places]
            return context.make_tuple(builder, signature.return_type, loaded)

        return types.UniTuple(array.dtype, number)(array, types.int64, count, stride), generate

    @named_intrinsic
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

    class Strided(types.CPointer):
        """A pointer to array[place], array[place + stride], … that Numba reads and writes by index, unchecked."""

        key = property(lambda kind: (kind.dtype, kind.stride))

        def __init__(self, dtype, stride):
            self.stride = stride
            super().__init__(dtype)
            self.name = f"Strided({dtype}, {stride})"

    register_model(Strided)(models.PointerModel)

    @named_intrinsic
    def strided(typingctx, array, place, stride):
        """The numbers of `column` as something that a kernel may write into; `stride` is a literal."""

        def generate(context, builder, signature, args):
            return builder.gep(context.make_array(signature.args[0])(context, builder, args[0]).data, [args[1]])

        return Strided(array.dtype, *literals(stride))(array, types.int64, stride), generate

    def _place(builder, kind, args):
        return builder.gep(args[0], [builder.mul(args[1], args[1].type(kind.stride))])

    @lower_builtin(operator.getitem, Strided, types.intp)
    def read_strided(context, builder, signature, args):
        return builder.load(_place(builder, signature.args[0], args))

    @lower_builtin(operator.setitem, Strided, types.intp, types.Any)
    def write_strided(context, builder, signature, args):
        builder.store(args[2], _place(builder, signature.args[0], args))
        return context.get_dummy_value()
