"""CSV and LaTeX hold the numbers of the page, for every run."""

import csv
import io
import math

from mbsbench.reports.model.results import Run, read_results
from mbsbench.reports.model.tables import COLUMNS, csv_of, latex_number, latex_of, latex_text
from mbsbench.reports.model.words import number, seconds, signed, unit, whole

from .conftest import HOSTILE, record


def test_csv_has_every_run_in_full(built):
    folder, records, _ = built
    runs = read_results(folder).variants[0].runs
    rows = list(csv.DictReader(io.StringIO(csv_of(runs))))
    assert len(rows) == len(runs)
    for row, run in zip(rows, runs, strict=True):
        value = row["energy_drift_max [J]"]
        expected = run.record.energy_drift_max_J
        assert value == "" if math.isnan(expected) else float(value) == expected
        assert bool(row["reason"]) == (run.status != "success")
    assert {c.variant for p in read_results(folder).variants for c in p.runs} >= {r.problem for r in records}


def test_latex_has_every_run_and_no_open_command(built):
    """As many columns in each row, and nothing of the hostile text works as a command."""
    folder, _, _ = built
    for variant in read_results(folder).variants:
        text = latex_of(variant.title, variant.runs)
        rows = [line for line in text.splitlines() if line.endswith(r"\\")]
        assert len(rows) == len(variant.runs) + 1
        assert len({row.replace(r"\&", "").count("&") for row in rows}) == 1
        assert r"\frac" not in "\n".join(rows)


def test_latex_text_is_safe():
    assert latex_text("a_b & 5 %\nc") == r"a\_b \& 5 \% c"
    assert "$x" not in latex_text(HOSTILE).replace(r"\$", "")


def test_latex_numbers_have_the_digits_of_the_page():
    for value in (0.0, 1.234e-7, -0.01234, 5.6789e7, 3.0e12):
        shown = latex_number(value, number(value)).strip("$").replace(r"\times 10^{", "e").replace("}", "")
        assert float(shown) == float(f"{value:.2e}")
    assert latex_number(math.nan, "") == "--"


def test_numbers_are_written_for_readers():
    assert [number(x) for x in (0.0, 1.0, 0.00123, 1.23e-5, -4.5e7, math.nan, math.inf)] == [
        "0", "1.00", "0.00123", "1.23×10⁻⁵", "−4.50×10⁷", "–", "∞",
    ]  # fmt: skip
    assert number(9.999) == "10.0"
    assert signed(0.5) == "+0.500" and whole(1234567.0) == "1\u202f234\u202f567"
    assert seconds(0.0123) == "12.3 ms" and unit("kg m2/s") == "kg m²/s"


def test_a_cpu_time_too_short_for_the_clock_is_no_zero():
    """It took some time: a reader is told that the clock says none, in LaTeX as text."""
    run = Run(record("aa01", cpu_median_s=0.0))
    column = next(c for c in COLUMNS if c.key == "cpu_median")
    assert column.text(run) == seconds(0.0) == "below the clock"
    assert "& below the clock" in latex_of("p", [run])
