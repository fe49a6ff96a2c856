"""The README says what the committed results say, and its example runs."""

import re

import numpy as np

from experiments import errata
from experiments.store import Store
from report import readme

TEXT = (readme.ROOT / "README.md").read_text(encoding="utf-8")


def test_claims_in_the_readme_are_those_of_the_reference_run():
    """If this fails: `python -m report.readme`, and read what changed."""
    assert readme.with_claims(TEXT, readme.ROOT / "results" / "reference") == TEXT


def test_the_picture_shows_the_reference_run(monkeypatch):
    """If this fails: `python -m report.readme`, and look at docs/headline.svg."""
    results = readme.ROOT / "results" / "reference"
    shown = readme.shown(readme.draw(results))
    assert f'data-shows="{shown}"' in readme.PICTURE.read_text(encoding="utf-8")
    useful = readme.work_precision.useful
    monkeypatch.setattr(readme.work_precision, "useful", lambda rows: useful(rows.assign(seconds=2 * rows.seconds)))
    assert readme.shown(readme.draw(results)) != shown


def test_the_times_of_a_step_are_those_of_the_reference_run():
    """In prose that nothing writes: if this fails, correct README.md and docs/tutorials/a-long-run.md."""
    rows = Store(readme.ROOT / "results" / "reference").rows("cost")
    found = f"{rows[(rows.part == 'step') & (rows.method == 'backlund')].ns_per_step.min():.0f} ns"
    for page in ("README.md", "docs/tutorials/a-long-run.md"):
        text = (readme.ROOT / page).read_text(encoding="utf-8")
        assert re.findall(r"\d+ ns", text.split("<!-- claims")[0]) == [found], page


def test_no_claim_is_refuted_or_without_data():
    block = TEXT.split(readme.BEGIN)[1].split(readme.END)[0]
    assert "refuted" not in block
    assert "no data" not in block


def test_the_example_runs_and_is_as_accurate_as_said(capsys):
    code = re.search(r"```python\n(.*?)```", TEXT, re.DOTALL)[1]
    scope = {}
    exec(code, scope)
    run, named = scope["run"], scope["named"]
    assert capsys.readouterr().out.count("[") == 2
    error = run.y[-1] - scope["exact"].solution(named.top, named.state, run.t[-1])
    assert np.max(np.abs(error)) < 1e-9


def test_errata_are_counted_as_they_are():
    assert f"corrected: {errata.count(errata.measure())}." in " ".join(TEXT.split())


def test_every_command_of_the_readme_exists():
    from experiments import EXPERIMENTS

    named = set(re.findall(r"python -m experiments\.(\w+)", TEXT)) | set(re.findall(r"lagrange-bench run (\w+)", TEXT))
    assert named <= set(EXPERIMENTS)
    makefile = (readme.ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"(?:`|^ +)make (\w+)", TEXT, re.MULTILINE):
        assert f"\n{target}:" in makefile
