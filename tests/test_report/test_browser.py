"""The page in a real browser: no error, no request, tables sort, the live top computes what Python computes; with fingers,
keys, on paper and in the dark.

Debian's chromium and chromium-driver, without a window. Screenshots go where SCREENSHOTS names a folder.
"""

import base64
import os
import re
import shutil
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from integrators import TOPS, StepError, integrate, registry
from integrators.problem.perturbed import PerturbedTop
from integrators.problem.potentials import TIDE
from report import page, readme
from results.store import Store

selenium = pytest.importorskip("selenium")

from selenium import webdriver  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import WebDriverWait  # noqa: E402

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = [
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs the packages chromium and chromium-driver"),
    pytest.mark.xdist_group("browser"),
    pytest.mark.processes,
]
METHODS_LISTED = {method.name: method.label for method in registry.METHODS.values()}
SWITCHES = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return page.build(readme.ROOT / "results" / "reference", tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def browser(built):
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


def look(browser, name):
    folder = os.environ.get("SCREENSHOTS")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        browser.save_screenshot(str(Path(folder) / f"{name}.png"))


def live(browser):
    """The live section, in view and drawn."""
    section = browser.find_element(By.ID, "live")
    browser.execute_script("arguments[0].scrollIntoView()", section)
    WebDriverWait(browser, 60).until(lambda _: section.get_attribute("data-ready") == "yes")
    return section


def move(browser, name, value):
    browser.execute_script(
        "const c = document.querySelector(`#live [name=${arguments[0]}]`); c.value = arguments[1];"
        "c.dispatchEvent(new Event('input', {bubbles: true}));",
        name, str(value),
    )  # fmt: skip


@contextmanager
def screen(browser, width, height, touch=True):
    """The page on a screen of another size, under fingers if it is a phone's."""
    mobile = touch and width < 600
    size = {"width": width, "height": height, "deviceScaleFactor": 2 if mobile else 1, "mobile": mobile}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": mobile, "maxTouchPoints": 5})
    frame(browser)
    yield
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    frame(browser)


def swipe(browser, *ways):
    """Moves fingers, each from (x, y) to (x, y), all at once."""

    def send(kind, part=None):
        at = [] if part is None else [(a + (b - a) * part, c + (d - c) * part) for (a, c), (b, d) in ways]
        points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(at)]
        browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    send("touchStart", 0)
    for k in range(1, 11):
        send("touchMove", k / 10)
    send("touchEnd")
    frame(browser)


def box(browser, selector, block="center"):
    """Where an element is in the window, after scrolling it there."""
    script = (
        "const e = document.querySelector(arguments[0]); e.scrollIntoView({block: arguments[1]});"
        "const r = e.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]"
    )
    return browser.execute_script(script, selector, block)


def drawn(browser):
    """The pictures of the live top, and what is told beside them."""
    frame(browser)
    return browser.execute_script(
        "return [...['.sphere', '.errors'].map(name => document.querySelector(`#live ${name}`).toDataURL()),"
        "document.querySelector('#live .told').innerText]"
    )


def said(browser):
    """On the console."""
    return [entry["message"] for entry in browser.get_log("browser")]


def afresh(browser):
    """Loads the page again: what other tests opened, chose or typed is gone."""
    browser.get("about:blank")
    browser.get(browser.page)


def frame(browser):
    browser.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done));")


def test_nothing_is_said_on_the_console_and_nothing_requested(browser):
    import json

    live(browser)
    assert said(browser) == []
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    urls = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert urls  # the page itself
    assert {url.partition(":")[0] for url in urls} <= {"file", "data", "blob"}


def test_the_console_is_listened_to(browser):
    """Negative control of the test above."""
    browser.execute_script("setTimeout(() => { throw new Error('made up') })")
    WebDriverWait(browser, 10).until(lambda b: any("made up" in e["message"] for e in b.get_log("browser")))


def test_tables_sort(browser):
    browser.execute_script("document.querySelector('#phase details.more').open = true")
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


def test_fingers_enlarge_and_move_a_figure(browser):
    with screen(browser, 390, 844):
        state = (
            "const p = document.querySelector('#zoom .pane'), r = p.querySelector('svg').getBoundingClientRect();"
            "return [r.width, p.scrollLeft, visualViewport.scale]"
        )
        x, y, width, height = box(browser, "main > figure button.enlarge")
        assert min(width, height) >= 40  # a finger's width
        swipe(browser, ((x + width / 2, y + height / 2),) * 2)
        fitted = browser.execute_script(state)
        swipe(browser, ((155, 400), (75, 400)), ((235, 400), (315, 400)))
        pinched = browser.execute_script(state)
        assert pinched[0] == pytest.approx(3 * fitted[0], rel=0.02)
        assert pinched[2] == 1  # the figure, not the page
        swipe(browser, ((250, 400), (150, 400)))
        moved = browser.execute_script(state)
        assert moved[0] == pinched[0]
        assert moved[1] == pytest.approx(pinched[1] + 100, abs=2)
        look(browser, "phone-enlarged")
        browser.find_element(By.CSS_SELECTOR, "#zoom [name=close]").click()


@pytest.mark.parametrize("what", ["main > figure .card", "#live .sphere", "#live .errors"])
def test_fingers_scroll_the_page_over_every_picture(browser, what):
    with screen(browser, 390, 844):
        live(browser)
        x, y, width, height = box(browser, what)
        before = browser.execute_script("return scrollY")
        swipe(browser, ((x + width / 2, y + 0.8 * height), (x + width / 2, y + 0.8 * height - 150)))
        WebDriverWait(browser, 5).until(lambda b: b.execute_script("return scrollY") > before + 80)


def test_fingers_and_keys_turn_and_enlarge_the_sphere(browser):
    with screen(browser, 390, 844):
        live(browser)
        x, y, width, height = box(browser, "#live .sphere")
        across, down = x + width / 2, y + height / 2
        before = drawn(browser)
        swipe(browser, ((across, down), (across + 100, down)))
        turned = drawn(browser)
        assert turned[0] != before[0]
        assert turned[1:] == before[1:]
        swipe(browser, ((across - 30, down), (across - 90, down)), ((across + 30, down), (across + 90, down)))
        assert drawn(browser)[0] != turned[0]
        assert browser.execute_script("return visualViewport.scale") == 1
    sphere = browser.find_element(By.CSS_SELECTOR, "#live .sphere")
    pictures = []
    for key in ("0", Keys.ARROW_LEFT, Keys.ARROW_UP, "+", "0"):
        sphere.send_keys(key)
        pictures.append(drawn(browser)[0])
    assert len(set(pictures)) == 4
    assert pictures[-1] == pictures[0]


def test_a_name_in_the_list_opens_the_panel_of_the_method(browser):
    """By keyboard; with its facts, claims and curves, also on tops in a tide; Escape leads back."""
    afresh(browser)
    browser.execute_script("document.getElementById('methods').open = true")
    buttons = browser.find_elements(By.CSS_SELECTOR, "#methods tbody td:first-child button")
    assert len(buttons) == len(METHODS_LISTED)
    dialog = browser.find_element(By.ID, "method")

    def curves():
        WebDriverWait(browser, 20).until(lambda _: dialog.is_displayed())
        kinds = "[...s.querySelectorAll('path:not(.grid)')].map(p => [p.getAttribute('class'), p.textContent])"
        return browser.execute_script(f"return [...document.querySelectorAll('#method svg')].map(s => {kinds})")

    for name, top in (("implicit_midpoint", "generic"), ("backlund_splitting", "weak_tide")):
        label = METHODS_LISTED[name]
        button = next(b for b in buttons if b.text == label)
        browser.execute_script("arguments[0].focus()", button)
        button.send_keys(Keys.ENTER)
        curves()
        choose = (
            "const s = document.querySelector('#method select'); s.value = arguments[0];"
            "s.dispatchEvent(new Event('change'))"
        )
        browser.execute_script(choose, top)
        drawn = curves()
        assert len(drawn) == 3
        for lines in drawn:
            assert len(lines) > 20
            assert [text for kind, text in lines if kind == "own"] == [label]
        assert dialog.find_element(By.TAG_NAME, "b").text == label
        text = dialog.text
        assert name in text
        assert "confirmed" in text
        assert ("order 2" in text) == (name == "implicit_midpoint")
        look(browser, f"panel-{name}")
        browser.switch_to.active_element.send_keys(Keys.ESCAPE)
        assert not dialog.is_displayed()
        assert browser.switch_to.active_element == button
    assert said(browser) == []


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
    key = browser.find_elements(By.CSS_SELECTOR, ".key dt")
    assert [number.text in sentence.text for number, sentence in zip(key, sentences, strict=True)][::2] == [True, True]
    for width, height, seen in ((1280, 800, 1.0), (360, 740, 0.3)):  # on a phone of two panels on top of each other
        with screen(browser, width, height):
            parts = browser.execute_script(
                "scrollTo(0, 0); for (const e of document.querySelectorAll('header .error')) e.hidden = true;"  # bad news may
                "return ['.key', 'main > figure .card svg'].map(s => [...document.querySelectorAll(s)])"
                ".map(found => found.find(e => e.getClientRects().length))"
                ".map(e => e.getBoundingClientRect()).map(r => [r.top, r.bottom])"
            )
        assert parts[0][1] < parts[1][0]  # the three numbers, then the figure
        assert parts[1][0] + seen * (parts[1][1] - parts[1][0]) < height


def test_the_navigation_fits_and_shows_where_one_is(browser):
    marked = "return [...document.querySelectorAll('nav [aria-current]')].map(a => a.hash)"
    seen = "const r = document.querySelector('nav [aria-current]').getBoundingClientRect(); return [r.left, r.right, innerWidth]"
    for width in (1280, 800, 390):
        with screen(browser, width, 900):
            row = "const row = document.querySelector('nav div'); return row.scrollWidth - row.clientWidth"
            assert (browser.execute_script(row) > 0) == (width < 600)  # a phone's is moved by a finger
            for name in ("perturbed", "environment", "claims"):
                browser.execute_script("document.getElementById(arguments[0]).scrollIntoView()", name)
                WebDriverWait(browser, 10).until(lambda b, name=name: b.execute_script(marked) == [f"#{name}"])
                left, right, inner = browser.execute_script(seen)
                assert 0 <= left < right <= inner
                bottom = browser.execute_script(
                    "return document.querySelector(`#${arguments[0]} h2`).getBoundingClientRect().top"
                    " - document.querySelector('nav').getBoundingClientRect().bottom", name,
                )  # fmt: skip
                assert bottom >= 0  # the navigation covers no heading
    browser.execute_script("scrollTo(0, 0)")
    WebDriverWait(browser, 10).until(lambda b: b.execute_script(marked) == ["#top"])


def test_a_reader_who_hears_the_page_is_told_what_is_drawn(browser):
    figures = browser.find_elements(By.CSS_SELECTOR, "figure .card svg")
    assert all(f.get_attribute("role") == "img" and len(f.get_attribute("aria-label")) > 20 for f in figures)
    unnamed = browser.execute_script(
        "const named = e => e.getAttribute('aria-label') || [...e.labels ?? []].some(l => l.textContent.trim())"
        " || (e.matches('button, a, summary') && e.textContent.trim());"
        "return [...document.querySelectorAll('button, a[href], input, select, summary, [tabindex]')]"
        ".filter(e => !named(e) || (e.matches('div') && !e.getAttribute('role'))).map(e => e.outerHTML.slice(0, 100))"
    )
    assert unnamed == []
    levels = browser.execute_script(
        "return [...document.querySelectorAll('h1, h2, h3, h4, h5, h6')].map(e => Number(e.tagName[1]))"
    )
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in zip([0, *levels], levels, strict=False))
    assert browser.execute_script("return document.querySelectorAll('th:not([scope])').length") == 0
    skip = browser.find_element(By.CSS_SELECTOR, "a.skip")
    browser.execute_script("arguments[0].focus()", skip)
    assert skip.rect["x"] >= 0


AXE = """
const done = arguments[0];
axe.run({runOnly: ["wcag2a", "wcag2aa", "best-practice"], resultTypes: ["violations"]})
  .then(r => done(r.violations.map(v => [v.id, v.nodes.slice(0, 3).map(n => n.html.slice(0, 200))])));
"""


def test_axe_finds_nothing_wrong(browser):
    """On a desk in the light, on a phone in the dark, all unfolded; and with the panel of a method.

    axe-core reads every element, seen or not, at a millisecond each: of tables only the first rows are left, and of figures
    only their names.
    """
    axe = Path(pytest.importorskip("axe_core_python").__file__).with_name("axe.min.js")
    afresh(browser)
    live(browser)
    browser.execute_script(
        "document.querySelectorAll('figure svg > *').forEach(e => e.remove());"
        "for (const body of document.querySelectorAll('tbody')) [...body.rows].slice(3).forEach(row => row.remove());"
        "document.querySelectorAll('details').forEach(e => { e.open = true; });"
    )
    browser.execute_script(axe.read_text(encoding="utf-8"))
    for width, height, scheme in ((1280, 900, "light"), (390, 844, "dark")):
        media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
        with screen(browser, width, height):
            assert browser.execute_async_script(AXE) == []
    browser.execute_script("document.querySelector('#methods td button').click()")
    WebDriverWait(browser, 10).until(lambda b: b.find_element(By.ID, "method").is_displayed())
    browser.execute_script("for (const e of document.querySelectorAll('main > *:not(h1, header)')) e.remove();")
    assert browser.execute_async_script(AXE) == []
    browser.execute_script(  # what it is to find
        "document.getElementById('method').close();"
        "document.querySelector('main').insertAdjacentHTML('beforeend', `<input><img src='data:,'>"
        "<p style='color: #888; background: #999'>pale</p><button></button><h6>too deep</h6>`)"
    )
    found = {rule for rule, _ in browser.execute_async_script(AXE)}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    afresh(browser)
    assert {"label", "image-alt", "color-contrast", "button-name", "heading-order"} <= found


def test_sliders_move_the_picture(browser):
    section = live(browser)

    before, told = drawn(browser), section.find_element(By.CSS_SELECTOR, ".told").text
    assert drawn(browser) == before  # it does not move by itself
    move(browser, "h", 0.8)
    assert drawn(browser) != before
    assert section.find_element(By.CSS_SELECTOR, ".told").text != told
    assert "after 1 whole nutation" in section.find_element(By.CSS_SELECTOR, ".exact").text
    assert "nutation" in section.find_element(By.CSS_SELECTOR, '[for="live-h"] output').text
    before = drawn(browser)
    move(browser, "steps", 80)
    assert drawn(browser) != before
    assert browser.execute_script("return document.getElementById('live').runs[0].states.length") == 81
    move(browser, "top", "figure1")
    assert float(browser.execute_script("return document.querySelector('#live [name=alpha]').value")) == 3.345


def test_the_paper_s_figures_are_a_click_away(browser):
    section = live(browser)
    browser.execute_script("arguments[0].querySelector('details').open = true", section)
    section.find_element(By.CSS_SELECTOR, '[name="preset"][value="2"]').click()
    frame(browser)
    runs = browser.execute_script(
        "return document.getElementById('live').runs.map(r => [r.name, r.states[r.states.length - 1].n])"
    )
    assert runs == [["free", 4000]]
    look(browser, "figure2")


def test_at_first_glance_the_exact_step_is_right_and_the_others_are_not(browser):
    afresh(browser)
    live(browser)
    for h in (0.4, 0.8, 1.2):
        move(browser, "h", h)
        frame(browser)
        off = browser.execute_script(
            "return [...document.querySelectorAll('#live .numbers tbody tr')].map(r => [...r.cells].map(c => c.innerText))"
        )
        assert [row[0] for row in off] == ["Bäcklund, exact λ(h)", "Implicit midpoint", "Strang"]
        assert re.fullmatch(r"0|[\d.]+×10⁻¹[³⁴⁵⁶⁷⁸⁹]", off[0][1]), (h, off[0])
        for row in off[1:]:
            assert re.match(r"failed|[\d.]+$", row[1]), (h, row)  # a thousandth and more


def test_whatever_is_typed_in_is_drawn_or_refused(browser):
    afresh(browser)
    live(browser)
    for top in ("generic", "weightless", "hanging", "homoclinic", "regular"):
        for h, steps in ((-2, 100), (1.5, 100), (0.4, 0)):
            for name, value in (("top", top), ("h", h), ("steps", steps)):
                move(browser, name, value)
            frame(browser)
            text = browser.find_element(By.ID, "live").text
            assert "axis is off by" in text, (top, h, steps, text)
            assert not re.search("NaN|Infinity|undefined", text)
    cases = [
        ("alpha", "1e300", "too large"),
        ("alpha", "", "six numbers"),
        ("x1", "1e200", "too large"),
        ("alpha", "0", "off by"),
    ]
    for name, value, answer in cases:
        move(browser, "top", "generic")
        move(browser, name, value)
        frame(browser)
        assert answer in browser.find_element(By.CSS_SELECTOR, "#live .told").text
    for name in ("alpha", "J1", "J2", "J3"):
        move(browser, name, 0)
    frame(browser)
    assert "no time scale" in browser.find_element(By.CSS_SELECTOR, "#live .told").text
    move(browser, "top", "generic")
    move(browser, "h", 0.4)
    assert said(browser) == []


def test_the_midpoint_rule_stops_where_python_s_does(browser):
    """Where its equation has three solutions."""
    top = TOPS["through_pole"]
    h = 30 * float(top.top.scales(top.state)[2])
    states = browser.execute_script(
        "const [a, y, h] = arguments; return Top.iterate(Top.stepper('implicit_midpoint', a, y, h).step, y, 5)",
        top.alpha, list(top.y0), h,
    )  # fmt: skip
    done = next(n for n, state in enumerate(states) if None in state) - 1
    assert np.all(np.isfinite(integrate(top.top, top.state, h, done, "implicit_midpoint").y))
    with pytest.raises(StepError, match="three solutions"):
        integrate(top.top, top.state, h, done + 1, "implicit_midpoint")


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
            if method in ("strang", "rk4") and abs(span) > 0.5:
                continue  # there they amplify round-off
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


IN_A_TIDE = {  # of top.js: Python's method and its options
    "backlund_splitting": ("backlund_splitting", {"corrector": False, "modified_kick": False}),
    "implicit_midpoint": ("implicit_midpoint", {}),
    "strang": ("strang", {}),
    "rk4": ("rk4", {}),
    "truth": ("taylor", {}),
}


@pytest.mark.parametrize("method", IN_A_TIDE)
def test_the_browser_computes_what_python_computes_in_a_tide(browser, method):
    """The largest of the named tides, and a weak one; a hundred steps, to 1e-12 of the scales. Another tide is told apart."""
    name, options = IN_A_TIDE[method]
    for state, epsilon in (("generic", 1e-2), ("fast", 1e-4)):
        base = TOPS[state]
        top = PerturbedTop(base.top, TIDE, (epsilon, 1.0, 0.0, 0.0))
        scale = np.repeat(top.scales(base.state)[:2], 3)
        h = 0.3 * float(top.scales(base.state)[2])
        expected = integrate(top, base.state, h, 100, name, **options).y[-1]

        def off(tide, base=base, h=h, scale=scale, expected=expected):
            found = browser.execute_script(
                "const [m, a, y, h, k] = arguments; return Top.iterate(Top.stepper(m, a, y, h, k).step, y, 100)[100]",
                method, base.alpha, list(base.y0), h, tide,
            )  # fmt: skip
            return np.max(np.abs(np.array(found) - expected) / scale)

        assert off(epsilon) < 1e-12
        assert off(1.01 * epsilon) > 1e-9


def test_the_tide_of_the_live_top(browser):
    """Leftmost there is none and the exact step is right; then it is a splitting's, whose energy error shrinks with the tide."""
    afresh(browser)
    section = live(browser)

    def numbers():
        frame(browser)
        cells = "[...document.querySelectorAll('#live .numbers tbody tr')].map(r => [...r.cells].map(c => c.innerText))"
        return browser.execute_script(f"return {cells}")

    calm, picture = numbers(), drawn(browser)
    assert not section.find_element(By.CSS_SELECTOR, ".energy").is_displayed()
    move(browser, "h", -0.2)
    found = []
    for exponent in (-2, -4):
        move(browser, "eps", exponent)
        rows = numbers()
        assert [row[0] for row in rows] == ["Bäcklund splitting", "Implicit midpoint", "Strang"]
        assert {row[3] for row in rows} == {"–"}  # J3 changes
        energies = browser.execute_script(
            "const k = 10 ** arguments[0]; return section.runs.map(r => Math.abs(Top.invariants(1, r.all[r.last], k)[0] - "
            "Top.invariants(1, r.all[0], k)[0]))".replace("section", "document.getElementById('live')"), exponent,
        )  # fmt: skip
        found.append(energies)
    assert section.find_element(By.CSS_SELECTOR, ".energy").is_displayed()
    assert 30 < found[0][0] / found[1][0] < 300  # of the splitting: like the tide
    assert max(found[0][1], found[1][1]) < 1e-14  # the midpoint rule keeps a quadratic energy
    assert found[1][2] > 100 * found[1][0]  # of Strang: as without
    assert section.find_element(By.CSS_SELECTOR, '[value="backlund_paper"]').get_attribute("disabled")
    move(browser, "h", 0.4)
    move(browser, "eps", -7)
    assert numbers() == calm
    assert drawn(browser) == picture
    move(browser, "eps", -1)
    move(browser, "h", 1.5)
    browser.execute_script("for (let i = 0; i < 3; i++) document.querySelector('#live [name=more]').click()")
    move(browser, "steps", 6400)
    frame(browser)
    assert "so far the truth" in section.find_element(By.CSS_SELECTOR, '[for="live-steps"] output').text
    assert not re.search("NaN|Infinity|undefined", section.text)
    assert said(browser) == []
    afresh(browser)


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


def luminance(colour):
    """Of #rrggbb, as WCAG 2 defines it."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_letters_stand_out_from_their_ground(scheme):
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") < 4.5 < contrast("#767676", "#ffffff")  # the classical pair
    css = (readme.ROOT / "report" / "page.css").read_text(encoding="utf-8")
    named = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", re.findall(r":root \{(.*?)\}", css, re.DOTALL)[scheme]))
    letters = [(name, ground) for name in ("ink", "soft", "link") for ground in ("paper", "wash")]
    letters += [(name, f"{name}-wash") for name in ("pass", "fail", "none")]
    for name, ground in letters:
        assert contrast(named[name], named[ground]) >= 4.5, (name, ground)
    assert contrast(named["edge"], named["paper"]) >= 3  # what is to be found, not read


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


def test_on_a_phone_every_figure_is_seen_whole(browser):
    """Those that are not folded have drawings of their own, in letters one can read; the others are a tap from full size."""
    afresh(browser)
    sizes = (
        "return [...document.querySelectorAll('figure')].filter(f => !f.closest('details:not([open])'))"
        ".map(f => [f, [...f.querySelectorAll('svg')]"
        ".filter(s => s.getClientRects().length)]).filter(([f, s]) => s.length).map(([f, s]) => [f.id, s.length, "
        "s[0].clientWidth / parseFloat(s[0].style.getPropertyValue('--w')), f.querySelector('.wide-scroll').scrollWidth"
        " - f.querySelector('.wide-scroll').clientWidth])"
    )
    assert all(count == 1 for _, count, _, _ in browser.execute_script(sizes))
    with screen(browser, 390, 844):
        WebDriverWait(browser, 20).until(lambda b: not b.find_elements(By.CSS_SELECTOR, "script.phone"))
        seen = browser.execute_script(sizes)
        assert len(seen) == len(browser.find_elements(By.CSS_SELECTOR, "main > section > figure, main > figure"))
        for name, count, scale, beyond in seen:
            assert (count, beyond) == (1, 0), name
            assert scale > 1.3, name  # pixels a point: the smallest letters have 6.5 points
        browser.execute_script("document.querySelector('#drift details.more').open = true")
        frame(browser)
        assert all(beyond <= 0 for _, _, _, beyond in browser.execute_script(sizes))
        x, y, width, height = box(browser, "#drift .figures figure .card svg")
        swipe(browser, ((x + width / 2, y + height / 2),) * 2)
        dialog = browser.find_element(By.ID, "zoom")
        assert dialog.is_displayed()
        assert dialog.find_element(By.CSS_SELECTOR, ".pane svg").rect["width"] > 1.4 * width
        dialog.find_element(By.CSS_SELECTOR, "[name=close]").click()
    assert all(count == 1 for _, count, _, _ in browser.execute_script(sizes))
    afresh(browser)


def test_it_prints(browser):
    afresh(browser)
    media = {"media": "print", "features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    with screen(browser, 703, 1000):  # A4 less its margins
        browser.execute_script("dispatchEvent(new Event('beforeprint'))")
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 703  # else all is shrunk
        shown = browser.execute_script(
            "return [...document.querySelectorAll('details')].map(d => [d, d.querySelector(':scope > .scroll tbody')])"
            ".filter(([d, body]) => body).map(([d, body]) => [body.rows.length, d.open])"
        )
        ground = "return getComputedStyle(document.querySelector(arguments[0])).backgroundColor"
        grounds = [browser.execute_script(ground, where) for where in ("body", ".badge.confirmed")]
        browser.execute_script("dispatchEvent(new Event('afterprint'))")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    assert [(rows, opened) for rows, opened in shown if rows > 14 and opened != (rows <= 60)] == []
    assert {opened for _, opened in shown} == {False, True}
    assert all(min(map(int, re.findall(r"\d+", ground)[:3])) > 200 for ground in grounds), "dark ink on paper"
    printed = browser.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    document = base64.b64decode(printed["data"])
    if folder := os.environ.get("SCREENSHOTS"):
        (Path(folder) / "page.pdf").write_bytes(document)
    assert 20 < len(re.findall(rb"/Type\s*/Page\b", document)) < 60


def test_the_page_is_one_file_of_moderate_size(built):
    assert built.stat().st_size < 5e6
