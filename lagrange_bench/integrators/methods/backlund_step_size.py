"""Which steps suit `backlund_splitting`: warnings where V is strong, and where a step is in resonance with V.

Along the motion V has harmonics of the nutation's frequency and, if it depends on time, of its own frequency. A step excites a
harmonic that comes near 2π/h.
"""

import math

import numpy as np

from lagrange_bench.integrators.checks import warn_caller
from lagrange_bench.integrators.compiling.tape import bandwidth
from lagrange_bench.integrators.interface import Array, StepError, StepWarning
from lagrange_bench.integrators.methods.backlund_schemes import WIDEST
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units, ldexp
from lagrange_bench.integrators.torus import time_step

NAME = "backlund_splitting"
STRONG = 0.05  # range of V over energy of the top, from which on other methods are better
RESONANT = 0.125  # a step over the nutation period, from which on harmonics of the motion come near 2π/h
SHORTEST = math.pi  # the shortest nutation period of any top, in time scales


def warn_strong(problem: Problem, y0: Array) -> None:
    """Warn where V is so strong that another method costs less."""
    rate, length, _ = top_without_V(problem).scales(y0)
    V = problem.alpha_and_rest[1]
    strength = length * math.hypot(*map(float, V.gradient(problem.start, *y0.tolist(), *problem.numbers)))
    if strength > STRONG * rate * rate:
        share = strength / rate / rate if rate > 0 else math.inf
        text = f"V is strong here, {share:.2g} of the top's own scale: blanes_moan6 costs less"
        warn_caller(text, StepWarning)


def warn_long(problem: Problem, y0: Array, h: float) -> None:
    """Warn, or raise a StepError, where the step is in resonance with V along the motion from y0 on."""
    h, frequency, unit = abs(h), highest_frequency(problem, y0, np.zeros(1)), top_without_V(problem).scales(y0)[2]
    if h <= RESONANT * SHORTEST * unit * (1.0 - h * frequency / WIDEST):
        return
    period = nutation_period(problem, y0)
    if h >= 0.5 * period:
        reason = f"h is {h / period:.2g} of the nutation period, in resonance with it; take less than a half"
        raise StepError(NAME, reason, h=h)
    if h > (longest := longest_step(period, frequency)):
        drive = f" and {h * frequency / math.tau:.2g} of the shortest period of H in time" if frequency else ""
        text = f"h is {h / period:.2g} of the nutation period{drive}: V's harmonics are near resonance with it; take less than"
        warn_caller(f"{text} {longest:.3g}", StepWarning)


def top_without_V(problem: Problem) -> LagrangeTop:
    """The top without V."""
    return LagrangeTop(problem.alpha_and_rest[0])


def longest_step(period: float, frequency: float) -> float:
    """The step from which on V has harmonics near 2π/h: of the nutation, of H in time, or of both together."""
    share = 1.0 / (RESONANT * period) + frequency / WIDEST
    return 1.0 / share if share > 0.0 else math.inf


def highest_frequency(problem: Problem, y0: Array, elapsed: Array) -> float:
    """The highest angular frequency of V in time, from the sin, cos and exp in its formula. elapsed : times since the start."""
    V = problem.alpha_and_rest[1]
    return bandwidth(V.energy, 0, (problem.start + elapsed, *y0, *problem.numbers)) if V.timed else 0.0


def nutation_period(problem: Problem, y0: Array) -> float:
    """The nutation period of the top without V, to 1e-15; inf, or a long time, if nothing oscillates."""
    units = Units(top_without_V(problem), y0, 1.0)
    return ldexp(time_step.nutation_period(units.alpha, tuple(units.enter(y0).tolist()))[0], -units.rate)
