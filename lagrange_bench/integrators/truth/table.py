"""A motion at many times, in doubles: Taylor series from the nearest of some proven states.

A period is cut into cells, at most 1/(4 r) long, with r of the majorant (`truth.curve`). In the middle of each cell the variables
are computed in balls, and rounded to pairs of doubles. Taylor series in doubles lead from there; what they leave off is below
1e-17 of the scales. Whole cells are subtracted from a time without rounding, and the turns of whole periods are counted mod 1, to
105 bits. On the separatrix, cells go on until the limit is reached to 1e-18, and from there the motion is steady.

The sums in doubles are tested against balls, to 5e-16 of the scales of a top (seen: 4.2e-16, on a processor without fused
operations); they are not proven.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple, cast

import numpy as np
from flint import arb, fmpq

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.truth.curve import (
    BITS,
    Terms,
    above,
    certified,
    midpoint,
    power_above,
    rational,
    series,
)
from lagrange_bench.integrators.truth.top import Top
from lagrange_bench.support.precision import workprec

TERMS = 19  # 8^-19 = 7e-18: the half of a cell is 1/8 of the radius of convergence
PER_RATE = 4  # cells in a time 1/r
EXACT = fmpq(1, 10**18)  # radii of states, relative to their scales
LATE = 100.0  # units 1/√w after which the separatrix has reached its limit: e^(−50) = 2e-22
LATEST = 2.0**52  # cells; later, a double does not resolve them
TOO_LATE = "t is so late that doubles hardly resolve the phase of the motion: pass digits="
MOST_CELLS = 30_000  # some seconds
SLOWEST = 2.0**-900  # rate of a turn that is none
BLOCK = 2048  # times that are computed at once, so that they stay in the processor's cache
Pieces = tuple[float, float, float]  # a number as a sum of three doubles; the first two have at most 27 bits


# ---------------------------------------------------------------- times and turns without rounding


class Clock(NamedTuple):
    """Constants that split a time into n lengths and a rest, with hardly any rounding."""

    length: Pieces
    t0: Pieces


def split(value: fmpq, unit: fmpq) -> Pieces:
    """`value` as a sum of multiples of 2^-26 and of 2^-52 of the binade of `unit`, and a rest; to 105 bits of `unit`."""
    binade, half = fmpq(2) ** exponent(unit), fmpq(1, 2)
    first = (value / binade * 2**26 + half).floor() * binade / 2**26
    second = ((value - first) / binade * 2**52 + half).floor() * binade / 2**52
    return float(first), float(second), float(value - first - second)


def clock(length: fmpq, t0: fmpq) -> Clock:
    return Clock(split(length, length), split(t0, length))


def reduced(c: Clock, t: Array) -> tuple[Array, Array]:
    """n and r with t - t0 = n length + r, |r| <= length/2 to within the rounding of n.

    n and the length are split into parts of 26 bits (Dekker, 1971). So their products are exact, and the differences, too, while
    they cancel. The rest is rounded once or twice.
    """
    first, second, third = c.length
    n = np.rint((t - c.t0[0]) / sum(c.length))
    if not np.all(np.abs(n) <= LATEST):
        raise ValueError(TOO_LATE)
    high, low = halves(n)
    r = t - high * first - (low * first + c.t0[0])
    r = r - high * second - (low * second + c.t0[1])
    return n, r - (n * third + c.t0[2])


def turned(turns: Pieces, n: Array) -> Array:
    """n times these turns, in [-1/2, 1/2]. All products but the last are exact."""
    first, second, third = turns
    high, low = halves(n)  # high * first is whole
    parts = part_of_turn(low * first) + part_of_turn(high * second) + low * second
    return part_of_turn(part_of_turn(parts) + n * third)


def halves(n: Array) -> tuple[Array, Array]:
    high = np.rint(n * 2.0**-26) * 2.0**26
    return high, n - high


def part_of_turn(a: Array) -> Array:
    return np.asarray(a - np.rint(a))


def rounded_off(h: float, n: Array) -> Array:
    """The exact n·h minus its double. n and h are split into parts of at most 27 bits, so products are exact (Dekker, 1971)."""
    mantissa, exponent = math.frexp(h)
    first, (high, low) = round(mantissa * 2**26) / 2**26, halves(n)
    second = mantissa - first
    product = n * mantissa
    return np.ldexp(((high * first - product) + low * first + high * second) + low * second, exponent)


# ---------------------------------------------------------------- the table


class Turning(NamedTuple):
    """A turn at a constant rate; see `top.Drift`."""

    clock: Clock  # of whole turns
    length: float  # of a turn, negative if it is clockwise
    is_left: bool
    side: int  # -1: it turns before the first cell only; 1: after the last cell; 0: always

    def turns(self, t: Array, remainders: Array, side: Array) -> Array:
        """Turns at the times t + remainders, mod 1. side : -1 before the first cell, 1 after the last one, else 0."""
        if not self.side:
            return (reduced(self.clock, t)[1] + remainders) / self.length
        turns_here = side == self.side
        return (
            np.where(turns_here, reduced(self.clock, np.where(turns_here, t, self.clock.t0[0]))[1] + remainders, 0.0)
            / self.length
        )


class Table:
    """The table of a motion. Its times are in units of 1/rate and its variables in powers of two, so no double overflows."""

    def __init__(self, motion: Top) -> None:
        self.motion, rate = motion, motion.rate
        self.log_rate, self.periodic = exponent(rate), not (motion.steady or motion.node)
        with workprec(BITS):
            self.logs = [exponent(power_above(size)) for size in motion.sizes()]
            self.first, self.gap, states = in_cells(motion)
            self.count, self.last = len(states), self.first + self.gap * (len(states) - 1)
            turns = turns_in(motion, self.gap * self.count) if self.periodic else (fmpq(0), fmpq(0))
            self.clock = clock(self.gap * rate, self.first * rate)
            self.turns = [split(part, fmpq(1)) for part in turns]
            self.turnings = list(turnings(motion, self.first, self.last))
        self.ends = float(self.first * rate), float(self.last * rate)
        heads, self.tails = heads_and_tails(states, self.logs)
        terms = 1 if motion.steady else TERMS
        coefficients = np.array(series(scaled_rates(motion, self.logs), list(heads.T), 1.0, terms))
        columns = list(motion.columns)
        self.coefficients = np.ascontiguousarray(coefficients.transpose(1, 2, 0)[:, :, columns])
        self.tails = self.tails[:, columns]
        self.logs = [self.logs[n] for n in columns]

    def __call__(self, times: Array, remainders: Array) -> Array:
        """States at `times` + `remainders` (N,), with `remainders` below an ulp."""
        blocks = [slice(start, start + BLOCK) for start in range(0, max(1, len(times)), BLOCK)]
        with np.errstate(over="ignore", under="ignore", invalid="ignore"):
            return np.concatenate([self.block(times[block], remainders[block]) for block in blocks])

    def block(self, times: Array, remainders: Array) -> Array:
        t, remainders = np.ldexp(times, self.log_rate), np.ldexp(remainders, self.log_rate)
        side, whole = np.zeros_like(t), np.zeros_like(t)
        if not self.periodic:
            side = np.where(t < self.ends[0], -1.0, np.where(t > self.ends[1], 1.0, 0.0))
        n, r = reduced(self.clock, np.where(side == 0, t, self.ends[0]))
        if self.periodic:
            whole = np.floor(n / self.count)
            n -= whole * self.count
        n, r = np.where(side > 0, self.count - 1, n).astype(int), np.where(side == 0, r + remainders, 0.0)
        u, r = np.zeros((len(n), len(self.logs))), r[:, None]
        gathered = np.empty_like(u)
        for row in self.coefficients[:0:-1]:
            u += row.take(n, axis=0, out=gathered, mode="clip")
            u *= r
        u += self.tails[n]
        u += self.coefficients[0][n]
        left, right = (turned(turns, whole) for turns in self.turns)
        for turning in self.turnings:
            turns = turning.turns(t, remainders, side)
            left, right = (left + turns, right) if turning.is_left else (left, right + turns)
        return self.motion.in_doubles(np.ldexp(u, self.logs), left, right)


def heads_and_tails(states: list[list[arb]], logs: list[int]) -> tuple[Array, Array]:
    """Each variable over 2^log as a double, and what the double lacks."""
    with workprec(BITS):
        scaled = [[v.mid() * fmpq(2) ** -log for v, log in zip(u, logs, strict=True)] for u in states]
        heads = [[float(v) for v in u] for u in scaled]
        tails = [[float(v - w) for v, w in zip(u, row, strict=True)] for u, row in zip(scaled, heads, strict=True)]
    return np.array(heads), np.array(tails)


def exponent(power: fmpq) -> int:
    """log2 of a power of two, of other numbers to a bit."""
    return int(power.p).bit_length() - int(power.q).bit_length()


def has_table(motion: Top) -> bool:
    """Whether a table is worth its time: not at a triple root, and not so close to one that a period has too many cells."""
    if motion.steady or motion.node is not None:
        return True
    with workprec(BITS):
        return not motion.triple and float(cells_in(motion, exact_period(motion))) < MOST_CELLS


def cells_in(motion: Top, time: fmpq) -> fmpq:
    return PER_RATE * above(motion.fastest()) * time


def exact_period(motion: Top) -> fmpq:
    """The period to BITS bits."""
    size = above(certified(lambda: [cast(arb, motion.period())], [1 / motion.rate], BITS)[0])
    return midpoint(certified(lambda: [cast(arb, motion.period())], [size / 2**150], BITS)[0])


def in_cells(motion: Top) -> tuple[fmpq, fmpq, list[list[arb]]]:
    """The time of the first cell, the gap to the next one, and the variables in all."""
    if motion.steady:
        return fmpq(0), fmpq(1), [motion.turned(fmpq(0))]
    length = exact_period(motion) if motion.node is None else rational(LATE / motion.node.speed)
    count = int(cells_in(motion, length).ceil())
    gap, places = length / count, [length / count] if motion.node is None else [length / count, -length / count]
    base, radii = fmpq(0), [EXACT * above(size) for size in motion.sizes()]

    def compute() -> list[arb]:
        nonlocal base
        base = motion.base_time()
        return [v for h in places for u in motion.grid(h, count) for v in u]

    size, states = len(radii), certified(compute, radii * ((count + 1) * len(places)), BITS)
    rows = [states[n : n + size] for n in range(0, len(states), size)]
    if motion.node is None:
        return base, gap, rows[:count]
    return base - gap * count, gap, [*rows[: count + 1 : -1], *rows[: count + 1]]  # the base point once


def turns_in(motion: Top, period: fmpq) -> tuple[fmpq, fmpq]:
    """The turns about e and about the own axis, mod 1, that a period adds, to BITS bits."""

    def compute() -> list[arb]:
        angles = motion.advance(motion.variables_at(fmpq(0)), motion.variables_at(period))
        return [angle / (2 * arb.pi()) for angle in angles]

    left, right = certified(compute, [fmpq(1, 2**130)] * 2, BITS)
    return midpoint(left), midpoint(right)


def turnings(motion: Top, first: fmpq, last: fmpq) -> Iterator[Turning]:
    """The drifts of a motion; one that starts beyond the cells begins at `first` and `last`."""
    for drift in motion.drifts():
        for rate, is_left in ((drift.left / motion.rate, True), (drift.right / motion.rate, False)):
            if abs(rate) > SLOWEST:
                turn = midpoint(2 * arb.pi() / abs(rate))
                length = math.copysign(float(turn), float(rate))
                for side, since in ((-1, first), (1, last)) if drift.is_beyond else ((0, fmpq(0)),):
                    yield Turning(clock(turn, since * motion.rate), length, is_left, side)


def scaled_rates(motion: Top, logs: Sequence[int]) -> list[Terms]:
    """The rates of the variables of a table."""
    two = fmpq(2)
    return [
        tuple((float(c * two ** (sum(logs[n] for n in places) - log) / motion.rate), *places) for c, *places in row)
        for row, log in zip(motion.rates, logs, strict=True)
    ]
