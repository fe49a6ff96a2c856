"""The tests can fail: maps that are slightly wrong and records that promise too much are caught, each by its claim."""

import cmath
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from toys import multistep

from lagrange_bench.experiments import phase
from lagrange_bench.experiments.measuring import check, metrics
from lagrange_bench.integrators import METHODS, TOPS, LagrangeTop, StepError, integrate, prepare, registry
from lagrange_bench.integrators.interface import Method, Stepper, Work
from tests.installed import in_uniform_fields
from tests.sabotage import failed

ALL = frozenset({"H", "J3", "C1", "C2"})
GENERIC = TOPS["generic"]


# ---------------------------------------------------------------- the Bäcklund map, and four ways to spoil it


def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


class TwoPoint(Stepper):
    """The two-point map with λ = i h |x|/2 as it stands in the report, no compiled code: an independent twin.

    `sabotage` is None or one of SABOTAGES; angle and length are wrong by 1e-8, which no plot shows.
    """

    def __init__(self, top, y0, h, sabotage):
        self.alpha, self.sabotage, self.work = top.alpha, sabotage, Work()
        self.lam = complex(0.0, abs(h) * math.hypot(*y0[3:]) / 2)
        m = math.hypot(*y0[3:])
        for k in range(1, 65):  # the branch continuous along the segment from 0 to λ
            root = self.root(y0.tolist(), k / 64 * self.lam)
            m = root if abs(root - m) < abs(root + m) else -root
        self.m = m if h > 0 else -m

    def curve(self, y, lam):
        """a(λ) = x + λ J + λ² alpha e3 as three complex numbers."""
        J, x = y[:3], y[3:]
        return [x[0] + lam * J[0], x[1] + lam * J[1], x[2] + lam * J[2] + lam**2 * self.alpha]

    def root(self, y, lam):
        a = self.curve(y, lam)
        return cmath.sqrt(dot(a, a))

    def step(self, y):
        J, x, lam, m = y[:3], y[3:], self.lam, self.m
        a = self.curve(y, lam)
        p, q = [z.real for z in a], [z.imag for z in a]
        n = cross(p, q)
        sign = -1 if self.sabotage == "wrong sign" else 1
        scale = 2 * lam.imag / (abs(m) ** 2 + dot(p, p) + dot(q, q))
        if self.sabotage == "unnormalised rotation":
            scale *= 1 + 1e-8
        w = [scale * (m.real * p[i] + m.imag * q[i] - sign * n[i]) for i in range(3)]
        K = [J[0] - 2 * self.alpha * w[1], J[1] + 2 * self.alpha * w[0], J[2]]
        R = lam.real + (1e-8 * lam.imag if self.sabotage == "wrong angle" else 0)
        if self.sabotage == "stale momentum":  # x̃ = x + R (J̃ − J) + (J + J̃)×w with J in place of J̃
            turn = cross([2 * J[i] for i in range(3)], w)
            return K + [x[i] + R * (K[i] - J[i]) + turn[i] for i in range(3)]
        u = cross(w, x)
        v = cross(w, u)
        return K + [x[i] + 2 * (v[i] + R * u[i]) / (R * R + lam.imag**2) for i in range(3)]

    def advance(self, y, n):
        state = y.tolist()
        for _ in range(n):
            state = self.step(state)
        self.work.steps += n
        if not all(map(math.isfinite, state)):
            raise StepError("twin", "not finite")
        return np.array(state)

    def record(self, y, n, every):
        rows = [y.copy()]
        for _ in range(n // every):
            rows.append(self.advance(rows[-1], every))
        return np.array(rows)


def twin(sabotage=None):
    return Method(
        name="twin",
        label="twin",
        family="backlund",
        order=2,
        symmetric=True,
        poisson=True,
        conserves=ALL,
        control="step",
        source="this test",
        prepare=lambda top, y0, h: TwoPoint(top, y0, h, sabotage),
    )


SABOTAGES = {
    "wrong angle": "conserves H",
    "wrong sign": "conserves H",
    "stale momentum": "conserves C1",
    "unnormalised rotation": "conserves C1",
}


def test_the_twin_keeps_every_claim():
    assert not failed(twin()) - {"finite, or a StepError"}  # it is not scaled, and overflows where it likes


def test_the_twin_is_the_compiled_map():
    for name in ("generic", "figure1", "slow"):
        top, y0 = TOPS[name].top, TOPS[name].state
        h = 0.4 * top.scales(y0)[2]
        a = TwoPoint(top, y0, h, None).advance(y0, 100)
        b = prepare(top, y0, h, "backlund_paper").advance(y0, 100)
        assert metrics.scaled_error(top, y0, a, b) < 1e-13  # 100 steps of a few ulp


@pytest.mark.parametrize("sabotage", SABOTAGES)
def test_sabotage_is_caught(sabotage):
    assert SABOTAGES[sabotage] in failed(twin(sabotage))


# ---------------------------------------------------------------- records that promise too much

LIES = [
    ("implicit_midpoint", {"poisson": True}, {"Poisson map"}),
    ("implicit_midpoint", {"order": 3}, {"order 3"}),
    ("implicit_midpoint", {"order": 1}, {"order 1"}),
    ("implicit_midpoint", {"order": None}, {"exact in time"}),
    ("rk45_fixed", {"symmetric": True}, {"symmetric"}),
    ("rk45_fixed", {"poisson": True}, {"Poisson map"}),
    ("rk45_fixed", {"order": 4}, {"order 4"}),
    ("rk45_fixed", {"conserves": ALL}, {"conserves H", "conserves C1", "conserves C2"}),
    ("rk45", {"conserves": ALL}, {"conserves H", "conserves C1", "conserves C2"}),
    ("taylor_fixed", {"symmetric": True}, {"symmetric"}),
    ("taylor_fixed", {"order": 21}, {"order 21"}),
    ("taylor_fixed", {"conserves": ALL}, {"conserves H", "conserves C1", "conserves C2"}),
    ("taylor_fixed", {"poisson": True}, {"Poisson map"}),
    ("backlund_paper", {"order": None}, {"exact in time"}),
]


@pytest.mark.parametrize(("name", "lie", "caught"), LIES)
def test_a_false_claim_is_caught(name, lie, caught):
    assert caught <= failed(replace(METHODS[name], **lie))


def test_rk45_drifts():
    """Its energy error at ten times the time is ten times as large: no bound holds for long."""
    run = integrate(GENERIC.top, GENERIC.state, h=1.0, steps=2000, every=1, method="rk45", rtol=1e-6)
    drift = np.abs(metrics.relative_drift(run.invariants(), GENERIC.top.invariant_scales(GENERIC.state))[:, 0])
    assert metrics.growth_exponent(run.t[1:], drift[None, 1:]).p == pytest.approx(1, abs=0.1)


def adams(order, conserves=frozenset({"J3"})):
    return replace(METHODS["rk4"], order=order, conserves=conserves, prepare=multistep.prepare)


def test_the_starter_of_a_multistep_method_does_not_hide_its_order():
    """Its first step has order 4: off single steps the lie would be confirmed. Compensation is no such memory."""
    (honest,), (liar,) = (list(check.order(adams(order), quick=True)) for order in (2, 4))
    assert (honest.passed, liar.passed) == (True, False)
    assert liar.measured == pytest.approx(2, abs=0.1)
    errors = np.mean(
        np.log(check.one_step_errors(adams(4), check.ORDER_STATES, 2.0 ** np.arange(-4.0, -7, -1))), axis=0
    )
    assert np.diff(errors) / -math.log(2) == pytest.approx(5, abs=0.1)
    for name in ("rk4", "strang", "gauss6"):
        carried = in_uniform_fields(METHODS[name])
        carried = replace(carried, prepare=partial(carried.prepare, compensated=True))
        assert not check.remembers(carried), name


def test_phase_reads_the_order_of_a_multistep_method_off_runs(monkeypatch):
    entries = {**METHODS._entries, "adams": registry.EntryPoint("adams", "toys.multistep:METHOD", METHODS.group)}
    monkeypatch.setitem(vars(METHODS), "_entries", entries)
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    rows = {name: phase.measure({"part": "order", "method": name}) for name in ("adams", "rk4")}
    frame = pd.DataFrame(
        [
            {"part": "order", "method": name, "state": None, "status": "done", **row}
            for name in rows
            for row in rows[name]
        ]
    )
    table = phase.orders(frame).set_index("method")
    assert table.measured["adams"] == pytest.approx(2, abs=0.1)
    assert table.measured["rk4"] == pytest.approx(4, abs=0.1)
    assert table.state.to_dict() == {"adams": "short runs, 8 tops", "rk4": "single steps, 8 tops"}
    assert not any("run" in row for row in rows["rk4"])


class Biased:
    """A good stepper whose every step makes x longer by so many ulps of its own."""

    def __init__(self, ulps, top, y0, h):
        self.inner, self.ulps, self.work = METHODS["strang"].prepare_for(top)(top, y0, h), ulps, Work()

    def record(self, y, n, every):
        rows = self.inner.record(y, n, every)
        rows[:, 3:] *= 1 + self.ulps * 2.0**-53 * every * np.arange(len(rows))[:, None]
        return rows


@pytest.mark.parametrize(
    ("ulps", "quick", "kept"), [(0, True, True), (0.1, False, True), (2, True, False), (1, False, False)]
)
def test_a_rounding_that_always_goes_the_same_way_is_caught(ulps, quick, kept):
    biased = in_uniform_fields(METHODS["strang"], prepare=partial(Biased, ulps))
    verdicts = {v.claim: v for v in check.conserves(biased, quick)}
    assert verdicts["conserves C1"].passed is kept, verdicts
    assert ("always the same way" in verdicts["conserves C1"].how) is (ulps == 1)
    excused = replace(biased, biased={"C1": "told"})
    assert next(v for v in check.conserves(excused, quick) if v.claim == "conserves C1").passed


@pytest.mark.parametrize(("limit", "passed"), [(0.3, None), (0.05, False)])
def test_a_run_that_stops_leaves_the_verdicts_on_the_others(limit, passed):
    """Stopped at h = 0.5 time scales: said, with what was measured below; at the smallest step: a fault."""

    def prepare(top, y0, h):
        if abs(h) > limit * top.scales(y0)[2]:
            raise StepError("stops", "too long", h=h)
        return METHODS["strang"].prepare_for(top)(top, y0, h)

    verdicts = {v.claim: v for v in check.conserves(in_uniform_fields(METHODS["strang"], prepare=prepare), quick=True)}
    stopped = verdicts.pop("takes 10000 steps")
    assert stopped.passed is passed
    assert stopped.measured is None, "no number to read as a bound"
    assert "fails at h = 0.5: too long (generic, figure1, random000, random001)" in stopped.how
    assert stopped.how.endswith("; only a failure at h = 0.1 or below counts against a method") is (passed is None)
    assert list(verdicts) == [f"conserves {name}" for name in ("H", "J3", "C1", "C2")]
    assert verdicts["conserves C1"].passed is (True if passed is None else None)
    assert (verdicts["conserves H"].measured is None) == (passed is False)


# ---------------------------------------------------------------- steppers that behave badly


class Wrapped(Stepper):
    """A good stepper that can be given bad manners by overriding one method."""

    def __init__(self, top, y0, h):
        self.inner = METHODS["rk45_fixed"].prepare_for(top)(top, y0, h)
        self.work = self.inner.work
        self.calls = 0

    def advance(self, y, n):
        return self.inner.advance(y, n)

    def record(self, y, n, every):
        return self.inner.record(y, n, every)


class ModifiesInput(Wrapped):
    def advance(self, y, n):
        y[:] = self.inner.advance(y, n)
        return y


class Remembers(Wrapped):
    def advance(self, y, n):
        self.calls += 1
        return self.inner.advance(y, n) * (1 + 1e-16 * (self.calls > 1) + 2e-16 * (self.calls > 1))


class Shares(Wrapped):
    latest = None  # of the class: the last stepper prepared serves all

    def __init__(self, top, y0, h):
        super().__init__(top, y0, h)
        Shares.latest = self.inner

    def advance(self, y, n):
        return Shares.latest.advance(y, n)


class OneBuffer(Wrapped):
    def __init__(self, top, y0, h):
        super().__init__(top, y0, h)
        self.buffer = np.empty(6)

    def advance(self, y, n):
        self.buffer[:] = self.inner.advance(y, n)
        return self.buffer


class OnlyForward(Wrapped):
    def __init__(self, top, y0, h):
        super().__init__(top, y0, abs(h))


class RowsShifted(Wrapped):
    def record(self, y, n, every):
        return np.roll(self.inner.record(y, n, every), 1, axis=0)


class RestartsRows(Wrapped):
    """Each row from the one before, by a stepper that rounds in between."""

    def record(self, y, n, every):
        rows = self.inner.record(y, n, every)
        rows[1:] = rows[1:] * (1 + 3e-16)
        return rows


class ForgetsWork(Wrapped):
    def record(self, y, n, every):
        rows = self.inner.record(y, n, every)
        self.work.steps -= n
        return rows


class Undecided(Wrapped):
    from_start = None


class ReturnsNaN(Wrapped):
    def record(self, y, n, every):
        try:
            return self.inner.record(y, n, every)
        except StepError:
            return np.full((n // every + 1, 6), np.nan)


class RaisesAnything(Wrapped):
    def record(self, y, n, every):
        try:
            return self.inner.record(y, n, every)
        except StepError:
            raise ZeroDivisionError from None


class Anonymous(Wrapped):
    def record(self, y, n, every):
        try:
            return self.inner.record(y, n, every)
        except StepError as error:
            raise StepError("somebody", error.reason) from None


MANNERS = {
    ModifiesInput: "input is not modified",
    Remembers: "same input, same bits",
    Shares: "two steppers share nothing",
    OneBuffer: "results are fresh arrays",
    OnlyForward: "negative h is as accurate",
    RowsShifted: "record has the start in row 0",
    RestartsRows: "record ends where advance does",
    ForgetsWork: "work counts steps",
    Undecided: "from_start is True or False",
    ReturnsNaN: "finite, or a StepError",
    RaisesAnything: "finite, or a StepError",
    Anonymous: "StepErrors name the method",
}


@pytest.mark.parametrize("stepper", [Wrapped, *MANNERS])
def test_bad_manners_are_caught(stepper):
    caught = failed(replace(METHODS["rk45_fixed"], prepare=lambda top, y0, h: stepper(top, y0, h)))
    if stepper is Wrapped:
        assert not caught
    else:
        assert MANNERS[stepper] in caught or "purity" in caught  # a read-only input makes a modification raise


def test_a_drift_of_the_formula_is_not_taken_for_round_off():
    liar = replace(METHODS["rk45_fixed"], conserves=frozenset({"C1"}))
    (verdict,) = (v for v in check.conserves(liar, True) if v.claim == "conserves C1")
    assert verdict.passed is False
    assert "always the same way" not in verdict.how
    assert check._steady(np.arange(11.0))
    assert not check._steady(np.array((0.0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 3)))


def test_the_name_in_a_step_error_and_that_of_the_record_are_told():
    renamed = replace(METHODS["rk4"], name="rk5", needs="uniform")
    verdict = next(v for v in check.extremes(renamed, True) if v.claim == "StepErrors name the method")
    assert not verdict.passed
    assert verdict.how.startswith("StepErrors say 'rk4', the record says 'rk5': ")


def test_a_check_that_crashes_is_a_failure():
    def broken(top, y0, h):
        if top.alpha == 1.0:
            return METHODS["rk45_fixed"].prepare_for(top)(top, y0, h)
        raise KeyError("no such thing")

    verdicts = check.check(replace(METHODS["rk45_fixed"], prepare=broken, needs="uniform"), quick=True)
    failures = [v.how for v in verdicts if v.passed is False]
    assert len([how for how in failures if how.startswith("ended in KeyError: 'no such thing' (")]) >= 3
    assert f"{Path(__file__).name}:" in failures[0]


def test_a_wrong_top_is_caught():
    """All four invariants kept, symmetric and Poisson; only the truth tells that it follows another top."""
    honest = METHODS["backlund"].prepare
    liar = replace(METHODS["backlund"], prepare=lambda top, y, h: honest(LagrangeTop(top.alpha * (1 + 1e-9)), y, h))
    assert not next(check.solution(liar, True)).passed
