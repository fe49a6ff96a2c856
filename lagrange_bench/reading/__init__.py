"""Trajectories that any program wrote: which columns are what (`survey`), and their numbers in SI units (`blocks`).

`names` is the grammar of names and units, `rows` finds the rows in files of many kinds, `layout` and `values` are the two steps.
"""

from lagrange_bench.reading.layout import Layout as Layout
from lagrange_bench.reading.layout import Options as Options
from lagrange_bench.reading.layout import survey as survey
from lagrange_bench.reading.values import blocks as blocks
