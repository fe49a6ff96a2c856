"""A method of somebody else's package, the one of the documentation: found, checked, measured, and drawn with the others."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "docs" / "example_plugin"

DRAW = """
import json
from matplotlib.text import Text
from experiments import load
from experiments.store import Store, make_record
from report import page, style

store = Store("results")
listed = {}
for name in ("phase", "work_precision"):
    module = load(name)
    listed[name] = [cell for cell in module.cells("quick") if cell.get("method") == "suzuki4"]
    few = [cell for cell in listed[name] if cell.get("part") != "time" and cell.get("span", 100) == 100]
    for position, cell in enumerate(few):
        done = {"status": "done", "rows": module.measure(cell), "error": None, "warnings": [], "seconds": 0.0}
        store.append(make_record(name, module.VERSION, position, cell, **done))
    with style.apply():
        figures = module.draw(store.rows(name))
        texts = {text.get_text() for figure in figures.values() for text in figure.findobj(Text)}
    assert "Suzuki 4" in texts, texts
    assert figures
table = load("phase").tables(store.rows("phase"))["orders"].set_index("state")
report = page.assemble(store.folder)
print(json.dumps({
    "cells": {name: len(cells) for name, cells in listed.items()},
    "order": table.measured["single steps, 8 tops"],
    "colour": style.of("suzuki4")["color"],
    "family": style.family("suzuki4"),
    "fair": report.fairness.methods.set_index("method").engine["suzuki4"],
}))
"""


def install(project: Path, target: Path) -> Path:
    """What `pip install --target` would put there, without pip, build tools or a network."""
    about = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))
    name, version = about["project"]["name"], about["project"]["version"]
    for module in about["tool"]["setuptools"]["py-modules"]:
        shutil.copy(project / f"{module}.py", target)
    info = target / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = [
        line
        for group, entries in about["project"]["entry-points"].items()
        for line in (f"[{group}]", *(f"{key} = {value}" for key, value in entries.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return target


@pytest.fixture
def python(tmp_path):
    """python(*words) in an empty folder, with the example installed: (exit code, stdout, stderr)."""
    (tmp_path / "site").mkdir()
    path = os.pathsep.join((str(install(EXAMPLE, tmp_path / "site")), str(ROOT)))
    environment = {**os.environ, "PYTHONPATH": path}
    (tmp_path / "results").mkdir()

    def call(*words):
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout, done.stderr

    return call


def test_found_and_checked(python):
    code, out, err = python("-m", "experiments", "check", "suzuki4", "--quick", "--json")
    assert code == 0, err
    assert "suzuki4" in out
    code, out, err = python("-m", "experiments", "methods", "--json")
    assert code == 0, err
    (found,) = (method for method in json.loads(out) if method["name"] == "suzuki4")
    assert (found["order"], found["family"], found["available"]) == (4, "splitting", True)


def test_measured_and_drawn(python):
    code, out, err = python("-c", DRAW)
    assert code == 0, err
    said = json.loads(out.splitlines()[-1])
    assert all(said["cells"].values())
    assert said["order"] == pytest.approx(4, abs=0.15)
    assert said["family"] == "splitting"
    assert said["fair"].startswith("compiled")


def test_not_there_unless_installed():
    """The control: without its package the name is unknown."""
    from integrators import METHODS

    assert "suzuki4" not in METHODS


def test_the_documents_name_what_there_is():
    text = (ROOT / "docs" / "adding-a-method.md").read_text(encoding="utf-8")
    from dataclasses import fields

    from integrators.interface import FAMILIES, Method

    for name in (*FAMILIES, *(field.name for field in fields(Method))):
        assert name in text, name
