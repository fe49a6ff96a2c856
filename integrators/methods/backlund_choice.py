"""Scheme and step for a given error: what `integrate(…, t=…, tol=…)` does for a splitting with the exact step inside.

A pilot run follows the start of the orbit with each scheme, with a step h and with half of it, quarter of it, …; the
difference of two neighbours is the error of the coarser one, taken to grow like t, or like t² if it grows faster than t² in
the pilot. A third of tol is left to it (`SHARE`) for beats slower than the pilot. What a pilot does not see, a close encounter
or a slow beat, shows in H: the error of the run is expected to be LAW times the mean move of H times t. If that is above half
of `tol`, or the pilot's error far above what H explains, the run is taken again with half of the step, and the two are
compared; at last a `StepError`. On a chaotic orbit nothing here sees errors that grow long after the pilot. Reasons and
measurements: docs/perturbed.md, section 6.

Of all schemes the one with the fewest kicks in a unit of time is taken. Where the round-off of the pilot hides the error, it
is extrapolated in h with the least order there is, 4.

Output. At equal distances of at least h the step divides the distance. Any other time is reached by whole steps, and by one
shorter step from the last of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from lagrange_bench.integrators.checks import check_real
from lagrange_bench.integrators.compiling.interpreted import at_first_interpreted
from lagrange_bench.integrators.compiling.loops import MEMORY
from lagrange_bench.integrators.interface import Array, StepError, Stepper, Work
from lagrange_bench.integrators.methods.dense import at_times
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.torus import time_step

first_nutation_period = at_first_interpreted(time_step.nutation_period)
LEAST, MOST = 1e-13, 0.1  # of tol
SHARE = 0.3  # of tol, for the error the pilot expects
# length of the pilot: time scales of the top, nutations; LONGEST scales at most
UNITS, PERIODS, LONGEST = 64.0, 8.0, 4096.0
ROWS = 16  # places along the pilot at which states are compared
WIDEST = 4.0  # time scales of the top: a step is never longer, even if there is no nutation
HALVINGS = 12
ORDER = 4  # the least order of a scheme in h
NOISE = 0.2  # round-off after n kicks and t time scales is about NOISE ulp/2 √n t: the energy walks at random
CLEAN = 1e-9  # an error below this that does not fall with h is round-off
STILL = 2.0**-60  # time scales of the top
PARTS = 16  # of a shorter step, at most
# the guard: an error expected of more than DOUBT tol, or a pilot whose error is more than SENSITIVE (move of H) (time), is not
# taken from one run; so many times the step is halved
DOUBT, SENSITIVE, RUNS = 0.5, 10.0, 5
LOOKS = 4  # places on the way at which H is looked at, at least: a row costs a corrector, as long as 150 steps
LAW = 0.2  # error in units of (mean move of H) (time): the median of 800 runs
LEAST_GAIN = 2.0**-8  # of the error by half of the step, at best
CLOSER = 3.0  # times the pilot's largest move of H


@dataclass
class ChosenWork(Work):
    """Work, the pilot's included, and what was chosen."""

    notes: str = ""
    expected: float = 0.0  # error at the last time, the larger one if there are times on both sides of 0


class Watched(Stepper, Protocol):
    """A stepper that says how far H moves."""

    h: float
    tally: Array

    def moves(self, rows: Array, tally: Array) -> Array: ...
    def least_move(self, n: int) -> float: ...


# (y, h, parts) → the state after a time h, by so many small steps, and how many kicks that took
Shorter = Callable[[Array, float, int], tuple[Array, int]]


class Candidate(NamedTuple):
    """What may be chosen: `build(h, table)` makes the stepper; `cost` in kicks; `widest` step in nutations."""

    build: Callable[[float, bool], Watched]
    cost: float
    widest: float


class Moves(NamedTuple):
    """How far H was from its first value, in the square of the rate of the top: on average, at most, and by round-off."""

    mean: float
    most: float
    least: float


Track = tuple[Array, Watched]  # states along a run, the first one included, and the stepper that took it


class Choice(NamedTuple):
    """A scheme and a step, the error expected at the last time, and the share of it that is round-off.

    rate : error of the pilot in a time scale of the top. moves : of H in the pilot.
    """

    name: str
    h: float
    cost: float
    error: float
    noise: float
    rate: float
    moves: Moves

    @property
    def sensitivity(self) -> float:
        """Error in units of (mean move of H) (time)."""
        return self.rate / self.moves.mean

    def expected(self, moves: Moves, time: float) -> float:
        """The error of a run in which H moves so far; `time` in time scales of the top."""
        law = LAW * min(max(self.sensitivity / LAW, 0.02), 50.0) ** 0.5
        closer = moves.most / max(self.moves.most, moves.least)
        return max(law * moves.mean, 0.5 * self.rate * (closer**0.5 if closer > CLOSER else 1.0)) * time + 2.0**-51


def check_tolerance(tol: Any) -> float:
    """`tol` as a float; ValueError if no error of doubles can be meant by it."""
    value = check_real(tol, "tol")
    if not LEAST <= value <= MOST:
        raise ValueError(f"tol must be between {LEAST:g} and {MOST:g}; got {value:g}")
    return value


def evaluate(
    name: str, top: PerturbedTop, y0: Array, times: Array, tol: float, candidates: Mapping[str, Candidate],
    shorter: Shorter,
) -> tuple[Array, ChosenWork]:  # fmt: skip
    """States at any times, the error at the last of them about `tol`.

    Raises
    ------
    StepError : no step is short enough, in the pilot or, by the guard, in the run.
    """
    notes, errors = [], [0.0]

    def run(y: Array, grid: Array, work: Work) -> Array:
        if not np.any(top.rhs(y)):
            notes.append("an equilibrium: no step is needed")
            return np.tile(y, (len(grid), 1))
        last = float(grid[-1])
        if abs(last) < STILL * top.scales(y)[2]:
            notes.append("a time in which the top moves by less than an ulp: no step is needed")
            return y + np.multiply.outer(grid, top.rhs(y))
        chosen = choose(name, top, y, last, tol, candidates, work)
        build, scales = candidates[chosen.name].build, _scales(top, y)
        take = partial(_rows, build, y=y, grid=grid, work=work, tol=tol, shorter=shorter, scales=scales)
        rows, note, expected = _guarded(name, top, y, grid, tol, chosen, take)
        notes.append(note)
        errors.append(expected)
        return rows

    states, work = at_times(name, top, run, y0, times)
    return states, ChosenWork(**vars(work), notes="; ".join(notes), expected=max(errors))


def _guarded(
    name: str, top: PerturbedTop, y0: Array, grid: Array, tol: float, chosen: Choice,
    rows_of: Callable[[float], tuple[Array, float, Moves]],
) -> tuple[Array, str, float]:  # fmt: skip
    """Rows whose error is about `tol`, a note, and the error expected.

    The run is taken again with half of the step until H, or a comparison of two runs, says that it is good.

    Raises
    ------
    StepError : they do not, after `RUNS` runs.
    """
    scales, last = _scales(top, y0), float(grid[-1])
    rows, h, moves = rows_of(math.copysign(chosen.h, last))
    time, why = abs(last) / top.scales(y0)[2], ""
    expected = chosen.expected(moves, time)
    good = expected <= DOUBT * tol and chosen.sensitivity <= SENSITIVE
    if not good:
        far = f"{moves.mean:.1e} in place of {chosen.moves.mean:.1e}"
        why = f"; with h = {h:.6g} H moved by {far}" if expected > DOUBT * tol else "; a sensitive motion: run twice"
    for _ in range(RUNS - 1):
        if good:
            break
        before, coarse = rows, moves
        rows, h, moves = rows_of(0.5 * h)
        difference = float(np.max(_distance(before, rows, scales)))
        gain = min(moves.most / coarse.most, 0.5) if coarse.most > 0.0 else 0.5
        expected = max(difference * gain, 0.25 * LAW * moves.mean * time) + 2.0**-51
        good = max(expected, difference * LEAST_GAIN) <= DOUBT * tol
    if not good:
        reason = (
            f"tol = {tol:g} is not reached at t = {last:g}: with h = {h:.3g} the error is about {expected:.0e}, more "
            "than the start of the motion promises; take method='taylor', which chooses each step, or a larger tol"
        )
        raise StepError(name, reason)
    return rows, f"{chosen.name}, h = {h:.6g}, expected error {expected:.1e} at t = {last:g}{why}", expected


def _rows(
    build: Callable[[float, bool], Watched], h: float, *, y: Array, grid: Array, work: Work, tol: float, shorter: Shorter,
    scales: Array,
) -> tuple[Array, float, Moves]:  # fmt: skip
    """The states at the times of `grid`, by steps of h or a little less; the step; how far H moved."""
    last, n = float(grid[-1]), len(grid)
    wide = abs(last) / n
    even = np.allclose(grid, last * np.arange(1, n + 1) / n, rtol=4 * 2.0**-52, atol=0.0)
    if even and (wide >= abs(h) or n == 1):
        every, parts = math.ceil(wide / abs(h) * (1 - 2.0**-40)), math.ceil(LOOKS / n)
        parts = parts if every >= 4 * parts else 1  # rows on the way, for the guard
        every = parts * math.ceil(every / parts)
        stepper = build(last / (n * every), True)
        track = stepper.record(y, n * every, every // parts)
        rows, moves = track[parts::parts], _moves(stepper, track, n * every)
    else:
        stepper = build(h, True)
        rows, moves = _at_any(stepper, y, grid, work, tol, shorter, scales)
    _count(work, stepper.work)
    return rows, stepper.h, moves


def _moves(stepper: Watched, track: Array, n: int, tally: Array | None = None) -> Moves:
    found = stepper.moves(track, stepper.tally if tally is None else tally)
    mean = float(found[: max(len(found) - 1, 1)].mean())  # the last is at the strongest kick
    return Moves(max(mean, 2.0**-54), float(found.max()), stepper.least_move(n))


def _at_any(
    stepper: Watched, y: Array, grid: Array, work: Work, tol: float, shorter: Shorter, scales: Array
) -> tuple[Array, Moves]:
    """Whole steps, then one shorter step to each time, made of as many parts as it needs."""
    parts, h = 1, stepper.h
    coarse = shorter(y, h, parts)[0]
    while parts < PARTS:
        fine = shorter(y, h, 2 * parts)[0]
        if _distance(coarse, fine, scales) < 0.01 * tol:
            break
        coarse, parts = fine, 2 * parts
    whole = [int(t / h) for t in grid]
    stops = sorted({*whole, *range(0, whole[-1], max(whole[-1] // LOOKS, 1))})
    track, tally = np.empty((len(stops), 6)), np.zeros_like(stepper.tally)
    for k, stop in enumerate(stops):
        track[k] = stepper.advance(track[k - 1], stop - stops[k - 1]) if k else y
        tally = max(tally, stepper.tally, key=lambda counts: counts[MEMORY])
    rows = track[np.searchsorted(stops, whole)]
    for k, (t, steps) in enumerate(zip(grid, whole, strict=True)):
        if t != steps * h:
            rows[k], kicks = shorter(rows[k], t - steps * h, parts)
            work.steps += 1
            work.rhs_evals += kicks
    return rows, _moves(stepper, track, whole[-1], tally)


# ------------------------------------------------------------------------------------ the pilot


def choose(
    name: str, top: PerturbedTop, y0: Array, last: float, tol: float, candidates: Mapping[str, Candidate], work: Work
) -> Choice:
    """The cheapest scheme and step with an expected error of at most `tol` at the time `last`.

    Raises
    ------
    StepError : there is none.
    """
    best, least, cheapest = None, math.inf, math.inf
    for scheme, candidate in candidates.items():
        found = _Pilot(name, candidate, top, y0, last, SHARE * tol, work).search(cheapest)
        if found is None:
            continue
        least = min(least, found.noise)
        if found.error <= tol and found.cost < cheapest:
            best, cheapest = found._replace(name=scheme), found.cost
    if best is not None:
        return best
    round_off = f"round-off alone is about {least:.0e}"
    why = round_off if math.isfinite(least) else "no step of those tried is short enough"
    raise StepError(name, f"tol = {tol:g} is not reached at t = {last:g}: {why}; take a larger tol, or another method")


class _Pilot:
    """Runs of one scheme over the start of the orbit."""

    def __init__(
        self, name: str, candidate: Candidate, top: PerturbedTop, y0: Array, last: float, goal: float, work: Work
    ):
        self.candidate, self.y0, self.goal, self.work = candidate, y0, goal, work
        self.unit, self.scales, self.last = top.scales(y0)[2], _scales(top, y0), abs(last)
        period = nutation_period(top, y0)
        nutations = PERIODS * period if math.isfinite(period) else 0.0
        span = min(self.last, LONGEST * self.unit, max(UNITS * self.unit, nutations))
        self.span = math.copysign(span, last)
        widest = min(candidate.widest * period, WIDEST * self.unit)
        if not 0.0 < widest < math.inf:
            raise StepError(name, "the time scales of the top are beyond the range of doubles")
        self.coarsest = math.ceil(span / ROWS / widest)

    def search(self, dearest: float) -> Choice | None:
        """The longest step whose expected error is at most `goal`; None if it costs more than `dearest`."""
        n, before = self.coarsest, math.inf
        coarse = self.rows(n)
        for _ in range(HALVINGS):
            if self.cost(n) > 2.0 * dearest:  # the step sought is at most twice as long
                break
            fine = self.rows(2 * n)
            error, expected = self.errors(coarse, fine, n)
            lost = error <= self.noise(n, abs(self.span)) or (error < CLEAN and error > before / 4.0)
            if lost and expected > self.goal:  # round-off hides how small the step has to be
                n = math.ceil(n * (expected / self.goal) ** (1.0 / ORDER))
                return self.choice(n, self.goal, self.rows(n))
            if expected <= self.goal:
                return self.between(n, expected, before, error, coarse, fine)
            coarse, n, before = fine, 2 * n, error
        return None

    def between(
        self, n: int, expected: float, before: float, error: float, coarse: Track | None, fine: Track | None
    ) -> Choice | None:
        """The longest step that is good, of n steps to a row and fewer; half as many are not enough."""
        order = min(max(math.log2(before / error), 1.0), 16.0) if before < math.inf and error > 0.0 else 1.0
        if n > self.coarsest:
            fewer = max(n // 2 + 1, math.ceil(n * (expected / self.goal) ** (1.0 / order)))
            for m in sorted({fewer, (fewer + n) // 2} - {n}):
                here = self.rows(m)
                error_here, expected_here = self.errors(here, fine, m)
                if expected_here <= self.goal:
                    return self.choice(m, expected_here, here, error_here)
        return self.choice(n, expected, coarse, error)

    def choice(self, n: int, expected: float, track: Track | None, error: float | None = None) -> Choice | None:
        if track is None:
            return None
        h, rounding = abs(self.span) / (ROWS * n), self.noise(n, self.last)
        moves = _moves(track[1], track[0], ROWS * n)
        rate = LAW * moves.mean if error is None else error * self.unit / abs(self.span)
        return Choice("", h, self.cost(n), expected + rounding, rounding, rate, moves)

    def cost(self, n: int) -> float:
        """Kicks in a unit of time."""
        return self.candidate.cost * ROWS * n / abs(self.span)

    def rows(self, n: int) -> Track | None:
        """States along the pilot, n steps from one to the next; None where a step fails."""
        try:
            stepper = self.candidate.build(self.span / (ROWS * n), False)
            found = stepper.record(self.y0, ROWS * n, n)
        except StepError:
            return None
        _count(self.work, stepper.work)
        return found, stepper

    def noise(self, n: int, t: float) -> float:
        """Round-off after a time t."""
        return 2.0**-53 * (4.0 + NOISE * math.sqrt(self.cost(n) * t) * t / self.unit)

    def errors(self, rows: Track | None, fine: Track | None, n: int) -> tuple[float, float]:
        """The largest error along the pilot, and the one expected at the end of the run."""
        if rows is None or fine is None:
            return math.inf, math.inf
        errors = _distance(rows[0][1:], fine[0][1:], self.scales)
        error, early = float(errors.max()), float(errors[: ROWS // 2].max())
        fast = error > 4.0 * early and error > 4.0 * self.noise(n, abs(self.span))
        return error, error * (self.last / abs(self.span)) ** (2.0 if fast else 1.0)


def _scales(top: PerturbedTop, y0: Array) -> Array:
    rate, size, _ = top.scales(y0)
    return np.array((rate, size))


def _distance(a: Array, b: Array, scales: Array) -> Any:
    """Of states (..., 6), relative to the scales of J and x."""
    J, x = (np.linalg.norm((a - b)[..., part], axis=-1) for part in (slice(0, 3), slice(3, 6)))
    return np.maximum(J / scales[0], x / scales[1])


def _count(work: Work, more: Work) -> None:
    work.steps += more.steps
    work.rhs_evals += more.rhs_evals
    work.iterations += more.iterations


def nutation_period(top: PerturbedTop, y0: Array) -> float:
    """Of the top without V, to 1e-15; where nothing oscillates inf, or a long time."""
    rate, size, unit = top.top.scales(y0)
    if not 0.0 < rate < math.inf:
        return math.inf
    y = np.concatenate((y0[:3] / rate, y0[3:] / size if size > 0.0 else y0[3:]))
    return unit * first_nutation_period(top.alpha / rate * (size / rate), y)[0]  # type: ignore[no-any-return]
