"""The page in a real browser: no error, no request; the live top computes what Python computes; axe finds nothing wrong.

Debian's chromium and chromium-driver, without a window.
"""

import json
import re
import shutil
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from lagrange_bench.experiments.drawing import style
from lagrange_bench.integrators import METHODS, TOPS, RigidBody, StepError, integrate
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.potentials import TIDE

pytest.importorskip("selenium")

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.color import Color
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
    driver.set_script_timeout(300)  # axe takes more than the 30 s of the default beside busy loops
    driver.page = built.as_uri()
    yield driver
    driver.quit()


@pytest.fixture
def browser(driver):
    """With the page as it is when it is opened; afterwards nothing is on its console."""
    driver.get("about:blank")
    driver.get(driver.page)
    yield driver
    assert console(driver) == []


def css(browser, selector):
    return browser.find_element(By.CSS_SELECTOR, selector)


def until(browser, condition, seconds=20):
    WebDriverWait(browser, seconds).until(condition)


def live(browser):
    """The live section, in view and drawn."""
    section = css(browser, "#live")
    browser.execute_script("arguments[0].scrollIntoView()", section)
    until(browser, lambda _: section.get_attribute("data-ready") == "yes", 60)
    return section


def move(browser, **controls):
    for name, value in controls.items():
        browser.execute_script(
            "const c = document.querySelector(`#live [name=${arguments[0]}]`); c.value = arguments[1];"
            "c.dispatchEvent(new Event('input', {bubbles: true}));",
            name, str(value),
        )  # fmt: skip
    frame(browser)


def numbers(browser):
    frame(browser)
    cells = "[...document.querySelectorAll('#live .numbers tbody tr')].map(r => [...r.cells].map(c => c.innerText))"
    return browser.execute_script(f"return {cells}")


def drawn(browser):
    frame(browser)
    return browser.execute_script(
        "return [...['.sphere', '.errors'].map(name => document.querySelector(`#live ${name}`).toDataURL()),"
        "document.querySelector('#live .told').innerText]"
    )


@contextmanager
def screen(browser, width, height):
    """The page on a screen of another size, under fingers if it is a phone's."""
    mobile = width < 600
    size = {"width": width, "height": height, "deviceScaleFactor": 2 if mobile else 1, "mobile": mobile}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": mobile, "maxTouchPoints": 5})
    frame(browser)
    yield
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    frame(browser)


def console(browser):
    return [entry["message"] for entry in browser.get_log("browser")]


def frame(browser):
    browser.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done));")


def iterate(browser, method, alpha, y, h, steps, tide=0.0):
    return browser.execute_script(
        "const [m, a, y, h, n, k] = arguments; return Top.iterate(Top.stepper(m, a, y, h, k || undefined).step, y, n)",
        method, alpha, list(y), h, steps, tide,
    )  # fmt: skip


# orbits so close to a separatrix that half an ulp of y0 is worth more than the bound; 1 − k² is far below 1e-3
UNSTABLE = {"near_separatrix": 1e-9, "homoclinic": 0.02, "unstable_sleeping": 0.02}
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
    """A hundred steps on every named top or in a tide, in the same plain doubles: to 1e-12 where the orbit allows it."""
    compared = 0
    for state, epsilon, span in runs:
        base = TOPS[state]
        top = PerturbedTop(base.top, TIDE, (epsilon, 1.0, 0.0, 0.0)) if epsilon else base.top
        *scales, unit = top.scales(base.state)
        try:
            expected = integrate(top, base.state, h := float(span * unit), 100, name, **options).y[-1]
        except StepError:
            continue
        ends = [iterate(browser, method, base.alpha, base.y0, h, 100, k)[100] for k in (epsilon, 1.01 * epsilon)]
        here, elsewhere = np.max(np.abs(np.array(ends) - expected) / np.repeat(scales, 3), axis=1)
        assert here < UNSTABLE.get(state, 1e-12), (state, span)
        assert epsilon == 0.0 or elsewhere > 1e-9, "negative control"
        compared += 1
    assert compared > len(runs) // 2


def test_the_body_spins_in_the_browser_as_in_python(browser):
    script = (
        "const [a, y, t] = arguments, taylor = (k) => Top.stepper('truth', a, y, t, k).step([...y, 1, 0, 0, 0]);"
        "return [Top.attitude(a, y, t), taylor(0).slice(6), taylor(0.1)]"
    )
    for name in ("generic", "figure1", "fast", "slow", "weightless", "through_pole"):
        top = TOPS[name]
        for span in (0.05, 0.9, 61.0):
            t = float(span * top.top.scales(top.state)[2])
            J, x = np.split(top.state, 2)
            size = np.linalg.norm(x)
            axis, weight = x / size, (0.0, 0.0, -2.0 * top.alpha * size)
            ball = RigidBody(1.0, (0, 0, 1), (1.0, 1.0, 2.0), weight)  # all moments about the tip are 2
            start = ball.state(rotation=Rotation.align_vectors(axis, (0, 0, 1))[0], omega_world=J)
            run = integrate(ball, start, t=[0.0, t]).rotation
            expected = (run[1] * run[0].inv()).as_quat(scalar_first=True)
            *both, tide = map(np.array, browser.execute_script(script, top.alpha, list(top.y0), t))
            for found in both:
                assert min(np.abs(found - expected).max(), np.abs(found + expected).max()) < 1e-11, (name, span)
            carried = Rotation.from_quat(tide[6:], scalar_first=True).apply(top.y0[3:])
            assert np.abs(carried - tide[3:6]).max() < 1e-11  # in a tide, too, x is the axis of the body
            if span > 50.0:
                assert min(np.abs(tide[6:] - expected).max(), np.abs(tide[6:] + expected).max()) > 1e-3


def test_controls_move_the_picture(browser):
    live(browser)
    before = drawn(browser)
    assert drawn(browser) == before, "it does not move by itself"
    move(browser, h=0.8)
    assert all(new != old for new, old in zip(drawn(browser), before, strict=True))
    assert "after 1 whole nutation" in css(browser, "#live .exact").text
    move(browser, steps=80)
    assert browser.execute_script("return document.getElementById('live').runs[0].states.length") == 81
    browser.execute_script("document.querySelector('#live details').open = true")
    css(browser, '#live [name="preset"][value="2"]').click()
    runs = "return document.getElementById('live').runs.map(r => [r.name, r.states[r.states.length - 1].n])"
    drawn(browser)
    assert browser.execute_script(runs) == [["free", 4000]]


def test_whatever_is_typed_in_is_drawn_or_refused(browser):
    section = live(browser)
    for top in ("generic", "weightless", "hanging", "homoclinic", "regular"):
        for h, steps in ((-2, 100), (1.5, 100), (0.4, 0)):
            move(browser, top=top, h=h, steps=steps)
            assert "axis is off by" in section.text, (top, h, steps)
            assert not re.search("NaN|Infinity|undefined", section.text)
    for typed, answer in (
        ({"alpha": "1e300"}, "too large"),
        ({"alpha": ""}, "six numbers"),
        ({"x1": "1e200"}, "too large"),
        ({"alpha": "0"}, "off by"),
        ({"alpha": 0, "J1": 0, "J2": 0, "J3": 0}, "no time scale"),
    ):
        move(browser, top="generic", **typed)
        assert answer in css(browser, "#live .told").text


def test_the_tide_of_the_live_top(browser):
    live(browser)
    calm, picture = numbers(browser), drawn(browser)
    exact, *others = calm
    assert re.fullmatch(r"0|[\d.]+×10⁻¹[³⁴⁵⁶⁷⁸⁹]", exact[1]), exact
    assert all(re.match(r"failed|[\d.]+$", row[1]) for row in others), "a thousandth and more"
    energy = css(browser, "#live .energy")
    assert not energy.is_displayed()
    move(browser, h=-0.2)
    errors = []
    for exponent in (-2, -4):
        move(browser, eps=exponent)
        rows = numbers(browser)
        assert [row[0] for row in rows] == ["Bäcklund splitting", "Implicit midpoint", "Strang"]
        assert {row[3] for row in rows} == {"–"}  # J3 changes
        H = "i => Top.invariants(1, r.all[i], 10 ** arguments[0])[0]"
        moved = f"runs.map(r => {{ const H = {H}; return H(r.last) - H(0); }})"
        errors.append(np.abs(browser.execute_script(f"return document.getElementById('live').{moved}", exponent)))
    strong, weak = errors
    assert energy.is_displayed()
    assert 30 < strong[0] / weak[0] < 300  # of the splitting: like the tide
    assert max(strong[1], weak[1]) < 1e-14  # the midpoint rule keeps a quadratic energy
    assert weak[2] > 100 * weak[0]  # of Strang: as without
    assert css(browser, '#live [value="backlund_paper"]').get_attribute("disabled")
    move(browser, h=0.4, eps=-7)
    assert (numbers(browser), drawn(browser)) == (calm, picture)


def test_nothing_is_said_on_the_console_and_nothing_requested(browser, built):
    assert built.stat().st_size < 3.3e6
    live(browser)
    assert console(browser) == []
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    urls = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    assert {url.partition(":")[0] for url in urls} <= {"file", "data", "blob"}
    assert browser.page in urls
    browser.execute_script("setTimeout(() => { throw new Error('made up') })")  # the console is listened to
    until(browser, lambda b: any("made up" in message for message in console(b)))


def test_tables_sort_and_are_filtered_by_words(browser):
    table = browser.execute_script(
        "const t = document.querySelector('#table-work_precision_ends table');"
        "for (let e = t; e; e = e.parentElement) if (e.tagName === 'DETAILS') e.open = true;"
        "t.closest('.scroll').previousElementSibling.scrollIntoView({block: 'center'}); return t"
    )
    label = browser.execute_script("return arguments[0].closest('.scroll').previousElementSibling", table)
    field, count = label.find_element(By.TAG_NAME, "input"), label.find_element(By.TAG_NAME, "output")
    button = table.find_element(By.CSS_SELECTOR, "thead button")

    def shown():
        rows = "[...arguments[0].tBodies[0].rows].filter(row => row.getClientRects().length).map(row => row.innerText)"
        return browser.execute_script(f"return {rows}", table)

    button.send_keys(Keys.ENTER)
    up = shown()
    button.send_keys(Keys.ENTER)
    down = shown()
    assert (sorted(up), len(set(up)) > 20, up != down) == (sorted(down), True, True)
    assert table.find_element(By.CSS_SELECTOR, "th").get_attribute("aria-sort") == "descending"
    field.send_keys("BACKLUND unpinned")
    some = shown()
    assert 0 < len(some) < len(up)
    assert all("backlund" in row and "unpinned" in row for row in some)
    assert count.text == f"{len(some)} of {len(up)} rows"
    field.send_keys(Keys.CONTROL + "a", Keys.DELETE)
    assert (len(shown()), count.text) == (len(up), "")


def test_figures_are_enlarged_and_put_back_by_keyboard_and_wheel(browser):
    button, dialog = css(browser, "#answer figure button.enlarge"), css(browser, "#zoom")
    drawn = css(browser, "#answer figure .card svg")
    button.send_keys(Keys.ENTER)
    assert dialog.is_displayed()

    def width():
        return dialog.find_element(By.CSS_SELECTOR, ".pane svg").rect["width"]

    fitted = width()
    assert fitted > drawn.rect["width"]
    browser.switch_to.active_element.send_keys("++")
    assert width() == pytest.approx(2.25 * fitted, rel=1e-3)
    browser.switch_to.active_element.send_keys("0")
    assert width() == pytest.approx(fitted, rel=1e-3)
    browser.execute_script(
        "document.querySelector('#zoom .pane')"
        ".dispatchEvent(new WheelEvent('wheel', {deltaY: -600, clientX: 700, clientY: 500, cancelable: true}))"
    )
    assert width() > 3 * fitted
    ids = browser.execute_script("return [...document.querySelectorAll('[id]')].map(e => e.id)")
    assert len(ids) == len(set(ids))
    browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    assert (dialog.is_displayed(), drawn.is_displayed()) == (False, True)
    assert browser.switch_to.active_element == button


def test_a_name_in_the_list_opens_the_panel_of_the_method(browser):
    name = "implicit_midpoint"
    browser.execute_script("document.getElementById('methods').open = true")
    buttons = browser.find_elements(By.CSS_SELECTOR, "#methods tbody td:first-child button")
    assert len(buttons) == len(METHODS)
    button = next(b for b in buttons if b.text == METHODS[name].label)
    dialog = css(browser, "#method")
    button.send_keys(Keys.ENTER)
    until(browser, lambda _: dialog.is_displayed())
    browser.execute_script(
        "const s = document.querySelector('#method select'); s.value = 'weak_tide'; s.dispatchEvent(new Event('change'))"
    )
    kinds = "[...s.querySelectorAll('path:not(.grid)')].map(p => [p.getAttribute('class'), p.textContent])"
    plots = browser.execute_script(f"return [...document.querySelectorAll('#method svg')].map(s => {kinds})")
    assert len(plots) == 3
    for lines in plots:
        assert len(lines) > 20
        assert [text for kind, text in lines if kind == "own"] == [METHODS[name].label]
    assert all(word in dialog.text for word in (name, METHODS[name].label, "order 2", "confirmed"))
    assert f'integrate("generic", h=0.1, steps=100, method="{name}")' in dialog.text
    own = dialog.find_element(By.CSS_SELECTOR, "svg .own").value_of_css_property("stroke")
    assert Color.from_string(own).hex == style.of(name)["color"].lower()
    browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    assert not dialog.is_displayed()
    assert browser.switch_to.active_element == button


def test_the_last_part_is_marked_at_the_end_of_the_page(browser):
    marked = "return document.querySelector('nav [aria-current]').textContent"
    assert browser.execute_script(marked) == "Answer"
    browser.execute_script("scrollTo(0, document.documentElement.scrollHeight)")
    until(browser, lambda b: b.execute_script(marked) == "Reference")


def test_a_key_names_lines_too(browser):
    key = "#figure-engines_steps [id*=legend] [data-line]"
    shown = browser.execute_script(
        f"return [...document.querySelectorAll('{key}')].map(e => e.tagName + e.dataset.line)"
    )
    label = METHODS["backlund"].label
    assert {f"g{label}", f"text{label}"} <= set(shown)


def test_rows_are_a_link_away(browser, stored, tmp_path):
    browser.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    browser.execute_script("document.getElementById('work_precision').open = true")
    css(browser, "#work_precision a.rows").send_keys(Keys.ENTER)
    file = tmp_path / "work_precision.csv"
    until(browser, lambda _: file.exists() and file.stat().st_size)
    assert pd.read_csv(file).error.dropna().tolist() == stored["work_precision"].error.dropna().tolist()


AXE = """
const done = arguments[0];
axe.run({runOnly: ["wcag2a", "wcag2aa", "best-practice"], resultTypes: ["violations"]})
  .then(r => done(r.violations.map(v => [v.id, v.nodes.slice(0, 3).map(n => n.html.slice(0, 200))])));
"""


def test_axe_finds_nothing_wrong(browser):
    """axe-core reads every element, seen or not, at a millisecond each: of tables only the first rows are left, and of figures
    only their names."""
    axe = Path(pytest.importorskip("axe_core_python").__file__).with_name("axe.min.js")
    live(browser)
    browser.execute_script(
        "document.querySelectorAll('svg > *, script.drawing').forEach(e => e.remove());"
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
    until(browser, lambda b: css(b, "#method").is_displayed())
    browser.execute_script(
        "for (const e of document.querySelectorAll('main > :not(#answer), #answer > :not(h1)')) e.remove();"
    )
    assert browser.execute_async_script(AXE) == []
    browser.execute_script(  # what it is to find
        "document.getElementById('method').close();"
        "document.querySelector('main').insertAdjacentHTML('beforeend', `<input><img src='data:,'>"
        "<p style='color: #888; background: #999'>pale</p><button></button><h6>too deep</h6>`)"
    )
    found = {rule for rule, _ in browser.execute_async_script(AXE)}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert {"label", "image-alt", "color-contrast", "button-name", "heading-order"} <= found


def test_on_a_phone_every_figure_is_seen_whole(browser):
    """Those that are not folded have drawings of their own, in letters one can read."""
    sizes = (
        "return [...document.querySelectorAll('figure')].filter(f => !f.closest('details:not([open])'))"
        ".map(f => [f, [...f.querySelectorAll('svg')]"
        ".filter(s => s.getClientRects().length)]).filter(([f, s]) => s.length).map(([f, s]) => [f.id, s.length, "
        "s[0].clientWidth / parseFloat(s[0].style.getPropertyValue('--w')), f.querySelector('.wide-scroll').scrollWidth"
        " - f.querySelector('.wide-scroll').clientWidth])"
    )
    with screen(browser, 390, 844):
        until(browser, lambda b: not b.find_elements(By.CSS_SELECTOR, "script.phone"))
        seen = browser.execute_script(sizes)
        assert len(seen) == len(browser.find_elements(By.CSS_SELECTOR, "#answer figure"))
        for name, count, scale, beyond in seen:
            assert (count, beyond) == (1, 0), name
            assert scale > 1.3, name  # pixels a point: the smallest letters have 6.5 points
    assert all(count == 1 for _, count, _, _ in browser.execute_script(sizes))


def test_the_chooser_answers_and_leads_to_the_figure_and_its_choice_is_in_the_address(browser):
    answer, fields = css(browser, "#choose .answer"), browser.find_elements(By.CSS_SELECTOR, "#choose select")
    assert len(fields) == 4
    before = answer.text
    assert 'integrate("generic", h=' in before
    browser.execute_script(
        "arguments[0].selectedIndex = 1; arguments[0].dispatchEvent(new Event('change', {bubbles: true}))", fields[0]
    )
    after, address = answer.text, browser.current_url
    assert after != before
    link = answer.find_element(By.TAG_NAME, "a")
    figure = css(browser, link.get_attribute("href").partition("#")[2].join(("#", "")))
    assert not figure.is_displayed()
    link.click()
    until(browser, lambda _: figure.find_elements(By.TAG_NAME, "svg"))
    assert figure.is_displayed()
    browser.get("about:blank")
    browser.get(address)
    assert css(browser, "#choose .answer").text == after


def test_pointing_at_a_name_fades_the_other_lines_and_a_click_pins_it(browser):
    figure = css(browser, "#figure-phase_h")
    name = next(e for e in figure.find_elements(By.TAG_NAME, "text") if e.text == METHODS["backlund"].label)
    heading = css(browser, "h1")

    def faded():
        opacities = "[...arguments[0].querySelectorAll('g[data-line]')].map(g => [g.dataset.line, +getComputedStyle(g).opacity])"
        return {line for line, opacity in browser.execute_script(f"return {opacities}", figure) if opacity < 0.5}

    def point(element):
        ActionChains(browser).scroll_to_element(element).move_to_element(element).perform()

    point(name)
    assert (len(faded()) > 4, METHODS["backlund"].label in faded()) == (True, False)
    leaders = figure.find_element(By.CSS_SELECTOR, "[id*=LineCollection]")  # from lines to their names
    assert float(leaders.value_of_css_property("opacity")) < 0.5
    point(heading)
    assert faded() == set()
    point(name)
    name.click()
    point(heading)
    assert METHODS["backlund"].label in css(browser, "#figure-phase_h .pointed").text
    assert (len(faded()) > 4, METHODS["backlund"].label in faded()) == (True, False)
    css(browser, "#figure-phase_h .pointed button").click()
    until(browser, lambda b: css(b, "#method").is_displayed())
    assert browser.current_url.endswith("#method=backlund")
