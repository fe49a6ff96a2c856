"""No request takes more memory than there is: what is too large is refused before it is computed, or fails alone."""

from __future__ import annotations

import json
import re
import sys

import pytest
from faults import HERE, TOY, squares

from lagrange_bench.integrators import memory
from lagrange_bench.runner import engine


@pytest.fixture
def toy(monkeypatch, tmp_path):
    """run(cells) -> Summary; the store is in tmp_path."""
    monkeypatch.syspath_prepend(str(HERE))

    def run(cells):
        monkeypatch.setenv("TOY_CELLS", json.dumps(cells))
        return engine.run([TOY], "quick", tmp_path, 1, show=False)

    return run


@pytest.mark.processes
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the limit does not hold")
def test_a_cell_that_takes_too_much_memory_fails_alone(toy, tmp_path, monkeypatch):
    monkeypatch.setenv(memory.VARIABLE, "0.5")
    summary = toy([{"do": "memory", "GB": 0.1, "i": 1}, {"do": "memory", "GB": 0.6, "i": 2}, *squares(3, facts=True)])
    assert [(cell["i"], error) for _, cell, error in summary.failures] == [
        (2, "MemoryError: more than 0.5 GB; LAGRANGE_BENCH_MEMORY in the environment, in GB, allows more")
    ]
    monkeypatch.setenv(memory.VARIABLE, "0.9")
    assert toy([{"do": "memory", "GB": 0.6, "i": 2}]).failures == []


@pytest.mark.parametrize("text", ["0", "-1", "inf", "nan", "four"])
def test_a_limit_that_makes_no_sense(toy, monkeypatch, text, tmp_path):
    monkeypatch.setenv(memory.VARIABLE, text)
    with pytest.raises(ValueError, match=f"LAGRANGE_BENCH_MEMORY must be a positive number of GB.*got '{text}'"):
        toy(squares(1))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--h", "0.1", "--steps", "1e12", "--every", "1"), r"--steps: 1000000000001 rows take about 1e\+06 GB"),
        (("--h", "0.1", "--steps", "1e12", "--output", "x.csv"), "record fewer states"),
        (("--times", "0:1:1e10"), r"--times: 0:1:1e10: 10000000000 rows take about 1e\+04 GB"),
    ],
)
def test_too_many_states_are_refused_before_they_are_computed(run, monkeypatch, tmp_path, words, named):
    monkeypatch.chdir(tmp_path)
    code, out, err = run("integrate", *words)
    assert (code, out) == (2, "")
    assert re.search(named, err), err
    assert err.count("lagrange-bench: error") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_fits_is_not_refused():
    memory.check(1000, 1000, 0.001, "--steps", "")
    with pytest.raises(
        ValueError, match=r"--steps: 1001 rows take about 0\.001 GB of memory, and there are 0\.001: less"
    ):
        memory.check(1001, 1000, 0.001, "--steps", "less")
    assert memory.available() > 0


def test_too_many_samples_of_a_sweep(run, monkeypatch, tmp_path):
    text = '[[sweep]]\nmethods = ["strang"]\nh = [0.5]\ntime = 50\nsamples = {}\n'
    (tmp_path / "mine.toml").write_text(text.format(10**9))
    code, out, err = run("run", tmp_path / "mine.toml", "--results", tmp_path / "results")
    assert (code, out) == (2, "")
    assert (
        "[[sweep]], samples: 1000000000 rows take about 3e+03 GB of memory, and there are 4: take fewer, or set" in err
    )
    assert not (tmp_path / "results").exists()
