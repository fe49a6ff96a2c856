"""One look for every figure: all drawing tools of the experiments in one module.

The canvas comes first (`canvas`), then the looks of methods (`looks`), then marks and names in panels (`marks`). Each imports
from those before it.
"""

# ruff: noqa: F403  it passes all their names on
from lagrange_bench.experiments.drawing.canvas import *
from lagrange_bench.experiments.drawing.looks import *
from lagrange_bench.experiments.drawing.marks import *
