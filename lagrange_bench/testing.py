"""Tests for a method of your own: bounds on the drift of the invariants, and the order.

    from lagrange_bench.testing import assert_drift, assert_order

    def test_mine():
        assert_drift(METHOD, tops=("generic", "fast"), h=0.1, steps=10**6, H=16, C1=16)  # ulps
        assert_drift(METHOD, growth="H", below=0.75)  # exponent of the growth in time
        assert_order(METHOD)

A method is a `Method`, a registered name or "package.module:METHOD". A top is a name, as in `lagrange-bench tops` (tops in a
potential, too), or a pair (top, y0). Steps are in units of the top's own time scale 1/(|J| + √(|alpha||x|)), as in all
experiments. Drifts are in ulps (units in the last place) of the invariant's scale, the size of its terms at the start;
they are measured after 1, 2, 4, … steps, and at three counts between each two. docs/ci.md shows how to use this.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.measuring import check, metrics, states
from experiments.measuring.check import Verdict
from integrators import INVARIANTS, METHODS, Method, StepError
from integrators.checks import check_count, check_step
from integrators.files import write_file
from integrators.registry import find_method
from integrators.words import suggestion

TOPS = ("generic", "figure1", "fast", "slow")
IN_POTENTIALS = ("moderate_tide", "magnet")  # written bounds have these, too, for methods that take them
STEPS = (0.1, 0.5)  # of written bounds
LENGTH = (
    10**5
)  # steps of a run, if nobody says; 2000 for methods that are interpreted, 200 for those that are implicit, too
MARGIN = 2  # of a written bound, times what was measured
WHERE = ("method", "top", "h", "steps")  # in a file of bounds: what a bound is for
HEAD = """\
# The largest drift of each invariant that is allowed, in ulps of its scale (see docs/ci.md of lagrange-bench).
# Written as twice what was measured, by check --write-bounds or pytest --write-drift-bounds; edit the numbers as you like.
"""

Top = str | tuple[Any, Any]


@dataclass(frozen=True)
class Run:
    """The drift of the four invariants along one run, (N, 4) in ulps, after `counts` steps."""

    top: str
    h: float
    counts: list[int]
    ulps: np.ndarray
    conserved: tuple[str, ...]

    def largest(self, invariant: str) -> tuple[float, int]:
        """The largest drift, and after which step."""
        drift = np.abs(self.ulps[:, INVARIANTS.index(invariant)])
        at = int(np.argmax(np.where(np.isnan(drift), np.inf, drift)))
        return float(drift[at]), self.counts[at]


class Refused(AssertionError):
    """The method cannot take a step of this run."""


def assert_drift(
    method: str | Method,
    *,
    tops: Iterable[Top] | None = None,
    h: float | Iterable[float] = 0.1,
    steps: int | None = None,
    growth: str | None = None,
    below: float | None = None,
    options: Mapping[str, Any] | None = None,
    **ulps: float,
) -> None:
    """AssertionError if an invariant drifts further than a bound, or grows faster.

    Parameters
    ----------
    tops : default: TOPS; for `growth` the sixteen random tops of the drift experiment. h : one step or several.
    steps : default: LENGTH; fewer for a method that is interpreted. options : of the method.
    growth, below : the invariant whose root-mean-square error over the tops grows like t^p, and a bound on p.
    ulps : H=16, J3=0, C1=16, C2=16: bounds in ulps of the invariant's scale, all on every top.

    Raises
    ------
    AssertionError : with the top, the step, the number of steps and the value of everything that is beyond its bound.
    ValueError : the arguments make no test: no such method, top or invariant; a top that does not conserve the invariant.
    """
    if (growth is None) != (below is None):
        raise ValueError("growth and below go together: growth='H', below=0.75")
    if not ulps and growth is None:
        raise ValueError("give a bound to test: H=16, or growth='H' and below=0.75")
    asked = [*ulps, *([] if growth is None else [growth])]
    for name in asked:
        _check_invariant(name)
    for name, bound in ulps.items():
        if not bound >= 0:
            raise ValueError(f"{name} must be a bound in ulps, at least 0; got {bound!r}")
    found = find_method(method)
    if tops is None:
        tops = TOPS if growth is None else states.RANDOM
    runs = list(drifts(found, tops, h, steps, options))
    if not runs:
        raise ValueError("tops and h: give at least one of each")
    wrong = []
    for run in runs:
        for name in asked:
            if name not in run.conserved:
                raise ValueError(f"{name}: the motion of the top {run.top} does not conserve it")
        for name, bound in ulps.items():
            value, step = run.largest(name)
            if not value <= bound:
                wrong.append(f"{name} is off by {value:.4g} ulps at step {step} on {run.top}, h = {run.h:g}: {bound:g}")
    lines = [f"{found.name}: {text} allowed" for text in wrong]
    if growth is not None and below is not None:
        lines += _grows(found, runs, growth, below)
    if lines:
        raise AssertionError("\n".join(lines))


def _grows(method: Method, runs: list[Run], name: str, below: float) -> Iterator[str]:
    """What is wrong with the exponents, one for each step. A drift that never exceeds half an ulp has none."""
    for h in dict.fromkeys(run.h for run in runs):
        these = [run for run in runs if run.h == h]
        E = np.array([run.ulps[:, INVARIANTS.index(name)] for run in these])
        where = f"on {len(these)} tops, h = {h:g}, {these[0].counts[-1]} steps"
        if not np.all(np.isfinite(E)):
            yield f"{method.name}: {name} is not finite {where}"
            continue
        p, low, high = metrics.growth_exponent(abs(h) * np.array(these[0].counts), E, floor=0.5)
        if p >= below:
            yield f"{method.name}: {name} grows like t^{p:.2f} (from {low:.2f} to {high:.2f}) {where}: below {below:g} allowed"


def assert_order(method: str | Method, order: int | None = None, *, tops: Iterable[str] = check.ORDER_STATES) -> None:
    """AssertionError if the error of one step does not grow like h^(order + 1), as `lagrange-bench check` measures it.

    order : default: what the method claims for these tops, which are all in a potential or all not.

    Raises
    ------
    AssertionError : with the order that was found. ValueError : a method exact in time, or one that chooses its steps.
    """
    found, names = find_method(method), tuple(tops)
    if not names:
        raise ValueError("tops: give at least one")
    for name in names:
        if reason := found.takes(_find(name)[1]):
            raise ValueError(f"tops: {reason}")
    if order is not None:
        field = None if found.in_field is None else replace(found.in_field, order=order)
        found = replace(found, order=order, in_field=field)
    claimed = found.order_for(_find(names[0])[1])
    if claimed is None or found.control == "tolerance":
        why = "is exact in time" if claimed is None else "chooses its own steps"
        raise ValueError(f"{found.name} {why}: it has no order to measure")
    (verdict,) = check.order(found, False, names)
    if verdict.passed is False:
        raise AssertionError(f"{found.name}, {verdict}, on {', '.join(names)}")


# ---------------------------------------------------------------- runs


def drifts(
    method: Method,
    tops: Iterable[Top],
    h: float | Iterable[float],
    steps: int | None = None,
    options: Mapping[str, Any] | None = None,
) -> Iterator[Run]:
    """A run for each top and each h, in units of the top's own time scale.

    Raises
    ------
    Refused : the method cannot take a step. ValueError : no such top, or the method does not take it.
    """
    n = _length(method, steps)
    counts = states.log_counts(n, per_octave=4)
    with METHODS.lent(method) as name:
        for word in tops:
            label, top, y0 = _find(word)
            if reason := method.takes(top):
                raise ValueError(f"tops: {reason}")
            for size in _sizes(h):
                try:
                    _, y = states.sample(top, y0, name, size * top.scales(y0)[2], counts, **options or {})
                except StepError as error:
                    raise Refused(f"{name} on {label}, h = {size:g}, in {n} steps: {error.reason}") from None
                with np.errstate(over="ignore", invalid="ignore"):  # of a run that has left every bound behind
                    ulps = metrics.ulps(top.invariants(np.vstack((y0, y))), top.invariant_scales(y0))[1:]
                yield Run(label, size, counts, ulps, tuple(getattr(top, "conserved", INVARIANTS)))


def _length(method: Method, steps: int | None) -> int:
    return states.affordable(method, LENGTH, full=False) if steps is None else check_count(steps, "steps", least=1)


def _sizes(h: float | Iterable[float]) -> list[float]:
    return [check_step(size, "h") for size in ([h] if isinstance(h, (int, float)) else h)]


def _find(word: Top) -> tuple[str, Any, np.ndarray]:
    """What messages call a top, the top and its state."""
    if isinstance(word, str):
        return word, *check.find(word)
    top, y0 = word
    return f"{top!r} from {np.asarray(y0, dtype=float).tolist()}", top, np.array(y0, dtype=float)


def _check_invariant(name: Any) -> None:
    if name not in INVARIANTS:
        raise ValueError(
            f"unknown invariant {name!r}{suggestion(str(name), INVARIANTS)} Known: {', '.join(INVARIANTS)}"
        )


# ---------------------------------------------------------------- bounds in a file

Bound = dict[str, Any]  # WHERE, and a number for each invariant


def read_bounds(path: Path) -> list[Bound]:
    """The tables [[drift]] of a TOML file. ValueError says what is wrong with it, and where."""
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not TOML: {error}") from None
    tables = content.pop("drift", [])
    if content or not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ValueError(f"{path}: must consist of tables [[drift]]")
    for number, table in enumerate(tables, 1):
        place = f"{path}, [[drift]] {number}"
        if missing := [key for key in WHERE if key not in table]:
            raise ValueError(f"{place} lacks {', '.join(missing)}")
        bounds = {name: bound for name, bound in table.items() if name not in WHERE}
        for name, bound in bounds.items():
            if name not in INVARIANTS:
                raise ValueError(f"{place}: unknown key {name!r}{suggestion(name, (*WHERE, *INVARIANTS))}")
            if isinstance(bound, bool) or not isinstance(bound, (int, float)) or not bound >= 0:
                raise ValueError(f"{place}, {name} must be a bound in ulps, at least 0; got {bound!r}")
        if not bounds:
            raise ValueError(f"{place}: give a bound on one of {', '.join(INVARIANTS)}")
    return tables


def write_bounds(path: Path, bounds: Iterable[Bound]) -> None:
    """Writes bounds into a file, in place of those it has for the same methods, tops and steps."""
    path = Path(path)
    known = {run_of(bound): bound for bound in [*(read_bounds(path) if path.exists() else []), *bounds]}
    tables = ("\n".join(f"{key} = {json.dumps(value)}" for key, value in bound.items()) for bound in known.values())
    write_file(path, HEAD + "".join(f"\n[[drift]]\n{table}\n" for table in tables))


def run_of(bound: Bound) -> tuple[Any, ...]:
    """What a bound is for."""
    return tuple(bound[key] for key in WHERE)


def plan(
    method: Method, tops: Iterable[str] | None = None, h: float | Iterable[float] = STEPS, steps: int | None = None
) -> list[Bound]:
    """The runs that bounds are for. tops : default: TOPS, and IN_POTENTIALS if the method takes those."""
    if tops is None:
        tops = [*TOPS, *(name for name in IN_POTENTIALS if method.takes(_find(name)[1]) is None)]
    n = _length(method, steps)
    return [{"method": method.name, "top": top, "h": size, "steps": n} for top in tops for size in _sizes(h)]


def measured(method: Method, bounds: Iterable[Bound], options: Mapping[str, Any] | None = None) -> Iterator[Bound]:
    """What to write for these runs: MARGIN times the largest drift of what each top conserves, in whole ulps."""
    for bound in bounds:
        (run,) = drifts(method, [bound["top"]], bound["h"], bound["steps"], options)
        found = {name: run.largest(name)[0] for name in INVARIANTS if name in run.conserved}
        limits = {name: math.ceil(MARGIN * value) for name, value in found.items() if math.isfinite(value)}
        yield {**{key: bound[key] for key in WHERE}, **limits}


def judge(method: Method, bounds: Iterable[Bound], options: Mapping[str, Any] | None = None) -> Iterator[Verdict]:
    """A verdict on each bound that is for this method."""
    for bound in bounds:
        if bound["method"] != method.name:
            continue
        top, h, steps = (bound[key] for key in WHERE[1:])
        where, limits = f"{top}, h = {h:g}", {name: limit for name, limit in bound.items() if name not in WHERE}
        try:
            (run,) = drifts(method, [top], h, steps, options)
        except Refused as error:
            yield Verdict(f"drift on {where}", False, None, "", str(error))
            continue
        for name, limit in limits.items():
            value, step = run.largest(name)
            how = f"largest at step {step} of {steps}"
            yield Verdict(f"drift of {name} on {where}", value <= limit, value, f"≤ {limit:g} ulps", how)
