"""Timing on a clock of our own, where every number is known; and the unit of each time that is stored."""

from __future__ import annotations

import gc
import itertools

import numpy as np
import pandas as pd
import pytest

from lagrange_bench.experiments import cost, ensemble, gaudin, round_off, work_precision
from lagrange_bench.experiments.measuring import timing


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

        return function

    return taking


def test_samples_are_calibrated_and_the_first_call_is_in_none(work):
    result = timing.time_call(work(5e-3, 1e-7), min_time=0.02, repeats=5)
    assert result.samples == pytest.approx([1e-7] * 5)
    assert 0.02 <= result.loops * 1e-7 < 0.05  # calibrated, not just large
    assert result.min == pytest.approx(result.median) == pytest.approx(1e-7)
    assert timing.time_call(work(0.05), repeats=3).loops == 1
    assert timing.time_call(work(1e-6, 0.05, 1e-6), min_time=0.02).loops * 1e-6 >= 0.02, "interrupted once"


def test_a_slowing_machine_does_not_favour_anyone(work):
    """Every call takes 10 % longer than the one before: what is always first would win by 10 %."""
    function = work(*(0.03 * 1.1**k for k in range(100)))
    ratios = timing.interleave({"a": function, "b": function}, repeats=6).ratios("b", "a")
    assert np.exp(np.mean(np.log(ratios))) == pytest.approx(1, abs=1e-6)
    assert np.max(ratios) > 1.09  # the drift was there


def test_unstable_timings_are_marked_and_bad_calls_refused():
    for samples, unstable in (((1.0, 1.05, 0.95, 1.0), False), ((1.0, 1.0, 1.0, 1.4), True), ((1.0,), False)):
        assert timing.Timing(1, samples).unstable is unstable
    with pytest.raises(ValueError, match="repeats"):
        timing.time_call(lambda: None, repeats=0)
    with pytest.raises(ZeroDivisionError):
        timing.time_call(lambda: 1 / 0)
    assert gc.isenabled()


# ---------------------------------------------------------------- the unit of each time that is stored

CALL = 0.75  # s that each timed call takes below


@pytest.fixture
def measure(monkeypatch):
    """measure(module, cell) -> its rows, where each call that is timed takes CALL seconds, and each set-up 3 ms."""

    def interleave(functions, *_, **__):
        for function in functions.values():
            function()
        seconds = {name: CALL * (2 if name == "long" else 1) for name in functions}
        return timing.Interleaved({name: timing.Timing(1, (s, s)) for name, s in seconds.items()})

    prepare = cost.prepare

    def prepared(*args, **options):
        stepper = prepare(*args, **options)
        stepper.work.setup_seconds = 3e-3
        return stepper

    monkeypatch.setattr(timing, "interleave", interleave)
    monkeypatch.setattr(cost, "prepare", prepared)
    monkeypatch.setattr(work_precision, "prepare", prepared)
    monkeypatch.setattr(ensemble, "perf_counter", itertools.count(0.0, CALL).__next__)
    return lambda module, cell: module.measure(cell)


def test_cost_of_a_step_is_in_ns_and_of_a_set_up_in_us(measure):
    (row,) = measure(cost, {"part": "step", "method": "strang", "h": 0.5, "repeats": 2})
    steps = cost.CALL["step"]
    assert row["ns_per_step"] == row["ns_per_step_median"] == row["samples_ns"][0] == pytest.approx(CALL / steps * 1e9)
    assert row["ns_per_time"] == pytest.approx(CALL / (steps * 0.5) * 1e9)
    assert row["setup_us"] == pytest.approx(3e3)
    assert cost.PRICES == {"ns_per_step": "ns per step", "setup_us": "set-up of a stepper, µs"}


def test_the_race_with_heyoka_is_in_seconds(measure):
    pytest.importorskip("heyoka")
    (row,) = measure(cost, {"part": "headline", "method": "taylor", "fraction": 0.5, "time": 100.0})
    assert (row["backlund_s"], row["heyoka_s"], row["ratio"]) == (CALL, CALL, 1.0)


def test_forms_are_timed_in_ns_per_step(measure, monkeypatch):
    monkeypatch.setattr(round_off, "FORMS", {"increments": round_off.FORMS["increments"]})
    (row,) = measure(round_off, {"part": "cost", "h": 0.125})
    assert row["ns_per_step"] == row["samples_ns"][0] == pytest.approx(CALL / 20_000 * 1e9)


def test_a_race_is_in_seconds(measure, monkeypatch):
    monkeypatch.setattr(work_precision, "_seconds", lambda *_: CALL)
    cell = {"method": "strang", "state": "generic", "span": 16.0, "per_octave": 1, "decades": 1, "longest": 100.0}
    row = work_precision._run({**cell, "h": 1 / 8})
    assert (row["seconds"], row["setup_seconds"], row["seconds_samples"][0]) == (CALL, 3e-3, CALL)


LANES, SET_UPS, TOPS, FEW = 1000 * 1024, 4096, 32, 17  # tops and steps in one call
A_STEP = CALL / (3125 - FEW) / TOPS
UNITS = {  # part of the ensembles, other fields of a cell → what its row has
    "bound": ({}, {"pinned_ns": CALL / 80_000 * 1e9, "free_bound_ns": CALL / 80_000 * 1e9, "free_ratio": 1.0}),
    "lanes": ({"lanes": 8}, {"free_ns_per_step": CALL / LANES * 1e9}),
    "setup": ({"h": 0.1}, {"setup_us": CALL / SET_UPS * 1e6, "first_step_us": CALL / SET_UPS * 1e6}),
    "tops": (
        {"tops": TOPS, "threads": 1, "budget": 1e5},
        {"ns_per_step": A_STEP * 1e9, "setup_us": (CALL / TOPS - FEW * A_STEP) * 1e6},
    ),
    "many": ({"tops": 64}, {"seconds": CALL, "us_per_top": CALL / 64 * 1e6}),
    "jump": ({"tops": 4, "span": 50.0}, {"us_per_top": CALL / 4 * 1e6, "ns_per_time": CALL / 4 / 50 * 1e9}),
    "perturbed": (
        {"method": "strang", "potential": "tide", "tops": 3, "span": 1.0, "h": 0.1},
        {"setup_us": CALL / 3 * 1e6, "ns_per_kick": CALL / 3 / 9 * 1e9},
    ),
}


@pytest.mark.parametrize("part", UNITS)
def test_ensembles_are_timed_per_top(measure, part):
    cell, expected = UNITS[part]
    (row,) = measure(ensemble, {"part": part, **cell})
    assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-3)


def test_labels_name_the_units_of_ensembles():
    rows = [
        {"part": "tops", "tops": 32, "threads": 1, "ns_per_step_and_core": 5.0},
        {"part": "setup", "h": 0.1, "setup_us": 3.0},
        {"part": "many", "tops": 10, "us_per_top": 2.0},
        {"part": "rival", "method": "strang", "h": 0.1, "ns_per_time": 9.0, "error": 1e-3, "span": 10.0},
    ]
    figures = ensemble.draw(pd.DataFrame(rows).assign(status="done"))
    shown = {ax.get_ylabel()[:13]: ax.lines[0].get_ydata()[0] for ax in figures["throughput"].axes}
    assert shown == {"ns per step o": 5.0, "µs per set-up": 3.0, "µs per top, 8": 2.0}
    (ax,) = figures["rivals"].axes
    assert (ax.get_xlabel()[:12], ax.lines[0].get_xdata()[0]) == ("ns for a top", 9.0)


def test_magnets_are_timed_per_step_and_spin(measure, monkeypatch):
    monkeypatch.setattr(gaudin, "prepare", cost.prepare)  # whose set-up takes 3 ms, see `measure`
    (row,) = measure(gaudin, {"part": "cost", "n": 3, "variant": "exact"})
    ns = CALL / (gaudin.CALL // (3 * row["maps"])) * 1e9
    expected = {"ns_per_step": ns, "ns_per_spin_and_map": ns / (3 * row["maps"]), "ns_per_time": ns / row["h"]}
    assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-3)
    assert row["setup_ms"] == pytest.approx(3.0)
