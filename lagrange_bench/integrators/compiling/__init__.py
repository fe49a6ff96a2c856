"""Compiles kernels, and holds the loops around them."""
