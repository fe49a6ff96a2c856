"""The magnet's maps for up to eight spins, their motion when λ moves, and the Poisson property for up to five."""

import numpy as np
import pytest

from lagrange_bench.integrators.paper import gaudin_maps
from lagrange_bench.integrators.paper.gaudin_curve import eigenvalue
from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet
from tests.test_integrators.paper.test_gaudin import defect
from tests.test_integrators.paper.tools import largest


def magnet(n, seed):
    rng = np.random.default_rng((n, seed))
    return GaudinMagnet(tuple(np.arange(n) + rng.uniform(-0.3, 0.3, n)), 0.8), rng.normal(size=(n, 3))


LAM = 0.4 + 0.7j


@pytest.mark.parametrize("n", [5, 6, 7, 8])
def test_the_maps_of_many_spins(n):
    """What they keep; that the inverse is one; and (7) of docs/exact-step.md: how the image moves with λ."""
    model, spins = magnet(n, 1)
    kept = [f(spins) for f in (model.casimirs, model.hamiltonians)]
    one = gaudin_maps.one_point(model, spins, LAM)
    two = gaudin_maps.two_point(model, spins, LAM)
    for image in (one, two):
        for f, before in zip((model.casimirs, model.hamiltonians), kept, strict=True):
            assert largest(f(image) - before) < 1e-10 * (1 + largest(image)) ** 2
    assert largest(gaudin_maps.one_point_inverse(model, one, LAM) - spins) < 1e-9 * (1 + largest(one)) ** 2
    assert largest(gaudin_maps.two_point(model, two, LAM, sheet=-1) - spins) < 1e-12
    rate, d = 0.6 - 0.3j, 1e-5
    ahead, behind = (gaudin_maps.two_point(model, spins, LAM + s * d * rate) for s in (1, -1))
    v, ell = eigenvalue(model, spins, LAM), model.vector(two, LAM)
    claimed = [2 * (rate / v * np.cross(s, ell) / (a - LAM)).imag for a, s in zip(model.sites, two, strict=True)]
    assert largest((ahead - behind) / (2 * d) - claimed) < 1e-8
    assert largest(claimed) > 0.01


def test_poisson_to_five_spins():
    """D P Dᵀ = P̃ with v of the state, D exact to round-off; with v frozen not."""
    for n in (4, 5):
        model, spins = magnet(n, 2)
        v = eigenvalue(model, spins, LAM)
        maps = {
            "one-point": (lambda s, m=model: gaudin_maps.one_point(m, s, LAM), True),
            "two-point": (lambda s, m=model: gaudin_maps.two_point(m, s, LAM), True),
            "one-point, frozen": (lambda s, m=model, v=v: gaudin_maps.one_point(m, s, LAM, v=v), False),
        }
        for name, (f, right) in maps.items():
            pushed, target = defect(f, model, spins)
            assert (largest(pushed - target) < 1e-11 * (1 + largest(pushed))) == right, (n, name)
