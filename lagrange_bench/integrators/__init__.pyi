"""The public names of this package: each is imported when it is first used."""

from .api import integrate as integrate, prepare as prepare
from .backward_error.prediction import PredictedPhase as PredictedPhase, predicted_phase as predicted_phase
from .cases import CASES as CASES, Case as Case
from .compiling.expression import cos as cos, exp as exp, log as log, sin as sin, sqrt as sqrt
from .ensemble import integrate_ensemble as integrate_ensemble
from .interface import (
    INVARIANTS as INVARIANTS,
    Claims as Claims,
    Method as Method,
    StepError as StepError,
    Stepper as Stepper,
    Work as Work,
)
from .paper.gaudin_model import GaudinMagnet as GaudinMagnet
from .problem.kirchhoff import kirchhoff_body as kirchhoff_body
from .problem.perturbed import PerturbedTop as PerturbedTop, Potential as Potential
from .problem.potentials import PERTURBED_TOPS as PERTURBED_TOPS
from .problem.problem import Problem as Problem
from .problem.rigid_body import RigidBody as RigidBody
from .problem.top import TOPS as TOPS, LagrangeTop as LagrangeTop, NamedTop as NamedTop
from .problem.vibrating_pivot import vibrating_pivot as vibrating_pivot
from .registry import METHODS as METHODS, POTENTIALS as POTENTIALS, available as available
from .torus.any_parameter import two_point as two_point
from .trajectory import EnsembleTrajectory as EnsembleTrajectory, Trajectory as Trajectory
from .truth import exact as exact, reference as reference
