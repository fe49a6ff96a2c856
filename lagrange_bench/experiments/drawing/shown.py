"""Tables and figures of an experiment, each made by a function of the rows of one part."""

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any

import pandas as pd

Made = Callable[[pd.DataFrame], dict[str, Any]]


def of_part(name: str = "", caption: str = "", failed: bool = False) -> Callable[..., Callable[..., Any]]:
    """Decorator of a function that makes a table or a figure from the rows of one part ("": all) that are done.

    Without such rows the result is None. caption : of the table. failed : the function gets the failed rows, too, for crosses.
    """

    def decorator(function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def of_rows(rows: pd.DataFrame, *others: Any, **options: Any) -> Any:
            in_part = rows["part"].eq(name) if name and "part" in rows else pd.Series(not name, index=rows.index)
            sound = in_part & rows["status"].eq("done")
            if not sound.any():
                return None
            result = function(rows[in_part if failed else sound], *others, **options)
            if caption:
                result.attrs["caption"] = caption
            return result

        return of_rows

    return decorator


def by_group(columns: Sequence[str], part: str, caption: str) -> Callable[..., Callable[..., Any]]:
    """As `of_part`, for a function of the values of `columns` and their rows. It makes the rest of a line; {} makes no line.

    If the rows lack one of the columns, there is no line.
    """

    def decorator(function: Callable[..., dict[str, Any]]) -> Callable[..., Any]:
        @of_part(part, caption)
        @wraps(function)
        def of_rows(rows: pd.DataFrame) -> pd.DataFrame:
            groups = rows.groupby(list(columns), sort=False) if set(columns) <= set(rows) else ()
            lines = [(dict(zip(columns, values, strict=True)), function(*values, group)) for values, group in groups]
            return pd.DataFrame([key | line for key, line in lines if line])

        return of_rows

    return decorator


def tabulated(*functions: Callable[..., Any]) -> Made:
    """The `tables` of an experiment: name of a function → the table it makes of rows, if that has lines."""

    def tables(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
        by_name = {function.__name__: function(rows) for function in functions}
        return {name: table for name, table in by_name.items() if table is not None and len(table)}

    return tables


def drawn(**functions: Callable[..., Any]) -> Made:
    """The `draw` of an experiment: name → the figure that a function(rows, style) draws, unless that is None."""

    def draw(rows: pd.DataFrame) -> dict[str, Any]:
        from lagrange_bench.experiments.drawing import style

        rows = style.shown(rows)
        figures = {name: function(rows, style) for name, function in functions.items()}
        for figure in figures.values():
            for ax in figure.axes if figure is not None else ():
                style.label_decades(ax)
        return {name: figure for name, figure in figures.items() if figure is not None}

    return draw
