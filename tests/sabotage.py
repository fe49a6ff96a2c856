"""What tests of sabotage share: a method with one spoiled line, and the claims that it fails."""

import inspect
import types

from lagrange_bench.experiments.measuring import check
from tests.installed import in_uniform_fields


def failed(method, quick=True):
    return {v.claim for v in check.check(method, quick) if v.passed is False}


def spoiled(module, old="", new="", record="METHOD"):
    """The record of the module with `old`, which occurs once, replaced by `new` in its source; for a uniform field only.

    The lines that tests spoil are of kernels for a uniform field: those for others would be compiled for nothing.
    """
    source = inspect.getsource(module)
    assert not old or source.count(old) == 1, old
    source = source.replace(old, new) if old else source
    source = source.replace("compiled import jit", "compiled import compiled as jit")
    copy = types.ModuleType("spoiled")
    exec(compile(source, module.__file__, "exec"), copy.__dict__)
    return in_uniform_fields(getattr(copy, record))
