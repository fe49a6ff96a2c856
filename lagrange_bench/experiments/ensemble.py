"""Ensembles: how much does a step cost among thousands of tops, each with its own alpha, torus and λ(h)?

The scalar step is compared with its bound, a chain of operations that must wait for each other. The chain has the additions,
products and divisions on the longest way from one state to the next. The SIMD form is timed against the number of tops, lanes
and threads. Set-up is timed against h: it computes λ(h) and all constants in double-double. Memory is measured in arrays of
states.

The rivals are heyoka in batch mode, and splittings and a Runge-Kutta formula, one top after another. (In SIMD lanes, which the
bench once had for them, they took 0.1 to 0.4 of this time.) All cover the same time with tops of the same kind. Nanoseconds per
top and unit of time, with set-up, are shown against the error. One jump to a far time is a row of its own.

Tops in a weak tide, each with its own strength, are followed by the exact step inside a splitting and by its rivals. Times are
in the units of the tops: alpha in [0.3, 2], each J in [−2, 2], |x| in [0.5, 2].
"""

import tracemalloc
from collections.abc import Callable, Iterable
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from lagrange_bench.experiments.ensemble_figures import draw as draw
from lagrange_bench.experiments.ensemble_figures import tables as tables
from lagrange_bench.experiments.ensemble_sizes import FEW, FIELD_JUDGED, FIELD_SPAN, FIELD_TOPS, JUDGED, RIVALS
from lagrange_bench.experiments.measuring import metrics, timing
from lagrange_bench.experiments.measuring.states import options_of, rounded, truth
from lagrange_bench.integrators import (
    METHODS,
    POTENTIALS,
    LagrangeTop,
    PerturbedTop,
    StepError,
    integrate_ensemble,
    prepare,
)
from lagrange_bench.integrators.compiling.compiled import compiled
from lagrange_bench.integrators.compiling.lanes import run_lanes
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.methods.taylor import equations
from lagrange_bench.integrators.torus import real_map
from lagrange_bench.integrators.truth import exact, reference
from lagrange_bench.support.machine import usable_cores

VERSION = 3
COST = ("us_per_top", "ns_per_time", "error", "largest_error")
MEASURED = {
    "bound": ("pinned_ns", "pinned_bound_ns", "pinned_ratio", "free_ns", "free_bound_ns", "free_ratio"),
    "tops": ("steps", "ns_per_step", "ns_per_step_and_core", "setup_us"),
    "lanes": ("tops", "pinned_ns_per_step", "free_ns_per_step"),
    "setup": ("tops", "setup_us", "first_step_us"),
    "many": ("steps", "threads", "seconds", "us_per_top", "memory"),
    "rival": COST,
    "jump": COST,
    "perturbed": (*COST, "setup_us", "ns_per_kick"),
}

STEP = 0.1
BUDGET = 2e7  # steps of all tops together in one sample
TOPS = {"quick": (32, 8192), "full": (1, 8, 32, 128, 1024, 8192, 65_536, 262_144)}
WIDTHS = {"quick": (8, 32), "full": (8, 16, 32, 64, 128, 256)}
MANY = {"quick": (10_000, 100_000), "full": (10_000, 100_000, 1_000_000, 10_000_000)}
SETUP = {"quick": (0.1, 1.0, 10.0), "full": (0.001, 0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)}
SPAN = 10_000.0  # length of the rivals' runs
TRIED: dict[str, dict[str, tuple[float, ...]]] = {
    "quick": {"backlund": (1.0,), "taylor": (2.3e-16,), "blanes_moan6": (0.2,)},
    "full": {
        "backlund": (0.1, 0.25, 1.0, 4.0),
        "taylor": (1e-3, 1e-6, 1e-9, 1e-12, 2.3e-16),
        "strang": (0.01, 0.05),
        "force_gradient4": (0.05, 0.1, 0.2),
        "force_gradient6": (0.05, 0.1, 0.2),
        "blanes_moan6": (0.05, 0.1, 0.2, 0.5),
        "kahan_li8": (0.05, 0.1, 0.2, 0.4),
        "verner9_fixed": (0.05, 0.1, 0.2, 0.4),
    },
}
IN_FIELD: dict[str, dict[str, tuple[float, ...]]] = {  # h, below an eighth of all nutation periods
    "quick": {},  # its kernels take a minute to compile
    "full": {
        "backlund_splitting": (0.075, 0.15),
        "force_gradient6": (0.15,),
        "blanes_moan6": (0.075, 0.15),
    },
}
STRENGTH, DIRECTION = 1e-4, (1.0, 0.0, 0.0)  # of the tide; the strength varies by half of it, up and down


def cells(profile: str) -> list[dict]:
    cores = usable_cores()
    listed: list[dict] = [{"part": "bound"}]
    for tops in TOPS[profile]:
        listed.append({"part": "tops", "tops": tops, "threads": 1, "budget": BUDGET})
        if cores > 1 and tops >= 1024:
            listed.append({"part": "tops", "tops": tops, "threads": cores, "budget": BUDGET})
    listed += [{"part": "lanes", "lanes": lanes} for lanes in WIDTHS[profile]]
    listed += [{"part": "setup", "h": h} for h in SETUP[profile]]
    listed += [{"part": "many", "tops": tops} for tops in MANY[profile]]
    for method, values in TRIED[profile].items():
        tops = RIVALS[METHODS[method].engine]
        run = {"part": "rival", "method": method, "tops": tops, "span": SPAN}
        listed += [{**run, METHODS[method].accuracy_option: value} for value in values]
    listed.append({"part": "jump", "method": "backlund", "tops": RIVALS["numba"], "span": SPAN})
    for method, steps in IN_FIELD[profile].items():
        run = {"part": "perturbed", "method": method, "potential": "tide", "tops": FIELD_TOPS, "span": FIELD_SPAN}
        listed += [{**run, "h": h} for h in steps]
    return [{"timing": True, **cell} for cell in listed]


def measure(cell: dict) -> list[dict]:
    return [MEASURES[cell["part"]](cell)]


def alphas_and_states(n: int) -> tuple[Array, Array]:
    """alpha (n,) and states (n, 6) of n tops, the same ones every time."""
    generator = np.random.default_rng(20040328)
    Y = generator.uniform(-2, 2, (n, 6))
    Y[:, 3:] *= (generator.uniform(0.5, 2, n) / np.linalg.norm(Y[:, 3:], axis=1))[:, None]
    return generator.uniform(0.3, 2, n), Y


# ---------------------------------------------------------------- the scalar step and its bound


@compiled
def step_chain(x, a, b):
    """The longest chain of `real_map.step`, in its order: five additions, three products, one division."""
    y = x + a
    y = y * y
    y = y + a
    y = y + a
    y = b / y
    y = y * b
    y = y + a
    y = y * b
    return y + a


@compiled
def pin_chain(x, a, b):
    """The longest chain of `real_map.restore_invariants`: eleven additions, six products, one division."""
    y = x * x
    y = y + a
    y = y + a
    y = y + a
    y = y + a
    y = y + a
    y = y * b
    y = y + a
    y = y * b
    y = y - a
    y = y * b
    y = y + a
    y = y + a
    y = b / y
    y = y * b
    y = y * b
    y = y + a
    return a - y


@compiled
def chains(n, block, x, a, b):
    """n steps. `pin_chain` runs before every `block` of them, or never if `block` is 0."""
    if block == 0:
        for _ in range(n):
            x = step_chain(x, a, b)
        return x
    for _ in range(n // block):
        x = pin_chain(x, a, b)
        for _ in range(block):
            x = step_chain(x, a, b)
    return x


def _measure_bound(cell: dict) -> dict:
    """Time the scalar step and its chain in turn, so that both meet the same disturbances."""
    (alpha,), (y0,) = alphas_and_states(1)
    one, n, block = LagrangeTop(alpha), 80_000, 8
    pinned, free = prepare(one, y0, STEP), prepare(one, y0, STEP, "backlund_unpinned")
    functions = {
        "pinned": lambda: pinned.advance(y0, n),
        "pinned_bound": lambda: chains(n, block, 0.7, 0.9, 0.8),
        "free": lambda: free.advance(y0, n),
        "free_bound": lambda: chains(n, 0, 0.7, 0.9, 0.8),
    }
    timed = timing.interleave(functions, repeats=9)
    row = {f"{name}_ns": rounded(t.min / n * 1e9) for name, t in timed.items()}
    for name in ("pinned", "free"):
        row[f"{name}_ratio"] = rounded(timed[name].min / timed[f"{name}_bound"].min)
    return row


# ---------------------------------------------------------------- many tops


def _measure_tops(cell: dict) -> dict:
    """Time a long run and the shortest run with the same set-up: their difference is the cost of the steps."""
    alphas, Y = alphas_and_states(cell["tops"])
    top = LagrangeTop(alphas)
    steps = max(2000, round(cell["budget"] / cell["tops"]))

    def run(n):
        return integrate_ensemble(top, Y, STEP, n, threads=cell["threads"])

    few = 1
    timed = timing.interleave({"long": lambda: run(steps), "short": lambda: run(few)}, repeats=5)
    long, short = timed["long"].min, timed["short"].min
    per_step = (long - short) / (steps - few) / cell["tops"] * 1e9
    return {
        "steps": steps,
        "ns_per_step": rounded(per_step),
        "ns_per_step_and_core": rounded(per_step * min(cell["threads"], usable_cores())),
        "setup_us": rounded(short / cell["tops"] * 1e6 - few * per_step / 1e3),
    }


def _measure_lanes(cell: dict) -> dict:
    n, steps = 1024, 1000
    alphas, Y = alphas_and_states(n)
    states, units, c = np.empty((n, 6)), np.empty((n, 6)), np.empty((n, real_map.CONSTANTS))
    forms, out = np.empty(n, dtype=np.int64), np.empty((1, n, 6))
    real_map.many_constants(alphas, Y, STEP, states, c, units, forms, np.empty((n, 4)))
    tops, row = np.flatnonzero(forms == 0), {}
    for name, kernel in (
        ("pinned", (real_map.step, real_map.restore_invariants, 8)),
        ("free", (real_map.step, None, 1 << 62)),
    ):

        def run(kernel=kernel, steps=steps):
            run_lanes(kernel, states, c, tops, steps, steps, out, lambda: False, lanes=cell["lanes"])

        seconds = timing.time_call(run, repeats=9).min
        row[f"{name}_ns_per_step"] = rounded(seconds / steps / len(tops) * 1e9)
    return {"tops": len(tops), **row}


def _measure_setup(cell: dict) -> dict:
    n = 4096
    alphas, Y = alphas_and_states(n)
    top = LagrangeTop(alphas)
    arrays = *(np.empty((n, k)) for k in (6, real_map.CONSTANTS, 6)), np.empty(n, dtype=np.int64), np.empty((n, 4))
    alone = timing.time_call(lambda: real_map.many_constants(alphas, Y, cell["h"], *arrays), repeats=5).min
    whole = timing.time_call(lambda: integrate_ensemble(top, Y, cell["h"], 1, threads=1), repeats=5).min
    return {"tops": n, "setup_us": rounded(alone / n * 1e6), "first_step_us": rounded(whole / n * 1e6)}


def _measure_many(cell: dict) -> dict:
    """Seconds and memory of a short run of very many tops; memory in units of one array of states."""
    alphas, Y = alphas_and_states(cell["tops"])
    top = LagrangeTop(alphas)
    integrate_ensemble(LagrangeTop(alphas[:1]), Y[:1], STEP, 1)
    samples = []
    for _ in range(2):  # too long for more
        start = perf_counter()
        integrate_ensemble(top, Y, STEP, FEW)
        samples.append(perf_counter() - start)
    seconds = min(samples)
    tracemalloc.start()
    try:
        integrate_ensemble(top, Y, STEP, FEW)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return {
        "steps": FEW,
        "threads": usable_cores(),
        "seconds": rounded(seconds),
        "us_per_top": rounded(seconds / cell["tops"] * 1e6),
        "memory": rounded(1 + peak / Y.nbytes),  # Y0 and all new arrays
    }


# ---------------------------------------------------------------- rivals


def follow_in_batches(alphas: Array, Y: Array, span: float, tol: float) -> Callable[[], Array]:
    """Make a function that follows the tops in heyoka's batch mode: one top in each SIMD lane, with its own steps."""
    import heyoka as hy

    width = hy.recommended_simd_size()
    batch = hy.taylor_adaptive_batch(equations(), np.ones((6, width)), tol=tol, compact_mode=False)

    def run() -> Array:
        end = np.empty_like(Y)
        for first in range(0, len(Y), width):
            places = np.minimum(np.arange(first, first + width), len(Y) - 1)  # the last top fills free lanes
            batch.set_time(0.0)
            batch.pars[:], batch.state[:] = alphas[places], Y[places].T
            batch.propagate_until(np.full(width, span))
            if any(result[0] != hy.taylor_outcome.time_limit for result in batch.propagate_res):
                raise StepError("taylor", f"heyoka: {batch.propagate_res}")
            end[first : first + width] = batch.state.T[: len(Y) - first]
        return end

    return run


def _measure_rival(cell: dict) -> dict:
    alphas, Y = alphas_and_states(cell["tops"])
    span, h = cell["span"], cell.get("h", cell["span"])
    steps, options = round(span / h), options_of(cell)
    top = LagrangeTop(alphas)

    def run() -> Any:
        return integrate_ensemble(top, Y, span / steps, steps, cell["method"], threads=1, **options)

    if cell["method"] == "taylor":
        run = follow_in_batches(alphas, Y, span, **options)
    right = partial(truth, method=METHODS[cell["method"]], h=span / steps, counts=[steps])
    return _judged(run, lambda one, y0: right(one, y0)[0], map(LagrangeTop, alphas), Y, span)


def _measure_jump(cell: dict) -> dict:
    (alphas, Y), span = alphas_and_states(cell["tops"]), cell["span"]
    top = LagrangeTop(alphas)

    def run() -> Array:
        return integrate_ensemble(top, Y, t=[span], threads=1)[0]

    return _judged(run, lambda one, y0: exact.solution(one, y0, span), map(LagrangeTop, alphas), Y, span)


def _measure_perturbed(cell: dict) -> dict:
    """Time tops in tides of different strengths. The cost of a kick is the difference to a run of one step."""
    n, method, span = cell["tops"], cell["method"], cell["span"]
    (alphas, Y), steps = alphas_and_states(n), round(span / cell["h"])
    h = span / steps
    strengths, tide = STRENGTH * np.random.default_rng(20040328).uniform(0.5, 1.5, n), POTENTIALS[cell["potential"]]
    problem = PerturbedTop(LagrangeTop(alphas), tide, (strengths, *DIRECTION))

    def run(steps: int = steps) -> Any:
        return integrate_ensemble(problem, Y, h, steps, method, threads=1)

    pairs = list(zip(alphas, strengths, strict=True))[:FIELD_JUDGED]
    ones = [PerturbedTop(LagrangeTop(a), tide, (k, *DIRECTION)) for a, k in pairs]
    row = _judged(run, lambda one, y0: reference.solution(one, y0, [span]).states[0], ones, Y, span)
    alone = prepare(ones[0], Y[0], h, method)
    alone.advance(Y[0], 1)
    timed = timing.interleave({"long": run, "short": lambda: run(1)}, repeats=5)
    short = timed["short"].min / n
    per_kick = (timed["long"].min / n - short) / (steps - 1) / alone.work.rhs_evals
    return {**row, "setup_us": rounded(short * 1e6), "ns_per_kick": rounded(per_kick * 1e9)}


def _judged(
    run: Callable[[], Any], right: Callable[..., Array], ones: Iterable[Any], Y: Array, span: float
) -> dict[str, float]:
    """Cost on one core, and errors of the first JUDGED tops of `ones`. right : (top, y0) → its true state at the end."""
    end = run()
    judged = list(zip(ones, Y, end, strict=False))[:JUDGED]
    errors = [float(metrics.scaled_error(one, y0, y, right(one, y0))) for one, y0, y in judged]
    seconds = timing.time_call(run, repeats=3).min
    per_top = seconds / len(Y)
    return {
        "error": rounded(float(np.median(errors))),
        "largest_error": rounded(max(errors)),
        "us_per_top": rounded(per_top * 1e6),
        "ns_per_time": rounded(per_top / span * 1e9),
    }


MEASURES = {
    "bound": _measure_bound,
    "tops": _measure_tops,
    "lanes": _measure_lanes,
    "setup": _measure_setup,
    "many": _measure_many,
    "rival": _measure_rival,
    "jump": _measure_jump,
    "perturbed": _measure_perturbed,
}
