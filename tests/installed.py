"""Methods that may be missing: those of packages that are not installed everywhere."""

from dataclasses import replace

import pytest

from lagrange_bench.integrators import METHODS, LagrangeTop, available


def in_uniform_fields(method, **changes):
    """The method as one for a uniform field only, with the kernel that it has there; `changes` of its record."""
    alone = replace(method, prepare=method.kernels_for.get("uniform", method.prepare), needs="uniform", kernels_for={})
    return replace(alone, **changes)


# not those for bodies only
FOR_TOPS = {name: method for name, method in METHODS.items() if method.takes(LagrangeTop()) is None}


def installed(name):
    """The record of a method; without its package the test that asks is skipped."""
    record = METHODS[name]
    if not available(record):
        pytest.skip(f"{record.requires} is not installed")
    return record
