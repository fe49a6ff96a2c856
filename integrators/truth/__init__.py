"""The exact solution, which imports no method."""
