"""`load` gives the stored rows of an experiment as a frame."""

import contextlib
import math
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments.catalogue import declared
from lagrange_bench.experiments.measuring import states
from lagrange_bench.integrators.registry import find_stored
from lagrange_bench.results.store import Store, find_results
from lagrange_bench.support.words import suggestion

TIMES = ("h", "t", "span")


class Results(Mapping[str, pd.DataFrame]):
    """The frames of a folder of results, by experiment. Each is read when it is asked for; see `load`."""

    def __init__(self, folder: Path):
        self.folder, self._store = folder, Store(folder)

    def __getitem__(self, experiment: str) -> pd.DataFrame:
        if experiment not in (known := list(self)):
            close = suggestion(str(experiment), known)
            raise KeyError(f"no rows of {experiment!r} in {self.folder}{close} There: {', '.join(known)}")
        journal = self._store.open(experiment)
        for problem in journal.problems:
            warnings.warn(problem, RuntimeWarning, stacklevel=2)
        rows = journal.rows().rename(columns=dict.fromkeys(("state", "case"), "top"))
        if {"seconds", "setup_seconds"} <= set(rows):
            rows["total"] = rows["seconds"] + rows["setup_seconds"]
        scaled = declared(experiment, "SCALED_TIMES")
        if not scaled:
            return rows
        if "top" not in rows:
            rows["top"] = None
        units = {top: _unit(group.iloc[0]) for top, group in rows.groupby("top", sort=False)}
        return in_both_units(rows, units, True if scaled is True else rows["part"].isin(scaled))

    def __iter__(self) -> Iterator[str]:
        return iter(self._store.experiments())

    def __len__(self) -> int:
        return len(self._store.experiments())

    def __repr__(self) -> str:
        return f"<results in {self.folder}: {', '.join(self)}>"


def load(results: str | Path = "reference") -> Results:
    """The stored rows, as a pandas frame for each experiment.

        frame = load()["drift"]
        frame[frame.method == "rk4"].plot("t_scaled", "H")

    Parameters
    ----------
    results : str or Path
        "reference": the published rows, which come with the package. "quick" or "full": what `lagrange-bench run` with this
        profile stored. Anything else is the path of a folder of results, also "./quick".

    Returns
    -------
    Results
        A mapping from the names of experiments to frames. results/README.md explains the columns, with three changes. `state`
        and `case` are called `top`. `total` is the sum of `seconds` and `setup_seconds`. `h`, `t` and `span` are in the top's
        own unit of time, as in `integrate`. `h_scaled`, `t_scaled` and `span_scaled` are in its time scale, if the experiment
        stores them so.

    Raises
    ------
    FileNotFoundError : there is no such folder, or nothing is stored in it.
    KeyError : when you ask for an experiment without rows. The message lists the experiments that have some.
    """
    return Results(find_results(results))


def in_both_units(rows: pd.DataFrame, known: Mapping[str, float], scaled: Any = True) -> pd.DataFrame:
    """Rows with each time in both units: `h_scaled` in the time scale of the top, `h` in its own unit, and so on.

    `h` is NaN if the top of a row is not known.

    known : time scales of tops. scaled : whether the times of the rows are in time scales, of all or of each.
    """
    times = [name for name in TIMES if name in rows]
    frame = rows.rename(columns={name: f"{name}_scaled" for name in times})
    units = rows["top"].map(known).astype(float)
    for name in times:
        place = int(frame.columns.get_loc(f"{name}_scaled"))
        frame.insert(place, name, rows[name] * np.where(scaled, units, 1.0))
        frame[f"{name}_scaled"] = rows[name] / np.where(scaled, 1.0, units)
    return frame


def _unit(row: Any) -> float:
    """The time scale of the top of a row, in the top's own unit; NaN if the top is not known here."""
    with contextlib.suppress(ValueError):
        top, y0 = states.of_cell({**row, "state": row["top"]}, find_stored)
        return float(top.scales(y0)[2])
    return math.nan
