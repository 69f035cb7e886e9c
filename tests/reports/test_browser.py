"""The site in a browser: no fault, no request, fits a phone, plots draw, tables sort and filter, colours are read."""

import json
import re
import time

import numpy as np
import pytest

from mbsbench.harness.results import store
from mbsbench.reports import site
from mbsbench.reports.model.curves import upper

from .conftest import because, put, record, series

PAGES = ("index.html", "problem-pendulum.html", "solver-beta.html", "runs/dd01.html", "runs/gg01.html")
OVERFLOW = "document.documentElement.scrollWidth - innerWidth"
OPEN = "document.querySelectorAll('details').forEach((e) => { e.open = true; })"
FIRST = "document.querySelectorAll('.plots .main-svg').length > 0"
CONTRAST = """
(() => {
  const numbers = (c) => c.match(/[\\d.]+/g).map(Number);
  const linear = (v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
  const light = (c) => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
  const behind = (e) => {
    for (; e; e = e.parentElement) {
      const c = numbers(getComputedStyle(e).backgroundColor);
      if (c.length < 4 || c[3] === 1) return c;
    }
    return [255, 255, 255];
  };
  const says = (e) => [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim()) && e.getClientRects().length;
  const out = [];
  for (const e of document.querySelectorAll("main *, nav *, footer *")) {
    if (e.closest("svg") || !says(e)) continue;
    const style = getComputedStyle(e), [a, b] = [light(numbers(style.color)), light(behind(e))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    if (ratio < (large ? 3 : 4.5)) out.push(`${e.tagName}.${e.className} ${ratio.toFixed(2)}`);
  }
  return out;
})()
"""
SET = (
    "((name, value) => {{ const e = document.forms[0].elements[name]; e.value = value; "
    "e.dispatchEvent(new Event('input', {{bubbles: true}})); }})({}, {})"
)


@pytest.fixture
def report(built):
    return built[0] / "report"


@pytest.mark.parametrize(("width", "dark"), [(390, True), (1280, False)], ids=["phone, dark", "desk, light"])
@pytest.mark.parametrize("name", PAGES)
def test_page_loads_fits_and_can_be_read(report, browser, name, width, dark):
    """No console fault, nothing asked of a network, no sideways scroll, contrast of WCAG AA."""
    tab = browser.open(report / name, width=width, dark=dark)
    if "plots" in tab.evaluate("[...document.scripts].map((s) => s.src).join()"):
        tab.evaluate("document.querySelector('.plots').scrollIntoView()")
        tab.until(FIRST)
    assert tab.evaluate(OVERFLOW) == 0 and tab.evaluate("innerWidth") == width
    assert tab.evaluate(CONTRAST) == []
    assert tab.faults == [] and tab.requests == []
    tab.close()


def test_contrast_is_measured(report, browser):
    """Grey on grey is found: the measure above is not blind."""
    tab = browser.open(report / "index.html")
    tab.evaluate("document.querySelector('h1').style.color = '#bbb'")
    assert any(found.startswith("H1") for found in tab.evaluate(CONTRAST))
    tab.close()


def test_plots_draw_and_the_legend_switches_them(report, browser):
    """Curves put pixels on the panel; without solvers there are none but axes."""
    tab = browser.open(report / "problem-pendulum.html")
    tab.evaluate("document.querySelector('[data-plot=energy]').scrollIntoView()")
    tab.until("document.querySelector('[data-plot=energy] .main-svg')")
    coloured = "document.querySelectorAll('[data-plot=energy] path.js-line, [data-plot=energy] .points path').length"
    drawn = tab.evaluate(coloured)
    ink = tab.ink("[data-plot=energy]", far=60)
    assert drawn >= 3 and ink > 0.01
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
    store.write_text(tmp_path / "environment.json", "{}")
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


def test_thousands_of_runs_are_paged_and_the_address_keeps_the_choice(browser, tmp_path):
    """100 rows a page, few nodes; a filter, an order and a page are in the address and come back with it."""
    for k in range(230):
        put(tmp_path, record(f"r{k:03}", dt_s=1e-4 * (k + 1), status="success" if k % 2 else "wrong", label="map"))
    store.write_text(tmp_path / "environment.json", "{}")
    tab = browser.open(site.build(tmp_path))
    rows = "document.querySelectorAll('[data-runs] tbody tr').length"
    tab.until(f"{rows} === 100")
    assert tab.evaluate("document.querySelectorAll('*').length") < 6000
    tab.evaluate(SET.format("'status'", "'wrong'"))
    tab.evaluate("document.querySelectorAll('[data-pager] button')[1].click()")
    assert tab.evaluate(rows) == 15
    assert "rows 101 to 115 of 115" in tab.evaluate("document.querySelector('[data-pager] output').textContent")
    address = tab.evaluate("location.search")
    assert address == "?status=wrong&page=2"
    tab.evaluate("window.before = true; location.reload()")
    tab.until(f"!window.before && {rows} === 15")
    assert tab.evaluate("document.forms[0].elements.status.value") == "wrong" and tab.faults == []
    tab.close()


def test_on_a_phone_a_run_is_a_card_led_by_its_status(report, browser):
    """Status and reason on top, over the whole width, the solver below; nothing to be pushed sideways."""
    for page in ("index.html", "problem-pendulum.html"):
        tab = browser.open(report / page, width=390)
        tab.evaluate(OPEN)
        table = "document.querySelector('table.cards')"
        tab.until(f"{table}.tBodies[0].rows.length > 2")
        row = f"[...{table}.tBodies[0].rows].find((r) => r.textContent.includes('stuck'))"
        top = f"{row}.querySelector('.status').getBoundingClientRect()"
        assert tab.evaluate(f"{top}.top < {row}.querySelector('th').getBoundingClientRect().top")
        assert tab.evaluate(f"{top}.width") > 250 and tab.evaluate(f"{row}.getBoundingClientRect().right") <= 390
        assert tab.evaluate(OVERFLOW) == 0 and tab.faults == []
        tab.close()


def test_on_a_phone_text_and_targets_are_large_enough(report, browser):
    """No text below 12 px, no control below 24 px high; links in running text are not controls."""
    tab = browser.open(report / "index.html", width=390)
    small = """[...document.querySelectorAll("main *")].filter((e) => !e.closest("svg, .hidden")
      && e.getClientRects().length && [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())
      && parseFloat(getComputedStyle(e).fontSize) < 11.95)
      .map((e) => `${e.tagName}.${e.className} ${getComputedStyle(e).fontSize}`)"""
    low = """[...document.querySelectorAll("main button, main select, main input, main summary, .heat td > a")]
      .filter((e) => e.getClientRects().length && e.getBoundingClientRect().height < 24)
      .map((e) => `${e.tagName}.${e.className} ${e.getBoundingClientRect().height}`)"""
    assert tab.evaluate(small) == [] and tab.evaluate(low) == []
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


def test_a_runs_page_explains_its_numbers(report, browser):
    tab = browser.open(report / "runs/aa01.html")
    assert tab.evaluate("[...document.querySelectorAll('nav li a')].map((a) => a.textContent)")[:1] == ["Claims"]
    said = tab.evaluate("document.querySelector('[data-meanings]').textContent")
    assert "Time of the last accepted step." in said and "Matrix factorisations" not in said
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


def test_hostile_names_stay_text_in_plots(report, browser):
    """A solver's name is no markup, in legends, labels and tables made by scripts."""
    tab = browser.open(report / "runs/gg01.html")
    tab.until(FIRST)
    assert tab.evaluate("document.querySelectorAll('main script, main img').length") == 0
    tab.goto(report / "index.html")
    tab.until("document.querySelector('[data-runs]').textContent.includes('alert(\"1\")')")
    assert tab.evaluate("document.querySelectorAll('main script').length") == 0
    tab.close()


def test_runs_sort_and_filter(report, browser, built):
    """By status and by words in any text; sorted by value, with what is not there last."""
    tab = browser.open(report / "index.html")
    count = "document.querySelectorAll('[data-runs] tbody tr').length"
    tab.until(f"{count} === {len(built[1])}")
    tab.evaluate(SET.format("'status'", "'wrong'"))
    assert tab.evaluate(count) == sum(r.status == "wrong" for r in built[1])
    assert tab.evaluate("document.querySelector('[data-count]').textContent") == f"1 of {len(built[1])} runs"
    tab.evaluate(SET.format("'status'", "''"))
    tab.evaluate(SET.format("'text'", "'stuck delta'"))
    assert tab.evaluate(count) == 1
    tab.evaluate(SET.format("'text'", "''"))
    tab.evaluate("document.querySelector('[data-runs] thead th:nth-child(7) button').click()")
    shown = tab.evaluate("[...document.querySelectorAll('[data-runs] tbody tr')].map((r) => r.cells[6].textContent)")
    there = [t for t in shown if t not in ("–", "")]
    assert shown[: len(there)] == there
    head = "document.querySelector('[data-runs] th:nth-child(7)').getAttribute('aria-sort')"
    assert tab.evaluate(head) == "ascending"
    tab.close()


@pytest.fixture(scope="module")
def matrices(tmp_path_factory):
    """Four problems, one without a run of beta, under two labels; a variant that must change nothing."""
    folder = tmp_path_factory.mktemp("matrices")
    ends = {"far": ("success", 3e-2, 9.0), "near": ("success", 5e-9, 0.05), "stuck": ("diverged", 1e-12, 0.0)}
    for k, (name, (status, size, cpu)) in enumerate(ends.items()):
        own = {"problem": name, "section": f"Sect. {k}", "position_error_max_m": size, "cpu_median_s": cpu}
        put(folder, record(f"a{k}", "alpha", status, message="lost", **own | {"cpu_median_s": cpu or 0.2}),
            series(size=size))  # fmt: skip
        put(folder, record(f"b{k}", "beta", **own | {"position_error_max_m": 1.0 / (k + 1)}), series())
    put(folder, record("a3", "alpha", "wrong", problem="off", section="Sect. 3", position_error_max_m=1e-5,
                       wrong_because=because("far off")), series())  # fmt: skip
    for k, name in ((0, "far"), (1, "near"), (3, "off")):
        put(
            folder,
            record(f"c{k}", problem=name, section=f"Sect. {k}", label="map", dt_s=0.1,
                           position_error_max_m=4.0 - k), series())  # fmt: skip
    store.write_text(folder / "environment.json", "{}")
    return site.build(folder)


def test_rows_of_a_matrix_sort_by_a_solvers_number_and_filter(matrices, browser):
    """By the number that is shown, those that stopped or did not run last either way; in the folded parts too."""
    tab = browser.open(matrices)
    rows = (
        "[...document.querySelectorAll('[data-part-of=\"{}\"] tbody tr:not([hidden]) th a')].map((a) => a.textContent)"
    )
    first, second = rows.format(1), rows.format(2)
    head = "document.querySelectorAll('[data-part-of=\"{}\"] thead th')[{}]"
    assert tab.evaluate(first) == ["far", "near", "stuck", "off"]
    tab.evaluate(f"{head.format(1, 1)}.querySelector('button').focus()")
    tab.press("Enter")
    assert tab.evaluate(first) == ["near", "off", "far", "stuck"]
    assert tab.evaluate(f"{head.format(1, 1)}.getAttribute('aria-sort')") == "ascending"
    assert tab.evaluate("document.activeElement.getAttribute('aria-label')") == "Sort by error of alpha"
    tab.press("Enter")
    assert tab.evaluate(first) == ["far", "off", "near", "stuck"]
    tab.evaluate("document.querySelector('[data-measure=cost]').click()")  # 9 s, 0.1 s, 50 ms
    assert tab.evaluate("document.activeElement.getAttribute('aria-label')") == "Sort by CPU time of alpha"
    assert tab.evaluate(first) == ["far", "off", "near", "stuck"]
    tab.evaluate(f"{head.format(1, 2)}.querySelector('button').click()")
    assert tab.evaluate(first) == ["stuck", "near", "far", "off"]  # 0, 50 ms, 9 s, not run
    tab.evaluate(f"{head.format(1, 0)}.querySelector('button').click()")
    assert tab.evaluate(first) == ["far", "near", "stuck", "off"]
    tab.evaluate("document.querySelector('[data-measure=error]').click()")
    tab.evaluate(f"{head.format(2, 1)}.querySelector('button').click()")
    assert tab.evaluate(second) == ["off", "near", "far"]
    pick = (
        "((key, value) => {{ const e = document.querySelector(`[data-rows=${{key}}]`); e.value = value; "
        "e.dispatchEvent(new Event('input', {{bubbles: true}})); }})({}, {})"
    )
    for has, left in (("wrong", ["off"]), ("stopped", ["stuck"]), ("succeeded", ["far", "near"]), ("refused", [])):
        tab.evaluate(pick.format("'has'", f"'{has}'"))
        assert tab.evaluate(first) == left
        assert tab.evaluate("document.querySelector('[data-rows-count]').textContent") == f"{len(left)} of 4 rows"
    tab.evaluate(pick.format("'has'", "''"))
    tab.evaluate(pick.format("'problem'", "'FA'"))
    assert (tab.evaluate(first), tab.evaluate(second)) == (["far"], ["far"])
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


def test_theme_follows_the_system_until_a_reader_chooses(report, browser):
    tab = browser.open(report / "index.html", dark=True)
    ground = "getComputedStyle(document.body).backgroundColor"
    dark = tab.evaluate(ground)
    tab.evaluate("document.querySelector('[data-theme-button]').click()")
    light = tab.evaluate(ground)
    assert sum(map(int, re.findall(r"\d+", dark))) < 150 < 600 < sum(map(int, re.findall(r"\d+", light)))
    end = time.monotonic() + 10.0
    kept = ""
    while kept != light and time.monotonic() < end:  # the browser hands its storage on to a new process a little later
        tab.goto(report / "problem-pendulum.html")
        kept = tab.evaluate(ground)
    assert kept == light  # the choice goes along
    tab.evaluate("localStorage.clear()")
    tab.close()


def test_numbers_of_scripts_are_those_of_pages(report, browser):
    """Two writers of numbers, one for the page and one in the browser, must agree."""
    from mbsbench.reports.model.words import number

    values = [0.0, 1.0, 0.00123, 1.23e-5, -4.5e7, 9.999, 12345.6, 99999.0, 0.1, 2.5e-300]
    tab = browser.open(report / "index.html")
    assert tab.evaluate(f"{json.dumps(values)}.map((v) => MBS.number(v))") == [number(v) for v in values]
    tab.close()
