"""Experiments beyond tops: spins, bodies and driven tops have no code of their own."""

import numpy as np

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.measuring import check
from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators import METHODS, Problem, cos, sin


def test_drift_phase_work_and_cost_of_spins():
    def measured(experiment, **cell):
        return load(experiment).measure({"method": "rk4", "state": "central_spin", **cell})

    assert set(measured("drift", part="time", h=0.5, steps=8)[-1]) == {"t", *find("central_spin")[0].names}
    (row,) = measured("phase", part="h", h=0.25)
    assert 0.0 < row["error"] < 1e-2
    curve = measured("work_precision", span=8.0, per_octave=1, decades=1, longest=0.002)
    assert curve[-1]["stopped"] == "too long"
    assert min(run.get("error", 1.0) for run in curve) < 1e-6
    (price,) = measured("cost", part="step", h=0.25, repeats=1)
    assert price["ns_per_step"] > 0.0


def swinging(t, y, p):
    return (y[0] ** 2 + y[1] ** 2 + y[2] ** 2) / 2 + (1 + 0.3 * cos(2 * t)) * y[5] + 0.2 * y[3] * y[4] * sin(t)


def test_the_way_back_is_judged_on_the_same_motion():
    """In a field that depends on time the errors at −t and t have nothing to do with each other."""
    start = Problem("swinging", "e3", swinging), np.array((0.3, -0.4, 1.2, 0.48, 0.6, 0.64))
    (verdict,) = check.solution(METHODS["blanes_moan6"], True, (start,))
    assert verdict.passed is True
