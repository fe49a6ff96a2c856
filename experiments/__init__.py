"""Experiments: each file asks one question, measures rows, and draws them."""

from __future__ import annotations

import difflib
import importlib
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

EXPERIMENTS = ("drift", "phase", "cost", "work_precision", "perturbed", "round_off", "ensemble", "paper", "gaudin")

SWEEP = "sweep_"  # how the names of experiments begin that a TOML file describes


def load(name: str) -> ModuleType:
    """The module of an experiment: one of EXPERIMENTS, the dotted path of a module of your own, or a sweep.

    Raises
    ------
    ValueError : no such experiment, or the module lacks a part of the protocol.
    """
    if name in EXPERIMENTS:
        path = f"experiments.{name}"
    elif "." in name:
        path = name
    elif name.startswith(SWEEP):
        from experiments import sweep

        return sweep.module(name)
    else:
        close = difflib.get_close_matches(name, EXPERIMENTS, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else "."
        raise ValueError(f"unknown experiment {name!r}{hint} Known: {', '.join(EXPERIMENTS)}")
    try:
        module = importlib.import_module(path)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{path}.".startswith(f"{error.name}."):
            raise  # the experiment is there; something it imports is not
        raise ValueError(f"unknown experiment {name!r}: {error}") from None
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
