"""What `integrate` returns: as a table, in a file, as a picture, and held against the truth."""

import json
import pickle

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from scipy.spatial.transform import Rotation

from lagrange_bench import CASES, PERTURBED_TOPS, TOPS, GaudinMagnet, LagrangeTop, RigidBody, exact, metrics
from lagrange_bench.integrators import integrate, integrate_ensemble
from lagrange_bench.integrators.interface import StepWarning
from lagrange_bench.integrators.problem import examples

pytestmark = pytest.mark.interpreted
NAMED, TIDE = TOPS["generic"], PERTURBED_TOPS["weak_tide"]
MAGNET = GaudinMagnet((0.0, -0.7, 1.1), 0.6).problem()
SPINS = np.array(((0.3, -0.4, 0.8), (0.9, 0.1, -0.2), (-0.3, 0.7, 0.5)))
BODY = CASES["slow"].body
SLOW = BODY.state(rotation=np.eye(3), omega_body=(0.0, 10.0, -4.61538))
FLYING = RigidBody(1.0, (0.0, 0.0, 0.1), (0.1, 0.2, 0.25), fixed=False)
THROWN = FLYING.state(rotation=np.eye(3), omega_body=(1.0, 2.0, 3.0), velocity=(1.0, 0.0, 4.0))
COLUMNS = ["px", "py", "pz", "qw", "qx", "qy", "qz", "wx", "wy", "wz"]
RUNS = {
    "top": ("J1 J2 J3 x1 x2 x3 H J3 C1 C2", NAMED.top, NAMED.state),
    "tide": ("J1 J2 J3 x1 x2 x3 H J3 C1 C2", TIDE.top, TIDE.state),
    "so3": ("J1 J2 J3 H C", *examples.problem("free_body")),
    "spins": ("s1_1 s1_2 s1_3 s2_1 s2_2 s2_3 s3_1 s3_2 s3_3 H C1 C2 C3", MAGNET, SPINS),
    "body": (f"q0 q1 q2 q3 L1 L2 L3 {' '.join(COLUMNS)} H C1 J3 C2", BODY, SLOW),
    "flying": (f"q0 q1 q2 q3 L1 L2 L3 {' '.join(COLUMNS)} vx vy vz H C1 J3", FLYING, THROWN),
}


@pytest.fixture(scope="module")
def runs():
    return {name: integrate(top, y0, 0.01, 20, "rk4", every=5) for name, (_, top, y0) in RUNS.items()}


@pytest.mark.parametrize("name", RUNS)
def test_a_frame_has_time_state_and_invariants(runs, name):
    run, words = runs[name], RUNS[name][0].split()
    frame = run.to_frame(invariants=True)
    n = len(run.columns())
    assert list(frame) == ["t", *dict.fromkeys(words)]
    assert np.array_equal(frame.t, run.t)
    assert np.array_equal(run.to_frame().to_numpy()[:, 1 : 1 + n], run.y.reshape(5, -1)[:, :n])
    assert np.array_equal(frame[words[-1]], run.invariants()[:, -1])
    if "px" in words:
        q = run.rotation.as_quat(canonical=True, scalar_first=True)
        assert np.allclose(frame[COLUMNS], np.hstack((run.position, q, run.omega_body)), rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", RUNS)
def test_the_error_is_the_distance_to_the_truth(runs, name):
    """Also of a run that goes to another process."""
    run = runs[name]
    error, sent = run.error(), pickle.loads(pickle.dumps(run))
    assert error.shape == (5,)
    assert error[0] < 1e-15 < error[-1] < 1e-4  # that of RK4
    assert np.array_equal(sent.error(), error)
    assert (run == run, run == sent) == (True, False)


def test_times_are_multiples_of_h_rounded_once():
    run = integrate(NAMED.top, NAMED.state, 0.1, 3000, "strang", every=3)
    assert np.array_equal(run.t, 0.1 * np.arange(0, 3001, 3))


def test_the_error_of_steps_is_that_at_n_h():
    odd = integrate(NAMED.top, NAMED.state, 0.01, 29)  # in doubles 0.29 / 0.01 is less than 29
    assert odd.error()[-1] < 1e-13
    jumps = integrate(NAMED.top, NAMED.state, t=[1000.0])
    true = exact.solution(NAMED.top, NAMED.state, [1000.0])
    assert np.array_equal(jumps.error(), metrics.scaled_error(NAMED.top, NAMED.state, jumps.y, true))


@pytest.mark.parametrize("name", RUNS)
def test_files_have_every_bit(runs, name, tmp_path):
    run = runs[name]
    lines = run.save(tmp_path / "run.csv", {"mine": "é", "n": np.int64(3)}).read_text("utf-8").splitlines()
    rows = np.loadtxt(lines, delimiter=",", skiprows=1 + sum(line.startswith("#") for line in lines))
    assert np.array_equal(rows, run.to_frame())
    facts = {"method": "rk4", "top": repr(run.top), "y0": run.start.state.tolist(), "h": 0.01, "options": {}}
    if numbers := getattr(run.top, "parameters", ()):
        facts["parameters"] = list(numbers)
    told = dict(line[2:].split(": ", 1) for line in lines if line.startswith("#"))
    assert {key: json.loads(value) for key, value in told.items()} == {**facts, "mine": "é", "n": 3}
    with np.load(run.save(str(tmp_path / "run.npz"))) as data:
        assert np.array_equal(data["y"], run.y)
        assert json.loads(str(data["metadata"])) == facts
    pytest.importorskip("pyarrow")
    assert pd.read_parquet(run.save(tmp_path / "run.parquet")).equals(run.to_frame())


def test_pictures_have_labels_and_name_the_top(runs):
    run = runs["top"]
    for what, lines in (("components", 6), ("invariants", 4), ("error", 1), ("axis", 2)):
        ax = run.plot(what, color="C3")
        assert (len(ax.lines), bool(ax.get_xlabel()), bool(ax.get_ylabel())) == (lines, True, True), what
        assert ax.lines[0].get_color() == "C3"
        plt.close(ax.figure)
    figure, (left, right) = plt.subplots(1, 2)
    assert runs["spins"].plot("error", ax=right) is right
    assert not left.lines
    assert right.get_title().startswith("rk4: Problem('magnet')")
    assert "reference solution" in right.get_ylabel()
    plt.close(figure)


def test_states_that_are_far_apart_are_dots():
    for what in ("axis", "components"):
        for h, style in ((4.0, "None"), (0.1, "-")):
            ax = integrate("generic", h=h, steps=100).plot(what)
            assert ax.lines[0].get_linestyle() == style
            plt.close(ax.figure)
    # NaN where it is behind the sphere
    seen = np.isnan(integrate("generic", h=4.0, steps=100).plot("axis").lines[0].get_data_3d()[0])
    assert 0.1 < seen.mean() < 0.9
    plt.close("all")


def test_every_step_is_recorded_up_to_100_000():
    assert len(integrate("generic", h=0.1, steps=99, method="rk4").t) == 100
    with pytest.warns(StepWarning, match=r"one state in 120 of 120000 steps is recorded, 1001 in all; set every="):
        run = integrate("generic", h=0.1, steps=120_000)
    assert np.array_equal(run.t, 0.1 * (120 * np.arange(1001.0)))


@pytest.mark.parametrize("name", RUNS)
def test_an_ensemble_is_its_motions_with_one_more_axis(runs, name, tmp_path):
    words, top, y0 = RUNS[name]
    together, alone = integrate_ensemble(top, [y0, y0], 0.01, 20, "rk4", every=5), runs[name]
    assert np.array_equal(together.y, np.stack([alone.y, alone.y], axis=1))
    assert np.array_equal(together.t, alone.t)
    frame = together.to_frame(invariants=True)
    assert list(frame) == ["t", "motion", *dict.fromkeys(words.split())]
    for i in (0, 1):
        one = frame[frame.motion == i].drop(columns="motion").reset_index(drop=True)
        assert one.equals(alone.to_frame(invariants=True))
    assert np.array_equal(together.motion(-1).error(), alone.error())
    head = 3 + bool(getattr(top, "parameters", ()))
    rows = np.loadtxt(together.save(tmp_path / "a.csv"), delimiter=",", skiprows=head)
    assert np.array_equal(rows, together.to_frame())
    with pytest.raises(IndexError):
        together.motion(2)


def test_an_ensemble_records_its_end_by_default():
    tops = LagrangeTop(np.array([1.0, 2.0]))
    other = 1.5 * NAMED.state
    end = integrate_ensemble(tops, [NAMED.state, other], 0.1, 4)
    rows = integrate_ensemble(tops, [NAMED.state, other], 0.1, 4, every=2)
    assert (end.y.shape, end.t.tolist(), rows.t.tolist()) == ((1, 2, 6), [0.4], [0.0, 0.2, 0.4])
    assert np.array_equal(end.y[0], rows.y[-1])
    assert np.array_equal(rows.invariants()[:, 1], LagrangeTop(2.0).invariants(rows.y[:, 1]))
    sent = pickle.loads(pickle.dumps(end)).motion(1)
    assert sent.error()[0] < 1e-14


def test_motions_of_bodies_that_failed_are_nan_in_tables(tmp_path):
    together = integrate_ensemble(BODY, np.array([SLOW, SLOW, SLOW]), 1e-3, 4, "rk4", every=2)
    together.y[:, 1], together.y[-1, 2] = np.nan, 1e200  # as on_failure="nan" and a step that is too large leave them
    tables = [together.to_frame(), *(together.motion(place).to_frame() for place in range(3))]
    assert [table[COLUMNS].isna().all(axis=1).sum() for table in tables] == [4, 0, 3, 1]
    assert np.array_equal(tables[0][COLUMNS][::3], tables[1][COLUMNS])
    assert together.save(tmp_path / "run.npz").exists()
    with pytest.raises(ValueError, match="no rotation where the method failed"):
        _ = together.motion(1).position


def test_a_file_that_cannot_be_written(runs, tmp_path):
    with pytest.raises(OSError, match="cannot be written"):
        runs["top"].save("/dev/null/run.csv")
    with pytest.raises(TypeError, match="keys must be"):
        runs["top"].save(tmp_path / "run.csv", {"a": {(1, 2): 3}})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["top", "body"])
def test_a_film_has_the_frames_that_were_asked_for(runs, name, tmp_path):
    """The docs' gallery shows what is drawn; problems without an axis and runs with too few states are refused."""
    film = runs[name].animate(tmp_path / "film.gif", frames=4, seconds=1.0)
    assert film.read_bytes()[:4] == b"GIF8"
    assert film.read_bytes().count(b"\x21\xf9\x04") == 4  # a graphic control extension for each frame
    red, _, blue = plt.imread(film)[..., :3].astype(int).T
    assert np.nonzero(blue > red + 60)[1].mean() < 0.45 * red.shape[1] or name == "body", (
        "the axis of the top points up"
    )
    with pytest.raises(ValueError, match="5 states, fewer than 72 frames: record more"):
        runs[name].animate(tmp_path / "no.gif")
    with pytest.raises(ValueError, match="no axis"):
        runs["so3"].animate(tmp_path / "no.gif", frames=4)


def test_directions_are_the_axis_and_the_principal_axes(runs):
    """The axis of a fixed symmetric body, through its centre of mass, is one of its principal axes."""
    from lagrange_bench.integrators.animation import directions

    top, body = directions(runs["top"]), directions(runs["body"])
    assert np.allclose(top[:, 0], runs["top"].y[:, 3:] / np.linalg.norm(NAMED.state[3:]))
    along = runs["body"].position / np.linalg.norm(BODY.com)
    assert np.allclose(np.max(np.abs(np.einsum("nki,ni->nk", body, along)), axis=1), 1.0)
    ax = runs["body"].plot("axis", plt.figure().add_subplot(projection="3d", azim=60.0))
    assert np.allclose(np.transpose(ax.lines[0].get_data_3d()), along)  # nothing of it is behind the sphere
    plt.close(ax.figure)
    turn = Rotation.from_rotvec((0.3, 0.5, 0.7)).as_matrix()
    tilted = RigidBody(1.0, 0.1 * turn[:, 2], turn @ np.diag((0.1, 0.1, 0.2)) @ turn.T)
    ax = integrate(tilted, tilted.state(rotation=np.eye(3), omega_body=(1, 2, 3)), 0.01, 4, "rk4").plot("axis")
    assert abs(np.ravel(ax.lines[-1].get_data_3d()) @ turn[:, 2]) == pytest.approx(1.0)
    plt.close(ax.figure)
