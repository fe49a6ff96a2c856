"""The published results, read, judged and drawn once."""

import pytest

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.report import page
from lagrange_bench.results.store import Store, default_results


@pytest.fixture(scope="session")
def journals():
    return {name: Store(default_results()).open(name) for name in EXPERIMENTS}


@pytest.fixture(scope="session")
def stored(journals):
    return {name: journal.rows() for name, journal in journals.items()}


@pytest.fixture(scope="session")
def judged(stored):
    return page.judge(stored)


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    return page.write(page.assemble(default_results()), tmp_path_factory.mktemp("page"))
