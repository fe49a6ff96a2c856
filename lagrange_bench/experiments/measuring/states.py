"""Initial states by name, and runs from them, for all experiments."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lagrange_bench.integrators.interface import Method, StepError, Stepper
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.top import TOPS, Array, LagrangeTop
from lagrange_bench.integrators.registry import NAMED_TOPS, find_potential
from lagrange_bench.integrators.truth import truths
from lagrange_bench.support.words import numbers, suggestion

# names of drawn tops, for which `find` takes any three digits
RANDOM = tuple(f"random{i:03d}" for i in range(16))  # generic tops, for statistics
CLOSE = tuple(f"close{i:03d}" for i in range(32))  # close to the separatrix
WIDE = tuple(f"wide{i:03d}" for i in range(200))  # tops of every kind
RELEASED = tuple(f"released{i:03d}" for i in range(200))  # released with pure spin
SPINNING = tuple(f"spinning{i:03d}" for i in range(100))  # released with pure and fast spin
DRAWN = ("random", "wide", "released", "spinning", "close")
SPINS = {"wide": (-3, 3), "released": (-3, 2), "spinning": (2, 3)}  # least and largest log10 of |J|²/(|alpha||x|)
PROBLEMS = (
    "free_body",
    "vibrating_pivot",
    "kirchhoff_body",
    "central_spin",
)  # problems other than a top in a fixed field


def is_drawn(name: str) -> bool:
    """Whether this is the name of a top that `find` draws."""
    return re.fullmatch(rf"({'|'.join(DRAWN)})\d{{3}}", name) is not None


@cache
def problem(name: str) -> tuple[Any, Array]:
    """The problem and the initial state of a name in PROBLEMS."""
    from lagrange_bench.integrators.problem.kirchhoff import kirchhoff_body
    from lagrange_bench.integrators.problem.vibrating_pivot import vibrating_pivot

    if name == "free_body":
        return Problem("free_body", "so3", free_body, (1.0, 2.0, 3.0), frame="body"), np.array([0.3, -0.4, 1.2])
    if name == "vibrating_pivot":
        return vibrating_pivot(1.0, 0.5, 2.0), np.array([0.3, -0.2, 0.8, 0.6, 0.0, 0.8])
    if name == "kirchhoff_body":
        body = kirchhoff_body((1.0, 0.7, 0.4), (0.1, 0.2, -0.1), (0.5, 0.6, 0.9))
        return body, np.array([0.3, -0.2, 0.8, 0.6, 0.0, 0.8])
    spins = np.array([(0.6, 0.0, 0.8), (0.0, 1.0, 0.0), (0.8, 0.6, 0.0), (-0.48, 0.64, 0.6)])
    return Problem("central_spin", 4, central_spin, (0.8, 0.5, 0.3)), spins.ravel()


def free_body(t: Any, y: Any, p: Any) -> Any:
    """Euler's free body: H of the angular momentum in its frame, with moments of inertia p."""
    return (y[0] * y[0] / p[0] + y[1] * y[1] / p[1] + y[2] * y[2] / p[2]) / 2.0


def central_spin(t: Any, y: Any, p: Any) -> Any:
    """A spin s_1 in a field along e3, coupled with the strengths p to spins without a field: H = s_1³ + Σ p_k s_1·s_{k+1}."""
    return y[2] + sum(A * (y[:3] @ y[3 * k : 3 * k + 3]) for k, A in enumerate(p, start=1))


def find(name: str) -> tuple[Any, Array]:
    """The problem and initial state of a name: of a named top, of PROBLEMS, or of a drawn top such as "random000".

    Drawn tops have alpha in [0.3, 2], each J in [-2, 2] and |x| in [0.5, 2]. Python's own generator draws them; its `random()`
    never changes. "wide", "released" and "spinning" tops have either sign of alpha. For "wide" tops |J|²/(|alpha||x|) is from
    1e-3 to 1e3. "released" and "spinning" tops have J parallel or antiparallel to x, and |J|²/(|alpha||x|) from 1e-3 to 100 and
    from 100 to 1e3. For "close" tops, J misses the separatrix by a part of 1e-1 to 1e-8. ValueError : the name is unknown.
    """
    if name in TOPS:
        return TOPS[name].top, TOPS[name].state
    if name in PERTURBED_TOPS:
        return PERTURBED_TOPS[name].top, PERTURBED_TOPS[name].state
    if name in NAMED_TOPS:  # of a package
        return NAMED_TOPS[name].top, NAMED_TOPS[name].state
    if name in PROBLEMS:
        return problem(name)
    if not is_drawn(name):
        known = ", ".join((*NAMED_TOPS, *PROBLEMS, *(f"{kind}000 … {kind}999" for kind in DRAWN)))
        raise ValueError(f"unknown top or problem {name!r}{suggestion(name, (*NAMED_TOPS, *PROBLEMS))} Known: {known}")
    draw = random.Random(name)  # seeded by the text itself, through SHA-512
    J = [draw.uniform(-2, 2) for _ in range(3)]
    x = np.array([draw.uniform(-1, 1) for _ in range(3)])
    alpha, size = draw.uniform(0.3, 2), draw.uniform(0.5, 2)
    x *= size / math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    if name.startswith("close"):
        J = _near_separatrix(alpha, x, J[2] / 2, 10 ** draw.uniform(-8, -1) * draw.choice((-1, 1)))
    kind = name[:-3]
    if kind in ("released", "spinning"):
        J = list(draw.choice((-1, 1)) * x)
    if kind in SPINS:
        long = math.sqrt(10 ** draw.uniform(*SPINS[kind]) * alpha * size) / math.hypot(*J)
        J, alpha = [long * component for component in J], alpha * draw.choice((-1, 1))
    return LagrangeTop(alpha), np.array([*J, *x])


def of_cell(cell: Mapping[str, Any], potential: Callable[[str], Any] = find_potential) -> tuple[Any, Array]:
    """The top and initial state of a cell, by the name in its `state`; for a top of a TOML file, by the numbers in the cell.

    potential : a function that finds a potential by its name. ValueError : the top or the potential is unknown.
    """
    if not isinstance(cell.get("y0"), str):  # NaN in a row of a frame
        return find(cell["state"])
    top: LagrangeTop | PerturbedTop = LagrangeTop(cell["alpha"])
    if isinstance(cell.get("potential"), str):
        parameters = tuple(numbers(cell["parameters"])) if cell["parameters"] else ()
        top = PerturbedTop(LagrangeTop(cell["alpha"]), potential(cell["potential"]), parameters)
    return top, top.check_state(numbers(cell["y0"]))


def label(state: str) -> str:
    """The name of a top in figures."""
    return str(NAMED_TOPS[state].label) if state in NAMED_TOPS else state


def _near_separatrix(alpha: float, x: Array, share: float, off: float) -> list[float]:
    """A J near the separatrix J·x = J3 |x|, H = J3²/2 + alpha |x|. share : J3 over its maximum. off : relative, of J1 and J2."""
    size, flat = math.hypot(*x), math.hypot(x[0], x[1])
    J3 = share * math.sqrt(2 * alpha * (size + x[2]))
    along = J3 * (size - x[2]) / flat
    across = math.sqrt(2 * alpha * (size - x[2]) - along * along)
    along, across = along * (1 + off), across * (1 + off)
    return [(along * x[0] - across * x[1]) / flat, (along * x[1] + across * x[0]) / flat, J3]


def methods_on(state: str | None = None) -> dict[str, Method]:
    """Name → method, for the methods that take the problem of a state; None: a top in a uniform field.

    `backlund_splitting` is left out in a uniform field, where it is `backlund`. A plug-in that cannot be loaded is left out, too:
    `lagrange-bench methods` says why.
    """
    from lagrange_bench.integrators import METHODS

    loaded = {name: method for name, method, _ in METHODS.each() if method}
    top = find(state)[0] if state else LagrangeTop()
    if kinds.uniform(top):
        loaded.pop("backlund_splitting", None)
    return {name: m for name, m in loaded.items() if m.takes(top) is None}


def log_counts(last: int, per_octave: int) -> list[int]:
    """Whole numbers from 1 to `last`, about `per_octave` in each doubling."""
    counts = {round(2 ** (k / per_octave)) for k in range(per_octave * last.bit_length() + 1)}
    return sorted(n for n in counts | {last} if n <= last)


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
    stepper = prepare(top, y0, h, method, **options)
    return times, np.array([y for y, _ in follow(stepper, y0, counts)])


def follow(stepper: Stepper, y0: Array, counts: Iterable[int]) -> Iterator[tuple[Array, float]]:
    """The state after each of `counts` steps (rising), and the seconds spent on stepping so far."""
    y, done, seconds = y0, 0, 0.0
    for n in counts:
        if stepper.from_start:  # its error must not depend on where it is sampled
            y, done, seconds = y0, 0, 0.0
        start = perf_counter()
        try:
            y, done = stepper.advance(y, n - done), n
        except StepError as error:
            step = None if error.step is None else done + error.step
            raise StepError(error.method, error.reason, h=error.h, step=step) from None
        seconds += perf_counter() - start
        yield y, seconds


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
    """The number of steps of a long run: `steps`, for interpreted methods at most a limit, for implicit ones a tenth of it."""
    if not interpreted(method):
        return steps
    limit = 20_000 if full else 2_000
    return min(steps, limit // 10 if method.family == "implicit" else limit)


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
