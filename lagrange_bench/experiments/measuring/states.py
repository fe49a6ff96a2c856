"""Initial states by name, and runs from them, for all experiments."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.interface import Array, Method, StepError, Stepper
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.vibrating_pivot import vibrating_pivot
from lagrange_bench.integrators.registry import NAMED_TOPS, POTENTIALS, Registry
from lagrange_bench.integrators.registry import find as find_record
from lagrange_bench.integrators.start import Start
from lagrange_bench.integrators.truth import truths
from lagrange_bench.support.words import numbers

# names of drawn tops (`integrators.problem.examples`), for which `find` takes any three digits
RANDOM = tuple(f"random{i:03d}" for i in range(16))  # generic tops, for statistics
CLOSE = tuple(f"close{i:03d}" for i in range(32))  # close to the separatrix
WIDE = tuple(f"wide{i:03d}" for i in range(200))  # tops of every kind
RELEASED = tuple(f"released{i:03d}" for i in range(200))  # released with pure spin
SPINNING = tuple(f"spinning{i:03d}" for i in range(100))  # released with pure and fast spin


def find(name: str) -> tuple[Any, Array]:
    """The problem and the initial state of a name, such as "generic" or "random000", by `Start.of`; ValueError if unknown."""
    start = Start.of(name)
    return start.top, start.state


def of_cell(cell: Mapping[str, Any], look_up: Callable[[str, Registry], Any] = find_record) -> tuple[Any, Array]:
    """The top and initial state of a cell, by the name in its `state`; for a top of a TOML file, by the numbers in the cell.

    look_up : finds a potential by its name. ValueError : the top or the potential is unknown.
    """
    if not isinstance(cell.get("y0"), str):  # NaN in a row of a frame
        return find(cell["state"])
    top: LagrangeTop | PerturbedTop = LagrangeTop(cell["alpha"])
    if isinstance(cell.get("potential"), str):
        parameters = tuple(numbers(cell["parameters"])) if cell["parameters"] else ()
        top = PerturbedTop(LagrangeTop(cell["alpha"]), look_up(cell["potential"], POTENTIALS), parameters)
    return top, top.check_state(numbers(cell["y0"]))


UNIFORM_TOP = LagrangeTop()


def label(state: str) -> str:
    """The name of a top in figures."""
    return str(NAMED_TOPS[state].label) if state in NAMED_TOPS else state


def methods_on(problem: Any = UNIFORM_TOP) -> dict[str, Method]:
    """Name → method, for the methods that take a problem; by default a top in a uniform field.

    `backlund_splitting` is left out in a uniform field, where it is `backlund`. A plug-in that cannot be loaded is left out, too:
    `lagrange-bench methods` says why.
    """
    from lagrange_bench.integrators import METHODS

    loaded = {name: method for name, method, _ in METHODS.each() if method}
    if kinds.uniform(problem):
        loaded.pop("backlund_splitting", None)
    return {name: m for name, m in loaded.items() if m.takes(problem) is None}


def log_counts(last: int, per_octave: int) -> list[int]:
    """Whole numbers from 1 to `last`, about `per_octave` in each doubling."""
    counts = {round(2 ** (k / per_octave)) for k in range(per_octave * last.bit_length() + 1)}
    return sorted(n for n in counts | {last} if n <= last)


# names, for `placed`, or starts of the user's own
Starts = Sequence[str | Start]
# `placed` takes these behind the name of a top
NEGATIVE, TIDE, CHARGE, PIVOT = " with alpha < 0", " in a tide", " near a charge", " on a vibrating pivot"


def placed(start: str | Start) -> Start:
    """A start with an array of its own: as `Start.of`, and for a top with one of the words above behind its name.

    A tide and a charge weigh nearly as much as the top, and a pivot vibrates in its time scale.
    """
    place = next(
        (place for place in (NEGATIVE, TIDE, CHARGE, PIVOT) if isinstance(start, str) and start.endswith(place)), ""
    )
    start_of_top = Start.of(start.removesuffix(place) if isinstance(start, str) else start)
    top, y0 = start_of_top.top, start_of_top.state.copy()
    if place:
        top = _elsewhere(top.alpha, float(np.linalg.norm(y0[3:])), float(top.scales(y0)[0]), place)
    return Start(top, y0, given_name=start if isinstance(start, str) else start_of_top.name)


@cache
def _elsewhere(alpha: float, size: float, rate: float, place: str) -> Any:
    if place == NEGATIVE:
        return LagrangeTop(-alpha)
    if place == PIVOT:
        return vibrating_pivot(alpha, 0.5 * alpha, rate)
    if place == TIDE:
        return PerturbedTop(LagrangeTop(alpha), POTENTIALS["tide"], (0.5 * alpha / size, 0.8, 0.0, 0.6))
    parameters = (0.2 * alpha * size**2, 0.0, 0.0, 1.5 * size)
    return PerturbedTop(LagrangeTop(alpha), POTENTIALS["charge"], parameters, axisymmetric=True)


def prepared(method: Method, top: Any, y: Array, h: float) -> Stepper:
    """A fresh stepper of a method, which may write to a state of its own only."""
    return method.prepare_for(top)(top, y.copy() if y.flags.writeable else y, float(h))


def sample(top: LagrangeTop, y0: Array, method: str, h: float, counts: list[int], **options) -> tuple[Array, Array]:
    """The times counts·h (N,), and the states of `method` at these times, (N, n).

    A method that steps by h is advanced from count to count. A method that chooses its own steps runs once, with dense output:
    a restart at every sample would change its steps.
    """
    from lagrange_bench.integrators import METHODS, prepare
    from lagrange_bench.integrators.api import integrate

    times = h * np.array(counts, dtype=float)
    if METHODS[method].control == "tolerance":
        return times, integrate(top, y0, t=times, method=method, **options).states
    stepper, y, done, states = prepare(top, y0, h, method, **options), y0, 0, []
    for n in counts:
        if stepper.from_start:  # its error must not depend on where it is sampled
            y, done = y0, 0
        try:
            y, done = stepper.advance(y, n - done), n
        except StepError as error:
            step = None if error.step is None else done + error.step
            raise StepError(error.method, error.reason, h=error.h, step=step) from None
        states.append(y)
    return times, np.array(states)


def truth(top: Any, y0: Array, method: Method, h: float, counts: ArrayLike) -> Array:
    """The exact states (N, n) after `counts` steps of h. A method that steps by h is at n·h itself, not at the nearest double."""
    if method.control == "tolerance":
        return truths.solution(top, y0, h * np.asarray(counts, dtype=float), longest=math.inf)
    return truths.after_steps(top, y0, h, counts, longest=math.inf)


ACCURACY_OPTIONS = ("h", "tol", "rtol")
SCHEME_OPTIONS = ("scheme", "corrector", "modified_kick", "high_accuracy")  # options that make a method another method
OPTIONS = ("tol", "rtol", "pin", *SCHEME_OPTIONS)
LEAST_RTOL = 1e-13  # SciPy takes no less than 100 eps


def interpreted(method: Method) -> bool:
    """Whether every step goes through the Python interpreter, which costs a thousand times as much as compiled code."""
    return method.engine in ("scipy", "python")


def affordable(method: Method, steps: int, full: bool) -> int:
    """The number of steps of a long run: `steps`, for interpreted methods at most a limit."""
    limit = 20_000 if full else 2_000
    return min(steps, limit) if interpreted(method) else steps


def accuracy_settings(method: Method, steps: Iterable[float], tolerances: Iterable[float]) -> list[dict[str, float]]:
    """Fields of cells, one for each run of a sweep: a step, or a tolerance if the method takes one."""
    if method.accuracy_option == "h":
        return [{"h": h} for h in steps]
    return [
        {method.accuracy_option: tol}
        for tol in tolerances
        if method.accuracy_option == "tol" or tol > 0.99 * LEAST_RTOL
    ]


def options_of(cell: dict[str, Any]) -> dict[str, Any]:
    """The options of a method that a cell sets: those in `OPTIONS`, and atol = rtol/1000."""
    from lagrange_bench.integrators import METHODS

    options: dict[str, Any] = {name: cell[name] for name in OPTIONS if name in cell}
    if "rtol" in options and "atol" in METHODS[cell["method"]].options:
        options["atol"] = options["rtol"] * 1e-3
    return options


def places(steps: int, parts: int = 16) -> list[int]:
    """Numbers of steps at the ends of `parts` equal parts of a run. The largest error there is hardly ever small by chance."""
    return sorted({max(steps * k // parts, 1) for k in range(1, parts + 1)})


def as_rows(columns: Mapping[str, Array]) -> list[dict[str, float]]:
    """Rows from measured columns of one length, with rounded numbers."""
    return [dict(zip(columns, map(rounded, values), strict=True)) for values in zip(*columns.values(), strict=True)]


def rounded(value: float, digits: int = 5) -> float:
    """The value with `digits` significant digits, which is enough for figures and journals."""
    return float(f"{value:.{digits - 1}e}")
