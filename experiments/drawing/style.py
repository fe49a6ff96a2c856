"""One look for every figure: what experiments draw with, by one name.

The canvas comes first (`canvas`), then what methods look like (`looks`), then marks and names in panels (`marks`). Each
imports from those before it.
"""

# ruff: noqa: F401  it hands names on
from lagrange_bench.experiments.drawing.canvas import (
    FAINT,
    INK,
    RC,
    TALLEST,
    TITLE,
    WIDTHS,
    Figure,
    apply,
    few_decades,
    figure,
    finish,
    panels,
    plain,
    title,
    width,
)
from lagrange_bench.experiments.drawing.looks import (
    CONTRAST,
    DASHES,
    FAMILIES,
    FEW,
    OTHERS,
    OWN,
    OWN_DASHES,
    TITLES,
    bold,
    family,
    label,
    looks,
    naming,
    of,
    ordered,
    readable,
    thin,
)
from lagrange_bench.experiments.drawing.marks import (
    STEP,
    TIME,
    by_family,
    failed_label,
    failure_marks,
    label_end,
    label_ends,
    legend_below,
    slope_guide,
    ulp_line,
)
