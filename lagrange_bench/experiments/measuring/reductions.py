"""Reduces measured rows to numbers for tables and claims, without hiding failures.

NaN in a measured row is a failure, which pandas would skip. A missing row was not measured, so nothing is said about it. But if a
measured row lacks a number that every row of its part has (`MEASURED` of the experiment), its cell has failed. There are two
exceptions: a row may give the reason (`reason`, `predicted`), and a run with an error above USEFUL is not timed.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

USEFUL = 0.1  # an error above this is no solution
EXCUSES = ("reason", "predicted")
TIMED = ("seconds", "setup_seconds", "steps", "evals", "iterations")  # measured only if the error is useful


def with_failures(rows: pd.DataFrame, measured: Mapping[str, Sequence[str]]) -> pd.DataFrame:
    """The rows, with one failed row in place of each cell that lacks a number; the same object if none does.

    measured : part of the experiment ("" for rows without a part) → the numbers that each of its rows must have.
    """
    missing = missing_value(rows, measured)
    if (missing == "").all():
        return rows
    cells = rows["key"] if "key" in rows else pd.Series(rows.index, index=rows.index)
    failed = cells.isin(cells[missing != ""])
    heads = rows[failed & ~cells.duplicated()].copy()
    why = missing[missing != ""].groupby(cells).first()
    heads["failure"] = "NotANumber: " + cells[heads.index].map(why)
    heads["status"] = "failed"
    for part, names in measured.items():
        in_this_part = in_part(heads, part)
        heads = heads.assign(**{name: heads[name].mask(in_this_part) for name in names if name in heads})
    return pd.concat([rows[~failed], heads]).sort_index()


def missing_value(rows: pd.DataFrame, measured: Mapping[str, Sequence[str]]) -> pd.Series:
    """For each measured row the name of the first missing number, or ""."""
    missing = pd.Series("", index=rows.index, dtype=object)
    known = rows.reindex(columns=["status", "error", *EXCUSES])
    done = known["status"].eq("done") & known[[*EXCUSES]].isna().all(axis=1)
    poor = known["error"].astype(float) > USEFUL
    for part, names in measured.items():
        in_this_part = done & in_part(rows, part)
        for name in names:
            if name in rows:
                missing[in_this_part & rows[name].isna() & ~(poor & (name in TIMED)) & missing.eq("")] = name
    return missing


def in_part(rows: pd.DataFrame, part: str) -> pd.Series:
    """Which rows belong to a part; "": which have no part."""
    if "part" not in rows:
        return pd.Series(not part, index=rows.index)
    return rows["part"].eq(part) if part else rows["part"].isna()


def largest(values: ArrayLike) -> float:
    """The largest absolute value; NaN if there is a NaN."""
    return float(np.max(np.abs(np.asarray(values, dtype=float))))


def worst(rows: pd.DataFrame, names: Iterable[str]) -> pd.Series:
    """For each row the largest absolute value of these columns; NaN if there is a NaN."""
    return rows[list(names)].abs().max(axis=1, skipna=False)


def mean_square(values: pd.Series, by: Any) -> pd.Series:
    """The mean square of each group; NaN if there is a NaN."""
    return values.pow(2).groupby(by).agg(lambda squares: squares.mean(skipna=False))
