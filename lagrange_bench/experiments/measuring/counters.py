"""Counts what a stepper does in a call."""

from collections.abc import Callable

from lagrange_bench.integrators.interface import Stepper


def counted(stepper: Stepper, call: Callable[[], object]) -> tuple[int, int, int, int]:
    """The steps, right-hand sides, iterations and rejected steps that `stepper` counts during `call()`."""
    work = stepper.work
    steps, evals, iterations, rejected = work.steps, work.rhs_evals, work.iterations, work.rejected
    call()
    return work.steps - steps, work.rhs_evals - evals, work.iterations - iterations, work.rejected - rejected
