"""Everything a user needs, from one place.

    from lagrange_bench import LagrangeTop, integrate, METHODS      # the integrators
    from lagrange_bench import check                                # does a method keep its word? on a problem of yours, too
    from lagrange_bench import metrics, states, timing              # what the experiments measure with
    from lagrange_bench import drift, phase, work_precision         # questions: a few methods, as a frame and as figures
    from lagrange_bench import load                                 # stored rows, the published ones among them, as frames
    from lagrange_bench import judge                                # the trajectory of any program, by the exact heavy top
    from lagrange_bench import explicit_stepper                     # for a method of your own, on any problem
    from lagrange_bench import FixedStepper, compiled               # and with a kernel of your own

Beside it, this package holds the command line (`commands`) and what runs cells (`runner`).
"""

from typing import TYPE_CHECKING

from lagrange_bench.integrators import __all__ as _INTEGRATORS
from lagrange_bench.integrators.lazy import face

if TYPE_CHECKING:  # `as` tells type checkers that a name is public: they cannot evaluate `__all__`
    from lagrange_bench.comparison import Comparison as Comparison
    from lagrange_bench.data import load as load
    from lagrange_bench.experiments.drawing import style as style
    from lagrange_bench.experiments.measuring import metrics as metrics
    from lagrange_bench.experiments.measuring import states as states
    from lagrange_bench.experiments.measuring import timing as timing
    from lagrange_bench.experiments.measuring.check import check as check
    from lagrange_bench.integrators import *  # noqa: F403
    from lagrange_bench.integrators.compiling.compiled import compiled as compiled
    from lagrange_bench.integrators.compiling.loops import MEMORY as MEMORY
    from lagrange_bench.integrators.compiling.loops import FixedStepper as FixedStepper
    from lagrange_bench.integrators.methods.explicit import explicit_stepper as explicit_stepper
    from lagrange_bench.judging import judge as judge
    from lagrange_bench.questions import *  # noqa: F403
    from lagrange_bench.results.store import Store as Store

_OTHERS = {
    "lagrange_bench.integrators.compiling.compiled": ("compiled",),
    "lagrange_bench.integrators.compiling.loops": ("MEMORY", "FixedStepper"),
    "lagrange_bench.integrators.methods.explicit": ("explicit_stepper",),
    "lagrange_bench.experiments.measuring.check": ("check",),
    "lagrange_bench.comparison": ("Comparison",),
    "lagrange_bench.questions": ("drift", "heavy_top", "order", "perturbed", "phase", "work_precision"),
    "lagrange_bench.data": ("load",),
    "lagrange_bench.judging": ("judge",),
    "lagrange_bench.results.store": ("Store",),
}
_MODULES = {f"lagrange_bench.experiments.measuring.{name}": () for name in ("metrics", "states", "timing")}
_MODULES["lagrange_bench.experiments.drawing.style"] = ()
__getattr__, __dir__ = face(__name__, {"lagrange_bench.integrators": tuple(_INTEGRATORS), **_OTHERS, **_MODULES})
__all__ = [*_INTEGRATORS, *sum(_OTHERS.values(), ()), "metrics", "states", "style", "timing"]
