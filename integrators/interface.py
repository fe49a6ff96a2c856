"""The one contract between a method and everything that uses it.

A method is a record of claims (`Method`) with a builder (`prepare`); what it builds is a `Stepper`.
Tests read the claims and check them; experiments only ever see a `Stepper`.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST = 2**62  # of anything that is counted
INVARIANTS = ("H", "J3", "C1", "C2")
ENGINES = ("numba", "heyoka", "scipy", "python")
FAMILIES = ("backlund", "closed-form", "taylor", "runge-kutta", "splitting", "integrable", "implicit", "lie-group")


class StepError(RuntimeError):
    """A method could not take a step: it says which method, which h, where and why."""

    def __init__(self, method: str, reason: str, *, h: float | None = None, step: int | None = None) -> None:
        at = "" if h is None else f" at h = {h:g}"
        where = "" if step is None else f", step {step}"
        super().__init__(f"{method}{at}{where}: {reason}")
        self.method, self.reason, self.h, self.step = method, reason, h, step

    def __reduce__(self) -> tuple[Any, ...]:  # keyword-only arguments do not survive the default pickling of exceptions
        return _rebuild_step_error, (self.method, self.reason, self.h, self.step)


def _rebuild_step_error(method: str, reason: str, h: float | None, step: int | None) -> StepError:
    return StepError(method, reason, h=h, step=step)


@dataclass
class Work:
    """What a stepper has done so far. Set-up is counted apart, with the compilation of a kernel's first use."""

    steps: int = 0  # internal steps: one per h for control "step", natural steps for control "tolerance"
    rhs_evals: int = 0  # right-hand sides, or their equivalent where a method has any
    iterations: int = 0  # of a nonlinear solver
    rejected: int = 0  # steps tried and thrown away
    setup_seconds: float = 0.0


class Stepper(Protocol):
    """Advances states by multiples of the step h it was built for."""

    work: Work

    def advance(self, y: Array, n: int) -> Array:
        """State (6,) after time n*h. `y` is (6,) float64 and is not modified."""
        ...

    def record(self, y: Array, n: int, every: int) -> Array:
        """States after 0, every, 2*every, … n steps, shape (n//every + 1, 6); row 0 is `y`."""
        ...


Quantity = Callable[[Any, float, Array], tuple[Array, float]]


@dataclass(frozen=True)
class Method:
    """What a method claims. Every field is read by a test, a legend or a table."""

    name: str  # registry key, the name in every table
    label: str  # what a legend shows
    family: str  # colour and grouping: one of FAMILIES, or a plug-in's own
    order: int | None  # None: exact in time
    symmetric: bool  # step(-h) undoes step(h)
    poisson: bool  # one step is a Poisson map
    conserves: frozenset[str]  # of INVARIANTS: at round-off, for every h
    control: str  # "step": one internal step per h · "tolerance": h is the output grid, tol the knob
    source: str  # citation, equation numbers
    prepare: Callable[..., Stepper]  # (top, y0, h, **options): everything slow happens here, once
    evaluate: Callable[..., tuple[Array, Work]] | None = None  # (top, y0, times, **options): dense output or jumps
    attitude: Callable[..., Array] | None = None  # (top, y0, h, n, every, g0) -> unit quaternions, see `body`
    # many tops in one call, (n,) alphas and (n, 6) states: (alphas, Y0, h, steps, every, out, stopped, **options) and
    # (alphas, Y0, times, out, **options) → the tops done, a mask; see `ensemble`
    advance_many: Callable[..., NDArray[np.bool_]] | None = None
    evaluate_many: Callable[..., NDArray[np.bool_]] | None = None
    requires: str | None = None  # a package that may be missing on some platforms
    engine: str = "numba"  # what takes the steps: "numba" compiled here · "heyoka" · "scipy" and "python" interpreted
    # what else is kept at round-off for every h, a modified energy say: name → function of (top, h, states (N, 6))
    # that returns its values (N,) and the size of its terms at the first state
    keeps: Mapping[str, Quantity] = field(default_factory=dict, hash=False)
    # of `conserves` and `keeps`: those whose round-off grows faster than a random walk, and why
    biased: Mapping[str, str] = field(default_factory=dict, hash=False)
    options: tuple[str, ...] = field(init=False)  # keyword options of `prepare`

    def __post_init__(self) -> None:
        if self.control not in ("step", "tolerance"):
            raise ValueError(f"control must be 'step' or 'tolerance', not {self.control!r}")
        if self.engine not in ENGINES:
            raise ValueError(f"engine must be one of {', '.join(ENGINES)}; got {self.engine!r}")
        if unknown := self.conserves - set(INVARIANTS):
            raise ValueError(f"conserves names unknown invariants: {sorted(unknown)}")
        if unclaimed := sorted(set(self.biased) - self.conserves - set(self.keeps)):
            raise ValueError(f"biased names what is not claimed: {unclaimed}")
        object.__setattr__(self, "options", keyword_options(self.prepare))

    @property
    def knob(self) -> str:
        """The option that trades work for precision: "tol" or "rtol" for control "tolerance", else "h"."""
        return "h" if self.control == "step" else next(name for name in self.options if name in ("tol", "rtol"))


def keyword_options(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of the keyword-only parameters: the options a user may set."""
    parameters = inspect.signature(function).parameters.values()
    return tuple(p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY)


def suggestion(name: str, known: Iterable[str]) -> str:
    """What follows an unknown name in a message: the known one it is close to, if any."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else "."


# ---------------------------------------------------------------- checking what a user passes in


def check_state(y0: Any, name: str = "y0") -> Array:
    """`y0` as a fresh (6,) float64 array; ValueError naming the argument if it is anything else."""
    try:
        y = np.asarray(y0)
    except ValueError as error:
        raise ValueError(f"{name} must be six real numbers (J1, J2, J3, x1, x2, x3): {error}") from None
    if y.shape != (6,):
        raise ValueError(f"{name} must have shape (6,), that is (J1, J2, J3, x1, x2, x3); got shape {y.shape}")
    if y.dtype.kind not in "iuf":
        raise ValueError(f"{name} must be real numbers; got dtype {y.dtype}")
    y = np.array(y, dtype=np.float64)
    if not np.all(np.isfinite(y)):
        raise ValueError(f"{name} must be finite; got {y.tolist()}")
    if not np.any(y[3:]):
        raise ValueError(f"{name} has x = 0: the axis of the top needs |x| > 0")
    return y


def check_step(h: Any, name: str = "h") -> float:
    """`h` as a finite float that is not zero."""
    step = check_real(h, name)
    if step == 0.0:
        raise ValueError(f"{name} must not be 0")
    return step


def check_times(t: Any) -> Array:
    """`t` as a one-dimensional array of finite floats."""
    times = np.asarray(t)
    if times.ndim != 1 or times.dtype.kind not in "iuf" or not np.all(np.isfinite(times)):
        raise ValueError("t must be a one-dimensional array of finite real times")
    return times.astype(np.float64)


def check_options(name: str, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
    """ValueError for an option that `function`, of the method `name`, does not have."""
    known = keyword_options(function) if options else ()
    for option in options:
        if option not in known:
            offered = ", ".join(known) if known else "none"
            raise ValueError(f"unknown option {option!r} of {name}{suggestion(option, known)} Its options: {offered}")


def check_real(value: Any, name: str) -> float:
    """`value` as a finite float."""
    if isinstance(value, (bool, np.bool_, str, bytes, complex)):
        raise ValueError(f"{name} must be a real number; got {value!r}")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a real number; got {value!r}") from None
    if not np.isfinite(number):
        raise ValueError(f"{name} must be finite; got {number}")
    return number


def check_choice(value: Any, name: str, choices: Iterable[str]) -> str:
    """`value` as one of the `choices`."""
    known = list(choices)
    if not isinstance(value, str) or value not in known:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, known))}; got {value!r}")
    return value


def check_count(n: Any, name: str, least: int = 0) -> int:
    """`n` as an int of at least `least`."""
    if isinstance(n, (bool, np.bool_)) or not isinstance(n, (int, np.integer)):
        raise ValueError(f"{name} must be a whole number; got {n!r}")
    if n < least:
        raise ValueError(f"{name} must be at least {least}; got {n}")
    if n > MOST:
        raise ValueError(f"{name} must be at most {MOST}; got {n}")
    return int(n)
