"""Where rows come from, and the commands that compute and draw them again."""

from types import ModuleType

import pandas as pd
import pytest

from lagrange_bench.report import origin
from lagrange_bench.report.origin import Origin
from lagrange_bench.results import store


def test_machines_and_commits_are_named_if_they_are_few():
    cells = pd.DataFrame(
        {"utc": "2026-11-21T00:00:00", "cpu": "EPYC", "commit": list("abc"), "dirty": [False, True, None]}
    )
    for source, count, line in (
        (Origin("r"), 3, "r; 2026-11-21; EPYC; 3 commits"),
        (origin.PUBLISHED, 2, "results/reference; full profile; 2026-11-21; EPYC; commit a, b with changes"),
        (Origin("r"), 0, "r"),
    ):
        assert origin.described(source, [cells[:count]]) == line


def test_the_profile_is_known_by_the_cells():
    module = ModuleType("study")
    module.cells = lambda profile: [{"h": h} for h in ((0.1, 1.0) if profile == "quick" else (0.01, 0.1))]
    for h, known in ((0.1, ("quick", "full")), (1.0, ("quick",)), (0.01, ("full",)), (7.0, ())):
        assert origin.profiles_of(module, [{"cell": store.clean({"h": h})}]) == known
    del module.cells
    assert origin.profiles_of(module, []) is None


@pytest.mark.parametrize(
    ("folder", "profiles", "profile"),
    [
        ("out", [("quick", "full"), ("full",), None], "full"),
        ("out", [("quick", "full")], "quick"),  # the same cells
        ("full", [("quick", "full")], "full"),
        ("full", [("quick",)], "quick"),
        ("quick", [None], "quick"),
        ("out", [None], None),
        ("out", [("quick",), ("full",)], None),
    ],
)
def test_the_profile_of_a_folder(tmp_path, monkeypatch, folder, profiles, profile):
    monkeypatch.chdir(tmp_path)
    assert origin.find(tmp_path / folder, profiles) == Origin(folder, profile)


def test_commands_of_the_usual_folders_are_short():
    reference = origin.find(store.default_results(), [()])
    assert (reference.option, reference.run("phase")) == ("", "lagrange-bench run phase --profile full")
    assert reference.report == "lagrange-bench report --results results/local/full"
    quick = origin.find(store.default_results("quick"), [("quick",)])
    assert quick.run("phase") == "lagrange-bench run phase --profile quick"
    assert quick.report == "lagrange-bench report --results results/local/quick"
    sweep = origin.find(store.default_results("mine"), [None])
    assert sweep.run("sweep_mine") == "lagrange-bench run mine.toml"
    assert Origin("my out").run("sweep_mine") == "lagrange-bench run mine.toml --results 'my out'"
