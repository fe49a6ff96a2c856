"""Geometric integrators for the symmetric Lagrange top, behind one interface.

    from lagrange_bench.integrators import LagrangeTop, integrate
    trajectory = integrate(LagrangeTop(alpha=1.0), y0, h=0.1, steps=10_000, method="backlund", every=10)
    trajectory.t, trajectory.y, trajectory.invariants(), trajectory.work

`METHODS` lists what there is; `exact` is the closed-form solution they are all judged by. The top is a limit of the
Gaudin magnet, which the same call follows:

    integrate(GaudinMagnet(sites=(0, -1, -3), alpha=0.5, site=0), spins, h=2.0, steps=1000, method="backlund")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagrange_bench.integrators.lazy import face, imported

if TYPE_CHECKING:
    from lagrange_bench.integrators.api import integrate, prepare, two_point
    from lagrange_bench.integrators.backward_error.prediction import PredictedPhase, predicted_phase
    from lagrange_bench.integrators.cases import CASES, Case
    from lagrange_bench.integrators.compiling.expression import cos, exp, log, sin, sqrt
    from lagrange_bench.integrators.ensemble import integrate_ensemble
    from lagrange_bench.integrators.interface import INVARIANTS, Method, StepError, Stepper, Work
    from lagrange_bench.integrators.paper.gaudin_model import MAGNETS, GaudinMagnet
    from lagrange_bench.integrators.problem.body import HeavyTop, RigidTop
    from lagrange_bench.integrators.problem.field import Potential
    from lagrange_bench.integrators.problem.free_body import free_body
    from lagrange_bench.integrators.problem.kirchhoff import kirchhoff_body
    from lagrange_bench.integrators.problem.orbiting_tide import orbiting_tide
    from lagrange_bench.integrators.problem.perturbed import PerturbedTop
    from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS, in_any_field
    from lagrange_bench.integrators.problem.problem import Problem
    from lagrange_bench.integrators.problem.top import TOPS, LagrangeTop, NamedTop
    from lagrange_bench.integrators.problem.vibrating_pivot import vibrating_pivot
    from lagrange_bench.integrators.problem.whole_body import WholeBody
    from lagrange_bench.integrators.registry import METHODS, POTENTIALS, available
    from lagrange_bench.integrators.trajectory import EnsembleTrajectory, Trajectory
    from lagrange_bench.integrators.truth import exact, reference

__all__ = [
    "CASES",
    "INVARIANTS",
    "MAGNETS",
    "METHODS",
    "PERTURBED_TOPS",
    "POTENTIALS",
    "TOPS",
    "Case",
    "EnsembleTrajectory",
    "GaudinMagnet",
    "HeavyTop",
    "LagrangeTop",
    "Method",
    "NamedTop",
    "PerturbedTop",
    "Potential",
    "PredictedPhase",
    "Problem",
    "RigidTop",
    "StepError",
    "Stepper",
    "Trajectory",
    "WholeBody",
    "Work",
    "available",
    "cos",
    "exact",
    "exp",
    "free_body",
    "in_any_field",
    "integrate",
    "integrate_ensemble",
    "kirchhoff_body",
    "log",
    "orbiting_tide",
    "predicted_phase",
    "prepare",
    "reference",
    "sin",
    "sqrt",
    "two_point",
    "vibrating_pivot",
]

__getattr__, __dir__ = face(__name__, imported(__file__))
