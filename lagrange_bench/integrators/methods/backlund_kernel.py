"""Kernels for `backlund_splitting`: the exact flow of a top, kicks by V, and the box of the tables.

A kick leaves the torus, so every flow has another λ and m. They come from a table over a box of (H, J3), see `step_table`. A
trial run with long steps shows how wide the box must be.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.expression import tuple_loader
from lagrange_bench.integrators.compiling.intrinsics import load_tuple, store_tuple
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.methods.splitting import torques
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.torus.plain_step import invariants, move, parameter
from lagrange_bench.integrators.torus.step_table import look_up, table_size

# Places of the constants: of the top, the box and V. The constants of each group follow, with its table.
ALPHA, C1, C2, GROUPS, STEP, CENTRE_H, SCALE_H, CENTRE_J, SCALE_J, NUMBERS = range(10)
# A group is one flow and one kick: the time of the flow; the factors of V, W and Z in the kick; the time of the kick from the
# start of the step; 1/(2|m|²) in the middle of the box.
TIME, KICK_V, KICK_W, KICK_Z, WHEN, INVERSE, GROUP = range(7)

LOST = 1
MOST_PARTS = 2**16  # of a flow; kicks are too far from each other long before
FAILURES = {LOST: "no exact step over this time was found; take a smaller |h|"}


@jit
def exact_flow(s, alpha, h):
    """The exact step over h, λ(h) computed in place, and whether λ was found. Too long an h is divided into equal parts."""
    torus, parts = invariants(s, alpha), 1
    R, eta, mr, mi, ok = parameter(torus, s[2], alpha, h)
    while not ok and parts < MOST_PARTS:
        parts *= 2
        R, eta, mr, mi, ok = parameter(torus, s[2], alpha, h / parts)
    for _ in range(parts if ok else 0):
        s = move(s, alpha, (R, eta, mr, mi))
    return s, ok


@unrolled
def tabled_flow(s, torus, alpha, R, eta, mr, mi, inverse):
    """The exact step with λ and m of a table, after one step of Newton's method for m on the curve m² = Q(λ).

    It is `plain_step.move`, arranged for a short chain of operations. The m of the table has all its digits but the last. So
    the division by n need not wait for the correction d + ie of m: 1/(n + f) is 1/n − f/n². For the same reason `inverse`,
    1/(2|m|²), may belong to another torus of the box.
    """
    J1, J2, J3, x1, x2, x3 = s
    double = 2.0 * alpha
    l2, i2 = R * R - eta * eta, 2.0 * (R * eta)  # λ²
    ee, mm = eta * eta, mr * mr + mi * mi
    q3 = eta * (J3 + double * R)
    p1, p2, p3 = x1 + R * J1, x2 + R * J2, x3 + (R * J3 + alpha * l2)
    n = (p1 * p1 + p2 * p2) + (((mm + q3 * q3) + p3 * p3) + ee * (J1 * J1 + J2 * J2))
    over = 1.0 / n
    c3, c4 = double * J3, alpha * alpha
    re = ((torus[0] - (mr * mr - mi * mi)) + torus[1] * R) + (l2 * (torus[2] + c3 * R) - i2 * (c3 * eta))
    im = (torus[1] * eta - 2.0 * (mr * mi)) + (i2 * (torus[2] + c3 * R) + l2 * (c3 * eta))
    re, im = re + c4 * (l2 * l2 - i2 * i2), im + c4 * (2.0 * (l2 * i2))
    d, e = inverse * (re * mr + im * mi), inverse * (im * mr - re * mi)
    f = 2.0 * (mr * d + mi * e)
    mr, mi = mr + d, mi + e
    r = 2.0 * eta * over
    r -= r * (f * over)
    me = mi * eta
    z = eta * x3 - eta * (alpha * (R * R + ee))
    u1 = (mr * p1 + me * J1) - (q3 * x2 - z * J2)
    u2 = (mr * p2 + me * J2) + (q3 * x1 - z * J1)
    u3 = (mr * p3 + mi * q3) - eta * (x1 * J2 - x2 * J1)
    v1, v2 = double * u1, double * u2
    K1, K2 = J1 + J1, J2 + J2
    w = 2.0 * J3
    y1 = K2 * u3 - (R * v2 + w * u2)
    y2 = (R * v1 + w * u1) - K1 * u3
    y3 = K1 * u2 - K2 * u1
    return (
        J1 - r * v2,
        J2 + r * v1,
        J3,
        x1 + r * (y1 + r * (v1 * u3)),
        x2 + r * (y2 + r * (v2 * u3)),
        x3 + r * (y3 - r * (v1 * u1 + v2 * u2)),
    )


@cache
def kick_of(V: System, gradients: int) -> Any:
    """(s, t, p, first, weights) → the state after a kick by V and the first `gradients` of W and Z. p[first] … : parameters."""
    total, conserves_J3, parameters = torques(V, gradients), 2 in V.constant, tuple_loader(V.parameters)

    @jit(inline=True)
    def kicked(s, time, p, first, weights):
        q = (time,) + parameters(p, first)  # noqa: RUF005 - compiled code does not unpack
        t = total(s[3:], q, weights)
        return s[0] + t[0], s[1] + t[1], s[2] if conserves_J3 else s[2] + t[2], s[3], s[4], s[5]

    return kicked


@cache
def kernel(V: System, gradients: int, degree: int, single: bool) -> Any:
    """The step. degree : of the tables, 0 for none. single : one flow and one kick, at places that the compiler knows."""
    conserves_J3, timed = 2 in V.constant, V.timed
    kicked, look = kick_of(V, gradients), look_up(degree or 1, conserves_J3)
    first, stride = NUMBERS + 1 + V.parameters, GROUP + table_size(degree, conserves_J3)

    @jit(inline=True)
    def step(s, c, counters):
        alpha = c[ALPHA]
        for g in range(1 if single else int(c[GROUPS])):
            place = first + g * stride
            torus = invariants(s, alpha)
            u, v = (torus[2] - c[CENTRE_H]) * c[SCALE_H], (s[2] - c[CENTRE_J]) * c[SCALE_J]
            if degree > 0 and abs(u) <= 1.0 and abs(v) <= 1.0:
                R, eta, mr, mi = look(c, place + GROUP, u, v)
                s = tabled_flow(s, torus, alpha, R, eta, mr, mi, c[place + INVERSE])
            else:
                counters[loops.ITERATIONS] += 1.0 if degree > 0 else 0.0
                s, ok = exact_flow(s, alpha, c[place + TIME])
                if not ok:
                    counters[loops.FAILURE] = LOST
            t = c[NUMBERS] + (c[STEP] * counters[loops.CLOCK] + c[place + WHEN]) if timed else 0.0
            s = kicked(s, t, c, NUMBERS + 1, (c[place + KICK_V], c[place + KICK_W], c[place + KICK_Z]))
        return s

    return step


@cache
def restorer(conserves_J3: bool) -> Any:
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


@cache
def map_over(V: System) -> Any:
    """Apply the flows and kicks of `parts`, one after the other, to each row, in place.

    numbers : alpha, t at the start and the parameters. times : t, dt, n; the first row is at the time t + n dt, the next at
    t + (n + 1) dt, and so on.
    """
    kicked = kick_of(V, 0)
    get = tuple_loader(6)

    @jit
    def run(rows, numbers, parts, times, counters):
        alpha, count = numbers[0], times[2]
        for row in rows:
            s = get(row, 0)
            t = times[0] + count * times[1]
            count += 1.0
            for k in range(len(parts)):
                t += parts[k, 0]
                if parts[k, 0] != 0.0:
                    s, ok = exact_flow(s, alpha, parts[k, 0])
                    if not ok:
                        counters[loops.FAILURE] = LOST
                if parts[k, 1] != 0.0:
                    s = kicked(s, t, numbers, 2, (parts[k, 1],))
            store_tuple(row, 0, s)

    return run


# ------------------------------------------------------------------------------------ the box of the tables

# Number and length of the steps that show where (H, J3) go, in time scales of the top. They need not be exact.
TRIAL_STEPS, TRIAL_STEP = 96, 1.2
MARGIN = 8.0  # the box is so many times as wide as the trial run: a slow motion goes further, and a table is cheap


@cache
def trial_run(V: System) -> Any:
    """(y, c, h, steps) → least and largest 2H, then J3, along steps of one flow and one kick; H is without V."""
    kicked = kick_of(V, 0)

    @jit
    def run(y, c, h, steps):
        alpha = c[ALPHA]
        s = load_tuple(y, 0, 6)
        low_h = high_h = invariants(s, alpha)[2]
        low_j = high_j = s[2]
        for k in range(steps):
            s, ok = exact_flow(s, alpha, h)
            if not ok:
                break
            s = kicked(s, c[NUMBERS] + (k + 1) * h, c, NUMBERS + 1, (h,))
            h2 = invariants(s, alpha)[2]
            low_h, high_h = min(low_h, h2), max(high_h, h2)
            low_j, high_j = min(low_j, s[2]), max(high_j, s[2])
        return low_h, high_h, low_j, high_j

    return run


def set_box(
    c: Array, scales: tuple[float, float, float], y0: Array, run: Callable[..., tuple[float, ...]], h: float
) -> bool:
    """Put the box of the tables into c, from a trial run with long steps; False if there is no such box.

    scales : rate, length and time scale of the top without V.
    """
    rate, _, unit = scales
    if not math.isfinite(unit):  # without V nothing moves
        return False
    low_h, high_h, low_j, high_j = run(y0, c, math.copysign(TRIAL_STEP * unit, h), TRIAL_STEPS)
    for place, low, high, size in ((CENTRE_H, low_h, high_h, rate * rate), (CENTRE_J, low_j, high_j, rate)):
        width = 0.5 * MARGIN * (high - low) + 2.0**-40 * size
        if not 0.0 < width < math.inf or 1.0 / width == math.inf:
            return False
        c[place], c[place + 1] = 0.5 * (low + high), 1.0 / width
    return True
