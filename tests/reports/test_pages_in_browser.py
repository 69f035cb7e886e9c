"""Every page in a browser: no fault, no request, fits a phone, text is read, light and dark."""

import json
import re
import time

import numpy as np
import pytest

from mbsbench.tests.covering import diagonal, few

from .browser import LOW, OPEN, OVERFLOW, PALE, SMALL

PAGES = (
    "index.html",
    "mechanisms.html",
    "solvers.html",
    "cost.html",
    "method.html",
    "problem-pendulum.html",
    "solver-beta.html",
    "runs/dd01.html",
    "runs/gg01.html",
)
FIRST = "document.querySelectorAll('.plots .axis').length > 0"


@pytest.mark.parametrize(("name", "look"), diagonal(PAGES, ["phone, dark", "desk, light"]))
def test_page_loads_fits_and_can_be_read(report, browser, name, look):
    """No console fault, nothing asked of a network, no sideways scroll, contrast of WCAG AA."""
    width, dark = {"phone, dark": (390, True), "desk, light": (1280, False)}[look]
    tab = browser.open(report / name, width=width, dark=dark)
    if tab.evaluate("document.querySelectorAll('.plots .canvas').length"):
        tab.evaluate("document.querySelector('.plots .canvas').scrollIntoView()")
        tab.until(FIRST)
    assert tab.evaluate(OVERFLOW) == 0 and tab.evaluate("innerWidth") == width
    assert tab.evaluate(PALE) == []
    assert tab.faults == [] and tab.requests == []


@pytest.mark.parametrize("name", few(PAGES, lambda name: name not in ("mechanisms.html", "runs/gg01.html")))
def test_axe_finds_no_violation(report, axe, name):
    """Light and dark, on a desktop and a phone, with all that is folded opened."""
    assert axe(report / name) == []


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_slider_stands_out(report, browser, dark):
    """Its track and its knob, which axe-core does not look at: 3 to 1 against what is behind (WCAG 1.4.11)."""
    tab = browser.open(report / "index.html", dark=dark)
    tab.evaluate("document.body.append(MBS.element('input', { type: 'range', id: 'slider', value: 50 }))")
    pixels = tab.screenshot(selector="#slider") / 255.0
    linear = np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)
    light = linear @ [0.2126, 0.7152, 0.0722]
    middle, ground = light[light.shape[0] // 2], light[1, 1]
    for place in (0.2, 0.5, 0.8):
        both = sorted((middle[int(place * len(middle))], ground))
        assert (both[1] + 0.05) / (both[0] + 0.05) >= 3.0, place
    tab.close()


@pytest.mark.parametrize("name", [name for name in PAGES if not name.startswith("runs/")])
def test_on_a_phone_the_whole_menu_is_seen(report, browser, name):
    """Nothing of it is cut off or has to be found by scrolling; text and controls are large enough."""
    tab = browser.open(report / name, width=390)
    boxes = tab.evaluate("""[...document.querySelectorAll("nav a, nav button")].map((e) => e.getBoundingClientRect())
        .map((b) => [b.left, b.right, b.top])""")
    assert len(boxes) > 5
    assert all(left >= 0 and right <= 390 and top >= 0 for left, right, top in boxes), boxes
    tab.evaluate(OPEN)
    assert tab.evaluate(SMALL) == [] and tab.evaluate(LOW) == []


def test_contrast_is_measured(report, browser):
    """Grey on grey is found: the measure above is not blind."""
    tab = browser.open(report / "index.html")
    tab.evaluate("document.querySelector('h1').style.color = '#bbb'")
    assert any(found.startswith("H1") for found in tab.evaluate(PALE))


def test_a_runs_page_explains_its_numbers(report, browser):
    tab = browser.open(report / "runs/aa01.html")
    assert tab.evaluate("[...document.querySelectorAll('nav li a')].map((a) => a.textContent)")[:1] == ["Mechanisms"]
    said = tab.evaluate("document.querySelector('[data-meanings]').textContent")
    assert "Time of the last accepted step." in said and "Matrix factorisations" not in said


def test_hostile_names_stay_text_in_plots(report, browser):
    """A solver's name is no markup, in legends, labels and tables made by scripts."""
    tab = browser.open(report / "runs/gg01.html")
    tab.evaluate("document.querySelector('.plots .canvas').scrollIntoView()")  # plots are drawn where they are seen
    tab.until(FIRST)
    assert tab.evaluate("document.querySelectorAll('main script, main img').length") == 0
    tab.goto(report / "runs.html")
    tab.until("document.querySelector('[data-runs]').textContent.includes('alert(\"1\")')")
    assert tab.evaluate("document.querySelectorAll('main script').length") == 0


def test_theme_follows_the_system_until_a_reader_chooses(report, browser):
    tab = browser.open(report / "index.html", dark=True)
    ground = "getComputedStyle(document.body).backgroundColor"
    dark = tab.evaluate(ground)
    tab.evaluate("document.querySelector('[data-theme-button]').click()")
    light = tab.evaluate(ground)
    assert sum(map(int, re.findall(r"\d+", dark))) < 150 < 600 < sum(map(int, re.findall(r"\d+", light)))
    end, kept = time.monotonic() + 20.0, dark
    while kept != light and time.monotonic() < end:  # a browser may end a page before it stores what the page gave it
        tab.goto(report / "index.html")
        if tab.evaluate(ground) == dark:
            tab.evaluate("document.querySelector('[data-theme-button]').click()")
        time.sleep(0.1)
        tab.goto(report / "problem-pendulum.html")
        kept = tab.evaluate(ground)
    assert kept == light  # the choice goes along
    tab.evaluate("localStorage.clear()")


def test_numbers_of_scripts_are_those_of_pages(report, browser):
    """Two writers of numbers, one for the page and one in the browser, must agree."""
    from mbsbench.reports.model.words import number

    values = [0.0, 1.0, 0.00123, 1.23e-5, -4.5e7, 9.999, 12345.6, 99999.0, 0.1, 2.5e-300]
    tab = browser.open(report / "index.html")
    assert tab.evaluate(f"{json.dumps(values)}.map((v) => MBS.number(v))") == [number(v) for v in values]
