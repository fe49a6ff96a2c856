"""Scheme and step for a given error: what `integrate(…, t=…, tol=…)` does for a splitting with the exact step inside.

A pilot run follows the start of the orbit with each scheme, with a step h and with half of it, quarter of it, …; the difference
of two neighbours is the error of the coarser one. How the error goes on is an assumption: in proportion to t. A symmetric Poisson
map keeps the energy within a bound, so on a torus its frequencies are wrong by a constant, and the phase by that times t. If in
the pilot the error grows faster than t², t² is taken. On a chaotic orbit errors grow exponentially in the end; no pilot sees
that, and there the error is what it is. A third of tol is left to it (`SHARE`) for beats slower than the pilot.

Of all schemes the one with the fewest kicks in a unit of time is taken. Where the round-off of the pilot hides the error, it
is extrapolated in h with the least order there is, 4.

Output. At equal distances of at least h the step divides the distance. Any other time is reached by whole steps, and by one
shorter step from the last of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from integrators.checks import check_real
from integrators.compiling.loops import FixedStepper
from integrators.interface import Array, StepError, Work
from integrators.methods.dense import at_times
from integrators.problem.perturbed import PerturbedTop
from integrators.truth import exact

LEAST, MOST = 1e-13, 0.1  # of tol
SHARE = 0.3  # of tol, for the error the pilot expects
UNITS, PERIODS, LONGEST = (
    64.0,
    8.0,
    4096.0,
)  # length of the pilot: time scales of the top, nutations; LONGEST scales at most
ROWS = 16  # places along the pilot at which states are compared
WIDEST = 4.0  # time scales of the top: a step is never longer, even if there is no nutation
HALVINGS = 12
ORDER = 4  # the least order of a scheme in h
NOISE = 0.2  # round-off after n kicks and t time scales is about NOISE ulp/2 √n t: the energy walks at random
CLEAN = 1e-9  # an error below this that does not fall with h is round-off
STILL = 2.0**-60  # time scales of the top
PARTS = 16  # of a shorter step, at most


@dataclass
class ChosenWork(Work):
    """Work, the pilot's included, and what was chosen."""

    notes: str = ""


class Candidate(NamedTuple):
    """What may be chosen: `build(h, table)` makes the stepper; `cost` in kicks; `widest` step in nutation periods."""

    build: Callable[[float, bool], FixedStepper]
    cost: float
    widest: float


class Choice(NamedTuple):
    """A scheme and a step, the error expected at the last time, and the share of it that is round-off."""

    name: str
    h: float
    cost: float
    error: float
    noise: float


def check_tolerance(tol: Any) -> float:
    """`tol` as a float; ValueError if no error of doubles can be meant by it."""
    value = check_real(tol, "tol")
    if not LEAST <= value <= MOST:
        raise ValueError(f"tol must be between {LEAST:g} and {MOST:g}; got {value:g}")
    return value


def evaluate(
    name: str, top: PerturbedTop, y0: Array, times: Array, tol: float, candidates: Mapping[str, Candidate],
    shorter: Callable[[Array, float, int], tuple[Array, int]],
) -> tuple[Array, ChosenWork]:  # fmt: skip
    """States at any times, the error at the last of them about `tol`.

    `shorter(y, h, parts)` → the state after a time h, by so many small steps, and how many kicks that took.
    """
    notes = []

    def run(y: Array, grid: Array, work: Work) -> Array:
        if not np.any(top.rhs(y)):
            notes.append("an equilibrium: no step is needed")
            return np.tile(y, (len(grid), 1))
        last = float(grid[-1])
        if abs(last) < STILL * top.scales(y)[2]:
            notes.append("a time in which the top moves by less than an ulp: no step is needed")
            return y + np.multiply.outer(grid, top.rhs(y))
        chosen = choose(name, top, y, last, tol, candidates, work)
        wide = abs(last) / len(grid)
        even = np.allclose(grid, last * np.arange(1, len(grid) + 1) / len(grid), rtol=4 * 2.0**-52, atol=0.0)
        if even and (wide >= chosen.h or len(grid) == 1):
            every = math.ceil(wide / chosen.h * (1 - 2.0**-40))
            h = last / (len(grid) * every)
            stepper = candidates[chosen.name].build(h, True)
            rows = stepper.record(y, len(grid) * every, every)[1:]
        else:
            h = math.copysign(chosen.h, last)
            stepper = candidates[chosen.name].build(h, True)
            rows = _at_any(stepper, y, grid, work, tol, shorter, _scales(top, y))
        _count(work, stepper.work)
        notes.append(
            f"{chosen.name}, h = {h:.6g}, expected error {chosen.error:.1e} at t = {last:g}"
            f" ({chosen.noise:.0e} of it round-off)"
        )
        return rows

    states, work = at_times(name, top, run, y0, times)
    return states, ChosenWork(**vars(work), notes="; ".join(notes))


def _at_any(
    stepper: FixedStepper, y: Array, grid: Array, work: Work, tol: float,
    shorter: Callable[[Array, float, int], tuple[Array, int]], scales: Array,
) -> Array:  # fmt: skip
    """Whole steps, then one shorter step to each time, made of as many parts as it needs."""
    parts, h = 1, stepper.h
    coarse = shorter(y, h, parts)[0]
    while parts < PARTS:
        fine = shorter(y, h, 2 * parts)[0]
        if _distance(coarse, fine, scales) < 0.01 * tol:
            break
        coarse, parts = fine, 2 * parts
    rows, done, at = np.empty((len(grid), 6)), 0, y
    for k, t in enumerate(grid):
        whole = int(t / h)
        if whole > done:
            at, done = stepper.advance(at, whole - done), whole
        rest = t - whole * h
        rows[k] = at
        if rest != 0.0:
            rows[k], kicks = shorter(at, rest, parts)
            work.steps += 1
            work.rhs_evals += kicks
    return rows


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
    reason = (
        f"round-off alone is about {least:.0e}" if math.isfinite(least) else "no step of those tried is short enough"
    )
    raise StepError(
        name, f"tol = {tol:g} is not reached at t = {last:g}: {reason}; take a larger tol, or another method"
    )


class _Pilot:
    """Runs of one scheme over the start of the orbit."""

    def __init__(
        self, name: str, candidate: Candidate, top: PerturbedTop, y0: Array, last: float, goal: float, work: Work
    ):
        self.candidate, self.y0, self.goal, self.work = candidate, y0, goal, work
        self.unit, self.scales, self.last = top.scales(y0)[2], _scales(top, y0), abs(last)
        period = exact.nutation_period(top.top, y0)
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
                return self.choice(n, self.goal, error)
            if expected <= self.goal:
                return self.between(n, expected, before, error, fine)
            coarse, n, before = fine, 2 * n, error
        return None

    def between(self, n: int, expected: float, before: float, error: float, fine: Array | None) -> Choice:
        """The longest step that is good, of n steps to a row and fewer; half as many are not enough."""
        order = min(max(math.log2(before / error), 1.0), 16.0) if before < math.inf and error > 0.0 else 1.0
        if n > self.coarsest:
            fewer = max(n // 2 + 1, math.ceil(n * (expected / self.goal) ** (1.0 / order)))
            for m in sorted({fewer, (fewer + n) // 2} - {n}):
                error_here, expected_here = self.errors(self.rows(m), fine, m)
                if expected_here <= self.goal:
                    return self.choice(m, expected_here, error_here)
        return self.choice(n, expected, error)

    def choice(self, n: int, expected: float, error: float) -> Choice:
        rounding = self.noise(n, self.last)
        return Choice("", abs(self.span) / (ROWS * n), self.cost(n), expected + rounding, rounding)

    def cost(self, n: int) -> float:
        """Kicks in a unit of time."""
        return self.candidate.cost * ROWS * n / abs(self.span)

    def rows(self, n: int) -> Array | None:
        """States along the pilot, n steps from one to the next; None where a step fails."""
        try:
            stepper = self.candidate.build(self.span / (ROWS * n), False)
            found = stepper.record(self.y0, ROWS * n, n)
        except StepError:
            return None
        _count(self.work, stepper.work)
        return found[1:]

    def noise(self, n: int, t: float) -> float:
        """Round-off after a time t."""
        return 2.0**-53 * (4.0 + NOISE * math.sqrt(self.cost(n) * t) * t / self.unit)

    def errors(self, rows: Array | None, fine: Array | None, n: int) -> tuple[float, float]:
        """The largest error along the pilot, and the one expected at the end of the run."""
        if rows is None or fine is None:
            return math.inf, math.inf
        errors = _distance(rows, fine, self.scales)
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
