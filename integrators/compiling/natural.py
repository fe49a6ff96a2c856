"""The time loop of a kernel that controls its own error: natural steps, and rows where they pass the times asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from lagrange_bench.integrators.compiling.compiled import jit_over
from lagrange_bench.integrators.compiling.numba_internals import column, put_column

# places in `walk`: where a run on natural steps is, so that it can be resumed, and what it has done
TIME, STEP, ROW, TAKEN, REJECTED, INTERPOLATED, STUCK, WALK = range(8)  # WALK: the size of it
SHRINK, GROW = 1.0 / 3.0, 6.0  # a step is at least this many times, and at most this many times, the one before


@cache
def compile_natural_loop(trial: Callable, interpolant: Callable, value: Callable, size: int = 6) -> Callable:
    """The loop around a kernel of `size` numbers that controls its own error.

    `trial(s, t, h, c) -> (new, error, growth, slopes)`: the step is taken if error ≤ 1, and the next is growth·h;
    `interpolant(s, new, t, h, c, slopes)` prepares what `value(interpolant, theta)` evaluates at s + theta h, 0 < theta < 1.
    """

    @jit_over(trial, interpolant, value)
    def run(y, grid, most, c, walk, out):
        # Up to `most` natural steps towards the last time of `grid`; rows of `out` where a step passes their times. Every h is
        # the difference of two times, so that times do not add up roundings.
        s = column(y, 0, size, 1)
        t, h, row, end = walk[TIME], walk[STEP], int(walk[ROW]), grid[-1]
        fresh = True  # not the repetition of a rejected step
        while row < len(grid) and (most > 0 or not fresh):
            most -= 1
            last = abs(1.01 * h) >= abs(end - t)  # no tiny step at the end
            ahead = end if last else t + h
            h = ahead - t
            if abs(h) <= 2.0**-50 * abs(t):
                walk[STUCK] = 1.0
                break
            new, error, growth, slopes = trial(s, t, h, c)
            if error <= 1.0:
                if abs(grid[row]) < abs(ahead):
                    walk[INTERPOLATED] += 1.0
                    f = interpolant(s, new, t, h, c, slopes)
                    while abs(grid[row]) < abs(ahead):
                        put_column(out, row * size, value(f, (grid[row] - t) / h), 1)
                        row += 1
                s, t = new, ahead
                if grid[row] == t:
                    put_column(out, row * size, s, 1)
                    row += 1
                walk[TAKEN] += 1.0
                h *= min(growth, GROW) if fresh else min(growth, 1.0)
                fresh = True
            else:
                walk[REJECTED] += 1.0
                h *= growth if SHRINK < growth < 1.0 else SHRINK  # the latter if the error is not a number
                fresh = False
        walk[TIME], walk[STEP], walk[ROW] = t, h, row
        put_column(y, 0, s, 1)

    return run
