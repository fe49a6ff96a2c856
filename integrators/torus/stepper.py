"""A stepper whose constants hold on one torus, and the check of them."""

from __future__ import annotations

from typing import Any

from lagrange_bench.integrators.compiling.interpreted import at_first_interpreted
from lagrange_bench.integrators.compiling.loops import FixedStepper, finite
from lagrange_bench.integrators.interface import Array, StepError
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus.real_map import NO_TURN, on_torus, turn_rows

Turn = tuple[tuple[float, float], tuple[float, float]]  # cos and sin of an angle, as double-doubles
first_on_torus, first_turn_rows = at_first_interpreted(on_torus), at_first_interpreted(turn_rows)
OFF_TORUS = 4e-11  # distance of an invariant from the prepared torus, in scaled units, that is no longer round-off


class TorusStepper(FixedStepper):
    """A fixed-step kernel whose constants hold on one torus only: other states are refused.

    `turn` is (cos, sin) of a turn about e3 that belongs to each step and commutes with the kernel; it is left to the rows.
    """

    def __init__(self, name: str, h: float, units: Units, *args: Any, turn: Turn = NO_TURN, **kwargs: Any):
        self.units, self.turn = units, turn
        super().__init__(name, h, *args, enter=units.enter, leave=units.leave, **kwargs)

    def enter(self, y: Array) -> Array:
        state = super().enter(y)
        if not first_on_torus(state, self.constants, OFF_TORUS):
            raise StepError(self.name, "the state is not on the torus this step was prepared for", h=self.h)
        return state

    def rows(self, out: Array, every: int) -> Array:
        if self.turn != NO_TURN:
            first_turn_rows(out[1:], *self.turn, every)
        return super().rows(out, every)


def check_constants(name: str, c: Array, h: float | None = None) -> None:
    if not finite(c):
        raise StepError(name, "no Bäcklund parameter within the range of doubles was found", h=h)
