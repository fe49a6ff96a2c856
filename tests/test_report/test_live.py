"""The live top in a real browser: it computes what Python computes, and whatever is typed in is drawn or refused."""

import re

import numpy as np
import pytest
from browsing import IN_A_BROWSER, By, afresh, box, drawn, frame, live, look, move, said, screen, swipe
from selenium.webdriver.common.keys import Keys

from lagrange_bench.integrators import TOPS, StepError, integrate
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.potentials import TIDE

pytestmark = IN_A_BROWSER


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
