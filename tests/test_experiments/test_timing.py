"""Timing: on a clock of our own, where every number is known, and once on the real one."""

from __future__ import annotations

import gc
import time

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import timing


class Clock:
    """A clock that only moves when told to; stands in for perf_counter_ns."""

    def __init__(self, monkeypatch):
        self.now = 0
        self.log = []
        monkeypatch.setattr(timing, "perf_counter_ns", lambda: self.now)
        monkeypatch.setattr(timing, "clock_tick", lambda: 50e-9)

    def work(self, name, nanoseconds):
        """A function that takes as long as the next value of `nanoseconds` says, the last one for ever."""
        values = list(nanoseconds)

        def function():
            assert not gc.isenabled()
            self.log.append(name)
            self.now += values.pop(0) if len(values) > 1 else values[0]

        return function


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def test_known_function(clock):
    result = timing.time_call(clock.work("f", [5_000_000, 100]), min_time=0.02, repeats=5)
    assert result.first_call == pytest.approx(5e-3)  # compilation, in no sample
    assert result.samples == pytest.approx([100e-9] * 5)
    assert result.loops * 100e-9 >= 0.02
    assert result.loops * 100e-9 < 0.05  # calibrated, not just large
    assert result.min == result.median == pytest.approx(100e-9)
    assert not result.unstable
    assert gc.isenabled()


def test_a_call_longer_than_a_sample_is_not_looped(clock):
    result = timing.time_call(clock.work("f", [50_000_000]), repeats=3)
    assert result.loops == 1
    assert clock.log == ["f"] * 6  # warm-up, calibration and its confirmation, three samples


def test_an_interrupted_calibration_is_not_believed(clock):
    """The call after the warm-up loses the processor for 50 ms: one call would seem to be enough for a sample."""
    result = timing.time_call(clock.work("f", [1000, 50_000_000, 1000]), min_time=0.02)
    assert result.loops * 1e-6 >= 0.02


def test_unstable_is_said(clock):
    quiet = timing.Timing(0.0, 1, (1.0, 1.05, 0.95, 1.0))
    noisy = timing.Timing(0.0, 1, (1.0, 1.0, 1.0, 1.4))
    assert not quiet.unstable
    assert noisy.unstable
    assert noisy.min == noisy.median == 1.0  # and yet the two figures that are quoted hold
    assert not timing.Timing(0.0, 1, (1.0,)).unstable


def test_rounds_are_interleaved_and_fair(clock):
    a, b = clock.work("a", [30_000_000]), clock.work("b", [60_000_000])
    result = timing.interleave({"a": a, "b": b}, repeats=4)
    assert "".join(clock.log[6:]) == "abbaabba"
    assert result.ratios("b", "a") == pytest.approx([2.0] * 4)


def test_a_slowing_machine_does_not_favour_anyone(clock):
    """Every call takes 10 % longer than the one before: what is always first would win by 10 %."""
    length = [30_000_000]

    def function():
        clock.now += int(length[0])
        length[0] *= 1.1

    ratios = timing.interleave({"a": function, "b": function}, repeats=6).ratios("b", "a")
    assert np.exp(np.mean(np.log(ratios))) == pytest.approx(1, abs=1e-6)
    assert np.max(ratios) > 1.09  # the drift was there


def test_too_short_a_sample_is_refused(clock):
    with pytest.raises(ValueError, match="min_time"):
        timing.time_call(lambda: None, min_time=49e-6)
    with pytest.raises(ValueError, match="repeats"):
        timing.time_call(lambda: None, repeats=0)
    timing.time_call(clock.work("f", [1000]), min_time=51e-6)


def test_collection_is_switched_on_again_after_an_error():
    def broken():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        timing.time_call(broken)
    assert gc.isenabled()


def test_real_clock():
    assert 0 < timing.clock_tick() < 1e-5
    result = timing.time_call(lambda: time.sleep(0.002), min_time=0.005, repeats=3)
    assert 1 <= result.loops <= 3
    assert result.min >= 0.002  # a busy machine sleeps longer, none shorter


def test_the_same_function_twice_is_as_fast():
    """A/A. Of the minima: on a machine that others use, the median of pairs of short samples says little."""

    def function():
        sum(range(2000))

    timed = timing.interleave({"a": function, "b": function}, min_time=0.001, repeats=60).timings
    assert timed["a"].min == pytest.approx(timed["b"].min, rel=0.1)
