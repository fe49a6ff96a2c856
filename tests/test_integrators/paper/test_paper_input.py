"""Bad input of the paper's functions, and points where a formula has no value: one table."""

from dataclasses import replace

import numpy as np
import pytest
from mpmath import mpc, mpf

from lagrange_bench.integrators import TOPS, LagrangeTop
from lagrange_bench.integrators.paper import eulerian, lax
from lagrange_bench.integrators.paper import generating_functions as gf
from lagrange_bench.integrators.paper import interpolating_flow as flow
from lagrange_bench.integrators.paper import one_point as op
from lagrange_bench.integrators.paper import two_point as tp
from lagrange_bench.integrators.paper.contraction import to_magnet
from lagrange_bench.integrators.paper.euler_angles import Weierstrass, angles, states, to_angles
from lagrange_bench.integrators.paper.gaudin_maps import one_point, two_point
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet

STATE, UPRIGHT, FLAT = TOPS["generic"].state, (0.0, 0.0, 3.0, 0.0, 0.0, 1.0), (1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
SLEEPING = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 1.0])
TOP, FREE = TOPS["generic"].top, LagrangeTop(0.0)
ON_CURVE = tp.point(TOP, STATE, 0.5)
ROOT = next(u for u in np.roots(lax.spectral_polynomial(TOP, STATE)[::-1]) if u.imag > 0)

MAPS = [
    ("alpha = 0: the one-point map", lambda: op.one_point(FREE, STATE, 0.3)),
    ("C1 = 0", lambda: tp.real_form(TOP, FLAT, 0.3j)),
    ("sheet must be 1 or -1", lambda: tp.real_form(TOP, STATE, 0.3j, 0)),
    ("to infinity", lambda: op.one_point(TOP, UPRIGHT, 0.7, -1)),
    ("lam must be finite with a positive imaginary part", lambda: tp.real_form(TOP, STATE, -1j)),
    ("lam must be a complex number", lambda: tp.real_form(TOP, STATE, "x")),
    ("λ = 0 is the pole of μ", lambda: tp.point(TOP, STATE, 0)),
    ("X = ∞", lambda: tp.explicit(TOP, STATE, ON_CURVE, (ON_CURVE[0], -ON_CURVE[1]))),
    # a(λ) = (1 + 2λ + 2λ²) e3 vanishes at a root
    ("denominator", lambda: tp.real_form(LagrangeTop(2.0), SLEEPING, -0.5 + 0.5j)),
    ("eps must not be 0", lambda: to_magnet(TOP, STATE, 0.0)),
    ("pole at u = 0", lambda: lax.lax_matrix(TOP, STATE, 0.0)),
    ("on a site", lambda: lax.gaudin_matrix(1.0, (0.0, 0.5), np.ones((2, 3)), 0.5)),
    (r"B\(λ2\) = 0", lambda: flow.limit_parameters(TOP, (0.0, 0.0, 1.0, 0.0, 0.0, 1.0), (0.5j, 1.0))),
    ("positive imaginary part", lambda: flow.time_and_turn(TOP, STATE, 0.1 - 0.3j)),
    ("root of Q lies on the segment", lambda: flow.moments(TOP, STATE, 2 * ROOT)),
]


def chart(side, alpha, lam, c1, first, second):
    """The momenta of a generating function; `first` and `second` are the first of the old and of the new variables."""
    shift = 1.0 if side is gf else 0.0
    return side.momenta(LagrangeTop(alpha), lam, c1, 0.5, (first, shift), (second, shift), 1.0)


CHARTS = [
    *((gf, v) for v in ((1, 0, 1, 1, 1), (1, 1, 1, 0, 1), (0, 1, 1, 1, 1), (1, 1, -1, 1, 1))),
    *((eulerian, v) for v in ((1, 0, 1, 1, 1), (1, -1 / np.sin(1) ** 2, 1, 1, 1))),
]
ANGLES = [
    (r"exact\.solution", lambda: states(TOPS["homoclinic"].top, TOPS["homoclinic"].state, 1.0)),
    ("pole", lambda: angles(TOPS["planar"].top, TOPS["planar"].state, 0.5)),
    ("poles", lambda: to_angles((0.1, 0.2, 0.3, 0.0, 0.0, 1.0))),
    ("digits", lambda: states(TOP, STATE, 1.0, digits=0)),
    ("distinct", lambda: Weierstrass(mpf(12), mpf(8))),
    ("pole", lambda: Weierstrass(mpf(4), mpf(0)).zeta(mpc(0))),
    *(
        ("singular|branch point|no one-point map", lambda side=side, v=v: chart(side, *map(float, v)))
        for side, v in CHARTS
    ),
]

MAGNET = GaudinMagnet((0.0, 1.0), 1.0)
SPINS = np.array(((0.0, 0.6, 0.8), (1.0, 0.0, 0.5)))
STILL = np.array(((0,), (1,)))  # the first spin is zero
MAGNETS = [
    *(("sites", lambda a=a: GaudinMagnet(a)) for a in ((1.0, 2.0, 1.0), (), ("a", 1.0), (0.0, 1j))),
    ("alpha", lambda: GaudinMagnet((1.0,), 1j)),
    *(("spins", lambda s=s: two_point(MAGNET, s, 1j + 1)) for s in (SPINS[:1], SPINS * np.nan, SPINS * STILL)),
    *(("lam", lambda lam=lam: two_point(MAGNET, SPINS, lam)) for lam in (1.5 - 1j, [1j, 2j])),
    ("site", lambda: two_point(MAGNET, SPINS, 1j, site=2)),
    ("sheet", lambda: two_point(MAGNET, SPINS, 1j, sheet=0)),
    ("lam", lambda: one_point(MAGNET, SPINS, 1.0)),
    ("alpha", lambda: one_point(GaudinMagnet((0.0, 1.0), 0.0), SPINS, 2j)),
    ("h must", lambda: MAGNET.exact_step(SPINS, np.inf)),
    ("site", lambda: replace(MAGNET, site=4)),
]


@pytest.mark.parametrize(("words", "call"), [*MAPS, *ANGLES, *MAGNETS])
def test_bad_input(words, call):
    with pytest.raises(ValueError, match=words):
        call()
