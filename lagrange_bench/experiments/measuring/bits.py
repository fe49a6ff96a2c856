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

Hashes = dict[str, dict[str, str]]  # method → "state constants" or "state steps" → digest


def kernels(only: Iterable[str] | None = None) -> list[str]:
    """The methods with a compiled kernel of this package. only : names of methods."""
    chosen = set(METHODS) if only is None else set(only)
    listed: list[str] = []
    top, y0 = find(STATES[0])
    for name, method, _ in METHODS.each():
        if not method or name in LIBRARY or name not in chosen or method.takes(top):
            continue
        builder = getattr(method.prepare, "func", method.prepare)  # a partial has `func`
        if method.engine != "numba" or not builder.__module__.startswith("lagrange_bench.integrators."):
            continue
        if isinstance(prepare(top, y0, STEP, method), FixedStepper):
            listed.append(name)
    return listed


def measured(last: int = COUNTS[-1], only: Iterable[str] | None = None) -> Hashes:
    """The hashes that this process computes, up to `last` steps."""
    hashes: Hashes = {}
    for method in kernels(only):
        hashes[method] = {}
        for state in STATES:
            top, y = find(state)
            stepper = prepare(top, y, STEP * top.scales(y)[2], method)
            assert isinstance(stepper, FixedStepper)
            hashes[method][f"{state} constants"] = digest(stepper.constants)
            done = 0
            for count in (c for c in COUNTS if c <= last and (state == LONGEST or c < COUNTS[-1])):
                y = stepper.advance(y, count - done)
                done = count
                hashes[method][f"{state} {count}"] = digest(y)
    return hashes


def digest(numbers: Array) -> str:
    return hashlib.sha256(numbers.astype(numbers.dtype.newbyteorder("<")).tobytes()).hexdigest()[:16]


def golden() -> Hashes:
    return json.loads(GOLDEN.read_text(encoding="utf-8"))


def write(hashes: Hashes) -> None:
    """Write hashes into the golden file, in the order of the registry. Hashes of other methods stay."""
    known = {**golden(), **hashes}
    order = [name for name in METHODS if name in known]
    write_file(GOLDEN, json.dumps({name: known[name] for name in order}, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":  # give the names of methods whose bits are new, or were changed on purpose
    hashes = measured(only=sys.argv[1:])
    if unknown := [name for name in sys.argv[1:] if name not in hashes] or hashes == {}:
        sys.exit(f"no kernel of {unknown}: name methods of the bench that are compiled here")
    write(hashes)
