"""The table of mutations fits the sources: what it replaces is there, once. `make mutants` applies it."""

import pytest
from mutants import ROOT, mutants

TABLE = mutants()


@pytest.mark.parametrize("mutant", TABLE, ids=lambda mutant: mutant["name"])
def test_a_mutation_fits_its_file(mutant):
    assert (ROOT / mutant["file"]).read_text(encoding="utf-8").count(mutant["old"]) == 1
    assert mutant["old"] != mutant["new"]
    files = [ROOT / word.partition("::")[0] for word in mutant["tests"] if word.startswith("tests/")]
    assert files
    assert all(file.exists() for file in files)
