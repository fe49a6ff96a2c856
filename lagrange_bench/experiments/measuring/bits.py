"""Golden bits: do compiled kernels compute the same bits here as on the machine where `golden.json` was written?

Kernels use only + − × ÷ and √, which IEEE 754 rounds correctly, in an order that no compiler may change (no fastmath, no
fused multiply-adds). So a state after ten thousand steps is the same on every machine. The constants of a step come from set-up
code, which may call functions of the C library. If the constants differ, the states differ, too. Methods that call a library in
each step promise no bits and are left out.
"""

import hashlib
import json
import sys
from pathlib import Path

from lagrange_bench.experiments.measuring.states import find
from lagrange_bench.integrators import METHODS, prepare
from lagrange_bench.integrators.compiling.loops import FixedStepper
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.registry import BUILT_IN
from lagrange_bench.support.files import write_file

GOLDEN = Path(__file__).with_name("golden.json")
STATES = ("generic", "figure1", "random000")
STEPS = 10**4  # after which a state is compared
LIBRARY = ("theta_functions",)  # it computes each state with the C library's sines
STEP = 0.125  # in units of the top's time scale

Hashes = dict[str, dict[str, str]]  # method → "state constants" or "state steps" → digest


def measured() -> Hashes:
    """The hashes of the compiled kernels of this package that this process computes."""
    hashes: Hashes = {}
    for name in BUILT_IN:
        method = METHODS[name]
        for state in STATES:
            top, y0 = find(state)
            if method.engine != "numba" or name in LIBRARY or method.takes(top):
                continue
            stepper = prepare(top, y0, STEP * top.scales(y0)[2], method)
            if isinstance(stepper, FixedStepper):
                of_state = {"constants": stepper.constants, f"{STEPS}": stepper.advance(y0, STEPS)}
                hashes.setdefault(name, {}).update({f"{state} {word}": digest(of_state[word]) for word in of_state})
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
    digests = measured()
    write({name: digests[name] for name in sys.argv[1:]})
