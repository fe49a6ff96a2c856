"""The page in a real browser: no error, no request, tables sort, the live top computes what Python computes.

Debian's chromium and chromium-driver, without a window. Screenshots go where SCREENSHOTS names a folder.
"""

import base64
import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.store import Store
from integrators import TOPS, StepError, integrate
from report import page, readme

selenium = pytest.importorskip("selenium")

from selenium import webdriver  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import WebDriverWait  # noqa: E402

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = [
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs the packages chromium and chromium-driver"),
    pytest.mark.xdist_group("browser"),
]
SWITCHES = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking")
WEBGL = ("--enable-unsafe-swiftshader", "--use-gl=angle", "--use-angle=swiftshader")
HARMLESS = "willReadFrequently"  # advice of the browser about speed, on Plotly's code


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return page.build(readme.ROOT / "results" / "reference", tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def browser(built):
    options = webdriver.ChromeOptions()
    for switch in (*SWITCHES, *WEBGL, "--window-size=1280,1000"):
        options.add_argument(switch)
    options.binary_location = CHROMIUM
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.get(built.as_uri())
    yield driver
    driver.quit()


def look(browser, name):
    folder = os.environ.get("SCREENSHOTS")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        browser.save_screenshot(str(Path(folder) / f"{name}.png"))


def live(browser):
    """The live section, in view and drawn."""
    section = browser.find_element(By.ID, "live")
    browser.execute_script("arguments[0].scrollIntoView()", section)
    WebDriverWait(browser, 60).until(
        lambda b: (
            section.get_attribute("data-ready") == "yes" and b.find_elements(By.CSS_SELECTOR, "#live .sphere canvas")
        )
    )
    return section


def move(browser, name, value):
    browser.execute_script(
        "const c = document.querySelector(`#live [name=${arguments[0]}]`); c.value = arguments[1];"
        "c.dispatchEvent(new Event('input', {bubbles: true}));",
        name, str(value),
    )  # fmt: skip


def frame(browser):
    browser.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done));")


def test_nothing_is_said_on_the_console_and_nothing_requested(browser):
    import json

    live(browser)
    said = [entry for entry in browser.get_log("browser") if HARMLESS not in entry["message"]]
    assert said == []
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    urls = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert urls  # the page itself
    assert {url.partition(":")[0] for url in urls} <= {"file", "data", "blob"}


def test_the_console_is_listened_to(browser):
    """Negative control of the test above."""
    browser.execute_script("setTimeout(() => { throw new Error('made up') })")
    WebDriverWait(browser, 10).until(lambda b: any("made up" in e["message"] for e in b.get_log("browser")))


def test_tables_sort(browser):
    table = next(t for t in browser.find_elements(By.CSS_SELECTOR, "table.sortable") if t.is_displayed())
    button = table.find_element(By.CSS_SELECTOR, "thead button")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", button)

    def column():
        return [row.text for row in table.find_elements(By.CSS_SELECTOR, "tbody td:first-child")]

    button.send_keys(Keys.ENTER)  # the keyboard will do
    up = column()
    button.send_keys(Keys.ENTER)
    down = column()
    assert len(set(up)) > 1
    assert up != down
    assert sorted(up) == sorted(down)
    assert table.find_element(By.CSS_SELECTOR, "th").get_attribute("aria-sort") == "descending"


def test_tables_are_filtered_by_words(browser):
    table = browser.execute_script(
        "return [...document.querySelectorAll('table.sortable')].sort((a, b) => b.rows.length - a.rows.length)[0]"
    )
    browser.execute_script(
        "for (let e = arguments[0]; e; e = e.parentElement) if (e.tagName === 'DETAILS') e.open = true;"
        "arguments[0].closest('.scroll').previousElementSibling.scrollIntoView({block: 'center'});",
        table,
    )
    label = browser.execute_script("return arguments[0].closest('.scroll').previousElementSibling", table)
    field, count = label.find_element(By.TAG_NAME, "input"), label.find_element(By.TAG_NAME, "output")

    def shown():
        rows = "[...arguments[0].tBodies[0].rows].filter(row => row.getClientRects().length).map(row => row.innerText)"
        return browser.execute_script(f"return {rows}", table)

    everything = len(shown())
    assert everything > 20
    field.send_keys("BACKLUND unpinned")
    some = shown()
    assert 0 < len(some) < everything
    assert all("backlund" in row and "unpinned" in row for row in some)
    assert count.text == f"{len(some)} of {everything} rows"
    look(browser, "filter")
    table.find_element(By.CSS_SELECTOR, "thead button").click()  # sorting keeps what is filtered
    assert sorted(shown()) == sorted(some)
    field.send_keys(" nothing-like-this")
    assert shown() == []
    field.send_keys(Keys.CONTROL + "a", Keys.DELETE)
    assert len(shown()) == everything
    assert count.text == ""


def test_figures_are_enlarged_and_put_back_by_keyboard_and_wheel(browser):
    figure = browser.find_element(By.CSS_SELECTOR, "main > figure")
    button = figure.find_element(By.CSS_SELECTOR, "button.enlarge")
    drawn = figure.find_element(By.CSS_SELECTOR, ".card svg")
    browser.execute_script("arguments[0].focus()", button)
    button.send_keys(Keys.ENTER)
    dialog = browser.find_element(By.ID, "zoom")
    assert dialog.is_displayed()
    assert dialog.find_element(By.TAG_NAME, "b").text == "Figure 1."

    def width():
        return dialog.find_element(By.CSS_SELECTOR, ".pane svg").rect["width"]

    fitted = width()
    assert fitted > drawn.rect["width"]
    look(browser, "enlarged")
    active = browser.switch_to.active_element
    active.send_keys("+")
    active.send_keys("+")
    assert width() == pytest.approx(2.25 * fitted, rel=1e-3)
    look(browser, "enlarged-twice")
    active.send_keys("0")
    assert width() == pytest.approx(fitted, rel=1e-3)
    point = browser.execute_script(  # the point under the pointer stays there
        "const p = document.querySelector('#zoom .pane'), s = p.querySelector('svg');"
        "const at = () => { const b = s.getBoundingClientRect(); return [(700 - b.x) / b.width, (500 - b.y) / b.height]; };"
        "const before = at();"
        "p.dispatchEvent(new WheelEvent('wheel', {deltaY: -600, clientX: 700, clientY: 500, cancelable: true}));"
        "return [before, at()];"
    )
    assert width() > 3 * fitted
    assert np.max(np.abs(np.subtract(*point))) < 0.002
    assert browser.execute_script(
        "const ids = [...document.querySelectorAll('[id]')].map(e => e.id); return ids.length === new Set(ids).size"
    )
    browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    assert not dialog.is_displayed()
    assert browser.switch_to.active_element == button
    assert drawn.is_displayed()


def test_rows_are_a_link_away(browser, built, tmp_path):
    browser.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    link = browser.find_element(By.CSS_SELECTOR, "#gaudin a.rows")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", link)
    link.send_keys(Keys.ENTER)
    file = tmp_path / "gaudin.csv"
    WebDriverWait(browser, 20).until(lambda _: file.exists() and file.stat().st_size)
    rows = Store(readme.ROOT / "results" / "reference").rows("gaudin")
    found = pd.read_csv(file)
    assert len(found) == len(rows)
    assert found.error.dropna().tolist() == rows.error.dropna().tolist()


def test_the_first_screen_says_what_the_bench_shows(browser):
    sentences = browser.find_elements(By.CSS_SELECTOR, ".summary li")
    assert len(sentences) == 3
    assert all(any(c.isdigit() for c in sentence.text) for sentence in sentences)
    assert not browser.find_elements(By.CSS_SELECTOR, ".summary .no-data")
    browser.execute_script("scrollTo(0, 0)")
    top = browser.find_element(By.CSS_SELECTOR, "main > figure").rect["y"]
    assert top < 1000, "the figure begins on the first screen"


def test_a_reader_who_hears_the_page_is_told_what_is_drawn(browser):
    figures = browser.find_elements(By.CSS_SELECTOR, "figure .card svg")
    assert all(f.get_attribute("role") == "img" and len(f.get_attribute("aria-label")) > 20 for f in figures)
    unnamed = browser.execute_script(
        "return [...document.querySelectorAll('button, a[href], input, select')].filter(e =>"
        " !(e.textContent.trim() || e.getAttribute('aria-label') || e.labels?.length)).length"
    )
    assert unnamed == 0
    assert browser.execute_script("return document.querySelectorAll('th:not([scope])').length") == 0
    skip = browser.find_element(By.CSS_SELECTOR, "a.skip")
    browser.execute_script("arguments[0].focus()", skip)
    assert skip.rect["x"] >= 0


def test_sliders_move_the_picture(browser):
    section = live(browser)

    def picture():
        frame(browser)
        return section.find_element(By.CSS_SELECTOR, ".pictures").screenshot_as_png

    before, told = picture(), section.find_element(By.CSS_SELECTOR, ".told").text
    assert picture() == before  # it does not move by itself
    move(browser, "h", 0.8)
    assert picture() != before
    assert section.find_element(By.CSS_SELECTOR, ".told").text != told
    assert "nutation" in section.find_element(By.CSS_SELECTOR, '[for="live-h"] output').text
    before = picture()
    move(browser, "steps", 200)
    assert picture() != before
    assert browser.execute_script("return document.getElementById('live').runs[0].states.length") == 201
    move(browser, "top", "figure1")
    assert float(browser.execute_script("return document.querySelector('#live [name=alpha]').value")) == 3.345


def test_the_paper_s_figures_are_a_click_away(browser):
    section = live(browser)
    section.find_element(By.CSS_SELECTOR, '[name="preset"][value="2"]').click()
    frame(browser)
    runs = browser.execute_script(
        "return document.getElementById('live').runs.map(r => [r.name, r.states[r.states.length - 1].n])"
    )
    assert runs == [["free", 4000]]
    look(browser, "figure2")


METHODS = ("backlund", "backlund_paper", "implicit_midpoint", "strang", "rk4")
SPANS = (0.1, 0.7, -0.3, 2.9)
# orbits so close to a separatrix that half an ulp of y0 is worth more than the bound; 1 − k² is far below 1e-3
UNSTABLE = {"near_separatrix": 1e-9, "homoclinic": 0.02, "unstable_sleeping": 0.02}


@pytest.mark.parametrize("method", METHODS)
def test_the_browser_computes_what_python_computes(browser, method):
    """A hundred steps on every named top, in the same plain doubles: to 1e-12 where the orbit allows it."""
    compared = 0
    for name, top in TOPS.items():
        scale = np.repeat(top.top.scales(top.state)[:2], 3)
        for span in SPANS:
            if not method.startswith("backlund") and abs(span) > 0.5:
                continue  # there some of them do not converge, or amplify round-off
            h = float(span * top.top.scales(top.state)[2])
            try:
                expected = integrate(top.top, top.state, h, 100, method).y[-1]
            except StepError:
                continue
            found = browser.execute_script(
                "const [m, a, y, h] = arguments; return Top.iterate(Top.stepper(m, a, y, h).step, y, 100)[100]",
                method, top.alpha, list(top.y0), h,
            )  # fmt: skip
            assert np.max(np.abs(np.array(found) - expected) / scale) < UNSTABLE.get(name, 1e-12), (name, span)
            compared += 1
    assert compared > 25


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_light_and_dark(browser, scheme):
    browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    )
    browser.execute_script("scrollTo(0, 0)")
    frame(browser)
    look(browser, f"page-{scheme}")
    for name in ("drift", "work_precision"):
        browser.execute_script("document.getElementById(arguments[0]).scrollIntoView()", name)
        frame(browser)
        look(browser, f"{name}-{scheme}")
    live(browser)
    frame(browser)
    look(browser, f"live-{scheme}")
    paper = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
    ink = browser.execute_script("return getComputedStyle(document.body).color")
    light = [sum(map(int, colour[4:-1].split(","))) for colour in (paper, ink)]
    assert (light[0] > light[1]) == (scheme == "light")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_on_a_phone_nothing_sticks_out(browser):
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 390, "height": 800, "deviceScaleFactor": 2, "mobile": True}
    )
    frame(browser)
    browser.execute_script("scrollTo(0, 0)")
    frame(browser)
    look(browser, "phone")
    for name in ("claims", "drift"):
        browser.execute_script("document.getElementById(arguments[0]).scrollIntoView()", name)
        frame(browser)
        look(browser, f"phone-{name}")
    width = browser.execute_script("return document.documentElement.scrollWidth")
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert width <= 390


def test_it_prints(browser):
    printed = browser.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    if folder := os.environ.get("SCREENSHOTS"):
        (Path(folder) / "page.pdf").write_bytes(base64.b64decode(printed["data"]))
    assert len(printed["data"]) > 100_000


def test_the_page_is_one_file_of_moderate_size(built):
    assert built.stat().st_size < 8e6
