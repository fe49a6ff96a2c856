"""Every method in the registry keeps what its record claims."""

import inspect
from pathlib import Path

import pytest

from lagrange_bench.experiments.measuring import check
from lagrange_bench.integrators import METHODS, methods
from lagrange_bench.integrators.registry import BUILT_IN
from tests.installed import installed

LONG = ("gauss8", "gauss12", "radau")  # 40 s; `test_problem` measures their orders, too
NAMES = [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in METHODS]


@pytest.mark.parametrize("quick", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["quick", "full"])
@pytest.mark.parametrize("name", NAMES)
def test_claims(name, quick):
    verdicts = check.check(installed(name), quick)
    failed = [f"{v.claim}: {v.measured} {v.bound} ({v.how})" for v in verdicts if v.passed is False]
    assert not failed
    assert sum(v.passed is True for v in verdicts) >= 8
    assert not any(v.claim.startswith("takes") for v in verdicts), "a moderate step was not taken"


def test_every_file_of_methods_is_registered():
    files = {path.stem for path in Path(methods.__file__).parent.glob("*.py")} - {
        "__init__",
        "backlund_choice",
        "backlund_schemes",
        "dense",
        "explicit",
        "gauss_coefficients",
        "gauss_in_field",
        "tableaux",
    }  # what several of them use
    known = {entry.value.partition(":")[0].rpartition(".")[2] for entry in METHODS._entries.values()}
    assert files <= known


def test_a_reason_for_a_uniform_field_only_is_given_where_it_is_so():
    """And only there: a splitting of the force alone does not answer with the reason of the processed one."""
    assert {name for name in BUILT_IN if METHODS[name].uniform_only} == {
        name for name in BUILT_IN if METHODS[name].needs == "uniform"
    }


@pytest.mark.parametrize("name", METHODS)
def test_options_are_keywords_with_defaults(name):
    """So that every method runs without any, and `evaluate` takes none that `prepare` does not know."""
    record = installed(name)
    parameters = inspect.signature(record.prepare).parameters
    assert all(parameters[option].default is not inspect.Parameter.empty for option in record.options)
