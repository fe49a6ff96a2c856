"""Sweeps: an experiment described by a TOML file, with tops, methods, steps and tolerances of your own.

Every field of such a file is explained in docs/sweeps.md. What is read becomes an experiment like all others, called
sweep_NAME. Its cells carry alpha, the potential and the initial state, so that no file is needed to compute or draw them.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import product
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from lagrange_bench.experiments import SWEEP
from lagrange_bench.experiments.measuring import metrics, timing
from lagrange_bench.experiments.measuring.states import KNOBS, as_rows, find, follow, options_of
from lagrange_bench.integrators import INVARIANTS, PerturbedTop, StepError, prepare
from lagrange_bench.integrators.api import integrate
from lagrange_bench.integrators.checks import MOST, check_count, check_real, check_state, check_step
from lagrange_bench.integrators.files import read_toml
from lagrange_bench.integrators.interface import Array, Method
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.registry import NAMED_TOPS, NotInstalled, find_method, find_potential
from lagrange_bench.integrators.truth import truths
from lagrange_bench.integrators.words import numbers, option, suggestion

if TYPE_CHECKING:
    import pandas as pd

VERSION = 3  # of rows whose seconds leave out compilation
MEASURED = {"": ("t", "H", "C1", "C2")}  # J3 and the error only where the top and the truth have them
TIMES = ("seconds",)  # columns that no two runs have in common

SAMPLES = 32
LARGEST = 1e100  # step: beyond, there is nothing to draw
EARLIEST = 1e-3  # first recorded time of a method that chooses its own steps, as a part of the last

Cell = dict[str, Any]
Start = dict[str, Any]  # the fields of a cell that say where it starts
_cells: dict[str, list[Cell]] = {}  # of the files read in this process, by experiment


# ---------------------------------------------------------------- the file


def _of_kind(kind: type, what: str, value: Any, name: str) -> Any:
    """`value`, if it is of this kind and no empty list."""
    if not isinstance(value, kind) or value == []:
        raise ValueError(f"{name} must be a {what}; got {value!r}")
    return value


_table, _word = partial(_of_kind, dict, "table"), partial(_of_kind, str, "name")
_list = partial(_of_kind, list, "list with something in it, as […]")


def _words(value: Any, name: str) -> list[str]:
    return [_word(word, name) for word in _list(value, name)]


def _numbers(value: Any, name: str) -> list[float]:
    return [check_real(number, f"{name}[{i}]") for i, number in enumerate(_list(value, name))]


KEYS: dict[str, dict[str, Callable[[Any, str], Any]]] = {  # of each table, with what checks their values
    "file": {"name": _word, "tops": _table, "sweep": _list},
    "top": {"alpha": check_real, "J": _numbers, "x": _numbers, "potential": _word, "parameters": _numbers},
    "sweep": {
        **{"methods": _words, "tops": _words, **dict.fromkeys(KNOBS, _numbers), "time": check_real, "options": _table},
        **{"steps": partial(check_count, least=1), "samples": partial(check_count, least=2)},
    },
}


def _checked(table: Any, kind: str) -> dict[str, Any]:
    """The values of a table; ValueError names the key that is unknown or has a wrong value."""
    known = KEYS[kind]
    for key in _table(table, "it"):
        if key not in known:
            raise ValueError(f"unknown key {key!r}{suggestion(key, known)} Known: {', '.join(known)}")
    return {key: known[key](value, key) for key, value in table.items()}


def read(path: str | Path) -> str:
    """Reads a file and returns the name of its experiment, which `experiments.load` knows from now on.

    Raises
    ------
    ValueError : what is wrong, where in the file, and what may have been meant. OSError : there is no such file.
    """
    path = Path(path)
    table = read_toml(path)
    if isinstance(table.get("sweep"), dict):
        raise ValueError(f"{path}: write [[sweep]], with two brackets")
    with _at(f"{path}, "):
        content: dict[str, Any] = {"name": path.stem, "tops": {}} | _checked(table, "file")
        name, sweeps = content["name"], content.get("sweep", ())
        if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
            raise ValueError(f'name must consist of letters, digits, _ and -; got {name!r}: set name = "…"')
        if not sweeps:
            raise ValueError("nothing to compute: add a table [[sweep]], with two brackets")
        tops = {own: _own_top(own, table) for own, table in content["tops"].items()}
        listed: dict[str, Cell] = {}
        for number, table in enumerate(sweeps, 1):
            with _at("[[sweep]]" + (f" {number}, " if len(sweeps) > 1 else ", ")):
                listed |= {repr(cell): cell for cell in _sweep(table, tops)}  # each cell once
        experiment, cells = f"{SWEEP}{name}", list(listed.values())
        if _cells.setdefault(experiment, cells) != cells:
            raise ValueError(f"name: another file of this run is called {name!r}, too")
    return experiment


@contextmanager
def _at(place: str) -> Iterator[None]:
    """What goes wrong inside is said with its place in the file."""
    try:
        yield
    except (ValueError, TypeError, NotInstalled) as error:
        raise ValueError(f"{place}{error}") from None


def _own_top(name: str, table: Any) -> Start:
    with _at(f"[tops.{name}], "):
        if _known_top(name):
            raise ValueError("the bench has a top of this name; choose another")
        given = _checked(table, "top")
        if missing := [key for key in ("alpha", "J", "x") if key not in given]:
            raise ValueError(f"{', '.join(missing)} must be given")
        if "parameters" in given and "potential" not in given:
            raise ValueError("parameters: of which potential? Give potential = NAME, too")
        y0 = check_state([*given["J"], *given["x"]], "J and x")
        start = {"top": name, "alpha": given["alpha"], "y0": _text(y0)}
        if "potential" in given:
            start |= {"potential": given["potential"], "parameters": _text(given.get("parameters", ()))}
        top = _top(start)
        if "uniform" not in top.offers:
            top.check_state(y0)
        if not math.isfinite(top.scales(y0)[2]):
            raise ValueError("it is at rest for ever, without weight and spin: its time has no scale")
    return start


def _text(values: Iterable[float]) -> str:
    return ",".join(repr(float(value)) for value in values)  # as the options of `integrate` take them


def _top(start: Start) -> Any:
    """The top of a cell; ValueError if its potential cannot be had."""
    top = LagrangeTop(start["alpha"])
    if "potential" not in start:
        return top
    with _at("potential: "):
        parameters = tuple(numbers(start["parameters"])) if start["parameters"] else ()
        return PerturbedTop(top, find_potential(start["potential"]), parameters)


def _known_top(name: str) -> bool:
    """Whether the bench itself, or a package, has a top of this name."""
    return name in NAMED_TOPS or re.fullmatch(r"random\d{3}", name) is not None


def _one_of(table: dict[str, Any], keys: tuple[str, ...]) -> str:
    given = [key for key in keys if key in table]
    if len(given) != 1:
        raise ValueError(f"give one of {', '.join(keys)}" + (f"; got {' and '.join(given)}" if given else ""))
    return given[0]


def _sweep(table: Any, tops: dict[str, Start]) -> Iterator[Cell]:
    """The cells of one table."""
    given: dict[str, Any] = {"samples": SAMPLES, "options": {}, "tops": list(tops) or ["generic"]}
    given |= _checked(table, "sweep")
    if "methods" not in given:
        raise ValueError("methods must be given, a list of names")
    knob, length = _one_of(given, KNOBS), _one_of(given, ("time", "steps"))
    if knob != "h" and length == "steps":
        raise ValueError(f"steps goes with h; with {knob} give time only")
    if length == "time" and not given["time"] > 0:
        raise ValueError(f"time must be positive; got {given['time']:g} (a negative h runs backwards)")
    for i, value in enumerate(given[knob]):
        check_step(value, f"{knob}[{i}]")
        if not 1 / LARGEST <= (abs(value) if knob == "h" else value) <= LARGEST:
            raise ValueError(f"{knob}[{i}] must be between {1 / LARGEST:g} and {LARGEST:g}; got {value:g}")
    # as the words that --option of `integrate` takes
    options = {key: str(v).lower() if isinstance(v, bool) else str(v) for key, v in given["options"].items()}
    starts = [_start(name, tops) for name in given["tops"]]
    for name in given["methods"]:
        _check_method(name, {knob: given[knob][0]}, starts, options)
    text = ", ".join(f"{key}={value}" for key, value in options.items())
    for start, name, value in product(starts, given["methods"], given[knob]):
        extent: Cell = {"span": given.get("time")}
        if knob == "h":
            n = given["steps"] if length == "steps" else round(min(given["time"] / abs(value), 2.0 * MOST))
            extent = {"steps": check_count(n, "time / h", least=1)}
        yield {"method": name, **start, "options": text, knob: value, **extent, "samples": given["samples"]}


def _start(name: str, tops: dict[str, Start]) -> Start:
    """The fields of a cell that say where it starts."""
    if name in tops:
        return tops[name]
    if not _known_top(name):
        names = [*tops, *NAMED_TOPS, "random000"]
        known = f"Known: {', '.join(names)} … random999"
        raise ValueError(f"tops: unknown top {name!r}{suggestion(name, names)} {known}")
    top, y0 = find(name)
    start = {"top": name, "alpha": top.single(), "y0": _text(y0)}
    if "uniform" not in top.offers:
        start |= {"potential": top.potential.name, "parameters": _text(top.parameters)}
    return start


def _check_method(name: str, knob: dict[str, float], starts: list[Start], words: dict[str, str]) -> None:
    """Whether there is the method, and takes this knob, these tops, and these options."""
    with _at("methods: "):
        method = find_method(name)
    (key,) = knob
    if key != method.knob and (key == "h" or method.control == "step" or key not in method.options):
        what = "steps by h" if method.control == "step" else "chooses its own steps"
        raise ValueError(f"{key}: {name} {what}: give it {method.knob} = […], in a [[sweep]] of its own")
    if key in words:
        raise ValueError(f"options: {key} is swept already")
    options: dict[str, Any] = dict(option(f"{key}={word}") for key, word in words.items())
    for start in starts:
        top, y0 = _top(start), np.array(numbers(start["y0"]))
        if reason := method.takes(top):
            advice = f"give the top {start['top']} to others, in a [[sweep]] of their own"
            raise ValueError(f"methods: {reason}: {advice}")
        if key != "h" and method.evaluate_for(top) is None:
            raise ValueError(f"methods: {name} has no dense output for the top {start['top']}")
        if options:  # what they may be, only the method knows
            with suppress(StepError), _at(f"options of {name}: "):  # a StepError, of this top and step, is a result
                if "h" in knob:
                    prepare(top, y0, knob["h"] * top.scales(y0)[2], method, **options)
                else:
                    integrate(top, y0, t=[0.0], method=method, **(options | knob))


# ---------------------------------------------------------------- the experiment


def module(experiment: str) -> ModuleType:
    """The experiment as a module, with what the engine and the report ask of one."""
    name = experiment.removeprefix(SWEEP)
    made = ModuleType(
        experiment,
        f"Sweep {name}.\n\nTimes, steps and tolerances of the file that was run are those of the top's own units: time in "
        "units of 1/(|J| + √(|alpha||x|)).",
    )

    def cells(profile: str) -> list[Cell]:
        if experiment not in _cells:
            raise ValueError(f"the cells of {experiment} are in a TOML file: lagrange-bench run FILE.toml")
        return _cells[experiment]

    shared = ("VERSION", "TIMES", "MEASURED", "measure", "draw", "tables", "__file__")
    vars(made).update({part: globals()[part] for part in shared}, cells=cells)
    return made


def measure(cell: Cell) -> list[dict[str, Any]]:
    """Drift of the invariants and errors along one run."""
    method, top, y0 = find_method(cell["method"]), _top(cell), np.array(numbers(cell["y0"]))
    options = dict(option(word) for word in cell["options"].split(", ") if word)
    timing.compile_at_once()
    rate, _, unit = top.scales(y0)
    counts, times, states, seconds = _run(method, top, y0, unit, cell, options)
    drift = metrics.relative_drift(top.invariants(np.vstack([y0, states])), top.invariant_scales(y0))[1:]
    columns = {"t": times * rate, **dict(zip(INVARIANTS, drift.T, strict=True))}
    if "J3" not in top.conserved:
        columns["J3"] = np.full(len(times), np.nan)
    columns |= dict.fromkeys(("error", "time", "angle"), np.full(len(times), np.nan))
    try:
        if counts is None or method.control == "tolerance":
            right = truths.solution(top, y0, times)
        else:
            right = truths.after_steps(top, y0, cell["h"] * unit, counts)
        columns["error"] = metrics.scaled_error(top, y0, states, right)
        if "uniform" in top.offers:  # there is no torus in a potential
            split = metrics.phase_split(top, right, states - right)
            columns |= {"time": split["time"] * rate, "angle": split["angle"]}
    except ValueError as error:  # beyond what doubles resolve: the method has an answer, the truth has none
        warnings.warn(f"no {truths.name(top)} to compare with: {error}", RuntimeWarning, stacklevel=1)
    columns["seconds"] = seconds
    return as_rows(columns)


def _run(
    method: Method, top: Any, y0: Array, unit: float, cell: Cell, options: dict[str, Any]
) -> tuple[list[int] | None, Array, Array, Array]:
    """Steps if it takes them, times (N,), states (N, 6) and the seconds spent until then (N,), at times growing geometrically."""
    if "h" in cell:
        h, n = cell["h"] * unit, cell["steps"]
        counts = sorted({round(n ** (k / (cell["samples"] - 1))) for k in range(cell["samples"])})
        stepper = prepare(top, y0, h, method, **options)
        stepper.advance(y0, 1)  # compiles
        recorded, clock = zip(*follow(stepper, y0, counts), strict=True)
        return counts, h * np.array(counts, dtype=float), np.array(recorded), np.array(clock)
    options = options_of(cell) | options
    times = cell["span"] * unit * np.geomspace(EARLIEST, 1, cell["samples"])
    integrate(top, y0, t=times[:1], method=method, **options)  # compiles
    start = perf_counter()
    states = integrate(top, y0, t=times, method=method, **options).y
    seconds = np.full(len(times), np.nan)  # it goes through in one go
    seconds[-1] = perf_counter() - start
    return None, times, states, seconds


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The largest error and drift of each run."""
    import pandas as pd

    from lagrange_bench.experiments.measuring.reductions import largest

    table = []
    for _, run in rows.groupby("key", sort=False):
        first = {name: value for name, value in run.iloc[0].items() if value == value}
        cell: Cell = {"options": "", "failure": None, **first}
        done = cell["status"] == "done"
        row = {name: cell.get(name, np.nan) for name in ("top", "method", "options", *KNOBS)}
        row["error at the end"] = run.error.iloc[-1] if done else np.nan
        row["largest error"] = largest(run.error) if done else np.nan
        row["seconds"] = run.seconds.iloc[-1] if done else np.nan
        row |= {f"drift of {name}": largest(run[name]) if done else np.nan for name in INVARIANTS}
        table.append({**row, "failure": cell["failure"] or ""})
    made = pd.DataFrame(table).dropna(axis=1, how="all")
    made = made.drop(columns=[name for name in ("options", "failure") if name in made and not made[name].any()])
    made.attrs["caption"] = (
        f"The largest error against {_truth(rows)}, relative to the scales of J and x, and the largest drift of each "
        "invariant, relative to the size of its terms, among the recorded states; seconds of stepping "
        "without compilation, measured beside other cells."
    )
    return {"runs": made}


def _truth(rows: pd.DataFrame) -> str:
    """What the errors of the rows are measured against."""
    if "potential" not in rows or rows.potential.isna().all():
        return "the exact solution"
    return "the exact solution (where there is none: a reference solution in quadruple precision)"


def draw(rows: pd.DataFrame) -> dict[str, Any]:
    """Against time, each method at its finest; and against each knob that has several values. Nothing if all runs failed."""
    from lagrange_bench.experiments.drawing import style
    from lagrange_bench.experiments.measuring.reductions import largest, worst

    if not (rows.status == "done").any():
        return {}
    # J3 has no number where the field does not conserve it
    rows = rows.assign(worst=worst(rows.fillna({"J3": 0.0}), INVARIANTS))
    steps = [knob for knob in KNOBS if knob in rows]
    rows = rows.assign(t=rows.t.abs(), **{knob: rows[knob].abs() for knob in steps})
    ranked = rows.assign(failed=rows.status != "done", size=rows[steps].min(axis=1)).sort_values(["failed", "size"])
    finest = ranked.drop_duplicates(["top", "method", "options"]).key
    figures = {"time": _figure(rows[rows.key.isin(finest)], "t", style.TIME)}
    figures["time"].caption = (
        f"Error against {_truth(rows)}, relative to the scales of J and x, and the largest of the relative drifts of H, "
        "J3, C1 and C2, against time: each method at the smallest step or tolerance at which it has a result. The grey line is "
        "the spacing of doubles at 1. A cross before a name: the method declined the step or failed."
    )
    for knob, text in {"h": style.STEP, "tol": "tolerance", "rtol": "relative tolerance"}.items():
        if knob not in steps or rows[knob].nunique() < 2:
            continue
        swept = rows[rows[knob].notna()].groupby("key", sort=False)
        ends = swept.first().assign(error=swept.error.agg(largest), worst=swept.worst.agg(largest))
        figures[knob] = _figure(ends, knob, text)
        figures[knob].caption = (
            f"Largest error against {_truth(rows)} among the recorded states, relative to the scales of J and x, and the "
            f"largest relative drift of H, J3, C1 and C2, against the {text.split(' h ')[0]}. "
            "Crosses: the method declined the step or failed."
        )
    return figures


def _figure(rows: pd.DataFrame, x: str, xlabel: str) -> Any:
    """A row for each top: errors on the left, invariants on the right."""
    from lagrange_bench.experiments.drawing import style

    tops = list(dict.fromkeys(rows.top))
    titles = [style.plain(f"{top}: {what}") for top in tops for what in ("error", "worst invariant")]
    figure, axes = style.panels(titles, 2, (0.4, 2.3), xlabel, "", sharex=True)
    looks = {name: style.of(name) | ({"marker": "none"} if x == "t" else {}) for name in style.ordered(rows.method)}
    for i, ax in enumerate(axes):
        style.ulp_line(ax)
        here = rows[rows.top == tops[i // 2]].sort_values(x, kind="stable")
        here_looks = {name: look for name, look in looks.items() if (here.method == name).any()}
        style.draw_lines(ax, here, x, ("error", "worst")[i % 2], ("options",), here_looks)
        ax.set(xscale="log", yscale="log")
    style.legend_below(figure)
    return figure
