"""How kernels are compiled, and the loops around them."""
