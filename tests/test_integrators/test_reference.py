"""The reference solution of a top in any field: against the closed form, against itself, and what it keeps on disk."""

import types

import numpy as np
import pytest
from mpmath import mp, mpf

from lagrange_bench import POTENTIALS, TOPS, LagrangeTop, PerturbedTop, Potential, Problem, StepError, cos, exact, exp
from lagrange_bench.integrators import log, reference, sin, sqrt
from lagrange_bench.integrators.problem.system import invariants_of
from lagrange_bench.integrators.truth import truths
from tests.reference import as_mpf, errors, largest

Y0 = np.array((0.3, -0.4, 1.2, 0.48, 0.6, 0.64))
FALLING = (2.0, 0.0, 0.0, 1.0)  # strength and place of a charge on the sphere that attracts


KINDS = {
    **POTENTIALS,
    "none": Potential("none", lambda x1, x2, x3, p: 0.0),
    "square": Potential("square", lambda x1, x2, x3, p: p[0] * x1 * x1 / 2),
    # heyoka must not turn a division by a double into a product with its rounded reciprocal
    "divided": Potential("divided", lambda x1, x2, x3, p: x1 * (x1 / 0.6) - (-x3) / p[0]),
}


def top(kind, alpha=1.0, parameters=()):
    return PerturbedTop(LagrangeTop(alpha), KINDS[kind], parameters)


QUADRATIC, CHARGED = top("square", 1.0, (0.3,)), top("charge", 1.0, (-0.125, 2.0, 0.1, 0.2))
DIVIDED = top("divided", 1.0, (0.7,))
DRIVEN = Problem(
    "driven",
    "e3",
    lambda t, y, p: y[:3] @ y[:3] / 2 + (1 + sin(t)) * y[5] + exp(y[3] / 4) * log(3 + y[4] * cos(t)),
)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A cache of its own for every test, on disk and in memory."""
    monkeypatch.setenv("LAGRANGE_BENCH_CACHE", str(tmp_path))
    monkeypatch.setattr(reference, "_memory", {})
    return tmp_path / "reference"


@pytest.fixture
def quadruple():
    """For tests that are too long for FLINT."""
    if "heyoka" not in reference.engines():
        pytest.skip("heyoka is not here, or without real128")


@pytest.fixture(params=["heyoka", "flint"])
def engine(request):
    if request.param not in reference.engines():
        pytest.skip("heyoka is not here, or without real128")
    return request.param


def digits(found):
    """states + tail as mpf."""
    with mp.workdps(40):
        return as_mpf(found.states) + as_mpf(found.tail)


def distance(problem, found, wanted, y0=Y0):
    """Largest error of each state in the scales of J and x."""
    return errors(problem, y0, digits(found), wanted)


@pytest.mark.parametrize("name", ["generic", "slow", "near_separatrix", "hanging", "weightless"])
def test_the_closed_form_of_the_top(engine, name):
    """And the estimate bounds the error."""
    named, times = TOPS[name], (20.0, -3.5, 0.0, 0.1, 20.0) if engine == "heyoka" else (3.0, -1.0, 0.0)
    problem, t = top("none", named.alpha), np.array(times) * min(named.top.scales(named.state)[2], 9)
    found = reference.solution(problem, named.state, t, engine)
    errors = distance(problem, found, exact.solution(named.top, named.state, t, digits=36), named.state)
    assert all(a <= b < 1e-25 for a, b in zip(errors, found.error, strict=True))
    assert found.engine == engine
    assert found.states[2].tolist() == named.state.tolist()


def invariants(problem, found):
    """H, C1, C2 to 40 digits."""
    values = invariants_of(problem.system, ("H", "C1", "C2"), ())
    with mp.workdps(40):
        return [values(0.0, *y, *map(mpf, problem.numbers)) for y in digits(found)]


@pytest.mark.parametrize(
    "problem", [QUADRATIC, CHARGED, DIVIDED, DRIVEN], ids=["quadratic", "charge", "divided", "driven"]
)
def test_the_engines_agree_and_keep_energy_and_casimirs(quadruple, problem):
    """And their estimates bound how far they are apart."""
    one, two = (reference.solution(problem, Y0, [0.0, 0.25, -0.2], engine) for engine in ("heyoka", "flint"))
    apart = distance(problem, one, digits(two))
    assert largest(apart) < 1e-30
    assert all(a <= b + c for a, b, c in zip(apart, one.error, two.error, strict=True))
    assert (one.engine, two.engine) == ("heyoka", "flint")
    if problem is DRIVEN:  # its energy changes
        return
    later = invariants(problem, one) + invariants(problem, reference.solution(problem, Y0, [15.0, -15.0]))
    assert largest([a - b for row in later for a, b in zip(row, later[0], strict=True)]) < 1e-28


def test_the_estimate_bounds_the_error_where_half_the_digits_are_lost(quadruple):
    """Next to the separatrix."""
    y0, t = TOPS["homoclinic"].state + 2.0**-28 * np.eye(6)[0], np.array((30.0, 50.0))
    found = reference.solution(top("none"), y0, t)
    actual = distance(top("none"), found, exact.solution(LagrangeTop(1.0), y0, t, digits=36), y0)
    assert all(a <= b <= 1e8 * a for a, b in zip(actual, found.error, strict=True))
    assert max(actual) > 1e-28


@pytest.fixture
def counted(monkeypatch):
    """The runs that are made from here on."""
    runs = []
    run = reference.Orbit.run
    monkeypatch.setattr(reference.Orbit, "run", lambda self, *rest: runs.append(rest) or run(self, *rest))
    return runs


def asked(engine="flint", t=(0.5, 1.0), problem=QUADRATIC):
    return reference.solution(problem, Y0, t, engine)


def same(one, two):
    return all(getattr(one, k).tobytes() == getattr(two, k).tobytes() for k in ("states", "tail", "error"))


def test_what_is_kept_has_the_same_bits(folder, counted, monkeypatch):
    first = asked()
    assert len(counted) == 2  # the solution and its check
    assert same(asked(), first)
    monkeypatch.setattr(reference, "_memory", {})  # another process
    assert same(asked(), first)
    assert len(counted) == 2
    assert len(list(folder.iterdir())) == 1
    with pytest.raises(ValueError, match="read-only"):
        first.states[0, 0] = 0.0
    asked(t=(0.5, 1.0 + 2.0**-52))
    asked(problem=top("square", 1.0, (0.3 + 2.0**-50,)))
    assert len(counted) == 6
    one, two = (asked(problem=DRIVEN.starting_at(t), t=[0.5]) for t in (0.0, 1.0))
    assert not same(one, two), "the time at the start counts"


def test_a_lost_state_is_no_truth(monkeypatch):
    lost = types.SimpleNamespace(states=np.tile(Y0, (3, 1)), tail=np.zeros((3, 6)), error=np.array([0.0, 1e-13, 1e-9]))
    monkeypatch.setattr(reference, "solution", lambda *asked: lost)
    states = truths.solution(QUADRATIC, Y0, np.array([0.5, 1.0, 1.5]))
    assert np.isnan(states).all(axis=1).tolist() == [False, False, True]


def test_a_damaged_file_is_written_anew(folder, counted, monkeypatch):
    first = asked()
    (file,) = folder.iterdir()
    good = file.read_bytes()
    for runs, damaged in ((4, good[:-1] + bytes([good[-1] ^ 1])), (6, good[:-8])):
        file.write_bytes(damaged)
        monkeypatch.setattr(reference, "_memory", {})
        assert same(asked(), first)
        assert len(counted) == runs
        assert file.read_bytes() == good


CORNER = PerturbedTop(LagrangeTop(1.0), Potential("corner", lambda x1, x2, x3, p: sqrt(x1 * x1)))


def test_what_cannot_be_followed():
    with pytest.raises(StepError, match=r"\|t\| = 1e\+12 is over 1e\+09 time scales"):
        asked(t=(1e12,))
    with pytest.raises(StepError, match="the potential corner has corners"):
        reference.solution(CORNER, Y0, [1.0])


@pytest.mark.parametrize("engine", ["heyoka", pytest.param("flint", marks=pytest.mark.slow)], indirect=True)
def test_singularities(engine, monkeypatch):
    """From (0.6, 0, 0.8) at rest the axis falls straight into the charge; its distance is about (t1 - t)^(2/3)."""
    monkeypatch.setattr(reference, "SHORTEST", 1e-6)
    falling = top("charge", 1.0, FALLING)
    with pytest.raises(ValueError, match="the potential charge is not finite at x"):
        reference.solution(falling, (0.1, 0.2, 0.3, 0.0, 0.0, 1.0), [1.0], engine)
    still = (0.0, 0.0, 0.0, 0.6, 0.0, 0.8)
    with pytest.raises(StepError, match=r"reference: the motion runs into a singularity at t = 0\.\d+") as one:
        reference.solution(falling, still, [3.0], engine)
    time = float(one.value.reason.rpartition("= ")[2])
    early = reference.solution(falling, still, [time - 1e-3], engine).states[0]
    assert np.linalg.norm(early[3:] - FALLING[1:]) == pytest.approx((4.5 * 2 * 1e-6) ** (1 / 3), rel=0.01)


def test_the_rest_of_a_time_is_led_over_by_one_term_only_where_it_suffices():
    """At a time that 26 bits cannot hold, by half of their last place."""
    top, t = PerturbedTop(LagrangeTop(1.0), POTENTIALS["tide"], (0.5, 0.8, 0.0, 0.6)), np.array((100.0 + 0.95e-6,))
    assert largest(truths.solution(top, Y0, t) - reference.solution(top, Y0, t).states) < 1e-14
