"""The schemes of the splitting with the exact step inside, and their correctors: numbers only, for h = 1.

`backlund_splitting` says what each scheme is for, docs/perturbed.md derives them. A is the exact flow of the top, B a kick by V.
A processed scheme kicks by b_i h V − c_i h³ W + d_i h⁵ Z, where N = x × ∇V, W = |N|² and Z = ∇W·(N × x). Its corrector has two
parts: the kicks of `corrector_kicks`, and exp(second h⁴ [B,[A,[A,B]]]) as a composition of kicks.
"""

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.methods.splitting_schemes import Scheme, palindrome
from lagrange_bench.support.precision import workdps

# processed6. V has a frequency ω along the motion, w = ωh, and the kicks are at −τ and τ, in this order. The part of second
# order in ε is right for long times if sin(2τw)/4 + cos²(τw) cot(w/2)/2 + γw = 1/w. The terms in w give γ = 1/12 + τ² − τ/2,
# those in w³ (τ² − τ/2)² = 1/240. We take τ < 0: the flow between the kicks goes back. The other solution, τ > 1/2, is the
# same kernel. DELTA and SECOND_ORDER reduce the errors at h⁵, of order ε³ and at the ends: see docs/perturbed.md, section 5.
TAU = 0.25 * (1.0 - math.sqrt(1.0 + 16.0 / math.sqrt(240.0)))
GAMMA = 1.0 / 12.0 + 1.0 / math.sqrt(240.0)
DELTA = 0.00546734954597738
SECOND_ORDER = -0.00180092478026637

SCHEMES = {
    "strang": Scheme(4, "A", (0.5, 0.5), (1.0,), "Strang, SIAM J. Numer. Anal. 5 (1968) 506", c=(1 / 24,)),
    "processed6": Scheme(
        6, "A", (0.5 - TAU, 2.0 * TAU, 0.5 - TAU), (0.5, 0.5), "this project", c=(GAMMA / 4, GAMMA / 4),
        d=(DELTA / 2, DELTA / 2), second=SECOND_ORDER,
    ),
    "aba864": Scheme(
        6, "A",
        palindrome((0.0711334264982231177779387300061549964174, 0.241153427956640098736487795326289649618,
                    0.521411761772814789212136078067994229991), 8),
        palindrome((0.183083687472197221961703757166430291072, 0.310782859898574869507522291054262796375,
                    -0.0265646185119588006972121379164987592663), 7),
        "Blanes, Casas, Farrés, Laskar, Makazaga and Murua, Appl. Numer. Math. 68 (2013) 58",
    ),
}  # fmt: skip

PROCESSED = tuple(name for name, scheme in SCHEMES.items() if scheme.c)


# ------------------------------------------------------------------------------------ correctors

SPACING = 0.4  # distance of the corrector's kicks, in h
NODES = 10  # kicks of the corrector on each side
WIDEST = 4.0  # largest |ωh| of the fit
LEAP = 2.0  # longest flow between two kicks, in h
SECOND_REACH = 0.5  # distance, in h, of the kicks whose commutators make the part of second order


@cache
def corrector_kicks(scheme: Scheme) -> tuple[float, ...]:
    """The kicks b_j at ±j SPACING, least squares with the weight exp(−3w)/w on 0 < w < WIDEST, in forty digits:

        Σ_j 2 b_j sin(j w SPACING) ≈ Σ_i b_i cos(w t_i)/(2 sin(w/2)) − 1/w

    The t_i are the times of the scheme's kicks b_i, from the middle of the step.
    """
    import mpmath

    times = [math.fsum(scheme.a[: i + 1]) - 0.5 for i in range(len(scheme.b))]
    with workdps(40):
        points = [WIDEST * (k + mpmath.mpf(1) / 2) / 400 for k in range(400)]
        A, rhs = mpmath.matrix(len(points), NODES), mpmath.matrix(len(points), 1)
        for i, w in enumerate(points):
            weight = mpmath.exp(-3 * w) / w
            kicks = mpmath.fsum(b * mpmath.cos(w * t) for b, t in zip(scheme.b, times, strict=True))
            rhs[i] = weight * (kicks / (2 * mpmath.sin(w / 2)) - 1 / w)
            for j in range(NODES):
                A[i, j] = weight * 2 * mpmath.sin(mpmath.mpf(SPACING) * (j + 1) * w)
        return tuple(map(float, mpmath.lu_solve(A.T * A, A.T * rhs)))


def _corrector(scheme: Scheme, b: Sequence[float], spacing: float) -> list[tuple[float, float]]:
    """The corrector as (flow, kick) pairs, for h = 1: half of each kick in the order of the times, then half backwards.

    So the commutators of two kicks, of size ε²h³, cancel. The part of second order is made of commutators of kicks, once with
    each sign of the kicks: so the terms of order ε³ cancel.
    """
    numbered_kicks = list(enumerate(b, 1))
    half = [(side * spacing * j, side * 0.5 * kick) for side in (-1, 1) for j, kick in numbered_kicks[::side]]
    kicks = [*half, *reversed(half)]
    if scheme.second:
        reach, a = SECOND_REACH, math.sqrt(0.5 * abs(scheme.second)) / SECOND_REACH
        for u, v in ((a, math.copysign(a, scheme.second)), (-a, -math.copysign(a, scheme.second))):
            kicks += [(0.0, u), (reach, v), (-reach, v), (0.0, -u), (-reach, -v), (reach, -v)]
    groups: list[tuple[float, float]] = []
    t = 0.0
    for time, kick in (*kicks, (0.0, 0.0)):
        flows = math.ceil(abs(time - t) / LEAP)  # a long flow takes the slow route to its λ
        if flows == 0 and groups:
            groups[-1] = (groups[-1][0], groups[-1][1] + kick)
        else:
            flow = (time - t) / max(flows, 1)
            groups += [*[(flow, 0.0)] * (flows - 1), (flow, kick)]
        t = time
    return groups


@cache
def _ends(scheme: Scheme, has_corrector: bool, sign: float) -> tuple[Array, ...]:
    """The result of `ends_of` for |h| = 1."""
    corrector = _corrector(scheme, corrector_kicks(scheme), SPACING) if has_corrector else ()
    exit_groups = [(scheme.a[0] * sign, 0.0), *corrector]
    entry_groups, flow = [], 0.0
    for time, kick in reversed(exit_groups):
        entry_groups.append((flow, -kick))
        flow = -time
    ends = [np.pad(groups, ((0, 0), (0, 3))) for groups in ([*entry_groups, (flow, 0.0)], exit_groups)]
    for groups, start in zip(ends, (0.0, -scheme.a[0] * sign), strict=True):
        groups[:, 4] = start + groups[:, 0].cumsum()
    return tuple(ends)


def ends_of(scheme: Scheme, h: float, has_corrector: bool) -> tuple[Array, ...]:
    """The flows and kicks by which a state enters a run, and those by which it leaves: inverse maps of each other.

    A row holds the time of a flow, the factors of V, W and Z in the kick after it, and the time of the kick.
    """
    return tuple(abs(h) * end for end in _ends(scheme, has_corrector, math.copysign(1.0, h)))
