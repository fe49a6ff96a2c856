"""What tests of faults share: runs of toy cells in processes of their own, and what is left of them."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from lagrange_bench.results.store import Store

HERE = Path(__file__).resolve().parent
TOY = "toys.behaviour"


def squares(*numbers, **fields):
    return [{"do": "square", "i": i, **fields} for i in numbers]


def start(cells, results, *words, jobs=2, **variables):
    """`lagrange-bench run` of these cells, in a process and a process group of its own; warnings are errors in it."""
    environment = {**os.environ, "TOY_CELLS": json.dumps(cells), "PYTHONPATH": str(HERE), **variables}
    command = [sys.executable, "-W", "error", "-m", "lagrange_bench", "run", TOY, "--results", str(results)]
    command += ["--jobs", str(jobs), *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env=environment, cwd=HERE.parent, start_new_session=True, **pipes)


def python(*words, **settings):
    """A process of Python that has ended."""
    settings = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 120, **settings}
    return subprocess.run([sys.executable, *map(str, words)], check=False, **settings)


def end(process):
    """Kills what is left of a session."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


@contextlib.contextmanager
def interrupted():
    """Ctrl-C comes after 0.3 s and must end what is inside within a second or so, though it would take an hour."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            yield
    finally:
        timer.cancel()
        signal.signal(signal.SIGINT, before)


def wait_for_lines(path, count, run=None):
    for _ in range(1500):
        if path.exists() and path.read_bytes().count(b"\n") >= count:
            return
        if run is not None and run.poll() is not None:
            break
        time.sleep(0.02)
    raise AssertionError(f"{path} never had {count} lines: {'' if run is None else run.communicate()}")


def session(leader):
    """Processes of a session that are alive."""
    alive = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, _, _, number = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
            except OSError:
                continue
            if int(number) == leader and state != "Z":
                alive.append(entry.name)
    return alive


def nobody_left(leader):
    for _ in range(200):
        if not session(leader):
            return True
        time.sleep(0.05)
    return False


def comparable(results, name=TOY):
    """What does not depend on when, where and how often a cell was computed."""
    return [{**r, "seconds": 0, "provenance": {}} for r in Store(results).open(name).latest]
