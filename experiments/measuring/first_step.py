"""The first step of a method, before all else: a kernel that cannot take it has one fault, reported once, with its line.

Numba does not name the line of every mistake, and compiled code does not check indices. Python does both. So the step is taken
once more by another process, with Numba switched off: `python -m lagrange_bench.experiments.measuring.first_step module:METHOD`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import traceback
import warnings
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.numba_internals import NumbaError, useful_lines
from lagrange_bench.integrators.interface import Method, StepError
from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS
from lagrange_bench.integrators.problem.rotated import prepare_for
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.integrators.registry import METHODS, find_method
from lagrange_bench.integrators.words import suggestion

PATIENCE = 60  # seconds that the other process may take


def problem(method: Method, word: str | None) -> str | None:
    """Why the method cannot take its first step, in one line; None if it can, or has a StepError.

    word : its name or module:METHOD, by which another process finds it, too. None: it has none.
    """
    error = stumble(method)
    if error is None:
        found = None if word is None or word in METHODS.built_in else interpreted(word)
        if found is None or found[0] != IndexError.__name__:  # else it is only Python that cannot take it
            return None
        return f"{found[1]}; compiled code does not check indices and takes whatever lies there"
    cause = error.__cause__ if isinstance(error, loops.KernelError) else error
    found = interpreted(word) if word is not None and isinstance(cause, NumbaError) else None
    return found[1] if found else describe(error, method, word)


def stumble(method: Method) -> BaseException | None:
    """What a first step ends in, if neither in a state nor in a StepError."""
    for named in (TOPS["generic"], *([PERTURBED_TOPS["moderate_tide"]] if method.in_field else [])):
        if method.takes(named.top) is not None:
            continue
        top, y0 = named.top, named.state
        try:
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                stepper: Any = prepare_for(method, top)(top, y0.copy(), 0.1 * top.scales(y0)[2])
                if stepper is None:
                    raise ValueError("prepare returned None: return a stepper")
                stepper.advance(y0.copy(), 1)
        except StepError:
            continue
        except (Exception, SystemExit) as error:  # a plug-in may raise anything
            return error
    return None


def describe(error: BaseException, method: Method, word: str | None) -> str:
    """An error in one line, with the innermost line of the method's own code."""
    if isinstance(error, loops.KernelError):
        return f"the kernel cannot be compiled: {useful_lines(error.__cause__)}"
    if isinstance(error, NumbaError):
        return useful_lines(error)
    text = " ".join(f"{type(error).__name__}: {error}".split())
    frames = list(traceback.walk_tb(error.__traceback__))
    if isinstance(error, NameError) and error.name:
        known = {**frames[-1][0].f_globals, **frames[-1][0].f_locals}
        text += suggestion(error.name, known).rstrip(".")
    own = {module.partition(".")[0] for module in _modules(method, word)}
    places = [(f, line) for f, line in frames if f.f_globals.get("__name__", "").partition(".")[0] in own]
    if places:
        frame, line = places[-1]
        return f"{text} ({frame.f_code.co_filename}:{line})"
    what_returned = isinstance(error, (ValueError, TypeError)) and frames[-1][0].f_code.co_filename == loops.__file__
    return f"{text}; a kernel returns six numbers" if what_returned else text


def _modules(method: Method, word: str | None) -> set[str]:
    """The modules of the record and of its `prepare`."""
    named = set() if word is None else {METHODS.module(word)}
    return named | {getattr(method.prepare, "__module__", None) or ""}


def interpreted(word: str) -> tuple[str, str] | None:
    """Type and description of what the step ends in without Numba; None if in nothing, or if this cannot be found out."""
    path = os.pathsep.join(folder for folder in sys.path if folder)
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    command = [sys.executable, "-P", "-m", __name__, word]
    settings: dict[str, Any] = {"env": environment, "capture_output": True, "stdin": subprocess.DEVNULL, "text": True}
    try:
        done = subprocess.run(command, check=True, timeout=PATIENCE, **settings)
        found = json.loads(done.stdout.splitlines()[-1])  # the method's module may print, too
    except (subprocess.SubprocessError, OSError, ValueError, IndexError):
        return None
    return (found[0], found[1]) if found else None


def main(word: str) -> None:
    method = find_method(word)
    error = stumble(method)
    print()
    print(json.dumps(error and (type(error).__name__, describe(error, method, word))))


if __name__ == "__main__":
    main(sys.argv[1])
