"""Round-off in what methods keep walks at random (Brouwer's law: ½, not 1), and what would make it drift."""

from functools import partial

import numpy as np
import pytest

from lagrange_bench import METHODS, LagrangeTop, metrics, states
from lagrange_bench.integrators.methods import splitting as sp
from tests.installed import in_uniform_fields

EPS = float(np.finfo(float).eps)


def drifts(prepare, n, span, keeps=None, tops=states.RANDOM):
    """Relative errors of H, J3, C1, C2, and of what else a method keeps, on the way: by name, (tops, 501)."""
    errors = {}
    for name in tops:
        top, y0 = states.find(name)
        rows = prepare(top, y0, span * top.scales(y0)[2]).record(y0, n, n // 500)
        drift = metrics.relative_drift(top.invariants(rows), top.invariant_scales(y0))
        found = dict(zip(("H", "J3", "C1", "C2"), drift.T, strict=True))
        for quantity, function in (keeps or {}).items():
            values, size = function(top, span * top.scales(y0)[2], rows)
            found[quantity] = (values - values[0]) / size
        for quantity, error in found.items():
            errors.setdefault(quantity, []).append(error)
    return {quantity: np.array(error) for quantity, error in errors.items()}


def exponent(errors):
    """Of the growth over the last two decades."""
    return metrics.growth_exponent(np.arange(501.0), errors).p


@pytest.mark.parametrize(
    ("name", "n", "span", "options"),
    [
        ("kahan", 500_000, 1.0, {}),
        ("bobenko_suris", 500_000, 0.125, {}),
        ("commutator_free4", 300_000, 0.125, {}),
        ("strang", 300_000, 0.25, {}),
        ("gauss4", 100_000, 0.5, {"compensated": True}),
        ("implicit_midpoint", 200_000, 0.25, {}),
        ("collective_midpoint", 100_000, 0.25, {}),
    ],
)
def test_errors_walk_at_random(name, n, span, options):
    """Over 10⁷ steps the exponents are 0.3 … 0.67. What a motion of space does not keep drifts in proportion to time."""
    method = METHODS[name]
    errors = drifts(partial(in_uniform_fields(method).prepare, **options), n, span, method.claims.conserves_own)
    kept = {*method.conserves_on(LagrangeTop()), *method.claims.conserves_own} - {"J3"}
    if "J3" in method.conserves_on(LagrangeTop()):
        assert not np.any(errors["J3"])
    assert {k: p for k in kept if (p := exponent(errors[k])) >= 0.75} == {}
    if method.family == "splitting":
        kicks = min(len(sp.SCHEMES[name].a), len(sp.SCHEMES[name].b))
        assert max(np.max(np.abs(errors[k])) for k in ("C1", "C2")) < 3 * EPS * np.sqrt(n * kicks)
    if name in ("rkmk4", "commutator_free4"):
        assert min(exponent(errors["H"]), exponent(errors["J3"])) > 0.9


def test_compensation_keeps_what_rounding_takes():
    """A tenth of the error in |x|² and x·J over 4·10⁴ steps."""
    plain, kept = (
        drifts(partial(in_uniform_fields(METHODS["kahan_li8"]).prepare, compensated=c), 40_000, 0.25)
        for c in (False, True)
    )
    for k in ("C1", "C2"):
        assert np.sqrt(np.mean(kept[k][:, -1] ** 2)) < 0.1 * np.sqrt(np.mean(plain[k][:, -1] ** 2))
