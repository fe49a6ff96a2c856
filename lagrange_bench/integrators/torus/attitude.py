"""The exact attitude of the frame that turns with J, one Bäcklund step at a time.

Let g be the unit quaternion of the frame with angular velocity J, g' = J g/2. Over one step with (λ, m), T = h, Θ = 0,

    g̃ = q · rot(x/|x|, χ) · g        q = (−Re λ, −w)/|λ|

The angle χ depends only on the torus. For small h it comes from the power series of
χ = −2 √C1 Im ∫_0^λ (1/√Q − 1/√C1) du/u − 2 arg λ. When the time is doubled (see `time_step`), χ is doubled up to the angle of
the complex number A(0) − i√C1, with A the interpolating cubic:

    exp(iχ'/2) = exp(iχ/2)² (A(0) − i√C1)/|A(0) − i√C1|

The reason: the third dressing matrix M(0), which replaces two, differs from their product by the value of
A − i√Q · L(0)/√C1 at 0.
"""

from __future__ import annotations

import math

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import add, cmul, dd, div, mul, neg, small_turn, sqrt, sub
from lagrange_bench.integrators.problem.rotation import quaternion_product
from lagrange_bench.integrators.torus import time_step as ts


@jit
def unit(z):
    """A complex double-double, scaled to length one."""
    n = sqrt(add(mul(z[0], z[0]), mul(z[1], z[1])))
    return div(z[0], n), div(z[1], n)


@jit
def doubled_spin(q, lam, m, spin):
    """exp(iχ/2) for twice the time, from λ, m and exp(iχ/2)."""
    R, eta = lam
    a1, b0, b1 = ts.cubic(q, lam, m)
    norm = add(mul(R, R), mul(eta, eta))
    at_zero = sub(mul(sub(b0, mul(b1, R)), norm), add(m[1], mul(a1, R)))
    return cmul(cmul(spin, spin), unit((at_zero, neg(sqrt(q[0])))))


@jit
def first_spin(q, lam):
    """exp(iχ/2) for a small time, from its power series: −√C1 Im Σ_{k>0} g_k λ^k/k is small, −arg λ is exact."""
    g = ts.series(q)
    s = (dd(0.0), dd(0.0))
    for k in range(len(g) - 1, 0, -1):
        term = (div((g[k, 0], g[k, 1]), dd(float(k))), dd(0.0))
        s = cmul((add(s[0], term[0]), s[1]), lam)
    c, d = small_turn(neg(mul(sqrt(q[0]), s[1])), len(g) + 3)
    direction = unit(lam)
    return cmul((neg(c), neg(d)), (direction[0], neg(direction[1])))  # with this sign g → +1 for h → 0


@jit
def spin_parameter(q, h):
    """(λ, m, exp(iχ/2)) of the exact step over 0 < h < nutation period."""
    h, doublings = ts.halved(q, h)
    lam, m = ts.start(q, h)
    spin = first_spin(q, lam)
    for _ in range(doublings):
        spin = doubled_spin(q, lam, m, spin)
        lam, m = ts.double_time(q, lam, m)
    return lam, m, spin


@jit
def step_spin(alpha, y, h):
    """exp(iχ/2) as doubles (cos, sin), for the exact step over h on the torus of y; |h| is below the nutation period."""
    spin = spin_parameter(ts.spectral_polynomial(alpha, y), dd(abs(h)))[2]
    return spin[0][0], spin[1][0] if h > 0.0 else -spin[1][0]


@jit
def turn_with(g, x, R, w, spin):
    """g after one step: a turn about x by χ, then q = (−R, −w)/|λ|."""
    x1, x2, x3 = x
    w1, w2, w3 = w
    c, s = spin
    s /= math.sqrt(x1 * x1 + x2 * x2 + x3 * x3)
    g = quaternion_product((-R, -w1, -w2, -w3), quaternion_product((c, s * x1, s * x2, s * x3), g))
    n = 1.0 / math.sqrt((g[0] * g[0] + g[1] * g[1]) + (g[2] * g[2] + g[3] * g[3]))
    return g[0] * n, g[1] * n, g[2] * n, g[3] * n
