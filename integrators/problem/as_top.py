"""A Hamiltonian |J|²/2 + U(t, x) as a Lagrange top in a potential: what methods with the exact step need.

    U(t, x) = alpha x3 + V(t, x)

alpha is the sum of all constant factors of x3. If V depends on t, its last parameter is t: formulas of V at a fixed time are
then those of any potential, and a kernel puts the time in.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import Tape
from lagrange_bench.integrators.problem.field import Potential
from lagrange_bench.integrators.problem.parts import Part, addends, depends_on
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.system import E3
from lagrange_bench.integrators.problem.top import LagrangeTop


def is_top(parts: tuple[Part, ...], numbers: tuple[float, ...]) -> bool:
    """Whether these parts of H are |J|²/2 and a function of t and x, in the frame of the world."""
    squares = [part for part in parts if part.kind == "square"]
    if len(squares) != 1 or any(part.kind not in ("square", "kick") for part in parts):
        return False
    (square,) = squares
    plain = square.space == E3 and not (square.body or square.timed)
    return plain and bool(square.energy(0.0, 1.0, *(0.0,) * 5, *numbers)[0] == 0.5)


def as_top(name: str, parts: tuple[Part, ...], numbers: tuple[float, ...], start: float | None) -> PerturbedTop:
    """The top in a potential, of parts for which `is_top`.

    start : the time, which is the last parameter of V then; None: V does not depend on t.
    """
    weight, potential = _taken_apart([part for part in parts if part.kind == "kick"], len(numbers))
    alpha = weight(*(0.0,) * 7, *numbers)[0]

    def value(x1: Any, x2: Any, x3: Any, p: Any) -> Any:
        t, given = (0.0, p) if start is None else (p[-1], p[:-1])
        return potential(t, 0.0, 0.0, 0.0, x1, x2, x3, *given)[0]

    parameters = numbers if start is None else (*numbers, start)
    return PerturbedTop(LagrangeTop(float(alpha)), Potential(name, value), parameters)


def _taken_apart(kicks: Sequence[Part], count: int) -> tuple[Program, Program]:
    """alpha and V as programs of (t, y, p)."""
    tape = Tape()
    inputs = [tape.input() for _ in range(7 + count)]
    t, x3, one = inputs[0], inputs[6], tape.constant(1.0)
    alpha = rest = tape.constant(0.0)
    for kick in kicks:
        for weight, core in addends(tape, one, tape.run(kick.energy, *inputs)[0], inputs[1:7]):
            if core.place != x3.place:
                rest = rest + weight * core
                continue
            for factor, change in addends(tape, one, weight, [t]):
                if depends_on(tape, change, {t.place}):
                    rest = rest + factor * change * x3
                else:
                    alpha = alpha + factor * change
    return tape.program((alpha,)), tape.program((rest,))
