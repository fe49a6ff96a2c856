"""Runs the cells of experiments, here or on a cluster, and stores each as it is finished.

Every process that computes rows imports this package, so its modules are read as `imported` says. A program
that only uses the library gets no import hook.
"""

from lagrange_bench.integrators import imported

imported.install()
