"""Every experiment at a tiny size: measured, stored, and drawn from what was stored; and the sections of `paper`."""

from functools import cache
from itertools import pairwise
from tempfile import TemporaryDirectory

import pandas as pd
import pytest
from matplotlib.text import Text

from lagrange_bench.experiments import EXPERIMENTS, perturbed
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.drawing import style, tables
from lagrange_bench.experiments.measuring import reductions, states, timing
from lagrange_bench.integrators import METHODS, available
from lagrange_bench.results.store import Store, clean_rows, make_record
from tests.installed import FOR_TOPS

pytestmark = [pytest.mark.usefixtures("short_races"), pytest.mark.xdist_group("measured")]
each = pytest.mark.parametrize("name", EXPERIMENTS)


SMALL = {"steps": 64, "span": 16.0, "time": 100.0, "longest": 0.01, "repeats": 1, "budget": 1e5}
STATES = ("generic", "random000", "random001", "random002", "random003", "wide000", "weak_tide")


def kinds():
    """A method of every kind the experiments tell apart: family, engine, control. The contract tests see the others."""
    there = {name: method for name, method in FOR_TOPS.items() if available(method)}
    return set(
        {
            (m.family, m.engine, m.control, bool(m.claims.conserves_own)): name for name, m in reversed(there.items())
        }.values()
    )


def tiny(name):
    """A few cells of the quick profile, made small: every part, every kind of method, one or two states."""
    chosen, seen, some = [], {}, kinds()
    if name == "perturbed":  # whose kernels are compiled for it alone
        some &= {"taylor", "rk4", "strang"}
    for cell in load(name).cells("quick"):
        if cell.get("state", "generic") not in STATES and name != "paper":
            continue
        method = cell.get("method")
        if method and method not in some:
            continue
        fields = ("part", "method", "state", "span", "figure", "eps", "variant")
        key = tuple(cell.get(field) for field in fields)
        seen[key] = seen.get(key, 0) + 1
        if seen[key] <= 2:
            chosen.append({**cell, **{k: v for k, v in SMALL.items() if k in cell}})
    return [dict(pairs) for pairs in dict.fromkeys(tuple(cell.items()) for cell in chosen)]


@cache
def rows_of(name):
    """Rows of tiny cells as the store has them; of each eight cells one failed."""
    module, interleave = load(name), timing.interleave
    error = {"type": "StepError", "message": "no", "traceback": ""}
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(timing, "interleave", lambda functions, *_, **__: interleave(functions, 1e-4, repeats=1))
        store = Store(folder)
        for position, cell in enumerate(tiny(name)):
            failed = position % 8 == 7 and cell.get("part") != "headline"
            outcome = {"error": error} if failed else {"rows": clean_rows(cell, module.measure(cell))}
            store.append(make_record(name, module.VERSION, position, cell, **outcome))
        return store.rows(name)


def assert_apart(ax):
    """Numbers below a panel do not cover each other."""
    ticks = [text for text in ax.get_xticklabels() + ax.get_xticklabels(minor=True) if text.get_text()]
    boxes = sorted(map(Text.get_window_extent, ticks if ax.xaxis.get_visible() else ()), key=lambda box: box.x0)
    inside = [box for box in boxes if ax.bbox.x0 <= (box.x0 + box.x1) / 2 <= ax.bbox.x1]
    assert all(left.x1 < right.x0 for left, right in pairwise(inside))


@each
def test_measured_stored_and_drawn(name):
    module, rows = load(name), rows_of(name)
    assert (rows.status == "done").sum() > 0.5 * len(rows)
    with style.apply():
        figures = module.draw(rows)
        assert figures
        for figure in figures.values():
            figure.draw_without_rendering()
            assert figure.caption
            for ax in figure.axes:
                assert_apart(ax)
    for table in module.tables(rows).values():
        assert isinstance(table, pd.DataFrame)
        assert len(table)
        text = tables.latex(tables.flat(table), caption := table.attrs.get("caption", "")).replace(f"% {caption}", "")
        assert not {letter for letter in text if letter > "ÿ"}, "LaTeX does not know these letters"


@each
def test_no_number_is_made_up_where_one_is_missing(name):
    """A table of rows in which every measured number is NaN has no finite error."""
    module, rows = load(name), rows_of(name)
    numbers = {column for names in module.MEASURED.values() for column in names} & set(rows) - {"t", "h", "fraction"}
    spoiled = reductions.with_failures(rows.assign(**dict.fromkeys(numbers, float("nan"))), module.MEASURED)
    for table in module.tables(spoiled).values():
        for column in table:
            if "error" in str(column) and "at most" not in str(column) and table[column].dtype == float:
                assert table[column].isna().all(), column


def test_perturbed_tops_say_who_wins_and_who_loses():
    ours = [(perturbed.OURS, 1e-9, 1.0, 0.5), (perturbed.OURS, 1e-5, 0.25, 0.5)]
    runs = [*ours, ("taylor", 1e-11, 3.0, 0.0), ("rk4", 1e-3, 0.1, 0.0)]
    rows = pd.DataFrame(runs, columns=["method", "error", "seconds", "setup_seconds"])
    rows = rows.assign(part="work", status="done", state="weak_tide", span=1e3)
    table = perturbed.winners(rows).set_index("error at most")
    ratios = table["times as long as the exact step inside"].tolist()
    assert ratios == pytest.approx([4.0, 2.0, 2.0, float("nan")], nan_ok=True)
    assert table.cheapest.tolist() == [perturbed.OURS] * 3 + ["taylor"]
    assert table["best of the others"].tolist() == ["taylor"] * 4
    alone = pd.DataFrame([{"method": "rk4", "status": "done", "part": "tolerance", "answer": "given"}])
    assert "winners" not in perturbed.tables(alone), "of a sweep"
    assert perturbed.draw(alone) == {}


def test_the_command_tells_the_residuals(answer):
    assert len(answer("paper", "separation")["residuals"]) > 5


def test_an_interpreted_method_takes_fewer_steps():
    assert [states.affordable(METHODS["rk45"], 10**7, full) for full in (True, False)] == [20_000, 2_000]
