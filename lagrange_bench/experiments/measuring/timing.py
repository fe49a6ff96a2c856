"""Times short functions: calibrated, repeated, in turn, with all samples kept, in s per call.

Each sample is the mean over some calls in a row. Quote the minimum. It repeats within a few per cent between processes; the mean
does not. The first call compiles and belongs to no sample.
"""

import timeit
from collections.abc import Callable, Mapping
from time import perf_counter

import numpy as np

from lagrange_bench.integrators.interface import Array


def time_call(function: Callable[[], object], min_time: float = 0.02, repeats: int = 7) -> Array:
    """The samples (repeats,) of `function()`; see `interleave`."""
    return interleave({"": function}, min_time, repeats)[""]


def interleave(
    functions: Mapping[str, Callable[[], object]], min_time: float = 0.02, repeats: int = 7
) -> dict[str, Array]:
    """Time several functions in one process in turn (AB BA AB …), so that all of them meet the same disturbances.

    No function always comes first, and no garbage is collected meanwhile.

    Parameters
    ----------
    functions : name → function without arguments. min_time : s, the least length of a sample: calls are repeated until it is
    reached. repeats : number of samples.

    Returns
    -------
    Name → samples (repeats,), in s per call. Samples of two functions in the same round may be divided.
    """
    timers = {name: timeit.Timer(function, timer=perf_counter) for name, function in functions.items()}
    for timer in timers.values():
        timer.timeit(1)  # compiles
    loops = {name: _calibrate(timer, min_time) for name, timer in timers.items()}
    samples = {name: np.empty(repeats) for name in functions}
    for round_ in range(repeats):
        for name in timers if round_ % 2 == 0 else reversed(timers):
            samples[name][round_] = timers[name].timeit(loops[name]) / loops[name]
    return samples


def _calibrate(timer: timeit.Timer, min_time: float) -> int:
    """How many calls in a row take at least `min_time`, with a fifth to spare.

    They must take so long twice, unless they take ten times as long: one sample may be long because of an interruption.
    """
    loops = 1
    while (seconds := timer.timeit(loops)) < min_time or (
        seconds < 10 * min_time and (seconds := timer.timeit(loops)) < min_time
    ):
        # at most ten times as many: the first, shortest samples are the least reliable
        loops = max(loops + 1, int(loops * min(10.0, 1.2 * min_time / max(seconds, 1e-9))))
    return loops
