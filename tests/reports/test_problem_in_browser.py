"""The page of a problem in a browser: plots draw, zoom, switch and save; tables sort."""

import numpy as np
import pytest

from mbsbench.harness.files import write_text
from mbsbench.reports import site
from mbsbench.reports.model.curves import upper

from .browser import OPEN
from .conftest import put, record, series


def test_plots_draw_and_the_legend_switches_them(report, browser):
    """Curves put pixels on the panel; without solvers there are none but axes."""
    tab = browser.open(report / "problem-pendulum.html")
    tab.evaluate("document.querySelector('[data-plot=energy]').scrollIntoView()")
    tab.until("document.querySelector('[data-plot=energy] .main-svg')")
    coloured = "document.querySelectorAll('[data-plot=energy] path.js-line, [data-plot=energy] .points path').length"
    drawn = tab.evaluate(coloured)
    ink = tab.ink("[data-plot=energy]", far=60)
    assert drawn >= 3 and ink > 0.01
    energy = "document.querySelector('[data-plot=energy]')"
    assert "limit 0.100 J" in tab.evaluate(f"{energy}.querySelector('.annotation').textContent")
    assert tab.evaluate(f"10 ** {energy}._fullLayout.yaxis.range[1]") > 0.1
    tab.evaluate("document.querySelectorAll('.legend button').forEach((b) => b.click())")
    tab.until(f"{coloured} === 0")
    assert tab.ink("[data-plot=energy]", far=60) < ink
    assert "nothing is selected" in tab.evaluate("document.querySelector('[data-plot=energy]').textContent")
    assert tab.faults == []
    tab.close()


def test_failures_are_starred_and_wrong_ones_crossed(report, browser):
    """At the last point that the solver made, in the group where they are."""
    tab = browser.open(report / "problem-pendulum.html")
    tab.evaluate("document.querySelector('[data-plot=energy]').scrollIntoView()")
    tab.until("document.querySelector('[data-plot=energy] .main-svg')")
    ends = tab.evaluate(
        "document.querySelector('[data-plot=energy]').data.filter((t) => t.customdata)"
        ".map((t) => [t.marker.symbol[0], t.x[0], t.meta.solver])"
    )
    assert ["star", pytest.approx(0.7, abs=1e-4), "delta"] in ends
    assert ["x", pytest.approx(2.0, abs=1e-4), "beta"] in ends
    tab.close()


def test_time_axes_zoom_together_and_back_by_the_keyboard(report, browser):
    tab = browser.open(report / "problem-pendulum.html", height=3000)
    tab.evaluate(OPEN)
    tab.until("document.querySelectorAll('[data-plot=energy] .main-svg, [data-plot=phi] .main-svg').length >= 2")
    span = (
        "(() => { const [a, b] = document.querySelector('[data-plot=phi]')._fullLayout.xaxis.range; return b - a; })()"
    )
    whole = tab.evaluate(span)
    tab.evaluate("document.querySelector('[data-plot=energy]').focus()")
    tab.press("+")
    tab.until(f"{span} < {0.7 * whole}")
    tab.press("0")
    tab.until(f"Math.abs({span} - {whole}) < 1e-6")
    tab.close()


def test_axes_leave_out_what_is_hidden(browser, tmp_path):
    """A coarse run that swings ten times as far is not drawn at first: it takes none of the axis until it is."""
    put(tmp_path, record("aa01", dt_s=0.005), series(size=1e-3))
    put(tmp_path, record("aa02", dt_s=0.05), series(size=9.0))
    write_text(tmp_path / "environment.json", "{}")
    tab = browser.open(site.build(tmp_path).parent / "problem-pendulum.html")
    tab.evaluate(OPEN)
    tab.evaluate("document.querySelector('[data-plot=obs-theta]').scrollIntoView()")
    tab.until("document.querySelector('[data-plot=obs-theta] .main-svg')")
    top = "document.querySelector('[data-plot=obs-theta]')._fullLayout.yaxis.range[1]"
    assert tab.evaluate(top) < 1.3
    ink = tab.ink("[data-plot=obs-theta]")
    tab.evaluate("document.querySelector('[data-switch=all]').click()")
    tab.until(f"{top} > 2.5")
    assert ink > 0.01 and tab.faults == []
    tab.close()


def test_numbers_drawn_are_those_of_the_series(report, browser):
    """Unpacked in the browser: times to 1/8190 of the run, errors to a tenth of a percent, zeros as zeros."""
    tab = browser.open(report / "problem-pendulum.html")
    tab.until("MBS.plotted")
    tab.evaluate("document.querySelector('[data-plot=energy]').scrollIntoView()")
    tab.until("document.querySelector('[data-plot=energy] .main-svg')")
    drawn = tab.evaluate(
        "MBS.plotted.plots.find((p) => p.name === 'energy').traces.find((t) => t.urls[0].includes('aa01'))"
    )
    made = series()
    expected = upper(made["t"], made["energy_error"], 2.0)
    assert len(drawn["x"]) == len(expected)
    np.testing.assert_allclose(drawn["x"], expected.t, atol=2.0 / 8190 + 1e-5)
    np.testing.assert_allclose(drawn["y"], expected.y, rtol=1.1e-3)
    points = tab.evaluate("MBS.plotted.plots.find((p) => p.name === 'work-error-cpu') !== undefined")
    assert points and tab.faults == []
    tab.close()


def test_axis_switch_csv_svg_and_table(report, browser):
    """Linear axis on demand; what is saved and told in the table are the numbers drawn."""
    tab = browser.open(report / "problem-pendulum.html")
    tab.evaluate("document.querySelector('[data-plot=energy]').scrollIntoView()")
    tab.until("document.querySelector('[data-plot=energy] .main-svg')")
    figure = "document.querySelector('[data-plot=energy]').closest('figure')"
    assert tab.evaluate("document.querySelector('[data-plot=energy]').layout.yaxis.type") == "log"
    tab.evaluate(f"[...{figure}.querySelectorAll('.tools button')].find((b) => b.textContent === 'log y').click()")
    tab.until("document.querySelector('[data-plot=energy]').layout.yaxis.type === 'linear'")
    csv = tab.evaluate("MBS.plotted.csv('energy')").splitlines()
    assert csv[0] == "series,t [s],|E − E₀| [J],end"
    assert any(line.startswith('"alpha') for line in csv) and any(line.endswith(",failed") for line in csv)
    svg = tab.evaluate("MBS.plotted.svg('energy')")
    assert svg.startswith("<svg") and "alpha" in svg and "Energy error" in svg
    tab.evaluate(f"{figure}.querySelector('details').open = true")
    tab.until(f"{figure}.querySelector('details table')")
    assert "stopped here" in tab.evaluate(f"{figure}.querySelector('details').textContent")
    assert tab.faults == []
    tab.close()


def test_a_zero_is_drawn_hollow_and_said_to_be_at_most(matrices, browser):
    """A logarithmic axis has no place for it: a twentieth of the smallest value, 0.2 s, stands for it and says so."""
    tab = browser.open(matrices.parent / "problem-stuck.html")
    tab.evaluate(OPEN)
    tab.evaluate("document.querySelector('[data-plot=work-error-cpu]').scrollIntoView()")
    tab.until("document.querySelector('[data-plot=work-error-cpu] .main-svg')")
    drawn = tab.evaluate(
        "document.querySelector('[data-plot=work-error-cpu]').data.filter((t) => t.marker)"
        ".map((t) => [t.meta.solver, t.x[0], [].concat(t.marker.symbol)[0].endsWith('-open'), [].concat(t.text)[0]])"
    )
    beta = next(d for d in drawn if d[0] == "beta")
    assert beta[1:3] == [pytest.approx(0.01), True]
    assert beta[3].startswith("CPU time 0, drawn at 0.0100 s<br>position error 0.333 m")
    assert not any(d[2] for d in drawn if d[0] == "alpha")
    tab.evaluate(
        "document.querySelector('[data-plot=work-error-cpu]').closest('figure').querySelector('details').open = true"
    )
    numbers = "document.querySelector('[data-plot=work-error-cpu]').closest('figure').querySelector('details tbody')"
    tab.until(numbers)
    assert "below the clock" in tab.evaluate(f"{numbers}.textContent")
    assert tab.faults == []
    tab.close()


def test_a_plot_that_takes_keys_is_no_image(report, browser):
    """Of an image a screen reader passes on no keys: a plot is a group that says what it is."""
    tab = browser.open(report / "problem-pendulum.html")
    said = "['role', 'aria-roledescription', 'tabindex'].map((k) => e.getAttribute(k)).join()"
    assert set(tab.evaluate(f"[...document.querySelectorAll('[data-plot]')].map((e) => {said})")) == {"group,plot,0"}
    assert tab.evaluate("document.querySelectorAll('[tabindex][role=img]').length") == 0
    tab.close()


def test_tables_of_pages_sort_by_value(report, browser):
    tab = browser.open(report / "problem-pendulum.html")
    tab.evaluate("document.querySelector('table.sortable thead th:nth-child(5) button').click()")
    values = tab.evaluate(
        "[...document.querySelector('table.sortable').tBodies[0].rows].map((r) => r.cells[4].dataset.v)"
    )
    numbers = [float(v) for v in values if v]
    assert len(numbers) > 3 and numbers == sorted(numbers)
    assert all(v == "" for v in values[len(numbers) :])
    tab.close()
