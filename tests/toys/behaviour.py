"""Cells that do as they are told.

The list of cells is JSON in the environment variable TOY_CELLS; a cell's field "do" says what measuring it does. TOY_PACE=0
leaves out the seconds that squares take.
"""

import json
import os
import signal
import sys
import time
import warnings
from pathlib import Path

import numpy as np

VERSION = 1


def cells(profile):
    return json.loads(os.environ["TOY_CELLS"])


def measure(cell):
    i = cell["i"]
    match cell["do"]:
        case "square":
            time.sleep(cell.get("seconds", 0.0) * float(os.environ.get("TOY_PACE", 1)))
        case "wait for lines":
            while not os.path.exists(cell["file"]) or Path(cell["file"]).read_bytes().count(b"\n") < cell["lines"]:
                time.sleep(0.01)
        case "raise":
            raise ArithmeticError(f"cell {i} was told to")
        case "long text":
            raise ValueError("x" * 10_000_000)
        case "exit":
            raise SystemExit(3)
        case "die":
            os._exit(3)
        case "segfault":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "compiled loop":  # like a long call into compiled code: no signal handler in Python runs
            signal.pthread_sigmask(signal.SIG_BLOCK, set(signal.Signals) - {signal.SIGKILL, signal.SIGTERM})
            time.sleep(600)
        case "wrong clock":
            time.time = lambda: -1e9
            time.time_ns = lambda: -(10**18)
        case "warn":
            warnings.warn("toy warning", RuntimeWarning, stacklevel=1)
            print("chatter on stdout")
            sys.stdout.flush()
        case "bad row":
            return [{"vector": np.zeros(3)}]
        case "fail until there":
            if not os.path.exists(cell["file"]):
                raise FileNotFoundError(cell["file"])
    facts = {"process": os.getpid(), "started": time.monotonic(), "threads": os.environ["OMP_NUM_THREADS"]}
    return [{"square": np.float64(i * i), "odd": np.bool_(i % 2)} | (facts if cell.get("facts") else {})]


def draw(rows):
    return {}


def tables(rows):
    return {}
