"""Geometric integrators for spinning tops, rigid bodies and problems of your own, behind one interface.

    from lagrange_bench.integrators import LagrangeTop, integrate
    trajectory = integrate(LagrangeTop(alpha=1.0), y0, h=0.1, steps=10_000, method="backlund", every=10)
    trajectory.t, trajectory.y, trajectory.invariants(), trajectory.work

`METHODS` lists the methods. The closed forms in `exact` judge them, and `reference` where there is no closed form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagrange_bench.support.lazy import exported, public_module

if TYPE_CHECKING:  # `as` says that a name is public
    from lagrange_bench.integrators.api import integrate as integrate
    from lagrange_bench.integrators.api import prepare as prepare
    from lagrange_bench.integrators.api import two_point as two_point
    from lagrange_bench.integrators.backward_error.prediction import PredictedPhase as PredictedPhase
    from lagrange_bench.integrators.backward_error.prediction import predicted_phase as predicted_phase
    from lagrange_bench.integrators.cases import CASES as CASES
    from lagrange_bench.integrators.cases import Case as Case
    from lagrange_bench.integrators.compiling.expression import cos as cos
    from lagrange_bench.integrators.compiling.expression import exp as exp
    from lagrange_bench.integrators.compiling.expression import log as log
    from lagrange_bench.integrators.compiling.expression import sin as sin
    from lagrange_bench.integrators.compiling.expression import sqrt as sqrt
    from lagrange_bench.integrators.ensemble import integrate_ensemble as integrate_ensemble
    from lagrange_bench.integrators.ensemble_trajectory import EnsembleTrajectory as EnsembleTrajectory
    from lagrange_bench.integrators.interface import INVARIANTS as INVARIANTS
    from lagrange_bench.integrators.interface import Claims as Claims
    from lagrange_bench.integrators.interface import Method as Method
    from lagrange_bench.integrators.interface import StepError as StepError
    from lagrange_bench.integrators.interface import Stepper as Stepper
    from lagrange_bench.integrators.interface import Work as Work
    from lagrange_bench.integrators.paper.gaudin_model import GaudinMagnet as GaudinMagnet
    from lagrange_bench.integrators.problem.kirchhoff import kirchhoff_body as kirchhoff_body
    from lagrange_bench.integrators.problem.orbiting_tide import orbiting_tide as orbiting_tide
    from lagrange_bench.integrators.problem.perturbed import PerturbedTop as PerturbedTop
    from lagrange_bench.integrators.problem.potential import Potential as Potential
    from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS as PERTURBED_TOPS
    from lagrange_bench.integrators.problem.problem import Problem as Problem
    from lagrange_bench.integrators.problem.rigid_body import RigidBody as RigidBody
    from lagrange_bench.integrators.problem.top import TOPS as TOPS
    from lagrange_bench.integrators.problem.top import LagrangeTop as LagrangeTop
    from lagrange_bench.integrators.problem.top import NamedTop as NamedTop
    from lagrange_bench.integrators.problem.vibrating_pivot import vibrating_pivot as vibrating_pivot
    from lagrange_bench.integrators.registry import METHODS as METHODS
    from lagrange_bench.integrators.registry import POTENTIALS as POTENTIALS
    from lagrange_bench.integrators.registry import available as available
    from lagrange_bench.integrators.trajectory import Trajectory as Trajectory
    from lagrange_bench.integrators.truth import exact as exact
    from lagrange_bench.integrators.truth import reference as reference

_HOMES = exported(__file__)
__getattr__, __dir__ = public_module(__name__, _HOMES)
__all__ = sorted(sum(_HOMES.values(), ()))
