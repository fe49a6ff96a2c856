"""The published results, read, judged and drawn once; and a headless Chromium with their page."""

import pytest

from lagrange_bench.experiments import EXPERIMENTS
from lagrange_bench.report import page
from lagrange_bench.results.store import Store, default_results

SWITCHES = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking")


@pytest.fixture(scope="session")
def journals():
    return {name: Store(default_results()).open(name) for name in EXPERIMENTS}


@pytest.fixture(scope="session")
def stored(journals):
    """The rows of each experiment."""
    return {name: journal.rows() for name, journal in journals.items()}


@pytest.fixture(scope="session")
def judged(stored):
    return page.judge(stored)


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    return page.write(page.assemble(default_results()), tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="session")
def browser(built):
    from browsing import CHROMIUM, DRIVER
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    for switch in (*SWITCHES, "--window-size=1280,1000"):
        options.add_argument(switch)
    options.binary_location = CHROMIUM
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.set_script_timeout(300)  # axe takes more than the 30 s of the default beside busy loops
    driver.page = built.as_uri()
    driver.get(driver.page)
    yield driver
    driver.quit()
