"""The exact step: the two-point map with the parameter of the torus."""
