"""The exact motion and rotation of a heavy symmetric body: the top of its axis, and two Cayley–Klein parameters.

With the moments A across and C along the axis a, and the constant L_a = L·a, J = R L/A and x = R a are a top (`truth.top`) with
alpha e = (weight/A) up. The body has the angular velocity J + σ x, σ = L_a (1/C − 1/A). So R is a turn by σt about a, and then
the rotation Q of a body with the angular velocity J: as quaternions Q' = J Q/2. In a frame with e up, Q = (q0, q1, q2, q3),

    u = q0 + i q3    v = q1 + i q2    |u|² = (1 + X/|e|)/2    |v|² = (1 − X/|e|)/2    x+ = −2i u v
    u'/u = (X' + i (M + |e| l))/(2 (|e| + X))        v'/v = (−X' + i (M − |e| l))/(2 (|e| − X))

for |q| = 1. So u has the one zero X = −|e|, X' = i (M + |e| l), and v the one zero X = |e|, X' = i (|e| l − M); as k = 0, both
have one pole. They are doubled as `truth.curve` says, and give x+, Q and J.

The numbers of the start are taken as exact. q/|q| is the rotation, and |q| stays constant. Tested against `truth.rigid_body`.

Source: Klein & Sommerfeld, Theorie des Kreisels, chapter VI.
"""

import numpy as np
from flint import acb, arb, fmpq

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.problem.rotation import product
from lagrange_bench.integrators.problem.vectors import dot
from lagrange_bench.integrators.truth.curve import I, Point, Terms, Zero, above
from lagrange_bench.integrators.truth.rotations import conjugate, matrix, square, turns_about
from lagrange_bench.integrators.truth.top import Drift, Top, angle

HALF = fmpq(1, 2)
# from the axes k + 1, k + 2, k of the body to its axes 1, 2, 3, by k
CYCLES = ((HALF, HALF, HALF, HALF), (HALF, -HALF, -HALF, -HALF), (fmpq(1), fmpq(0), fmpq(0), fmpq(0)))


class SymmetricBody(Top):
    """The moments A and C, the weight (3), up (3) and the start q, L. Variables are (J, x, X, Q), states (q, L)."""

    columns = 0, 1, 2, 7, 8, 9, 10

    def __init__(self, A: fmpq, C: fmpq, *numbers: fmpq) -> None:
        weight, up, q, L = numbers[:3], numbers[3:6], numbers[6:10], numbers[10:]
        axis = next(n for n in range(3) if weight[n])
        self.A, self.cycle, self.axis, self.along = A, CYCLES[axis], axis, L[axis]
        self.Q, self.length = product(q, self.cycle), square(q)
        R = matrix(q)
        J, x = [dot(row, L) / A for row in R], [row[axis] for row in R]
        super().__init__(weight[axis] / A, fmpq(0), *J, *x, up=up)
        self.start = [*self.start, *self.Q]
        self.spin = L[axis] * (1 / C - 1 / A)

    def equations(self) -> list[Terms]:
        half = fmpq(1, 2)
        J1, J2, J3, Q0, Q1, Q2, Q3 = 0, 1, 2, 7, 8, 9, 10
        frame = (
            ((-half, J1, Q1), (-half, J2, Q2), (-half, J3, Q3)),
            ((half, J1, Q0), (half, J2, Q3), (-half, J3, Q2)),
            ((half, J2, Q0), (half, J3, Q1), (-half, J1, Q3)),
            ((half, J3, Q0), (half, J1, Q2), (-half, J2, Q1)),
        )
        return [*super().equations(), *frame]

    def sizes(self) -> list[arb]:
        return [*super().sizes(), *[arb(self.length).sqrt()] * 4]

    def radii(self, tolerance: fmpq) -> list[fmpq]:
        return [tolerance * above(arb(self.length).sqrt())] * 4 + [tolerance * self.A * above(self.scale)] * 3

    def zeros(self) -> tuple[Zero, ...]:  # type: ignore[override]
        length = arb(self.eps).sqrt()
        return Zero(-length, I * (self.M + length * self.l)), Zero(length, I * (length * self.l - self.M))

    def point(self, u: list[arb], t: fmpq) -> Point:
        q0, q1, q2, q3 = product(self.frame().turn, u[7:])
        return super().point(u, t)._replace(Z=(acb(q0, q3), acb(q1, q2)))

    def variables(self, p: Point, t: fmpq) -> list[arb]:
        u, v = p.Z
        Q = product(conjugate(self.frame().turn), (u.real, v.real, v.imag, u.imag))
        return [*super().variables(p._replace(Z=(-2 * I * u * v / self.length,)), t), *Q]

    def turned(self, t: fmpq) -> list[arb]:
        frame, rate = self.frame(), self.turn_rate()
        sin, cos = arb(self.own_rate() * t / 2).sin_cos()
        Q = product(product(frame.turned(rate * t * frame.length), self.Q), (cos, arb(0), arb(0), sin))
        return [*super().turned(t), *Q]

    def own_rate(self) -> fmpq:
        """The rate of Q about the axis in a steady motion, beside the turn about e."""
        return self.l - self.turn_rate() * self.X

    def state(self, u: list[arb], t: fmpq) -> list[arb]:
        sin, cos = arb(self.spin * t / 2).sin_cos()
        q = product(product(u[7:], (cos, arb(0), arb(0), sin)), conjugate(self.cycle))
        L = [self.A * dot(column, u[:3]) for column in zip(*matrix(q), strict=True)]
        L[self.axis] = arb(self.along)
        return [*q, *L]

    # ------------------------------------------------------------------ for tables

    def advance(self, before: list[arb], after: list[arb]) -> tuple[arb, arb]:
        left, _ = super().advance(before, after)
        turn = product(product(conjugate(before[7:]), self.frame().turned(-left)), after[7:])
        return left, 2 * angle(turn[0], turn[3])

    def drifts(self) -> list[Drift]:
        spin = [Drift(arb(0), arb(self.spin))]
        if self.steady:
            return [*spin, super().drifts()[0]._replace(right=arb(self.own_rate()))]
        return spin if self.node is None else [*spin, Drift(arb(0), arb(self.l), is_beyond=True)]

    def in_doubles(self, u: Array, left: Array, right: Array) -> Array:
        """States (N, 7) from J and Q (N, 7), turned about e and about the axis."""
        zero, length = np.zeros(len(u)), float(arb(self.eps).sqrt())
        q = product(product(u[:, 3:].T, turns_about((0.0, 0.0, 1.0), right)), [float(v) for v in conjugate(self.cycle)])
        _, *L = product(product(conjugate(q), (zero, *u[:, :3].T)), q)
        L = [float(self.A / self.length) * v for v in L]
        L[self.axis] = np.full(len(u), float(self.along))
        return np.stack((*product(turns_about([float(v) / length for v in self.up], left), q), *L), axis=-1)
