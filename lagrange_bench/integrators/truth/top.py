"""The top in a uniform field or in a vertical tide, J' = (alpha + k X) e × x, x' = J × x, X = e·x, as a motion on a curve.

e is any vector that points up, ε = |e|²; for a Lagrange top it is e3, and X = x3. M = e·J, l = x·J, c = |x|² and the energy
2H = |J|² + 2 alpha X + k X² are constant. X' = e·(J × x), and Gram's determinant of e, J and x gives

    X'² = f(X) = (2H − 2 alpha X − k X²)(ε c − X²) − (c M² − 2 l M X + ε l²).

The parts of x and J across e are complex numbers x+ and J+, with

    J+ conj(x+) = l − M X/ε − iX'/√ε        |x+|² = c − X²/ε        x+'/x+ = (i√ε (c M − l X) − X X')/(ε c − X²).

So Z = x+ is as `truth.curve` wants it. Its zeros are X = ±√(ε c), X' = i (ε l − M X)/√ε; its poles are those of X.

**Steady motions.** If X' = X'' = 0, J and x turn about e at the rate ρ|e|, with ρ e × J = (alpha + k X) e × x, ρ rational.

**The separatrix.** If f has a double root X*, and no other root lies between X and X*, then X goes to X* in infinite time, with
f = (X − X*)² w(X) and w > 0. Later than T, X lies between X(T) and X*, and |X − X*| decays at least like e^(−√w (t − T)), with
the least w there. If Z has a limit, it turns at a rate q(X) that is rational in X. This differs from q(X*) by at most
|q'| |X − X*|, so the phase gained since T differs from q(X*) (t − T) by at most max |q'| |X(T) − X*|/√w. (A triple root is
reached like 1/t², and needs none of this.)

**The period.** With `low` and `high`, the roots of f between which X moves, e(X) = f'(low)/(4 (X − low)) is Weierstrass' function
of t but for a constant. With e1 = e(high), and e2, e3 = e of the other two roots (0 for a root at infinity), it is

    T = 2 R_F(0, e1 − e2, e1 − e3)        ∫ dX/(|P − X| √f) = (R_F + e(P) R_J(0, e1 − e2, e1 − e3, e1 − e(P))/3)/|P − low|

from `low` to `high`. The integrals for the poles P = ±√(ε c) give the angle that x sweeps about e in a period: its rate is the
sum of (M √c ∓ |e| l)/(2 |P − X|).

Sources: Whittaker, Analytical Dynamics, sections 71–72; DLMF 19.25.35 and 19.16. All formulas are derived again, and tested
against Taylor series in integers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple, cast

from flint import acb, arb, ctx, fmpq, fmpq_poly

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.truth.curve import (
    KEPT,
    Curve,
    I,
    Motion,
    Point,
    Terms,
    Uncertain,
    Zeros,
    above,
    around,
    certified,
    cross,
    derivative,
    dot,
    horner,
    power_above,
    rational,
)
from lagrange_bench.integrators.truth.rotations import matrix, product, square, unit_turn
from lagrange_bench.support.precision import workprec

Rationals = Sequence[fmpq]
E3 = fmpq(0), fmpq(0), fmpq(1)


class Frame(NamedTuple):
    """Axes of which the third is e/|e|."""

    length: arb  # |e|
    turn: list[arb]  # the quaternion that takes vectors of the world to these axes
    axes: list[list[arb]]  # its matrix

    def across(self, v: Sequence[Any]) -> acb:
        """v+ of a vector."""
        return acb(dot(self.axes[0], v), dot(self.axes[1], v))

    def vector(self, across: acb, along: arb) -> list[arb]:
        """The vector with the parts v+ and `along`, that along e/|e|."""
        return [a * across.real + b * across.imag + third * along for a, b, third in zip(*self.axes, strict=True)]

    def turned(self, angle: arb) -> list[arb]:
        """The quaternion of a turn about e."""
        sin, cos = (angle / 2).sin_cos()
        return [cos, *(sin * v for v in self.axes[2])]


class Node(NamedTuple):
    """The double root X* that X approaches, and √w there."""

    pole: int  # from pole to pole: the sign of X* for t → ∞; else 0
    root: fmpq  # X*, for t → ±∞
    speed: float


class Near(NamedTuple):
    """A time later than T on the separatrix, or before −T. X holds X(t) and X*."""

    p: Point  # at T
    X: arb
    root: arb  # X*
    apart: arb  # |X(T) − X*|
    speed: arb  # √w
    since: fmpq
    t: fmpq

    def turn(self, n: Sequence[arb], d: Sequence[arb]) -> acb:
        """e^(iφ), with the phase that a Z gains since T; its rate is n(X)/d(X)."""
        N, D = horner(n, self.X), horner(d, self.X)
        slope = (horner(derivative(n), self.X) * D - N * horner(derivative(d), self.X)) / (D * D)
        phase = horner(n, self.root) / horner(d, self.root) * self.since + around(slope * self.apart / self.speed)
        sin, cos = phase.sin_cos()
        return acb(cos, sin)


class Drift(NamedTuple):
    """A turn at a constant rate, about e from the left and about the body's own axis from the right."""

    left: arb
    right: arb
    is_beyond: bool = False  # only near the limit on the separatrix


class Turns(NamedTuple):
    """Where X turns, and the other roots of f, which may be complex."""

    low: arb
    high: arb
    others: list[acb]


def past_poles(swept: arb, poles: int) -> float:
    """The angle about e in a period, if the axis passes through 0, 1 or 2 poles. At each the azimuth jumps by ±π.

    swept : the angle without the jumps. The smaller of the two limits is taken; of a pair ±π the positive one.
    """
    if poles != 1:
        return float(swept)
    return float(swept - arb.pi() if swept > 0 else swept + arb.pi())


def angle(c: arb, s: arb) -> arb:
    """The angle of (c, s), away from the cut of the arc tangent."""
    return arb.atan2(-s, -c) + arb.pi() if c < 0 else arb.atan2(s, c)


class Top(Motion):
    """alpha, k and the start (J, x), rational. Variables are (J, x, X), states (J, x).

    columns : the places of the variables that `in_doubles` takes.
    """

    columns: Sequence[int] = range(6)

    def __init__(self, alpha: fmpq, k: fmpq, J: Rationals, x: Rationals, up: Rationals = E3) -> None:
        super().__init__()
        self.frame_with = lru_cache(KEPT)(self._frame_with)
        self.alpha, self.k, self.J, self.x, self.up = alpha, k, list(J), list(x), list(up)
        self.X, self.M, self.l, self.c, self.eps = dot(up, x), dot(up, J), dot(x, J), dot(x, x), dot(up, up)
        X, M, l, c, eps = self.X, self.M, self.l, self.c, self.eps
        self.force = alpha + k * X
        self.kinetic = fmpq_poly([dot(J, J) + 2 * alpha * X + k * X * X, -2 * alpha, -k])
        pole = fmpq_poly([eps * c, 0, -1])
        self.f = self.kinetic * pole - fmpq_poly([c * M * M + eps * l * l, -2 * l * M])
        self.velocity, self.acceleration = dot(up, cross(J, x)), self.f.derivative()(X) / 2
        self.start, self.rates = [*J, *x, X], self.equations()
        with workprec(64):
            length, size = arb(eps).sqrt(), arb(c).sqrt()
            self.scale = (
                arb(dot(J, J)).sqrt() + (length * size * (abs(arb(alpha)) + length * size * abs(arb(k)))).sqrt()
            )
            self.rate = power_above(self.scale)
        self.steady = self.velocity == 0 and self.acceleration == 0
        common = self.f.gcd(self.f.derivative())
        self.triple = not self.steady and common.gcd(common.derivative()).degree() > 0
        self.node = None if self.steady or self.triple else self.find_node()

    def equations(self) -> list[Terms]:
        """Terms of J', x' and X'."""
        J, x, X = (0, 1, 2), (3, 4, 5), 6
        pairs = (1, 2), (2, 0), (0, 1)
        up, alpha, k = self.up, self.alpha, self.k
        fields = [
            ((alpha * up[i], x[j]), (-alpha * up[j], x[i]), (k * up[i], X, x[j]), (-k * up[j], X, x[i]))
            for i, j in pairs
        ]
        moves = [[(fmpq(1), J[i], x[j]), (fmpq(-1), J[j], x[i])] for i, j in pairs]
        climb = [(v * c, *places) for v, row in zip(up, moves, strict=True) for c, *places in row]
        return [tuple(term for term in row if term[0]) for row in (*fields, *moves, climb)]

    # ------------------------------------------------------------------ the curve

    def sizes(self) -> list[arb]:
        size, length = arb(self.c).sqrt(), arb(self.eps).sqrt()
        return [arb(self.rate)] * 3 + [size] * 3 + [length * size]

    def radii(self, tolerance: fmpq) -> list[fmpq]:
        """The largest radii of a state."""
        return [tolerance * above(self.scale)] * 3 + [tolerance * above(arb(self.c).sqrt())] * 3

    def _frame_with(self, bits: int) -> Frame:
        """The shortest turn that takes e to the third axis; if e points down, half a turn after one that takes −e there."""
        length, (x, y, z) = arb(self.eps).sqrt(), self.up
        turn = (
            [length + z, arb(y), arb(-x), arb(0)]
            if z >= 0
            else product((0, 1, 0, 0), [length - z, arb(-y), arb(x), arb(0)])
        )
        size = square(turn).sqrt()
        return Frame(length, [v / size for v in turn], matrix(turn))

    def curve(self, base: Point) -> Curve:
        return Curve(arb(self.f[1]), arb(self.f[2]), arb(self.f[3]), arb(self.f[4]), self.zeros(), base)

    def zeros(self) -> tuple[Zeros, ...]:
        length = arb(self.eps).sqrt()
        return (Zeros(I * (length * self.l), -I * (self.M / length), arb(self.eps * self.c), arb(1)),)

    def point(self, u: list[arb], t: fmpq) -> Point:
        return Point(u[6], dot(self.up, cross(u[:3], u[3:6])), (self.frame_with(ctx.prec).across(u[3:6]),))

    def variables(self, p: Point, t: fmpq) -> list[arb]:
        frame, X, x = self.frame_with(ctx.prec), p.x, p.Z[0]
        J = x * acb(self.l - self.M * X / self.eps, -p.y / frame.length) / (self.c - X * X / self.eps)
        return [*frame.vector(J, self.M / frame.length), *frame.vector(x, X / frame.length), X]

    def state(self, u: list[arb], t: fmpq) -> list[arb]:
        return u[:6]

    def variables_at(self, t: fmpq) -> list[arb]:
        if self.steady:
            return self.turned(t)
        if self.node is not None and abs(t) > (T := self.late()):
            sign = 1 if t > 0 else -1
            return self.beyond(self.point_since(sign * T - self.base_time()), sign, t - sign * T, t)
        return super().variables_at(t)

    # ------------------------------------------------------------------ steady motions

    def turn_rate(self) -> fmpq:
        """ρ of a steady motion: it turns at the rate ρ|e|. 0 if x is vertical, too: sleeping or hanging."""
        J, M, X, eps = self.J, self.M, self.X, self.eps
        if square := dot(J, J) - M * M / eps:
            return self.force * (self.l - M * X / eps) / square
        return M / eps if self.c * eps != X * X else fmpq(0)

    def turned(self, t: fmpq) -> list[arb]:
        """The variables of a steady motion."""
        frame, rate = self.frame_with(ctx.prec), self.turn_rate()
        sin, cos = (rate * t * frame.length).sin_cos()
        parts = ((v, along / frame.length) for v, along in ((self.J, self.M), (self.x, self.X)))
        return [w for v, along in parts for w in frame.vector(frame.across(v) * acb(cos, sin), along)] + [arb(self.X)]

    # ------------------------------------------------------------------ the separatrix

    def find_node(self) -> Node | None:
        """The double root that X approaches, or None; decided in rational numbers."""
        f, X, eps, c = self.f, self.X, self.eps, self.c
        pole, double = fmpq_poly([eps * c, 0, -1]), f.gcd(f.derivative())
        # f <= 0 at the poles: so if f = k q² with k > 0, q vanishes there, and X goes from pole to pole
        if self.k > 0 and f == self.k * pole * pole:
            with workprec(64):
                return Node(1 if self.velocity > 0 else -1, fmpq(0), float(2 * arb(self.k * eps * c).sqrt()))
        if double.degree() != 1:
            return None
        root = -double[0] / double[1]
        w = f // (fmpq_poly([-root, 1]) * fmpq_poly([-root, 1]))
        if w(root) <= 0 or (self.velocity == 0 and self.acceleration * (root - X) < 0):
            return None
        # w > 0 at both ends of the way, so roots between them are two, on both sides of the vertex of w
        vertex = -w[1] / (2 * w[2]) if w[2] else root
        if (vertex - root) * (vertex - X) < 0 and w(vertex) < 0:
            return None
        with workprec(64):
            return Node(0, root, float(arb(w(root)).sqrt()))

    def late(self) -> fmpq:
        """A time at which X is close to X*, at the present precision. Until then 0.36 of its bits are lost, as X − X* decays."""
        assert self.node is not None
        return fmpq(ctx.prec, 4) / rational(self.node.speed)

    def beyond(self, p: Point, sign: int, since: fmpq, t: fmpq) -> list[arb]:
        """The variables at t, `since` later than at p."""
        assert self.node is not None
        f, root = self.f, arb(self.node.root)
        if self.node.pole:
            root = sign * self.node.pole * arb(self.eps * self.c).sqrt()
        apart, X = p.x - root, p.x.union(root)
        # f/(X − X*)²
        w = f[4] * X * X + (f[3] + 2 * f[4] * root) * X + (f[2] + 2 * f[3] * root + 3 * f[4] * root * root)
        if not (w > 0 and sign * p.y * apart < 0):
            raise Uncertain
        return self.limit(Near(p, X, root, abs(apart).upper(), w.sqrt(), since, t))

    def limit(self, near: Near) -> list[arb]:
        """The variables near the limit. At a pole J+ and x+ vanish; elsewhere x+ turns."""
        frame, X = self.frame_with(ctx.prec), near.X
        across = self.c - X * X / self.eps
        if across.contains(0):
            J = around((horner(self.kinetic.coeffs(), X) - self.M * self.M / self.eps).abs_upper().sqrt())
            x = around(across.abs_upper().sqrt())
            return [*frame.vector(acb(J, J), self.M / frame.length), *frame.vector(acb(x, x), X / frame.length), X]
        turn = near.turn(
            (frame.length * (self.c * self.M), -frame.length * self.l), (arb(self.eps * self.c), arb(0), arb(-1))
        )
        (before,) = near.p.Z
        Z = before / abs(before) * across.sqrt() * turn
        return self.variables(Point(X, around(near.apart * near.speed), (Z,)), near.t)

    # ------------------------------------------------------------------ periods

    def roots(self) -> list[acb]:
        """The roots of f; multiple ones several times."""
        found: Any = self.f.numer().complex_roots()
        return [root for root, order in found for _ in range(order)]

    def turns(self) -> Turns:
        """Where X turns, at the present precision. If it does at the start, the acceleration tells which turn this is."""
        X, still = arb(self.X), self.velocity == 0
        roots = self.roots()
        real = [root.real for root in roots if root.imag.is_zero()]
        others = [root for root in roots if not root.imag.is_zero()]
        here = [root for root in real if root.overlaps(X)]
        if len(here) != still:
            raise Uncertain
        low = max((root for root in real if root < X or (root in here and self.acceleration > 0)), key=float)
        high = min((root for root in real if root > X or (root in here and self.acceleration < 0)), key=float)
        return Turns(low, high, [acb(root) for root in real if root is not low and root is not high] + others)

    def period(self) -> arb | None:
        """The time from one turn of X to the next and back, at the present precision; None if it is infinite or X is constant."""
        return None if self.steady or self.triple or self.node is not None else 2 * self.half_period(self.turns())[0]

    def half_period(self, at: Turns) -> tuple[arb, list[acb]]:
        """R_F and its arguments besides 0."""
        e1, *others = (self.weierstrass(at, root) for root in (acb(at.high), *at.others))
        e2, e3 = [*others, acb(0), acb(0)][:2]
        return acb.elliptic_rf(0, e1 - e2, e1 - e3).real, [e1, e1 - e2, e1 - e3]

    def weierstrass(self, at: Turns, X: acb) -> acb:
        """e(X)."""
        return horner(self.f.derivative().coeffs(), at.low) / 4 / (X - at.low)

    def advance(self, before: list[arb], after: list[arb]) -> tuple[arb, arb]:
        """The angles, mod 2π, of the turns about e and about the body's own axis that a period adds, from variables around it."""
        frame, weights = self.frame_with(ctx.prec), (self.c, above(self.scale) ** 2)
        overlap = acb(0)
        for n, weight in zip((0, 3), weights, strict=True):
            old, new = (frame.across(u[n : n + 3]) for u in (before, after))
            overlap += old.conjugate() * new * weight
        return angle(overlap.real, overlap.imag), arb(0)

    def drifts(self) -> list[Drift]:
        """The turns at a constant rate: of a steady motion, and near the limit on the separatrix."""
        length = arb(self.eps).sqrt()
        if self.steady:
            return [Drift(self.turn_rate() * length, arb(0))]
        if self.node is None or self.node.pole or self.eps * self.c == self.node.root**2:
            return []
        X = self.node.root
        return [Drift(length * (self.c * self.M - self.l * X) / (self.eps * self.c - X * X), arb(0), is_beyond=True)]

    def in_doubles(self, u: Array, left: Array, right: Array) -> Array:
        """States (N, 6) from J and x (N, 6), turned about e = e3."""
        turn, states = unit_turn(left), u.copy()
        for n in (0, 3):
            across = (u[:, n] + 1j * u[:, n + 1]) * turn
            states[:, n], states[:, n + 1] = across.real, across.imag
        return states

    def fastest(self) -> arb:
        """r of the majorant at any time, not only at the start."""
        length, size = arb(self.eps).sqrt(), arb(self.c).sqrt()
        kinetic = self.kinetic[0] + length * size * (abs(arb(2 * self.alpha)) + length * size * abs(arb(self.k)))
        return kinetic.sqrt() + (length * size * (abs(arb(self.alpha)) + length * size * abs(arb(self.k)))).sqrt()

    def nutation(self) -> tuple[float, float]:
        """The period of X and the angle that x sweeps about e in it; if X is constant, of its small oscillations."""
        if self.triple or self.node is not None:
            return math.inf, math.nan
        if not self.steady:
            (period,) = certified(lambda: [cast(arb, self.period()) * self.rate], [fmpq(1, 2**70)], 128)
            (swept,) = certified(lambda: [self.swept()], [fmpq(1, 2**70)], 128)
            with workprec(256):
                return float(period / self.rate), past_poles(swept, 2 - len(self.avoided_poles()))
        square = -self.f.derivative().derivative()(self.X) / 2
        if square <= 0:
            return math.inf, math.nan
        with workprec(128):
            period = 2 * arb.pi() / arb(square).sqrt()
            if (
                self.eps * self.c == self.X**2
            ):  # upright: J+ and x+ have two frequencies, M/2 ± half of the frequency of X
                return float(period), past_poles(self.M / arb(self.eps).sqrt() * period / 2, 1)
            return float(period), float(self.turn_rate() * arb(self.eps).sqrt() * period)

    def real_roots(self) -> list[float]:
        """The roots of f, if all are real."""
        with workprec(128):
            return [float(root.real) for root in self.roots()]

    def swept(self) -> arb:
        """The angle by which x turns about e in a period, without the jumps by ±π at poles."""
        at, length, size = self.turns(), arb(self.eps).sqrt(), arb(self.c).sqrt()
        half, (e1, d2, d3) = self.half_period(at)
        angle = arb(0)
        for sign in self.avoided_poles():
            P = sign * length * size
            e = self.weierstrass(at, acb(P))
            integral = (half + (e * acb.elliptic_rj(0, d2, d3, e1 - e)).real / 3) / abs(P - at.low)
            angle += (self.M * size - sign * length * self.l) * integral
        return angle

    def avoided_poles(self) -> list[int]:
        """The signs of the poles that the axis does not meet; at the others f = 0, and X reaches them."""
        meets = self.c * self.M**2 == self.eps * self.l**2
        pole, at = arb(self.eps * self.c).sqrt(), self.turns()
        met = [sign for sign in (1, -1) if meets and sign * self.M * self.l >= 0]
        return [
            sign for sign in (1, -1) if sign not in met or not (at.low if sign < 0 else at.high).overlaps(sign * pole)
        ]
