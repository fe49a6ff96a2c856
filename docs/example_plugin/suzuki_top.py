"""Suzuki's composition of order four, of an explicit step with a rational rotation: a method of somebody else's package.

One step of order two: half a kick by the weight, J += (h/2) alpha e3 × x; the Cayley rotation about J by about h|J|; half a
kick. Both are exact flows, of alpha x3 and of a function of |J|: the step is a Poisson map, symmetric, and keeps J3, |x|²
and x·J. Five of them, over s h, s h, (1 − 4 s) h, s h, s h with s = 1/(4 − 4^{1/3}), are of order four.

Source: Suzuki, Phys. Lett. A 146 (1990) 319.
"""

import numpy as np

from lagrange_bench import Claims, FixedStepper, Method, StepError, compiled

ALPHA, OUTER, MIDDLE = range(3)  # places of the constants
S = 1 / (4 - 4 ** (1 / 3))


@compiled
def kicked(J1, J2, x1, x2, push):
    return J1 - push * x2, J2 + push * x1


@compiled
def substep(s, alpha, h):
    """Six scalars in, six out: no arrays, no allocation, only + − × ÷."""
    J1, J2, J3, x1, x2, x3 = s
    J1, J2 = kicked(J1, J2, x1, x2, 0.5 * h * alpha)
    v1, v2, v3 = 0.5 * h * J1, 0.5 * h * J2, 0.5 * h * J3
    u1, u2, u3 = v2 * x3 - v3 * x2, v3 * x1 - v1 * x3, v1 * x2 - v2 * x1
    q = 1.0 / (1.0 + ((v1 * v1 + v2 * v2) + v3 * v3))
    d1 = q * (u1 + (v2 * u3 - v3 * u2))  # d = (1 − v×)⁻¹ v×x: x + d is half-way
    d2 = q * (u2 + (v3 * u1 - v1 * u3))
    d3 = q * (u3 + (v1 * u2 - v2 * u1))
    # x + d + v×(x + d), not x + 2d: the rounding of q, the same in every step, would lengthen x steadily
    x1, x2, x3 = (
        (x1 + d1) + (u1 + (v2 * d3 - v3 * d2)),
        (x2 + d2) + (u2 + (v3 * d1 - v1 * d3)),
        (x3 + d3) + (u3 + (v1 * d2 - v2 * d1)),
    )
    J1, J2 = kicked(J1, J2, x1, x2, 0.5 * h * alpha)
    return J1, J2, J3, x1, x2, x3


@compiled
def step(s, c, counters):
    for _ in range(2):
        s = substep(s, c[ALPHA], c[OUTER])
    s = substep(s, c[ALPHA], c[MIDDLE])
    for _ in range(2):
        s = substep(s, c[ALPHA], c[OUTER])
    return s


def prepare(top, y0, h):
    if abs(h) * top.scales(y0)[0] > 100.0:
        raise StepError("suzuki4", "|h| is over 100 time scales: Cayley's turn loses the digits of |x|", h=h)
    return FixedStepper("suzuki4", h, step, np.array((top.alpha, S * h, (1 - 4 * S) * h)))


METHOD = Method(
    name="suzuki4",
    label="Suzuki 4",
    family="splitting",
    order=4,
    claims=Claims(symmetric=True, poisson=True, conserves={"J3", "C1", "C2"}),
    source="Suzuki, Phys. Lett. A 146 (1990) 319",
    prepare=prepare,
)
