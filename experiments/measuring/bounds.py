"""How far the invariants drift along runs of a method, and bounds on that, kept in a file.

Steps are in units of the top's own time scale 1/(|J| + √(|alpha||x|)), as in all experiments. Drifts are in ulps (units in
the last place) of the invariant's scale, the size of its terms at the start; they are measured after 1, 2, 4, … steps, and
at three counts between each two.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lagrange_bench.experiments.measuring import check, metrics, states
from lagrange_bench.experiments.measuring.check import Verdict
from lagrange_bench.integrators import INVARIANTS, METHODS, LagrangeTop, Method, PerturbedTop, StepError
from lagrange_bench.integrators.checks import check_count, check_state, check_step
from lagrange_bench.integrators.files import read_toml, write_file
from lagrange_bench.integrators.words import suggestion

__tracebackhide__ = True  # pytest shows the user's test, not the lines of this file

TOPS = ("generic", "figure1", "fast", "slow")
IN_POTENTIALS = ("moderate_tide", "magnet")  # written bounds have these, too, for methods that take them
STEPS = (0.1, 0.5)  # of written bounds
# steps of a run by default; 2000 for methods that are interpreted, 200 for those that are implicit, too
LENGTH = 10**5
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
    if not isinstance(options or {}, Mapping):
        raise ValueError(f"options must be a dict; got {options!r}")
    with METHODS.lent(method) as name:
        for word in check_tops(tops):
            label, top, y0 = find(word)
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
    return [check_step(size, "h") for size in (h if isinstance(h, Iterable) else [h])]


def find(word: Top) -> tuple[str, Any, np.ndarray]:
    """What messages call a top, the top and its state."""
    if isinstance(word, str):
        return word, *check.find(word)
    pair = isinstance(word, (tuple, list)) and len(word) == 2
    if not pair or not isinstance(word[0], (LagrangeTop, PerturbedTop)):
        raise ValueError(f"tops: a top is a name or a pair (LagrangeTop or PerturbedTop, y0); got {word!r}")
    top, y0 = word[0], check_state(word[1])
    return f"{top!r} from {y0.tolist()}", top, y0


def check_tops(tops: Any) -> tuple[Top, ...]:
    """`tops` as a tuple; ValueError if they are no sequence."""
    if isinstance(tops, str) or not isinstance(tops, Iterable):
        raise ValueError(f"tops must be a sequence of tops; got {tops!r}")
    return tuple(tops)


def check_invariant(name: Any) -> None:
    """ValueError if it is none."""
    if name not in INVARIANTS:
        raise ValueError(
            f"unknown invariant {name!r}{suggestion(str(name), INVARIANTS)} Known: {', '.join(INVARIANTS)}"
        )


# ---------------------------------------------------------------- bounds in a file

Bound = dict[str, Any]  # WHERE, and a number for each invariant


def read_bounds(path: Path) -> list[Bound]:
    """The tables [[drift]] of a TOML file. ValueError says what is wrong with it, and where."""
    content = read_toml(Path(path))
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
        tops = [*TOPS, *(name for name in IN_POTENTIALS if method.takes(find(name)[1]) is None)]
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
