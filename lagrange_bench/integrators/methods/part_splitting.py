"""Splittings of any Hamiltonian that is a sum of `parts` with closed flows.

A scheme for two flows becomes sweeps through all parts, see `stages_of`. `splitting` prepares these steps for every problem that
is not a top in a fixed potential.

Source: McLachlan, SIAM J. Sci. Comput. 16 (1995) 151.
"""

from collections.abc import Sequence
from functools import cache
from itertools import accumulate, chain, zip_longest
from typing import NamedTuple

import numpy as np

from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import machine_code, tuple_loader
from lagrange_bench.integrators.compiling.loops import CLOCK, FixedStepper, Kernel
from lagrange_bench.integrators.methods.splitting_schemes import SCHEMES, Scheme
from lagrange_bench.integrators.problem.parts import Part
from lagrange_bench.integrators.problem.problem import Problem


class Stage(NamedTuple):
    """A flow of a part: its number, the length of the flow, and the time of the part, both in units of h."""

    part: int
    length: float
    time: float


def stages_of(scheme: Scheme, parts: Sequence[Part]) -> list[Stage]:
    """The flows of one step.

    They are sweeps φ*, φ, φ*, … through all parts, φ* in the opposite order (McLachlan), with t as one more part before the
    first. A scheme that begins with A begins with φ. For two parts the sweeps are the letters of the scheme.
    """
    pairs = zip_longest(scheme.a, scheme.b) if scheme.first == "A" else zip_longest(scheme.b, scheme.a)
    letters = [letter for pair in pairs for letter in pair if letter is not None]
    stages: list[Stage] = []
    t = 0.0

    def flow(part: int, length: float) -> None:
        last = stages[-1] if stages else None
        if last and last.part == part and (last.time == t or not parts[part].timed):
            stages[-1] = last._replace(length=last.length + length)
        else:
            stages.append(Stage(part, length, t))

    for i, weight in enumerate(accumulate(letters[:-1], lambda weight, letter: letter - weight)):
        is_forward = (i % 2 == 0) == (scheme.first == "A")
        t += weight if is_forward else 0.0
        for part in range(len(parts)) if is_forward else reversed(range(len(parts))):
            flow(part, weight)
        t += 0.0 if is_forward else weight
    return stages


# Places of the constants: the time at the start, h, the number of stages. The stages follow, then the parameters.
START, TIME_STEP, STAGES = range(3)


@cache
def kernel_of_parts(parts: tuple[Part, ...]) -> Compiled:
    """One step of any stages, as flows of the parts."""
    timed = any(part.timed for part in parts)

    def flow_of(number: int) -> Compiled:
        program, numbers = machine_code(parts[number].flow), tuple_loader(parts[number].parameters)
        flow_of_others = flow_of(number + 1) if number + 1 < len(parts) else None

        @jit(inline=True)
        def flow(part, s, t, span, c, first):
            if flow_of_others is None or part == number:
                return program((t, *s, span), numbers(c, first))
            return flow_of_others(part, s, t, span, c, first)

        return flow

    flow = flow_of(0)

    @jit(inline=True)
    def step(s, c, counters):
        first = STAGES + 1 + 3 * int(c[STAGES])
        for i in range(STAGES + 1, first, 3):
            t = c[START] + c[TIME_STEP] * (counters[CLOCK] + c[i + 2]) if timed else 0.0
            s = flow(int(c[i]), s, t, c[i + 1], c, first)
        return s

    return step


def prepare_parts(name: str, problem: Problem, h: float) -> FixedStepper:
    """One step of a `Problem` by the flows of its parts."""
    parts, system = problem.parts, problem.system
    stages = [stage._replace(length=stage.length * h) for stage in stages_of(SCHEMES[name], parts)]
    c = np.array((problem.start, h, len(stages), *chain.from_iterable(stages), *problem.numbers))
    step = kernel_of_parts(parts)
    return FixedStepper(name, h, Kernel(step, rhs_per_step=len(stages), timed=system.timed), c, size=system.size)
