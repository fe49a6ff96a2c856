"""Section 5.1, what the one-point maps do together: commutativity, products, deformation in λ, Poisson property."""

from functools import partial

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench.integrators import TOPS, two_point
from lagrange_bench.integrators.paper import lax
from lagrange_bench.integrators.paper import one_point as op
from lagrange_bench.integrators.paper.phase_space import invariants, poisson_tensor
from tests.test_integrators.paper.tools import (
    DIGITS,
    Dual,
    jacobian,
    largest,
    points,
    poisson_defect,
    size,
)

both = pytest.mark.parametrize("digits", DIGITS)
sheets = pytest.mark.parametrize("sheet", [1, -1])


# ------------------------------------------------------------------------------------------- compositions


@both
def test_all_maps_commute(digits):
    """Any parameters, any sheets, and the inverses."""
    for p in points(digits):
        y, lam, nu, top = p.state(), p.number(), p.number(), p.top
        for f, g in (
            (partial(op.one_point, top, lam=lam), partial(op.one_point, top, lam=nu, sheet=-1)),
            (partial(op.one_point, top, lam=lam, sheet=-1), partial(op.inverse, top, lam=nu)),
            (partial(op.inverse, top, lam=lam), partial(op.inverse, top, lam=nu, sheet=-1)),
        ):
            a, b = f(y), g(y)
            p.same(f(b), g(a), size(a, b, f(b)) ** 3)


@pytest.mark.parametrize("name", ["figure1", "figure2", "generic", "inverted"])
@sheets
def test_composition_with_the_inverse_is_the_two_point_map(name, sheet):
    """B_(λ̄)⁻¹ ∘ B_λ on one sheet is real, and `lagrange_bench.two_point` of the other; so is the product reversed."""
    top, y = TOPS[name].top, TOPS[name].state
    for lam in (0.1 + 0.3j, -0.5 + 0.2j):
        with mp.workdps(30):
            z = op.one_point(top, [mpf(v) for v in y], mp.mpc(lam), sheet)
            composed = op.inverse(top, z, mp.mpc(lam.conjugate()), sheet).astype(complex)
        expected = two_point(top, y, lam, sheet=-sheet)
        assert largest(composed.imag) <= 1e-25 * largest(y)
        assert largest(composed - expected) <= 1e-12 * largest(y)
        z = op.inverse(top, y, lam.conjugate(), sheet)
        assert largest(op.one_point(top, z, lam, sheet) - expected) <= 1e-12 * size(z, y)


@both
def test_the_two_sheets_do_not_undo_each_other(digits):
    """Section 5.5 has B_(λ,−μ) as the inverse of B_(λ,μ). Their product is T, independent of λ and Poisson."""
    for p in points(digits):
        y, top = p.state(), p.top
        T = op.sheet_exchange(top, y)
        for _ in range(3):
            lam = p.number()
            middle = op.one_point(top, y, lam)
            p.same(op.one_point(top, middle, lam, -1), T, size(middle, T) ** 3)
            p.same(op.one_point(top, middle, lam, mu=-lax.eigenvalue(top, y, lam)), T, size(middle, T) ** 3)
        assert largest(T - y) > 1e-2
        p.same(invariants(top, T), invariants(top, y), size(T))
        defect, scale = poisson_defect(lambda z, top=top: op.sheet_exchange(top, z), y)
        assert defect <= p.tol * scale**2


@both
@sheets
def test_deformation(digits, sheet):
    """∂z̃/∂λ = {−μ(λ), z̃}."""
    for p in points(digits):
        y, lam, top = p.state(), p.number(), p.top
        slope = jacobian(lambda z, y=y, top=top: op.one_point(top, y, z[0], sheet), np.array([lam]))[:, 0]
        new = op.one_point(top, y, lam, sheet)
        p.same(op.deformation(top, new, lam, sheet), slope, size(new) ** 3)
        mu_gradient = jacobian(lambda z, lam=lam, top=top: np.array([lax.eigenvalue(top, z, lam, sheet)]), new)[0]
        p.same(poisson_tensor(new) @ mu_gradient, slope, size(new) ** 3)  # {z, μ}


# ---------------------------------------------------------------------------------------- Poisson property


@both
@sheets
def test_the_map_is_poisson(digits, sheet):
    """D P Dᵀ = P̃ with λ frozen and μ from the curve at every state: to round-off, 30 digits and more in mpmath."""
    for p in points(digits):
        y, lam, top = p.state(), p.number(), p.top
        for f in (op.one_point, op.inverse, op.real_form):
            defect, scale = poisson_defect(lambda z, f=f, lam=lam, top=top: f(top, z, lam, sheet), y)
            assert defect <= p.tol * scale**2


@both
def test_with_frozen_mu_it_is_not_poisson(digits):
    """The trap: on the orbit frozen μ gives the same images, but not the same derivative."""
    for p in points(digits):
        y, lam, top = p.state(), p.number(), p.top
        mu = lax.eigenvalue(top, y, lam)
        defect, _ = poisson_defect(lambda z, lam=lam, top=top, mu=mu: op.one_point(top, z, lam, mu=mu), y)
        assert defect > 1e-3


@both
def test_which_invariants_detect_a_wrong_mu(digits):
    """With any μ at all (5.1.10) conserves H and J3; C1 and C2 do not survive. So a test must look at those."""
    for p in points(digits):
        y, lam, top = p.state(), p.number(), p.top
        new = op.one_point(top, y, lam, mu=p.number())
        before, after = np.array(invariants(top, y)), np.array(invariants(top, new))
        p.same(after[:2], before[:2], size(new))
        assert min(abs(after[2:] - before[2:])) > 1e-4


def test_derivatives_by_duals_are_derivatives():
    """The tool behind these tests, against differences."""
    top, y = TOPS["generic"].top, TOPS["generic"].state.astype(complex)
    D = jacobian(lambda z: op.one_point(top, z, 0.4j), y)
    for k in range(6):
        e = 1e-6 * np.eye(6)[k]
        difference = (op.one_point(top, y + e, 0.4j) - op.one_point(top, y - e, 0.4j)) / 2e-6
        assert largest(D[:, k] - difference) <= 1e-8 * (1 + largest(D))
    x = Dual(2.0, np.ones(1))
    assert (3 / x - (1 - x) ** 2).d[0] == pytest.approx(-0.75 - 2)
