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

# ruff: noqa: F401, names that `__all__` below is made of

from __future__ import annotations

from typing import TYPE_CHECKING

from lagrange_bench.integrators import __all__ as _INTEGRATORS
from lagrange_bench.integrators.lazy import face

if TYPE_CHECKING:
    from lagrange_bench.comparison import Comparison
    from lagrange_bench.data import load
    from lagrange_bench.experiments.drawing import style
    from lagrange_bench.experiments.measuring import metrics, states, timing
    from lagrange_bench.experiments.measuring.check import check
    from lagrange_bench.integrators import *  # noqa: F403
    from lagrange_bench.integrators.compiling.compiled import compiled
    from lagrange_bench.integrators.compiling.loops import MEMORY, FixedStepper
    from lagrange_bench.integrators.methods.explicit import explicit_stepper
    from lagrange_bench.judging import judge
    from lagrange_bench.questions import drift, heavy_top, order, perturbed, phase, work_precision
    from lagrange_bench.results.store import Store

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
