"""Which mistakes the tests see: `make mutants`, or python tests/mutants.py [NAME …].

Each mutation of `mutants.toml` is one wrong line. The tests that it names are run on a copy of the repository, as `make test`
runs them, first without the mutation, where all must pass, and then with it, where at least one must fail, must not end,
or cannot be collected. Exit status 1 if fewer than 95 % of the mutations are killed, or if one could not be tested.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import threading
import tomllib
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 900  # s for the tests of one mutation: without it they take less, so a kernel that never ends is seen
ENOUGH = 0.95
PASSED, FAILED, NOT_COLLECTED, NO_TESTS = 0, 1, 2, 5  # exit codes of pytest


def mutants() -> list[dict[str, Any]]:
    """The table."""
    return tomllib.loads((ROOT / "tests" / "mutants.toml").read_text(encoding="utf-8"))["mutant"]


def copy(folder: Path) -> Path:
    """The repository: Python started with this folder on its path imports the copy."""
    ignored = shutil.ignore_patterns(".*", "build", "dist", "__pycache__", "*.egg-info", "local")
    home = folder / "bench"
    shutil.copytree(ROOT, home, ignore=ignored, symlinks=True)
    return home


def tested(home: Path, tests: Iterable[str]) -> int:
    """The exit code of pytest; FAILED if the tests do not end."""
    settings = {**os.environ, "PYTHONPATH": str(home), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests, "-m"]
    codes = []
    for marks, more in (("interpreted", {"NUMBA_DISABLE_JIT": "1"}), ("not interpreted", {})):
        words, environment = [*command, f"{marks} and not slow"], {**settings, **more}
        try:
            done = subprocess.run(words, cwd=home, env=environment, capture_output=True, timeout=LIMIT, check=False)
        except subprocess.TimeoutExpired:
            return FAILED
        codes.append(done.returncode)
        if done.returncode not in (PASSED, NO_TESTS):
            return done.returncode
    return PASSED if PASSED in codes else NO_TESTS


def outcome(home: Path, mutant: dict[str, Any], passing: dict[tuple[str, ...], bool]) -> str:
    """What became of one mutation: "killed", "SURVIVED", or why it was not tested. passing : tests that pass without one."""
    path, tests = home / mutant["file"], tuple(mutant["tests"])
    source = path.read_text(encoding="utf-8")
    if source.count(mutant["old"]) != 1:
        return "NOT TESTED, its line is not in the file once"
    if tests not in passing:
        passing[tests] = tested(home, tests) == PASSED
    if not passing[tests]:
        return "NOT TESTED, its tests fail without it"
    path.write_text(source.replace(mutant["old"], mutant["new"]), encoding="utf-8")
    try:
        code = tested(home, tests)
    finally:
        path.write_text(source, encoding="utf-8")
    words = {FAILED: "killed", NOT_COLLECTED: "killed", PASSED: "SURVIVED"}
    return words.get(code, f"NOT TESTED, pytest ended with {code}")


def main(names: list[str]) -> int:
    table = [mutant for mutant in mutants() if not names or mutant["name"] in names]
    if not table:
        sys.exit(f"no mutation is called {' or '.join(names)}: see tests/mutants.toml")
    words, passing, local = Counter[str](), dict[tuple[str, ...], bool](), threading.local()

    def one(mutant: dict[str, Any]) -> str:
        if not hasattr(local, "home"):  # each thread has a copy
            local.home = copy(Path(tempfile.mkdtemp(dir=folder)))
        return outcome(local.home, mutant, passing)

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
        for number, (mutant, word) in enumerate(zip(table, pool.map(one, table), strict=True), 1):
            words[word] += 1
            print(f"{number}/{len(table)} {word}: {mutant['name']}", flush=True)
    killed, survived = words["killed"], words["SURVIVED"]
    print(f"{killed} of {len(table)} killed, {survived} survived, {len(table) - killed - survived} not tested")
    return 0 if killed + survived == len(table) and killed >= ENOUGH * len(table) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
