"""Checks of arguments. Each returns the argument in its proper type, or raises a ValueError that names it."""

import inspect
import math
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lagrange_bench.support.words import suggestion

Array = NDArray[np.float64]

MOST = 2**62  # the largest count
# names in other programs → names here
USUAL = {"dt": "h", "step": "h", "step_size": "h", "n": "steps", "n_steps": "steps", "t_eval": "t", "times": "t"}


def warn_caller(text: str, category: type[Warning]) -> None:
    """Warn, and name the line of the user's code that called this package."""
    level, frame, package = 1, sys._getframe(), os.path.dirname(__file__) + os.sep
    while frame.f_back and frame.f_code.co_filename.startswith(package):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)


@lru_cache(maxsize=256)
def keyword_options(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of the keyword-only parameters: the options a user may set."""
    parameters = inspect.signature(function).parameters.values()
    return tuple(p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY)


def _as_reals(values: Any) -> Array | None:
    """`values` as a fresh array of finite doubles, or None."""
    try:
        numbers = np.array(values)
    except ValueError:  # rows of different lengths
        return None
    is_real = numbers.dtype.kind in "iuf" and np.isfinite(numbers).all()
    return numbers.astype(np.float64, copy=False) if is_real else None


def check_array(values: Any, name: str, *shapes: tuple[int, ...]) -> Array:
    """`values` as a fresh array of finite doubles, of one of these shapes; else ValueError."""
    numbers = _as_reals(values)
    if numbers is None or numbers.shape not in shapes:
        raise ValueError(f"{name} must be finite real numbers, shape {' or '.join(map(str, shapes))}; got {values!r}")
    return numbers


def check_state(y0: Any, name: str = "y0") -> Array:
    """`y0` as a fresh (6,) float64 array; else ValueError."""
    if np.isscalar(y0):
        raise ValueError(f"{name} must be a state (J1, J2, J3, x1, x2, x3); if {y0!r} is a step, write h={y0!r}")
    y = check_array(y0, name, (6,))
    if not y[3:].any():
        raise ValueError(f"{name} has x = 0: the axis of the top needs |x| > 0")
    return y


def as_state(y: Any, size: int = 6) -> Array:
    """`y` as a (size,) float64 array for compiled code, which checks nothing: `y` itself if it is one, else a checked copy."""
    if type(y) is np.ndarray and y.shape == (size,) and y.dtype == np.float64:
        return y
    return check_state(y, "y") if size == 6 else check_numbers(y, "y", size)


def check_numbers(y: Any, name: str, size: int) -> Array:
    """`y`, of any shape, as a fresh array (size,) of finite real numbers; else ValueError."""
    numbers = _as_reals(y)
    if numbers is None or numbers.size != size:
        raise ValueError(f"{name} must be {size} finite real numbers; got {y!r}")
    return numbers.reshape(size)


def check_step(h: Any, name: str = "h") -> float:
    """`h` as a finite float that is not zero."""
    step = check_real(h, name)
    if step == 0.0:
        raise ValueError(f"{name} must not be 0")
    return step


def check_times(t: Any, single: bool = False) -> Array:
    """`t` as a one-dimensional array of finite floats; with `single` one time is allowed, too, and gets no axis."""
    times = _as_reals(t)
    if times is None or times.ndim not in ((0, 1) if single else (1,)):
        raise ValueError(f"t must be {'a time or ' if single else ''}a one-dimensional array of finite real times")
    return times


def check_times_or_grid(t: Any, h: Any, steps: Any, every: Any) -> Array | None:
    """The times t, or None for a grid of steps of h; ValueError for both or neither."""
    if t is None:
        if h is None or steps is None:
            raise ValueError("give h and steps, or output times t")
        return None
    for name, value in (("h", h), ("steps", steps), ("every", every)):
        if value is not None:
            raise ValueError(f"give either t or h and steps; got t and {name}")
    return check_times(t)


def check_options(
    name: str, function: Callable[..., Any], options: Mapping[str, Any], other: Callable[..., Any] | None, runs: str
) -> None:
    """Raise a ValueError for an option that `function`, of the method `name`, does not have.

    other : the method's function for the other kind of runs, named by `runs`; None if there is none.
    """
    known = keyword_options(function) if options else ()
    for option in options:
        if option not in known:
            elsewhere = other is not None and option in keyword_options(other)
            hint = f"; did you mean {USUAL[option]!r}?" if option in USUAL else suggestion(option, known)
            hint = f": it belongs to {runs}." if elsewhere else hint
            offered = ", ".join(known) if known else "none"
            raise ValueError(f"unknown option {option!r} of {name}{hint} Options here: {offered}")


def check_grid(n: Any, every: Any = None, name: str = "n") -> tuple[int, int]:
    """The number of steps, and how many of them lead from one row to the next: by default all."""
    n = check_count(n, name)
    every = max(n, 1) if every is None else check_count(every, "every", least=1)
    if n % every:
        raise ValueError(f"every = {every} does not divide {name} = {n}")
    return n, every


def check_real(value: Any, name: str) -> float:
    """`value` as a finite float."""
    if isinstance(value, (bool, np.bool_, str, bytes, complex)):
        raise ValueError(f"{name} must be a real number; got {value!r}")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a real number; got {value!r}") from None
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite; got {number}")
    return number


def check_reals(values: Any, name: str) -> tuple[float, ...]:
    """`values` as finite floats."""
    if isinstance(values, (str, bytes)) or not hasattr(values, "__iter__"):
        raise ValueError(f"{name} must be numbers; got {values!r}")
    return tuple(check_real(value, f"{name}[{i}]") for i, value in enumerate(values))


def check_one_or_many(value: Any, name: str) -> Any:
    """`value` as a finite float; or an array (n,) of them, which is copied and read-only."""
    if not isinstance(value, np.ndarray) or value.ndim != 1:
        return check_real(value, name)
    numbers = check_array(value, name, value.shape)
    numbers.flags.writeable = False
    return numbers


def check_flag(value: Any, name: str) -> bool:
    """`value` as True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} must be True or False; got {value!r}")
    return bool(value)


def check_choice(value: Any, name: str, choices: Iterable[str]) -> str:
    """`value` as one of the `choices`."""
    known = list(choices)
    if not isinstance(value, str) or value not in known:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, known))}; got {value!r}")
    return value


def check_count(n: Any, name: str, least: int = 0) -> int:
    """`n` as an int of at least `least`."""
    if type(n) is int and least <= n <= MOST:
        return n
    is_whole = isinstance(n, (int, np.integer)) or (isinstance(n, float) and n.is_integer())  # 1e6, too
    if isinstance(n, (bool, np.bool_)) or not is_whole:
        raise ValueError(f"{name} must be a whole number; got {n!r}")
    if n < least:
        raise ValueError(f"{name} must be at least {least}; got {n}")
    if n > MOST:
        raise ValueError(f"{name} must be at most {MOST}; got {n}")
    return int(n)


def check_rows(name: str, word: str, rows: Any, shape: tuple[int, ...]) -> None:
    """ValueError unless `rows`, which `word` of the method `name` returned, is an array of floats of this shape."""
    if not isinstance(rows, np.ndarray) or rows.shape != shape or rows.dtype != np.float64:
        kind = f"{rows.dtype} {rows.shape}" if isinstance(rows, np.ndarray) else type(rows).__name__
        raise ValueError(f"{name}: {word} must return an array of floats (float64) of shape {shape}; got {kind}")
