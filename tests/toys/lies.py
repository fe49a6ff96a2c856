"""A method that promises too much: of order five as it says, but not symmetric, and it loses H and C1."""

from installed import in_uniform_fields

from lagrange_bench.integrators import METHODS, Claims

FALSE = Claims(symmetric=True, conserves={"H", "J3", "C1"})
METHOD = in_uniform_fields(METHODS["rk45_fixed"], name="lies", label="a liar", source="a toy", claims=FALSE)
