"""A potential V(x) of the axis x, as a user writes it: an ordinary Python function with the names of its parameters.

The function uses + − × ÷, whole and half powers, `sqrt`, `sin`, `cos`, `exp` and `log`. It is recorded once (`compiling.tape`).
So one formula serves floats, mpmath, heyoka and the compiled kernels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from lagrange_bench.integrators.compiling.expression import Program
from lagrange_bench.integrators.compiling.tape import Tape, Term, record_own
from lagrange_bench.integrators.problem.symmetry import random_states, values_at, vanish

SAME = 1e-8  # relative difference between a gradient of the user and the derived one


class Potential:
    """A potential V(x1, x2, x3, p) of the axis x, p a tuple of parameters.

    Parameters
    ----------
    name : str
        Its name in messages and tables.
    value : callable
        (x1, x2, x3, p) → V, in the units of |J|².
    gradient : callable, optional
        (x1, x2, x3, p) → (∂V/∂x1, ∂V/∂x2, ∂V/∂x3). By default it is derived, and otherwise compared with the derived one.
    parameters : sequence of str, optional
        Names of the parameters; by default a top may have any number of them.
    note : str
        The meaning of the potential, in a line.

    Raises
    ------
    ValueError
        An argument of the wrong type. From `formulas` and `PerturbedTop`: a function that is no such formula, a gradient that is
        not V's, or another number of parameters.
    """

    def __init__(
        self,
        name: str,
        value: Callable[..., Any],
        gradient: Callable[..., Any] | None = None,
        *,
        parameters: Sequence[str] | None = None,
        note: str = "",
    ):
        if not isinstance(name, str) or not name:
            raise ValueError(f"name of a potential must be a word; got {name!r}")
        for word, function in (("value", value), ("gradient", gradient)):
            if not callable(function) and not (word == "gradient" and function is None):
                raise ValueError(f"potential {name}: {word} must be a function of (x1, x2, x3, p); got {function!r}")
        self.name, self.value, self.gradient, self.note = name, value, gradient, note
        if parameters is not None:
            listed = isinstance(parameters, Iterable) and not isinstance(parameters, str)
            if not listed or not all(isinstance(word, str) and word for word in parameters):
                raise ValueError(f"potential {name}: parameters must be a sequence of names; got {parameters!r}")
        self.parameters = None if parameters is None else tuple(parameters)
        self._formulas: dict[int, tuple[Program, Program]] = {}

    def __repr__(self) -> str:
        return f"Potential({self.name!r})"

    def __getstate__(self) -> dict[str, Any]:
        # a function from a prompt cannot be pickled, but its recorded formula can
        return {**self.__dict__, "value": None, "gradient": None}

    def formulas(self, count: int) -> tuple[Program, Program]:
        """V and ∇V, the user's or derived, as programs of x and `count` parameters; ValueError as of the class."""
        if self.parameters is not None and count != len(self.parameters):
            names = ", ".join(self.parameters)
            needed = f"{len(self.parameters)} numbers ({names})"
            raise ValueError(f"parameters of the potential {self.name}: {needed}; got {count}")
        if count not in self._formulas:
            value = self._record("value", self.value, count, 1)
            gradient = derived = _gradient(value)
            if self.gradient is not None:
                gradient = self._record("gradient", self.gradient, count, 3)
                x_and_p = random_states(3 + count).T
                ours, theirs = values_at(derived, x_and_p), values_at(gradient, x_and_p)
                if not vanish(ours - theirs, np.hstack((ours, theirs)), SAME):
                    raise ValueError(f"potential {self.name}: gradient is not the derivative of value")
            self._formulas[count] = value, gradient
        return self._formulas[count]

    def _record(self, word: str, function: Callable[..., Any], count: int, outputs: int) -> Program:
        def plain(*numbers: Term) -> tuple[Any, ...]:
            result = function(*numbers[:3], numbers[3:])
            return tuple(result) if outputs > 1 else (result,)

        where = f"potential {self.name}: {word}"
        program = record_own(plain, 3 + count, where, "(x1, x2, x3, p)", f"{count} parameters")
        if len(program.outputs) != outputs:
            raise ValueError(f"potential {self.name}: {word} must return {outputs} numbers; got {len(program.outputs)}")
        return program


def _gradient(V: Program) -> Program:
    """∇V, derived from V."""
    tape = Tape()
    inputs = [tape.input() for _ in range(V.inputs)]
    return tape.program(tape.gradient(tape.run(V, *inputs)[0], inputs[:3]))
