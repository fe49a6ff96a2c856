"""Where rows come from, and the commands that compute and draw them again."""

from types import ModuleType

from lagrange_bench.report import origin
from lagrange_bench.report.origin import Origin
from lagrange_bench.results import store


def test_the_profile_is_known_by_the_cells_and_a_sweep_by_its_file():
    module = ModuleType("study")
    module.cells = lambda profile: [{"h": h} for h in ((0.1, 1.0) if profile == "quick" else (0.01, 0.1))]
    for h, known in ((0.1, ("quick", "full")), (1.0, ("quick",)), (0.01, ("full",)), (7.0, ())):
        assert origin.profiles_of(module, [{"cell": store.clean({"h": h})}]) == known
    assert Origin("my out").run("sweep_mine") == "lagrange-bench run mine.toml --results 'my out'"
    del module.cells
    assert origin.profiles_of(module, []) is None


def test_the_profile_of_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    both, full, quick = ("quick", "full"), ("full",), ("quick",)
    for folder, profiles, profile in (
        ("out", [both, full, None], "full"),
        ("out", [both], "quick"),  # the same cells
        ("full", [both], "full"),
        ("full", [quick], "quick"),
        ("quick", [None], "quick"),
        ("out", [quick, full], None),
    ):
        assert origin.find(tmp_path / folder, profiles) == Origin(folder, profile)
