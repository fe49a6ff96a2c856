"""The exact solution, and the reference solution for problems without one. They import no method."""
