"""The questions of the bench, each in one call from Python, and what they return: a `Comparison`.

    answer = work_precision(["rk4", "strang", METHOD], tops=["generic", (problem, y0)])
    answer.to_frame()
    answer.plot(x="evals", y="error", xlim=(1e2, 1e5))

A method is a registered name, "package.module:METHOD" or a `Method`. A top is a name of `lagrange-bench tops`,
"package.module:TOP", or a problem with a state: (problem, y0), or ("name", problem, y0). It may be a `Problem` of your own.

Steps and times are in two units, and every frame has both: `h`, `t` and `span` are in the top's own unit of time, as for
`integrate`; `h_scaled`, `t_scaled` and `span_scaled` in its time scale, for a top 1/(|J| + √(|alpha||x|)).
"""

from __future__ import annotations

import re
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib import rcParams

from lagrange_bench.data import in_both_units
from lagrange_bench.experiments import drift as drift_experiment
from lagrange_bench.experiments import heavy_top as body_experiment
from lagrange_bench.experiments import perturbed as field_experiment
from lagrange_bench.experiments import phase as phase_experiment
from lagrange_bench.experiments import work_precision as work_experiment
from lagrange_bench.experiments.drawing import style
from lagrange_bench.experiments.drawing.tables import heading, show
from lagrange_bench.experiments.measuring import check, metrics, states
from lagrange_bench.experiments.measuring.reductions import worst
from lagrange_bench.integrators import INVARIANTS, METHODS, Method, StepError
from lagrange_bench.integrators.checks import check_count, check_real
from lagrange_bench.integrators.interface import Array, StepWarning
from lagrange_bench.integrators.problem.top import NamedTop
from lagrange_bench.integrators.registry import NAMED_TOPS, find_method, find_top
from lagrange_bench.integrators.truth import truths
from lagrange_bench.integrators.words import suggestion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Top = str | NamedTop | tuple[Any, Any]
SPANS = (1e-3, 1e9)  # of runs, in time scales: shorter ones are a step each, longer ones take seconds only to be tried
MOST = 12  # panels of one figure
SAMPLED = 32  # points of a line that has no markers
LABELS = {
    "h": "step h, in the top's own unit of time",
    "h_scaled": style.STEP,
    "t": "time t, in the top's own unit",
    "t_scaled": style.TIME,
    "error": "error, relative to the scales of J and x",
    "worst": "largest relative error of the invariants",
    "seconds": work_experiment.WALL,
    "total": "wall time of the run with set-up, s",
    "setup_seconds": "time of set-up, s",
    "evals": "evaluations of the right-hand side",
    "time": "error of the nutation phase, in time scales",
    "angle": "error of the precession phase, rad",
    "off": "error off the torus",
    "position": "error of the position, m",
    "rotation": "error of the rotation, rad",
    "spin": "error of the spin, rad",
    "energy": "relative error of the energy",
    "momentum": "relative error of the momentum about the vertical",
}
OF_PROBLEMS = {  # that are no tops
    "h_scaled": "step h, in the time scale of the motion",
    "t_scaled": "time t, in the time scale of the motion",
    "error": "error, relative to the scales of the state",
}
ERRORS = (
    "error",
    "worst",
    "time",
    "angle",
    "off",
    "predicted_time",
    "predicted_angle",
    "left",
)  # beside the invariants
APART = ("top", "scheme", "options", "variant", "form", "pin", "n", "span_scaled")  # what tells lines of a method apart
WORDS = {"span_scaled": "t", "h_scaled": "h"}  # what they are called then
KNOBS = ("h_scaled", "tol", "rtol", "fraction")  # likewise, where a run has many rows


@dataclass(frozen=True, repr=False)
class Comparison:
    """Rows of some methods on some tops, as a frame and as figures.

    Attributes
    ----------
    frame : a row for each sample or run, with columns `method`, `top` and `status` ("done", or "failed" for the reason in
        `failure`); rows of `load` have these, too. x, y : the columns that `plot` draws unless it is told others.
    methods : records of methods that need not be registered. labels : what titles call tops.
    invariants : the columns that are errors of invariants.
    """

    frame: pd.DataFrame
    x: str = "h_scaled"
    y: str = "error"
    methods: tuple[Method, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)
    invariants: tuple[str, ...] = INVARIANTS

    def __repr__(self) -> str:
        tops = list(dict.fromkeys(self.frame["top"])) if "top" in self.frame else []
        names = textwrap.shorten(", ".join(dict.fromkeys(self.frame["method"])), 60, placeholder=" …")
        return f"<Comparison of {names} on {len(tops)} top{'s' * (len(tops) != 1)}: {self.y} against {self.x}>"

    def to_frame(self) -> pd.DataFrame:
        """A copy of the frame."""
        return self.frame.copy()

    def plot(
        self,
        x: str | None = None,
        y: str | None = None,
        methods: Iterable[str] | None = None,
        tops: Iterable[str] | None = None,
        ax: Axes | Sequence[Axes] | None = None,
        xlim: tuple[float, float] | None = None,
        ylim: tuple[float, float] | None = None,
    ) -> Any:
        """Draw a column against another, a panel for each top, in your own rcParams.

        An axis is logarithmic if the numbers on it are errors, or positive and of several sizes; of errors the absolute value
        is drawn. Names of lines stand where they leave the panel, also after `set_xlim`. Crosses: the method failed there.

        Parameters
        ----------
        x, y : names of columns of numbers. methods, tops : names, to draw some of them only.
        ax : axes of your own: as many as tops, or one for all of them. By default a new figure of pyplot.
        xlim, ylim : limits, as for `set_xlim`.

        Returns
        -------
        the axes: one, or an array (tops,).

        Raises
        ------
        ValueError : no such column, method or top, or nothing to draw; the message says what there is.
        """
        x, y = x or self.x, y or self.y
        rows, names = self._rows(x, y, methods, tops), self.tops(x, y, methods, tops)
        axes = _axes(ax, names)
        with self._known():
            for place, one in enumerate(axes):
                here = rows if len(axes) == 1 else rows[rows["top"] == names[place]]
                self._draw(one, here, x, y)
                one.set(
                    title=self._title(list(dict.fromkeys(here["top"]))), xlabel=self._label(x), ylabel=self._label(y)
                )
                one.set(**{name: limits for name, limits in (("xlim", xlim), ("ylim", ylim)) if limits is not None})
        return axes[0] if len(axes) == 1 else np.array(axes)

    def tops(
        self, x: str, y: str, methods: Iterable[str] | None = None, tops: Iterable[str] | None = None
    ) -> list[str]:
        """The tops that `plot` has panels for."""
        return list(dict.fromkeys(self._rows(x, y, methods, tops)["top"]))

    # ------------------------------------------------------------------ what is drawn

    def _rows(self, x: str, y: str, methods: Iterable[str] | None, tops: Iterable[str] | None) -> pd.DataFrame:
        """The rows that are asked for."""
        rows = self.frame
        numbers = [str(name) for name in rows.select_dtypes("number")]
        for word, name in (("x", x), ("y", y)):
            if name not in numbers:
                close = suggestion(str(name), numbers)
                raise ValueError(
                    f"{word} must be a column of numbers; got {name!r}{close} There are {', '.join(numbers)}"
                )
        rows = rows.assign(top=rows["top"].fillna("") if "top" in rows else "")
        for word, column, chosen in (("methods", "method", methods), ("tops", "top", tops)):
            if chosen is None:
                continue
            known = list(dict.fromkeys(rows[column]))
            wanted = [chosen] if isinstance(chosen, str) else list(chosen)
            if unknown := [name for name in wanted if name not in known]:
                close = suggestion(str(unknown[0]), known)
                raise ValueError(f"{word}: no rows of {unknown[0]!r}{close} There are {', '.join(known)}")
            rows = rows[rows[column].isin(wanted)]
        both = rows[x].notna() & rows[y].notna()
        if not both.any():
            raise ValueError(f"no row has both {x} and {y}")
        if "part" in rows:
            if len(parts := list(dict.fromkeys(rows["part"][both]))) > 1:
                raise ValueError(
                    f"rows of several parts have {x} and {y}: choose one of {', '.join(parts)} from the frame"
                )
            rows = rows[rows["part"] == parts[0]]
        return rows[rows["top"].isin(rows["top"][both])]

    def _draw(self, ax: Axes, rows: pd.DataFrame, x: str, y: str) -> None:
        """All lines of a panel."""
        sampled, race = _sampled(rows), x in ("seconds", "total") and y == "error"
        log = [self._is_log(rows, name) for name in (x, y)]
        if log[1] and not self._is_error(y):
            rows = rows.assign(**{y: rows[y].where(rows[y] > 0)})
        good = rows[rows[x].notna() & rows[y].notna()]
        if race and len(good):
            work_experiment.draw_front(ax, good[x], good[y])
        for method, look in self._looks(style.ordered(rows["method"]), good, y).items():
            for place, (words, line) in enumerate(_lines(rows[rows["method"] == method], x, y)):
                if race and line[y].notna().any():
                    line = line.iloc[metrics.pareto_front(line[x], line[y])]
                if place and "linestyle" in look:
                    dashes = style.DASHES if look["linestyle"] in style.DASHES else style.OWN_DASHES
                    look["linestyle"] = dashes[(dashes.index(look["linestyle"]) + 1) % len(dashes)]
                named = {**look, "label": ", ".join([look["label"], *map(style.plain, words)])}
                style.draw_method(ax, line.sort_values("t_scaled" if sampled else x), method, x, y, named, log)
        style.label_ends([ax], rcParams["legend.fontsize"])

    def _looks(self, methods: list[str], good: pd.DataFrame, y: str) -> dict[str, dict[str, Any]]:
        """Of each method; among many only the best of each family is named, by the median of |y|."""
        middle = good[y].abs().groupby(good["method"]).median()
        best = set(middle.groupby(middle.index.map(style.family)).idxmin())
        looks = {name: style.of(name) for name in methods} if len(methods) <= MOST else style.looks(methods, best)
        if len(good) > SAMPLED * max(good["method"].nunique(), 1):
            looks = {name: look | {"marker": "none"} for name, look in looks.items()}
        return looks

    def _is_log(self, rows: pd.DataFrame, name: str) -> bool:
        values = rows[name][np.isfinite(rows[name])]
        if not self._is_error(name) and (values < 0).any():
            return False
        sizes = values[values != 0].abs()
        return bool(len(sizes) and sizes.max() > 30 * sizes.min())

    def _is_error(self, name: str) -> bool:
        return name in (*self.invariants, *ERRORS) or name.startswith(drift_experiment.KEPT)

    def _label(self, name: str) -> str:
        if name in self.invariants:
            return f"relative error of {name}"
        labels = LABELS if self.invariants == INVARIANTS else {**LABELS, **OF_PROBLEMS}
        return labels.get(name) or style.plain(heading(name))

    def _title(self, tops: list[str]) -> str:
        named = [self.labels.get(top) or (NAMED_TOPS[top].label if top in NAMED_TOPS else top) for top in tops]
        return style.plain(textwrap.shorten(", ".join(named), 60, placeholder=" …"))

    @contextmanager
    def _known(self) -> Iterator[None]:
        with ExitStack() as stack:
            for method in self.methods:
                stack.enter_context(METHODS.lent(method))
            yield


def _sampled(rows: pd.DataFrame) -> bool:
    """Whether the rows are samples of runs, and not runs."""
    return "t_scaled" in rows and bool(rows["t_scaled"].notna().any())


def _lines(rows: pd.DataFrame, x: str, y: str) -> Iterator[tuple[list[str], pd.DataFrame]]:
    """The rows of each line of a method, and what tells it from the others."""
    columns = (*APART, *(KNOBS if _sampled(rows) else ()))
    apart = [name for name in columns if name in rows and name not in (x, y) and rows[name].nunique() > 1]
    if not apart:
        yield [], rows
        return
    for values, line in rows.groupby(apart, sort=False, dropna=False):
        known = [(name, value) for name, value in zip(apart, values, strict=True) if pd.notna(value)]
        yield (
            [value if isinstance(value, str) else f"{WORDS.get(name, name)} = {show(value)}" for name, value in known],
            line,
        )


def _axes(ax: Any, tops: list[str]) -> list[Any]:
    """A panel for each top, or one for all."""
    if ax is None:
        from matplotlib import pyplot as plt

        if len(tops) > MOST:
            raise ValueError(f"tops: there are {len(tops)}; choose at most {MOST}, as tops={tops[:2]}")
        columns = min(len(tops), 2)
        rows = -(-len(tops) // columns)
        width, height = plt.rcParams["figure.figsize"]
        size = (width * (1.15 if columns == 1 else 1.9), height * (1 if rows == 1 else 0.8 * rows))
        _, grid = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
        for spare in grid.flat[len(tops) :]:
            spare.remove()
        return list(grid.flat[: len(tops)])
    axes = list(np.ravel(np.array(ax, dtype=object)))
    if len(axes) not in (1, len(tops)):
        raise ValueError(f"ax: give one, or one for each of {len(tops)} tops; got {len(axes)}")
    return axes


# ---------------------------------------------------------------- questions


def drift(
    methods: Iterable[str | Method],
    tops: Top | Iterable[Top] = "generic",
    *,
    h: float | None = None,
    h_scaled: float | None = None,
    steps: int = 10_000,
) -> Comparison:
    """How far the invariants of the problem drift along a run.

    Parameters
    ----------
    methods, tops : see the head of this module. h : the step in the top's own unit; or h_scaled : in its time scale (0.125).
    steps : their number; samples are taken after 1, 2, 3, … steps, evenly on a logarithmic scale.

    Returns
    -------
    a `Comparison` with a column for each invariant, such as H, J3, C1, C2: (I − I at the start)/size of its terms; `worst`, the
    largest of those that are conserved; and "kept: …" for what a method conserves of its own.

    Raises
    ------
    ValueError : bad input, or a method that does not take a top.
    """
    steps = check_count(steps, "steps", least=1)
    step = _step(h, h_scaled, 0.125)
    asked = _Asked(methods, tops)
    frame = asked.measure(drift_experiment.measure, lambda unit: {"part": "time", "h": step(unit), "steps": steps})
    for top in asked.tops:
        here, names = frame["top"] == top.name, [name for name in top.top.names if name in top.top.conserved]
        frame.loc[here, "worst"] = worst(frame.reindex(columns=names)[here], names)
    return asked.comparison(frame, "t_scaled", "worst")


def phase(
    methods: Iterable[str | Method],
    tops: Top | Iterable[Top] = "generic",
    *,
    h: float | None = None,
    h_scaled: float | None = None,
    steps: int = 4_000,
) -> Comparison:
    """How far a run is from where it should be, and, of a top in a uniform field, where on its torus.

    Parameters
    ----------
    methods, tops, h, h_scaled, steps : as for `drift`; the default of h_scaled is 0.25. Without a closed form of the motion runs
        of at most 2000 time scales have a reference solution.

    Returns
    -------
    a `Comparison` with `error`, the distance to the exact or reference solution; of tops in a uniform field also `time` and
    `angle`, by which nutation and precession are off, and `off`, the distance to the torus.

    Raises
    ------
    ValueError : bad input, a method that does not take a top, or a run that is too long.
    """
    steps = check_count(steps, "steps", least=1)
    step = _step(h, h_scaled, 0.25)
    asked = _Asked(methods, tops)
    for top in asked.tops:
        if "uniform" not in top.top.offers and step(top.unit) * steps > truths.LONGEST:
            raise ValueError(
                f"steps: {top.name} has no reference solution beyond {truths.LONGEST:g} time scales; take fewer"
            )
    frame = asked.measure(phase_experiment.measure, lambda unit: {"part": "time", "h": step(unit), "steps": steps})
    return asked.comparison(frame, "t_scaled", "time" if "time" in frame and frame["time"].notna().all() else "error")


def order(methods: Iterable[str | Method], tops: Top | Iterable[Top] = "generic") -> Comparison:
    """The error of one step against the step: the slope is the order plus one.

    Parameters
    ----------
    methods, tops : see the head of this module; methods that step by h and are not exact in time.

    Returns
    -------
    a `Comparison` with `error`, the mean of a step of h and one of −h, where it is no round-off, and `order`, the measured one.
    Of a method whose steps depend on those before they are errors of short runs, for each step.

    Raises
    ------
    ValueError : bad input, or a method that has no order.
    """
    asked = _Asked(methods, tops)
    for method in asked.methods:
        if method.control == "tolerance" or method.order is None:
            why = "chooses its own steps" if method.control == "tolerance" else "is exact in time"
            raise ValueError(f"methods: {method.name} {why}: it has no order")

    def measure(cell: dict[str, Any]) -> list[dict[str, Any]]:
        start = next((top.top, top.state) for top in asked.tops if top.name == cell["state"])
        points = check.order_points(METHODS[cell["method"]], phase_experiment.ORDER_SPANS, (start,))
        few = len(points.spans) < 3
        found = np.nan if few else np.polyfit(np.log(points.spans), np.log(points.errors), 1)[0] - 1
        return [{"h": h, "error": e, "order": found} for h, e in zip(points.spans, points.errors, strict=True)]

    return asked.comparison(asked.measure(measure, lambda unit: {}), "h_scaled", "error")


def work_precision(
    methods: Iterable[str | Method],
    tops: Top | Iterable[Top] = "generic",
    *,
    t: float | None = None,
    t_scaled: float | None = None,
    longest: float = 0.4,
) -> Comparison:
    """What an error costs each method, in runs with ever smaller steps or tolerances.

    Parameters
    ----------
    methods, tops : see the head of this module. t : length of the runs in the top's own unit; or t_scaled : in its time scale
        (100). longest : s; no single run takes longer.

    Returns
    -------
    a `Comparison` with a row for each step or tolerance: `error`, the largest in the last fifth of the run, without a closed form
    that at its end; `seconds` (missing where the error is above 0.1), `setup_seconds`, `total` of both, `steps`, `evals`. In the
    last row of a method `stopped` says why there are no more.

    Raises
    ------
    ValueError : bad input, a method that does not take a top, or no run with an error below 0.1 within `longest`.
    """
    return _race(_Asked(methods, tops), work_experiment.measure, {}, _step(t, t_scaled, 100.0, "t"), longest, "seconds")


def perturbed(
    methods: Iterable[str | Method],
    tops: Top | Iterable[Top] = "weak_tide",
    *,
    t: float | None = None,
    t_scaled: float | None = None,
    longest: float = 0.1,
) -> Comparison:
    """As `work_precision`, where there is no closed form: tops in a potential, or problems of your own; set-up is counted.

    The default of t_scaled is 1000. Chaotic motions that double precision loses before the end have no errors: `stopped` says so.
    """
    asked = _Asked(methods, tops)
    for top in asked.tops:
        if "uniform" in top.top.offers:
            raise ValueError(f"tops: {top.name} is in a uniform field; take work_precision")
    return _race(asked, field_experiment.measure, {"part": "work"}, _step(t, t_scaled, 1000.0, "t"), longest, "total")


def heavy_top(methods: Iterable[str | Method], tops: str | Iterable[str] = "bruels") -> Comparison:
    """Position and rotation of a whole body at the end of a run against the step.

    Parameters
    ----------
    methods : those that take a `WholeBody`. tops : "bruels", "slow", "simo_wong" or "kovalevskaya". For a body of your own ask
        `work_precision` or `drift`.

    Returns
    -------
    a `Comparison` with h in s, `position` (m), `rotation` and `spin` (rad), `energy` and `momentum` (relative).

    Raises
    ------
    ValueError : bad input, or a method that does not take a whole body.
    """
    cases = [tops] if isinstance(tops, str) else list(tops)
    if unknown := [case for case in cases if case not in body_experiment.POWERS]:
        known = tuple(body_experiment.POWERS)
        raise ValueError(
            f"tops: {unknown[0]!r} must be one of {', '.join(known)}; of a body of your own ask work_precision"
        )
    asked = _Asked(methods, [_Placed(case, case, *body_experiment.motion(case)) for case in cases])
    units = {top.name: top.unit for top in asked.tops}

    def measure(cell: dict[str, Any]) -> list[dict[str, Any]]:
        case, rows = cell["state"], []
        for k in body_experiment.POWERS[case]:
            h = body_experiment.UNTIL[case] / 2**k
            found = _tried(body_experiment.measure, {**cell, "case": case, "h": h})
            rows += [{**row, "h": h / units[case]} for row in found]
        return rows

    return asked.comparison(asked.measure(measure, lambda unit: {}), "h", "rotation")


# ---------------------------------------------------------------- how they are asked


@dataclass(frozen=True)
class _Placed:
    """A problem and a state under a name."""

    name: str
    label: str
    top: Any
    state: Array

    @property
    def unit(self) -> float:
        return float(self.top.scales(self.state)[2])


class _Asked:
    """Methods and tops that were checked."""

    def __init__(self, methods: Any, tops: Any):
        if isinstance(methods, str) or not isinstance(methods, Iterable):
            raise ValueError(f"methods must be a list of names or Method objects; got {methods!r}")
        self.methods = tuple(find_method(method) for method in methods)
        names = [method.name for method in self.methods]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"methods: give at least one, and each name once; got {names}")
        one = isinstance(tops, (str, NamedTop)) or (
            isinstance(tops, tuple) and len(tops) == 2 and not isinstance(tops[0], (str, tuple))
        )
        if not one and not isinstance(tops, Iterable):
            raise ValueError(f"tops must be names, or pairs of a problem and a state; got {tops!r}")
        self.tops = tuple(_placed(top) for top in ([tops] if one else tops))
        if len({top.name for top in self.tops}) < max(len(self.tops), 1):
            raise ValueError(f"tops: give at least one, and each name once; got {[top.name for top in self.tops]}")
        refused = [reason for top in self.tops for method in self.methods if (reason := method.takes(top.top))]
        if refused:
            raise ValueError(f"methods: {'; '.join(refused)}")

    @property
    def invariants(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name for top in self.tops for name in top.top.names))

    def measure(
        self, measure: Callable[[dict[str, Any]], list[dict[str, Any]]], cell: Callable[[float], dict[str, Any]]
    ) -> pd.DataFrame:
        """The rows of `measure` for each top and method, a failed one where it ends in a StepError, in both units of time."""
        rows: list[dict[str, Any]] = []
        with ExitStack() as stack, warnings.catch_warnings():
            warnings.simplefilter("ignore", StepWarning)  # of steps that are tried because they are long
            for method in self.methods:
                stack.enter_context(METHODS.lent(method))
            for top in self.tops:
                stack.enter_context(NAMED_TOPS.lent(top))
            for top in self.tops:
                for method in self.methods:
                    asked = {"method": method.name, "state": top.name, **cell(top.unit)}
                    rows += [{**asked, **row} for row in _tried(measure, asked)]
        frame = pd.DataFrame(rows).rename(columns={"state": "top"}).drop(columns="part", errors="ignore")
        return in_both_units(frame, {top.name: top.unit for top in self.tops})

    def comparison(self, frame: pd.DataFrame, x: str, y: str) -> Comparison:
        labels = {top.name: top.label for top in self.tops}
        return Comparison(frame, x, y, self.methods, labels, self.invariants)


def _tried(measure: Callable[[dict[str, Any]], list[dict[str, Any]]], cell: dict[str, Any]) -> list[dict[str, Any]]:
    try:
        return [{**row, "status": "done", "failure": None} for row in measure(cell)]
    except StepError as error:
        return [{"status": "failed", "failure": str(error)}]


def _placed(top: Any) -> _Placed:
    """A top of a name, of the bench or of the user's own; or a problem and a state of it."""
    if isinstance(top, _Placed):
        return top
    if isinstance(top, str):
        if ":" in top:
            named = find_top(top)
            return _Placed(top, named.label, named.top, named.state)
        problem, y0 = states.find(top)
        return _Placed(top, NAMED_TOPS[top].label if top in NAMED_TOPS else top, problem, y0)
    if isinstance(top, NamedTop):
        return _Placed(top.name, top.label, top.top, top.state)
    if not isinstance(top, (tuple, list)) or not 2 <= len(top) <= 3:
        raise ValueError(f"tops: a top is a name, or a pair of a problem and a state; got {top!r}")
    *name, given, y0 = top
    problem = getattr(given, "problem", given)
    if not hasattr(problem, "check_state"):
        raise ValueError(f"tops: a pair is a problem, such as a LagrangeTop, and a state; got {top!r}")
    label = name[0] if name else getattr(problem, "name", None) or textwrap.shorten(repr(given), 60, placeholder=" …")
    if label in NAMED_TOPS or re.fullmatch(r"(random|wide|close)\d{3}", label):
        raise ValueError(f"tops: the bench has a top named {label}; give yours another name: ('mine', problem, y0)")
    return _Placed(label, label, problem, problem.check_state(y0))


def _step(own: float | None, scaled: float | None, usual: float, word: str = "h") -> Callable[[float], float]:
    """The step, or the length of a run, of a top with a time scale, in its time scale."""
    if own is not None and scaled is not None:
        raise ValueError(f"give {word} or {word}_scaled, not both")
    number = check_real(usual if own is scaled is None else scaled if own is None else own, word)
    if not number > 0:
        raise ValueError(f"{word if scaled is None else f'{word}_scaled'} must be positive; got {number:g}")
    return lambda unit: number if own is None else number / unit


def _race(
    asked: _Asked,
    measure: Callable[..., Any],
    fields: dict[str, Any],
    span: Callable[[float], float],
    longest: float,
    x: str,
) -> Comparison:
    """Work against precision of each method on each top."""
    if not check_real(longest, "longest") > 0:
        raise ValueError(f"longest must be positive; got {longest!r}")
    for top in asked.tops:
        if not SPANS[0] <= span(top.unit) <= SPANS[1]:
            raise ValueError(
                f"t must be from {SPANS[0]:g} to {SPANS[1]:g} time scales of {top.name}; got {span(top.unit):g}"
            )

    def cell(unit: float) -> dict[str, Any]:
        return {**fields, "span": float(span(unit)), "per_octave": 1, "decades": 1, "longest": longest}

    frame = asked.measure(measure, cell)
    if "seconds" not in frame or not frame["seconds"].notna().any():
        limit = work_experiment.USEFUL
        why = next((str(reason) for reason in frame.get("reason", ()) if isinstance(reason, str)), "")
        raise ValueError(
            f"methods: no run has an error below {limit:g} within longest = {longest:g} s{f': {why}' if why else ''}"
        )
    frame["total"] = frame["seconds"] + frame["setup_seconds"]
    return asked.comparison(frame, x, "error")
