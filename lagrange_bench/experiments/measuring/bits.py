"""Golden bits: do compiled kernels compute the same bits here as on the machine where `golden.json` was written?

Kernels use only + − × ÷ and √, which IEEE 754 rounds correctly, in an order that no compiler may change (no fastmath, no
fused multiply-adds). So a state after a million steps is the same on every machine. The constants of a step come from set-up
code, which may call functions of the C library. If the constants differ, the states differ, too. Methods that call a library in
each step promise no bits and are left out.
"""

import hashlib
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators import METHODS, prepare
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.interface import Array
from lagrange_bench.support.files import write_file

GOLDEN = Path(__file__).with_name("golden.json")
STATES = ("generic", "figure1", "random000")
COUNTS = (10**3, 10**4, 10**5, 10**6)  # steps after which a state is compared
LONGEST = STATES[0]  # only this run goes on to the last count
LIBRARY = ("theta_functions",)  # it computes each state with the C library's sines
STEP = 0.125  # in units of the top's time scale

Hashes = dict[str, dict[str, str]]  # "method" or "method compensated" → "state constants" or "state steps" → digest


def kernels(only: Iterable[str] | None = None) -> list[tuple[str, str, dict[str, Any]]]:
    """(name, method, options) of this package's compiled kernels, plain and compensated. only : names of kernels or methods."""
    chosen = set(METHODS) if only is None else set(only)
    listed: list[tuple[str, str, dict[str, Any]]] = []
    top, y0 = find(STATES[0])
    for name, method, _ in METHODS.each():
        if not method or name in LIBRARY or chosen.isdisjoint((name, f"{name} compensated")) or method.takes(top):
            continue
        builder = getattr(method.prepare, "func", method.prepare)  # a partial has `func`
        if method.engine != "numba" or not builder.__module__.startswith("lagrange_bench.integrators."):
            continue
        if isinstance(prepare(top, y0, STEP, method), FixedStepper):
            listed.append((name, name, {}))
            if "compensated" in method.options:
                listed.append((f"{name} compensated", name, {"compensated": True}))
    return [kernel for kernel in listed if not chosen.isdisjoint(kernel[:2])]


def measured(last: int = COUNTS[-1], only: Iterable[str] | None = None) -> Hashes:
    """The hashes that this process computes, up to `last` steps."""
    hashes: Hashes = {}
    for kernel, method, options in kernels(only):
        hashes[kernel] = {}
        for state in STATES:
            top, y = find(state)
            stepper = prepare(top, y, STEP * top.scales(y)[2], method, **options)
            assert isinstance(stepper, FixedStepper)
            hashes[kernel][f"{state} constants"] = digest(stepper.constants)
            done = 0
            for count in (c for c in COUNTS if c <= last and (state == LONGEST or c < COUNTS[-1])):
                y = stepper.advance(y, count - done)
                done = count
                hashes[kernel][f"{state} {count}"] = digest(y)
    return hashes


def digest(numbers: Array) -> str:
    return hashlib.sha256(numbers.astype(numbers.dtype.newbyteorder("<")).tobytes()).hexdigest()[:16]


def golden() -> Hashes:
    return json.loads(GOLDEN.read_text(encoding="utf-8"))


def write(hashes: Hashes) -> None:
    """Write hashes into the golden file, in the order of the registry. Hashes of other kernels stay."""
    known = {**golden(), **hashes}
    order = [name for method in METHODS for name in (method, f"{method} compensated") if name in known]
    write_file(GOLDEN, json.dumps({name: known[name] for name in order}, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":  # give the names of methods whose bits are new, or were changed on purpose
    hashes = measured(only=sys.argv[1:])
    if unknown := [name for name in sys.argv[1:] if name not in hashes] or hashes == {}:
        sys.exit(f"no kernel of {unknown}: name methods of the bench that are compiled here")
    write(hashes)
