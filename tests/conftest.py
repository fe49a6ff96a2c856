"""What several test files use: a cache folder for heyoka that is not the user's, and the command line in this process."""

import json
import os
import shutil
import signal
import sys
import tempfile
from concurrent.futures import Future
from pathlib import Path

import pytest

from lagrange_bench import __main__ as cli

if "PYTEST_XDIST_WORKER" not in os.environ:  # the processes of pytest-xdist share the folder of their parent
    _folder = tempfile.TemporaryDirectory(prefix="heyoka-")
    os.environ["HEYOKA_CACHE_DIR"] = _folder.name


# pytest shows what differs in an assertion of this file, too
pytest.register_assert_rewrite("tests.test_integrators.paper.tools")

# a shell lets what it starts with & ignore Ctrl-C; tests that press it, and the processes they start, must not
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[1]
KERNELS = Path(__file__).parent / "test_integrators"


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the groups in this hook, too
def pytest_collection_modifyitems(items):
    """A file about integrators is a group: its tests share kernels, which two processes would compile twice.

    Groups come first: each is long, and the last one would keep the other processes waiting.
    """
    for item in items:
        if item.path.parent == KERNELS and item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(item.path.stem))
    items.sort(key=lambda item: item.get_closest_marker("xdist_group") is None)


@pytest.fixture
def tree(tmp_path):
    """A copy of the bench, laid out as a wheel installs it: Python started in this folder imports the copy."""
    ignored = shutil.ignore_patterns("__pycache__", "*.html", "*.svg", "*.jsonl", "local")
    shutil.copytree(ROOT / "lagrange_bench", tmp_path / "lagrange_bench", ignore=ignored)
    return tmp_path


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty current folder whose modules are found, and forgotten afterwards, as are figures that were left open."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        facts = vars(sys.modules[name])
        if str(tmp_path) in f"{facts.get('__file__')} {facts.get('__path__')}":
            del sys.modules[name]
    if "matplotlib" in sys.modules:
        from matplotlib import pyplot

        pyplot.close("all")


@pytest.fixture
def run(capsys):
    """run(*words) -> (exit code, stdout, stderr)."""

    def call(*words):
        code = cli.main([str(word) for word in words])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def answer(run):
    """answer(*words) -> the JSON on stdout of a command that succeeds."""

    def call(*words):
        code, out, err = run(*words, "--json")
        assert code == 0, err
        return json.loads(out)

    return call


@pytest.fixture
def short_races(monkeypatch):
    """What races by the clock stops after a moment."""
    from lagrange_bench.experiments import work_precision

    monkeypatch.setattr(work_precision, "SAMPLE", 2e-4)


@pytest.fixture
def in_process(monkeypatch):
    """Cells are computed in this process: starting others takes longer than most cells."""
    from lagrange_bench.runner import workers

    class Here(workers.Local):
        def submit(self, task):
            future = Future()
            future.set_result(workers.compute(task.experiment, task.cell))
            return future

    monkeypatch.setattr(workers, "Local", Here)
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
