"""What tests do in a browser, Debian's chromium and chromium-driver without a window: move, touch, read the console."""

import shutil
from contextlib import contextmanager

import pytest

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
IN_A_BROWSER = [
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs the packages chromium and chromium-driver"),
    pytest.mark.xdist_group("browser"),
    pytest.mark.processes,
    pytest.mark.slow,
]

selenium = pytest.importorskip("selenium")

from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.support.ui import WebDriverWait  # noqa: E402


def css(browser, selector):
    """The first element of this kind."""
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
    """Sets controls of the live top, and draws."""
    for name, value in controls.items():
        browser.execute_script(
            "const c = document.querySelector(`#live [name=${arguments[0]}]`); c.value = arguments[1];"
            "c.dispatchEvent(new Event('input', {bubbles: true}));",
            name, str(value),
        )  # fmt: skip
    frame(browser)


def numbers(browser):
    """The cells of the table of the live top."""
    frame(browser)
    cells = "[...document.querySelectorAll('#live .numbers tbody tr')].map(r => [...r.cells].map(c => c.innerText))"
    return browser.execute_script(f"return {cells}")


def drawn(browser):
    """The pictures of the live top, and what is told beside them."""
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


def afresh(browser):
    """Loads the page again: what other tests opened, chose or typed is gone."""
    browser.get("about:blank")
    browser.get(browser.page)


def frame(browser):
    browser.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done));")
