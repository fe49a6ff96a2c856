"""Tries the first step of a method before its claims are tested: a fault is reported once, with the line of the user's code."""

import traceback
import warnings
from typing import Any

import numpy as np

from lagrange_bench.integrators.checks import check_rows
from lagrange_bench.integrators.compiling import loops
from lagrange_bench.integrators.compiling.compiled import NumbaError, useful_lines
from lagrange_bench.integrators.interface import Method, StepError
from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.integrators.registry import METHODS
from lagrange_bench.support.words import suggestion


def problem(method: Method, word: str | None) -> str | None:
    """One line that says why the method cannot take its first step; None if it can, or if it raises StepError.

    word : the name of the method, or module:METHOD; None for a record that was passed itself.
    """
    for named in (TOPS["generic"], PERTURBED_TOPS["moderate_tide"]):
        if method.takes(named.top) is not None:
            continue
        top, y0 = named.top, named.state
        try:
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                build = method.prepare_for(top)
                stepper: Any = build(top, y0.copy(), 0.1 * top.scales(y0)[2])
                if not getattr(build, "func", build).__module__.startswith("lagrange_bench."):
                    _interpreted(stepper, y0)
                check_rows(method.name, "record", stepper.record(y0.copy(), 1, 1), (2, len(y0)))
                check_rows(method.name, "advance", stepper.advance(y0.copy(), 1), (len(y0),))
        except StepError:
            continue
        except (Exception, SystemExit) as error:  # a plug-in may raise anything
            return describe(error, method, word)
    return None


def _interpreted(stepper: Any, y0: Any) -> None:
    """Take one step without the compiler. IndexError: the kernel reads beyond its arrays, which compiled code does not notice."""
    kernel: Any = getattr(stepper, "kernel", None)
    if not hasattr(getattr(kernel, "step", None), "py_func"):
        return
    try:
        kernel.step.py_func(tuple(stepper.enter(y0).tolist()), stepper.constants, np.zeros(len(stepper.counters)))
    except IndexError:
        raise
    except Exception:  # the kernel may call a function that only compiled code can call
        return


def describe(error: BaseException, method: Method, word: str | None) -> str:
    """An error as one line of text, with the innermost line of the method's own code."""
    if isinstance(error, loops.KernelError):
        return error.reason
    if isinstance(error, NumbaError):
        return useful_lines(error)
    text = " ".join(f"{type(error).__name__}: {error}".split())
    frames = list(traceback.walk_tb(error.__traceback__))
    if isinstance(error, NameError) and error.name:
        known = {**frames[-1][0].f_globals, **frames[-1][0].f_locals}
        text += suggestion(error.name, known).rstrip(".")
    record, prepare = word and METHODS.module(word), getattr(method.prepare, "__module__", None)
    own_packages = {module.partition(".")[0] for module in (record, prepare) if module}
    places = [(f, line) for f, line in frames if f.f_globals.get("__name__", "").partition(".")[0] in own_packages]
    if places:
        frame, line = places[-1]
        return f"{text} ({frame.f_code.co_filename}:{line})"
    what_returned = isinstance(error, (ValueError, TypeError)) and frames[-1][0].f_code.co_filename == loops.__file__
    return f"{text}; a kernel returns six numbers" if what_returned else text
