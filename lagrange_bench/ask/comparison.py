"""`Comparison`: rows of methods on tops, as a frame, and any column of it against any other as a figure."""

from __future__ import annotations  # signatures show names of types, not what they stand for

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from lagrange_bench.experiments.drawing import style
from lagrange_bench.experiments.drawing.tables import heading, show
from lagrange_bench.experiments.drift import OWN
from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.measuring.states import SCHEME_OPTIONS
from lagrange_bench.experiments.work_precision import WALL
from lagrange_bench.integrators import INVARIANTS, METHODS, Method
from lagrange_bench.integrators.registry import NAMED_TOPS
from lagrange_bench.support.words import suggestion

Names = Iterable[str | Method] | None
MOST = 12  # the most panels of a figure, and the most methods that are all named
SAMPLED = 32  # a line of more points has no markers
LABELS = {
    "h": "step h, in the problem's own unit",
    "h_scaled": "step h, in the time scale of the motion",
    "t": "time t, in the problem's own unit",
    "t_scaled": "time t, in the time scale of the motion",
    "error": "error, relative to the scales of the state",
    "worst": "largest relative error of the invariants",
    "seconds": WALL,
    "total": "wall time of the run with set-up, s",
    "setup_seconds": "time of set-up, s",
    "evals": "evaluations of the right-hand side",
    "time": "phase error, in time scales",
    "angle": "error of the precession, rad",
    "off": "error off the torus",
    "position": "error of the position, m",
    "rotation": "error of the rotation, rad",
    "spin": "error of the spin, rad",
    "energy": "relative error of the energy",
    "momentum": "relative error of the momentum about the vertical",
}
# columns of errors, beside the invariants
ERRORS = ("error", "worst", "time", "angle", "off", "left")
# columns that tell the lines of a method apart
APART = ("top", "integrator", "setting", *SCHEME_OPTIONS, "options", "variant", "form", "pin", "n", "span_scaled")
RUN_OPTIONS = ("h_scaled", "tol", "rtol", "fraction")  # likewise, if a run has many rows
STEPS = ("h", *RUN_OPTIONS)  # always on a logarithmic axis, or no slope could be read


@dataclass(frozen=True, repr=False, eq=False)
class Comparison:
    """Rows of some methods on some tops, as a frame and as figures.

    Parameters
    ----------
    frame : DataFrame
        A row for each sample or run, with columns `method`, `top` and `status` ("done", or "failed" for the reason in `failure`).
        Frames of `load` have these, too.
    x, y : str
        The columns that `plot` draws by default.
    methods : tuple of Method
        Records of methods, registered or not.
    labels : dict
        Names of tops in titles.
    invariants : tuple of str
        The columns that are errors of invariants.
    """

    frame: pd.DataFrame
    x: str = "h_scaled"
    y: str = "error"
    methods: tuple[Method, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)
    invariants: tuple[str, ...] = INVARIANTS

    def __repr__(self) -> str:
        names = textwrap.shorten(", ".join(dict.fromkeys(_methods(self.frame))), 60, placeholder=" …")
        tops = self.frame["top"].nunique() if "top" in self.frame else 0
        return f"<Comparison of {names} on {tops} top{'' if tops == 1 else 's'}: {self.y} against {self.x}>"

    def _repr_html_(self) -> str:
        """The rows as a notebook shows them."""
        return str(self.frame._repr_html_())

    def plot(
        self,
        x: str | None = None,
        y: str | None = None,
        methods: Names = None,
        tops: Names = None,
        ax: Axes | Sequence[Axes] | None = None,
        xlim: tuple[float, float] | None = None,
        ylim: tuple[float, float] | None = None,
        names: bool = True,
        **look: Any,
    ) -> Any:
        """Draw a column against another, a panel for each top, in your own rcParams.

        An axis is logarithmic if the numbers on it are errors, steps or tolerances, or positive and of several sizes. Errors are
        drawn by absolute value. A cross is a failure.

        Parameters
        ----------
        x, y : str, optional
            Names of columns of numbers.
        methods, tops : list of str, optional
            Draw these only.
        ax : Axes or a list of them, optional
            Your own: as many as tops, or one for all. By default those of a new figure of pyplot.
        xlim, ylim : (float, float), optional
            Limits, as for `set_xlim`.
        names : bool
            Whether there is a legend: below a new figure, in each panel of your own.
        **look : dict
            Options of matplotlib's `plot` for all lines, such as `linestyle="--"` on a second axis.

        Returns
        -------
        Axes, or an array of them
            One for each top.

        Raises
        ------
        ValueError
            No such column, method or top, or nothing to draw; the message says what there is.
        """
        x, y = x or self.x, y or self.y
        if x == "h_scaled" and _lack(self.frame, x):
            x = "h"  # rows in the tops' own units
        tops = _as_list(tops)
        rows = self._rows(x, y, methods, tops)
        named = list(dict.fromkeys(rows["top"]))
        panels = named if tops is None else [top for top in tops if top in named]
        axes = _axes(ax, panels)
        limits = {name: ends for name, ends in (("xlim", xlim), ("ylim", ylim)) if ends is not None}
        with METHODS.temporarily_registered(*self.methods):
            for place, panel in enumerate(axes):
                of_panel = rows if len(axes) == 1 else rows[rows["top"] == panels[place]]
                self._draw(panel, of_panel, x, y, look)
                if names and ax is not None:
                    panel.legend()
                title = self._title(list(dict.fromkeys(of_panel["top"])))
                zeros = self._is_error(y) and 0 < (of_panel[y] == 0).sum() < of_panel[y].count()
                ylabel = self._label(y) + (f" (0 is drawn at {show(style.LEAST)})" if zeros else "")
                panel.set(title=title, xlabel=self._label(x), ylabel=ylabel, **limits)
            if names and ax is None:
                style.legend_below(axes[0].figure)
        return axes[0] if len(axes) == 1 else np.array(axes)

    def _rows(self, x: str, y: str, methods: Names, tops: Names) -> pd.DataFrame:
        """The rows to draw; ValueError if there are none."""
        rows = self.frame
        if "failure" in rows and len(rows) and (rows["status"] == "failed").all():
            raise ValueError(f"every run failed: {rows['failure'].iloc[0]}")
        numbers = [str(name) for name in rows.select_dtypes("number")]
        for word, name in (("x", x), ("y", y)):
            if name not in numbers:
                hint = f"{suggestion(str(name), numbers)} There are {', '.join(numbers)}"
                raise ValueError(f"{word} must be a column of numbers; got {name!r}{hint}")
        rows = rows.assign(top=rows["top"].fillna("") if "top" in rows else "", method=_methods(rows))
        for column, wanted in (("method", _as_list(methods)), ("top", _as_list(tops))):
            known = list(dict.fromkeys(rows[column]))
            if unknown := [name for name in wanted or () if name not in known]:
                close = suggestion(str(unknown[0]), known)
                raise ValueError(f"{column}s: no rows of {unknown[0]!r}{close} There are {', '.join(known)}")
            rows = rows if wanted is None else rows[rows[column].isin(wanted)]
        both = rows[x].notna() & rows[y].notna()
        if not both.any():
            raise ValueError(f"no row has both {x} and {y}")
        if "part" in rows:
            if len(parts := list(dict.fromkeys(rows["part"][both]))) > 1:
                choose = f"choose one, as frame[frame.part == {parts[0]!r}]"
                hint = "; time is an error here, the time of a run is t_scaled" if x == "time" else ""
                raise ValueError(f"rows of several parts have {x} and {y}: {', '.join(parts)}; {choose}{hint}")
            rows = rows[rows["part"] == parts[0]]
        return rows[rows["top"].isin(rows["top"][both])]

    def _draw(self, ax: Axes, rows: pd.DataFrame, x: str, y: str, look: dict[str, Any]) -> None:
        sampled = not _lack(rows, "t_scaled")  # rows are samples of runs, and not runs
        race = x in ("seconds", "total") and y == "error"
        log = [self._is_log(rows, name) for name in (x, y)]
        if log[1] and not self._is_error(y):
            rows = rows.assign(**{y: rows[y].where(rows[y] > 0)})
        good = rows[rows[x].notna() & rows[y].notna()]
        spans = ("span",) if _lack(rows, "span_scaled") else ()  # of rows in the tops' own units
        apart = [name for name in (*APART, *spans, *(RUN_OPTIONS if sampled else ())) if name not in (x, y)]
        if race:
            each = (style.lines(mine, apart) for _, mine in rows.groupby("method", sort=False))
            fronts = [line.iloc[metrics.pareto_front(line[x], line[y])] for lines in each for _, line in lines]
            rows = pd.concat([*fronts, rows[~rows["method"].isin(good["method"])]])
        rows = rows.sort_values("t_scaled" if sampled else x, kind="stable")
        looks = {name: default | look for name, default in self._looks(style.ordered(rows["method"]), good, y).items()}
        style.draw_lines(ax, rows, x, y, apart, looks, log)

    def _looks(self, methods: list[str], good: pd.DataFrame, y: str) -> dict[str, dict[str, Any]]:
        """The look of each method. Among many, only the best of each family is named, by the median of |y|."""
        best = style.best_of_families(good[y].abs().groupby(good["method"]).median())
        looks = {name: style.of(name) for name in methods} if len(methods) <= MOST else style.looks(methods, best)
        if len(good) > SAMPLED * max(good["method"].nunique(), 1):
            looks = {name: look | {"marker": "none"} for name, look in looks.items()}
        return looks

    def _is_log(self, rows: pd.DataFrame, name: str) -> bool:
        values = rows[name][np.isfinite(rows[name])]
        sizes = values[values != 0].abs()
        is_wide = bool((values >= 0).all()) and bool(sizes.max() > 30 * sizes.min())
        return len(sizes) > 0 and (self._is_error(name) or name in STEPS or is_wide)

    def _is_error(self, name: str) -> bool:
        return name in (*self.invariants, *ERRORS) or name.startswith(OWN)

    def _label(self, name: str) -> str:
        if name in self.invariants:
            return f"relative error of {name}"
        return LABELS.get(name) or style.plain(heading(name))

    def _title(self, tops: list[str]) -> str:
        scaled = {"h_scaled", "t_scaled", "span_scaled"} & set(self.frame)
        ours = NAMED_TOPS if scaled else {}  # rows without scaled times are of other problems, perhaps of the same name
        named = [self.labels.get(top) or (ours[top].label if top in ours else top) for top in tops]
        return style.plain(textwrap.shorten(", ".join(named), 60, placeholder=" …"))


def _lack(rows: pd.DataFrame, name: str) -> bool:
    """Whether no row has a value in this column."""
    return name not in rows or bool(rows[name].isna().all())


def _as_list(names: Names) -> list[str] | None:
    """Names, each once, as a list; None stands for all."""
    if names is None:
        return None
    several = [names] if isinstance(names, str | Method) else names
    return list(dict.fromkeys(name.name if isinstance(name, Method) else name for name in several))


def _methods(rows: pd.DataFrame) -> pd.Series:
    """The method of each row; without one the engine, variant or form."""
    names = rows.reindex(columns=["method", "engine", "variant", "form"]).bfill(axis=1)["method"]
    return names.fillna("rows").astype(str)


def _axes(ax: Any, tops: list[str]) -> list[Any]:
    from matplotlib import pyplot as plt

    if ax is not None:
        axes = list(np.ravel(np.array(ax, dtype=object)))
        if len(axes) not in (1, len(tops)):
            raise ValueError(f"ax: give one, or one for each of {len(tops)} tops; got {len(axes)}")
        return axes
    if len(tops) > MOST:
        raise ValueError(f"tops: there are {len(tops)}; choose at most {MOST}, such as {','.join(tops[:2])}")
    columns = min(len(tops), 2)
    rows = -(-len(tops) // columns)
    width, height = plt.rcParams["figure.figsize"]
    size = (columns * width, rows * height)
    _, grid = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    for spare in grid.flat[len(tops) :]:
        spare.remove()
    return list(grid.flat[: len(tops)])
