"""Fixed-step methods in any potential: what they keep, to round-off; Kahan's method and that of Bobenko and Suris."""

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.integrators import METHODS, TOPS, LagrangeTop, PerturbedTop, Potential, StepError, prepare
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.problem.potentials import CHARGE, QUADRATIC, TIDE

EPS = np.finfo(float).eps
TOP, Y0 = LagrangeTop(1.0), TOPS["generic"].state
SPHERE = Potential("nothing", lambda x1, x2, x3, p: 0.0)
NOTHING = PerturbedTop(TOP, SPHERE)
FIELDS = {  # formulas that other tests use too: they are compiled once for all
    "quadratic": PerturbedTop(TOP, TIDE, (0.8, 0.6, -0.4, 0.7)),
    "charge": PerturbedTop(TOP, CHARGE, (0.4, 1.1, -0.7, 0.9)),
    "level": PerturbedTop(TOP, CHARGE, (0.4, 0.0, 0.0, 1.6)),
}
SOLVED = ("implicit_midpoint", "gauss4", "gauss6", "gauss8", "gauss12", "collective_midpoint")
NAMES = ("rkmk4", "commutator_free4", "bobenko_suris", "kahan", *SOLVED)


def starts(count, speed=1.5):
    """Random states with |x| = 1."""
    draw = np.random.default_rng(11)
    for _ in range(count):
        J, x = draw.normal(size=(2, 3))
        yield np.concatenate((speed * J, x / np.sqrt(x @ x)))


# ---------------------------------------------------------------- what is kept


def walks(drifts):
    """Of drifts (runs, 2) at N/16 and N steps, in ulps over √N: no larger than round-off, and not growing like N."""
    early, late = np.sqrt(np.mean(drifts**2, axis=0))
    return late <= 4.0 and late <= 2.2 * max(early, 0.2)


def drifts(top, name, h, count, steps=10240, **options):
    """Of H, J3, C1, C2 after N/16 and N steps, over √N ulps, (4, runs, 2)."""
    found = []
    for y in starts(count):
        I = top.invariants(prepare(top, y, h, name, **options).record(y, steps, steps // 16)[[0, 1, 16]])
        change = (I[1:] - I[0]) / (EPS / 2 * top.invariant_scales(y))
        found.append(change.T / np.sqrt([steps / 16, steps]))
    return np.moveaxis(found, 0, 1)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_kept(name):
    """By every solver; and what is not kept is seen not to be."""
    top, record = FIELDS["quadratic" if name == "kahan" else "level"], METHODS[name]
    kept = record.kept(top)
    assert kept <= top.conserved
    for options in ({}, {"solver": "newton"}) if name in ("gauss8", "collective_midpoint") else ({},):
        for invariant, values in zip(INVARIANTS, drifts(top, name, 0.1, 12, **options), strict=True):
            if invariant in kept:
                assert walks(values), (invariant, np.sqrt(np.mean(values**2, axis=0)))
    for invariant, values in zip(INVARIANTS, drifts(top, name, 0.6, 2, 1024), strict=True):
        if invariant not in kept:
            assert not walks(values), invariant


def test_compensated_sums_keep_more():
    plain, carried = (drifts(FIELDS["charge"], "gauss4", 0.1, 12, compensated=c)[2:] for c in (False, True))
    assert walks(carried[0])
    assert walks(carried[1])
    assert np.mean(carried**2) < 0.2 * np.mean(plain**2)


def test_a_drift_is_seen():
    """A twentieth of an ulp a step, added to what is no more than a random walk."""
    values = drifts(FIELDS["charge"], "bobenko_suris", 0.1, 24)[2]
    assert walks(values)
    assert not walks(values + 0.05 * np.sqrt([10240 / 16, 10240]))


@pytest.mark.parametrize("name", [name for name in NAMES if "J3" in METHODS[name].kept(NOTHING)])
def test_level_fields_keep_J3_without_any_rounding(name):
    """From J3 = 0: the torque about the vertical is rounding alone, and beside a larger J3 it would be rounded off."""
    top = PerturbedTop(TOP, QUADRATIC, (0.7, 0.7, 0.3, 0.0, 0.0, 0.0)) if name == "kahan" else FIELDS["level"]
    y = Y0 * (1, 1, 0, 1, 1, 1)
    assert "J3" in METHODS[name].kept(top)
    assert prepare(top, y, 0.1, name).advance(y, 100)[2] == 0.0


# ---------------------------------------------------------------- the steps, from their definitions


def hat(v):
    """The matrix of v×."""
    return np.cross(v, np.eye(3)).T


def cayley(v, x):
    """(1 − v×)⁻¹ (1 + v×) x."""
    return np.linalg.solve(np.eye(3) - hat(v), x + np.cross(v, x))


@pytest.mark.parametrize("field", FIELDS)
def test_bobenko_suris_is_kick_rotation_kick(field):
    top, h = FIELDS[field], 0.3

    def kick(t, y):
        return np.concatenate((y[:3] + t * top.rhs(y)[:3], y[3:]))

    for y in (Y0, *starts(3)):
        for form, before, after in (("symmetric", h / 2, h / 2), ("lagrange", h, 0.0)):
            K = kick(before, y)
            expected = kick(after, np.concatenate((K[:3], cayley(h / 2 * K[:3], K[3:]))))
            z = prepare(top, y, h, "bobenko_suris", form=form).advance(y, 1)
            assert metrics.scaled_error(top, y, z, expected) < 16 * EPS
    with pytest.raises(ValueError, match="form must be one of"):
        prepare(top, Y0, h, "bobenko_suris", form="poisson")


@pytest.mark.parametrize("top", [NOTHING, FIELDS["quadratic"]], ids=["nothing", "quadratic"])
def test_kahan_is_the_polarised_step_and_refuses_its_poles(top):
    """ỹ = y + h (1 − (h/2) f')⁻¹ f. A pole passed between 0 and h leaves det ≤ 0, or a real eigenvalue of D ≤ 0."""
    refused = taken = 0
    for y in starts(150):
        for h in (0.3, -1.0, 2.5):
            D = np.eye(6) - h / 2 * top.jacobian(y)
            T = top.jacobian(y)[:3, 3:]
            small = np.eye(3) - h / 2 * hat(y[:3]) + h * h / 4 * hat(y[3:]) @ T
            assert np.linalg.det(small) == pytest.approx(np.linalg.det(D), rel=1e-9, abs=1e-12)
            eigenvalues = np.linalg.eigvals(small)
            real = eigenvalues.real[np.abs(eigenvalues.imag) < 1e-12]
            try:
                z = prepare(top, y, h, "kahan").advance(y, 1)
            except StepError:
                e1, e2 = np.trace(small), (np.trace(small) ** 2 - np.trace(small @ small)) / 2
                assert min(np.linalg.det(D), e1, e2) < 1e-12
                refused += 1
                continue
            assert np.all(real > 0)
            taken += 1
            expected = y + h * np.linalg.solve(D, top.rhs(y))
            assert metrics.scaled_error(top, y, z, expected) < 64 * EPS * np.linalg.cond(D)
    assert refused > 10
    assert taken > 300


def test_kahan_takes_without_potential_what_its_record_takes():
    """And more: beyond eps x3 = 1, a pole of r0, the step may have none."""
    verdicts = set()
    for y in starts(150):
        for h in (0.5, 2.0, 4.0):
            answers = []
            for top in (TOP, NOTHING):
                try:
                    prepare(top, y, h, "kahan").advance(y, 1)
                    answers.append(True)
                except StepError:
                    answers.append(False)
            verdicts.add(tuple(answers))
    assert verdicts == {(True, True), (False, False), (False, True)}


def test_kahan_needs_a_quadratic_potential():
    for field, top in FIELDS.items():
        if field == "quadratic":
            assert METHODS["kahan"].takes(top) is None
            continue
        with pytest.raises(ValueError, match=f"kahan needs a quadratic potential, which {top.potential.name} is not"):
            prepare(top, Y0, 0.1, "kahan")


# ---------------------------------------------------------------- where there is no step


@pytest.mark.parametrize("name", ["rkmk4", "commutator_free4"])
def test_turns_beyond_the_most_are_refused(name):
    with pytest.raises(StepError, match="turns by more than 1024 rad"):
        prepare(FIELDS["charge"], Y0, 1e4, name).advance(Y0, 1)
