"""The exact flow of |J|²/2, compiled: the axis x turns about the constant J at the rate |J|.

With v = (t/2) J, z = |v|² and u = v×x, p = v×u, r = v×p, the rotation by 2|v| is

    x + 2u + 2p + r + a(z) u + b(z) p,    a = sin(2√z)/√z − 2 + z,   b = (1 − cos 2√z)/z − 2,

where r replaces −zu. Part of the error of z is the same in every step, because v3² is rounded the same way. With r, only the
angle feels this error, and the length of x is kept to higher order. a and b are small, of order z, and so are their errors.
Beyond 2|v| = 1 the turn is made in 2, 4, 8, … equal parts. No library function is called: the bits are the same everywhere.

Source: this project.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.unroll import unrolled
from lagrange_bench.integrators.methods.runge_kutta import carrying_sums
from lagrange_bench.integrators.problem.vectors import cross

PART = 0.25  # largest z = (angle/2)² of one part: an angle of 1
MOST = 128.0**2  # largest z of a turn: an angle of 256


@jit(inline=True)
def small_coefficients(z):
    """a/z and b/z of the rotation, 0 <= z <= 1/4; a and b to 3e-19.

    Least squares, with one coefficient rounded after the other, so that the later ones mend the rounding of the earlier. The
    rounded polynomials keep |x|² to 2e-19.
    """
    z2 = z * z
    z4 = z2 * z2
    a = (-0.3333333333333333 + 0.2666666666666631 * z) + z2 * (-0.025396825396671374 + 0.001410934741425644 * z)
    b = (-0.6666666666666666 + 0.08888888888888634 * z) + z2 * (-0.006349206349141372 + 0.00028218694802735093 * z)
    a += z4 * ((-5.1306691152203537e-05 + 1.315420958644531e-06 * z) - 2.470580985210812e-08 * z2)
    b += z4 * ((-8.55111385492195e-06 + 1.8791375066112914e-07 * z) - 3.08449838086915e-09 * z2)
    return a, b


@unrolled
def turn(x, v, a, b, z):
    """Change of x by the rotation about v, |v|² = z; a and b stand for a/z and b/z."""
    u = cross(v, x)
    p = cross(v, u)
    parts = zip(u, p, cross(v, p), strict=True)
    return tuple((2.0 * (u + p) + r) + (a * (z * u) + b * (z * p)) for u, p, r in parts)


@cache
def adding(compensated: bool) -> Any:
    """(x, change, lost) → x + change, and what the sums lose. Compensated sums add to each change what the last one lost."""

    @unrolled
    def plain(x, change, lost):
        return tuple(a + d for a, d in zip(x, change, strict=True)), lost

    return carrying_sums if compensated else plain


@cache
def rotation(compensated: bool) -> Any:
    """(part, J, x, lost) → whether it is done (False: too far), x turned about v = part·J, |v| half the angle, and `lost`."""
    add = adding(compensated)

    @jit(inline=True)
    def rotate(part, J, x, lost):
        v = part * J[0], part * J[1], part * J[2]
        z = (v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]
        parts = 1
        if z > PART:
            if not z <= MOST:
                return False, x, lost
            while z > PART:
                v, z, parts = (0.5 * v[0], 0.5 * v[1], 0.5 * v[2]), 0.25 * z, 2 * parts
        a, b = small_coefficients(z)
        x, lost = add(x, turn(x, v, a, b, z), lost)
        for _ in range(1, parts):
            x, lost = add(x, turn(x, v, a, b, z), lost)
        return True, x, lost

    return rotate
