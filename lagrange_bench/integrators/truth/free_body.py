"""The exact motion and rotation of a free rigid body, for any moments, any start and any time: a top in a tide, and more.

    L' = L × ω,   ω = a L,   a = 1/I,   G = |L|,   D = Σ a L²

Let j be the axis of the middle moment, and i, k the next two in cyclic order. In a frame that turns about L at the rate a_j G,
the axis x = R_j is that of a top (`truth.top`) without weight in a tide of the strength (a_i − a_j)(a_j − a_k), with e = L in the
world. Proof: J = ω − a_j L is the angular velocity in this frame; in the body it has the components (a_n − a_j) L_n, so J·x = 0.
From L_i' = (a_j − a_k) L_j L_k, L_k' = (a_i − a_j) L_i L_j follows J' = (a_i − a_j)(a_j − a_k) L_j (L_k R_i − L_i R_k), and the
last factor is L × x.∎ Hence X = L_j, l = 0 and M = D − a_j G².

To Z = x+ of this top come L_i and L_k. They are quotients of the same kind, as L_i'/L_i = (a_j − a_k) L_j L_k/L_i, and

    L_i² = (D − a_k G² − (a_j − a_k) X²)/(a_i − a_k)        L_k² = (a_i G² − D − (a_i − a_j) X²)/(a_i − a_k)

vanish where X' = 0. Let ζ_n be the part of R_n across L. From ζ × L = iGζ the parts of the other two axes follow,

    ζ_i (G² − X²) = (−L_i X + iG L_k) ζ_j        ζ_k (G² − X²) = (−L_k X − iG L_i) ζ_j                  (cyclic for every n)

The numbers of the start are taken as exact. q/|q| is the rotation, and |q| stays constant.
Sources: Jacobi, Gesammelte Werke 2 (1882) 289; Whittaker, Analytical Dynamics, section 69. Tested against `truth.rigid_body`.
"""

import numpy as np
from flint import acb, arb, fmpq

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.problem.rotation import product
from lagrange_bench.integrators.problem.vectors import dot
from lagrange_bench.integrators.truth.curve import (
    BITS,
    Point,
    Terms,
    Zeros,
    above,
    certified,
    midpoint,
    power_above,
)
from lagrange_bench.integrators.truth.rotations import conjugate, matrix, quaternion, square, turns_about
from lagrange_bench.integrators.truth.top import Drift, Top, angle
from lagrange_bench.support.precision import workprec


class FreeBody(Top):
    """The moments and the start q, L: ten numbers. Variables and states are (q, L)."""

    columns = range(7)

    def __init__(self, *numbers: fmpq) -> None:
        moments, q, L = numbers[:3], numbers[3:7], numbers[7:]
        self.a, self.q, self.L, self.length = [1 / v for v in moments], list(q), list(L), square(q)
        a, R = self.a, matrix(q)
        _, j, _ = sorted(range(3), key=a.__getitem__)
        self.places = (j + 1) % 3, j, (j + 2) % 3
        i, j, k = self.places
        self.G2, self.D = dot(L, L), sum((w * v * v for w, v in zip(a, L, strict=True)), fmpq(0))
        J = [sum(((a[n] - a[j]) * L[n] * row[n] for n in range(3)), fmpq(0)) for row in R]
        tide = (a[i] - a[j]) * (a[j] - a[k])
        super().__init__(fmpq(0), tide, *J, *(row[j] for row in R), up=[dot(row, L) for row in R])
        self.start = [*q, *L]
        with workprec(64):
            self.bounds, self.scale = self.amplitudes()
            self.rate = power_above(self.scale)

    def amplitudes(self) -> tuple[list[fmpq], arb]:
        """Squares of the largest |L_n|, by G and D; and r of the majorant, for L_n in units of these and the unit quaternion."""
        (i, j, k), a, bounds = sorted(range(3), key=lambda n: -self.a[n]), self.a, [self.G2] * 3
        if not self.steady:
            low, high = self.D - a[k] * self.G2, a[i] * self.G2 - self.D
            bounds[i], bounds[k] = low / (a[i] - a[k]), high / (a[i] - a[k])
            bounds[j] = min(part / gap for part, gap in ((low, a[j] - a[k]), (high, a[i] - a[j])) if gap)
        rates = [sum((w * w * v for w, v in zip(a, bounds, strict=True)), fmpq(0))]
        for n, p, q in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            if not self.steady:
                rates.append((a[p] - a[q]) ** 2 * bounds[p] * bounds[q] / bounds[n])
        return bounds, arb(max(rates)).sqrt()

    def equations(self) -> list[Terms]:
        """q' = q ω/2, L' = L × ω."""
        h = [w / 2 for w in self.a]
        q0, q1, q2, q3, L1, L2, L3 = range(7)
        spins = (
            ((-h[0], q1, L1), (-h[1], q2, L2), (-h[2], q3, L3)),
            ((h[0], q0, L1), (h[2], q2, L3), (-h[1], q3, L2)),
            ((h[1], q0, L2), (h[0], q3, L1), (-h[2], q1, L3)),
            ((h[2], q0, L3), (h[1], q1, L2), (-h[0], q2, L1)),
        )
        pairs = (1, 2), (2, 0), (0, 1)
        return [*spins, *(((self.a[q] - self.a[p], 4 + p, 4 + q),) for p, q in pairs)]

    def sizes(self) -> list[arb]:
        return [arb(self.length).sqrt()] * 4 + [arb(v).sqrt() for v in self.bounds]

    def radii(self, tolerance: fmpq) -> list[fmpq]:
        return [tolerance * above(arb(self.length).sqrt())] * 4 + [tolerance * above(arb(self.G2).sqrt())] * 3

    def zeros(self) -> tuple[Zeros, ...]:
        i, j, k = (self.a[n] for n in self.places)
        squares = (self.D - k * self.G2, j - k), (i * self.G2 - self.D, i - j)
        return (*super().zeros(), *(Zeros(acb(0), acb(0), arb(v0), arb(v1)) for v0, v1 in squares))

    def own_turn(self, t: fmpq) -> acb:
        """The turn of the top's frame."""
        sin, cos = (self.a[self.places[1]] * t * arb(self.G2).sqrt()).sin_cos()
        return acb(cos, sin)

    def point(self, u: list[arb], t: fmpq) -> Point:
        (i, j, k), L = self.places, u[4:]
        axis = self.frame().across([row[j] for row in matrix(u[:4])])
        Z = axis * self.own_turn(t).conjugate(), acb(L[i]), acb(L[k])
        return Point(L[j], (self.a[k] - self.a[i]) * L[i] * L[k], Z)

    def variables(self, p: Point, t: fmpq) -> list[arb]:
        (i, j, k), L = self.places, [arb(0)] * 3
        L[i], L[j], L[k] = p.Z[1].real, p.x, p.Z[2].real
        zeta, frame = p.Z[0] * self.own_turn(t), self.frame()
        zetas, across, G = [zeta] * 3, self.G2 - L[j] * L[j], frame.length
        zetas[i] = zeta * acb(-L[i] * L[j], G * L[k]) / across
        zetas[k] = zeta * acb(-L[k] * L[j], -G * L[i]) / across
        columns = [frame.vector(v, along / G) for v, along in zip(zetas, L, strict=True)]
        size = arb(self.length).sqrt()
        return [*(size * v for v in quaternion(list(zip(*columns, strict=True)))), *L]

    def state(self, u: list[arb], t: fmpq) -> list[arb]:
        return u

    def turned(self, t: fmpq) -> list[arb]:
        if not self.G2:
            return [arb(v) for v in self.start]
        frame = self.frame()
        return [*product(frame.turned(self.D / self.G2 * t * frame.length), self.q), *map(arb, self.L)]

    # ------------------------------------------------------------------ for tables

    def advance(self, before: list[arb], after: list[arb]) -> tuple[arb, arb]:
        turn = product(after[:4], conjugate(before[:4]))
        return 2 * angle(turn[0], dot(turn[1:], self.frame().axes[2])), arb(0)

    def half_turn(self, period: fmpq, k: int) -> fmpq:
        """The turns about L in half a period, mod 1, if L goes round axis k: then L_k is as before, L_i and L_j are opposite."""
        half = [fmpq(0), *(fmpq(n == k) for n in range(3))]

        def compute() -> list[arb]:
            before, after = product(self.q, half), self.variables_at(period / 2)[:4]
            turn = product(after, conjugate(before))
            return [angle(turn[0], dot(turn[1:], self.frame().axes[2])) / arb.pi()]

        return midpoint(certified(compute, [fmpq(1, 2**130)], BITS)[0])

    def drifts(self) -> list[Drift]:
        if not self.G2 or (self.node is None and not self.steady):
            return []
        rate = self.D / self.G2 * arb(self.G2).sqrt()
        return [Drift(rate, arb(0), is_beyond=not self.steady)]

    def fastest(self) -> arb:
        return self.scale

    def in_doubles(self, u: Array, left: Array, right: Array) -> Array:
        """States (N, 7) that are turned about L."""
        size = float(arb(self.G2).sqrt()) or 1.0
        turn = turns_about([float(v) / size for v in self.up], left)
        return np.column_stack((*product(turn, u[:, :4].T), u[:, 4:]))
