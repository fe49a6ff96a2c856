"""`python experiments/NAME.py` does what `lagrange-bench run NAME` does."""

import runpy
import sys


def run(name: str) -> None:
    """Run `lagrange-bench run NAME` with the options of this command line, and end the process with its exit code."""
    sys.argv[:] = ["lagrange-bench", "run", name, *sys.argv[1:]]
    runpy.run_module("lagrange_bench", run_name="__main__", alter_sys=True)
