"""CSV and LaTeX hold the numbers of the page, for every run."""

import csv
import io
import math

import pytest

from mbsbench.harness.results.shadows import NearestMotion
from mbsbench.reports import site
from mbsbench.reports.model.accuracy import choose_measure
from mbsbench.reports.model.columns import COLUMNS
from mbsbench.reports.model.results import StoredRun, read_results
from mbsbench.reports.model.tables import escape_latex, format_as_csv, format_as_latex, format_latex_number
from mbsbench.reports.model.words import format_count, format_signed, number, seconds, unit
from mbsbench.reports.plots.work import list_points
from mbsbench.tests.factories import make_measured_record, make_swing

from .conftest import HOSTILE, put


def test_csv_has_every_run_in_full(built):
    folder, records, _ = built
    runs = read_results(folder).variants[0].runs
    rows = list(csv.DictReader(io.StringIO(format_as_csv(runs))))
    assert len(rows) == len(runs)
    for row, run in zip(rows, runs, strict=True):
        value = row["energy_drift_max [J]"]
        expected = run.record.energy_drift_max_J
        assert value == "" if math.isnan(expected) else float(value) == expected
        assert bool(row["reason"]) == (run.status != "success")
    assert {c.variant for p in read_results(folder).variants for c in p.runs} >= {r.problem for r in records}


def test_latex_text_is_safe():
    assert escape_latex("a_b & 5 %\nc") == r"a\_b \& 5 \% c"
    assert "$x" not in escape_latex(HOSTILE).replace(r"\$", "")


def test_latex_numbers_have_the_digits_of_the_page():
    for value in (0.0, 1.234e-7, -0.01234, 5.6789e7, 3.0e12):
        shown = format_latex_number(value, number(value)).strip("$").replace(r"\times 10^{", "e").replace("}", "")
        assert float(shown) == float(f"{value:.2e}")
    assert format_latex_number(math.nan, "") == "--"


def test_numbers_are_written_for_readers():
    assert [number(x) for x in (0.0, 1.0, 0.00123, 1.23e-5, -4.5e7, math.nan, math.inf)] == [
        "0",
        "1.00",
        "0.00123",
        "1.23×10⁻⁵",
        "−4.50×10⁷",
        "–",
        "∞",
    ]
    assert number(9.999) == "10.0"
    assert format_signed(0.5) == "+0.500" and format_count(1234567.0) == "1\u202f234\u202f567"
    assert seconds(0.0123) == "12.3 ms" and unit("kg m2/s") == "kg m²/s"


def test_the_nearest_true_motion_is_beside_the_verdict_inaccurate():
    """Chaos makes the error large; a run that succeeds says nothing of it but in its columns."""
    near = NearestMotion(20.0, 4.3e-3, 6.9e-4, 8e-5)
    run = StoredRun(make_measured_record("aa01", status="inaccurate"), nearest=near)
    assert run.reasons[-1] == "yet a true motion within 4.3 mm (rms 0.69 mm) over 20 s"
    shown = {c.key: c.text(run) for c in COLUMNS}
    assert (shown["true_motion"], shown["true_motion_until"], shown["symplectic"]) == ("0.00430", "20", "not shown")
    assert not StoredRun(
        make_measured_record("aa02"), nearest=near
    ).reasons and ",0.0043,20.0,not shown," in format_as_csv([run])


def test_a_cpu_time_too_short_for_the_clock_is_no_zero():
    """It took some time: a reader is told that the clock says none, in LaTeX as text."""
    run = StoredRun(make_measured_record("aa01", cpu_median_s=0.0))
    column = next(c for c in COLUMNS if c.key == "cpu_median")
    assert column.text(run) == seconds(0.0) == "below the clock"
    assert "& below the clock" in format_as_latex("p", [run])


def test_pages_tables_and_plots_have_one_error_over_one_interval(tmp_path):
    """A chain is judged to 0.5 s and compared to 2 s: 0.4 m of the chaotic rest beside 0.001 m would contradict."""
    chaos = {"judged_to_s": 0.5, "position_error_judged_m": 1e-3, "position_error_max_m": 0.4}
    put(tmp_path, make_measured_record("aa01", **chaos))
    put(tmp_path, make_measured_record("aa02", dt_s=0.005, **chaos))
    (variant,) = read_results(tmp_path).variants
    measure = choose_measure(variant.runs)
    assert measure is not None and measure.until == 0.5
    (row, _) = csv.DictReader(io.StringIO(format_as_csv(variant.runs)))
    assert (float(row["position_error [m]"]), float(row["position_error_whole [m]"])) == (1e-3, 0.4)
    assert measure.of(variant.runs[0]) == list_points(variant)[0].errors["error"] == 1e-3
    latex = format_as_latex(variant.title, variant.runs)
    assert "errors up to 0.5 s" in latex and "$0.00100$" in latex and "$0.400$" not in latex


def test_of_runs_with_the_same_settings_the_latest_is_shown(tmp_path):
    """Results that were resumed after a change of the code hold both: one solver would count twice."""
    put(tmp_path, make_measured_record("old", settings_id="s", finished="2026-01-01T00:00:00Z", energy_drift_max_J=1.0))
    put(tmp_path, make_measured_record("new", settings_id="s", finished="2026-01-02T00:00:00Z"))
    put(tmp_path, make_measured_record("other", "beta"))
    found = read_results(tmp_path)
    assert {c.record.run_id for c in found.runs} == {"new", "other"}
    assert found.made_again == 1
    put(tmp_path, make_measured_record("older", settings_id="s", finished="2025-01-01T00:00:00Z"))
    assert read_results(tmp_path).made_again == 2


@pytest.mark.parametrize(
    "ending",
    [
        {"status": "crashed", "ended_by": "killed"},
        {"status": "crashed", "signal": 11},
        {"status": "stalled", "ended_by": "total_limit"},
    ],
)
def test_a_later_run_that_was_killed_or_crashed_hides_no_success(ending, tmp_path):
    """Its end says nothing about the settings; a later run that came to its own end does replace it."""
    put(tmp_path, make_measured_record("good", settings_id="s", finished="2026-01-01T00:00:00Z"))
    put(tmp_path, make_measured_record("cut", settings_id="s", finished="2026-01-03T00:00:00Z", **ending))
    found = read_results(tmp_path)
    assert [c.record.run_id for c in found.runs] == ["good"]
    assert (found.made_again, found.cut_short) == (0, 1)
    put(tmp_path, make_measured_record("lost", settings_id="s", finished="2026-01-02T00:00:00Z", status="diverged"))
    assert [c.record.run_id for c in read_results(tmp_path).runs] == ["lost"]
    put(
        tmp_path,
        make_measured_record("first", "beta", settings_id="b", finished="2026-01-01T00:00:00Z", status="diverged"),
    )
    put(tmp_path, make_measured_record("then", "beta", settings_id="b", finished="2026-01-02T00:00:00Z", **ending))
    assert "then" in {c.record.run_id for c in read_results(tmp_path).runs}  # of no success the latest


def test_a_later_run_with_a_damaged_series_hides_no_earlier_one(tmp_path):
    """It is listed as unreadable; the earlier one stands in for it."""
    put(tmp_path, make_measured_record("good", settings_id="s", finished="2026-01-01T00:00:00Z"), make_swing())
    put(tmp_path, make_measured_record("damaged", settings_id="s", finished="2026-01-02T00:00:00Z"), make_swing())
    (tmp_path / "series" / "damaged.npz").write_bytes(b"no archive")
    found = read_results(tmp_path)
    assert [c.record.run_id for c in found.runs] == ["good"] and found.made_again == 0
    assert [path.name for path in found.unreadable] == ["damaged.json"]


def test_the_stated_error_of_the_reference_is_told_where_errors_are_judged(tmp_path):
    """It grows with time: at the horizon it is larger than the errors of runs, which are judged before."""
    own = {"reference": "exact", "reference_horizon_s": 5.0, "t_end_s": 20.0, "judged_to_s": 1.5}
    put(
        tmp_path,
        make_measured_record(
            "aa", t_reached_s=20.0, reference_own_error_m=1e-3, reference_own_error_judged_m=2e-9, **own
        ),
    )
    put(tmp_path, make_measured_record("bb", "beta", "diverged", t_reached_s=0.1, reference_own_error_m=1e-11, **own))
    page = (site.build_report(tmp_path).parent / "problem-pendulum.html").read_text(encoding="utf-8")
    assert "0.00100 m up to 5 s, 2.00×10⁻⁹ m up to 1.5 s, where errors are judged</p>" in page
