"""The judge can fail a method: maps slightly wrong, records that claim too much, and files that cannot take a step."""

import re
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import check, first_step, states
from lagrange_bench.integrators import METHODS, Claims, LagrangeTop, Problem, RigidBody, StepError
from lagrange_bench.integrators.interface import Stepper
from lagrange_bench.integrators.methods.explicit import explicit_stepper
from lagrange_bench.integrators.problem import examples, kinds
from lagrange_bench.integrators.problem.vibrating_pivot import vibrating_pivot
from lagrange_bench.integrators.registry import find_method
from tests.installed import in_uniform_fields
from tests.mutants import ROOT

HONEST = in_uniform_fields(METHODS["rk45_fixed"])


def wrong(verdicts):
    return {v.claim for v in verdicts if v.passed is False}


def by_claim(verdicts):
    return {v.claim: v for v in verdicts}


class Wrapped(Stepper):
    """A good stepper, to be spoiled by overriding one method."""

    def __init__(self, top, y0, h, name="rk45_fixed"):
        self.inner = METHODS[name].prepare_for(top)(top, y0, h)
        self.h, self.work = h, self.inner.work

    def advance(self, y, n):
        return self.inner.advance(y, n)

    def record(self, y, n, every):
        return self.inner.record(y, n, every)


class Off(Wrapped):
    """A good stepper whose result of a call is spoiled: spoil(y, h, steps)."""

    def __init__(self, name, spoil, *where):
        super().__init__(*where, name)
        self.spoil = spoil

    def advance(self, y, n):
        return self.spoil(self.inner.advance(y, n), self.h, n)

    def record(self, y, n, every):
        rows = self.inner.record(y, n, every)
        return np.array([self.spoil(row, self.h, every * k) if k else row for k, row in enumerate(rows)])


class Bent(Off):
    """Spoiled after each step, so it has no memory."""

    advance = Stepper.advance

    def record(self, y, n, every):
        rows = [y]
        for _ in range(n):
            rows.append(Off.advance(self, rows[-1], 1))
        return np.array(rows[::every])


def off(name, spoil, **changes):
    return in_uniform_fields(METHODS[name], prepare=partial(Off, name, spoil), **changes)


def longer(size):
    """A map that makes x longer by a relative size."""
    return lambda y: y * (1, 1, 1, 1 + size, 1 + size, 1 + size)


BENDS = [
    (lambda y, h, n: y + 1e-8 * np.array((-y[4], y[3], 0, 0, 0, 0)), {"H"}),  # a kick across
    (lambda y, h, n: y + 1e-8 * np.eye(6)[2], {"H", "J3", "C2"}),  # more spin
    (lambda y, h, n: longer(1e-8)(y), {"H", "C1", "C2"}),
]


@pytest.mark.parametrize(("bend", "lost"), BENDS, ids=["kick", "spin", "length"])
def test_a_map_wrong_by_1e_8_loses_its_invariants(bend, lost):
    record = off("implicit_midpoint", bend)
    assert wrong(check.conserves(record, True, check.STATES[:1], 1000)) == {f"conserves {name}" for name in lost}


@pytest.mark.parametrize(("limit", "passed"), [(0.3, None), (0.05, False)])
def test_a_run_that_stops_leaves_the_verdicts_on_the_others(limit, passed):
    """Stopped at h = 0.5 time scales: reported; at the smallest step: a fault."""

    def prepare(top, y0, h):
        if abs(h) > limit * top.scales(y0)[2]:
            raise StepError("stops", "too long", h=h)
        return METHODS["strang"].prepare_for(top)(top, y0, h)

    verdicts = by_claim(check.conserves(in_uniform_fields(METHODS["strang"], prepare=prepare), quick=True))
    stopped = verdicts.pop("takes 10000 steps")
    assert (stopped.passed, stopped.measured) == (passed, None), "no number to read as a bound"
    assert list(verdicts) == [f"conserves {name}" for name in ("H", "J3", "C1", "C2")]
    assert verdicts["conserves C1"].passed is (True if passed is None else None)


LIES = [
    ("implicit_midpoint", {"poisson": True, "order": None}, {"Poisson map", "exact in time"}),
    ("rk45_fixed", {"conserves": {"H", "J3"}}, {"conserves H", "conserves in long steps"}),
]


@pytest.mark.parametrize(("name", "lie", "caught"), LIES)
def test_a_false_claim_is_caught(name, lie, caught):
    claims = {word: lie.pop(word) for word in {*lie} & {"symmetric", "poisson", "conserves"}}
    honest = METHODS[name]
    liar = in_uniform_fields(honest, claims=replace(honest.claims, **claims), **lie)
    assert wrong(check.check(liar, quick=True)) == caught


class Adams(Stepper):
    """Adams and Bashforth's formula of order two, started with Runge and Kutta's of order four: one step is better than two."""

    def __init__(self, top, y0, h):
        self.rhs, self.h, self.starter = top.rhs, h, METHODS["rk4"].prepare_for(top)(top, y0, h)
        self.work = self.starter.work

    def record(self, y, n, every):
        rows, slope = [y], self.rhs(y)
        for k in range(1, n + 1):
            before, slope = slope, self.rhs(y)
            y = self.starter.advance(y, 1) if k == 1 else y + self.h * (1.5 * slope - 0.5 * before)
            if k % every == 0:
                rows.append(y)
        return np.array(rows)


def test_the_starter_of_a_multistep_method_does_not_hide_its_order():
    """Its first step has order 4: off single steps the lie would be confirmed."""
    adams = replace(METHODS["rk4"], claims=Claims(conserves={"J3"}), prepare=Adams)
    (honest,), (liar,) = (list(check.order(replace(adams, order=order), quick=True)) for order in (2, 4))
    assert (honest.passed, liar.passed) == (True, False)
    assert liar.measured == pytest.approx(2, abs=0.1)


class Shares(Wrapped):
    latest = None  # of the class: the last stepper prepared serves all

    def __init__(self, top, y0, h):
        super().__init__(top, y0, h)
        Shares.latest = self.inner

    def advance(self, y, n):
        return Shares.latest.advance(y, n)


def at_a_failure(instead):
    """`record` that gives, or raises, something else where a good one raises StepError."""

    def record(self, y, n, every):
        try:
            return self.inner.record(y, n, every)
        except StepError:
            if isinstance(instead, Exception):
                raise instead from None
            return np.full((n // every + 1, 6), instead)

    return {"record": record}


def modifying(self, y, n):
    y[:] = self.inner.advance(y, n)
    return y


def remembering(self, y, n):
    self.calls = getattr(self, "calls", 0) + 1
    return self.inner.advance(y, n) * (1 + 3e-16 * (self.calls > 1))


def buffered(self, y, n):
    self.buffer = getattr(self, "buffer", np.empty(6))
    self.buffer[:] = self.inner.advance(y, n)
    return self.buffer[:]  # another array, of the same memory


def after(spoil):
    """`record` that spoils something at its end: spoil(stepper, y, n, rows)."""

    def record(self, y, n, every):
        rows = self.inner.record(y, n, every)
        spoil(self, y, n, rows)
        return rows

    return {"record": record}


BEHAVIOUR = [  # claim that fails, what is overridden
    ("purity", {"advance": modifying}),  # a read-only input makes a modification raise
    ("input is not modified", after(lambda self, y, n, rows: np.copyto(y, rows[-1]))),
    ("same input, same bits", {"advance": remembering}),
    ("two steppers share nothing", vars(Shares)),
    ("results are fresh arrays", {"advance": buffered}),
    ("negative h is as accurate", {"__init__": lambda self, top, y0, h: Wrapped.__init__(self, top, y0, abs(h))}),
    ("record has the start in row 0", after(lambda self, y, n, rows: np.multiply(rows[0], 2.0, out=rows[0]))),
    ("record ends where advance does", after(lambda self, y, n, rows: np.multiply(rows[1:], 1 + 3e-16, out=rows[1:]))),
    ("work counts steps", after(lambda self, y, n, rows: setattr(self.work, "steps", self.work.steps + n))),
    ("finite, or a StepError", at_a_failure(np.nan)),
    ("finite, or a StepError", at_a_failure(ZeroDivisionError())),
    ("StepErrors name the method", at_a_failure(StepError("somebody", "no reason"))),
]


@pytest.mark.parametrize(("claim", "overridden"), [(None, {}), *BEHAVIOUR], ids=lambda value: str(value)[:12])
def test_bad_behaviour_is_caught(claim, overridden):
    stepper = Shares if "latest" in overridden else type("Spoiled", (Wrapped,), overridden)
    caught = wrong(check.check(replace(HONEST, prepare=stepper), quick=True))
    assert claim in caught if claim else not caught


def test_a_check_that_crashes_is_a_failure_with_its_line():
    def broken(top, y0, h):
        if top.alpha == 1.0:
            return Wrapped(top, y0, h)
        raise KeyError("no such thing")

    failures = [v.how for v in check.check(replace(HONEST, prepare=broken), quick=True) if v.passed is False]
    assert len([how for how in failures if how.startswith("ended in KeyError: 'no such thing' (")]) >= 3
    assert f"{Path(__file__).name}:" in failures[0]


CLAIMED = ("J3", "C1", "C2")


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(check, "FIELD_STEPS", 50)
    monkeypatch.setattr(check, "extremes", lambda method, quick, names: ())


def in_fields(bend=lambda y, h, n: y, order=2, **more):
    """Strang's splitting, right in a uniform field, bent in others."""
    claims = Claims(symmetric=True, poisson=True, conserves={*CLAIMED}, **more)
    prepare = partial(Bent, "strang", bend)
    return replace(METHODS["strang"], needs=kinds.top, claims=claims, kernels_for={}, order=order, prepare=prepare)


def test_claims_in_a_potential_are_judged(short):
    assert not wrong(check.in_field(in_fields(), quick=True))
    claims = {"order 2", "symmetric", "Poisson map", *(f"conserves {name}" for name in CLAIMED)}
    for record, caught in (
        (in_fields(lambda y, h, n: y + 0.1 * h * h * y[[1, 2, 0, 4, 5, 3]]), claims),
        (in_fields(order=4, conserves_if_quadratic={"H"}), {"order 4", "conserves H"}),
    ):
        assert wrong(check.in_field(record, quick=True)) == {f"in a field: {claim}" for claim in caught}


def test_a_method_is_not_judged_where_it_does_not_go(short):
    verdicts = check.in_field(METHODS["theta_functions"], quick=True)
    assert [(v.claim, v.passed) for v in verdicts] == [("in a field", None), ("on a vibrating pivot", None)]


BODY, START = examples.problem("free_body")
SPINS = Problem(
    "spins", 2, lambda t, y, p: p[0] * (y[0] * y[3] + y[1] * y[4] + y[2] * y[5]) + y[2] + 2.0 * y[5], (1.0,)
)
TRUE = {
    "spins": ("rkmk4", SPINS, (1.0, 0.0, 0.2, 0.3, -0.5, 0.6)),
    "pivot": ("rk4", vibrating_pivot(1.0, 0.02, 3.0), (0.3, -0.2, 1.1, 0.4, 0.1, 0.9)),
}


@pytest.mark.parametrize("name", TRUE)
def test_claims_hold_on_a_problem(name):
    method, problem, y0 = TRUE[name]
    verdicts = check.check(method, quick=True, problem=problem, y0=y0)
    assert not wrong(verdicts)
    assert any("order" in v.claim and v.passed for v in verdicts)
    assert {v.claim.partition(": ")[0] for v in verdicts} == {problem.name}


def test_false_claims_fail_on_a_problem():
    honest = METHODS["rk4"]
    liar = replace(honest, claims=Claims(symmetric=True, poisson=True, conserves={"C1", "C2"}), order=3)
    caught = {f"free_body: {claim}" for claim in ("order 3", "symmetric", "Poisson map", "conserves C")}
    assert wrong(check.check(liar, quick=True, problem=BODY, y0=START)) == caught


MINE = (ROOT / "docs" / "example_plugin" / "suzuki_top.py").read_text(encoding="utf-8")


@pytest.fixture
def mine(folder):
    """mine(old, new) -> the name of the method in a file with this change."""

    def write(old="", new=""):
        assert old in MINE
        (folder / "my_first.py").write_text(MINE.replace(old, new, 1), encoding="utf-8")
        return "my_first:METHOD"

    return write


FAULTS = [  # a change of the file, and what is said
    ("c[MIDDLE]", "c[MIDLE]", "the kernel step cannot be compiled: NameError: name 'MIDLE' is not defined"),
    ("@compiled\ndef step", "def step", "the kernel step is not compiled: put @compiled above it ({file}:56)"),
    ("    return Fixed", "    raise SystemExit(3)\n    return Fixed", "SystemExit: 3 ({file}:57)"),
]


@pytest.mark.parametrize(("old", "new", "message"), FAULTS, ids=[message[-20:] for *_, message in FAULTS])
def test_a_fault_is_told_once_with_its_line(mine, tmp_path, old, new, message):
    name, wanted = mine(old, new), message.format(file=tmp_path / "my_first.py")
    (verdict,) = check.check(name, quick=True)
    assert (verdict.claim, verdict.passed) == (check.TAKES_A_STEP, False)
    assert wanted in verdict.how


def test_a_state_without_a_time_scale_is_refused():
    with pytest.raises(ValueError, match="no time scale there"):
        check.check("rk4", problem=LagrangeTop(0.0), y0=[0, 0, 0, 0, 0, 1.0])


def test_an_index_beyond_the_constants_is_found(mine, tmp_path):
    told = first_step.problem(find_method(mine("c[MIDDLE]", "c[7]")), "my_first:METHOD")
    assert told == f"IndexError: index 7 is out of bounds for axis 0 with size 3 ({tmp_path / 'my_first.py'}:48)"


RECORDS = [
    ('{"J3", "C1", "C2"}', '{"J 4"}', "conserves names invariants by words, as {'J3'}; got {'J 4'}"),
    ("order=4", "oder=4", "unexpected keyword argument 'oder'"),
]


@pytest.mark.parametrize(("old", "new", "message"), RECORDS)
def test_a_record_of_wrong_types_is_refused_by_the_field(mine, old, new, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        find_method(mine(old, new))


# ---------------------------------------------------------------- what must be refused at twice its bound

EPS = 2.0**-52
HALF, TWICE = 0.5, 2.0


def order_off(by):
    """Spoils a step of the exact motion by an error of order 2 + `by`."""
    return lambda y, h, n: longer(1e-3 * abs(h) ** (3 + by))(y)


def in_field(bend):
    """A method of order 20 in all fields, bent to order 2."""
    prepare = partial(Bent, "taylor_fixed", bend)
    return replace(METHODS["taylor_fixed"], order=2, prepare=prepare, kernels_for={})


ONE = ("generic",)
IN_A_TIDE = ("generic" + states.TIDE, "random001" + states.TIDE)
FREE_TOP = replace(states.placed("generic"), given_name="a start of the user's own")
BOUNDS = {  # claim → (check, record that is off by so many times the bound)
    "exact in time": lambda times: check.solution(off("backlund", lambda y, h, n: longer(times * 1e-12)(y)), True, ONE),
    "follows the exact solution": lambda times: check.solution(
        off("rk45", lambda y, h, n: longer(times * 1e-4)(y)), True, ONE
    ),
    "negative h is as accurate": lambda times: check.solution(
        off("backlund", lambda y, h, n: longer(1e-6 if h > 0 else times * 1e-5)(y), order=2), True, ONE
    ),
    "symmetric": lambda times: check.symmetric(
        off("strang", lambda y, h, n: longer(times * 256 * EPS if h < 0 else 0.0)(y)), True, ONE
    ),
    "symmetric, at a start of the user's own": lambda times: check.symmetric(
        off("strang", lambda y, h, n: longer(times * 1024 * EPS if h < 0 else 0.0)(y)), True, (FREE_TOP,)
    ),
    "Poisson map": lambda times: check.poisson(off("strang", lambda y, h, n: y * (1 + times * 1e-8)), True, ONE),
    "conserves C1, a bias of 8 ulps a step": lambda times: check.conserves(
        off("strang", lambda y, h, n: longer(times * 4 * EPS * n)(y)), True, ONE, 10
    ),
    "conserves C1, a walk of 128 ulps": lambda times: check.conserves(
        off("strang", lambda y, h, n: longer(times * 64 * EPS * n**0.5)(y)), True, ONE, 10_000
    ),
    "conserves in long steps": lambda times: check.long_steps(
        off("backlund", lambda y, h, n: longer(times * 128 * EPS * abs(h) * states.placed("generic").unit ** -1)(y)),
        True,
        ONE,
    ),
    "order 2": lambda times: check.order(off("backlund", order_off(times * 0.15), order=2), True),
    "order 2, in a field": lambda times: check.order(in_field(order_off(times * 0.3)), True, IN_A_TIDE),
}


@pytest.mark.parametrize("claim", BOUNDS)
def test_what_is_off_by_twice_a_bound_is_refused(claim):
    """Half of the bound is allowed. The bounds are written down here, so that a looser one is seen."""
    for times, passed in ((HALF, True), (TWICE, False)):
        verdict = by_claim(BOUNDS[claim](times))[claim.partition(",")[0]]
        assert verdict.passed is passed, verdict


def test_a_run_that_is_lost_says_nothing_about_the_way_back():
    for size, passed in ((0.05, True), (0.2, None)):
        record = off("backlund", lambda y, h, n, size=size: longer(size if h > 0 else 0.0)(y), order=2)
        assert by_claim(check.solution(record, True, ONE))["negative h is as accurate"].passed is passed


# ---------------------------------------------------------------- where claims are tested


def test_a_method_that_takes_alpha_without_its_sign_fails():
    honest = METHODS["strang"].prepare_for(LagrangeTop())
    liar = in_uniform_fields(METHODS["strang"], prepare=lambda top, y, h: honest(LagrangeTop(abs(top.alpha)), y, h))
    assert not next(check.order(liar, True)).passed


def runge_kutta_4(time_counts):
    """The classical formula; `time_counts` = 0 : all its nodes are 0, so t stays that of the start of the step."""

    def increment(rates, t, y, h):
        k1 = rates(t, y)
        k2 = rates(t + time_counts * h / 2, [a + b / 2 for a, b in zip(y, k1, strict=True)])
        k3 = rates(t + time_counts * h / 2, [a + b / 2 for a, b in zip(y, k2, strict=True)])
        k4 = rates(t + time_counts * h, [a + b for a, b in zip(y, k3, strict=True)])
        return [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]

    return lambda problem, y0, h: explicit_stepper("mine", problem, h, increment)


@pytest.mark.parametrize(("time_counts", "passed"), [(1, True), (0, False)])
def test_a_method_that_forgets_the_time_fails(short, time_counts, passed):
    record = replace(METHODS["rk4"], name="mine", prepare=runge_kutta_4(time_counts))
    assert by_claim(check.in_field(record, True))["on a vibrating pivot: order 4"].passed is passed


def test_a_claim_that_a_problem_does_not_have_is_said():
    record = replace(METHODS["rkmk4"], claims=Claims(conserves={"C1", "C2", "J3"}))
    verdicts = by_claim(check.conserves(record, True, ("free_body",), 10))
    assert list(verdicts) == ["conserves J3", "conserves H", "conserves C"], "C1 and C2 stand for the Casimir function"
    said = verdicts["conserves J3"]
    assert said.word == "not judged"
    assert said.how.startswith("claims J3, which the problem free_body does not have; its invariants are H, C.")


@cache
def without_weight(body):
    return RigidBody(1.0, (0.0, 0.0, 0.0), body.inertia, (0.0, 0.0, 0.0))


def test_a_method_for_free_bodies_is_tested_on_one(short):
    """Whether its record says so or not."""
    step = METHODS["simo_wong"].prepare
    careless = replace(METHODS["simo_wong"], prepare=lambda body, y0, h: step(without_weight(body), y0, h))
    verdicts = by_claim(check.of_its_kind(careless, True))
    assert [verdicts[f"{name}: order 2"].passed for name in check.BODIES] == [False, True]
    right = list(check.of_its_kind(replace(careless, needs=kinds.free_body), True))
    assert wrong(right) == set()
    assert {v.claim.partition(":")[0] for v in right} == {"free body"}


def test_a_method_that_takes_no_body_of_the_bench_is_told():
    (verdict,) = check.of_its_kind(replace(METHODS["simo_wong"], needs=lambda problem: False), True)
    assert (verdict.word, "--problem" in verdict.how) == ("not judged", True)
