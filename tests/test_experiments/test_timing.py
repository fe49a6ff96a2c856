"""Timing on a clock of our own, where every number is known; and the unit of each time that is stored."""

import gc
import itertools

import numpy as np
import pytest

from lagrange_bench.experiments import cost, work_precision
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.measuring import timing
from lagrange_bench.integrators import prepare


@pytest.fixture
def work(monkeypatch):
    """work(seconds) -> a function that takes as long as the next of them on a clock that nothing else moves, then as the last."""
    now = [0.0]
    monkeypatch.setattr(timing, "perf_counter", lambda: now[0])

    def taking(*seconds):
        lengths = itertools.chain(seconds, itertools.repeat(seconds[-1]))

        def function():
            assert not gc.isenabled()
            now[0] += next(lengths)
            function.calls += 1

        function.calls = 0
        return function

    return taking


def test_samples_are_calibrated_and_the_first_call_is_in_none(work):
    assert timing.time_call(work(5e-3, 1e-7), min_time=0.02, repeats=5) == pytest.approx([1e-7] * 5)

    def calls_in_a_sample(*seconds):
        short, longer = work(*seconds), work(*seconds)
        timing.time_call(short, min_time=0.02, repeats=1)
        timing.time_call(longer, min_time=0.02, repeats=2)
        return longer.calls - short.calls

    assert 0.02 <= calls_in_a_sample(5e-3, 1e-7) * 1e-7 < 0.05  # calibrated, not just large
    assert calls_in_a_sample(0.05) == 1
    assert calls_in_a_sample(1e-6, 0.05, 1e-6) * 1e-6 >= 0.02, "interrupted once"


def test_a_slowing_machine_does_not_favour_anyone(work):
    """Every call takes 10 % longer than the one before: what is always first would win by 10 %."""
    function = work(*(0.03 * 1.1**k for k in range(100)))
    timed = timing.interleave({"a": function, "b": function}, repeats=6)
    ratios = timed["b"] / timed["a"]
    assert np.exp(np.mean(np.log(ratios))) == pytest.approx(1, abs=1e-6)
    assert np.max(ratios) > 1.09  # the drift was there


def test_garbage_is_collected_again_after_an_error():
    with pytest.raises(ZeroDivisionError):
        timing.time_call(lambda: 1 / 0)
    assert gc.isenabled()


CALL = 0.75  # s that the quickest of timed calls takes below, and 3 ms each set-up
STEP = CALL / cost.CALL["step"] * 1e9
RACE = {"method": "strang", "state": "generic", "span": 16.0, "h": 1 / 8}
RACE |= {"per_octave": 1, "decades": 1, "longest": 100.0}
UNITS = {  # experiment and part, other fields of a cell → what its row has
    "cost step": (
        {"method": "strang", "h": 0.5, "repeats": 2},
        {"ns_per_step": STEP, "setup_us": 3e3},
    ),
    "cost headline": ({"method": "taylor", "fraction": 0.5, "time": 100.0}, {"backlund_s": CALL, "heyoka_s": CALL}),
    "work_precision ": (RACE, {"seconds": CALL, "setup_seconds": 3e-3}),
    "heavy_top ": (
        {"case": "bruels", "method": "strang", "h": 2.0 / 2**9},
        {"ns_per_step": CALL / 512 * 1e9},
    ),
    "ensemble rival": (
        {"method": "backlund", "tops": 4, "span": 50.0, "h": 1.0},
        {"us_per_top": CALL / 4 * 1e6, "ns_per_time": CALL / 4 / 50 * 1e9},
    ),
}


@pytest.mark.parametrize("place", UNITS)
def test_the_least_times_are_stored_in_their_units(place, monkeypatch):
    (name, _, part), (cell, expected) = place.partition(" "), UNITS[place]
    if part == "headline":
        pytest.importorskip("heyoka")

    def interleave(functions, *_, **__):
        for function in functions.values():
            function()
        return {name: np.array([2 * CALL, CALL, 3 * CALL]) for name in functions}

    def prepared(*args, **options):
        stepper = prepare(*args, **options)
        stepper.work.setup_seconds = 3e-3
        return stepper

    monkeypatch.setattr(timing, "interleave", interleave)
    for module in (cost, work_precision):
        monkeypatch.setattr(module, "prepare", prepared)
    monkeypatch.setattr(work_precision, "_seconds", lambda *_: CALL)
    module = load(name)
    row = module._run(cell) if module is work_precision else module.measure({"part": part, **cell})[0]
    assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-3)


def test_curves_of_exact_methods_go_on_to_a_state_every_unit():
    curves = {cell["method"]: cell.get("state_every") for cell in work_precision.cells("full")}
    assert (curves["backlund"], curves["theta_functions"], curves["strang"]) == (1.0, 1.0, None)
