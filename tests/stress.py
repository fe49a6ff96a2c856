"""Runs the tests that start processes, terminals or browsers again and again on a busy machine: `make stress`.

Twice as many busy loops as cores run beside the tests. One failure in many rounds is a defect like any other.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from time import monotonic

HERE = Path(__file__).resolve().parent
LONGEST = 3600.0  # s; a round that takes longer hangs
LOOP = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    sum(range(10**6))"  # ends with its parent


@contextlib.contextmanager
def load(loops):
    """Keeps cores busy for as long as the block lasts."""
    processes = [subprocess.Popen([sys.executable, "-c", LOOP]) for _ in range(loops)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def play(words):
    """One round: how many tests failed, 1 at least if pytest itself did, and what it printed."""
    command = [sys.executable, "-m", "pytest", "-m", "processes", "-q", "-p", "no:cacheprovider", *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, cwd=HERE.parent, start_new_session=True, **pipes) as tests:
        try:
            out = tests.communicate(timeout=LONGEST)[0]
        except BaseException as error:  # also Ctrl-C, which does not reach another session
            os.killpg(tests.pid, signal.SIGKILL)
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            out = f"{tests.communicate()[0]}\nnot done after {LONGEST:g} s"
    failed = sum(int(count) for count in re.findall(r"(\d+) (?:failed|errors?)\b", out.strip().rpartition("\n")[2]))
    return failed or int(tests.returncode != 0), out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=30, metavar="N", help="default: 30")
    parser.add_argument("--minutes", type=float, default=240, metavar="M", help="no round begins later (default: 240)")
    parser.add_argument("--loops", type=int, default=2 * (os.cpu_count() or 1), metavar="N", help="default: 2 × cores")
    parser.add_argument("pytest", nargs="*", metavar="WORD", help="for pytest, after --, e.g. -n 2")
    options = parser.parse_args()
    begun, rounds, bad, failed = monotonic(), 0, 0, 0
    try:
        with load(options.loops):
            while rounds < options.rounds and monotonic() - begun < 60 * options.minutes:
                start = monotonic()
                failures, out = play(options.pytest)
                rounds, bad, failed = rounds + 1, bad + (failures > 0), failed + failures
                print(out if failures else "", end="")
                last = out.strip().rpartition("\n")[2]
                print(f"round {rounds}: {last} ({monotonic() - start:.0f} s)", flush=True)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    minutes = (monotonic() - begun) / 60
    print(f"stress: {rounds} of {options.rounds} rounds, {bad} with failures, {failed} tests failed, {minutes:.0f} min")
    return int(failed > 0 or rounds == 0)


if __name__ == "__main__":
    sys.exit(main())
