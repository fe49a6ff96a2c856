"""Sections 5.1 and 5.5: the maps of the top. First what all have in common, each law once; then what each has of its own."""

from functools import partial

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench.integrators import TOPS, LagrangeTop, prepare, two_point
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import one_point as op
from lagrange_bench.integrators.paper import two_point as tp
from lagrange_bench.integrators.paper.phase_space import invariants, ladder, sqrt
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


def test_maps_commute(p):
    """Any parameters, sheets, inverses and forms; also with complex rotations about e3."""
    lam, nu = p.numbers(2)
    other = {
        "one_point": partial(op.one_point, p.top, lam=nu, sheet=-p.sheet),
        "inverse": partial(op.inverse, p.top, lam=nu),
        "pole_free": partial(tp.pole_free, p.top, lam1=lam, lam2=nu, sheet=-1),
        "gauge": lambda z: op.gauge(z, nu),
    }
    for name, g in (*(("one_point", g) for g in other.values()), *(("pole_free", g) for g in other.values())):
        f = partial(image, name, p)
        a, b = f(p.y), g(p.y)
        p.same(f(b), g(a), size(a, b, f(b)) ** 3 if name == "one_point" else 10 * (1 + largest((a, b))) ** 5)


def test_inverse(p):
    """One-point: both ways at the same (λ, μ). Two-point: points exchanged, or both μ negated, or the other sheet."""
    new, old = image("one_point", p, p.y), image("inverse", p, p.y)
    p.same(image("inverse", p, new), p.y, size(new) ** 2)
    p.same(image("one_point", p, old), p.y, size(old) ** 2)
    (lam1, mu1), (lam2, mu2) = first, second = ends(p, p.y, p.sheet)
    new = tp.explicit(p.top, p.y, first, second)
    scale = chart_size(p.top, p.y, first, second) * chart_size(p.top, new, second, first)
    p.same(tp.inverse(p.top, new, first, second), p.y, scale)
    p.same(tp.explicit(p.top, new, (lam1, -mu1), (lam2, -mu2)), p.y, scale)
    p.same(image("pole_free", p, new, -p.sheet), p.y, scale)
    p.same(tp.explicit(p.top, p.y, first, first), p.y)
    p.same(tp.pole_free(p.top, p.y, lam1, lam1, p.sheet), p.y)


# -------------------------------------------------------------------------------------------- one-point, section 5.1


def test_intertwining_and_spectrality(p):
    """(5.1.3), (5.1.4), (5.1.6)–(5.1.10): M L = L̃ M at random u, both forms of q, a given μ."""
    y, lam, u, top = p.y, p.lam, p.u, p.top
    new = op.one_point(top, y, lam, p.sheet)
    P, q = op.parameters(top, y, lam, p.sheet)
    M = op.dressing_matrix(P, q, lam, u)
    p.same(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0], u - lam, 1 + abs(P * q))
    p.same(M @ lax.lax_matrix(top, y, u), lax.lax_matrix(top, new, u) @ M, size(new, y, [q]))
    (J3, Jm, _, *_), (J3_new, _, Jp_new, *_) = ladder(y), ladder(new)
    p.same([J3_new, P, q], [J3, Jm / (2 * top.alpha), Jp_new / (2 * top.alpha)])
    mu, (A, B, C) = lax.eigenvalue(top, y, lam, p.sheet), lax.entries(top, y, lam)
    p.same(mu * mu, A * A + B * C, 10 * (1 + abs(mu) ** 2))
    p.same([q * B, q * (A + mu)], [A - mu, -C], 10 * (1 + abs(q)) * (1 + abs(mu)))
    p.same(op.one_point(top, y, lam, mu=mu), new, 10 * size(new, y))


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


def test_k_and_its_sign(p):
    """(5.2.6): k = x3 − q x- = x̃3 − p x̃+, k² = C1 + λ x- x̃+, and k → sheet · √C1 as λ → 0, where the map is regular."""
    y, lam, top, sheet = p.y, p.lam, p.top, p.sheet
    new = op.one_point(top, y, lam, sheet)
    k, (P, q) = op.k_value(top, y, lam, sheet), op.parameters(top, y, lam, sheet)
    (*_, x3, xm, _), (*_, x3_new, _, xp_new), c1 = ladder(y), ladder(new), invariants(top, y)[2]
    p.same([k, k], [x3 - q * xm, x3_new - P * xp_new], size(new, y))
    p.same(k * k, c1 + lam * xm * xp_new, size(new, y))
    p.same(op.k_value(top, y, lam, mu=lax.eigenvalue(top, y, lam, sheet)), k, size(new, y))
    p.same(op.k_value(top, y, 0, sheet), sheet * sqrt(c1))
    at_zero, near = op.one_point(top, y, 0, sheet), op.one_point(top, y, p.tol, sheet)
    p.same(at_zero, near, size(at_zero) ** 3 * 100)
    p.same(invariants(top, at_zero), invariants(top, y), size(at_zero))


def test_stable_q():
    """One form of q loses all digits where B(λ) → 0, the other is right."""
    top, y = TOPS["generic"].top, TOPS["generic"].state
    _, Jm, _, _, xm, _ = ladder(y)
    lam = complex(-xm / Jm)
    mu, (A, _, _) = lax.eigenvalue(top, y, lam), lax.entries(top, y, lam)
    good = 1 if abs(A + mu) > abs(A - mu) else -1
    assert largest(op.one_point(top, y, 0.2 + 0.1j).imag) > 0.1  # the image of a real state is not real
    for nudge in (0.0, 1e-13, 1e-9):
        with mp.workdps(50):
            exact = op.one_point(top, [mpf(v) for v in y], mp.mpc(lam + nudge), good)
        assert largest(op.one_point(top, y, lam + nudge, good) - exact.astype(complex)) <= 1e-13
    upright = (0.0, 0.0, 3.0, 0.0, 0.0, 1.0)  # J- = x- = 0: q/p of the paper is 0/0
    assert np.array_equal(op.one_point(top, upright, 0.7), upright)


# -------------------------------------------------------------------------------------------- two-point, section 5.5


def step(p, sheets, top=None):
    """Two points of the curve through the state, the image, and the size of the terms."""
    top = top or p.top
    first, second = tp.point(top, p.y, p.lam, sheets[0]), tp.point(top, p.y, p.nu, sheets[1])
    return first, second, tp.explicit(top, p.y, first, second), chart_size(top, p.y, first, second)


def conjugates(top, y, lam, sheet=1):
    return tp.point(top, y, lam, sheet), tp.point(top, y, lam.conjugate(), sheet)


def test_intertwining(p):
    """(5.5.2)–(5.5.4), (5.5.7): M L = L̃ M, det M = (u − λ1)(u − λ2), μ on both curves.

    (5.5.1): B_(P1,Q2) = B_Q2 ∘ B_P1, B_Q2 the inverse of the one-point map at (λ2, μ2); in either order.
    """
    first, second, new, size = step(p, (-p.sheet, 1))
    (lam1, mu1), (lam2, mu2) = first, second
    M = tp.dressing_matrix(*tp.parameters(p.top, p.y, first, second), lam1, lam2, p.u)
    p.same(M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0], (p.u - lam1) * (p.u - lam2), size)
    p.same(M @ lax.lax_matrix(p.top, p.y, p.u), lax.lax_matrix(p.top, new, p.u) @ M, 10 * size)
    for lam, mu in (first, second):
        for state in (p.y, new):
            A, B, C = lax.entries(p.top, state, lam)
            p.same(mu * mu, A * A + B * C, 10 * size)
    middle, other = op.one_point(p.top, p.y, lam1, mu=mu1), op.inverse(p.top, p.y, lam2, mu=mu2)
    p.same(op.inverse(p.top, middle, lam2, mu=mu2), new, size * (1 + largest(middle)) ** 3)
    p.same(op.one_point(p.top, other, lam1, mu=mu1), new, size * (1 + largest(other)) ** 3)


@pytest.mark.parametrize("alpha", ["heavy", 0.0])
def test_all_forms_are_one_map(p, alpha):
    """(5.5.9), (5.5.10) corrected, the line of the program, the vector w. At alpha = 0 J stays, and factors do not exist.

    (5.5.5), (5.5.6): x and X from the old state, from the new one, from J+ between and from J-; with (5.5.8).
    """
    top = p.top if alpha == "heavy" else LagrangeTop(alpha)
    first, second, new, size = step(p, (p.sheet, p.sheet), top)
    for form in TWO.values():
        p.same(form(top, p.y, first, second), new, size)
    p.same(tp.pole_free(top, p.y, first[0], second[0], p.sheet), new, size)
    p.same(invariants(top, new), invariants(top, p.y), 10 * size)
    w, gap = tp.axis(top, p.y, first[0], second[0], p.sheet), first[0] - second[0]
    p.same(np.sum(w * w), -gap * gap / 4, 1 + largest(w) ** 2)
    x, X = tp.parameters(top, p.y, first, second)  # M0 = −λ0 + i w·σ
    p.same([1j * w[2], 1j * (w[0] - 1j * w[1])], [x * X - gap / 2, X], size)
    count = 5 if top.alpha else 4
    p.same(tp.expressions_x(top, p.y, new, first, second), [x] * count, 10 * size)
    p.same(tp.expressions_X(top, p.y, new, first, second), [X] * count, 10 * size)
    if not top.alpha:
        p.same(new[:3], p.y[:3])
        defect, scale = poisson_defect(lambda z: tp.pole_free(top, z, first[0], second[0], p.sheet), p.y)
        assert defect <= p.tol * scale**2


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


def test_the_matrix_form_is_the_papers_program():
    top, y = TOPS["figure1"].top, TOPS["figure1"].state
    lam = 0.1j * top.scales(y)[1] / top.scales(y)[0]
    program = prepare(top, y, 1.0, "backlund_textbook", lam=lam).advance(y, 1)
    assert largest(tp.matrix_form(top, y, *conjugates(top, y, lam)) - program) <= 1e-12 * largest(y)


def test_a_singular_chart_is_not_a_singular_map():
    """B(λ1) = 0 exactly: the paper's formulas stop there, w does not."""
    top, lam = LagrangeTop(1.0), 0.5j
    xm = -lam * (1 - 2j)
    y = np.array([1.0, 2.0, 0.75, xm.real, -xm.imag, 0.3])
    assert lax.entries(top, y, lam)[1] == 0
    for form in TWO.values():
        with pytest.raises(ValueError, match=r"B\(λ1\) = 0: the chart"):
            form(top, y, *conjugates(top, y, lam))
    image = tp.real_form(top, y, lam)
    assert largest(np.array(invariants(top, image)) - top.invariants(y)) <= 1e-13
    assert largest(tp.real_form(top, y + 1e-9, lam) - image) < 1e-7
