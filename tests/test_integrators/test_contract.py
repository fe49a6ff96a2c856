"""Every method in the registry keeps what its record claims."""

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import check, states
from lagrange_bench.integrators import METHODS
from tests.installed import FOR_TOPS, installed

LONG = ("gauss6", "gauss8")  # a minute; `test_problem` measures their orders, too
NAMES = [pytest.param(name, marks=[pytest.mark.slow] if name in LONG else []) for name in METHODS]
ELSEWHERE = {  # judged in fields with test-all; in `make test` by other tests
    *("backlund_splitting", "taylor_fixed", *LONG),  # `test_backlund_splitting`, `test_problem`
    *("gauss4", "blanes_moan6", "kahan_li8"),  # the code of others; `test_gauss`, `test_problem`
}
IN_FIELDS = [
    name
    for name in FOR_TOPS
    if METHODS[name].takes(states.placed("generic in a tide").top) is None and name not in ELSEWHERE
]
pytestmark = pytest.mark.filterwarnings("ignore::lagrange_bench.integrators.interface.StepWarning")


def require(verdicts, least):
    assert [str(v) for v in verdicts if v.passed is False] == []
    assert sum(v.passed is True for v in verdicts) >= least
    assert not any(v.claim.startswith("takes") for v in verdicts), "a moderate step was not taken"


@pytest.mark.parametrize("name", NAMES)
def test_claims(name):
    """On tops in a uniform field; of methods for a body, on one."""
    record = installed(name)
    checks = check.CHECKS[:-1] if name in FOR_TOPS else (check.of_its_kind,)
    require([verdict for function in checks for verdict in function(record, True)], 8)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", IN_FIELDS)
def test_claims_in_a_field(name, monkeypatch):
    monkeypatch.setattr(check, "FIELD_STEPS", 50)
    with np.errstate(all="ignore"):  # where nothing is compiled, NumPy warns of an overflow
        require(list(check.in_field(installed(name), True)), 4)


@pytest.mark.interpreted
@pytest.mark.parametrize("name", ["strang", pytest.param("implicit_midpoint", marks=pytest.mark.slow)])
def test_claims_on_a_body(name, monkeypatch):
    monkeypatch.setattr(check, "FIELD_STEPS", 50)
    with np.errstate(all="ignore"):
        require(list(check.of_its_kind(METHODS[name], True)), 12)


@pytest.mark.slow
@pytest.mark.parametrize("name", METHODS)
def test_all_claims(name):
    require(check.check(installed(name)), 8)
