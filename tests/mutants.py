"""Which mistakes the tests see: `make mutants`, or python tests/mutants.py [NAME …].

Each mutation of `mutants.toml` is one wrong line. It is applied to a copy of the repository, the tests that it names are
run there, and at least one of them must fail. Exit status 1 if fewer than 95 % of the mutations are killed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from time import perf_counter
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("integrators", "experiments", "results", "report")
LIMIT = 900  # s for the tests of one mutation; a kernel that never ends is seen, too
ENOUGH = 0.95
KILLED, SURVIVED = 1, 0  # exit codes of pytest


def mutants() -> list[dict[str, Any]]:
    """The table."""
    return tomllib.loads((ROOT / "tests" / "mutants.toml").read_text(encoding="utf-8"))["mutant"]


def copy(folder: Path) -> Path:
    """The repository, with its rooms inside the package: Python started with this folder on its path imports the copy."""
    ignored = shutil.ignore_patterns(".*", "build", "dist", "__pycache__", "*.egg-info", "local")
    home = folder / "bench"
    shutil.copytree(ROOT, home, ignore=ignored)
    for room in ROOMS:
        (home / "lagrange_bench" / room).symlink_to(home / room)
    return home


def tested(home: Path, tests: list[str]) -> int:
    """The exit code of pytest; KILLED if the tests do not end."""
    settings = {**os.environ, "PYTHONPATH": str(home), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        return subprocess.run(
            command, cwd=home, env=settings, capture_output=True, timeout=LIMIT, check=False
        ).returncode
    except subprocess.TimeoutExpired:
        return KILLED


def main(names: list[str]) -> int:
    table = [mutant for mutant in mutants() if not names or mutant["name"] in names]
    if not table:
        sys.exit(f"no mutation is called {' or '.join(names)}: see tests/mutants.toml")
    survivors, broken = [], []
    with tempfile.TemporaryDirectory() as folder:
        home = copy(Path(folder))
        for number, mutant in enumerate(table, 1):
            path = home / mutant["file"]
            source, start = path.read_text(encoding="utf-8"), perf_counter()
            path.write_text(source.replace(mutant["old"], mutant["new"]), encoding="utf-8")
            code = tested(home, mutant["tests"])
            path.write_text(source, encoding="utf-8")
            word = {KILLED: "killed", SURVIVED: "SURVIVED"}.get(code, f"BROKEN: pytest ended with {code}")
            print(f"{number}/{len(table)} {word}: {mutant['name']} ({perf_counter() - start:.0f} s)", flush=True)
            if code == SURVIVED:
                survivors.append(mutant["name"])
            elif code != KILLED:
                broken.append(mutant["name"])
    killed = len(table) - len(survivors) - len(broken)
    print(f"{killed} of {len(table)} mutations killed, {len(survivors)} survived, {len(broken)} not tested")
    return 0 if not broken and killed >= ENOUGH * len(table) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
