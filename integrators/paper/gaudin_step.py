"""Compiled two-point steps of the real Gaudin magnet: any number of spins, any number of commuting maps to a step.

The map of `gaudin_maps.two_point`, with ℓ(λ) = p + iq, n = Re v p + Im v q − p×q, ρ = |n|/Im λ, g_j = a_j − Re λ:

    s̃_j = s_j + 2/(ρ² g_j² + n·n) (n×(n×s_j) − ρ g_j n×s_j)

Round-off is what decides here. Three things make it a random walk of a few ulp, or less:

- No constant that was rounded once is used twice. The denominators, also those of 1/(λ − a_j), carry the factor ρ²
  of the step before: |n| changes along the orbit, so the rounding of the quotients does too. With weights and
  denominators computed once (or from |w| = Im λ, the same at every step) all |s_j| and H_j drift linearly, 1e-17 to
  1e-16 per step; so they did here.
- v is frozen at its correctly rounded value on the torus of the initial state. Then ℓ(λ)² is drawn back to v² by the
  step itself, on either sheet: every map holds two real combinations of the H_j. (Correcting v from the current state
  lets all H_j drift.) The frozen map is not Poisson off its torus; `gaudin_maps.two_point` is. Several maps of one step
  may together drive a state away, by a factor e in thousands of steps. So v follows the state in an exact step of
  two maps and more, and all H_j drift by up to 3e-17 a step.
- Every eighth step and at the end of a run |s_j| is put back, a change of an ulp.
- The turn about e3 that is part of an exact step commutes with the maps. It is left out of the loop and made once for a
  state that is handed out, by the whole angle: cos² + sin² − 1, the same at every step, would change all H_j linearly.
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from mpmath import mp

from lagrange_bench.integrators.checks import check_grid, check_step
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.loops import INTERRUPTIBLE
from lagrange_bench.integrators.interface import StepError, Stepper, Work
from lagrange_bench.integrators.paper.gaudin_curve import eigenvalue, pade_parameters
from lagrange_bench.integrators.paper.gaudin_doubling import exact_step
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet, check_upper
from lagrange_bench.integrators.paper.phase_space import Numbers, dot, numbers, root_near
from lagrange_bench.integrators.precision import workdps

PIN = 8  # steps between two corrections of |s_j|
OFF_TORUS = 1e-9  # relative distance of an invariant from the prepared torus that is no longer round-off


@jit
def axis(s, alpha, g, r, e, v, follow, weight):
    """n = Re v p + Im v q − p×q of spins s (3, n); r, e: ρ and |n| of the step before, weight (n,): scratch."""
    for j in range(s.shape[1]):
        h = g[j] * r
        weight[j] = 1.0 / (h * h + e * e)
    a1 = a2 = a3 = b1 = b2 = b3 = 0.0
    for j in range(s.shape[1]):
        h = g[j] * r
        x = s[0, j] * weight[j]
        y = s[1, j] * weight[j]
        z = s[2, j] * weight[j]
        a1 += h * x
        a2 += h * y
        a3 += h * z
        b1 += x
        b2 += y
        b3 += z
    p1 = -r * a1
    p2 = -r * a2
    p3 = alpha - r * a3
    f = -r * e
    q1 = f * b1
    q2 = f * b2
    q3 = f * b3
    if follow:  # v of the present state, by a step of Newton's method from the frozen one
        square = complex(
            (p1 * p1 + p2 * p2 + p3 * p3) - (q1 * q1 + q2 * q2 + q3 * q3), 2 * (p1 * q1 + p2 * q2 + p3 * q3)
        )
        v = v + (square - v * v) / (2.0 * v)
    n1 = (v.real * p1 + v.imag * q1) - (p2 * q3 - p3 * q2)
    n2 = (v.real * p2 + v.imag * q2) - (p3 * q1 - p1 * q3)
    n3 = (v.real * p3 + v.imag * q3) - (p1 * q2 - p2 * q1)
    return n1, n2, n3


@jit
def turn(s, g, r, nn, n1, n2, n3):
    """All spins about n."""
    for j in range(s.shape[1]):
        x = s[0, j]
        y = s[1, j]
        z = s[2, j]
        h = g[j] * r
        d = 2.0 / (h * h + nn)
        t1 = n2 * z - n3 * y
        t2 = n3 * x - n1 * z
        t3 = n1 * y - n2 * x
        s[0, j] = x + d * ((n2 * t3 - n3 * t2) - h * t1)
        s[1, j] = y + d * ((n3 * t1 - n1 * t3) - h * t2)
        s[2, j] = z + d * ((n1 * t2 - n2 * t1) - h * t3)


@jit
def pin(s, square, low):
    """Every spin back to its own s_j² = square + low, along itself."""
    for j in range(s.shape[1]):
        if square[j] != 0.0:
            x = s[0, j]
            y = s[1, j]
            z = s[2, j]
            e = 0.5 * ((((x * x - square[j]) + y * y) + z * z) - low[j]) / square[j]
            s[0, j] = x - e * x
            s[1, j] = y - e * y
            s[2, j] = z - e * z


@jit
def run(s, alpha, g, eta, v, follow, rho, edge, square, low, first, last, total, every, out):
    """Steps `first` to `last` of `total` of spins s (3, n), row by row into out; g is (k, n), eta, v, rho, edge (k,)."""
    weight = np.empty(s.shape[1])
    for step in range(first, last):
        for i in range(len(eta)):
            n1, n2, n3 = axis(s, alpha, g[i], rho[i], edge[i], v[i], follow, weight)
            nn = n1 * n1 + n2 * n2 + n3 * n3
            edge[i] = math.sqrt(nn)
            rho[i] = edge[i] / eta[i]
            turn(s, g[i], rho[i], nn, n1, n2, n3)
        if (step + 1) % PIN == 0 or step + 1 == total:
            pin(s, square, low)
        if (step + 1) % every == 0:
            out[(step + 1) // every] = s


class MagnetStepper(Stepper):
    """Advances the spins (n, 3) of one torus by steps of one or more two-point maps.

    Parameters
    ----------
    near, lams, v : of each map the site from which its λ is counted, λ less that site, Im λ > 0, and v to a few digits.
    turn : about e3 after the maps, in revolutions.
    """

    def __init__(
        self, magnet: GaudinMagnet, spins: Any, h: float, near: Sequence[int], lams: Numbers, v: Any, turn: Fraction
    ):
        self.magnet, self.h, self.work = magnet, h, Work()
        spins, sites = magnet.check_real_spins(spins), np.array(magnet.sites)
        origins = sites[np.array(near, dtype=int)]
        self.lams = np.array([check_upper(magnet, lam, "lams") for lam in origins + lams], dtype=complex)
        self.turn, self.follow, points = turn, False, []
        with workdps(34):  # so that what is kept is correctly rounded
            exactly = numbers(spins)
            for origin, lam, guess in zip(origins.tolist(), lams.tolist(), v, strict=True):
                fine = GaudinMagnet(tuple(mp.mpmathify(a) - origin for a in magnet.sites), mp.mpmathify(magnet.alpha))
                ell = fine.vector(exactly, mp.mpc(lam))
                points.append(root_near(dot(ell, ell), guess))
            squares = magnet.casimirs(exactly)
            self.v = np.array(points, dtype=complex)
            self.square = squares.astype(float)
            self.low = (squares - numbers(self.square)).astype(float)
        self.gaps = (sites - origins[:, None]) - lams.real[:, None]
        self.home = magnet.invariants(spins)

    def record(self, spins: Numbers, n: int, every: int) -> Numbers:
        """Spins after 0, every, 2·every, … n steps, each in the shape of `spins`, (sites, 3) or (3 sites,)."""
        check_grid(n, every)
        shape, spins = np.shape(spins), self.magnet.check_spins(spins)
        here = self.magnet.invariants(spins)
        if np.max(np.abs(here - self.home)) > OFF_TORUS * np.max(np.abs(self.home)):
            raise StepError("two-point map", "the spins are not on the torus this step was prepared for", h=self.h)
        s = np.ascontiguousarray(spins.T).astype(float, copy=True)
        out = np.empty((n // every + 1, *s.shape))
        out[0] = s
        rho, edge = np.ones(len(self.lams)), self.lams.imag.copy()
        curve = float(self.magnet.alpha), self.gaps, edge.copy(), self.v, self.follow
        constants = (*curve, rho, edge, self.square, self.low)
        some = max(1, INTERRUPTIBLE // max(1, self.gaps.size))  # Ctrl-C is seen between two calls
        for first in range(0, n, some):
            run(s, *constants, first, min(first + some, n), n, every, out)
        rows = np.swapaxes(out, 1, 2)
        if not np.all(np.isfinite(rows[-1])):
            raise StepError("two-point map", "the spins left the range of floating-point numbers", h=self.h, step=n)
        self.work.steps += n
        return (rows if self.turn == 0 else self._turned(rows, every)).reshape(-1, *shape)

    def _turned(self, rows: Numbers, every: int) -> Numbers:
        """Row r turned about e3 by r · every times the turn of a step; row 0 is left alone."""
        whole, part = self.turn.denominator, every * self.turn.numerator
        angle = 2 * math.pi * np.array([(r * part) % whole / whole for r in range(1, len(rows))])[:, None]
        turned, (x, y) = rows.copy(), np.moveaxis(rows[1:, :, :2], -1, 0)
        turned[1:, :, 0] = np.cos(angle) * x - np.sin(angle) * y
        turned[1:, :, 1] = np.sin(angle) * x + np.cos(angle) * y
        return turned


def prepare(magnet: GaudinMagnet, spins: Any, h: float, *, factors: int = 1) -> MagnetStepper:
    """The step of order 2·factors over h, positive or negative, for the flow of H_site."""
    h, spins, site = check_step(h), magnet.check_spins(spins), magnet.site or 0
    lams, here = pade_parameters(magnet, spins, abs(h), factors, site), magnet.sites[site]
    centred = GaudinMagnet(tuple(a - here for a in magnet.sites), magnet.alpha)
    v = [eigenvalue(centred, spins, lam, 1 if h > 0 else -1, site) for lam in lams]
    return MagnetStepper(magnet, spins, h, [site] * factors, lams, v, Fraction(0))


def prepare_exact(magnet: GaudinMagnet, spins: Any, h: float) -> MagnetStepper:
    """The exact step over h, positive or negative: half as many maps as spins, and a turn about e3."""
    h, spins = check_step(h), magnet.check_real_spins(spins)
    try:
        near, lams, v, turn = exact_step(magnet, spins, h)
    except ArithmeticError as error:
        raise StepError("backlund", str(error), h=h) from None
    stepper = MagnetStepper(magnet, spins, h, near, lams, v, turn)
    stepper.follow = len(lams) > 1
    return stepper
