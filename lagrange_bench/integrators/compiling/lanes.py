"""The time loop of many tops at once, one in each SIMD lane.

It takes the kernels of `loops`, but they must not fail, and they carry nothing from step to step.
"""

import threading
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.intrinsics import column, put_column, stack
from lagrange_bench.integrators.compiling.loops import INTERRUPTIBLE, MEMORY
from lagrange_bench.integrators.interface import Array

compiling = threading.Lock()
LANES = 32  # so many tops take a step together: some SIMD registers full, so that none waits for its own result


@cache
def compile_lanes(step: Callable, restore: Callable | None, size: int, lanes: int) -> Callable:
    """The loop around one kernel for `lanes` tops at a time, each with `size` constants.

    If the kernel has no loops, the loop over the lanes is SIMD code. The bits of a top do not depend on its lane or on its
    neighbours, and are those of `compile_loop`.
    """
    step = jit(step, inline=True)

    @jit
    def run(columns, first, last, every, block, tops, out):
        # `columns` holds blocks of columns of `lanes` numbers: states and constants. `tops` gives the place in `out` of each
        # lane, or −1 for an unused lane. The first row of `out` is the state after `every` steps.
        counters = stack(MEMORY)
        for b in range(len(tops) // lanes):
            origin = b * (6 + size) * lanes
            constants = origin + 6 * lanes
            i = first
            row = i // every
            next_row = (row + 1) * every
            next_restore = (i + block - 1) // block * block
            while i < last:
                if i == next_restore:
                    next_restore += block
                    if restore is not None:
                        for j in range(lanes):
                            s = column(columns, origin + j, 6, lanes)
                            c = column(columns, constants + j, size, lanes)
                            put_column(columns, origin + j, restore(s, c), lanes)
                stop = min(last, next_row, next_restore)
                for _ in range(i, stop):
                    for j in range(lanes):
                        s = column(columns, origin + j, 6, lanes)
                        c = column(columns, constants + j, size, lanes)
                        put_column(columns, origin + j, step(s, c, counters), lanes)
                i = stop
                if i == next_row:
                    for j in range(lanes):
                        top = tops[b * lanes + j]
                        if top >= 0:
                            for k in range(6):
                                out[row, top, k] = columns[origin + k * lanes + j]
                    row += 1
                    next_row += every

    return run


def run_lanes(
    kernel: tuple[Callable, Callable | None, int],
    states: Array,
    constants: Array,
    tops: NDArray[np.int64],
    steps: int,
    every: int,
    out: Array,
    stopped: Callable[[], bool],
    lanes: int = LANES,
) -> None:
    """Take the `tops` among `states` (m, 6) through `steps` steps of a kernel (step, restore, steps between two restores).

    `constants` (m, k) has a row for each top. Rows of `out` (steps // every, m, 6) are the states after every, 2 every, … steps.
    It ends early, with rows unfinished, once `stopped()`.
    """
    step, restore, block = kernel
    places = np.resize(tops, -(-len(tops) // lanes) * lanes)  # the lanes left over repeat some tops
    rows = np.hstack((states[places], constants[places]))
    columns = rows.reshape(-1, lanes, rows.shape[1]).transpose(0, 2, 1).ravel()
    places[len(tops) :] = -1
    with compiling:  # once, not in every thread
        run = compile_lanes(step, restore, constants.shape[1], lanes)
        run(columns, 0, 0, 1, 1, places, out)
    stride = max(1, INTERRUPTIBLE * 4 // len(places))
    for first in range(0, steps, stride):
        if stopped():
            break
        run(columns, first, min(first + stride, steps), every, block, places, out)
