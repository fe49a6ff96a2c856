"""What all maps of the top have in common, each law once: invariants, Poisson property, inverse, commutation, digits."""

from functools import partial

import numpy as np
import pytest
from mpmath import mp, mpc, mpf

from lagrange_bench.integrators import TOPS
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
    return op.gauge(y, p.nu) if name == "gauge" else op.sheet_exchange(p.top, y)


MAPS = (*ONE, *TWO, "pole_free", "gauge", "sheet_exchange")


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


def test_with_frozen_mu_they_are_not_poisson(p):
    """The trap: points taken from one torus give the same images there, but not the same derivative."""
    first, second = ends(p, p.y, p.sheet)
    m = tuple(1j * lam * lam * mu for lam, mu in (first, second))
    for name, frozen in (
        ("one_point", partial(op.one_point, p.top, lam=p.lam, mu=lax.eigenvalue(p.top, p.y, p.lam, p.sheet))),
        ("pole_free", partial(tp.pole_free, p.top, lam1=p.lam, lam2=p.nu, m=m)),
        ("explicit", partial(tp.explicit, p.top, first=first, second=second)),
    ):
        new = image(name, p, p.y)
        p.same(frozen(p.y), new, 10 * scale_of(name, p, new))
        assert poisson_defect(frozen, p.y)[0] > 1e-3


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


@pytest.mark.parametrize("name", [*ONE, *TWO, "pole_free"])
def test_python_numbers_as_parameters_do_not_cost_digits(name):
    """alpha = 3.345 and λ = 0.3 + 0.2i are doubles taken as exact: nothing is rounded to double on the way."""
    with mp.workdps(40):
        p = type("P", (), {"top": TOPS["figure1"].top, "lam": 0.3 + 0.2j, "nu": 0.3 - 0.2j, "sheet": 1})
        y = np.array([mpf(v) for v in TOPS["figure1"].y0])
        new = image(name, p, y)
        assert largest(np.array(invariants(p.top, new)) - np.array(invariants(p.top, y))) <= mpf("1e-34")
        p.lam, p.nu = mpc(p.lam), mpc(p.nu)
        assert largest(new - image(name, p, y)) <= mpf("1e-36")
