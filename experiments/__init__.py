"""Experiments: each file asks one question, measures rows, and draws them."""

from __future__ import annotations

import difflib
import importlib
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType

EXPERIMENTS = ("drift", "phase", "cost", "work_precision", "perturbed", "round_off", "ensemble", "paper", "gaudin")

SWEEP = "sweep_"  # how the names of experiments begin that a TOML file describes
GROUP = "lagrange_bench.experiments"  # of entry points: name = package.module


class UnknownExperiment(ValueError):
    """There is no experiment of this name, or none that may be imported."""


@cache
def installed() -> dict[str, EntryPoint]:
    """The experiments of other packages by name. The bench's own names, and those of modules and sweeps, are taken."""
    found = sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value), reverse=True)
    return {
        e.name: e for e in found if e.name not in EXPERIMENTS and "." not in e.name and not e.name.startswith(SWEEP)
    }


def load(name: str) -> ModuleType:
    """The module of an experiment: of EXPERIMENTS, of an installed package, a sweep, or the module of a dotted path.

    It imports what `name` says, so the user must have given it: see `load_stored` for names that come with results.

    Raises
    ------
    ValueError : no such experiment, or the module lacks a part of the protocol.
    """
    if name in EXPERIMENTS:
        path = f"experiments.{name}"
    elif "." in name and all(map(str.isidentifier, name.split("."))):
        path = name
    elif name.startswith(SWEEP):
        from experiments import sweep

        return sweep.module(name)
    elif name in installed():
        path = installed()[name].module
    else:
        known = [*EXPERIMENTS, *installed()]
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else "."
        raise UnknownExperiment(f"unknown experiment {name!r}{hint} Known: {', '.join(known)}")
    try:
        module = importlib.import_module(path)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{path}.".startswith(f"{error.name}."):
            raise  # the experiment is there; something it imports is not
        raise UnknownExperiment(f"unknown experiment {name!r}: {error}") from None
    if missing := [part for part in ("VERSION", "cells", "measure", "draw", "tables") if not hasattr(module, part)]:
        raise ValueError(f"experiment {name!r} ({module.__file__}) lacks {', '.join(missing)}")
    return module


@contextmanager
def interrupted_once() -> Iterator[None]:
    """Around all that a process does: the first Ctrl-C raises KeyboardInterrupt, later ones do nothing.

    The end that the first one begins is short, as worker processes are killed. A second Ctrl-C in the middle of it could
    only leave processes behind, or print a traceback.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:  # e.g. nohup
        yield
        return
    signal.signal(signal.SIGINT, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _interrupt(*_: object) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise KeyboardInterrupt


def load_stored(name: str) -> ModuleType:
    """As `load`, of a name that results bring with them: a module that nobody has imported yet is unknown.

    Whoever wrote the results chose the name, and importing a module runs its code.
    """
    if "." in name and name not in sys.modules:
        raise UnknownExperiment(f"unknown experiment {name!r}; if it is your own, add --module {name}")
    return load(name)
