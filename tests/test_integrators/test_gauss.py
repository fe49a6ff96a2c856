"""Gauss collocation and the collective midpoint rule: coefficients, solvers, round-off, and what they coincide with."""

from fractions import Fraction

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import metrics, states
from lagrange_bench.integrators import METHODS, TOPS, LagrangeTop, StepError, prepare
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.methods import collective_midpoint, gauss, gauss_coefficients

TOP, Y0 = TOPS["generic"].top, TOPS["generic"].state
EPS = np.finfo(float).eps
STAGES = {"gauss4": 2, "gauss6": 3, "gauss8": 4, "gauss12": 6}
CASES = ("generic", "figure1", "fast", "slow", "random000", "random001")


# ---------------------------------------------------------------- coefficients


def order_defect(c, b, A):
    """Largest defect of B(2s): Σ b c^(k−1) = 1/k, and C(s): Σ_j a_ij c_j^(k−1) = c_i^k/k."""
    s = len(c)
    B = [abs(sum(b[j] * c[j] ** (k - 1) for j in range(s)) - Fraction(1, k)) for k in range(1, 2 * s + 1)]
    C = [
        abs(sum(A[i][j] * c[j] ** (k - 1) for j in range(s)) - c[i] ** k / k) for k in range(1, s + 1) for i in range(s)
    ]
    return float(max(B + C))


@pytest.mark.parametrize("s", STAGES.values())
def test_order_conditions(s):
    """In exact fractions; B(2s) and C(s) give order 2s (Butcher)."""
    c, b, mu = gauss_coefficients.tableau(s)
    A = [[mu[i][j] * b[j] for j in range(s)] for i in range(s)]
    assert order_defect(c, b, A) < 1e-32
    nodes, weights = np.polynomial.legendre.leggauss(s)
    assert np.allclose(np.array(c, dtype=float), (1 + nodes) / 2, rtol=0, atol=4 * EPS)
    assert np.allclose(np.array(b, dtype=float), weights / 2, rtol=0, atol=4 * EPS)
    A[0][-1] += Fraction(1, 10**12)  # a wrong digit is seen
    assert order_defect(c, b, A) > 1e-13


@pytest.mark.parametrize("s", STAGES.values())
def test_doubles_keep_the_structure(s):
    """μ + μᵀ = 1 (quadratic invariants) and the symmetry of the nodes hold without any rounding."""
    b, mu, nu, ahead = gauss.matrices(s)
    assert np.array_equal(mu + mu.T, np.ones((s, s)))
    assert np.array_equal(mu + mu[::-1, ::-1], np.ones((s, s)))
    assert np.array_equal(b, b[::-1])
    assert np.max(np.abs(nu @ mu - np.eye(s))) < 64 * EPS
    c = np.array(gauss_coefficients.tableau(s)[0], dtype=float)
    for k in range(s):  # a polynomial of degree s − 1 is extrapolated exactly
        assert np.allclose(ahead @ (b * c**k), b * (1 + c) ** k, rtol=1e-9)
    A = mu * b
    assert np.max(np.abs(np.linalg.eigvals(A))) <= gauss.RADIUS[s]


# ---------------------------------------------------------------- the step, from its definition


def jacobian(top, h, A, Y):
    s = len(A)
    D = np.eye(6 * s)
    for i in range(s):
        for j in range(s):
            D[6 * i : 6 * i + 6, 6 * j : 6 * j + 6] -= h * A[i, j] * top.jacobian(Y[j])
    return D


def newton_reference(top, y, h, s, start=None):
    """The step by Newton's iteration on all 6s equations Y = y + h A f(Y), from stages `start` (s, 6)."""
    c, b, mu = gauss_coefficients.tableau(s)
    A = np.array([[float(m * w) for m, w in zip(row, b, strict=True)] for row in mu])
    Y = np.tile(y, (s, 1)) if start is None else start
    for _ in range(60):
        R = Y - y - h * A @ top.rhs(Y)
        change = np.linalg.solve(jacobian(top, h, A, Y), R.ravel()).reshape(s, 6)
        Y = Y - change
        if np.max(np.abs(change)) < 1e-14 * np.max(np.abs(Y)):
            return y + h * np.array(b, dtype=float) @ top.rhs(Y)
    return None


@pytest.mark.parametrize("span", [0.05, -0.3, 1.0, 2.5])
@pytest.mark.parametrize("name", STAGES)
def test_step_is_what_the_tableau_says(name, span):
    """All solvers, against Newton's iteration on the unreduced equations; the second step starts from the first."""
    for case in CASES:
        top, y = states.find(case)
        h = span * top.scales(y)[2]
        expected = newton_reference(top, newton_reference(top, y, h, STAGES[name]), h, STAGES[name])
        for solver in ("auto", "newton", "fixed_point") if abs(span) <= 1 else ("auto", "newton"):
            z = prepare(top, y, h, name, solver=solver).advance(y, 2)
            assert metrics.scaled_error(top, y, z, expected) < 64 * EPS, (case, solver)


@pytest.mark.parametrize("name", STAGES)
def test_fixed_point_and_newton_take_the_same_step(name):
    for compensated in (False, True):
        a, b = (
            prepare(TOP, Y0, 0.1, name, solver=solver, compensated=compensated).advance(Y0, 1000)
            for solver in ("newton", "fixed_point")
        )
        assert metrics.scaled_error(TOP, Y0, a, b) < 1e-12  # 1000 steps of a few ulp, phases growing linearly


@pytest.mark.parametrize("name", STAGES)
def test_starting_values_change_no_more_than_rounding(name):
    """A new call starts from the state, not from the last step: other iterates, the same step."""
    stepper = prepare(TOP, Y0, 0.2, name)
    once = stepper.advance(Y0, 50)
    twice = stepper.advance(stepper.advance(Y0, 25), 25)
    assert metrics.scaled_error(TOP, Y0, once, twice) < 1e-14
    first = prepare(TOP, Y0, 0.2, name)
    first.advance(Y0, 1)
    assert stepper.work.iterations / stepper.work.steps < first.work.iterations  # and they pay
    assert stepper.work.rhs_evals == STAGES[name] * stepper.work.iterations


@pytest.mark.parametrize(("name", "p"), [("gauss4", 5), ("gauss6", 7)])
def test_gauss_is_not_poisson(name, p):
    """The defect of one step is O(h^p), not zero: what the record does not claim is not so."""

    def defect(h):
        return metrics.poisson_defect(lambda y: prepare(TOP, y, h, name).advance(y, 1), TOP, Y0).defect

    large, small = defect(0.2), defect(0.1)
    assert small > 1e-11
    assert abs(np.log2(large / small) - p) < 0.5


# ---------------------------------------------------------------- where there is no step


@pytest.mark.parametrize("name", STAGES)
def test_no_convergence_is_an_error(name):
    """A fast top turns ten times in a step: the fixed point diverges, Newton solves it."""
    top, y = TOPS["fast"].top, TOPS["fast"].state
    h = 3.0
    message = rf"{name} at h = 3, step 0: .*500 iterations.*residual"
    with pytest.raises(StepError, match=message):
        prepare(top, y, h, name, solver="fixed_point").advance(y, 1)
    z = prepare(top, y, h, name).advance(y, 100)
    drift = metrics.relative_drift(top.invariants(np.stack((y, z))), top.invariant_scales(y))
    assert np.max(np.abs(drift)) < 1e-12


@pytest.mark.parametrize("name", [*STAGES, "collective_midpoint"])
def test_steps_too_large_are_refused(name):
    with pytest.raises(StepError, match="several solutions"):
        prepare(TOP, Y0, 7.0, name)
    with pytest.raises(StepError, match="time scale"):
        prepare(LagrangeTop(0.0), Y0, 1e9, name)


@pytest.mark.parametrize("solver", ["Newton", "", None, True])
@pytest.mark.parametrize("name", ["gauss6", "collective_midpoint"])
def test_unknown_solvers_are_refused(name, solver):
    with pytest.raises(ValueError, match=r"^solver must be"):
        prepare(TOP, Y0, 0.1, name, solver=solver)
    with pytest.raises(ValueError, match=r"^compensated must be"):
        prepare(TOP, Y0, 0.1, "gauss4", compensated=1)


def solutions(kappa, angle, spin, tries=60):
    """Steps of two stages that Newton's iteration finds for a planar pendulum, h = |x| = 1, alpha = kappa, from random starts."""
    draw = np.random.default_rng(3)
    y = np.array((0.0, spin, 0.0, np.sin(angle), 0.0, np.cos(angle)))
    found = []
    for _ in range(tries):
        a = draw.uniform(-2.5, 2.5, size=2)
        start = np.tile(y, (2, 1))
        start[:, 3], start[:, 5] = np.sin(a), np.cos(a)
        z = newton_reference(LagrangeTop(kappa), y, 1.0, 2, start)
        if z is not None and all(np.max(np.abs(z - other)) > 1e-6 for other in found):
            found.append(z)
    return found


def test_uniqueness_ends_where_it_is_said_to():
    """Near the first fold of two stages (a planar pendulum, nearly upright): one solution below the bound, three above."""
    assert 11.5 < gauss.UNIQUE[2] < 12.0
    assert len(solutions(11.5, 0.25, -7 / 30)) == 1
    assert len(solutions(12.0, 0.25, -7 / 30)) == 3


# ---------------------------------------------------------------- round-off


def growth(build, n, span, tops=states.RANDOM[:8]):
    """Exponents of the growth of H, C1, C2 over the last two decades."""
    errors = []
    for name in tops:
        top, y = states.find(name)
        rows = build(top, y, span * top.scales(y)[2]).record(y, n, n // 500)
        errors.append(metrics.relative_drift(top.invariants(rows), top.invariant_scales(y)))
    return [metrics.growth_exponent(np.arange(501.0), np.array(errors)[:, :, k]).p for k in (0, 2, 3)]


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize(("name", "span"), [("gauss4", 0.1), ("gauss4", 0.5), ("gauss8", 0.25), ("gauss12", 0.25)])
def test_errors_walk_at_random(name, span, compensated):
    """Brouwer's law: ½, not 1."""
    found = growth(lambda top, y, h: METHODS[name].prepare_for(top)(top, y, h, compensated=compensated), 100_000, span)
    assert max(found) < 0.8  # over 10⁷ steps of 0.1 … 0.5 the exponents are 0.30 … 0.67


def test_compensated_sums_lose_less():
    lost = []
    for compensated in (False, True):
        rows = prepare(TOP, Y0, 0.1, "gauss8", compensated=compensated).record(Y0, 200_000, 2000)
        lost.append(np.max(np.abs(metrics.relative_drift(TOP.invariants(rows), TOP.invariant_scales(Y0))), axis=0))
    assert np.all(lost[1][[0, 2, 3]] < 0.4 * lost[0][[0, 2, 3]])


def test_coefficients_off_by_an_ulp_would_drift():
    """Negative control: μ + μᵀ = 1 + 2⁻⁵⁰, as it comes out of rounded a and b."""

    def build(top, y, h):
        stepper = METHODS["gauss4"].prepare_for(top)(top, y, h, compensated=True)
        stepper.constants[gauss.BETA + 4 + 1] += 2.0**-50
        return stepper

    assert max(growth(build, 100_000, 0.5)) > 0.9


def test_a_slow_fixed_point_would_drift():
    """Why Newton takes over: at a contraction of 0.4 the iteration stops on the side it comes from."""
    found = growth(lambda top, y, h: METHODS["gauss4"].prepare_for(top)(top, y, h, solver="fixed_point"), 100_000, 1.5)
    assert max(found) > 0.85


def test_collective_midpoint_walks_at_random():
    for solver in ("auto", "fixed_point"):
        found = growth(
            lambda top, y, h, solver=solver: METHODS["collective_midpoint"].prepare_for(top)(top, y, h, solver=solver),
            100_000,
            0.25,
        )
        assert max(found[1:]) < 0.75


@jit
def kick_off_by_an_ulp(s, c, tally):
    J1, J2, J3, x1, x2, x3 = collective_midpoint.step(s, c, tally, True)
    return J1 + 2.0**-52 * (J1 - s[0]), J2 + 2.0**-52 * (J2 - s[1]), J3, x1, x2, x3


def test_two_roundings_of_the_kick_would_drift():
    """Negative control: C2, when the constant that kicks J is not the one in the equation for u."""

    def build(top, y, h):
        return FixedStepper("sabotaged", h, np.array((0.25 * h, h * top.alpha)), kick_off_by_an_ulp)

    assert growth(build, 100_000, 1.0)[2] > 0.9


# ---------------------------------------------------------------- what coincides with the midpoint rule


def energy_of(top, z, quartic):
    return top.invariants(z)[0] + quartic * z[5] ** 4


def gradient_of(top, z, quartic):
    return top.gradients(z)[0] + np.array((0, 0, 0, 0, 0, 4 * quartic * z[5] ** 3))


def gonzalez(top, a, b, quartic):
    """Gonzalez's midpoint discrete gradient."""
    g, d = gradient_of(top, (a + b) / 2, quartic), b - a
    if not np.any(d):
        return g
    return g + (energy_of(top, b, quartic) - energy_of(top, a, quartic) - g @ d) / (d @ d) * d


def averaged(top, a, b, quartic):
    """∫ ∇H along the segment from a to b."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    return sum(
        w / 2 * gradient_of(top, a + (1 + t) / 2 * (b - a), quartic) for t, w in zip(nodes, weights, strict=True)
    )


def midpoint_gradient(top, a, b, quartic):
    return gradient_of(top, (a + b) / 2, quartic)


def discrete_gradient_step(gradient, top, y, h, quartic=0.0):
    """ỹ = y + h P((y + ỹ)/2) g(y, ỹ), iterated."""
    z = y
    for _ in range(40):
        z = y + h * top.poisson((y + z) / 2) @ gradient(top, y, z, quartic)
    return z


@pytest.mark.parametrize("gradient", [gonzalez, averaged])
def test_discrete_gradients_are_the_midpoint_rule(gradient):
    """∇H is affine: its discrete gradients are its value at the midpoint. With x3⁴ in the energy they are not."""
    for case in CASES:
        top, y = states.find(case)
        h = 0.3 * top.scales(y)[2]
        expected = prepare(top, y, h, "implicit_midpoint").advance(y, 1)
        assert metrics.scaled_error(top, y, discrete_gradient_step(gradient, top, y, h), expected) < 16 * EPS
    other = [discrete_gradient_step(g, TOP, Y0, 0.3, quartic=1.0) for g in (gradient, midpoint_gradient)]
    assert metrics.scaled_error(TOP, Y0, *other) > 1e-6


# ---------------------------------------------------------------- the collective midpoint rule, on quaternions


def times(a, b):
    v = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array((a[0] * b[0] - a[1:] @ b[1:], *v))


def conjugate(a):
    return a * np.array((1, -1, -1, -1))


E3 = np.array((0.0, 0, 0, 1))


def project(q, p):
    """(J, x) of a pair of quaternions."""
    return np.concatenate((0.5 * times(p, conjugate(q))[1:], times(times(q, E3), conjugate(q))[1:]))


def lift(y, angle, shift):
    """(q, p) over (J, x): the turn that takes e3 to x, then along the fibre."""
    size = np.linalg.norm(y[3:])
    half = np.array((1 + y[5] / size, *np.cross((0, 0, 1), y[3:] / size)))
    q = np.sqrt(size) * times(half / np.linalg.norm(half), np.array((np.cos(angle), 0, 0, np.sin(angle))))
    return q, times(np.array((0, *(2 * y[:3]))), q) / size + shift * q


def lifted_step(top, y, h, angle, shift, force=2.0):
    """The implicit midpoint rule for q' = ½Jq, p' = ½Jp + 2 alpha kqk, iterated."""
    q, p = lift(y, angle, shift)
    Q, P = q, p
    for _ in range(40):
        J = np.array((0, *project(Q, P)[:3]))
        f = 0.5 * times(J, Q)
        g = 0.5 * times(J, P) + force * top.alpha * times(times(E3, Q), E3)
        Q, P = q + 0.5 * h * f, p + 0.5 * h * g
    return project(2 * Q - q, 2 * P - p)


@pytest.mark.parametrize("span", [0.1, -0.7])
def test_collective_midpoint_is_the_midpoint_rule_of_any_lift(span):
    for case in CASES:
        top, y = states.find(case)
        h = span * top.scales(y)[2]
        assert metrics.scaled_error(top, y, project(*lift(y, 0.3, 0.2)), y) < 8 * EPS
        for solver in ("auto", "newton", "fixed_point"):
            z = prepare(top, y, h, "collective_midpoint", solver=solver).advance(y, 1)
            for angle, shift in ((0.0, 0.0), (0.8, 0.0), (-2.0, 1.5)):
                assert metrics.scaled_error(top, y, lifted_step(top, y, h, angle, shift), z) < 64 * EPS
        assert metrics.scaled_error(top, y, lifted_step(top, y, h, 0.0, 0.0, force=1.99), z) > 1e-6


def test_collective_midpoint_solves_its_equation_wherever_it_is_unique():
    """Random tops up to the bound, with h|J| from 0.1 to 100: Newton's iteration never fails, and C2 stays."""
    draw = np.random.default_rng(5)
    for _ in range(200):
        x = draw.normal(size=3)
        y = np.concatenate((draw.normal(size=3) * 10 ** draw.uniform(-1, 2), x))
        top = LagrangeTop(draw.uniform(-1, 1) * collective_midpoint.UNIQUE / np.linalg.norm(x))
        z = prepare(top, y, 1.0, "collective_midpoint", solver="newton").advance(y, 1)
        drift = metrics.relative_drift(top.invariants(np.stack((y, z))), top.invariant_scales(y))
        assert np.max(np.abs(drift[1, 1:])) < 32 * EPS
