"""Section 5.5: the two-point map in all its forms, its factors, reality and singular charts."""

import numpy as np
import pytest
from mpmath import mp, mpc, mpf

from lagrange_bench.integrators import TOPS, LagrangeTop, prepare, two_point
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import one_point as op
from lagrange_bench.integrators.paper import two_point as tp
from lagrange_bench.integrators.paper.phase_space import invariants
from tests.test_integrators.paper.tools import chart_size, largest, poisson_defect

FORMS = (tp.explicit, tp.real_generators, tp.matrix_form)


def step(p, sheets=(1, 1), top=None):
    """Two points of the curve through the state, the image, and the size of the terms."""
    top = top or p.top
    first, second = tp.point(top, p.y, p.lam, sheets[0]), tp.point(top, p.y, p.nu, sheets[1])
    return first, second, tp.explicit(top, p.y, first, second), chart_size(top, p.y, first, second)


def conjugates(top, y, lam, sheet=1):
    return tp.point(top, y, lam, sheet), tp.point(top, y, lam.conjugate(), sheet)


@pytest.mark.parametrize("sheets", [(1, 1), (-1, -1), (1, -1)])
def test_intertwining(p, sheets):
    """(5.5.2)–(5.5.4), (5.5.7): M L = L̃ M, det M = (u − λ1)(u − λ2), μ on both curves."""
    first, second, new, size = step(p, sheets)
    lam1, lam2 = first[0], second[0]
    M = tp.dressing_matrix(*tp.parameters(p.top, p.y, first, second), lam1, lam2, p.u)
    p.same(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0], (p.u - lam1) * (p.u - lam2), size)
    p.same(M @ lax.lax_matrix(p.top, p.y, p.u), lax.lax_matrix(p.top, new, p.u) @ M, 10 * size)
    for lam, mu in (first, second):
        for state in (p.y, new):
            A, B, C = lax.entries(p.top, state, lam)
            p.same(mu * mu, A * A + B * C, 10 * size)


@pytest.mark.parametrize("alpha", ["heavy", 0.0])
def test_every_expression_of_x_and_X(p, alpha):
    """(5.5.5), (5.5.6): from the old state, from the new one, from J+ between and from J-; with (5.5.8)."""
    top = p.top if alpha == "heavy" else LagrangeTop(alpha)
    first, second, new, size = step(p, (1, -1), top)
    x, X = tp.parameters(top, p.y, first, second)
    count = 5 if top.alpha else 4
    p.same(tp.expressions_x(top, p.y, new, first, second), [x] * count, 10 * size)
    p.same(tp.expressions_X(top, p.y, new, first, second), [X] * count, 10 * size)


@pytest.mark.parametrize("alpha", ["heavy", 0.0])
def test_all_forms_are_one_map(p, alpha):
    """(5.5.9), (5.5.10) corrected, the line of the program, the vector w. At alpha = 0 J stays, and factors do not exist."""
    top = p.top if alpha == "heavy" else LagrangeTop(alpha)
    first, second, new, size = step(p, (p.sheet, p.sheet), top)
    for form in FORMS:
        p.same(form(top, p.y, first, second), new, size)
    p.same(tp.pole_free(top, p.y, first[0], second[0], p.sheet), new, size)
    p.same(invariants(top, new), invariants(top, p.y), 10 * size)
    w, gap = tp.axis(top, p.y, first[0], second[0], p.sheet), first[0] - second[0]
    p.same(np.sum(w * w), -gap * gap / 4, 1 + largest(w) ** 2)
    x, X = tp.parameters(top, p.y, first, second)  # M0 = −λ0 + i w·σ
    p.same([1j * w[2], 1j * (w[0] - 1j * w[1])], [x * X - gap / 2, X], size)
    if not top.alpha:
        p.same(new[:3], p.y[:3])
        defect, scale = poisson_defect(lambda z: tp.pole_free(top, z, first[0], second[0], p.sheet), p.y)
        assert defect <= p.tol * scale**2


@pytest.mark.parametrize("sheets", [(1, 1), (-1, 1)])
def test_factorisation(p, sheets):
    """(5.5.1): B_(P1,Q2) = B_Q2 ∘ B_P1, B_Q2 the inverse of the one-point map at (λ2, μ2); in either order."""
    (lam1, mu1), (lam2, mu2), new, size = step(p, sheets)
    middle, other = op.one_point(p.top, p.y, lam1, mu=mu1), op.inverse(p.top, p.y, lam2, mu=mu2)
    p.same(op.inverse(p.top, middle, lam2, mu=mu2), new, size * (1 + largest(middle)) ** 3)
    p.same(op.one_point(p.top, other, lam1, mu=mu1), new, size * (1 + largest(other)) ** 3)


def test_chains(p):
    """B_(P2,Q3) ∘ B_(P1,Q2) = B_(P1,Q3)."""
    one, two, three = p.numbers(3)
    middle = tp.pole_free(p.top, p.y, one, two)
    right = tp.pole_free(p.top, p.y, one, three)
    p.same(tp.pole_free(p.top, middle, two, three), right, 10 * (1 + largest(middle)) ** 5)


# ------------------------------------------------------------------------------------------------ the real map


@pytest.mark.parametrize("name", ["figure1", "generic", "fast", "inverted"])
def test_reality(name):
    """(5.5.11): λ2 = λ̄1 and μ2 = −μ̄1; not μ2 = μ̄1, and not two real λ. It is the inverse after the one-point map."""
    top, y = TOPS[name].top, TOPS[name].state
    unit = top.scales(y)[1] / top.scales(y)[0]
    for lam, sheet in ((0.6j * unit, 1), ((0.4 + 0.3j) * unit, -1)):
        first, second = conjugates(top, y, lam, sheet)
        assert abs(second[1] + first[1].conjugate()) <= 1e-13 * abs(first[1])
        image, expected = tp.explicit(top, y, first, second), two_point(top, y, lam, sheet)
        assert largest(image.imag) <= 1e-12 * largest(y)
        assert largest(image - expected) <= 1e-12 * largest(y)
        with mp.workdps(30):
            z = op.one_point(top, [mpf(v) for v in y], mpc(lam), -sheet)
            composed = op.inverse(top, z, mpc(lam.conjugate()), -sheet).astype(complex)
        assert largest(composed - expected) <= 1e-12 * largest(y)
        wrong = tp.explicit(top, y, first, (lam.conjugate(), first[1].conjugate()))
        two_real = tp.explicit(top, y, tp.point(top, y, 0.3 * unit), tp.point(top, y, -0.2 * unit))
        assert largest(wrong.imag) > 1e-2 * largest(y)
        assert largest(two_real.imag) > 1e-2 * largest(y)


@pytest.mark.parametrize("name", TOPS)
def test_the_pole_free_form_is_the_map_that_is_sold(name):
    """All named tops, vertical ones too, and the λ of the paper's figures: real, |w| = Im λ, C1 … J3 to 1e-12."""
    top, y = TOPS[name].top, TOPS[name].state
    rate, length, _ = top.scales(y)
    lams = [(0.2 + 0.3j) * length / rate, 0.05j * length / rate, (-3 + 2j) * length / rate]
    for lam in [*lams, *({"figure1": [0.02j], "figure2": [500 + 5000j]}.get(name, []))]:
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


@pytest.mark.parametrize(("name", "lam"), [("figure1", 0.02j), ("figure2", 500 + 5000j)])
def test_the_papers_figures_in_many_digits(name, lam):
    """At 40 digits the λ of Figure 2 costs nothing: invariants to 1e-30, and the image is real mpmath numbers."""
    with mp.workdps(40):
        top, y = TOPS[name].top, np.array([mpf(v) for v in TOPS[name].y0])
        image = tp.real_form(top, y, mpc(lam))
        assert all(isinstance(v, mpf) for v in image)
        assert largest(np.array(invariants(top, image)) - np.array(invariants(top, y))) <= mpf("1e-30")
        assert largest(image.astype(float) - two_point(TOPS[name].top, TOPS[name].state, lam)) <= 1e-13


def test_the_matrix_form_is_the_papers_program():
    top, y = TOPS["figure1"].top, TOPS["figure1"].state
    lam = 0.1j * top.scales(y)[1] / top.scales(y)[0]
    program = prepare(top, y, 1.0, "backlund_textbook", lam=lam).advance(y, 1)
    assert largest(tp.matrix_form(top, y, *conjugates(top, y, lam)) - program) <= 1e-12 * largest(y)


def test_a_singular_chart_is_not_a_singular_map():
    """B(λ1) = 0 exactly: the paper's formulas stop there, and lose digits nearby; w does neither."""
    top, lam = LagrangeTop(1.0), 0.5j
    xm = -lam * (1 - 2j)
    y = np.array([1.0, 2.0, 0.75, xm.real, -xm.imag, 0.3])
    assert lax.entries(top, y, lam)[1] == 0
    for form in FORMS:
        with pytest.raises(ValueError, match=r"B\(λ1\) = 0: the chart"):
            form(top, y, *conjugates(top, y, lam))
    image = tp.real_form(top, y, lam)
    assert largest(np.array(invariants(top, image)) - top.invariants(y)) <= 1e-13
    near = y + 1e-9
    truth = tp.real_form(top, near, lam)
    assert largest(truth - image) < 1e-7
    lost = tp.explicit(top, near, *conjugates(top, near, lam))
    assert largest(lost - truth) > 1e-11  # 1e-16/|B|²: four digits and more of the sixteen


@pytest.mark.parametrize("name", TOPS)
def test_the_real_map_is_poisson(name):
    """At the named tops, figures included: the defect is round-off, measured below 1e-13 of |D|²."""
    top, y = TOPS[name].top, TOPS[name].state
    unit = top.scales(y)[1] / top.scales(y)[0]
    for lam in (0.3j * unit, (0.4 + 0.2j) * unit):
        defect, scale = poisson_defect(lambda z, lam=lam: tp.real_form(top, z, lam), y)
        assert defect <= 1e-12 * scale**2
