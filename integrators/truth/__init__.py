"""The exact solution, and the reference solution where there is none. They import no method."""
