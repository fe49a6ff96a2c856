"""The public names of the bench: each is imported when it is first used."""

from .ask.comparison import Comparison as Comparison
from .ask.data import load as load
from .ask.questions import drift as drift, order as order, phase as phase, work_precision as work_precision
from .ask.testing import assert_drift as assert_drift, assert_order as assert_order
from .experiments.drawing import style as style
from .experiments.measuring import metrics as metrics, states as states, timing as timing
from .experiments.measuring.check import check as check
from .integrators import (
    CASES as CASES,
    INVARIANTS as INVARIANTS,
    METHODS as METHODS,
    PERTURBED_TOPS as PERTURBED_TOPS,
    POTENTIALS as POTENTIALS,
    TOPS as TOPS,
    Case as Case,
    Claims as Claims,
    EnsembleTrajectory as EnsembleTrajectory,
    GaudinMagnet as GaudinMagnet,
    LagrangeTop as LagrangeTop,
    Method as Method,
    NamedTop as NamedTop,
    PerturbedTop as PerturbedTop,
    Potential as Potential,
    PredictedPhase as PredictedPhase,
    Problem as Problem,
    RigidBody as RigidBody,
    StepError as StepError,
    Stepper as Stepper,
    Trajectory as Trajectory,
    Work as Work,
    available as available,
    cos as cos,
    exact as exact,
    exp as exp,
    integrate as integrate,
    integrate_ensemble as integrate_ensemble,
    kirchhoff_body as kirchhoff_body,
    log as log,
    predicted_phase as predicted_phase,
    prepare as prepare,
    reference as reference,
    sin as sin,
    sqrt as sqrt,
    two_point as two_point,
    vibrating_pivot as vibrating_pivot,
)
from .integrators.compiling.compiled import compiled as compiled
from .integrators.compiling.loops import MEMORY as MEMORY, FixedStepper as FixedStepper, Kernel as Kernel
from .integrators.methods.explicit import explicit_stepper as explicit_stepper
from .judging import judge as judge
from .results.store import Store as Store
