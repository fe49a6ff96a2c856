"""Timing of short functions: calibrated, repeated, interleaved, raw samples kept.

The minimum is the figure to quote (it repeats within a few per cent between processes, the mean does not); the
median and the spread say how quiet the machine was. The first call, which compiles, is timed apart.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from statistics import mean, median, stdev
from time import get_clock_info, perf_counter_ns

import numpy as np
from numpy.typing import NDArray

from lagrange_bench.integrators.compiling import interpreted

interpreted.OFTEN = 0  # reported times are those of compiled code, set-up included
TICKS = 1000  # a sample is at least this many ticks of the clock: 0.1 % resolution
UNSTABLE = 0.1  # coefficient of variation above which a timing is called unstable


@dataclass(frozen=True)
class Timing:
    """Samples of one function, each the mean over `loops` calls in a row."""

    first_call: float  # s, includes compilation
    loops: int
    samples: tuple[float, ...]  # s per call

    @property
    def min(self) -> float:
        return min(self.samples)

    @property
    def median(self) -> float:
        return median(self.samples)

    @property
    def variation(self) -> float:
        """Coefficient of variation: standard deviation / mean."""
        return stdev(self.samples) / mean(self.samples) if len(self.samples) > 1 else 0.0

    @property
    def unstable(self) -> bool:
        return self.variation > UNSTABLE


@dataclass(frozen=True)
class Interleaved:
    """Timings of several functions taken in turn (ABAB…), so that what the machine does meets all of them."""

    timings: dict[str, Timing]

    def ratios(self, name: str, reference: str) -> NDArray[np.float64]:
        """Seconds of `name` / seconds of `reference`, round by round."""
        above, below = self.timings[name].samples, self.timings[reference].samples
        return np.array(above, dtype=np.float64) / np.array(below, dtype=np.float64)


def time_call(function: Callable[[], object], min_time: float = 0.02, repeats: int = 7) -> Timing:
    """Times `function()`.

    Parameters
    ----------
    min_time : s, the least length of a sample; calls are looped until it is reached. repeats : number of samples.

    Raises
    ------
    ValueError : `min_time` is too short for the clock.
    """
    return interleave({"": function}, min_time, repeats).timings[""]


def interleave(functions: Mapping[str, Callable[[], object]], min_time: float = 0.02, repeats: int = 7) -> Interleaved:
    """Times several functions in one process, one sample of each per round; see `time_call`. Seconds per call.

    Every other round takes them in reverse order, so that none of them always comes first. ValueError : `repeats` is below 1,
    or `min_time` is too short for the clock.
    """
    if repeats < 1:
        raise ValueError(f"repeats must be at least 1; got {repeats}")
    if min_time < TICKS * clock_tick():
        raise ValueError(f"min_time = {min_time:g} s is less than {TICKS} ticks of the clock ({clock_tick():g} s each)")
    first = {name: _sample(function, 1) for name, function in functions.items()}
    loops = {name: _calibrate(function, min_time) for name, function in functions.items()}
    samples: dict[str, list[float]] = {name: [] for name in functions}
    for round_ in range(repeats):
        names = list(functions) if round_ % 2 == 0 else list(reversed(list(functions)))
        for name in names:
            samples[name].append(_sample(functions[name], loops[name]) / loops[name])
    return Interleaved({name: Timing(first[name], loops[name], tuple(samples[name])) for name in functions})


@cache
def clock_tick() -> float:
    """The shortest step of the clock that is seen, in s: its resolution or the cost of reading it."""
    readings = [perf_counter_ns() for _ in range(1000)]
    steps = [b - a for a, b in pairwise(readings) if b > a]
    return max(get_clock_info("perf_counter").resolution, median(steps) * 1e-9 if steps else 0.0)


def _calibrate(function: Callable[[], object], min_time: float) -> int:
    """Number of calls in a row that takes at least `min_time`, with a fifth to spare.

    It has to do so twice, unless it takes far longer: a sample the machine interrupted is long for no reason of the function's.
    """
    loops = 1
    while (seconds := _sample(function, loops)) < min_time or (
        seconds < 10 * min_time and (seconds := _sample(function, loops)) < min_time
    ):
        # at most tenfold: the first, shortest samples are the least reliable
        loops = max(loops + 1, int(loops * min(10.0, 1.2 * min_time / max(seconds, 1e-9))))
    return loops


def _sample(function: Callable[[], object], loops: int) -> float:
    """Seconds of `loops` calls in a row; a garbage collection is no part of the function."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        start = perf_counter_ns()
        for _ in range(loops):
            function()
        return (perf_counter_ns() - start) * 1e-9
    finally:
        if collecting:
            gc.enable()
