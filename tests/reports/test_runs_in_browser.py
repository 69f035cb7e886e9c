"""The table of all runs in a browser: it sorts, filters and is paged; cards on a phone."""

import pytest

from mbsbench.harness.base.files import write_text
from mbsbench.reports import site
from mbsbench.tests.factories import make_measured_record

from .browser import LOW, OPEN, OVERFLOW, SMALL
from .conftest import put

SET = (
    "((name, value) => {{ const e = document.forms[0].elements[name]; e.value = value; "
    "e.dispatchEvent(new Event('input', {{bubbles: true}})); }})({}, {})"
)


@pytest.mark.sampled(0)
def test_thousands_of_runs_are_paged_and_the_address_keeps_the_choice(browser, tmp_path):
    """100 rows a page, few nodes; a filter, an order and a page are in the address and come back with it."""
    for k in range(230):
        put(
            tmp_path,
            make_measured_record(f"r{k:03}", dt_s=1e-4 * (k + 1), status="success" if k % 2 else "wrong", label="map"),
        )
    write_text(tmp_path / "environment.json", "{}")
    tab = browser.open(site.build_report(tmp_path).parent / "runs.html")
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


def test_on_a_phone_a_run_is_a_card_led_by_its_status(report, browser):
    """Status and reason on top, over the whole width, the solver below; nothing to be pushed sideways."""
    for page in ("runs.html", "problem-pendulum.html"):
        tab = browser.open(report / page, width=390)
        tab.evaluate(OPEN)
        table = "document.querySelector('table.cards')"
        tab.until(f"{table}.tBodies[0].rows.length > 2")
        row = f"[...{table}.tBodies[0].rows].find((r) => r.textContent.includes('stuck'))"
        top = f"{row}.querySelector('.status').getBoundingClientRect()"
        assert tab.evaluate(f"{top}.top < {row}.querySelector('th').getBoundingClientRect().top")
        assert tab.evaluate(f"{top}.width") > 250 and tab.evaluate(f"{row}.getBoundingClientRect().right") <= 390
        assert tab.evaluate(OVERFLOW) == 0 and tab.faults == []


def test_on_a_phone_text_and_targets_are_large_enough(report, browser):
    """No text below 12 px, no control below 24 px high; links in running text are not controls."""
    tab = browser.open(report / "runs.html", width=390)
    assert tab.evaluate(SMALL) == [] and tab.evaluate(LOW) == []


def test_runs_sort_and_filter(report, browser, built):
    """By status and by words in any text; sorted by value, with what is not there last."""
    tab = browser.open(report / "runs.html")
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
