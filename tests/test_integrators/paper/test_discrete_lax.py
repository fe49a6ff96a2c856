"""The discrete Lax pair of Bobenko and Suris: L̃ = M L M⁻¹, its curve and clock, and that Kahan's map has it too."""

import math

import numpy as np
import pytest

from lagrange_bench.integrators import TOPS, LagrangeTop, prepare
from lagrange_bench.integrators.paper import discrete_lax, lax
from lagrange_bench.integrators.paper.two_point import pole_free
from lagrange_bench.integrators.truth import exact
from tests.reference import turned
from tests.test_integrators.paper.tools import largest


def steps(method="bobenko_suris", lengths=(0.1, 1.0, 3.0)):
    """Random tops, states and steps, and the images under the method the benchmark has."""
    rng = np.random.default_rng(14)
    for h in lengths * 2:
        top, y = LagrangeTop(float(rng.uniform(-2, 2))), rng.normal(size=6)
        yield top, y, h, prepare(top, y, h, method).advance(y, 1)


@pytest.mark.parametrize("u", [0.7, -0.4 + 0.9j])
def test_the_pair_conjugates(u):
    for top, y, h, image in steps():
        M, L, new = discrete_lax.dressing(y, h, u), *(discrete_lax.lax_matrix(top, z, h, u) for z in (y, image))
        assert largest(M @ L - new @ M) < 1e-12 * (1 + largest(L))
        plain = [lax.lax_matrix(top, z, u) for z in (y, image)]  # without the deformation it does not
        assert largest(M @ plain[0] - plain[1] @ M) > 1e-5
    gaps = [largest(discrete_lax.lax_matrix(top, y, h, u) - lax.lax_matrix(top, y, u)) for h in (1e-2, 1e-3, 1e-4)]
    assert np.log10(gaps[:-1]) - np.log10(gaps[1:]) == pytest.approx(1.0, abs=0.01)  # it goes to zero with the step


def test_it_is_the_two_point_map_of_the_deformed_state():
    for top, y, h, image in steps():
        z, new, (lam, m) = *(discrete_lax.deformed(top, s, h) for s in (y, image)), discrete_lax.curve_point(y, h)
        assert abs(sum(q * lam**k for k, q in enumerate(lax.spectral_polynomial(top, z))) - m * m) < 1e-12 * abs(m) ** 2
        for sign, right in ((1, True), (-1, False)):
            step = pole_free(top, z + 0j, lam, lam.conjugate(), m=(sign * m, (sign * m).conjugate()))
            assert (largest(step - new) < 1e-12 * (1 + largest(new))) == right


@pytest.mark.parametrize("method", ["bobenko_suris", "kahan"])
def test_the_clock_of_a_thousand_steps(method):
    """n steps are the flow of the deformed state over nT, then turned by nΘ; not over the nominal time nh."""
    top, y, h, n = TOPS["generic"].top, TOPS["generic"].state, 0.25, 1000
    end = prepare(top, y, h, method).advance(y, n)
    (z, step), (end, _) = [discrete_lax.of_kahan(top, s, h) if method == "kahan" else (s, h) for s in (y, end)]
    T, turn = discrete_lax.clock(top, z, step)
    start, end = (discrete_lax.deformed(top, s, step) for s in (z, end))
    for time, right in ((T, True), (h, False)):
        moved = exact.solution(top, start, [n * time])[0]
        angle = math.fmod(n * turn, 2 * math.pi)
        error = largest(np.array(turned(math.cos(angle), math.sin(angle), moved)) - end)
        assert error < 1e-10 if right else error > 0.1


def test_kahan_is_bobenko_and_suris_elsewhere():
    for top, y, h, image in steps("kahan", (0.2, 0.4, 0.6)):
        z, step = discrete_lax.of_kahan(top, y, h)
        new, same = discrete_lax.of_kahan(top, image, h)
        assert step == pytest.approx(same, rel=1e-12)
        assert step > h
        assert largest(prepare(top, z, step, "bobenko_suris").advance(z, 1) - new) < 1e-12
        assert largest(prepare(top, z, h, "bobenko_suris").advance(z, 1) - new) > 1e-7
