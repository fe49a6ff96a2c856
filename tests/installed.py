"""Methods that may be missing: those of packages that are not installed everywhere."""

import pytest

from lagrange_bench.integrators import METHODS, LagrangeTop, available

FOR_TOPS = {
    name: method for name, method in METHODS.items() if method.takes(LagrangeTop()) is None
}  # not for bodies only


def installed(name):
    """The record of a method; without its package the test that asks is skipped."""
    record = METHODS[name]
    if not available(record):
        pytest.skip(f"{record.requires} is not installed")
    return record
