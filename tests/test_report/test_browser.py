"""The page in a real browser: no error, no request; tables sort, figures are enlarged, panels open, and axe finds nothing."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from browsing import IN_A_BROWSER, By, WebDriverWait, afresh, live, look, said, screen
from selenium.webdriver.common.keys import Keys

from lagrange_bench.integrators import registry
from lagrange_bench.report import readme
from lagrange_bench.results.store import Store

pytestmark = IN_A_BROWSER
METHODS_LISTED = {method.name: method.label for method in registry.METHODS.values()}


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


def test_the_page_is_one_file_of_moderate_size(built):
    assert built.stat().st_size < 5e6
