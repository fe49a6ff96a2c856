"""The problems: equations, invariants, named tops, units, rigid bodies."""
