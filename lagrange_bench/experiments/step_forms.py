"""The ways to write the exact Bäcklund step that `drift` compares, and columns of its rows.

In exact arithmetic all forms are the same map; only rounding differs.
"""

import math
from collections.abc import Callable
from typing import Any

from lagrange_bench.integrators import prepare
from lagrange_bench.integrators.compiling.loops import NEVER, FixedStepper
from lagrange_bench.integrators.interface import Array
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus import real_map
from lagrange_bench.integrators.torus.real_map import ETA, R

OWN = "kept: "  # before the name of a quantity that a method itself conserves: its column
FORM_INVARIANTS = ("H", "C1", "C2")  # whose errors are measured for each form


class FormStepper(real_map.TorusStepper):
    """A stepper that also takes states off its torus, because some forms drift away from it."""

    def enter(self, y: Array) -> Array:
        return self.units.enter(y)


def exact_map(kernel: Callable[..., Any], pin: int = 0) -> Callable[..., FixedStepper]:
    """A builder of steppers with exact λ(h) and this kernel. pin : steps between two corrections of the invariants; 0: none."""

    def build(top, y0, h):
        units = Units(top, y0, h)
        state = units.enter(y0)
        c, turn = real_map.exact_constants(units.alpha, tuple(state), units.time(h))
        back, block = (real_map.restore_invariants, pin) if pin else (None, NEVER)
        return FormStepper("form", h, units, c, kernel, back, block, turn=turn)

    return build


def program(top, y0, h):
    """A stepper of the paper's program, with the exact λ(h)."""
    units = Units(top, y0, h)
    c, _ = real_map.exact_constants(units.alpha, tuple(units.enter(y0)), units.time(h))
    shift = units.length - units.rate
    return prepare(top, y0, h, "backlund_textbook", lam=complex(math.ldexp(c[R], shift), math.ldexp(c[ETA], shift)))


PROGRAM = "paper's program"
FORMS: dict[str, Callable[..., Any]] = {
    PROGRAM: program,
    "increments": exact_map(real_map.step),
    "x turned": exact_map(real_map.turning_step),
    "compensated": exact_map(real_map.compensated_step),
    "pinned, every 1024": exact_map(real_map.step, 1024),
    "pinned, every 64": exact_map(real_map.step, 64),
    "pinned, every 8": exact_map(real_map.step, 8),
    "pinned, every step": exact_map(real_map.step, 1),
}
