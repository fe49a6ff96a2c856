"""Tests the duties of every stepper, whatever its method claims: it is a function of its arguments, and never gives a NaN."""

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np

from lagrange_bench.experiments.measuring import first_step
from lagrange_bench.experiments.measuring.states import NEGATIVE, Starts, placed, prepared
from lagrange_bench.experiments.measuring.verdicts import Verdict
from lagrange_bench.integrators.interface import Array, Method, StepError
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.top import TOPS, LagrangeTop


def purity(method: Method, quick: bool, names: Starts = ("generic", "figure1")) -> Iterator[Verdict]:
    """A stepper is a function of its arguments: it modifies nothing, remembers nothing, and shares nothing."""
    one, two = map(placed, names[:2])
    (top, y0, h), (other, z0, k) = (one.top, one.state, 0.25 * one.unit), (two.top, two.state, -0.4 * two.unit)
    y = y0.copy()
    stepper = prepared(method, top, y, h)
    last, rows = stepper.advance(y, 50), stepper.record(y, 50, 10)
    yield Verdict("input is not modified", same(y, y0), "bits of y after prepare, advance and record")
    y.flags.writeable = False
    again = (stepper.advance(y, 50), prepared(method, top, y, h).advance(y, 50))
    evidence = "advance twice, and with a second stepper"
    yield Verdict("same input, same bits", all(same(a, last) for a in again), evidence)
    alone = prepared(method, other, z0, k).advance(z0, 50)
    first, second = prepared(method, top, y0, h), prepared(method, other, z0, k)
    turns = [(first.advance(y0, 50), second.advance(z0, 50)) for _ in range(2)]
    shared_nothing = all(same(a, last) and same(b, alone) for a, b in turns)
    yield Verdict("two steppers share nothing", shared_nothing, "two tops in turns, against each alone")
    apart = last is not again[0] and not np.shares_memory(last, again[0]) and not np.shares_memory(last, y0)
    yield Verdict("results are fresh arrays", apart, "memory of two results and of the input")
    shape = rows.shape == (6, len(y0)) and same(rows[0], y0) and rows.dtype == np.float64 and last.shape == y0.shape
    nothing = same(stepper.advance(y0, 0), y0) and same(stepper.record(y0, 0, 1), y0[None])
    yield Verdict("record has the start in row 0", shape and nothing, "shapes and row 0 for 50 and for 0 steps")
    decided = isinstance(getattr(stepper, "from_start", None), bool)
    yield Verdict("from_start is True or False", decided, "an attribute; False in classes that derive from Stepper")
    if method.control == "step":
        ends = (stepper.record(y0, 50, every)[-1] for every in (1, 25, 50))
        yield Verdict("record ends where advance does", all(same(end, last) for end in ends), "bits, every = 1, 25, 50")
        before = stepper.work.steps
        stepper.advance(y0, 7)
        stepper.record(y0, 6, 3)
        yield Verdict("work counts steps", stepper.work.steps == before + 13, "7 steps advanced, 6 recorded")


def extremes(method: Method, quick: bool, names: Starts = ("random001" + NEGATIVE, "generic")) -> Iterator[Verdict]:
    """Any finite state and step give finite numbers, or a StepError that says why."""
    bad: dict[str, list[str]] = {}  # what is wrong → the runs
    runs, raised = 0, []
    for case, top, y0, h in extreme_cases(names):
        runs += 1
        try:
            with np.errstate(all="ignore"):  # the result may be finite after an overflow
                y = prepared(method, top, y0, h).record(y0, 4, 2)
            if not np.all(np.isfinite(y)):
                bad.setdefault(str(y[-1].tolist()), []).append(case)
        except StepError as error:
            raised.append(error)
        except Exception as error:
            bad.setdefault(first_step.describe(error, method, None), []).append(case)
    where = {fault: on[0] if len(on) == 1 else f"{len(on)} of {runs} runs ({on[0]}, …)" for fault, on in bad.items()}
    evidence = "; ".join(f"{on}: {fault}" for fault, on in where.items())
    evidence = evidence or f"{len(raised)} StepErrors, the other runs finite"
    yield Verdict("finite, or a StepError", not bad, evidence, float(sum(map(len, bad.values()))), "0")
    if raised:
        evidence = f"{len(raised)} of them"
        if others := dict.fromkeys(repr(error.method) for error in raised if error.method != method.name):
            evidence = f"StepErrors say {', '.join(others)}, the record says {method.name!r}: "
            evidence += "give FixedStepper, or StepError, the record's name"
        yield Verdict("StepErrors name the method", not others, evidence)
        yield Verdict("StepErrors have a reason", all(error.reason for error in raised), f"{len(raised)} of them")


def extreme_cases(names: Starts) -> Iterator[tuple[str, Any, Array, float]]:
    """A label, a problem, a state and a step: at the first two starts, and of all named tops if these are uniform tops."""
    for start in map(placed, names[:2]):
        top, y0 = start.top, start.state
        momenta = np.zeros(len(y0), dtype=bool)
        momenta[top.system.space.momenta] = True
        for h in (1e-300, -3.0, 30.0):
            yield f"{start.name}, h = {h:g} (own unit)", top, y0, h
        for size in (1e-30, 1e30):
            yield f"{start.name}, |J| = {size:g}", top, np.where(momenta, size * y0, y0), 0.3 / size
    if not kinds.uniform(top):
        return
    for size in (1e-300, 1e-150, 1e-30, 1e30, 1e150, 1e300):
        for kind, y in (("size", size * y0), ("|x|", np.where(momenta, y0, size * y0))):
            yield f"{start.name}, {kind} {size:g}", top, y, 0.3 * top.scales(y)[2]
    for named, span in product(map(placed, TOPS), (0.1, 3.0)):
        yield f"{named.name}, h_scaled = {span}", named.top, named.state, span * named.unit
    yield "at rest without weight", LagrangeTop(0.0), np.array((0.0, 0, 0, 0, 0, 1)), 0.5
    yield "hanging at rest", LagrangeTop(1.0), np.array((0.0, 0, 0, 0, 0, -1)), 0.5


def same(a: Array, b: Array) -> bool:
    """The same bits."""
    return a.shape == b.shape and a.tobytes() == b.tobytes()
