"""`lagrange-bench paper`: every section holds at tops of both signs of alpha, and what is wrong is found."""

import pytest

from lagrange_bench.experiments import paper_sections
from lagrange_bench.integrators import TOPS
from lagrange_bench.integrators.paper import one_point, two_point


def missed(name, top):
    shown = paper_sections.show(name, TOPS[top].top, TOPS[top].state)
    assert shown.figure.caption.endswith(".")
    return {what for what, (found, allowed) in shown.residuals.items() if not found <= allowed}


SLOW = ("euler", "discrete")  # seconds each; test_integrators/paper has their formulas, too


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n in SLOW)) for n in paper_sections.SECTIONS]
)
def test_sections_hold(name):
    """At one sign of alpha each, in turn: two of them take a second."""
    top = ("generic", "inverted")[list(paper_sections.SECTIONS).index(name) % 2]
    assert missed(name, top) == set()


def test_what_is_wrong_is_found(monkeypatch):
    right = one_point.real_form
    monkeypatch.setattr(one_point, "real_form", lambda *args: right(*args) * (1 + 1e-9))
    assert "(5.1.11) against (5.1.10)" in missed("one-point", "generic")
    monkeypatch.setattr(two_point, "inverse", lambda top, y, first, second: two_point.explicit(top, y, first, second))
    assert missed("two-point", "generic") == {"the inverse"}


def test_the_command_draws_and_tells_the_residuals(answer, tmp_path):
    path = tmp_path / "picture.svg"
    assert len(answer("paper", "separation", "--output", path)["residuals"]) > 5
    assert path.read_text("utf-8").startswith("<?xml")
