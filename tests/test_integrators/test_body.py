"""The whole body: attitude, angular velocity, Euler angles and energy of a real top."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import (
    METHODS,
    TOPS,
    HeavyTop,
    LagrangeTop,
    StepError,
    available,
    integrate,
)
from lagrange_bench.integrators.problem import body

# a brass gyroscope: 0.1 kg, 3 cm from the tip to the centre of mass
TOY = HeavyTop(mass=0.1, distance=0.03, gravity=9.81, A=1.5e-4, C=6e-5)
CARRIED = (
    "generic",
    "figure1",
    "near_separatrix",
    "planar_rotation",
    "through_pole",
    "weightless",
    "regular",
    "hanging",
)
START = TOY.state(angles=(0.4, 0.3, 0.0), rates=(0.2, 1.5, 120.0))


def rigid_body(top, t, z):
    """Euler angles of a heavy symmetric top from its Lagrangian, SI units: an independent description."""
    theta, phi, psi, theta_rate, p_phi, p_psi = z
    mgl = top.mass * top.weight * top.distance
    s, c = math.sin(theta), math.cos(theta)
    phi_rate = (p_phi - p_psi * c) / (top.A * s * s)
    psi_rate = p_psi / top.C - phi_rate * c
    force = top.A * phi_rate**2 * s * c - p_psi * phi_rate * s + mgl * s
    return [theta_rate, phi_rate, psi_rate, force / top.A, 0.0, 0.0]


def euler_solution(top, angles, rates, times):
    theta, phi, psi = angles
    theta_rate, phi_rate, psi_rate = rates
    p_psi = top.C * (psi_rate + phi_rate * math.cos(theta))
    p_phi = top.A * phi_rate * math.sin(theta) ** 2 + p_psi * math.cos(theta)
    start = [theta, phi, psi, theta_rate, p_phi, p_psi]
    found = solve_ivp(
        lambda t, z: rigid_body(top, t, z), (0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-12
    )
    return found.y[:3].T


def methods_with_attitude():
    return [name for name in METHODS if METHODS[name].attitude is not None and available(METHODS[name])]


@pytest.mark.parametrize("method", methods_with_attitude())
@pytest.mark.parametrize("h", [1e-3, 0.05])
def test_euler_angles_against_the_lagrangian_equations(method, h):
    angles, rates = (0.4, 0.3, 0.1), (0.2, 1.5, 120.0)
    y0 = TOY.state(angles, rates)
    steps = round(1 / h)
    run = integrate(
        TOY,
        y0,
        h,
        steps,
        method,
        every=steps // 10,
    )
    expected = Rotation.from_euler("ZYZ", euler_solution(TOY, angles, rates, run.t)[:, (1, 0, 2)])
    assert np.max((run.rotation.inv() * expected).magnitude()) < 4e-9  # that of the reference
    assert np.max(np.abs(np.abs(np.sum(run.attitude**2, axis=1)) - 1)) < 1e-14


@pytest.mark.parametrize("name", CARRIED)
@pytest.mark.parametrize("h", [0.1, -0.3, 7.0])
def test_the_axis_is_carried_along(name, h):
    """g e3 ḡ = x/|x| all the way, for steps below and above the nutation period, forwards and backwards."""
    named = TOPS[name]
    unit = named.top.scales(named.state)[2]
    run = integrate(named.top, named.state, h * unit, 100, every=10, attitude=True)
    axis = run.rotation.as_matrix()[:, :, 2]
    x = run.y[:, 3:]
    promise = 2 * (1e-13 + 1e-15 * 100 * abs(h))  # of the exact step, see test_backlund; g and y are two runs of it
    assert np.max(np.abs(axis - x / np.linalg.norm(x, axis=1, keepdims=True))) < promise


@pytest.mark.parametrize("name", CARRIED)
def test_attitudes_at_any_times(name):
    """In any order, on both sides of 0, over many nutations: the methods agree, and with steps."""
    named, unit = TOPS[name], TOPS[name].top.scales(TOPS[name].state)[2]
    t = unit * np.array([3.0, -5.0, 0.1, 0.0, 70.0, 3.0])
    runs = [integrate(named.top, named.state, t=t, method=m, attitude=True).rotation for m in methods_with_attitude()]
    steps = integrate(named.top, named.state, h=10 * unit, steps=7, every=1, attitude=True)
    for run in runs:
        assert np.max((run.inv() * runs[0]).magnitude()) < 2e-12
        assert (run[4].inv() * steps.rotation[-1]).magnitude() < 2e-12


@pytest.mark.parametrize(("h", "steps"), [(40.0, 1), (45.0, 1), (100.0, 4), (1000.0, 1), (-45.0, 2)])
def test_an_unstable_sleeping_top_turns_at_a_constant_rate(h, steps):
    """There is no nutation to divide a long step by."""
    run = integrate(LagrangeTop(1.0), (0.0, 0.0, 1.0, 0.0, 0.0, 1.0), h, steps, attitude=True)
    assert abs(math.remainder(run.euler_angles()[-1, 1] - h * steps, 2 * math.pi)) < 1e-12


def test_a_long_step_to_the_unstable_vertical_is_many_short_ones():
    named = TOPS["homoclinic"]
    coarse = integrate(named.top, named.state, 25.0, 1, attitude=True).attitude[-1]
    fine = integrate(named.top, named.state, 0.5, 50, attitude=True).attitude[-1]
    assert min(np.max(np.abs(fine - coarse)), np.max(np.abs(fine + coarse))) < 1e-6  # round-off grows exponentially
    with pytest.raises(StepError, match="the orbit is unstable"):
        integrate(named.top, named.state, 100.0, 1, attitude=True)


def test_attitude_turns_with_the_angular_velocity():
    """g' ḡ = ω/2, by central differences of order 6."""
    h = 1e-4
    run = integrate(TOY, START, h, 6, every=1, attitude=True)
    g = run.attitude
    rate = (45 * (g[4] - g[2]) - 9 * (g[5] - g[1]) + (g[6] - g[0])) / (60 * h)
    omega = 2 * np.array(body.quaternion_product(rate, g[3] * (1, -1, -1, -1)))
    assert np.allclose(omega[1:], run.omega_world[3], rtol=0, atol=1e-8 * 120)
    assert abs(omega[0]) < 1e-8 * 120


def test_energy_by_hand():
    """½A(θ'² + φ'² sin²θ) + ½C(ψ' + φ' cosθ)² + m g l cosθ, Landau-Lifshitz Mechanics, section 35."""
    theta, rates = 0.4, (0.2, 1.5, 120.0)
    expected = TOY.A / 2 * (rates[0] ** 2 + rates[1] ** 2 * math.sin(theta) ** 2)
    expected += TOY.C / 2 * (rates[2] + rates[1] * math.cos(theta)) ** 2
    expected += TOY.mass * TOY.weight * TOY.distance * math.cos(theta)
    assert math.isclose(TOY.energy(START), expected, rel_tol=1e-14)


@pytest.mark.parametrize("share", [0.98, 1.02])
def test_sleeping_threshold(share):
    """Upright the top sleeps if J3² > 4 alpha: spun 2 % faster it stays within the push, 2 % slower it falls."""
    critical = 2 * math.sqrt(TOY.top.alpha) * TOY.A / TOY.C  # spin, rad/s
    y0 = TOY.state((1e-4, 0.0, 0.0), (0.0, 0.0, share * critical))
    x3 = integrate(TOY, y0, 0.01, 2000, every=1).y[:, 5]
    tilt = math.acos(x3.min())
    assert tilt < 2e-3 if share > 1 else tilt > 0.2


@pytest.mark.parametrize("angles", [(0.4, 0.3, -2.0), (3.0, -3.0, 3.0), (0.0, 0.7, 0.0)])
def test_euler_angles_round_trip(angles):
    """Those of `state` come back; on the vertical phi has all of the turn, and no warning is given."""
    run = integrate(TOY, TOY.state(angles, (0.1, 0.2, 0.3)), t=[0.0])
    assert np.allclose(run.euler_angles(), angles, atol=1e-14)


@pytest.mark.parametrize("attitude", [(1, 0, 0), (2, 0, 0, 0), (1, 0, 0, 0), (math.nan, 0, 0, 1)])
def test_a_wrong_attitude_is_refused(attitude):
    with pytest.raises(ValueError, match="attitude"):
        integrate(TOY, START, 0.01, 10, attitude=attitude)


def test_rates_beyond_the_largest_double_are_refused():
    body = HeavyTop(mass=1.0, distance=1.0, gravity=9.81, A=1.0, C=1.0)
    assert np.isfinite(body.state((1.0, 0.0, 0.0), (0.0, 1e307, 1e307))).all()
    with pytest.raises(ValueError, match="rates are too large"):
        body.state((1.0, 0.0, 0.0), (0.0, 1.7e308, 1.7e308))
