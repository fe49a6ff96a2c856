"""The top itself: equations, invariants, named tops, units, the whole body."""
