"""Tests for users' own methods: the assertions fail where they should, and name the top, the step and the value."""

import re
from dataclasses import replace

import numpy as np
import pytest

from lagrange_bench import assert_drift, assert_order, integrate
from lagrange_bench.ask import testing
from lagrange_bench.experiments.measuring import states
from lagrange_bench.integrators import METHODS, LagrangeTop

MINE = replace(METHODS["strang"], name="mine")  # of nobody's registry


def test_a_method_within_its_bounds():
    assert_drift("backlund", tops=("generic", "fast"), h_scaled=(0.1, 2.0), steps=20_000, H=16, C1=16, C2=16)
    assert_drift(MINE, tops=["generic", "magnet"], steps=1000, C1=200)
    assert_drift(MINE, tops=[(LagrangeTop(1.0), [0.0, 1, 2, 0.6, 0, 0.8])], steps=1000, J3=0)
    assert "mine" not in METHODS


def test_a_bound_that_is_exceeded_names_top_step_and_value():
    with pytest.raises(AssertionError) as caught:
        assert_drift(MINE, tops=("generic", "figure1"), h_scaled=(0.1, 0.2), steps=1000, H=16, J3=0)
    lines = str(caught.value).splitlines()
    assert len(lines) == 4, "J3 stays"
    assert re.fullmatch(r"mine: H is off by \S+ ulps at step \d+ on generic, h_scaled = 0.2: 16 allowed", lines[1])


def test_drift_is_in_ulps_of_the_scale():
    top, y0 = states.find("generic")
    h = 0.1 * top.scales(y0)[2]
    (run,) = testing.drifts(MINE, testing.starts_of("generic", MINE), None, 0.1, 64)
    (same,) = testing.drifts(MINE, testing.starts_of("generic", MINE), h, None, 64)
    assert (run.ulps["H"] == same.ulps["H"]).all(), "h is in the top's own unit"
    H = integrate(top, y0, h, 64, "strang", every=1).invariants()[:, 0]
    expected = (H - H[0]) / np.spacing(top.invariant_scales(y0)[0])
    assert run.ulps["H"] == pytest.approx(expected[run.counts], abs=4)  # H itself is rounded
    at = int(np.argmax(abs(expected[run.counts])))
    assert run.largest("H") == (pytest.approx(abs(expected[run.counts[at]]), abs=4), run.counts[at])


def test_growth():
    assert_drift("backlund_unpinned", growth="H", below=0.75, steps=20_000)
    told = r"rk4: H grows like t\^\d\.\d\d .* 16 tops, h_scaled = 0.1, 20000 steps: below 0.75"
    with pytest.raises(AssertionError, match=told):
        assert_drift("rk4", growth="H", below=0.75, steps=20_000)
    with pytest.raises(AssertionError, match="in the last decade"):  # over both decades an oscillation makes it t^0.62
        assert_drift("rk4", growth="H", below=0.75, steps=3000)
    assert_drift("rk4", growth="J3", below=0.1, steps=100)  # no error at all has no exponent
    with pytest.raises(AssertionError, match=r"growth of H cannot be measured .* 2 steps: take more steps"):
        assert_drift("rk4", growth="H", below=0.1, steps=2)


def test_growth_that_comes_late_or_is_not_finite():
    counts = list(range(1, 101))
    runs = [testing.Run("generic", "h = 0.1", counts, {"H": np.zeros(100)}) for _ in range(16)]
    for run in runs:
        run.ulps["H"][-3:] = 1e6
    (line,) = testing.growth_beyond(MINE, runs, "H", 0.75)
    assert "H is off by 1e+06 ulps at last on 16 tops" in line
    runs[3].ulps["H"][50] = np.nan
    (line,) = testing.growth_beyond(MINE, runs, "H", 0.75)
    assert "H is not finite on 16 tops" in line


def test_a_run_that_ends_early_or_is_not_finite():
    told = r"^rk4 on generic, h_scaled = 30, step \d+ of 100: the state left the range of floating-point numbers$"
    with pytest.raises(AssertionError, match=told):
        assert_drift("rk4", tops=["generic"], h_scaled=30, steps=100, J3=0)
    run = testing.Run("generic", "h = 0.1", [1, 2, 3], {"H": np.array([1.0, np.nan, 2.0])})
    assert (run.largest("H")[1], run.largest("H")[0] <= 1e300) == (2, False)


NO_TEST = [
    ({}, "give a bound"),
    ({"C3": 16}, "unknown invariant 'C3'"),
    ({"H": float("nan")}, "^H must be "),
    ({"H": 16, "tops": []}, "^tops"),
    ({"H": 16, "h": []}, "give at least one step"),
    ({"growth": "H"}, "go together"),
    ({"growth": "H", "below": float("nan")}, "^below must be "),
    ({"J3": 0, "tops": ["magnet"], "steps": 1}, "magnet does not conserve it"),
]


@pytest.mark.parametrize(("asked", "message"), NO_TEST)
def test_what_would_test_nothing(asked, message):
    with pytest.raises(ValueError, match=message):
        assert_drift(MINE, **asked)


def test_order():
    assert_order(MINE)
    with pytest.raises(AssertionError, match=r"mine, order 4: 2(\.\d+)?, bound 4 ± 0\.15; .*random000"):
        assert_order(MINE, 4)
    for method, claimed, tops in (("rk4", 7, "hanging"), ("strang", 9, "weightless")):  # nothing moves, or all is exact
        with pytest.raises(AssertionError, match=f"{method}, order {claimed}:.* exact up to round-off.*not judged"):
            assert_order(method, claimed, tops=[tops])
    for method, message in (("backlund", "exact in time"), ("rk45", "chooses its own steps")):
        with pytest.raises(ValueError, match=message):
            assert_order(method, tops=["generic"])
    with pytest.raises(ValueError, match=r"^tops"):
        assert_order(MINE, tops=())
