"""Pages of judgements in a browser: no fault, no request, a phone's width, filters, keyboard, plots, colours."""

import pytest
from msgspec.structs import replace

from mbsbench.harness.results.judgements.files import ORDERS, format_judgement
from mbsbench.reports.model.results import read_results
from mbsbench.tests.factories import make_measured_record, make_swing

from ..browser import LOW, OPEN, PALE, SMALL
from ..conftest import every_kind, put
from .conftest import PAGES, render
from .synthetic import orders

pytestmark = pytest.mark.browser
CHOOSE = """(() => { const s = document.querySelector("select[name=verdict]"); s.value = "%s";
    s.dispatchEvent(new Event("change")); })()"""


@pytest.fixture
def folder(judged_run, judged_pages):
    return judged_run.folder / "report"


@pytest.mark.parametrize(("width", "dark"), [(390, True), (1280, False)])
def test_pages_load_without_a_fault_and_fit(browser, folder, width, dark):
    """From the disk; nothing asked of a network; no sideways scroll; text stands out in light and dark."""
    for name in PAGES:
        tab = browser.open(folder / name, width=width, dark=dark)
        assert (tab.faults, tab.requests) == ([], []), name
        assert tab.evaluate("document.documentElement.scrollWidth") <= width, name
        assert tab.evaluate(PALE) == [], name
        if width < 600:
            tab.evaluate(OPEN)
            assert (tab.evaluate(SMALL), tab.evaluate(LOW)) == ([], []), name


@pytest.mark.parametrize("name", PAGES)
def test_axe_finds_no_violation(axe, folder, name):
    """Also where judgements are shown."""
    assert axe(folder / name) == []


def test_all_published_claims_fit_a_phone_and_are_searched(browser, tmp_path):
    """Those that carry the paper, the field's, the rest folded: less than ten screens; words find one, a link too."""
    put(tmp_path, make_measured_record("aa01"), make_swing(40))
    render(read_results(tmp_path), [PAGES["claims.html"]])
    tab = browser.open(tmp_path / "report" / "claims.html", width=390, height=844)
    assert tab.evaluate("document.documentElement.scrollHeight") < 10 * 844
    shown = "[...document.querySelectorAll('[data-item]')].filter((e) => !e.hidden)"
    whole = tab.evaluate(f"{shown}.length")
    search = "document.querySelector('.filters input[type=search]')"
    tab.evaluate(f"{search}.value = 'one step'; {search}.dispatchEvent(new Event('input'))")
    assert 0 < tab.evaluate(f"{shown}.length") < whole
    folded = "[...document.querySelectorAll('details[data-item]')].filter((e) => !e.hidden)"
    first = tab.evaluate(f"{folded}[0].id")
    assert tab.evaluate(
        f"document.getElementById('{first}').closest('.group').open"
    )  # what is found is not folded away
    tab.evaluate("document.querySelectorAll('.group').forEach((e) => { e.open = false; })")
    tab.evaluate(f"location.hash = '#{first}'")
    tab.until(f"document.getElementById('{first}').open && document.getElementById('{first}').closest('.group').open")
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390 and tab.faults == []


def test_claims_filter_and_their_map_obeys_the_arrow_keys(browser, folder):
    tab = browser.open(folder / "claims.html")
    shown = "[...document.querySelectorAll('[data-item]')].filter((e) => !e.hidden).length"
    assert tab.evaluate(shown) == 9
    tab.evaluate(CHOOSE % "reproduced if")
    assert tab.evaluate(shown) == 2
    assert tab.evaluate("document.querySelector('.filters [role=status]').textContent") == "2 of 9 shown"
    boxes = "document.querySelectorAll('[data-grid] .box')"
    assert tab.evaluate(f"[...{boxes}].filter((b) => b.tabIndex === 0).length") == tab.evaluate(
        "document.querySelectorAll('[data-grid]').length"
    )  # one stop of the tab key a map
    tab.evaluate(CHOOSE % "*")  # not every claim has a map
    tab.evaluate("document.querySelectorAll('.claim, .claim details').forEach((e) => { e.open = true; })")
    grid = "document.querySelector('.claim:not([hidden]) [data-grid]')"
    tab.evaluate(f"{grid}.querySelector('.box').focus()")
    first = tab.evaluate("document.activeElement.getAttribute('aria-label')")
    assert tab.evaluate(f"{grid}.querySelector('.readout').textContent") == first
    tab.press("ArrowRight")
    second = tab.evaluate("document.activeElement.getAttribute('aria-label')")
    assert second != first and tab.evaluate(f"{grid}.querySelector('.readout').textContent") == second


def test_thousands_of_certificates_are_paged_and_the_address_keeps_the_choice(browser, tmp_path):
    """No page has more rows than one reads; what is chosen, and where, a link shows again."""
    every_kind(tmp_path)
    quantities, one = ("position", "velocity"), orders(["aa01"])[0]
    many = [replace(one, case=f"ladder {k}", quantity=quantities[k % 2]) for k in range(1250)]
    (tmp_path / "judgement").mkdir()
    (tmp_path / "judgement" / f"{ORDERS.name}.json").write_text(format_judgement(tuple(many)), encoding="utf-8")
    render(read_results(tmp_path), [PAGES["solver-alpha.html"]])
    page, rows = tmp_path / "report" / "solver-alpha.html", "document.querySelectorAll('#orders-table tbody tr')"
    said = "document.querySelector('#orders-table ~ .pager output').textContent"
    tab = browser.open(page)
    assert tab.evaluate(f"{rows}.length") == 100 and tab.evaluate(said) == "rows 1 to 100 of 1250"
    assert tab.evaluate("document.querySelectorAll('*').length") < 12_000  # with all rows 80,000
    tab.evaluate("document.querySelectorAll('#orders-table ~ .pager button')[1].click()")
    tab.evaluate("""(() => { const s = document.querySelector("[data-filters='#orders-table'] select[name=quantity]");
        s.value = "velocity"; s.dispatchEvent(new Event("change")); })()""")
    assert tab.evaluate(said) == "rows 1 to 100 of 625"
    tab.evaluate("document.querySelectorAll('#orders-table ~ .pager button')[1].click()")
    address = tab.evaluate("location.href")
    assert "orders-table.quantity=velocity" in address
    shown = tab.evaluate(f"[...{rows}].map((r) => r.cells[0].textContent)")
    tab.evaluate(f"location.href = {address!r}; window.seen = true; location.reload()")
    tab.until(f"!window.seen && document.readyState === 'complete' && {said} === 'rows 101 to 200 of 625'")
    assert tab.evaluate(f"[...{rows}].map((r) => r.cells[0].textContent)") == shown
    assert len(shown) == 100 and tab.faults == []
    tab.evaluate("document.querySelector('#orders-table thead button').click()")  # all rows are sorted, not these
    assert tab.evaluate(said) == "rows 1 to 100 of 625"


def test_a_link_to_a_hidden_claim_brings_it_back(browser, folder):
    tab = browser.open(folder / "claims.html")
    tab.evaluate(CHOOSE % "not reproduced")
    tab.evaluate("location.hash = '#first-claim'")
    tab.until("!document.getElementById('first-claim').hidden")


@pytest.mark.parametrize("page", ["cost.html", "solver-alpha.html"])
def test_plots_are_drawn(browser, folder, page):
    tab = browser.open(folder / page)
    tab.evaluate(OPEN)
    tab.evaluate("[...document.querySelectorAll('.canvas')].find((e) => e.clientWidth).classList.add('first')")
    tab.evaluate("document.querySelector('.canvas.first').scrollIntoView()")
    tab.until("document.querySelector('.canvas.first .axis')")
    assert tab.ink(".canvas.first") > 0.002
    assert tab.faults == []


def test_another_pair_of_work_and_error_shows_its_plots(browser, folder):
    tab = browser.open(folder / "cost.html")
    tab.evaluate("""(() => { const [error, over] = document.querySelectorAll("[data-choose='.field'] select");
        error.value = "energy"; over.value = "cpu"; error.dispatchEvent(new Event("change")); })()""")
    shown = (
        "[...document.querySelectorAll('.field [data-choice]')].filter((e) => !e.hidden).map((e) => e.dataset.choice)"
    )
    choices = tab.evaluate(shown)
    assert choices and set(choices) == {"energy-cpu"}
    tab.evaluate("document.querySelector('.field [data-choice]:not([hidden])').scrollIntoView()")  # drawn when seen
    tab.until("document.querySelector('.field [data-choice]:not([hidden]) .axis')")


def test_a_ladder_has_its_slope_triangle(browser, tmp_path):
    """Its sides and order are on the page and in the picture saved from it; a slope means nothing on a linear axis."""
    every_kind(tmp_path)
    (tmp_path / "judgement").mkdir()
    one = replace(orders(["aa01"])[0], quantity="position")
    (tmp_path / "judgement" / f"{ORDERS.name}.json").write_text(format_judgement((one,)), encoding="utf-8")
    render(read_results(tmp_path), [PAGES["solver-alpha.html"]])
    tab = browser.open(tmp_path / "report" / "solver-alpha.html", width=1280)
    tab.evaluate(OPEN)
    find = "MBS.plotted.plots.find((p) => p.triangles)"
    tab.evaluate(f"{find}.canvas.scrollIntoView()")
    tab.until(f"{find}.picture.querySelector('.slope')")
    shapes = f"{find}.picture.querySelectorAll('.slope').length"
    assert tab.evaluate(shapes) == 1 and tab.evaluate(f"{find}.triangles[0].order") == 2
    assert "2" in tab.evaluate(f"[...{find}.picture.querySelectorAll('text')].map((t) => t.textContent)")
    assert 'class="slope"' in tab.evaluate(f"MBS.plotted.svg({find}.name)")
    tab.evaluate(f"[...{find}.canvas.closest('figure').querySelectorAll('button')][0].click()")
    assert tab.evaluate(shapes) == 0 and tab.faults == []
