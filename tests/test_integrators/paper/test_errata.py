"""Every erratum on record: visibly wrong as printed, right as corrected; and docs/equations.md names what exists."""

import importlib
from functools import reduce
from pathlib import Path
from random import Random

import pytest

from lagrange_bench.experiments.paper_sections import SECTIONS
from lagrange_bench.integrators.paper.errata import errata

RECORDS = errata()


@pytest.mark.parametrize("record", RECORDS, ids=[f"{e.section}: {e.equation}" for e in RECORDS])
def test_printed_is_wrong_and_corrected_is_right(record):
    for seed in range(2):
        assert record.residual(Random(seed), True) > 1e-6
        assert record.residual(Random(seed), False) <= 1e-12


LINES = (Path(__file__).resolve().parents[3] / "docs" / "equations.md").read_text(encoding="utf-8").splitlines()
CELLS = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in LINES if line.startswith("| ")]
ROWS = [row for row in CELLS if row[0] not in ("equation", "place")]  # place, what, functions, tests


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_functions_and_tests_exist(row):
    named, tests = ([word.strip("`") for word in cell.split(", ")] for cell in row[2:])
    for name in named:
        module, *path = name.split(".")
        assert callable(reduce(getattr, path, importlib.import_module(f"lagrange_bench.integrators.paper.{module}")))
    for name in tests:
        module, _, function = name.partition(".")
        if function:
            assert callable(getattr(importlib.import_module(f"tests.test_integrators.paper.{module}"), function))
        else:
            assert name.removeprefix("paper ") in SECTIONS
