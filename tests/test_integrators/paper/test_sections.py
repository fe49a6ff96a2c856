"""What `lagrange-bench paper` checks, section by section. The other tests of this folder see what the sections do not."""

import pytest

from lagrange_bench.experiments import paper_sections
from lagrange_bench.integrators import TOPS


@pytest.mark.parametrize("name", paper_sections.SECTIONS)
@pytest.mark.parametrize("top", ["generic", "inverted"])
def test_sections_hold(name, top):
    residuals = paper_sections.SECTIONS[name][1](TOPS[top].top, TOPS[top].state)
    assert {what for what, (found, allowed) in residuals.items() if not found <= allowed} == set()
