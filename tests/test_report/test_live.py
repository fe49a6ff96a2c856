"""The page in a real browser: no error, no request; the live top computes what Python computes.

Debian's chromium and chromium-driver, without a window.
"""

import json
import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import TOPS, RigidBody, StepError, integrate
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.potentials import TIDE
from lagrange_bench.integrators.truth import exact

pytest.importorskip("selenium")

from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
SWITCHES = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking")
pytestmark = [
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs the packages chromium and chromium-driver"),
    pytest.mark.xdist_group("browser"),
    pytest.mark.processes,
    pytest.mark.slow,
]


@pytest.fixture(scope="session")
def driver(built):
    options = webdriver.ChromeOptions()
    for switch in (*SWITCHES, "--window-size=1280,1000"):
        options.add_argument(switch)
    options.binary_location = CHROMIUM
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.page = built.as_uri()
    yield driver
    driver.quit()


@pytest.fixture
def browser(driver):
    """With the page as it is when it is opened, the live top drawn; afterwards nothing is on its console."""
    driver.get("about:blank")
    driver.get(driver.page)
    driver.execute_script("document.getElementById('live').scrollIntoView()")
    until(driver, lambda b: css(b, "#live").get_attribute("data-ready") == "yes")
    yield driver
    assert driver.get_log("browser") == []


def css(browser, selector):
    return browser.find_element(By.CSS_SELECTOR, selector)


def until(browser, condition):
    WebDriverWait(browser, 60).until(condition)


def move(browser, **controls):
    """Set controls of the live top, and wait until it is drawn."""
    for name, value in controls.items():
        browser.execute_script(
            "const c = document.querySelector(`#live [name=${arguments[0]}]`); c.value = arguments[1];"
            "c.dispatchEvent(new Event('input', {bubbles: true}));",
            name,
            str(value),
        )
    browser.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done));")


SPAN = 20.0  # in time scales of the top; in longer runs near a separatrix an ulp is worth more than 1e-12
LONG = [(name, 0.0, span) for name in TOPS for span in (0.1, 0.7, -0.3, 2.9)]
SHORT = [run for run in LONG if run[2] < 0.5]  # longer steps of these methods amplify round-off
TIDES = [("generic", 1e-2, 0.3), ("fast", 1e-4, 0.3)]
RUNS = [  # method here, runs, its name in Python, options
    *((method, LONG, method, {}) for method in ("backlund", "backlund_paper", "implicit_midpoint")),
    *((method, SHORT, method, {}) for method in ("strang", "rk4")),
    *((method, TIDES, method, {}) for method in ("implicit_midpoint", "strang", "rk4")),
    ("backlund_splitting", TIDES, "backlund_splitting", {"corrector": False, "modified_kick": False}),
    ("truth", TIDES, "taylor", {}),
]


@pytest.mark.parametrize(("method", "runs", "name", "options"), RUNS)
def test_the_browser_computes_what_python_computes(browser, method, runs, name, options):
    """Runs of every named top or in a tide, in the same plain doubles: to 1e-12."""
    script = (
        "const [m, a, y, h, n, k] = arguments; return Top.iterate(Top.stepper(m, a, y, h, k || undefined).step, y, n)"
    )
    compared = 0
    for state, epsilon, span in runs:
        base = TOPS[state]
        top = PerturbedTop(base.top, TIDE, (epsilon, 1.0, 0.0, 0.0)) if epsilon else base.top
        *scales, unit = top.scales(base.state)
        h, n = float(span * unit), round(SPAN / abs(span))
        try:
            expected = integrate(top, base.state, h, n, name, **options).y[-1]
        except StepError:
            continue
        run = (method, base.alpha, list(base.y0), h, n)
        ends = [browser.execute_script(script, *run, k)[n] for k in (epsilon, 1.01 * epsilon)]
        here, elsewhere = np.max(np.abs(np.array(ends) - expected) / np.repeat(scales, 3), axis=1)
        assert here < 1e-12, (state, span)
        assert epsilon == 0.0 or elsewhere > 1e-9, "negative control"
        compared += 1
    assert compared > len(runs) // 2


def test_the_tumbling_body_is_exact_and_turns_over_only_with_gyroscopic_torque(browser):
    script = (
        "const [rule, h, steps] = arguments; let y = Tumble.START;"
        "for (let i = 0; i < steps; i++) y = rule ? Tumble.RULES[rule](y, h) : Tumble.truth(y, h); return y"
    )
    inertia, start, rules = browser.execute_script("return [Tumble.I, Tumble.START, Object.keys(Tumble.RULES)]")
    body = RigidBody(1.0, (0, 0, 0), inertia, gravity=(0, 0, 0))
    y0 = body.state(omega_body=start[:3], rotation=start[3:])
    rotation = body.rotations(exact.enclosure(body, y0, 6.0).midpoints.astype(float)).as_matrix()

    def off(rule, h):
        here = browser.execute_script(script, rule, h, round(6.0 / h))
        return np.max(np.abs(Rotation.from_quat(here[3:], scalar_first=True).as_matrix() - rotation))

    assert off(None, 0.1) < 1e-8
    assert off("RK4", 0.01) < 1e-4
    assert off("three rotations (Strang)", 0.01) < 0.01
    assert [name for name in rules if off(name, 0.01) > 0.3] == ["no gyroscopic torque, a default of games"]
    told = css(browser, "#tumble .told").text
    browser.execute_script("document.querySelector('#tumble [name=rule]').value = 'RK4'")
    browser.execute_script(
        "document.querySelector('#tumble [name=rule]').dispatchEvent(new Event('change', {bubbles: true}))"
    )
    assert css(browser, "#tumble .told").text != told


def test_whatever_is_typed_in_is_drawn_or_refused(browser):
    section = css(browser, "#live")
    for top in ("generic", "weightless", "hanging", "homoclinic", "regular"):
        move(browser, top=top, h=1.5, steps=100)
        assert "axis is off by" in section.text, top
        assert not any(word in section.text for word in ("NaN", "Infinity", "undefined"))
    for typed, answer in (
        ({"alpha": "1e300"}, "too large"),
        ({"alpha": ""}, "six numbers"),
        ({"alpha": "0"}, "off by"),
    ):
        move(browser, top="generic", **typed)
        assert answer in css(browser, "#live .told").text


def test_the_page_requests_nothing_and_the_chooser_leads_to_a_figure(browser, built):
    assert built.stat().st_size < 3.3e6
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    urls = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert {url.partition(":")[0] for url in urls} <= {"file", "data", "blob", "about"}
    answer, field = css(browser, "#choose .answer"), css(browser, "#choose select")
    before = answer.text
    browser.execute_script(
        "arguments[0].selectedIndex = 1; arguments[0].form.dispatchEvent(new Event('change', {bubbles: true}))", field
    )
    assert 'integrate("generic", h=' in before != answer.text
    link = answer.find_element(By.TAG_NAME, "a")
    figure = css(browser, f"#{link.get_attribute('href').partition('#')[2]}")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", link)
    link.click()
    until(browser, lambda _: figure.find_elements(By.TAG_NAME, "svg"))
    assert figure.is_displayed()
