"""Sections 5.1 and 5.5: the maps of the top. First what all have in common, each law once; then what each has of its own."""

from functools import partial

import numpy as np
import pytest

from lagrange_bench.integrators import TOPS, prepare, two_point
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import one_point as op
from lagrange_bench.integrators.paper import two_point as tp
from lagrange_bench.integrators.paper.phase_space import invariants
from tests.test_integrators.paper.tools import chart_size, largest, poisson_defect, size

ONE = {f.__name__: f for f in (op.one_point, op.real_form, op.inverse)}
TWO = {f.__name__: f for f in (tp.explicit, tp.real_generators, tp.matrix_form)}


def ends(p, y, sheet):
    return tp.point(p.top, y, p.lam, sheet), tp.point(p.top, y, p.nu, sheet)


def image(name, p, y, sheet=None):
    """The image of y under the map with the parameters λ, ν of the point, μ of the state, on its sheet or another."""
    sheet = sheet or p.sheet
    if name in ONE:
        return ONE[name](p.top, y, p.lam, sheet)
    if name in TWO:
        return TWO[name](p.top, y, *ends(p, y, sheet))
    if name == "pole_free":
        return tp.pole_free(p.top, y, p.lam, p.nu, sheet)
    return op.gauge(y, p.nu)


MAPS = (*ONE, *TWO, "pole_free", "gauge")


def scale_of(name, p, new):
    """Size of the terms of the map from y to `new`."""
    return 10 * chart_size(p.top, p.y, *ends(p, p.y, p.sheet)) if name in (*TWO, "pole_free") else size(new, p.y)


@pytest.mark.parametrize("name", MAPS)
def test_maps_are_poisson_and_keep_the_invariants(p, name):
    """D P Dᵀ = P̃ with λ frozen and μ from the curve at every state: 1e-12 in double, 38 digits in mpmath."""
    new = image(name, p, p.y)
    p.same(invariants(p.top, new), invariants(p.top, p.y), scale_of(name, p, new))
    defect, scale = poisson_defect(partial(image, name, p), p.y)
    assert defect <= p.tol * scale**2 * (chart_size(p.top, p.y, *ends(p, p.y, p.sheet)) if name in TWO else 1)


# -------------------------------------------------------------------------------------------- one-point, section 5.1


def test_quadratic_algebra_of_the_dressing_matrix(p):
    """(5.1.5) with r of (2.6) holds for {p, q} = −i and not for +i."""
    P, q, lam, u, v = p.numbers(5)
    gradient, r = np.array((((q, 1), (0, 0)), ((P, 0), (1, 0)))), lax.r_matrix(u - v)  # of M by p and q, for every u
    Mu, Mv = op.dressing_matrix(P, q, lam, u), op.dressing_matrix(P, q, lam, v)

    def defect(bracket):
        brackets = lax.matrix_brackets(gradient, np.array(((0, bracket), (-bracket, 0))), gradient)
        return lax.quadratic_algebra_defect(brackets, Mu, Mv, r)

    p.same(defect(-1j), np.zeros((4, 4)), largest(r) * largest(Mu) * largest(Mv))
    assert largest(defect(1j)) > 1e-2


# -------------------------------------------------------------------------------------------- two-point, section 5.5


def conjugates(top, y, lam, sheet=1):
    return tp.point(top, y, lam, sheet), tp.point(top, y, lam.conjugate(), sheet)


MORE = {  # of the paper's figures; a double root of Q
    "figure1": [0.02j],
    "figure2": [500 + 5000j],
    "homoclinic": [-0.5 + 1j],
}


@pytest.mark.parametrize("name", TOPS)
def test_the_pole_free_form_is_the_map_that_is_sold(name):
    """All named tops, vertical ones too: real, |w| = Im λ, C1 … J3 to 1e-12."""
    top, y = TOPS[name].top, TOPS[name].state
    rate, length, _ = top.scales(y)
    lams = [(0.2 + 0.3j) * length / rate, 0.05j * length / rate, (-3 + 2j) * length / rate]
    for lam in [*lams, *MORE.get(name, [])]:
        for sheet in (1, -1):
            image = tp.real_form(top, y, lam, sheet)
            assert image.dtype == float
            accuracy = 1e-13 if abs(lam) < 100 else 1e-9  # increments of size λ cancel there; `far_step` has the cure
            assert largest(image - two_point(top, y, lam, sheet)) <= accuracy * largest(y)
            drift = np.abs(np.array(invariants(top, image)) - top.invariants(y)) / top.invariant_scales(y)
            assert largest(drift) <= (1e-12 if abs(lam) < 100 else 1e-9)
            w = tp.axis(top, y, lam, lam.conjugate(), sheet)
            assert abs(np.sqrt(np.sum(w * w)) - lam.imag) <= 1e-13 * abs(lam)
            assert largest(w.imag) <= 1e-14 * lam.imag


def test_the_matrix_form_is_the_papers_program():
    top, y = TOPS["figure1"].top, TOPS["figure1"].state
    lam = 0.1j * top.scales(y)[1] / top.scales(y)[0]
    program = prepare(top, y, 1.0, "backlund_textbook", lam=lam).advance(y, 1)
    assert largest(tp.matrix_form(top, y, *conjugates(top, y, lam)) - program) <= 1e-12 * largest(y)
