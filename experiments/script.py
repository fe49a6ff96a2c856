"""`python experiments/NAME.py` does what `lagrange-bench run NAME` does."""

import runpy
import sys


def run(name: str) -> None:
    """Hands the words of this command line over to `lagrange-bench run NAME`; ends the process with its exit code."""
    sys.argv[:] = ["lagrange-bench", "run", name, *sys.argv[1:]]
    runpy.run_module("lagrange_bench", run_name="__main__", alter_sys=True)
