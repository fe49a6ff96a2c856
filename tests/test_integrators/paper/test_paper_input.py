"""Bad input of the paper's functions, and points where a formula has no value: one table."""

import numpy as np
import pytest

from lagrange_bench.integrators import TOPS, LagrangeTop
from lagrange_bench.integrators.paper import interpolating_flow as flow
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import one_point as op
from lagrange_bench.integrators.paper import two_point as tp
from lagrange_bench.integrators.paper.euler_angles import angles, states, to_angles
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
    ("lam must be finite with a positive imaginary part", lambda: tp.real_form(TOP, STATE, -1j)),
    ("λ = 0 is the pole of μ", lambda: tp.point(TOP, STATE, 0)),
    ("X = ∞", lambda: tp.explicit(TOP, STATE, ON_CURVE, (ON_CURVE[0], -ON_CURVE[1]))),
    # a(λ) = (1 + 2λ + 2λ²) e3 vanishes at a root
    ("denominator", lambda: tp.real_form(LagrangeTop(2.0), SLEEPING, -0.5 + 0.5j)),
    ("on a site", lambda: lax.gaudin_matrix(1.0, (0.0, 0.5), np.ones((2, 3)), 0.5)),
    (r"B\(λ2\) = 0", lambda: flow.limit_parameters(TOP, (0.0, 0.0, 1.0, 0.0, 0.0, 1.0), (0.5j, 1.0))),
    ("root of Q lies on the segment", lambda: flow.moments(TOP, STATE, 2 * ROOT)),
]


ANGLES = [
    (r"exact\.solution", lambda: states(TOPS["homoclinic"].top, TOPS["homoclinic"].state, 1.0)),
    ("pole", lambda: angles(TOPS["planar"].top, TOPS["planar"].state, 0.5)),
    ("poles", lambda: to_angles((0.1, 0.2, 0.3, 0.0, 0.0, 1.0))),
]

MAGNET = GaudinMagnet((0.0, 1.0), 1.0)
SPINS = np.array(((0.0, 0.6, 0.8), (1.0, 0.0, 0.5)))
STILL = np.array(((0,), (1,)))  # the first spin is zero
MAGNETS = [
    *(("sites", lambda a=a: GaudinMagnet(a)) for a in ((1.0, 2.0, 1.0), (), ("a", 1.0), (0.0, 1j))),
    *(("spins", lambda s=s: two_point(MAGNET, s, 1j + 1)) for s in (SPINS[:1], SPINS * np.nan, SPINS * STILL)),
    *(("lam", lambda lam=lam: two_point(MAGNET, SPINS, lam)) for lam in (1.5 - 1j, [1j, 2j])),
    ("alpha", lambda: one_point(GaudinMagnet((0.0, 1.0), 0.0), SPINS, 2j)),
    ("h must", lambda: MAGNET.exact_step(SPINS, np.inf)),
]


@pytest.mark.parametrize(("words", "call"), [*MAPS, *ANGLES, *MAGNETS])
def test_bad_input(words, call):
    with pytest.raises(ValueError, match=words):
        call()
