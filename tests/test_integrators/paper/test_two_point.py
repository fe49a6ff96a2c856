"""Section 5.5: the two-point map in all its forms, its factors, inverse, reality, singular charts, Poisson property."""

from functools import partial

import numpy as np
import pytest
from mpmath import mp, mpc, mpf

from lagrange_bench.integrators import TOPS, LagrangeTop, prepare, two_point
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import one_point as op
from lagrange_bench.integrators.paper import two_point as tp
from lagrange_bench.integrators.paper.phase_space import components, invariants, ladder, poisson_tensor
from tests.test_integrators.paper.tools import DIGITS, jacobian, largest, points, poisson_defect

both = pytest.mark.parametrize("digits", DIGITS)
sheets = pytest.mark.parametrize("sheet", [1, -1])
REAL_TOPS = [name for name in TOPS if name not in ("sleeping_stable", "sleeping_unstable", "hanging")]


def curve_points(p, y, top, sheet=1, other=None):
    """Two random points of the curve, of one sheet or of two."""
    return tp.point(top, y, p.number(), sheet), tp.point(top, y, p.number(), other or sheet)


def size(top, y, first, second):
    """Size of the terms of the map, which are of degree six in x and X."""
    x, X = tp.parameters(top, y, first, second)
    return (1 + abs(x)) ** 3 * (1 + abs(X)) ** 2 * (1 + largest(y)) ** 2


# ------------------------------------------------------------------------------------------- equations of 5.5


@both
@pytest.mark.parametrize("both_sheets", [(1, 1), (-1, -1), (1, -1)])
def test_intertwining(digits, both_sheets):
    """(5.5.2)–(5.5.4), (5.5.7): M L = L̃ M, det M = (u − λ1)(u − λ2), μ on both curves, invariants."""
    for p in points(digits):
        y, u, top = p.state(), 2 * p.number(), p.top
        first, second = curve_points(p, y, top, *both_sheets)
        new, scale = tp.explicit(top, y, first, second), size(top, y, first, second)
        M = tp.dressing_matrix(*tp.parameters(top, y, first, second), first[0], second[0], u)
        p.same(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0], (u - first[0]) * (u - second[0]), scale)
        p.same(M @ lax.lax_matrix(top, y, u), lax.lax_matrix(top, new, u) @ M, 10 * scale)
        p.same(invariants(top, new), invariants(top, y), 10 * scale)
        for lam, mu in (first, second):
            for state in (y, new):
                A, B, C = lax.entries(top, state, lam)
                p.same(mu * mu, A * A + B * C, 10 * scale)


@both
def test_every_expression_of_x_and_X(digits):
    """(5.5.5), (5.5.6): from the old state, from the new one, from J+ between and from J-; with (5.5.8)."""
    for p in points(digits):
        y, top = p.state(), p.top
        first, second = curve_points(p, y, top, 1, -1)
        new, scale = tp.explicit(top, y, first, second), size(top, y, first, second)
        x, X = tp.parameters(top, y, first, second)
        xs, Xs = tp.expressions_x(top, y, new, first, second), tp.expressions_X(top, y, new, first, second)
        assert len(xs) == len(Xs) == 5
        p.same(xs, [x] * 5, 10 * scale)
        p.same(Xs, [X] * 5, 10 * scale)


@both
@sheets
def test_all_forms_are_one_map(digits, sheet):
    """(5.5.9), (5.5.10) [145–150] corrected, the line of the program, the vector w; the printed ones miss."""
    for p in points(digits):
        y, top = p.state(), p.top
        first, second = curve_points(p, y, top, sheet)
        new, scale = tp.explicit(top, y, first, second), size(top, y, first, second)
        p.same(tp.real_generators(top, y, first, second), new, scale)
        p.same(tp.matrix_form(top, y, first, second), new, scale)
        p.same(tp.pole_free(top, y, first[0], second[0], sheet), new, scale)
        w, gap = tp.axis(top, y, first[0], second[0], sheet), first[0] - second[0]
        p.same(np.sum(w * w), -gap * gap / 4, 1 + largest(w) ** 2)
        x, X = tp.parameters(top, y, first, second)  # M0 = −λ0 + i w·σ
        p.same([1j * w[2], 1j * (w[0] - 1j * w[1])], [x * X - gap / 2, X], scale)
        ladders, reals = tp._as_printed(top, y, first, second)
        right = dict(zip(tp.LADDER, ladder(new), strict=True))
        assert min(abs(value - right[name]) for name, value in ladders.items()) > 1e-4
        right = dict(zip(tp.REAL, components(new), strict=True))
        assert min(abs(value - right[name]) for name, value in reals.items()) > 1e-4


@both
@pytest.mark.parametrize("both_sheets", [(1, 1), (-1, 1)])
def test_factorisation(digits, both_sheets):
    """(5.5.1): B_(P1,Q2) = B_Q2 ∘ B_P1, B_Q2 the inverse of the one-point map at (λ2, μ2); in either order."""
    for p in points(digits):
        y, top = p.state(), p.top
        (lam1, mu1), (lam2, mu2) = first, second = curve_points(p, y, top, *both_sheets)
        new, scale = tp.explicit(top, y, first, second), size(top, y, first, second)
        middle, other = op.one_point(top, y, lam1, mu=mu1), op.inverse(top, y, lam2, mu=mu2)
        p.same(op.inverse(top, middle, lam2, mu=mu2), new, scale * (1 + largest(middle)) ** 3)
        p.same(op.one_point(top, other, lam1, mu=mu1), new, scale * (1 + largest(other)) ** 3)


@both
@sheets
def test_inverse(digits, sheet):
    """The points exchanged, or both μ negated, or w of the other sheet; equal points give the identity."""
    for p in points(digits):
        y, top = p.state(), p.top
        first, second = curve_points(p, y, top, sheet)
        new, scale = tp.explicit(top, y, first, second), size(top, y, first, second)
        (lam1, mu1), (lam2, mu2) = first, second
        scale *= size(top, new, second, first)
        p.same(tp.inverse(top, new, first, second), y, scale)
        p.same(tp.explicit(top, new, (lam1, -mu1), (lam2, -mu2)), y, scale)
        p.same(tp.pole_free(top, new, lam1, lam2, -sheet), y, scale)
        p.same(tp.pole_free(top, tp.pole_free(top, y, lam1, lam2, -sheet), lam1, lam2, sheet), y, scale**2)
        p.same(tp.explicit(top, y, first, first), y)
        p.same(tp.pole_free(top, y, lam1, lam1, sheet), y)


# ------------------------------------------------------------------------------------------------ the real map


@sheets
@pytest.mark.parametrize("name", REAL_TOPS)
def test_reality(name, sheet):
    """(5.5.11): λ2 = λ̄1 and μ2 = −μ̄1; not μ2 = μ̄1, and not two real λ."""
    top, y = TOPS[name].top, TOPS[name].state
    unit = top.scales(y)[1] / top.scales(y)[0]
    for lam in (0.6j, 0.4 + 0.3j, -0.2 + 0.7j):
        (lam, mu) = first = tp.point(top, y, lam * unit, sheet)
        conjugate = tp.point(top, y, lam.conjugate(), sheet)
        assert abs(conjugate[1] + mu.conjugate()) <= 1e-13 * abs(mu)
        image = tp.explicit(top, y, first, conjugate)
        assert largest(image.imag) <= 1e-12 * largest(y)
        assert largest(image - two_point(top, y, lam, sheet)) <= 1e-12 * largest(y)
        wrong = tp.explicit(top, y, first, (lam.conjugate(), mu.conjugate()))
        two_real = tp.explicit(top, y, tp.point(top, y, 0.3 * unit), tp.point(top, y, -0.2 * unit))
        assert name.startswith("planar") or largest(wrong.imag) > 1e-2 * largest(y)
        assert largest(two_real.imag) > 1e-2 * largest(y)


@sheets
@pytest.mark.parametrize("name", TOPS)
def test_the_pole_free_form_is_the_map_that_is_sold(name, sheet):
    """All named tops, vertical ones too, and the λ of the paper's figures: real, |w| = Im λ, C1 … J3 to 1e-12."""
    top, y = TOPS[name].top, TOPS[name].state
    rate, length, _ = top.scales(y)
    lams = [(0.2 + 0.3j) * length / rate, 0.05j * length / rate, (-3 + 2j) * length / rate]
    for lam in [*lams, *({"figure1": [0.02j], "figure2": [500 + 5000j]}.get(name, []))]:
        image = tp.real_form(top, y, lam, sheet)
        assert image.dtype == float
        accuracy = 1e-13 if abs(lam) < 100 else 1e-9  # increments of size λ cancel there; `far_step` has the cure
        assert largest(image - two_point(top, y, lam, sheet)) <= accuracy * largest(y)
        drift = np.abs(np.array(invariants(top, image)) - top.invariants(y)) / top.invariant_scales(y)
        assert largest(drift) <= (1e-12 if abs(lam) < 100 else 1e-9)
        w = tp.axis(top, y, lam, lam.conjugate(), sheet)
        assert abs(np.sqrt(np.sum(w * w)) - lam.imag) <= 1e-13 * abs(lam)
        assert largest(w.imag) <= 1e-14 * lam.imag


def test_the_papers_figures_in_many_digits():
    """At 40 digits the λ of Figure 2 costs nothing: invariants to 1e-30, and the image is real mpmath numbers."""
    for name, lam in (("figure1", 0.02j), ("figure2", 500 + 5000j)):
        with mp.workdps(40):
            top, y = TOPS[name].top, np.array([mpf(v) for v in TOPS[name].y0])
            image = tp.real_form(top, y, mpc(lam))
            assert all(isinstance(v, mpf) for v in image)
            assert largest(np.array(invariants(top, image)) - np.array(invariants(top, y))) <= mpf("1e-30")
            assert largest(image.astype(float) - two_point(TOPS[name].top, TOPS[name].state, lam)) <= 1e-13


@pytest.mark.parametrize("name", ["figure1", "generic", "fast"])
def test_the_matrix_form_is_the_papers_program(name):
    top, y = TOPS[name].top, TOPS[name].state
    lam = 0.1j * top.scales(y)[1] / top.scales(y)[0]
    program = prepare(top, y, 1.0, "backlund_textbook", lam=lam).advance(y, 1)
    image = tp.matrix_form(top, y, *(tp.point(top, y, u) for u in (lam, lam.conjugate())))
    assert largest(image - program) <= 1e-12 * largest(y)


# ---------------------------------------------------------------------------------------- charts and alpha = 0


def test_a_singular_chart_is_not_a_singular_map():
    """B(λ1) = 0 exactly: the paper's formulas stop there, and lose digits nearby; w does neither."""
    top, lam = LagrangeTop(1.0), 0.5j
    xm = -lam * (1 - 2j)
    y = np.array([1.0, 2.0, 0.75, xm.real, -xm.imag, 0.3])
    assert lax.entries(top, y, lam)[1] == 0
    first, second = (tp.point(top, y, u) for u in (lam, lam.conjugate()))
    for form in (tp.explicit, tp.real_generators, tp.matrix_form):
        with pytest.raises(ValueError, match=r"B\(λ1\) = 0: the chart"):
            form(top, y, first, second)
    image = tp.real_form(top, y, lam)
    assert largest(np.array(invariants(top, image)) - top.invariants(y)) <= 1e-13
    near = y + 1e-9
    truth = tp.real_form(top, near, lam)
    assert largest(truth - image) < 1e-7
    lost = tp.explicit(top, near, *(tp.point(top, near, u) for u in (lam, lam.conjugate())))
    assert largest(lost - truth) > 1e-11  # 1e-16/|B|²: four digits and more of the sixteen


@both
def test_no_weight(digits):
    """alpha = 0: the map exists (its factors do not), J stays and x turns."""
    for p in points(digits):
        y, top = p.state(), LagrangeTop(0.0)
        first, second = curve_points(p, y, top)
        new, scale = tp.explicit(top, y, first, second), size(top, y, first, second)
        for form in (tp.real_generators, tp.matrix_form):
            p.same(form(top, y, first, second), new, scale)
        p.same(tp.pole_free(top, y, first[0], second[0]), new, scale)
        p.same(new[:3], y[:3])
        p.same(invariants(top, new), invariants(top, y), 10 * scale)
        x, X = tp.parameters(top, y, first, second)
        p.same(tp.expressions_x(top, y, new, first, second), [x] * 4, 10 * scale)
        p.same(tp.expressions_X(top, y, new, first, second), [X] * 4, 10 * scale)
        D = jacobian(partial(tp.pole_free, top, lam1=first[0], lam2=second[0]), y)
        p.same(D @ poisson_tensor(y) @ D.T, poisson_tensor(new), (1 + largest(D)) ** 2)


# ------------------------------------------------------------------------------------------- commutativity


@both
def test_maps_of_different_parameters_commute(digits):
    """Any four λ and any sheets, with the one-point maps, and with (complex) rotations about e3."""
    for p in points(digits):
        y, top, lams, d = p.state(), p.top, p.numbers(5), p.number()
        f = partial(tp.pole_free, top, lam1=lams[0], lam2=lams[1])
        for g in (
            partial(tp.pole_free, top, lam1=lams[2], lam2=lams[3], sheet=-1),
            partial(op.one_point, top, lam=lams[4]),
            lambda z, d=d: op.gauge(z, d),
        ):
            scale = 10 * (1 + max(largest(f(y)), largest(g(y)))) ** 5
            p.same(f(g(y)), g(f(y)), scale)


def test_chains():
    """B_(P2,Q3) ∘ B_(P1,Q2) = B_(P1,Q3)."""
    for p in points(15):
        y, top, (one, two, three) = p.state(), p.top, p.numbers(3)
        middle = tp.pole_free(top, y, one, two)
        scale = 10 * (1 + largest(middle)) ** 5
        p.same(tp.pole_free(top, middle, two, three), tp.pole_free(top, y, one, three), scale)


# ------------------------------------------------------------------------------------------- Poisson property


@both
@sheets
def test_the_map_is_poisson(digits, sheet):
    """λ1, λ2 frozen, μ1, μ2 from the curve at every state: 1e-12 in double, 38 digits in mpmath; every form."""
    for p in points(digits, 4):
        y, top, lams = p.state(), p.top, p.numbers(2)

        def by_points(form, z, top=top, lams=lams):
            return form(top, z, *(tp.point(top, z, lam, sheet) for lam in lams))

        chart = size(top, y, *(tp.point(top, y, lam, sheet) for lam in lams))
        for form in (tp.explicit, tp.real_generators, tp.matrix_form):
            defect, scale = poisson_defect(partial(by_points, form), y)
            assert defect <= p.tol * scale**2 * chart
        defect, scale = poisson_defect(partial(tp.pole_free, top, lam1=lams[0], lam2=lams[1], sheet=sheet), y)
        assert defect <= p.tol * scale**2


@pytest.mark.parametrize("name", TOPS)
def test_the_real_map_is_poisson(name):
    """At the named tops, figures included: the defect is round-off, measured below 1e-13 of |D|²."""
    top, y = TOPS[name].top, TOPS[name].state
    unit = top.scales(y)[1] / top.scales(y)[0]
    for lam in (0.3j * unit, (0.4 + 0.2j) * unit):
        defect, scale = poisson_defect(lambda z, lam=lam: tp.real_form(top, z, lam), y)
        assert defect <= 1e-12 * scale**2


@both
def test_with_frozen_mu_it_is_not_poisson(digits):
    """The trap: points taken from one torus give the same orbit there, but not the same derivative."""
    for p in points(digits):
        y, top, lams = p.state(), p.top, p.numbers(2)
        first, second = (tp.point(top, y, lam) for lam in lams)
        m = tuple(1j * lam * lam * mu for lam, mu in (first, second))
        frozen = partial(tp.pole_free, top, lam1=lams[0], lam2=lams[1], m=m)
        p.same(frozen(y), tp.pole_free(top, y, *lams), 10 * (1 + largest(frozen(y))) ** 2)
        for f in (frozen, lambda z, top=top, a=first, b=second: tp.explicit(top, z, a, b)):
            assert poisson_defect(f, y)[0] > 1e-3


# ---------------------------------------------------------------------------------------- arrays and errors


def test_arrays_of_states():
    Y = np.stack([TOPS[n].state for n in ("figure1", "figure2", "generic")])
    top, lam = LagrangeTop(1.5), 0.3 + 0.4j
    one_by_one = np.stack([tp.real_form(top, y, lam) for y in Y])
    assert largest(tp.real_form(top, Y, lam) - one_by_one) <= 1e-13 * largest(one_by_one)
    ends = [tp.point(top, Y, u) for u in (lam, lam.conjugate())]
    for form in (tp.explicit, tp.real_generators, tp.matrix_form):
        assert largest(form(top, Y, *ends) - one_by_one) <= 1e-12 * largest(one_by_one)


def test_python_numbers_as_parameters_do_not_cost_digits():
    """alpha = 3.345 and λ = 0.3 + 0.2i are doubles taken as exact: nothing is rounded to double on the way."""
    with mp.workdps(40):
        top, y, lam = TOPS["figure1"].top, np.array([mpf(v) for v in TOPS["figure1"].y0]), 0.3 + 0.2j
        image = tp.real_form(top, y, lam)
        assert largest(np.array(invariants(top, image)) - np.array(invariants(top, y))) <= mpf("1e-34")
        ends = [tp.point(top, y, u) for u in (lam, lam.conjugate())]
        for form in (tp.explicit, tp.real_generators, tp.matrix_form):
            assert largest(form(top, y, *ends) - image) <= mpf("1e-34")


def test_bad_input():
    top, y = TOPS["generic"].top, TOPS["generic"].state
    for lam in (1.0, -1j, 0, complex("nan"), complex(0, np.inf)):
        with pytest.raises(ValueError, match="lam must be finite with a positive imaginary part"):
            tp.real_form(top, y, lam)
    for lam in ("x", None):
        with pytest.raises(ValueError, match="lam must be a complex number"):
            tp.real_form(top, y, lam)
    with pytest.raises(ValueError, match="λ = 0 is the pole of μ"):
        tp.point(top, y, 0)
    for sheet in (0, 2, "1"):
        with pytest.raises(ValueError, match="sheet must be 1 or -1"):
            tp.real_form(top, y, 0.3j, sheet)
    with pytest.raises(ValueError, match="C1 = 0"):
        tp.real_form(top, (1.0, 2.0, 3.0, 0.0, 0.0, 0.0), 0.3j)
    lam, mu = tp.point(top, y, 0.5)
    with pytest.raises(ValueError, match="X = ∞"):
        tp.explicit(top, y, (lam, mu), (lam, -mu))
    sleeping = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 1.0])  # a(λ) = (1 + 2λ + 2λ²) e3 vanishes at a root
    with pytest.raises(ValueError, match="denominator"):
        tp.real_form(LagrangeTop(2.0), sleeping, -0.5 + 0.5j)
