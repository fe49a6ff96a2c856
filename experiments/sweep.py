"""Sweeps: an experiment described by a TOML file, with tops, methods, steps and tolerances of your own.

Every field of such a file is explained in docs/sweeps.md. What is read becomes an experiment like all others, called
sweep_NAME. Its cells carry alpha, the potential and the initial state, so that no file is needed to compute or draw them.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from lagrange_bench.experiments import SWEEP
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.measuring.states import find, follow, rounded
from lagrange_bench.integrators import INVARIANTS, PerturbedTop, StepError, memory, prepare
from lagrange_bench.integrators.api import integrate
from lagrange_bench.integrators.checks import MOST, check_count, check_options, check_real, check_state, check_step
from lagrange_bench.integrators.files import read_toml
from lagrange_bench.integrators.interface import Array, Method
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.registry import (
    NAMED_TOPS,
    NotInstalled,
    find_method,
    find_potential,
    find_stored_method,
)
from lagrange_bench.integrators.truth import truths
from lagrange_bench.integrators.words import numbers, option, suggestion

if TYPE_CHECKING:
    import pandas as pd

VERSION = 2
MEASURED = {"": ("t", "H", "C1", "C2")}  # J3 and the error only where the top and the truth have them
TIMES = ("seconds",)  # columns that no two runs have in common

KNOBS = ("h", "tol", "rtol")
KEYS = {
    "file": ("name", "tops", "sweep"),
    "top": ("alpha", "J", "x", "potential", "parameters"),
    "sweep": ("methods", "tops", *KNOBS, "time", "steps", "samples", "options"),
}
SAMPLES = 32
PER_SAMPLE = 3000  # bytes of memory that a cell takes for each, a generous guess
LARGEST = 1e100  # step: beyond, there is nothing to draw
EARLIEST = 1e-3  # first recorded time of a method that chooses its own steps, as a part of the last

Cell = dict[str, Any]
Start = dict[str, Any]  # the fields of a cell that say where it starts
_cells: dict[str, list[Cell]] = {}  # of the files read in this process, by experiment


# ---------------------------------------------------------------- the file


def read(path: str | Path) -> str:
    """Reads a file and returns the name of its experiment, which `experiments.load` knows from now on.

    Raises
    ------
    ValueError : what is wrong, where in the file, and what may have been meant. OSError : there is no such file.
    """
    path = Path(path)
    content = read_toml(path)
    _known(content, KEYS["file"], str(path))
    name = content.get("name", path.stem)
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise ValueError(f'{path}: name must consist of letters, digits, _ and -; got {name!r}: set name = "…"')
    tops = _tops(content.get("tops", {}), str(path))
    sweeps = content.get("sweep")
    if isinstance(sweeps, dict):
        raise ValueError(f"{path}, [sweep]: write [[sweep]], with two brackets")
    if not isinstance(sweeps, list) or not sweeps:
        raise ValueError(f"{path}: nothing to compute: add a table [[sweep]]")
    listed: dict[str, Cell] = {}
    for number, table in enumerate(sweeps, 1):
        place = f"{path}, [[sweep]]" + (f" {number}" if len(sweeps) > 1 else "")
        if not isinstance(table, dict):
            raise ValueError(f"{place} must be a table")
        for cell in _sweep(table, tops, place):
            listed[repr(cell)] = cell  # what two sweeps ask for is computed once
    experiment, found = f"{SWEEP}{name}", list(listed.values())
    if _cells.setdefault(experiment, found) != found:
        raise ValueError(f"{path}: name: another file of this run is called {name!r}, too")
    return experiment


def _tops(tables: Any, path: str) -> dict[str, Start]:
    """The file's own tops."""
    if not isinstance(tables, dict):
        raise ValueError(f"{path}: tops must be tables [tops.NAME]")
    tops = {}
    for name, table in tables.items():
        place = f"{path}, [tops.{name}]"
        if not isinstance(table, dict):
            raise ValueError(f"{place} must be a table with {', '.join(KEYS['top'][:3])}")
        if _own(name):
            raise ValueError(f"{place}: the bench has a top of this name; choose another")
        _known(table, KEYS["top"], place)
        if missing := [key for key in KEYS["top"][:3] if key not in table]:
            raise ValueError(f"{place} lacks {', '.join(missing)}")
        J, x = (_numbers(table[key], f"{place}, {key}") for key in ("J", "x"))
        for key, given in (("J", J), ("x", x)):
            if len(given) != 3:
                raise ValueError(f"{place}, {key} must be three numbers; got {len(given)}")
        alpha, y0 = check_real(table["alpha"], f"{place}, alpha"), check_state([*J, *x], place)
        start = {"top": name, "alpha": alpha, "y0": _words(y0), **_potential(table, place)}
        try:
            top = _top(start)
            if isinstance(top, PerturbedTop):
                top.check_state(y0)
        except ValueError as error:
            raise ValueError(f"{place}, {error}") from None
        if not math.isfinite(top.scales(y0)[2]):
            raise ValueError(f"{place} is at rest for ever, without weight and spin: its time has no scale")
        tops[name] = start
    return tops


def _potential(table: dict[str, Any], place: str) -> Start:
    """The potential of a top, if it has one."""
    if "potential" not in table:
        if "parameters" in table:
            raise ValueError(f"{place}, parameters: of which potential? Give potential = NAME, too")
        return {}
    if not isinstance(table["potential"], str):
        raise ValueError(f"{place}, potential must be a name; got {table['potential']!r}")
    parameters = table.get("parameters", [])
    if parameters != []:
        parameters = _numbers(parameters, f"{place}, parameters")
    return {"potential": table["potential"], "parameters": _words(parameters)}


def _words(values: Iterable[float]) -> str:
    return ",".join(repr(float(value)) for value in values)  # as the options of `integrate` take them


def _top(start: Start) -> Any:
    """The top of a cell; ValueError if its potential cannot be had."""
    top = LagrangeTop(start["alpha"])
    if "potential" not in start:
        return top
    try:
        parameters = tuple(numbers(start["parameters"])) if start["parameters"] else ()
        return PerturbedTop(top, find_potential(start["potential"]), parameters)
    except ValueError as error:
        raise ValueError(f"potential: {error}") from None


def _own(name: str) -> bool:
    """Whether the bench itself, or a package, has a top of this name."""
    return name in NAMED_TOPS or re.fullmatch(r"random\d{3}", name) is not None


def _sweep(table: dict[str, Any], tops: dict[str, Start], place: str) -> Iterator[Cell]:
    """The cells of one table."""
    _known(table, KEYS["sweep"], place)
    knob = _one_of(table, KNOBS, place)
    values = _numbers(table[knob], f"{place}, {knob}")
    for i, value in enumerate(values):
        check_step(value, f"{place}, {knob}[{i}]")
        if not 1 / LARGEST <= abs(value) <= LARGEST:
            raise ValueError(f"{place}, {knob}[{i}] must be between {1 / LARGEST:g} and {LARGEST:g}; got {value:g}")
        if knob != "h" and value < 0:
            raise ValueError(f"{place}, {knob}[{i}] must be positive; got {value:g}")
    span = _one_of(table, ("time", "steps") if knob == "h" else ("time",), place)
    time = check_real(table.get("time", 1.0), f"{place}, time")
    if not time > 0:
        raise ValueError(f"{place}, time must be positive; got {time:g} (a negative h runs backwards)")
    steps = check_count(table.get("steps", 1), f"{place}, steps", least=1)
    if knob != "h" and "steps" in table:
        raise ValueError(f"{place}, steps goes with h; with {knob} give time only")
    samples = check_count(table.get("samples", SAMPLES), f"{place}, samples", least=2)
    memory.check(samples, PER_SAMPLE, memory.limit(), f"{place}, samples", f"take fewer, or set {memory.VARIABLE}")
    options = _options(table.get("options", {}), place)
    names = table.get("tops", list(tops) or ["generic"])
    starts = [_start(name, tops, f"{place}, tops") for name in _list(names, f"{place}, tops")]
    methods = _list(table.get("methods"), f"{place}, methods")
    for name in methods:
        _check_method(name, knob, place)
        for start in starts:
            _check_taken(name, start, knob, options, place)
        if options:
            _try_options(name, starts[0], {knob: values[0]}, options, place)
    text = ", ".join(f"{key}={value}" for key, value in options.items())
    for start in starts:
        for name in methods:
            for value in values:
                extent: Cell = {"span": time}
                if knob == "h":
                    n = time / abs(value) if span == "time" else steps
                    extent = {"steps": check_count(round(min(n, 2.0 * MOST)), f"{place}, time / h", least=1)}
                yield {"method": name, **start, "options": text, knob: value, **extent, "samples": samples}


def _start(name: Any, tops: dict[str, Start], place: str) -> Start:
    """The fields of a cell that say where it starts."""
    if not isinstance(name, str) or not (name in tops or _own(name)):
        names = [*tops, *NAMED_TOPS, "random000"]
        raise ValueError(
            f"{place}: unknown top {name!r}{suggestion(str(name), names)} Known: {', '.join(names)} … random999"
        )
    if name in tops:
        return tops[name]
    top, y0 = find(name)
    start = {"top": name, "alpha": top.single(), "y0": _words(y0)}
    if isinstance(top, PerturbedTop):
        start |= {"potential": top.potential.name, "parameters": _words(top.parameters)}
    return start


def _check_method(name: Any, knob: str, place: str) -> None:
    if not isinstance(name, str):
        raise ValueError(f"{place}, methods must be names; got {name!r}")
    try:
        method = find_method(name)
    except (ValueError, NotInstalled) as error:
        raise ValueError(f"{place}, methods: {error}") from None
    if knob != method.knob and (knob == "h" or method.control == "step" or knob not in method.options):
        what = "steps by h" if method.control == "step" else "chooses its own steps"
        raise ValueError(f"{place}, {knob}: {name} {what}: give it {method.knob} = […], in a [[sweep]] of its own")


def _check_taken(name: str, start: Start, knob: str, options: dict[str, Any], place: str) -> None:
    """Whether the method takes the top, and these options with it."""
    method, top = find_method(name), _top(start)
    if reason := method.takes(top):
        raise ValueError(
            f"{place}, methods: {reason}: give the top {start['top']} to others, in a [[sweep]] of their own"
        )
    if knob != "h" and method.evaluate_for(top) is None:
        raise ValueError(f"{place}, methods: {name} has no dense output for the top {start['top']}")
    try:
        check_options(name, method.prepare_for(top), options)
    except ValueError as error:
        raise ValueError(f"{place}, options: {error}") from None
    if knob in options:
        raise ValueError(f"{place}, options: {knob} is swept already")


def _try_options(name: str, start: Start, knob: dict[str, float], words: dict[str, str], place: str) -> None:
    """Prepares the method once: what an option may be, only the method knows."""
    method, top, y0 = find_method(name), _top(start), np.array(numbers(start["y0"]))
    options: dict[str, Any] = dict(option(f"{key}={word}") for key, word in words.items())
    try:
        if "h" in knob:
            prepare(top, y0, knob["h"] * top.scales(y0)[2], method, **options)
        else:
            integrate(top, y0, t=[0.0], method=method, **(options | knob))
    except StepError:  # of this top and step: a result
        pass
    except (ValueError, TypeError) as error:
        raise ValueError(f"{place}, options of {name}: {error}") from None


def _options(table: Any, place: str) -> dict[str, str]:
    """The options as the words that --option of `integrate` takes."""
    if not isinstance(table, dict):
        raise ValueError(f"{place}, options must be a table, as {{ pin = 0 }}; got {table!r}")
    words = {}
    for key, value in table.items():
        if not isinstance(value, (bool, int, float, str)) or (isinstance(value, str) and ("," in value or not value)):
            raise ValueError(f"{place}, options.{key} must be a number, true, false or a word; got {value!r}")
        words[key] = str(value).lower() if isinstance(value, bool) else str(value)
    return words


def _known(table: dict[str, Any], known: Iterable[str], place: str) -> None:
    for key in table:
        if key not in known:
            raise ValueError(f"{place}: unknown key {key!r}{suggestion(key, known)} Known: {', '.join(known)}")


def _list(value: Any, place: str) -> list[Any]:
    if not isinstance(value, list) or not value:
        raise ValueError(f"{place} must be a list with something in it, as […]; got {value!r}")
    return value


def _numbers(value: Any, place: str) -> list[float]:
    return [check_real(number, f"{place}[{i}]") for i, number in enumerate(_list(value, place))]


def _one_of(table: dict[str, Any], keys: tuple[str, ...], place: str) -> str:
    given = [key for key in keys if key in table]
    if len(given) != 1:
        asked = f"one of {', '.join(keys)}" if len(keys) > 1 else keys[0]
        raise ValueError(f"{place} needs {asked}" + (f"; got {' and '.join(given)}" if given else ""))
    return given[0]


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

    parts = {
        "VERSION": VERSION,
        "TIMES": TIMES,
        "MEASURED": MEASURED,
        "cells": cells,
        "measure": measure,
        "draw": draw,
        "tables": tables,
    }
    vars(made).update(parts, __file__=__file__)
    return made


def measure(cell: Cell) -> list[dict[str, Any]]:
    """Drift of the invariants and errors along one run."""
    method, top, y0 = find_method(cell["method"]), _top(cell), np.array(numbers(cell["y0"]))
    options = dict(option(word) for word in cell["options"].split(", ") if word)
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
        if isinstance(top, LagrangeTop):  # there is no torus in a potential
            split = metrics.phase_split(top, right, states - right)
            columns |= {"time": split["time"] * rate, "angle": split["angle"]}
    except ValueError as error:  # beyond what doubles resolve: the method has an answer, the truth has none
        warnings.warn(f"no {truths.name(top)} to compare with: {error}", RuntimeWarning, stacklevel=1)
    columns["seconds"] = seconds
    return [{name: rounded(value[i]) for name, value in columns.items()} for i in range(len(times))]


def _run(
    method: Method, top: Any, y0: Array, unit: float, cell: Cell, options: dict[str, Any]
) -> tuple[list[int] | None, Array, Array, Array]:
    """Steps if it takes them, times (N,), states (N, 6) and the seconds spent until then (N,), at times growing geometrically."""
    if "h" in cell:
        h, n = cell["h"] * unit, cell["steps"]
        counts = sorted({round(n ** (k / (cell["samples"] - 1))) for k in range(cell["samples"])})
        recorded, clock = zip(*follow(prepare(top, y0, h, method, **options), y0, counts), strict=True)
        return counts, h * np.array(counts, dtype=float), np.array(recorded), np.array(clock)
    options |= {knob: cell[knob] for knob in KNOBS if knob in cell}
    if "rtol" in cell and "atol" in method.options:
        options.setdefault("atol", cell["rtol"] * 1e-3)  # as in all experiments
    times = cell["span"] * unit * np.geomspace(EARLIEST, 1, cell["samples"])
    start = perf_counter()
    states = integrate(top, y0, t=times, method=method, **options).y
    seconds = np.full(len(times), np.nan)  # it goes through in one go
    seconds[-1] = perf_counter() - start
    return None, times, states, seconds


# ---------------------------------------------------------------- what the rows say


def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The largest error and drift of each run."""
    import pandas as pd

    from lagrange_bench.experiments.measuring.reductions import largest

    table = []
    for cell, run in _runs(rows):
        most = {name: largest(run[name]) for name in INVARIANTS} if cell["status"] == "done" else {}
        found: dict[str, Any] = {"error at the end": np.nan, "largest error": np.nan, "seconds": np.nan}
        if cell["status"] == "done":
            ends = {"error at the end": run.error.iloc[-1], "largest error": largest(run.error)}
            found = {**ends, "seconds": run.seconds.iloc[-1]}
        head = {name: cell.get(name, np.nan) for name in ("top", "method", "options", *KNOBS)}
        drift = {f"drift of {name}": most.get(name, np.nan) for name in INVARIANTS}
        table.append({**head, **found, **drift, "failure": cell["failure"] or ""})
    made = pd.DataFrame(table).dropna(axis=1, how="all")
    made = made.drop(columns=[name for name in ("options", "failure") if name in made and not made[name].any()])
    made.attrs["caption"] = (
        f"The largest error against {_truth(rows)}, relative to the scales of J and x, and the largest drift of each "
        "invariant, relative to the size of its terms, among the recorded states; seconds of stepping, measured beside "
        "other cells."
    )
    return {"runs": made}


def _truth(rows: pd.DataFrame) -> str:
    """What the errors of the rows are measured against."""
    if "potential" not in rows or rows.potential.isna().all():
        return "the exact solution"
    return "the exact solution (in a potential: a reference solution in quadruple precision)"


def _runs(rows: pd.DataFrame) -> Iterator[tuple[Cell, pd.DataFrame]]:
    """The fields of each cell, in the order of the file, and its rows."""
    for _, run in rows.groupby("key", sort=False):
        first = {name: value for name, value in run.iloc[0].items() if value == value}
        yield {"options": "", "failure": None, **first}, run


def draw(rows: pd.DataFrame) -> dict[str, Any]:
    """Against time, each method at its finest; and against each knob that has several values."""
    figures: dict[str, Any] = {}
    runs = list(_runs(rows))
    finest: dict[tuple[str, str, str], tuple[Cell, pd.DataFrame]] = {}
    for cell, run in runs:
        old = finest.get(_series(cell))
        if old is None or _rank(cell) < _rank(old[0]):
            finest[_series(cell)] = (cell, run)
    figures["time"] = _draw_time(list(finest.values()), _truth(rows))
    for knob in KNOBS:
        swept = [(cell, run) for cell, run in runs if knob in cell]
        if len({abs(cell[knob]) for cell, _ in swept}) > 1:
            figures[knob] = _draw_knob(swept, knob, _truth(rows))
    return figures


def _series(cell: Cell) -> tuple[str, str, str]:
    return cell["top"], cell["method"], cell["options"]


def _conserved(run: pd.DataFrame) -> list[str]:
    """The invariants of the top of a run: J3 has no number where the field does not conserve it."""
    return [name for name in INVARIANTS if run[name].notna().any()]


def _rank(cell: Cell) -> tuple[bool, float]:
    """A cell that is done comes before one that failed, and then the finer one."""
    return cell["status"] != "done", min(abs(cell[knob]) for knob in KNOBS if knob in cell)


def _panels(runs: list[tuple[Cell, pd.DataFrame]], xlabel: str) -> tuple[Any, dict[str, Any]]:
    """A figure with a row for each top: errors on the left, invariants on the right."""
    from lagrange_bench.experiments.drawing import style

    tops = list(dict.fromkeys(cell["top"] for cell, _ in runs))
    figure, axes = style.figure("page", 0.4 + 2.3 * len(tops), nrows=len(tops), ncols=2, sharex=True, squeeze=False)
    for top, (left, right) in zip(tops, axes, strict=True):
        left.set_title(style.plain(f"{top}: error"))
        right.set_title(style.plain(f"{top}: worst invariant"))
        for ax in (left, right):
            ax.set(xscale="log", yscale="log")
            style.ulp_line(ax)
    for ax in axes[-1]:
        ax.set_xlabel(xlabel)
    return figure, dict(zip(tops, axes, strict=True))


def _looks(runs: list[tuple[Cell, pd.DataFrame]]) -> dict[tuple[str, str], dict[str, Any]]:
    """Method and options → keywords of a line; the options of one method differ by their dashes."""
    from lagrange_bench.experiments.drawing import style

    looks: dict[tuple[str, str], dict[str, Any]] = {}
    for method in style.ordered({cell["method"] for cell, _ in runs}):
        for i, options in enumerate(dict.fromkeys(cell["options"] for cell, _ in runs if cell["method"] == method)):
            look = style.of(method)
            if i:
                dashes = style.DASHES if look["linestyle"] in style.DASHES else style.OWN_DASHES
                look["linestyle"] = dashes[(dashes.index(look["linestyle"]) + i) % len(dashes)]
            looks[method, options] = {
                **look,
                "label": style.plain(_label(method) + (f" ({options})" if options else "")),
            }
    return looks


def _label(name: str) -> str:
    """What a legend calls a method; one of `module:METHOD` by its own label, if it is loaded."""
    from lagrange_bench.experiments.drawing import style

    if ":" in name:
        with suppress(ValueError):
            return find_stored_method(name).label
    return style.label(name)


def _line(ax: Any, x: Any, y: Any, look: dict[str, Any]) -> None:
    x, y = np.abs(np.asarray(x, dtype=float)), np.asarray(y, dtype=float)
    if (y > 0).any():
        ax.plot(x, np.where(y > 0, y, np.nan), **look)


def _draw_time(runs: list[tuple[Cell, pd.DataFrame]], truth: str) -> Any:
    from lagrange_bench.experiments.drawing import style
    from lagrange_bench.experiments.measuring.reductions import worst

    figure, panels = _panels(runs, style.TIME)
    looks = _looks(runs)
    for cell, run in runs:
        if cell["status"] != "done":
            style.failed_label(panels[cell["top"]][0], cell["method"], _label(cell["method"]))
            continue
        look = {**looks[cell["method"], cell["options"]], "marker": "none"}
        for ax, values in zip(panels[cell["top"]], (run.error, worst(run, _conserved(run))), strict=True):
            _line(ax, run.t, values, look)
    style.legend_below(figure)
    figure.caption = (
        f"Error against {truth}, relative to the scales of J and x, and the largest of the relative drifts of H, "
        "J3, C1 and C2, against time: each method at the smallest step or tolerance at which it has a result. Values that are "
        "exactly zero are left out; the grey line is the spacing of doubles at 1. "
        "A cross before a name: the method declined the step or failed."
    )
    return figure


def _draw_knob(runs: list[tuple[Cell, pd.DataFrame]], knob: str, truth: str) -> Any:
    from lagrange_bench.experiments.drawing import style
    from lagrange_bench.experiments.measuring.reductions import largest

    texts = {"h": style.STEP, "tol": "tolerance", "rtol": "relative tolerance"}
    figure, panels = _panels(runs, texts[knob])
    points: dict[tuple[str, str, str], list[tuple[float, float, float]]] = {}
    failed: dict[tuple[str, str], list[float]] = {}
    for cell, run in runs:
        if cell["status"] == "done":
            found = (abs(cell[knob]), largest(run.error), largest(run[_conserved(run)]))
            points.setdefault(_series(cell), []).append(found)
        else:
            failed.setdefault((cell["top"], cell["method"]), []).append(abs(cell[knob]))
    looks = _looks(runs)
    for (top, method, options), line in points.items():
        x, *ys = np.array(sorted(line)).T
        for ax, y in zip(panels[top], ys, strict=True):
            _line(ax, x, y, looks[method, options])
    for (top, method), steps in failed.items():
        style.failure_marks(panels[top][0], steps, method)
    style.legend_below(figure)
    figure.caption = (
        f"Largest error against {truth} among the recorded states, relative to the scales of J and x, and the "
        f"largest relative drift of H, J3, C1 and C2, against the {texts[knob].split(' h ')[0]}. "
        "Crosses: the method declined the step or failed."
    )
    return figure
