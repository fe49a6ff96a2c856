"""What a formula shows of a problem, and what random states refute.

A tape shows that a function is affine if no derivative of it depends on the state, and that it keeps J3 if x1 and x2 do not
occur in it. The numbers of its parameters are put in first, so that a term times 0 is none. If in doubt, the answer is no.

What a user says of a problem, such as that a function is conserved, is believed unless it fails at one of `STATES` random states.
"""

from collections.abc import Sequence

import numpy as np

from lagrange_bench.integrators.checks import Array
from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import Tape
from lagrange_bench.integrators.problem.system import depends

STATES = 128
# a difference that is smaller than this part of its terms is round-off
SAME = 1e-12


def are_affine(program: Program, numbers: Sequence[float]) -> tuple[bool, ...]:
    """Whether each output is an affine function of all inputs but the last ones, the parameters, which are `numbers`."""
    tape = Tape()
    inputs = [tape.input() for _ in range(program.inputs - len(numbers))]
    direction = [tape.input() for _ in inputs]
    slopes = tape.along(tape.run(program, *inputs, *numbers), inputs, direction)
    places = {term.place for term in inputs}
    return tuple(places.isdisjoint(tape.needed([slope])) for slope in slopes)


def is_of_height(potential: Program, numbers: Sequence[float]) -> bool:
    """Whether V(x, p) with p = `numbers` depends on x3 only."""
    tape = Tape()
    x = [tape.input() for _ in range(3)]
    return not depends(tape.program(tape.run(potential, *x, *numbers)), [0, 1])


def random_states(size: int) -> Array:
    """STATES rows of `size` random numbers, of lengths from about 0.1 to 3."""
    draw = np.random.default_rng(1)
    return draw.normal(size=(STATES, size)) * 10.0 ** draw.uniform(-1.0, 0.5, size=(STATES, 1))


def vanish(values: Array, terms: Array, least: float = SAME) -> bool:
    """Whether no finite row of `values` (N, k) is longer than round-off of `terms` (N, m), and some row is finite."""
    lengths, sizes = np.linalg.norm(values, axis=1), np.linalg.norm(terms, axis=1)
    good = np.isfinite(lengths) & np.isfinite(sizes)
    return bool(good.any() and np.all(lengths[good] <= least * sizes[good]))
