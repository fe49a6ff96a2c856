"""`Diagnosis`: a mistake is named with its number, two mistakes both; a right run has no finding. The matrix is mistakes.py."""

import hashlib
from importlib.metadata import version

import mistakes
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lagrange_bench import CASES, Case, RigidBody
from lagrange_bench.judging.diagnosis import Diagnosis, Rows
from lagrange_bench.judging.fits import Model, choose, maps

FRESH = int(hashlib.sha256(version("lagrange-bench").encode()).hexdigest()[:8], 16)  # other runs in each release
TUMBLING = RigidBody(1.0, (0, 0, 0), [[0.9, 0.1, 0], [0.1, 1.1, 0.15], [0, 0.15, 1.6]], (0, 0, 0))
START = Case("tumbling", TUMBLING, (1, 0, 0, 0), (3.0, 1.0, -2.0))
T = np.arange(150) / 60


def program(case=START, integrator="exact", **physics):
    """Rows of a program, and the exact motion."""
    wrong, exact = mistakes.Program(case)._replace(**physics), mistakes.exact_motion(mistakes.Program(case), 4.0)
    if integrator == "exact":
        x, R, omega = mistakes.exact_motion(wrong, 4.0)(T)
    else:
        x, R, omega = mistakes.poor_motion(wrong, T, 1, integrator == "rk4")
    return Rows(T, R, omega, x), exact


def found(rows, case=START, exact=None):
    return Diagnosis(rows, {}, case.body, exact).findings()


@pytest.mark.parametrize("with_case", [True, False])
@pytest.mark.parametrize("mistake", mistakes.MISTAKES)
def test_a_mistake_is_named(mistake, with_case):
    """In the first or in the second run, for not every run shows it."""
    if mistakes.causes_of(mistake, with_case):
        assert any(mistakes.power(mistake, with_case, 1, seed) for seed in (0, 1))


def test_the_number_of_the_cause_is_in_its_sentence():
    for change, integrator, words in (
        ({"damping": 0.05}, "exact", "L decays like exp(−0.05 t): damping"),
        ({"torque": 0.0}, "exact", "the program leaves out the gyroscopic torque ω × I ω"),
        ({"cap": np.radians(100)}, "euler", "|ω| falls from 3.742 to 1.7453 rad/s (100 °/s) in the first step"),
        (
            {"case": mistakes.with_body(mistakes.Program(START), inertia_com=(1.2, 1.0, 1.4)).case},
            "exact",
            "the rows keep the",
        ),
    ):
        rows, exact = program(integrator=integrator, **change)
        for known in (exact, None):
            finding, *others = found(rows, exact=known)
            assert words in finding.text, finding.text
            assert [each.cause for each in others] == ["omega-half-step"] * (integrator == "euler")
            assert 0 <= finding.after < 0.1 * finding.before


def test_a_body_that_the_rows_keep_the_momentum_of_is_named():
    other = mistakes.with_body(mistakes.Program(START), inertia_com=(0.9, 1.1, 1.6)).case
    (finding,) = found(program(case=other)[0])
    assert finding.text == "the products of inertia are left out."
    other = mistakes.with_body(mistakes.Program(START), inertia_com=[[1.0, 0, 0.2], [0, 1.2, 0], [0.2, 0, 1.6]]).case
    (finding,) = found(program(case=other)[0])
    scale = np.linalg.norm([0.9, 1.1, 1.6]) / np.linalg.norm([1.0, 1.2, 1.6])
    moments = ", ".join(f"{scale * v:.4g}" for v in (1.0, 1.2, 1.6))
    assert f"with moments {moments} and products 0, {scale * 0.2:.4g}, 0" in finding.text


def test_two_mistakes_are_both_named():
    rows, exact = program(damping=0.05, torque=0.0)
    assert {each.cause for each in found(rows, exact=exact)} == {"damping", "gyroscopic-torque"}
    rows = rows._replace(omega=np.degrees(rows.omega), R=rows.R.transpose(0, 2, 1))
    causes = [each.cause for each in found(rows, exact=exact)]
    assert {"rotation-transposed", "omega-unit"} <= set(causes)
    assert len(causes) == len(set(causes)) == 3, "no more are told"


def test_semi_implicit_euler_is_named_by_its_step():
    (half, explicit) = found(program(integrator="euler")[0])
    assert (half.cause, explicit.cause) == ("omega-half-step", "explicit-step")
    assert "half a step late: it is what turns the row before" in half.text
    late = float(explicit.text.partition("that of ")[2].partition(" s before")[0])
    assert late == pytest.approx(1 / 120, rel=0.05)
    every_second = Rows(*(column[::2] for column in program(integrator="euler")[0][:4]))
    (part, explicit) = found(every_second)
    assert (part.cause, explicit.cause) == ("omega-half-step", "explicit-step")
    assert float(part.text.split()[2]) == pytest.approx(1 / 120, rel=0.05)


def test_a_fall_along_y_is_told_without_a_start():
    case = CASES["flying_box"]
    rows, exact = program(case)
    up = Rotation.from_rotvec([np.pi / 2, 0, 0]).as_matrix()
    (finding,) = found(Rows(rows.t, x=rows.x @ up), case)
    assert (finding.cause, finding.option) == ("world-axes", "--up=y")
    (finding,) = found(Rows(1e3 * rows.t, x=rows.x), case)
    assert (finding.cause, finding.option) == ("time-unit", "--units t=ms")
    (finding,) = found(Rows(rows.t, x=100 * rows.x), case)
    assert (finding.cause, finding.option) == ("length-unit", "--units position=cm")
    assert found(Rows(rows.t, x=rows.x), case) == []
    s, g = rows.t[:, None], case.body.gravity
    slowed = case.position + 5 * g * s + (case.velocity - 5 * g) * 5 * (1 - np.exp(-s / 5))
    for known in (exact, None):
        (finding,) = found(Rows(rows.t, x=slowed), case, known)
        assert finding.text == "the body flies by v' = g − 0.2 v: linear damping."
    rows, _ = program(CASES["slow"])
    (finding,) = found(rows._replace(t=rows.t / 20), CASES["slow"])
    assert finding.text == "the times have the factor 0.05.", "one clock, no unit of ω and no gravity"


def test_omega_alone_tells_the_law_of_a_free_body():
    rows, exact = program(damping=0.05)
    (finding,) = found(Rows(rows.t, omega=rows.omega))
    assert finding.text == "L decays like exp(−0.05 t): damping."
    rows, exact = program()
    assert found(Rows(rows.t, omega=rows.omega)) == []
    (finding,) = found(Rows(rows.t, omega=np.degrees(rows.omega)), exact=exact)
    assert finding.option == "--units omega=deg/s"


def test_a_right_run_has_no_finding():
    for k in range(30):
        assert mistakes.right_run(np.random.default_rng([0, k])).findings() == []


def test_few_rows_and_rows_at_rest_tell_nothing():
    rows, exact = program()
    assert found(Rows(rows.t[:7], rows.R[:7], -rows.omega[:7]), exact=exact) == []
    still = Case("still", TUMBLING, (1, 0, 0, 0), (0, 0, 0))
    assert found(*program(still)[:1], case=still, exact=program(still)[1]) == []


def test_the_rule_needs_a_clear_and_a_good_model():
    now = Model(0.0, 1.0, "now")
    assert choose([now, Model(1.0, 0.09, "no")], 0.0).winner is None  # 4 · 3 times smaller
    assert choose([now, Model(1.0, 0.08, "yes")], 0.0).winner.value == "yes"
    assert choose([Model(0.0, 9.0, "now"), Model(1.0, 0.2, "no")], 0.0).winner is None  # not good
    assert choose([now, Model(1.0, 0.01, "no")], 0.5).winner is None  # below the floor
    assert choose([], 0.0).winner is None


def test_a_motion_in_a_plane_tells_no_axes():
    a = np.outer(np.linspace(1, 2, 20), [0, 0, 1.0])
    swapped = [model for model in maps(a, a[:, [2, 1, 0]]) if model.misfit < 0.1]
    assert swapped == []


@pytest.mark.slow
@pytest.mark.parametrize(("with_case", "least"), [(True, 0.9), (False, 0.8)])
def test_the_power_of_the_matrix(with_case, least):
    """Two thirds of the runs are always the same, a third is another one in each release."""
    names = [name for name in mistakes.MISTAKES if mistakes.causes_of(name, with_case)]
    counts = [mistakes.power(name, with_case, runs, seed) for name in names for runs, seed in ((4, 1), (2, FRESH))]
    assert sum(counts) >= least * 6 * len(names)


@pytest.mark.slow
def test_the_power_of_pairs():
    count = 0
    for k in range(60):
        rng = np.random.default_rng([35 if k < 40 else FRESH, k])
        count += mistakes.is_named(*mistakes.run(rng, mistakes.pair(rng), True))
    assert count >= 0.7 * 60


@pytest.mark.slow
def test_the_silence_of_400_right_runs():
    """None in the runs that are always the same; of new ones one may be wrong, for no fit is right in any motion."""
    alarms = [
        sum(bool(mistakes.right_run(np.random.default_rng([seed, k])).findings()) for k in range(runs))
        for seed, runs in ((23, 270), (FRESH, 130))
    ]
    assert alarms[0] == 0
    assert alarms[1] <= 1
