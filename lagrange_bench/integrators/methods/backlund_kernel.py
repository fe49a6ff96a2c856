"""Kernels for `backlund_splitting`: the exact flow of a top, kicks by V, and the box of the tables.

A kick leaves the torus, so every flow has another λ and m. They come from a table over a box of (H, J3), see `step_table`. A
trial run with long steps shows how wide the box must be.
"""

import math
from functools import cache

import numpy as np

from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import tuple_loader
from lagrange_bench.integrators.compiling.intrinsics import load_tuple
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.methods.splitting import torques
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.torus.plain_step import invariants, move, parameter
from lagrange_bench.integrators.torus.step_table import look_up, table_size

# Places of the constants: of the top, the box and V. The constants of each group follow, with its table.
ALPHA, C1, C2, GROUPS, STEP, CENTRE_H, SCALE_H, CENTRE_J, SCALE_J, NUMBERS = range(10)
# A group is one flow and one kick: the time of the flow; the factors of V, W and Z in the kick; the time of the kick from the
# start of the step.
TIME, KICK_V, KICK_W, KICK_Z, KICK_TIME, GROUP = range(6)

LOST = 1
MOST_PARTS = 2**16  # of a flow; kicks are too far from each other long before
FAILURES = {LOST: "no exact step over this time was found; take a smaller |h|"}


@jit
def exact_flow(s, alpha, h):
    """The exact step over h, λ(h) computed in place, and whether λ was found. Too long an h is divided into equal parts."""
    torus, parts = invariants(s, alpha), 1
    R, eta, mr, mi, is_found = parameter(torus, s[2], alpha, h)
    while not is_found and parts < MOST_PARTS:
        parts *= 2
        R, eta, mr, mi, is_found = parameter(torus, s[2], alpha, h / parts)
    for _ in range(parts if is_found else 0):
        s = move(s, alpha, (R, eta, mr, mi))
    return s, is_found


@unrolled
def on_curve(torus, j3, alpha, lam):
    """λ and m of a table, after one step of Newton's method for m on the curve m² = Q(λ)."""
    R, eta, mr, mi = lam
    l2, i2 = R * R - eta * eta, 2.0 * (R * eta)  # λ²
    c3, c4 = (2.0 * alpha) * j3, alpha * alpha
    re = ((torus[0] - (mr * mr - mi * mi)) + torus[1] * R) + (l2 * (torus[2] + c3 * R) - i2 * (c3 * eta))
    im = (torus[1] * eta - 2.0 * (mr * mi)) + (i2 * (torus[2] + c3 * R) + l2 * (c3 * eta))
    re, im = re + c4 * (l2 * l2 - i2 * i2), im + c4 * (2.0 * (l2 * i2))
    inverse = 0.5 / (mr * mr + mi * mi)
    return R, eta, mr + inverse * (re * mr + im * mi), mi + inverse * (im * mr - re * mi)


@cache
def kernel(V: System, gradients: int, degree: int) -> Compiled:
    """The flows and kicks of a composition. degree : of the tables, 0 for none. gradients : whether kicks have W, and Z."""
    conserves_J3, timed = 2 in V.constant, V.timed
    torque, table_at, parameters = torques(V, gradients), look_up(degree or 1, conserves_J3), tuple_loader(V.parameters)
    first, stride = NUMBERS + 1 + V.parameters, GROUP + table_size(degree, conserves_J3)

    @jit(inline=True)
    def step(s, c, counters):
        alpha = c[ALPHA]
        for g in range(int(c[GROUPS])):
            place = first + g * stride
            torus = invariants(s, alpha)
            u, v = (torus[2] - c[CENTRE_H]) * c[SCALE_H], (s[2] - c[CENTRE_J]) * c[SCALE_J]
            if degree > 0 and abs(u) <= 1.0 and abs(v) <= 1.0:
                s = move(s, alpha, on_curve(torus, s[2], alpha, table_at(c, place + GROUP, u, v)))
            else:
                counters[loops.ITERATIONS] += 1.0 if degree > 0 else 0.0
                s, is_found = exact_flow(s, alpha, c[place + TIME])
                if not is_found:
                    counters[loops.FAILURE] = LOST
            t = c[NUMBERS] + (c[STEP] * counters[loops.CLOCK] + c[place + KICK_TIME]) if timed else 0.0
            q = (t, *parameters(c, NUMBERS + 1))
            k = torque(s[3:], q, (c[place + KICK_V], c[place + KICK_W], c[place + KICK_Z]))
            s = s[0] + k[0], s[1] + k[1], s[2] if conserves_J3 else s[2] + k[2], s[3], s[4], s[5]
        return s

    return step


def constants(head: Array, h: float, groups: Array) -> Array:
    """The constants of a composition. head : those of the top, the box and V. groups : a row for each, with its table."""
    c = np.concatenate((head, groups.ravel()))
    c[GROUPS], c[STEP] = len(groups), h
    return c


@cache
def restorer(conserves_J3: bool) -> Compiled:
    """(s, c) → the state, moved back onto C1 and C2: first x along x, then J along x.

    Where J3 is conserved, J moves in the horizontal plane, and not at all where x is vertical.
    """

    @jit
    def restore_casimirs(s, c):
        J1, J2, J3, x1, x2, x3 = s
        f = 0.5 * (c[C1] - ((x1 * x1 + x2 * x2) + x3 * x3)) / c[C1]
        x1, x2, x3 = x1 + f * x1, x2 + f * x2, x3 + f * x3
        square = (x1 * x1 + x2 * x2) + 2.0**-10 * c[C1] if conserves_J3 else c[C1]
        p = (c[C2] - ((x1 * J1 + x2 * J2) + x3 * J3)) / square
        return J1 + p * x1, J2 + p * x2, J3 if conserves_J3 else J3 + p * x3, x1, x2, x3

    return restore_casimirs


RESTORE_EVERY = 16  # steps


# ------------------------------------------------------------------------------------ the box of the tables

# steps of the trial run that shows where (H, J3) go
TRIAL_STEPS = 96
# length of such a step, in time scales of the top; it need not be exact
TRIAL_STEP = 1.2
# width of the box over that of the trial run: a slow motion goes further, and a table is cheap
MARGIN = 8.0


@cache
def trial_run(step: Compiled) -> Compiled:
    """(y, c, counters, n) → least and largest 2H, then J3, along n steps; H is without V."""

    @jit
    def run(y, c, counters, n):
        s = load_tuple(y, 0, 6)
        low_h = high_h = invariants(s, c[ALPHA])[2]
        low_j = high_j = s[2]
        for _ in range(n):
            s = step(s, c, counters)
            counters[loops.CLOCK] += 1.0
            h2 = invariants(s, c[ALPHA])[2]
            low_h, high_h = min(low_h, h2), max(high_h, h2)
            low_j, high_j = min(low_j, s[2]), max(high_j, s[2])
        return low_h, high_h, low_j, high_j

    return run


def set_box(c: Array, scales: tuple[float, float, float], y0: Array, step: Compiled, h: float) -> bool:
    """Put the box of the tables into c, from a trial run with long steps; False if there is no such box.

    scales : rate, length and time scale of the top without V. step : without tables.
    """
    rate, _, unit = scales
    if not math.isfinite(unit):  # without V nothing moves
        return False
    h, counters = math.copysign(TRIAL_STEP * unit, h), np.zeros(loops.SIZE)
    trial = constants(c, h, np.array([(h, h, 0.0, 0.0, h)]))
    low_h, high_h, low_j, high_j = trial_run(step)(y0, trial, counters, TRIAL_STEPS)
    for place, low, high, size in ((CENTRE_H, low_h, high_h, rate * rate), (CENTRE_J, low_j, high_j, rate)):
        width = 0.5 * MARGIN * (high - low) + 2.0**-40 * size
        if counters[loops.FAILURE] or not 0.0 < width < math.inf or 1.0 / width == math.inf:
            return False
        c[place], c[place + 1] = 0.5 * (low + high), 1.0 / width
    return True
