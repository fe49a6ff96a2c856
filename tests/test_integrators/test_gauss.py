"""Implicit methods: Gauss collocation and its midpoint rule; Kahan's step, linearly implicit."""

from fractions import Fraction

import numpy as np
import pytest

from lagrange_bench import TOPS, LagrangeTop, PerturbedTop, StepError, metrics, prepare, states
from lagrange_bench.integrators.methods import gauss_coefficients
from lagrange_bench.integrators.problem.potentials import CHARGE, TIDE
from tests.reference import drift, largest

pytestmark = [
    pytest.mark.interpreted,
    pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning"),  # an iteration that diverges overflows
]
TOP, Y0 = TOPS["generic"].top, TOPS["generic"].state
EPS = np.finfo(float).eps
CHARGED = PerturbedTop(TOP, CHARGE, (0.4, 1.1, -0.7, 0.9))
STAGES = {"implicit_midpoint": 1, "gauss4": 2, "gauss6": 3, "gauss8": 4}
GAUSS = [name for name, s in STAGES.items() if s > 1]


def starts(count):
    """Random states."""
    return [states.find(f"random{number:03d}")[1] for number in range(count)]


@pytest.mark.parametrize("s", [2, 3, 4])
def test_order_conditions(s):
    """In exact fractions; B(2s), Σ b c^(k−1) = 1/k, and C(s), Σ_j a_ij c_j^(k−1) = c_i^k/k, give order 2s (Butcher)."""
    c, b, mu = map(np.array, gauss_coefficients.tableau(s))
    B = [b @ c ** (k - 1) - Fraction(1, k) for k in range(1, 2 * s + 1)]
    C = [(mu * b) @ c ** (k - 1) - c**k / k for k in range(1, s + 1)]
    assert max(largest(B), largest(C)) < 1e-32


def newton_reference(top, y, h, s, start=None):
    """The step by Newton's iteration on all 6s equations Y = y + h A f(Y), from stages `start`; and det(1 − h A f') there."""
    _, b, mu = map(np.array, gauss_coefficients.tableau(s))
    A = (mu * b).astype(float)
    Y = np.tile(y, (s, 1)) if start is None else start
    for _ in range(60):
        F = np.stack([top.jacobian(z) for z in Y])
        D = np.eye(6 * s) - h * np.einsum("ij,jkl->ikjl", A, F).reshape(6 * s, 6 * s)
        change = np.linalg.solve(D, (Y - y - h * A @ top.rhs(Y)).ravel()).reshape(s, 6)
        Y = Y - change
        if np.max(np.abs(change)) < 1e-14 * np.max(np.abs(Y)):
            return y + h * b.astype(float) @ top.rhs(Y), np.linalg.det(D)
    return None, 0.0


def steps_to_take():
    """Tops, states and steps."""
    for case in ("generic", "figure1", "fast", "random000"):
        top, y = states.find(case)
        for span in (0.05, -0.3, 1.0, 2.5):
            yield top, y, span * top.scales(y)[2]
    for y in (Y0, *starts(2)):
        for h in (0.05, -0.3, 0.8):
            yield CHARGED, y, h


@pytest.mark.parametrize("name", STAGES)
def test_step_is_what_the_tableau_says(name):
    """Against Newton's iteration in other arithmetic; the second step starts from the first."""
    for top, y, h in steps_to_take():
        if name == "implicit_midpoint" and h > 1 and isinstance(top, LagrangeTop):
            continue  # there the step has three solutions; see test_midpoint_solves_its_equation
        middle = newton_reference(top, y, h, STAGES[name])[0]
        expected = newton_reference(top, middle, h, STAGES[name])[0]
        z = prepare(top, y, h, name).advance(y, 2)
        assert metrics.scaled_error(top, y, z, expected) < 64 * EPS, (top, h)


@pytest.mark.parametrize("name", STAGES)
def test_no_step_is_an_error(name):
    """A fast top turns ten times in a step, and the step is taken if it is unique."""
    y = np.concatenate((10 * Y0[:3], Y0[3:]))
    assert np.isfinite(prepare(CHARGED, y, 0.3, name).advance(y, 10)).all()
    if name in GAUSS:
        top, y = TOPS["fast"].top, TOPS["fast"].state
        stepper = prepare(top, y, 2.5, name)
        assert np.max(drift(top, y, stepper.advance(y, 10))) < 1e-12
        assert stepper.work.iterations < 130, "Newton's method takes over"
    if name != "implicit_midpoint":
        with pytest.raises(StepError, match="several solutions"):
            prepare(TOP, Y0, 7.0, name)
    for top in (LagrangeTop(0.0), CHARGED):
        with pytest.raises(StepError, match="time scale"):
            prepare(top, Y0, 1e9, name)


@pytest.mark.parametrize("name", ["implicit_midpoint", "gauss4"])
def test_solutions_beyond_a_fold_are_refused(name):
    """A step that is taken has det(1 − h A f') > 0; of random long steps some lie beyond, and some are not solved."""
    top, folded, unsolved = CHARGED, 0, 0
    for k, y in enumerate(starts(400)):
        if folded and k > 20:
            break
        try:
            z = prepare(top, y, 8.0, name).advance(y, 1)
        except StepError as error:
            folded += "several solutions" in str(error)
            unsolved += "not solved after 500 iterations" in str(error)
            continue
        expected, det = newton_reference(top, y, 8.0, STAGES[name])
        if expected is not None and metrics.scaled_error(top, y, z, expected) < 1e-9:
            assert det > 0
    assert folded > 0
    assert unsolved > 0


@pytest.mark.parametrize("contraction", [0.9, 30.0])
def test_midpoint_solves_its_equation_or_says_why_not(contraction):
    """To round-off, a few ulp times the length of the step. With a contraction below 1 the step is unique: no excuse."""
    draw, refused = np.random.default_rng(7), []
    for _ in range(20):
        y = draw.normal(size=6) * draw.choice([0.1, 1.0, 10.0])
        top = LagrangeTop(draw.normal())
        h = 2 * np.sqrt(contraction / abs(top.alpha) / np.linalg.norm(y[3:]))
        try:
            z = prepare(top, y, h, "implicit_midpoint").advance(y, 1)
        except StepError as error:
            refused.append(error.reason)
            continue
        rate, size, _ = top.scales(y)
        residual = np.abs(z - y - h * top.rhs((y + z) / 2)) / np.repeat((rate, size), 3)
        assert np.max(residual) < 16 * EPS * (1 + h * rate) ** 2
    assert bool(refused) == (contraction > 1)
    assert all("three solutions" in reason or "over 100 times the time" in reason for reason in refused)


def hat(v):
    """The matrix of v×, in any kind of number."""
    zero = 0 * v[0]
    return np.array(((zero, -v[2], v[1]), (v[2], zero, -v[0]), (-v[1], v[0], zero)))


FIELDS = {  # formulas that other tests use too: they are compiled once for all
    "uniform": TOP,
    "quadratic": PerturbedTop(LagrangeTop(1.0), TIDE, (0.8, 0.6, -0.4, 0.7)),
}


@pytest.mark.parametrize("top", FIELDS.values(), ids=FIELDS)
def test_kahan_is_the_polarised_step_and_refuses_its_poles(top):
    """ỹ = y + h (1 − (h/2) f')⁻¹ f. A pole passed between 0 and h leaves det ≤ 0, or a real eigenvalue of D ≤ 0."""
    refused, taken = 0, 0
    for y in starts(80):
        for h in (0.3, -1.0, 2.5):
            D = np.eye(6) - h / 2 * top.jacobian(y)
            small = np.eye(3) - h / 2 * hat(y[:3]) + h * h / 4 * hat(y[3:]) @ top.jacobian(y)[:3, 3:]
            eigenvalues = np.linalg.eigvals(small)
            near = 1 - h * h * y[5] / 4 if isinstance(top, LagrangeTop) else 1.0  # its first pole
            try:
                z = prepare(top, y, h, "kahan").advance(y, 1)
            except StepError:
                e1, e2 = np.trace(small), (np.trace(small) ** 2 - np.trace(small @ small)) / 2
                assert min(np.linalg.det(D), near, e1, e2) < 1e-12
                refused += 1
                continue
            assert near > 0
            assert np.all(eigenvalues.real[np.abs(eigenvalues.imag) < 1e-12] > 0)
            taken += 1
            expected = y + h * np.linalg.solve(D, top.rhs(y))
            assert metrics.scaled_error(top, y, z, expected) < 64 * EPS * np.linalg.cond(D)
    assert refused > 5
    assert taken > 150
