"""The page on phones, in the dark and on paper."""

import base64
import os
import re
from pathlib import Path

import numpy as np
import pytest
from browsing import IN_A_BROWSER, By, WebDriverWait, afresh, box, frame, live, look, screen, swipe

from lagrange_bench.report import readme

pytestmark = IN_A_BROWSER


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
