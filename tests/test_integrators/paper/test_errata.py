"""Every erratum on record: visibly wrong as printed, right to round-off as corrected, at two random points each."""

import importlib
import pkgutil
from random import Random

import pytest

from lagrange_bench.integrators import paper
from lagrange_bench.integrators.paper.errata import errata

RECORDS = errata()


@pytest.mark.parametrize("record", RECORDS, ids=[f"{e.section}: {e.equation}" for e in RECORDS])
def test_printed_is_wrong_and_corrected_is_right(record):
    for seed in range(2):
        assert record.printed(Random(seed)) > 1e-6
        assert record.corrected(Random(seed)) <= 1e-12


def test_every_record_is_gathered_once():
    keys = [(e.section, e.equation, e.printed_text) for e in RECORDS]
    assert len(set(keys)) == len(keys)
    for module in pkgutil.iter_modules(paper.__path__):
        for record in getattr(importlib.import_module(f"lagrange_bench.integrators.paper.{module.name}"), "ERRATA", []):
            assert record in RECORDS
