"""Geometric integrators for the symmetric Lagrange top, behind one interface.

    from integrators import LagrangeTop, integrate
    trajectory = integrate(LagrangeTop(alpha=1.0), y0, h=0.1, steps=10_000, method="backlund", every=10)
    trajectory.t, trajectory.y, trajectory.invariants(), trajectory.work

`METHODS` lists what there is; `exact` is the closed-form solution they are all judged by. The top is a limit of the
Gaudin magnet, which the same call follows, by `MAGNET_METHODS`:

    integrate(GaudinMagnet(sites=(0, -1, -3), alpha=0.5, site=0), spins, h=2.0, steps=1000, method="backlund")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from integrators.lazy import face

if TYPE_CHECKING:
    from integrators.any_problem import integrate
    from integrators.api import Trajectory, prepare, two_point
    from integrators.backward_error.prediction import PredictedPhase, predicted_phase
    from integrators.compiling.expression import sqrt
    from integrators.ensemble import integrate_ensemble
    from integrators.interface import INVARIANTS, AnyField, Method, StepError, Stepper, Work
    from integrators.paper.gaudin_magnets import MAGNETS
    from integrators.paper.gaudin_methods import MAGNET_METHODS
    from integrators.paper.gaudin_model import GaudinMagnet
    from integrators.problem.body import HeavyTop
    from integrators.problem.field import Potential
    from integrators.problem.perturbed import PerturbedTop
    from integrators.problem.potentials import PERTURBED_TOPS, in_any_field
    from integrators.problem.top import TOPS, LagrangeTop, NamedTop
    from integrators.registry import METHODS, POTENTIALS, available
    from integrators.truth import exact

__all__ = [
    "INVARIANTS",
    "MAGNETS",
    "MAGNET_METHODS",
    "METHODS",
    "PERTURBED_TOPS",
    "POTENTIALS",
    "TOPS",
    "AnyField",
    "GaudinMagnet",
    "HeavyTop",
    "LagrangeTop",
    "Method",
    "NamedTop",
    "PerturbedTop",
    "Potential",
    "PredictedPhase",
    "StepError",
    "Stepper",
    "Trajectory",
    "Work",
    "available",
    "exact",
    "in_any_field",
    "integrate",
    "integrate_ensemble",
    "predicted_phase",
    "prepare",
    "sqrt",
    "two_point",
]

__getattr__, __dir__ = face(
    __name__,
    {
        "integrators.any_problem": ("integrate",),
        "integrators.api": ("Trajectory", "prepare", "two_point"),
        "integrators.backward_error.prediction": ("PredictedPhase", "predicted_phase"),
        "integrators.ensemble": ("integrate_ensemble",),
        "integrators.interface": ("INVARIANTS", "AnyField", "Method", "StepError", "Stepper", "Work"),
        "integrators.paper.gaudin_magnets": ("MAGNETS",),
        "integrators.paper.gaudin_methods": ("MAGNET_METHODS",),
        "integrators.paper.gaudin_model": ("GaudinMagnet",),
        "integrators.problem.body": ("HeavyTop",),
        "integrators.compiling.expression": ("sqrt",),
        "integrators.problem.field": ("Potential",),
        "integrators.problem.perturbed": ("PerturbedTop",),
        "integrators.problem.potentials": ("PERTURBED_TOPS", "in_any_field"),
        "integrators.problem.top": ("TOPS", "LagrangeTop", "NamedTop"),
        "integrators.registry": ("METHODS", "POTENTIALS", "available"),
        "integrators.truth.exact": (),
    },
)
