"""`lagrange-bench case`: the list of the named cases, and their motion as a file for any other program."""

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lagrange_bench.integrators import CASES

REFERENCE = Path(__file__).parents[2] / "docs" / "cases"


def test_the_list(run, answer):
    code, out, _ = run("case", "--verbose")
    assert code == 0
    for name, case in CASES.items():
        assert name in out
        assert case.source in out
    assert {row["name"] for row in answer("case")} == set(CASES)


def test_a_file_of_doubles(run, tmp_path):
    """17 digits make the doubles again; pandas reads it; the times are the decimals that were asked for."""
    path = tmp_path / "ref.csv"
    assert run("case", "bruels", "--until", "2", "--every", "0.1", "--output", str(path))[0] == 0
    table = pd.read_csv(path, comment="#")
    assert table["t"].tolist() == [k / 10 for k in range(21)]
    assert np.array_equal(table.to_numpy(), CASES["bruels"].doubles(table["t"].to_numpy()))
    header = path.read_text("utf-8").splitlines()[:6]
    assert all(line.startswith("# ") for line in header[:5])
    assert header[5].startswith("t,x,y,z,qw,qx,qy,qz,r11,")


@pytest.mark.parametrize("name", CASES)
def test_the_reference_files(name, run):
    """Their first rows again, to the last of 25 digits; their checksums."""
    text = (REFERENCE / f"{name}.csv").read_bytes()
    assert (
        f"{hashlib.sha256(text).hexdigest()}  {name}.csv" in (REFERENCE / "SHA256SUMS").read_text("utf-8").splitlines()
    )
    lines = text.decode().splitlines()
    code, out, _ = run("case", name, "--until", lines[8].split(",")[0], "--digits", "25")
    assert code == 0
    assert out.splitlines() == lines[:9]
    assert len(lines) == 27
