"""Everything a user needs, from one place.

    from lagrange_bench import LagrangeTop, integrate, METHODS      # the integrators
    from lagrange_bench import metrics, states, timing, check       # what the experiments measure with
    from lagrange_bench import work_precision                       # a few methods against each other: a figure and a frame
    from lagrange_bench import FixedStepper, compiled               # for a method of your own

Beside it, this package holds the command line (`commands`) and what runs cells (`runner`).
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING

ROOMS = ("integrators", "experiments", "results", "report")


def _check_rooms() -> None:
    """ImportError where another folder hides a package of the bench: nothing below would work."""
    home = Path(__file__).resolve().parents[1]
    for name in ROOMS:
        spec = importlib.util.find_spec(name)
        places = [Path(place) for place in spec.submodule_search_locations or [spec.origin or ""]] if spec else []
        if not any(place.resolve() == home / name for place in places):
            hides = f"{places[0]} hides" if places else "there is no"
            raise ImportError(
                f"{hides} the package {name!r} of lagrange-bench: rename it, start Python in another folder, or take its "
                "folder off PYTHONPATH"
            )


_check_rooms()

from integrators import __all__ as _INTEGRATORS  # noqa: E402
from integrators.lazy import face  # noqa: E402

if TYPE_CHECKING:
    from experiments.drawing import style
    from experiments.measuring import check, metrics, states, timing
    from integrators import *  # noqa: F403
    from integrators.compiling.compiled import compiled
    from integrators.compiling.loops import MEMORY, FixedStepper
    from lagrange_bench.comparison import work_precision
    from results.store import Store

__getattr__, __dir__ = face(
    __name__,
    {
        "integrators": tuple(_INTEGRATORS),
        "integrators.compiling.compiled": ("compiled",),
        "integrators.compiling.loops": ("MEMORY", "FixedStepper"),
        "experiments.drawing.style": (),
        "experiments.measuring.check": (),
        "experiments.measuring.metrics": (),
        "experiments.measuring.states": (),
        "experiments.measuring.timing": (),
        "lagrange_bench.comparison": ("work_precision",),
        "results.store": ("Store",),
    },
)
__all__ = [
    *_INTEGRATORS,
    "MEMORY",
    "FixedStepper",
    "Store",
    "check",
    "compiled",
    "metrics",
    "states",
    "style",
    "timing",
    "work_precision",
]
