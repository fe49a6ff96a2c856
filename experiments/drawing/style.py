"""One look for every figure: what experiments draw with, by one name.

The canvas comes first (`canvas`), then what methods look like (`looks`), then marks and names in panels (`marks`). Each
imports from those before it.
"""

# ruff: noqa: F403  it hands all their names on
from lagrange_bench.experiments.drawing.canvas import *
from lagrange_bench.experiments.drawing.looks import *
from lagrange_bench.experiments.drawing.marks import *
