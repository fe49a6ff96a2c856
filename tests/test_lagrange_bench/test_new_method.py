"""docs/adding-a-method.md, “In this one”, and docs/adding-a-top.md, walked through in a copy of the bench."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = [pytest.mark.processes, pytest.mark.slow]


def bench(tree, *words):
    """Without compiler: little to compute, and all to compile."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-W", "error", "-m", "lagrange_bench", *words, "--json"]
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def edit(path, *changes):
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")


def test_a_method_is_one_file_and_one_line_and_a_top_one_entry(tree):
    integrators = tree / "lagrange_bench" / "integrators"
    shutil.copy(ROOT / "docs" / "example_plugin" / "suzuki_top.py", integrators / "methods" / "suzuki.py")
    compiling = "from lagrange_bench.integrators.compiling"
    imports = f"from lagrange_bench import Method\n{compiling}.compiled import jit as compiled\n"
    imports += f"{compiling}.loops import FixedStepper"
    edit(integrators / "methods" / "suzuki.py", ("from lagrange_bench import FixedStepper, Method, compiled", imports))
    line = '    "suzuki4": "lagrange_bench.integrators.methods.suzuki:METHOD",\n'
    edit(integrators / "registry.py", ("    # integrable\n", f"{line}    # integrable\n"))
    entry = '    NamedTop("lopsided", "lopsided", 0.75, (0.5, 0.0, 1.25, 0.5, 0.0, 1.0), "of this test"),\n'
    edit(integrators / "problem" / "top.py", ("    NamedTop(", f"{entry}    NamedTop("))
    listed = bench(tree, "methods")
    assert [method["available"] for method in listed if method["name"] == "suzuki4"] == [True]
    assert [top["regime"] for top in bench(tree, "tops") if top["name"] == "lopsided"] == ["elliptic"]
    errors = []
    for method in ("backlund", "suzuki4"):
        words = ("integrate", "--method", method, "--top", "lopsided", "--h", "0.1", "--steps", "20")
        errors.append(bench(tree, *words)["error"]["final"])
    assert errors[0] < 1e-14 < errors[1] < 1e-5
