"""The page in a real browser: no error, no request; tables sort, figures are enlarged, panels open, and axe finds nothing."""

import json
from pathlib import Path

import pandas as pd
import pytest
from browsing import IN_A_BROWSER, By, afresh, console, css, live, screen, until
from selenium.webdriver.common.keys import Keys

from lagrange_bench.integrators import METHODS

pytestmark = IN_A_BROWSER


def test_nothing_is_said_on_the_console_and_nothing_requested(browser, built):
    assert built.stat().st_size < 5e6
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
        "const t = [...document.querySelectorAll('table.sortable')].sort((a, b) => b.rows.length - a.rows.length)[0];"
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
    button, dialog = css(browser, "main > figure button.enlarge"), css(browser, "#zoom")
    drawn = css(browser, "main > figure .card svg")
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


@pytest.mark.parametrize(
    ("name", "top", "words"),
    [("implicit_midpoint", "generic", "order 2"), ("backlund_splitting", "weak_tide", "confirmed")],
)
def test_a_name_in_the_list_opens_the_panel_of_the_method(browser, name, top, words):
    """By keyboard; with its facts, claims and curves, also on tops in a tide; Escape leads back."""
    afresh(browser)
    browser.execute_script("document.getElementById('methods').open = true")
    buttons = browser.find_elements(By.CSS_SELECTOR, "#methods tbody td:first-child button")
    assert len(buttons) == len(METHODS)
    button = next(b for b in buttons if b.text == METHODS[name].label)
    dialog = css(browser, "#method")
    button.send_keys(Keys.ENTER)
    until(browser, lambda _: dialog.is_displayed())
    browser.execute_script(
        "const s = document.querySelector('#method select'); s.value = arguments[0]; s.dispatchEvent(new Event('change'))",
        top,
    )
    kinds = "[...s.querySelectorAll('path:not(.grid)')].map(p => [p.getAttribute('class'), p.textContent])"
    plots = browser.execute_script(f"return [...document.querySelectorAll('#method svg')].map(s => {kinds})")
    assert len(plots) == 3
    for lines in plots:
        assert len(lines) > 20
        assert [text for kind, text in lines if kind == "own"] == [METHODS[name].label]
    assert all(word in dialog.text for word in (name, METHODS[name].label, "confirmed", words))
    browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    assert not dialog.is_displayed()
    assert browser.switch_to.active_element == button
    assert console(browser) == []


def test_rows_are_a_link_away(browser, stored, tmp_path):
    browser.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    css(browser, "#gaudin a.rows").send_keys(Keys.ENTER)
    file = tmp_path / "gaudin.csv"
    until(browser, lambda _: file.exists() and file.stat().st_size)
    assert pd.read_csv(file).error.dropna().tolist() == stored["gaudin"].error.dropna().tolist()


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
    until(browser, lambda b: css(b, "#method").is_displayed())
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


def test_on_a_phone_every_figure_is_seen_whole(browser):
    """Those that are not folded have drawings of their own, in letters one can read."""
    afresh(browser)
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
        assert len(seen) == len(browser.find_elements(By.CSS_SELECTOR, "main > section > figure, main > figure"))
        for name, count, scale, beyond in seen:
            assert (count, beyond) == (1, 0), name
            assert scale > 1.3, name  # pixels a point: the smallest letters have 6.5 points
    assert all(count == 1 for _, count, _, _ in browser.execute_script(sizes))
    afresh(browser)


def test_the_chooser_answers_and_leads_to_the_figure(browser):
    answer, fields = css(browser, "#choose .answer"), browser.find_elements(By.CSS_SELECTOR, "#choose select")
    assert len(fields) == 4
    before = answer.text
    browser.execute_script(
        "arguments[0].selectedIndex = arguments[0].options.length - 1;"
        "arguments[0].dispatchEvent(new Event('change', {bubbles: true}))",
        fields[0],
    )
    assert answer.text != before
    link = answer.find_element(By.TAG_NAME, "a").get_attribute("href").partition("#")[2]
    assert css(browser, f"#{link} figcaption b").get_attribute("textContent").startswith("Figure")
