"""The README says what the committed results say, and its example runs."""

import re

import numpy as np
import pytest

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
