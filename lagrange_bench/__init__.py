"""Everything a user needs, from one place.

    from lagrange_bench import LagrangeTop, integrate, METHODS      # the integrators
    from lagrange_bench import check                                # does a method keep its word? on a problem of yours, too
    from lagrange_bench import metrics, states, timing              # what the experiments measure with
    from lagrange_bench import drift, phase, work_precision         # questions: a few methods, as a frame and as figures
    from lagrange_bench import load                                 # stored rows, the published ones among them, as frames
    from lagrange_bench import judge                                # the trajectory of any program, by the exact motion
    from lagrange_bench import assert_drift, assert_order           # for the tests of your own method
    from lagrange_bench import explicit_stepper                     # for a method of your own, on any problem
    from lagrange_bench import FixedStepper, Kernel, compiled       # and with a kernel of your own

docs/how-it-is-built.md names the rooms of this package.
"""

from typing import TYPE_CHECKING

from lagrange_bench.integrators import __all__ as _INTEGRATORS
from lagrange_bench.support.lazy import exported, public_module

if TYPE_CHECKING:  # `as` tells type checkers that a name is public: they cannot evaluate `__all__`
    from lagrange_bench.ask.comparison import Comparison as Comparison
    from lagrange_bench.ask.data import load as load
    from lagrange_bench.ask.questions import drift as drift
    from lagrange_bench.ask.questions import order as order
    from lagrange_bench.ask.questions import phase as phase
    from lagrange_bench.ask.questions import work_precision as work_precision
    from lagrange_bench.ask.testing import assert_drift as assert_drift
    from lagrange_bench.ask.testing import assert_order as assert_order
    from lagrange_bench.experiments.drawing import style as style
    from lagrange_bench.experiments.measuring import metrics as metrics
    from lagrange_bench.experiments.measuring import states as states
    from lagrange_bench.experiments.measuring import timing as timing
    from lagrange_bench.experiments.measuring.check import check as check
    from lagrange_bench.integrators import *  # noqa: F403
    from lagrange_bench.integrators.compiling.compiled import compiled as compiled
    from lagrange_bench.integrators.compiling.loops import MEMORY as MEMORY
    from lagrange_bench.integrators.compiling.loops import FixedStepper as FixedStepper
    from lagrange_bench.integrators.compiling.loops import Kernel as Kernel
    from lagrange_bench.integrators.methods.explicit import explicit_stepper as explicit_stepper
    from lagrange_bench.judging import judge as judge
    from lagrange_bench.results.store import Store as Store

_HOMES = {**exported(__file__), "lagrange_bench.integrators": tuple(_INTEGRATORS)}
__getattr__, __dir__ = public_module(__name__, _HOMES)
__all__ = sorted(sum(_HOMES.values(), ()))
