"""The live top in a real browser: it computes what Python computes, and whatever is typed in is drawn or refused."""

import re

import numpy as np
import pytest
from browsing import IN_A_BROWSER, afresh, console, css, drawn, live, move, numbers
from scipy.spatial.transform import Rotation

from lagrange_bench.integrators import TOPS, StepError, integrate
from lagrange_bench.integrators.problem.perturbed import PerturbedTop
from lagrange_bench.integrators.problem.potentials import TIDE

pytestmark = IN_A_BROWSER


def iterate(browser, method, alpha, y, h, steps, tide=0.0):
    """States of a method of top.js."""
    return browser.execute_script(
        "const [m, a, y, h, n, k] = arguments; return Top.iterate(Top.stepper(m, a, y, h, k || undefined).step, y, n)",
        method, alpha, list(y), h, steps, tide,
    )  # fmt: skip


# orbits so close to a separatrix that half an ulp of y0 is worth more than the bound; 1 − k² is far below 1e-3
UNSTABLE = {"near_separatrix": 1e-9, "homoclinic": 0.02, "unstable_sleeping": 0.02}


@pytest.mark.parametrize("method", ["backlund", "backlund_paper", "implicit_midpoint", "strang", "rk4"])
def test_the_browser_computes_what_python_computes(browser, method):
    """A hundred steps on every named top, in the same plain doubles: to 1e-12 where the orbit allows it."""
    spans = (0.1, -0.3) if method in ("strang", "rk4") else (0.1, 0.7, -0.3, 2.9)  # longer steps amplify round-off
    compared = 0
    for name, top in TOPS.items():
        x_scale, J_scale, unit = top.top.scales(top.state)
        scale = np.repeat([x_scale, J_scale], 3)
        for span in spans:
            h = float(span * unit)
            try:
                expected = integrate(top.top, top.state, h, 100, method).y[-1]
            except StepError:
                continue
            found = np.array(iterate(browser, method, top.alpha, top.y0, h, 100)[100])
            assert np.max(np.abs(found - expected) / scale) < UNSTABLE.get(name, 1e-12), (name, span)
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
        *scales, unit = top.scales(base.state)
        h = 0.3 * float(unit)
        expected = integrate(top, base.state, h, 100, name, **options).y[-1]
        tides = (epsilon, 1.01 * epsilon)
        ends = [iterate(browser, method, base.alpha, base.y0, h, 100, tide)[100] for tide in tides]
        here, elsewhere = np.max(np.abs(np.array(ends) - expected) / np.repeat(scales, 3), axis=1)
        assert here < 1e-12
        assert elsewhere > 1e-9


def test_the_body_spins_in_the_browser_as_in_python(browser):
    """By exact steps and by Taylor series; the sign of a quaternion does not count."""
    script = (
        "const [a, y, t] = arguments, taylor = (k) => Top.stepper('truth', a, y, t, k).step([...y, 1, 0, 0, 0]);"
        "return [Top.attitude(a, y, t), taylor(0).slice(6), taylor(0.1)]"
    )
    for name in ("generic", "figure1", "fast", "slow", "weightless", "through_pole"):
        top = TOPS[name]
        for span in (0.05, 0.9, 61.0):
            t = float(span * top.top.scales(top.state)[2])
            run = integrate(top.top, top.state, t=[0.0, t], attitude=True).rotation
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


def test_at_first_glance_the_exact_step_is_right_and_the_others_are_not(browser):
    afresh(browser)
    live(browser)
    for h in (0.4, 0.8, 1.2):
        move(browser, h=h)
        exact, *others = numbers(browser)
        assert [exact[0], *(row[0] for row in others)] == ["Bäcklund, exact λ(h)", "Implicit midpoint", "Strang"]
        assert re.fullmatch(r"0|[\d.]+×10⁻¹[³⁴⁵⁶⁷⁸⁹]", exact[1]), (h, exact)
        for row in others:
            assert re.match(r"failed|[\d.]+$", row[1]), (h, row)  # a thousandth and more


def test_whatever_is_typed_in_is_drawn_or_refused(browser):
    afresh(browser)
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
    move(browser, top="generic", h=0.4)
    assert console(browser) == []


def test_the_tide_of_the_live_top(browser):
    """Leftmost there is none and the exact step is right; then it is a splitting's, whose energy error shrinks with the tide."""
    afresh(browser)
    section = live(browser)
    calm, picture = numbers(browser), drawn(browser)
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
    assert not re.search("NaN|Infinity|undefined", section.text)
    assert console(browser) == []
    afresh(browser)
