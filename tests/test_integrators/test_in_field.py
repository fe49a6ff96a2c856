"""Fixed-step methods in any potential: what their records claim there, and that a uniform field is no special case."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.integrators import METHODS, TOPS, LagrangeTop, PerturbedTop, Potential, StepError, prepare
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.methods import gauss_coefficients as gauss
from lagrange_bench.integrators.problem.body import quaternion_product
from lagrange_bench.integrators.problem.potentials import CHARGE, QUADRATIC, TIDE
from lagrange_bench.integrators.problem.top import hat
from lagrange_bench.integrators.truth import reference

EPS = np.finfo(float).eps
TOP, Y0 = LagrangeTop(1.0), TOPS["generic"].state
SPHERE = Potential("nothing", lambda x1, x2, x3, p: 0.0)
NOTHING = PerturbedTop(TOP, SPHERE)
FIELDS = {  # formulas that other tests use too: they are compiled once for all
    "quadratic": PerturbedTop(TOP, TIDE, (0.8, 0.6, -0.4, 0.7)),
    "charge": PerturbedTop(TOP, CHARGE, (0.4, 1.1, -0.7, 0.9)),
    "level": PerturbedTop(TOP, CHARGE, (0.4, 0.0, 0.0, 1.6)),
}
STAGES = {"implicit_midpoint": 1, "gauss4": 2, "gauss6": 3, "gauss8": 4, "gauss12": 6}
SOLVED = (*STAGES, "collective_midpoint")
NAMES = ("rkmk4", "commutator_free4", "bobenko_suris", "kahan", *SOLVED)
PAIRS = [(name, field) for name in NAMES for field, top in FIELDS.items() if METHODS[name].takes(top) is None]


def zero(name):
    """A potential of strength 0 that the method takes."""
    return (
        PerturbedTop(TOP, TIDE, (0.0, 0.6, -0.4, 0.7))
        if name == "kahan"
        else PerturbedTop(TOP, CHARGE, (0.0, 0.0, 0.0, 1.6))
    )


def starts(count, speed=1.5):
    """Random states with |x| = 1."""
    draw = np.random.default_rng(11)
    for _ in range(count):
        J, x = draw.normal(size=(2, 3))
        yield np.concatenate((speed * J, x / np.sqrt(x @ x)))


# ---------------------------------------------------------------- a uniform field


@pytest.mark.parametrize("name", NAMES)
def test_without_potential_it_is_the_kernel_of_the_uniform_field(name):
    """With every option, to round-off: of ten steps, each from where the other has been."""
    options = [{}]
    if "solver" in METHODS[name].options:
        options = [{"solver": solver} for solver in ("auto", "fixed_point", "newton")]
    if "compensated" in METHODS[name].options:
        options += [{**more, "compensated": True} for more in options]
    if "form" in METHODS[name].options:
        options = [{"form": "symmetric"}, {"form": "lagrange"}]
    for y0 in (Y0, *starts(4)):
        for h in (0.05, -0.3):
            for more in options:
                one = prepare(TOP, y0, h, name, **more).record(y0, 10, 1)
                other = prepare(zero(name), y0, h, name, **more).record(y0, 10, 1)
                assert np.max(metrics.scaled_error(TOP, y0, other, one)) < 32 * EPS, (h, more)
    assert METHODS[name].kept(NOTHING) == METHODS[name].conserves
    if "form" in METHODS[name].options:  # the options are told apart
        one, other = (prepare(zero(name), Y0, 0.3, name, **more).advance(Y0, 1) for more in options)
        assert metrics.scaled_error(TOP, Y0, one, other) > 1e-3


# ---------------------------------------------------------------- the order


@cache
def end(field):
    """The state at t = 4."""
    return reference.solution(FIELDS[field], Y0, [4.0]).states[0]


def measured_order(name, field, top, **options):
    """The slope over the last three step numbers whose errors are clear of round-off."""
    found = []
    for n in (5, 6, 7, 8, 10, 12, 16, 24, 32, 48, 64, 96, 128):
        error = np.max(np.abs(prepare(top, Y0, 4.0 / n, name, **options).advance(Y0, n) - end(field)))
        if error > 1e-13:
            found.append((n, error))
    (n, error), (m, less) = found[-3], found[-1]
    return np.log(error / less) / np.log(m / n)


# the errors of gauss12 are round-off before its slope is its order; `check` reads that off single steps
@pytest.mark.parametrize(("name", "field"), [(name, field) for name, field in PAIRS if name != "gauss12"])
def test_order(name, field):
    assert abs(measured_order(name, field, FIELDS[field]) - METHODS[name].order) < 0.35
    top = FIELDS[field]
    other = PerturbedTop(TOP, top.potential, (top.parameters[0] + 0.2, *top.parameters[1:]))
    assert measured_order(name, field, other) < 1  # another field is seen


def test_order_of_the_variables_of_lagrange():
    assert abs(measured_order("bobenko_suris", "charge", FIELDS["charge"], form="lagrange") - 1) < 0.1


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


@pytest.mark.parametrize(("name", "field"), PAIRS)
def test_what_is_kept(name, field):
    top, record = FIELDS[field], METHODS[name]
    kept = record.kept(top)
    assert kept <= top.conserved
    for invariant, values in zip(INVARIANTS, drifts(top, name, 0.1, 24), strict=True):
        if invariant in kept:
            assert walks(values), (invariant, np.sqrt(np.mean(values**2, axis=0)))
    for invariant, values in zip(INVARIANTS, drifts(top, name, 0.6, 2, 1024), strict=True):
        if invariant not in kept:
            assert not walks(values), invariant


def test_what_is_kept_with_other_options():
    for name, options in (
        ("gauss4", {"compensated": True}),
        ("gauss8", {"solver": "newton"}),
        ("implicit_midpoint", {"solver": "newton"}),
        ("collective_midpoint", {"solver": "newton"}),
        ("bobenko_suris", {"form": "lagrange"}),
    ):
        top = FIELDS["charge"]
        values = drifts(top, name, 0.1, 12, **options)
        assert walks(values[2]), (name, options)
        assert walks(values[3]), (name, options)
    plain = drifts(top, "gauss4", 0.1, 12)
    carried = drifts(top, "gauss4", 0.1, 12, compensated=True)
    assert np.mean(carried[2:] ** 2) < 0.2 * np.mean(plain[2:] ** 2)


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


# ---------------------------------------------------------------- symmetric, Poisson


@pytest.mark.parametrize(("name", "field"), PAIRS)
def test_symmetric(name, field):
    top = FIELDS[field]
    gaps = []
    for y in starts(6):
        there = prepare(top, y, 0.4, name).advance(y, 1)
        gaps.append(metrics.scaled_error(top, y, prepare(top, y, -0.4, name).advance(there, 1), y))
    gap = np.max(gaps)  # `max` may drop NaN
    assert gap < 32 * EPS if METHODS[name].symmetric else gap > 1e-8


@pytest.mark.parametrize(("name", "field"), PAIRS)
def test_poisson(name, field):
    """What the record does not claim is not so, but for a defect below the error of the differences."""
    top = FIELDS[field]
    for h in (0.4, -0.9):
        stepper = prepare(top, Y0, h, name)
        found = metrics.poisson_defect(lambda y, stepper=stepper: stepper.advance(y, 1), top, Y0)
        assert found.error < 1e-9
        if METHODS[name].poisson:
            assert found.defect < 1e-9
        elif METHODS[name].order <= 6:
            assert found.defect > 1e-7


def test_poisson_of_the_variables_of_lagrange():
    top = FIELDS["charge"]
    stepper = prepare(top, Y0, 0.9, "bobenko_suris", form="lagrange")
    assert metrics.poisson_defect(lambda y: stepper.advance(y, 1), top, Y0).defect < 1e-9


# ---------------------------------------------------------------- the steps, from their definitions


def stages_by_newton(top, y, h, s):
    """The stages of the step, by Newton's iteration on all 6s equations, and det(1 − h A f') there."""
    _, b, mu = gauss.tableau(s)
    A = np.array([[float(m * w) for m, w in zip(row, b, strict=True)] for row in mu])
    Y = np.tile(y, (s, 1))
    for _ in range(60):
        F = np.stack([top.jacobian(z) for z in Y])
        D = np.eye(6 * s) - h * np.einsum("ij,jkl->ikjl", A, F).reshape(6 * s, 6 * s)
        change = np.linalg.solve(D, (Y - y - h * A @ top.rhs(Y)).ravel()).reshape(s, 6)
        Y = Y - change
        if np.max(np.abs(change)) < 1e-14 * np.max(np.abs(Y)):
            return y + h * np.array(b, dtype=float) @ top.rhs(Y), np.linalg.det(D)
    return None, 0.0


@pytest.mark.parametrize(("name", "field"), [pair for pair in PAIRS if pair[0] in STAGES])
def test_gauss_step_is_what_the_tableau_says(name, field):
    """All solvers; the second step starts from the first."""
    top = FIELDS[field]
    for y in (Y0, *starts(3, 1.0)):
        for h in (0.05, -0.3, 0.8):
            middle = stages_by_newton(top, y, h, STAGES[name])[0]
            expected = stages_by_newton(top, middle, h, STAGES[name])[0]
            for solver in ("auto", "newton", "fixed_point") if h < 0.5 else ("auto", "newton"):
                z = prepare(top, y, h, name, solver=solver).advance(y, 2)
                assert metrics.scaled_error(top, y, z, expected) < 64 * EPS, (h, solver)


def product(a, b):
    return np.array(quaternion_product(a, b))


def quaternion_midpoint(top, y, h, spin):
    """One implicit midpoint step of q' = ½Jq, p' = ½Jp + 2 g q k with x = q k q̄, J = ½ Im(p q̄), from a lift of y."""
    k, conjugate = np.array((0.0, 0, 0, 1)), np.array((1.0, -1, -1, -1))

    def state(q, p):
        J, x = product(p, q * conjugate)[1:] / 2, product(product(q, k), q * conjugate)[1:]
        return J, x

    def rates(q, p):
        J, x = state(q, p)
        J, g = np.concatenate(((0.0,), J)), np.concatenate(((0.0,), top.gradient(*x)))
        return np.concatenate((product(J, q) / 2, product(J, p) / 2 + 2 * product(product(g, q), k)))

    length = np.sqrt(y[3:] @ y[3:])
    half = np.array((length + y[5], -y[4], y[3], 0.0))  # from e3 to x
    q = half / np.sqrt(half @ half) * np.sqrt(length)
    q = product(q, np.array((np.cos(spin), 0, 0, np.sin(spin))))
    p = product(np.concatenate(((spin,), 2 * y[:3])), q) / length
    z = np.concatenate((q, p))
    middle = z
    for _ in range(200):
        middle = z + h / 2 * rates(middle[:4], middle[4:])
    new = 2 * middle - z
    assert np.allclose(np.concatenate(state(q, p)), y, atol=1e-14)
    return np.concatenate(state(new[:4], new[4:]))


@pytest.mark.parametrize("field", FIELDS)
def test_collective_midpoint_is_the_midpoint_rule_of_quaternions(field):
    """Whatever the lift; the record's own formula is for a uniform field."""
    top = FIELDS[field]
    for y in (Y0, *starts(3)):
        for h in (0.1, -0.4):
            for solver in ("auto", "newton", "fixed_point"):
                z = prepare(top, y, h, "collective_midpoint", solver=solver).advance(y, 1)
                for spin in (0.0, 0.7):
                    assert metrics.scaled_error(top, y, z, quaternion_midpoint(top, y, h, spin)) < 64 * EPS
    wrong = prepare(zero("collective_midpoint"), Y0, 0.1, "collective_midpoint").advance(Y0, 1)
    assert metrics.scaled_error(top, Y0, wrong, quaternion_midpoint(top, Y0, 0.1, 0.0)) > 1e-4


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
    for y in starts(300):
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
    assert refused > 20
    assert taken > 600


def test_kahan_takes_without_potential_what_its_record_takes():
    """And more: beyond eps x3 = 1, a pole of r0, the step may have none."""
    verdicts = set()
    for y in starts(300):
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


@pytest.mark.parametrize("name", SOLVED)
def test_no_convergence_is_an_error(name):
    """The fixed point of a fast top diverges or goes on for ever; Newton solves it."""
    top, y = FIELDS["charge"], np.concatenate((10 * Y0[:3], Y0[3:]))
    with pytest.raises(StepError, match=rf"{name} at h = 3, step 0: .*500 iterations"):
        prepare(top, y, 3.0, name, solver="fixed_point").advance(y, 1)
    assert np.isfinite(prepare(top, y, 0.3, name).advance(y, 100)).all()


@pytest.mark.parametrize("name", SOLVED)
def test_solutions_beyond_a_fold_are_refused(name):
    """A step that is taken has det(1 − h A f') > 0; of random long steps some lie beyond."""
    top, folded = FIELDS["charge"], 0
    for y in starts(400, 1.0):
        try:
            z = prepare(top, y, 8.0, name, solver="newton").advance(y, 1)
        except StepError as error:
            folded += "several solutions" in str(error)
            continue
        if name in STAGES:
            expected, det = stages_by_newton(top, y, 8.0, STAGES[name])
            if expected is not None and metrics.scaled_error(top, y, z, expected) < 1e-9:
                assert det > 0
    assert folded > 0


@pytest.mark.parametrize("name", SOLVED)
def test_absurd_steps_are_refused(name):
    with pytest.raises(StepError, match="time scale"):
        prepare(FIELDS["charge"], Y0, 1e9, name)
    with pytest.raises(ValueError, match="solver must be one of"):
        prepare(FIELDS["charge"], Y0, 0.1, name, solver="simplex")


@pytest.mark.parametrize("name", STAGES)
def test_starting_values_change_no_more_than_rounding(name):
    """A new call starts from the state, not from the last step."""
    stepper = prepare(FIELDS["charge"], Y0, 0.2, name)
    once, twice = stepper.advance(Y0, 50), stepper.advance(stepper.advance(Y0, 25), 25)
    assert metrics.scaled_error(FIELDS["charge"], Y0, once, twice) < 1e-13
    assert stepper.work.rhs_evals == STAGES[name] * stepper.work.iterations


@pytest.mark.parametrize("name", ["rkmk4", "commutator_free4"])
def test_turns_beyond_the_most_are_refused(name):
    with pytest.raises(StepError, match="turns by more than 1024 rad"):
        prepare(FIELDS["charge"], Y0, 1e4, name).advance(Y0, 1)


@pytest.mark.parametrize(("name", "field"), PAIRS)
def test_rows_do_not_depend_on_how_they_are_asked_for(name, field):
    stepper = prepare(FIELDS[field], Y0, 0.1, name)
    rows = [stepper.record(Y0, 60, every)[-1] for every in (1, 4, 60)]
    assert all(np.array_equal(a, b) for a, b in pairwise(rows))
