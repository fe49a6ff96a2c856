"""The README says what the committed results say, its example runs, and it is short."""

import re
from dataclasses import fields, replace

import numpy as np
import pytest

from lagrange_bench.integrators import Method
from lagrange_bench.report import claims, page, readme

pytestmark = pytest.mark.xdist_group("claims")  # all are judged once
TEXT = (readme.ROOT / "README.md").read_text(encoding="utf-8")


def test_claims_in_the_documents_are_those_of_the_reference_run(judged):
    """If this fails: `python -m lagrange_bench.report.readme`, and read what changed."""
    documents = readme.documents(judged)
    assert len(documents) == 3
    for path, text in documents.items():
        assert text == path.read_text(encoding="utf-8"), path


def test_the_fields_of_a_method_are_explained():
    guide = (readme.ROOT / "docs" / "adding-a-method.md").read_text(encoding="utf-8")
    assert [field.name for field in fields(Method) if field.name not in guide] == []


def test_the_picture_shows_what_methods_do_today():
    """If this fails: `python -m lagrange_bench.report.readme`, and look at report/exact-step.svg."""
    shown = readme.shown(readme.draw())
    assert f'data-shows="{shown}"' in readme.PICTURE.read_text(encoding="utf-8")
    assert readme.shown(readme.draw(other="blanes_moan6")) != shown


def test_answers_are_rounded_outwards_and_left_out_where_something_was_not_measured():
    bound = claims.Bound((), "≤", 1.0)
    named = claims.BoundCheck(replace(bound, what="b"))
    verdict = claims.ClaimVerdict((claims.BoundCheck(bound, (0.1234, 9.95e-16)), named))
    answer = claims.ShortAnswer("?", "{claim.least} to {claim.most}, {claim.worst}")
    assert answer.filled(verdict) == "0.12 to 10⁻¹⁵, 10⁻¹⁵"
    assert answer._replace(text="{claim.least} {b.worst}").filled(verdict) is None


def test_the_readme_has_an_answer_to_each_question_and_is_short(judged):
    asked = {answer.question for each in judged if each.verdict.word == "confirmed" for answer in each.claim.answers}
    assert asked <= {question for question, *_ in page.in_brief(judged)}
    assert len(TEXT.split()) <= 900


def test_the_times_of_a_step_are_those_of_the_reference_run(stored):
    """In prose that nothing writes: if this fails, correct README.md and docs/tutorials/a-long-run.md."""
    rows = stored["cost"]
    found = f"{rows[(rows.part == 'step') & (rows.method == 'backlund')].ns_per_step.min():.0f} ns"
    for name in ("README.md", "docs/tutorials/a-long-run.md"):
        text = (readme.ROOT / name).read_text(encoding="utf-8")
        assert re.findall(r"\d+ ns", text.split("<!-- claims")[0]) == [found], name


def test_the_example_runs_and_is_as_accurate_as_the_text_says(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    scope = {}
    exec(code, scope)
    assert len(capsys.readouterr().out.splitlines()) == 2
    run = scope["run"]
    assert (run.t[-1], run.error()[-1] < 1e-9) == (1e6, True)
    assert np.max(np.abs(run.invariants()[-1] - run.invariants()[0])) < 1e-14
