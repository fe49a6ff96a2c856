"""docs/adding-a-method.md, “In this one”, and docs/adding-a-top.md, walked through in a copy of the bench."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.processes


def bench(tree, *words, **settings):
    environment = {**os.environ, "PYTHONPATH": str(tree), **settings}
    command = [sys.executable, "-W", "error", "-m", "lagrange_bench", *words, "--json"]
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    return done.returncode, json.loads(done.stdout) if done.stdout else done.stderr


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_a_method_is_one_file_and_one_line(tree):
    file = tree / "lagrange_bench" / "integrators" / "methods" / "suzuki.py"
    shutil.copy(ROOT / "docs" / "example_plugin" / "suzuki_top.py", file)
    compiling = "from lagrange_bench.integrators.compiling"
    imports = f"{compiling}.compiled import jit as compiled\n{compiling}.loops import FixedStepper"
    edit(
        file,
        "from lagrange_bench import FixedStepper, Method, compiled",
        f"from lagrange_bench import Method\n{imports}",
    )
    code, message = bench(tree, "check", "suzuki4", "--quick")
    assert code == 2, "negative control: without the line nobody knows it"
    edit(
        tree / "lagrange_bench" / "integrators" / "registry.py",
        "    # integrable\n",
        '    "suzuki4": "lagrange_bench.integrators.methods.suzuki:METHOD",\n    # integrable\n',
    )
    code, found = bench(tree, "check", "suzuki4", "--quick")
    assert (code, found["passed"]) == (0, True)
    golden = tree / "lagrange_bench" / "experiments" / "measuring" / "golden.json"
    before = json.loads(golden.read_text())
    assert bench(tree, "bits", "suzuki4", "--quick")[1]["verdicts"][0]["passed"] is None
    assert bench(tree, "bits", "suzuki4", "--write")[0] == 0
    after = json.loads(golden.read_text())
    assert {name: hashes for name, hashes in after.items() if name != "suzuki4"} == before
    assert bench(tree, "bits", "suzuki4", "--quick")[1]["verdicts"][0]["passed"] is True
    code, listed = bench(tree, "methods")
    assert [method["available"] for method in listed if method["name"] == "suzuki4"] == [True]


def test_a_top_is_one_entry(tree):
    entry = '    NamedTop("lopsided", "lopsided", 0.75, (0.5, 0.0, 1.25, 0.5, 0.0, 1.0), "of this test"),\n'
    path = tree / "lagrange_bench" / "integrators" / "problem" / "top.py"
    text = path.read_text(encoding="utf-8")
    place = text.index("    NamedTop(")
    path.write_text(text[:place] + entry + text[place:], encoding="utf-8")
    code, listed = bench(tree, "tops", NUMBA_DISABLE_JIT="1")  # little to compute, and all to compile
    assert code == 0
    assert [top["regime"] for top in listed if top["name"] == "lopsided"] == ["elliptic"]
    code, found = bench(tree, "integrate", "--top", "lopsided", "--h", "0.5", "--steps", "100", NUMBA_DISABLE_JIT="1")
    assert code == 0
    assert found["error"]["final"] < 1e-13
