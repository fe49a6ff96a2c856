"""The top in a uniform field or in a vertical tide, J' = (alpha + k X) e × x, x' = J × x, X = e·x, as a motion on a curve.

e is any vector that points up, ε = |e|²; for a Lagrange top it is e3, and X = x3. M = e·J, l = x·J, c = |x|² and the energy
2H = |J|² + 2 alpha X + k X² are constant. X' = e·(J × x), and Gram's determinant of e, J and x gives

    X'² = f(X) = (2H − 2 alpha X − k X²)(ε c − X²) − (c M² − 2 l M X + ε l²).

The parts of x and J across e are complex numbers x+ and J+, with

    J+ conj(x+) = l − M X/ε − iX'/√ε        |x+|² = c − X²/ε        x+'/x+ = (i√ε (c M − l X) − X X')/(ε c − X²).

So Z = x+ is as `truth.curve` wants it. Its zeros are X = ±√(ε c), X' = i (ε l − M X)/√ε; its poles are those of X.

**Steady motions.** If X' = X'' = 0, J and x turn about e at the rate ρ|e|, with ρ e × J = (alpha + k X) e × x, ρ rational.

**The separatrix.** If f has a double root X*, and no other root lies between X and X*, then X goes to X* in infinite time, with
f = (X − X*)² w(X) and w > 0; |X − X*| decays like e^(−√w t). So every unit 1/√w of time costs a bit or two. (A triple root is
reached like 1/t².)

**The period.** Let g2 and g3 be the invariants of f, and e1 > e2, e3 the roots of 4 z³ − g2 z − g3; e2 and e3 may be complex.
With `low` and `high`, the roots of f between which X moves, e(X) = f'(low)/(4 (X − low)) + f''(low)/24 is Weierstrass' function
of t, and

    T = 2 R_F(0, e1 − e2, e1 − e3)        ∫ dX/(|P − X| √f) = (R_F + d R_J(0, e1 − e2, e1 − e3, e1 − e(P))/3)/|P − low|

from `low` to `high`, with d = f'(low)/(4 (P − low)). The integrals for the poles P = ±√(ε c) give the angle that x sweeps about e
in a period: its rate is the sum of (M √c ∓ |e| l)/(2 |P − X|). The axis passes through a pole only if its term is 0: so a jump of
the azimuth does not count.

Sources: Whittaker, Analytical Dynamics, sections 71–72; Whittaker & Watson, 20.6; DLMF 19.25.35 and 19.16. All formulas are
derived again, and tested against Taylor series in integers.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar, cast

from flint import acb, arb, ctx, fmpq, fmpq_poly

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.problem.rotation import product
from lagrange_bench.integrators.problem.vectors import cross, dot
from lagrange_bench.integrators.truth.curve import (
    Curve,
    I,
    Point,
    Terms,
    Uncertain,
    Zeros,
    above,
    around,
    certified,
    horner,
    power_above,
    series,
)
from lagrange_bench.integrators.truth.rotations import matrix, square, unit_turn
from lagrange_bench.support.precision import workprec

# The fraction of the longest first step at which the base point lies. Times of users are multiples of powers of two. No such time
# minus this one is a power of two times it, so symmetric motions meet no division by zero.
BASE = fmpq(3, 10)
Rationals = Sequence[fmpq]
Value = TypeVar("Value")
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

    root: fmpq | None  # None if X goes from pole to pole
    speed: float


class Drift(NamedTuple):
    """A turn at a constant rate, about e from the left and about the body's own axis from the right."""

    left: arb
    right: arb
    is_beyond: bool = False  # only near the limit on the separatrix


def angle(c: arb, s: arb) -> arb:
    """The angle of (c, s), away from the cut of the arc tangent."""
    return arb.atan2(-s, -c) + arb.pi() if c < 0 else arb.atan2(s, c)


def roots_of(f: fmpq_poly) -> list[acb]:
    """The roots of a polynomial; multiple ones several times."""
    factors: Any = f.numer().complex_roots()
    return [root for root, order in factors for _ in range(order)]


def at_each_precision(compute: Callable[[Any], Value]) -> Callable[[Any], Value]:
    """A method that computes once at each precision."""

    def cached(self: Any) -> Value:
        key = compute.__name__, ctx.prec
        if key not in self.kept:
            self.kept[key] = compute(self)
        return cast(Value, self.kept[key])

    return cached


class Top:
    """alpha, k and the start (J, x), rational. Its variables u are (J, x, X), its states (J, x); bodies have others.

    start : u at t = 0. rates : the terms of u' = B(u, u) + C u. rate : r of the majorant. columns : the places of the variables
    that `in_doubles` takes.
    """

    columns: Sequence[int] = range(6)

    def __init__(self, alpha: fmpq, k: fmpq, *y0: fmpq, up: Rationals = E3) -> None:
        self.kept: dict[tuple[str, int], Any] = {}
        J, x = y0[:3], y0[3:]
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

    # ------------------------------------------------------------------ at any time, at the present precision

    def at(self, t: fmpq) -> list[arb]:
        """The state at a time."""
        return self.state(self.variables_at(t), t)

    def variables_at(self, t: fmpq) -> list[arb]:
        """u at a time: by Taylor's series if the time is short, else by doublings."""
        if self.steady:
            return self.turned(t)
        since = t - self.base_time()
        if abs(since) <= self.first_step() / 2:
            return self.near(t)
        return self.variables(self.point_since(since), t)

    def point_since(self, since: fmpq) -> Point:
        """The point at a time since the base point."""
        doublings = 0
        while abs(since) > self.first_step() / 2:
            since, doublings = since / 2, doublings + 1
        t = self.base_time() + since
        curve, p = self.curve(), self.point(self.near(t), t)
        for _ in range(doublings):
            p = curve.add(p, p)
        return p

    def grid(self, h: fmpq, count: int) -> list[list[arb]]:
        """u at the times n h since the base point, n = 0, …, count."""
        points = self.curve().multiples(self.point_since(h), count)
        return [self.variables(p, self.base_time() + n * h) for n, p in enumerate(points)]

    def base_time(self) -> fmpq:
        """The time of the base point."""
        return BASE * self.first_step()

    def first_step(self) -> fmpq:
        """The longest time of the series, in powers of two: at more bits shorter, with fewer terms for more doublings."""
        return 1 / (self.rate * 2 ** (6 + ctx.prec // 64))

    def near(self, t: fmpq) -> list[arb]:
        """u at a short time, by Taylor's series and the bound of its rest."""
        rows, theta = self.series(), arb(self.rate * t)
        rest = abs(theta) ** len(rows[0]) / (1 - abs(theta))
        return [horner(row, theta) + around(rest * size) for row, size in zip(rows, self.sizes(), strict=True)]

    @at_each_precision
    def series(self) -> list[list[arb]]:
        """Coefficients of each u in powers of r t; enough terms for the longest first step."""
        terms = ctx.prec // (6 + ctx.prec // 64) + 3
        return series(self.rates, self.start, 1 / arb(self.rate), terms)

    @at_each_precision
    def curve(self) -> Curve:
        """The curve and its base point."""
        base = self.base_time()
        f1, f2, f3, k = (arb(self.f[n]) for n in (1, 2, 3, 4))
        return Curve(f1, f2, f3, k, self.zeros(), self.point(self.near(base), base))

    # ------------------------------------------------------------------ the curve

    def sizes(self) -> list[arb]:
        """Bounds of the norms of all u at t = 0."""
        size, length = arb(self.c).sqrt(), arb(self.eps).sqrt()
        return [arb(self.rate)] * 3 + [size] * 3 + [length * size]

    def radii(self, tolerance: fmpq) -> list[fmpq]:
        """The largest radii of a state."""
        return [tolerance * above(self.scale)] * 3 + [tolerance * above(arb(self.c).sqrt())] * 3

    @at_each_precision
    def frame(self) -> Frame:
        """The shortest turn that takes e to the third axis; if e points down, half a turn after one that takes −e there."""
        length, (x, y, z) = arb(self.eps).sqrt(), self.up
        turn = (
            [length + z, arb(y), arb(-x), arb(0)]
            if z >= 0
            else product((0, 1, 0, 0), [length - z, arb(-y), arb(x), arb(0)])
        )
        size = square(turn).sqrt()
        return Frame(length, [v / size for v in turn], matrix(turn))

    def zeros(self) -> tuple[Zeros, ...]:
        length = arb(self.eps).sqrt()
        return (Zeros(I * (length * self.l), -I * (self.M / length), arb(self.eps * self.c), arb(1)),)

    def point(self, u: list[arb], t: fmpq) -> Point:
        """The point of the curve, from u at the time t."""
        return Point(u[6], dot(self.up, cross(u[:3], u[3:6])), (self.frame().across(u[3:6]),))

    def variables(self, p: Point, t: fmpq) -> list[arb]:
        """u at the time t, from the point there."""
        frame, X, x = self.frame(), p.x, p.Z[0]
        J = x * acb(self.l - self.M * X / self.eps, -p.y / frame.length) / (self.c - X * X / self.eps)
        return [*frame.vector(J, self.M / frame.length), *frame.vector(x, X / frame.length), X]

    def state(self, u: list[arb], t: fmpq) -> list[arb]:
        """The state at the time t, from u."""
        return u[:6]

    # ------------------------------------------------------------------ steady motions

    def turn_rate(self) -> fmpq:
        """ρ of a steady motion: it turns at the rate ρ|e|. 0 if x is vertical, too: sleeping or hanging."""
        J, M, X, eps = self.J, self.M, self.X, self.eps
        if square := dot(J, J) - M * M / eps:
            return self.force * (self.l - M * X / eps) / square
        return M / eps if self.c * eps != X * X else fmpq(0)

    def turned(self, t: fmpq) -> list[arb]:
        """The variables of a steady motion."""
        frame, rate = self.frame(), self.turn_rate()
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
                return Node(None, float(2 * arb(self.k * eps * c).sqrt()))
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
            return Node(root, float(arb(w(root)).sqrt()))

    # ------------------------------------------------------------------ periods

    def period(self) -> arb | None:
        """The time from one turn of X to the next and back, at the present precision; None if it is infinite or X is constant."""
        return None if self.steady or self.triple or self.node is not None else 2 * self.half_period()[0]

    def half_period(self) -> tuple[arb, list[acb]]:
        """R_F, and e1, e1 − e2, e1 − e3."""
        f0, f1, f2, f3, k = (self.f[n] for n in range(5))
        g2 = k * f0 - f1 * f3 / 4 + f2**2 / 12
        g3 = k * f0 * f2 / 6 + f1 * f2 * f3 / 48 - f2**3 / 216 - (k * f1**2 + f0 * f3**2) / 16
        roots = roots_of(fmpq_poly([-g3, -g2, 0, 4]))
        e1 = max((e for e in roots if e.imag.is_zero()), key=lambda e: float(e.real))
        e2, e3 = (e for e in roots if e is not e1)
        return acb.elliptic_rf(0, e1 - e2, e1 - e3).real, [e1, e1 - e2, e1 - e3]

    def advance(self, before: list[arb], after: list[arb]) -> tuple[arb, arb]:
        """The angles, mod 2π, of the turns about e and about the body's own axis that a period adds, from variables around it."""
        frame, weights = self.frame(), (self.c, above(self.scale) ** 2)
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
        X = None if self.node is None else self.node.root
        if X is None or self.eps * self.c == X * X:
            return []
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
                return float(period / self.rate), float(swept)
        square = -self.f.derivative().derivative()(self.X) / 2
        if square <= 0:
            return math.inf, math.nan
        with workprec(128):
            period = 2 * arb.pi() / arb(square).sqrt()
            if self.eps * self.c == self.X**2:  # upright: J+ and x+ have two frequencies, M/2 ± half of that of X
                return float(period), float(self.M / arb(self.eps).sqrt() * period / 2)
            return float(period), float(self.turn_rate() * arb(self.eps).sqrt() * period)

    def swept(self) -> arb:
        """The angle by which x turns about e in a period, without the jumps by ±π at poles."""
        length, size, X = arb(self.eps).sqrt(), arb(self.c).sqrt(), self.curve().base.x
        real = [root.real for root in roots_of(self.f) if root.imag.is_zero()]
        if any(root.overlaps(X) for root in real):
            raise Uncertain
        low = max((root for root in real if root < X), key=float)
        slope, bend = (
            horner(v.coeffs(), low) for v in (self.f.derivative() / 4, self.f.derivative().derivative() / 24)
        )
        half, (e1, d2, d3) = self.half_period()
        angle = arb(0)
        for sign in (1, -1):
            if self.c * self.M**2 == self.eps * self.l**2 and sign * self.M * self.l >= 0:
                continue  # M √c = sign |e| l
            P = sign * length * size
            d = slope / (P - low)
            integral = (half + (d * acb.elliptic_rj(0, d2, d3, e1 - bend - d)).real / 3) / abs(P - low)
            angle += (self.M * size - sign * length * self.l) * integral
        return angle
