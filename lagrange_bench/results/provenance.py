"""Records where a result comes from: commit, versions, machine, time. Never the name of the host or the user."""

import contextlib
import os
import platform
import re
import subprocess
import tomllib
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path

from lagrange_bench.support import machine

BENCH = "lagrange-bench"
# a result is stored under these versions: if one of them changes, `run` measures again
DECISIVE = ("numpy", "scipy", "numba", "heyoka", "mpmath", BENCH)
PACKAGES = (*DECISIVE, "llvmlite", "pandas", "matplotlib")


def provenance() -> dict[str, object]:
    """The facts as a flat dict. All but the time are looked up once in a process."""
    return {"utc": datetime.now(UTC).isoformat(timespec="seconds"), **_unchanging()}


@cache
def version(package: str) -> str | None:
    """Installed version, None if it is not installed.

    Of the bench in a clone, the version of its sources: it may have been installed at an older one.
    """
    if package == BENCH and (root := checkout()):
        return str(tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"])
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


@cache
def checkout() -> Path | None:
    """The root of the source tree of this package; None if it is an installed wheel."""
    root = Path(__file__).resolve().parents[2]
    project = root / "pyproject.toml"
    ours = project.is_file() and f'name = "{BENCH}"' in project.read_text(encoding="utf-8")
    return root if ours else None


@cache
def _unchanging() -> dict[str, object]:
    commit, dirty = _git_state()
    return {
        "commit": commit,
        "dirty": dirty,
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
        "platform": f"{platform.system()} {platform.machine()}",
        "cpu": _cpu_model(),
        "cores": machine.usable_cores(),
    }


def _git_state() -> tuple[str | None, bool | None]:
    """The commit of the checkout, and whether its files differ from it. Results are not compared: a run writes them."""
    root = checkout()
    if root is None or not (root / ".git").exists():
        return None, None
    commit = _output("git", "-C", str(root), "rev-parse", "--verify", "HEAD")
    changes = _output(
        "git", "-C", str(root), "status", "--porcelain", "--", ".", ":(exclude)lagrange_bench/results/reference"
    )
    return commit, None if changes is None else changes != ""


def _cpu_model() -> str | None:
    with contextlib.suppress(OSError):
        facts = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        if match := re.search(r"^model name\s*:(.*)$", facts, re.MULTILINE):
            return match[1].strip()
    if platform.system() == "Darwin":
        return _output("sysctl", "-n", "machdep.cpu.brand_string")
    return platform.processor() or None


def _output(*command: str) -> str | None:
    """Standard output of a command; None if it is missing, fails or hangs."""
    environment = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}  # looking must not write to the repository
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, env=environment, check=False)
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
