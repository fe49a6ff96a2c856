"""The README says what the committed results say, and its example runs."""

import re
from collections import Counter
from dataclasses import fields

import numpy as np
import pytest

from lagrange_bench.integrators import METHODS, LagrangeTop, Method
from lagrange_bench.integrators.registry import BUILT_IN
from lagrange_bench.report import readme

pytestmark = pytest.mark.xdist_group("claims")  # all are judged once
TEXT = (readme.ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def documents(judged):
    return readme.documents(judged)


def test_claims_in_the_documents_are_those_of_the_reference_run(documents):
    """If this fails: `python -m lagrange_bench.report.readme`, and read what changed."""
    assert len(documents) == 2
    for path, text in documents.items():
        assert text == path.read_text(encoding="utf-8"), path


def test_the_methods_are_counted_and_their_fields_explained():
    methods = [METHODS[name] for name in BUILT_IN]
    needs, text = Counter(method.needs for method in methods), " ".join(TEXT.split())
    compared = [method for method in methods if method.takes(LagrangeTop()) is None]
    any_field = sum(needs[word] for word in ("rhs", "parts", "kinetic", "top", "force"))
    assert f"lists the {len(methods)} methods" in text
    assert f"so {len(compared) - 1} methods are compared there" in text
    assert f"{any_field} methods take any potential, {needs['smooth']} more take smooth ones" in text
    guide = (readme.ROOT / "docs" / "adding-a-method.md").read_text(encoding="utf-8")
    assert [field.name for field in fields(Method) if field.name not in guide] == []


def test_the_picture_shows_the_reference_run(stored, monkeypatch):
    """If this fails: `python -m lagrange_bench.report.readme`, and look at docs/headline.svg."""
    shown = readme.shown(readme.draw(stored))
    assert f'data-shows="{shown}"' in readme.PICTURE.read_text(encoding="utf-8")
    useful = readme.work_precision.useful
    monkeypatch.setattr(readme.work_precision, "useful", lambda rows: useful(rows.assign(seconds=2 * rows.seconds)))
    assert readme.shown(readme.draw(stored)) != shown


def test_the_times_of_a_step_are_those_of_the_reference_run(stored):
    """In prose that nothing writes: if this fails, correct README.md and docs/tutorials/a-long-run.md."""
    rows = stored["cost"]
    found = f"{rows[(rows.part == 'step') & (rows.method == 'backlund')].ns_per_step.min():.0f} ns"
    for page in ("README.md", "docs/tutorials/a-long-run.md"):
        text = (readme.ROOT / page).read_text(encoding="utf-8")
        assert re.findall(r"\d+ ns", text.split("<!-- claims")[0]) == [found], page


def test_the_examples_run_and_are_as_accurate_as_the_text_says(capsys):
    code, field = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    scope = {}
    exec(code, scope)
    run, named = scope["run"], scope["named"]
    assert capsys.readouterr().out.count("[") == 2
    error = run.y[-1] - scope["exact"].solution(named.top, named.state, run.t[-1])
    assert np.max(np.abs(error)) < 1e-9
    exec(field, scope)
    energies = scope["run"].invariants()[:, 0]
    assert np.ptp(energies) < 1e-6
