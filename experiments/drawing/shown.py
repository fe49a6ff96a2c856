"""What an experiment shows: its tables and figures, each made by a function of its rows; see `reductions.of_part`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd


def tabulated(rows: pd.DataFrame, *functions: Callable[..., Any]) -> dict[str, pd.DataFrame]:
    """The tables that these functions make of rows, by their names; those that have lines."""
    made = {function.__name__: function(rows) for function in functions}
    return {name: table for name, table in made.items() if table is not None and len(table)}


def drawn(rows: pd.DataFrame, **draw: Callable[..., Any]) -> dict[str, Any]:
    """The figures that these functions draw of rows, given the style of all figures; None where there is nothing to draw."""
    from lagrange_bench.experiments.drawing import style

    figures = {name: function(rows, style) for name, function in draw.items()}
    return {name: figure for name, figure in figures.items() if figure is not None}
