"""How far the invariants drift along runs of a method.

Steps are in units of the top's own time scale 1/(|J| + √(|alpha||x|)), as in all experiments. Drifts are in ulps (units in
the last place) of the invariant's scale, the size of its terms at the start; they are measured after 1, 2, 4, … steps, and
at three counts between each two.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from lagrange_bench.experiments.measuring import check, metrics, states
from lagrange_bench.integrators import METHODS, Method, StepError
from lagrange_bench.integrators.checks import check_count, check_step
from lagrange_bench.integrators.words import suggestion

__tracebackhide__ = True  # pytest shows the user's test, not the lines of this file

TOPS = ("generic", "figure1", "fast", "slow")
# steps of a run by default; 2000 for methods that are interpreted, 200 for those that are implicit, too
LENGTH = 10**5

Top = str | tuple[Any, Any]
Named = tuple[str, Any, np.ndarray]


class Run(NamedTuple):
    """The drift of the invariants `names` along one run, (N, len(names)) in ulps, after `counts` steps."""

    top: str
    h: float
    counts: list[int]
    ulps: np.ndarray
    names: tuple[str, ...]

    def drift(self, invariant: str) -> np.ndarray:
        """Of one invariant, (N,)."""
        return self.ulps[:, self.names.index(invariant)]

    def largest(self, invariant: str) -> tuple[float, int]:
        """The largest drift, and after which step."""
        drift = np.abs(self.drift(invariant))
        at = int(np.argmax(np.where(np.isnan(drift), np.inf, drift)))
        return float(drift[at]), self.counts[at]


class Refused(AssertionError):
    """The method cannot take a step of this run."""


def drifts(
    method: Method,
    tops: Iterable[Named],
    h: float | Iterable[float],
    steps: int | None = None,
    options: Mapping[str, Any] | None = None,
) -> Iterator[Run]:
    """A run for each top and each h, in units of the top's own time scale; `tops` as `find` gives them.

    Raises
    ------
    Refused : the method cannot take a step. ValueError : the method does not take a top.
    """
    n = states.affordable(method, LENGTH, full=False) if steps is None else check_count(steps, "steps", least=1)
    counts = states.log_counts(n, per_octave=4)
    sizes = [check_step(size, "h") for size in (h if isinstance(h, Iterable) else [h])]
    if not isinstance(options or {}, Mapping):
        raise ValueError(f"options must be a dict; got {options!r}")
    with METHODS.lent(method) as name:
        for label, top, y0 in tops:
            if reason := method.takes(top):
                raise ValueError(f"tops: {reason}")
            for size in sizes:
                try:
                    times, y = states.sample(top, y0, name, size * top.scales(y0)[2], counts, **options or {})
                except StepError as error:
                    raise Refused(f"{name} on {label}, h = {size:g}, in {n} steps: {error.reason}") from None
                with np.errstate(over="ignore", invalid="ignore"):  # of a run that has left every bound behind
                    values = top.invariants(np.vstack((y0, y)), np.concatenate(((0.0,), times)))
                    ulps = metrics.ulps(values, top.invariant_scales(y0))[1:]
                yield Run(label, size, counts, ulps, top.names)


def find(word: Top) -> Named:
    """What messages call a top or another problem, the problem and its state."""
    if isinstance(word, str):
        return word, *check.find(word)
    pair = isinstance(word, (tuple, list)) and len(word) == 2
    problem: Any = getattr(word[0], "problem", word[0]) if pair else None  # of a magnet or a body
    if not hasattr(problem, "check_state"):
        raise ValueError(f"tops: a top is a name or a pair (top or Problem, y0); got {word!r}")
    y0 = problem.check_state(word[1])
    return f"{problem!r} from {y0.tolist()}", problem, y0


def find_all(tops: Any, invariants: Iterable[str] = ()) -> list[Named]:
    """Every top of a sequence. ValueError: it is none, or one of them does not conserve one of `invariants`."""
    if isinstance(tops, str) or not isinstance(tops, Iterable):
        raise ValueError(f"tops must be a sequence of tops; got {tops!r}")
    named = [find(word) for word in tops]
    for label, problem, _ in named:
        for name in invariants:
            if name not in problem.names:
                hint = suggestion(str(name), problem.names)
                raise ValueError(f"unknown invariant {name!r}{hint} Known: {', '.join(problem.names)}")
            if name not in problem.conserved:
                raise ValueError(f"{name}: the motion of the top {label} does not conserve it")
    return named
