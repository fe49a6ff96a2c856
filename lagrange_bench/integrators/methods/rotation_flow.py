"""The exact flow of |J|²/2, compiled: the axis x turns about the constant J at the rate |J|.

With v = (t/2) J, z = |v|² and u = v×x, p = v×u, r = v×p, the rotation by 2|v| is

    x + 2u + 2p + r + a(z) u + b(z) p,    a = sin(2√z)/√z − 2 + z,   b = (1 − cos 2√z)/z − 2,

where r replaces −zu. Part of the error of z is the same in every step, because v3² is rounded the same way. With r, only the
angle feels this error, and the length of x is kept to higher order. a and b are small, of order z, and so are their errors.
Beyond 2|v| = 1 the turn is made in 2, 4, 8, … equal parts. No library function is called: the bits are the same everywhere.

Source: this project.
"""

from __future__ import annotations

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import two_sum

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


@jit(inline=True)
def turn(x1, x2, x3, v1, v2, v3, a, b, z):
    """Change of x by the rotation about v, |v|² = z; a and b stand for a/z and b/z."""
    u1, u2, u3 = v2 * x3 - v3 * x2, v3 * x1 - v1 * x3, v1 * x2 - v2 * x1
    p1, p2, p3 = v2 * u3 - v3 * u2, v3 * u1 - v1 * u3, v1 * u2 - v2 * u1
    r1, r2, r3 = v2 * p3 - v3 * p2, v3 * p1 - v1 * p3, v1 * p2 - v2 * p1
    return (
        (2.0 * (u1 + p1) + r1) + (a * (z * u1) + b * (z * p1)),
        (2.0 * (u2 + p2) + r2) + (a * (z * u2) + b * (z * p2)),
        (2.0 * (u3 + p3) + r3) + (a * (z * u3) + b * (z * p3)),
    )


@jit(inline=True)
def add(x, lost, change, compensated):
    """x + (change + what the last sum lost), and what this sum loses."""
    return two_sum(x, change + lost) if compensated else (x + change, lost)


@jit(inline=True)
def rotate(part, J1, J2, J3, x1, x2, x3, l1, l2, l3, compensated):
    """Turn x about v = part·J, |v| half the angle. Returns whether it is done (False: too far), x, and what its sums lose."""
    v1, v2, v3 = part * J1, part * J2, part * J3
    z = (v1 * v1 + v2 * v2) + v3 * v3
    parts = 1
    if z > PART:
        if not z <= MOST:
            return False, x1, x2, x3, l1, l2, l3
        while z > PART:
            v1, v2, v3, z, parts = 0.5 * v1, 0.5 * v2, 0.5 * v3, 0.25 * z, 2 * parts
    a, b = small_coefficients(z)
    d1, d2, d3 = turn(x1, x2, x3, v1, v2, v3, a, b, z)
    x1, l1 = add(x1, l1, d1, compensated)
    x2, l2 = add(x2, l2, d2, compensated)
    x3, l3 = add(x3, l3, d3, compensated)
    for _ in range(1, parts):
        d1, d2, d3 = turn(x1, x2, x3, v1, v2, v3, a, b, z)
        x1, l1 = add(x1, l1, d1, compensated)
        x2, l2 = add(x2, l2, d2, compensated)
        x3, l3 = add(x3, l3, d3, compensated)
    return True, x1, x2, x3, l1, l2, l3
