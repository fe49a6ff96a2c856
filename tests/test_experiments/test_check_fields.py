"""`check` on tops in a potential: methods that break there, and there only, are found out, each by its claim."""

from dataclasses import replace

import numpy as np
import pytest

from lagrange_bench.experiments.measuring import check
from lagrange_bench.integrators import METHODS, PERTURBED_TOPS, POTENTIALS, LagrangeTop, PerturbedTop
from lagrange_bench.integrators.interface import Stepper, Work
from lagrange_bench.integrators.truth import truths


class Map(Stepper):
    """One step of Strang's splitting in a potential, in Python; `sabotage` spoils it."""

    def __init__(self, top, y0, h, sabotage=None):
        self.top, self.h, self.sabotage, self.work = top, float(h), sabotage, Work()

    def advance(self, y, n):
        y = np.array(y)
        for _ in range(n):
            y = self.step(y)
        self.work.steps += n
        return y

    def record(self, y, n, every):
        rows = [np.array(y)]
        for _ in range(n // every):
            rows.append(self.advance(rows[-1], every))
        return np.array(rows)

    def step(self, y):
        (J, x), h = (y[:3], y[3:]), self.h
        J = J + h / 2 * np.cross(self.top.gradient(*x), x)
        angle = np.linalg.norm(J) * h
        axis = J / np.linalg.norm(J)
        turned = x * np.cos(angle) + np.cross(axis, x) * np.sin(angle) + axis * (axis @ x) * (1 - np.cos(angle))
        if self.sabotage == "drift":
            turned = turned * (1 + 1e-9)
        force = np.array(self.top.gradient(*turned))
        if self.sabotage == "force of a stale axis":
            force = np.array(self.top.gradient(*x))
        return np.concatenate((J + h / 2 * np.cross(force, turned), turned))


CLAIMED = frozenset({"J3", "C1", "C2"})


def spoiled(sabotage, **claims):
    """Strang's splitting, right in a uniform field, spoiled in others."""
    record = replace(METHODS["strang"], needs="force", conserves=CLAIMED)
    return replace(record, prepare=lambda top, y0, h: Map(top, y0, h, sabotage), **claims)


def failed(method):
    return {v.claim for v in check.in_field(method, quick=True) if v.passed is False}


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(check, "FIELD_STEPS", 100)
    monkeypatch.setattr(check, "extreme_fields", lambda names: ())


def test_an_honest_method_passes():
    verdicts = {v.claim: v for v in check.in_field(spoiled(None), quick=True)}
    assert [claim for claim, verdict in verdicts.items() if verdict.passed is False] == []
    assert verdicts["in a field: order 2"].measured == pytest.approx(2, abs=0.05)
    for claim in ("symmetric", "Poisson map", "conserves C1", "conserves J3"):
        assert verdicts[f"in a field: {claim}"].passed is True
    assert verdicts["in a field: conserves H"].passed is None


@pytest.mark.parametrize(
    ("sabotage", "claims"),
    [
        ("force of a stale axis", {"order 2", "symmetric", "Poisson map"}),
        ("drift", {"symmetric", "conserves C1"}),
    ],
)
def test_a_spoiled_one_fails(sabotage, claims):
    assert {f"in a field: {claim}" for claim in claims} <= failed(spoiled(sabotage))


def test_a_record_that_promises_too_much_fails():
    assert failed(spoiled(None, order=4)) == {"in a field: order 4"}
    assert failed(spoiled(None, conserves=CLAIMED | {"H"})) == {"in a field: conserves H"}
    assert failed(spoiled(None, if_quadratic=frozenset({"H"}))) == {"in a field: conserves H"}


def test_methods_are_judged_where_they_go():
    (verdict,) = check.in_field(METHODS["theta_functions"], quick=True)
    assert (verdict.claim, verdict.passed) == ("in a field", None)
    assert "closed form of an integrable top" in verdict.how
    verdicts = check.in_field(spoiled(None, needs="quadratic"), quick=True)
    assert {v.claim: v for v in verdicts}["in a field: conserves C1"].how.partition(";")[0].endswith("2 states")


def test_the_two_potentials_are_of_opposite_kinds():
    (tide, _), (charge, _) = (check.find(f"generic{kind}") for kind in (check.TIDE, check.CHARGE))
    assert tide.offers == {"rhs", "parts", "kinetic", "top", "force", "smooth", "quadratic"}
    assert tide.conserved == {"H", "C1", "C2"}
    assert charge.offers == {"rhs", "parts", "kinetic", "top", "force", "smooth"}
    assert charge.conserved == {"H", "J3", "C1", "C2"}


# ---------------------------------------------------------------- what runs are judged by


def test_what_is_lost_is_not_known(monkeypatch):
    named = PERTURBED_TOPS["magnet"]
    assert np.isfinite(truths.solution(named.top, named.state, [0.0, 3.0])).all()
    with pytest.raises(ValueError, match="longer than 2000 time scales"):
        truths.solution(named.top, named.state, [1e5])
    fall = PerturbedTop(LagrangeTop(1.0), POTENTIALS["charge"], (1.0, 0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="singularity"):
        truths.solution(fall, np.array((0.0, 0.0, 0.0, 0.6, 0.0, 0.8)), [10.0])
    monkeypatch.setattr(truths, "LOST", 0.0)
    assert np.isnan(truths.after_steps(named.top, named.state, 0.1, [30])).all()
