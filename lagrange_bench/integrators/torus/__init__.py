"""The exact step of the top: the two-point map, with the λ that makes it a step of time h."""
