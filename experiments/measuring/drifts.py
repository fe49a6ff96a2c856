"""How far the invariants drift along runs of a method.

Steps are in units of the top's own time scale 1/(|J| + √(|alpha||x|)), as in all experiments. Drifts are in ulps (units in
the last place) of the invariant's scale, the size of its terms at the start; they are measured after 1, 2, 4, … steps, and
at three counts between each two.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lagrange_bench.experiments.measuring import check, metrics, states
from lagrange_bench.integrators import INVARIANTS, METHODS, LagrangeTop, Method, PerturbedTop, StepError
from lagrange_bench.integrators.checks import check_count, check_state, check_step
from lagrange_bench.integrators.words import suggestion

__tracebackhide__ = True  # pytest shows the user's test, not the lines of this file

TOPS = ("generic", "figure1", "fast", "slow")
# steps of a run by default; 2000 for methods that are interpreted, 200 for those that are implicit, too
LENGTH = 10**5

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
                yield Run(label, size, counts, ulps, tuple(top.conserved))


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
