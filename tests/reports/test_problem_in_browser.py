"""The page of a problem in a browser: plots draw, zoom, switch and save; tables sort."""

import numpy as np
import pytest

from mbsbench.harness.base.files import write_text
from mbsbench.reports import site
from mbsbench.reports.model.curves import find_maxima
from mbsbench.tests.factories import make_measured_record, make_swing

from .browser import OPEN
from .conftest import put

DRAWN = "document.querySelector('[data-plot={0}] .axis')"


def drawn(browser, page, name="energy"):
    """A tab with that plot drawn."""
    tab = browser.open(page)
    tab.evaluate(OPEN)
    tab.until("window.MBS.plotted")
    tab.evaluate(f"document.querySelector('[data-plot={name}]').scrollIntoView()")
    tab.until(DRAWN.format(name))
    return tab


def test_plots_draw_and_the_legend_puts_a_solver_in_colour(report, browser):
    """Curves put pixels on the panel; the solver that is asked for is coloured and named, the others are grey."""
    tab = drawn(browser, report / "problem-pendulum.html")
    assert tab.ink("[data-plot=energy]", far=60) > 0.01
    text = "[...document.querySelectorAll('[data-plot=energy] text')].map((t) => t.textContent)"
    assert "limit 0.100 J" in tab.evaluate(text)
    assert tab.evaluate("MBS.plotted.view('energy').range.y[1]") > 0.1
    assert {"alpha", "beta", "delta"} <= set(tab.evaluate("MBS.plotted.lit('energy')"))
    tab.evaluate("[...document.querySelectorAll('.legend button')].find((b) => b.textContent === 'beta').click()")
    lines = "[...document.querySelectorAll('[data-plot=energy] .line[data-solver={}]')]"
    strokes = f"{lines}.map((e) => e.getAttribute('stroke'))"
    assert tab.evaluate("MBS.plotted.lit('energy')") == ["beta"]
    assert set(tab.evaluate(strokes.format("alpha"))) == {"var(--ghost)"}
    assert "var(--ghost)" not in tab.evaluate(strokes.format("beta"))
    assert "beta" in tab.evaluate(text) and "alpha" not in tab.evaluate(text)
    assert tab.evaluate("location.search") == "?solver=beta"
    tab.evaluate("window.before = true; location.reload()")
    tab.until("!window.before && window.MBS && MBS.plotted")
    assert tab.evaluate("MBS.plotted.lit('energy')") == ["beta"] and tab.faults == []


def test_failures_are_starred_and_wrong_ones_crossed(report, browser):
    """At the last point that the solver made, in the group where they are."""
    tab = drawn(browser, report / "problem-pendulum.html")
    for end, solver in (("failed", "delta"), ("wrong", "beta")):
        assert (
            tab.evaluate(f"document.querySelectorAll('[data-plot=energy] .end-{end}[data-solver={solver}]').length")
            == 1
        )
    last = "MBS.plotted.view('energy').places.filter((p) => p[2].solver === 'delta').map((p) => p[2].x[p[3]])"
    assert max(tab.evaluate(last)) == pytest.approx(0.7, abs=1e-3)


def test_time_axes_zoom_together_and_back_by_the_keyboard(report, browser):
    tab = drawn(browser, report / "problem-pendulum.html")
    span = "(([a, b]) => b - a)(MBS.plotted.view('phi').range.x)"
    tab.evaluate("document.querySelector('[data-plot=phi]').scrollIntoView()")
    tab.until(DRAWN.format("phi"))
    whole = tab.evaluate(span)
    tab.evaluate("document.querySelector('[data-plot=energy]').focus()")
    tab.press("+")
    tab.until(f"{span} < {0.7 * whole}")
    tab.press("0")
    tab.until(f"Math.abs({span} - {whole}) < 1e-6")


def test_axes_leave_out_what_is_hidden(browser, tmp_path):
    """A coarse run that swings ten times as far is not drawn at first: it takes none of the axis until it is."""
    put(tmp_path, make_measured_record("aa01", dt_s=0.005), make_swing(size=1e-3))
    put(tmp_path, make_measured_record("aa02", dt_s=0.05), make_swing(size=9.0))
    write_text(tmp_path / "environment.json", "{}")
    tab = drawn(browser, site.build_report(tmp_path).parent / "problem-pendulum.html", "obs-theta")
    top = "MBS.plotted.view('obs-theta').range.y[1]"
    assert tab.evaluate(top) < 1.3
    ink = tab.ink("[data-plot=obs-theta]")
    tab.evaluate("document.querySelector('[data-switch=all]').click()")
    tab.until(f"{top} > 2.5")
    assert ink > 0.01 and tab.faults == []


@pytest.mark.parametrize("width", [1440, 390])
def test_heights_are_reserved_and_nothing_moves(report, browser, width):
    """The sum of all layout shifts while a page loads and is scrolled through stays below a twentieth."""
    tab = browser.open(report / "method.html", width=width)
    watch = """(() => { window.moved = 0;
        const sum = (found) => { for (const e of found.getEntries()) window.moved += e.value; };
        new PerformanceObserver(sum).observe({ type: "layout-shift", buffered: true }); })()"""
    for page in (
        "index.html",
        "problem-pendulum.html",
        "cost.html",
        "runs/aa01.html",
        *(p.name for p in report.glob("theatre-pendulum.html")),
    ):
        tab.goto(report / page)
        tab.evaluate(watch)
        tab.evaluate("scrollTo(0, document.body.scrollHeight)")
        tab.evaluate("new Promise((f) => setTimeout(f, 400))")
        assert tab.evaluate("window.moved") < 0.05, page


def test_numbers_drawn_are_those_of_the_series(report, browser):
    """Unpacked in the browser: times to 1/8190 of the run, errors to a tenth of a percent, zeros as zeros."""
    tab = drawn(browser, report / "problem-pendulum.html")
    found = tab.evaluate(
        "MBS.plotted.plots.find((p) => p.name === 'energy').traces.find((t) => t.urls && t.urls[0].includes('aa01'))"
    )
    made = make_swing()
    expected = find_maxima(made["t"], made["energy_error"], 2.0)
    assert len(found["x"]) == len(expected)
    np.testing.assert_allclose(found["x"], expected.t, atol=2.0 / 8190 + 1e-5)
    np.testing.assert_allclose(found["y"], expected.y, rtol=1.1e-3)
    points = tab.evaluate("MBS.plotted.plots.find((p) => p.name === 'work-error-cpu') !== undefined")
    assert points and tab.faults == []


def test_axis_switch_csv_svg_and_table(report, browser):
    """Linear axis on demand; what is saved and told in the table are the numbers drawn."""
    tab = drawn(browser, report / "problem-pendulum.html")
    figure, low = (
        "document.querySelector('[data-plot=energy]').closest('figure')",
        "MBS.plotted.view('energy').range.y[0]",
    )
    log = tab.evaluate("MBS.plotted.plots.find((p) => p.name === 'energy').y.log")
    tab.evaluate(f"[...{figure}.querySelectorAll('.tools button')].find((b) => b.textContent === 'log y').click()")
    assert log and tab.evaluate("MBS.plotted.plots.find((p) => p.name === 'energy').y.log") is False
    assert tab.evaluate(low) >= 0.0
    csv = tab.evaluate("MBS.plotted.csv('energy')").splitlines()
    assert csv[0] == "series,t [s],|E − E₀| [J],end"
    assert any(line.startswith('"alpha') for line in csv) and any(line.endswith(",failed") for line in csv)
    svg = tab.evaluate("MBS.plotted.svg('energy')")
    assert svg.startswith("<svg") and "alpha" in svg and "Energy error" in svg
    tab.evaluate(f"{figure}.querySelector('details').open = true")
    tab.until(f"{figure}.querySelector('details table')")
    assert "stopped here" in tab.evaluate(f"{figure}.querySelector('details').textContent")
    assert tab.faults == []


def test_a_zero_is_drawn_hollow_and_said_to_be_at_most(matrices, browser):
    """A logarithmic axis has no place for it: a twentieth of the smallest value, 0.2 s, stands for it and says so."""
    tab = drawn(browser, matrices.parent / "problem-stuck.html", "work-error-cpu")
    hollow = "[...document.querySelectorAll('[data-plot=work-error-cpu] .open')].map((e) => e.dataset.solver)"
    assert tab.evaluate(hollow) == ["beta"]
    tab.evaluate("""(() => { const c = document.querySelector('[data-plot=work-error-cpu]');
        const [x, y] = MBS.plotted.view('work-error-cpu').places.find((p) => p[2].solver === 'beta');
        const { left, top } = c.getBoundingClientRect(), at = { clientX: left + x, clientY: top + y };
        c.dispatchEvent(new PointerEvent('pointermove', at)); })()""")
    assert "CPU time 0, drawn at 0.0100 s" in tab.evaluate("document.querySelector('.tip').textContent")
    assert "position error 0.333 m" in tab.evaluate("document.querySelector('.tip').textContent")
    tab.evaluate(
        "document.querySelector('[data-plot=work-error-cpu]').closest('figure').querySelector('details').open = true"
    )
    numbers = "document.querySelector('[data-plot=work-error-cpu]').closest('figure').querySelector('details tbody')"
    tab.until(numbers)
    assert "below the clock" in tab.evaluate(f"{numbers}.textContent")
    assert tab.faults == []


def test_a_plot_that_takes_keys_is_no_image(report, browser):
    """Of an image a screen reader passes on no keys: a plot is a group that says what it is."""
    tab = browser.open(report / "problem-pendulum.html")
    said = "['role', 'aria-roledescription', 'tabindex'].map((k) => e.getAttribute(k)).join()"
    assert set(tab.evaluate(f"[...document.querySelectorAll('[data-plot]')].map((e) => {said})")) == {"group,plot,0"}
    assert tab.evaluate("document.querySelectorAll('[tabindex][role=img]').length") == 0


def test_tables_of_pages_sort_by_value(report, browser):
    tab = browser.open(report / "problem-pendulum.html")
    tab.evaluate("document.querySelector('table.sortable thead th:nth-child(5) button').click()")
    values = tab.evaluate(
        "[...document.querySelector('table.sortable').tBodies[0].rows].map((r) => r.cells[4].dataset.v)"
    )
    numbers = [float(v) for v in values if v]
    assert len(numbers) > 3 and numbers == sorted(numbers)
    assert all(v == "" for v in values[len(numbers) :])
