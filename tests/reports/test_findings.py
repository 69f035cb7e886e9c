"""Sentences follow from the numbers; no winner is named that they do not show."""

from mbsbench.reports.model.accuracy import drifts, measure_for
from mbsbench.reports.model.findings import findings, findings_of
from mbsbench.reports.model.results import Run, read_results

from .conftest import because, put, record


def said(folder) -> str:
    results = read_results(folder)
    return " ".join(f.text for f in [*findings(results), *(f for p in results.variants for f in findings_of(p))])


def test_equal_errors_have_no_winner(tmp_path):
    """Within a quarter, and on both sides of each other in time."""
    put(tmp_path, record("aa01", "alpha", position_error_max_m=1.00e-3, cpu_median_s=0.10))
    put(tmp_path, record("bb01", "beta", position_error_max_m=1.10e-3, cpu_median_s=0.11))
    text = said(tmp_path)
    assert "alpha (dt = 0.01 s) and beta (dt = 0.01 s) (within 1.25 of each other)" in text
    assert "too close to distinguish" not in text  # neither is within 1e-3 of the size by much: alpha alone is
    put(tmp_path, record("cc01", "gamma", position_error_max_m=0.9e-3, cpu_median_s=0.12))
    assert "too close to distinguish: alpha (dt = 0.01 s) 0.100 s and gamma (dt = 0.01 s) 0.120 s" in said(tmp_path)


def test_errors_below_the_reference_own_are_not_ranked(tmp_path):
    put(tmp_path, record("aa01", "alpha", position_error_max_m=1e-14))
    put(tmp_path, record("bb01", "beta", position_error_max_m=5e-13))
    put(tmp_path, record("cc01", "gamma", position_error_max_m=1e-3))
    text = said(tmp_path)
    assert "not distinguished" in text and "Smallest" not in text


def test_a_wrong_run_wins_nothing(tmp_path):
    """However cheap and however near at its end."""
    put(
        tmp_path,
        record("aa01", "alpha", "wrong", position_error_max_m=1e-9, cpu_median_s=1e-6, wrong_because=because("x")),
    )
    put(tmp_path, record("bb01", "beta"))
    text = said(tmp_path)
    assert "Smallest position error of 1 success: 0.00100 m, beta" in text
    assert "Least CPU time with a position error within 0.00100 m (single timings): beta" in text


def test_two_steps_tell_a_ratio_and_no_order(tmp_path):
    """Orders are fitted to ladders, on the page of certificates."""
    put(tmp_path, record("aa01", dt_s=0.02, position_error_max_m=4e-3))
    put(tmp_path, record("aa02", dt_s=0.01, position_error_max_m=1e-3))
    text = said(tmp_path)
    assert "falls by 4.00, from 0.00400 to 0.00100 m" in text and "observed order" not in text


def test_a_saturated_error_and_one_of_rounding_are_called_so(tmp_path):
    """A body that is half a turn off cannot be further off; what grows with a finer step is not the scheme's."""
    turned = {"position_error_max_m": 0.0, "control": "dt"}
    for run, solver, dt, error in (("aa01", "alpha", 0.1, 3.14), ("aa02", "alpha", 0.01, 0.131),
                                   ("bb01", "beta", 0.1, 2e-10), ("bb02", "beta", 0.01, 1e-8)):  # fmt: skip
        put(tmp_path, record(run, solver, dt_s=dt, orientation_error_max_rad=error, **turned))
    text = said(tmp_path)
    assert (
        "alpha: from dt = 0.1 s to dt = 0.01 s the orientation error falls from 3.14 to 0.131 rad: at the larger"
        in text
    )
    assert "beta: from dt = 0.1 s to dt = 0.01 s the orientation error does not fall" in text and "order -" not in text


def test_tighter_tolerance_that_hurts_is_said(tmp_path):
    for run, rtol, error in (("aa01", 1e-3, 1e-4), ("aa02", 1e-6, 1e-2)):
        put(tmp_path, record(run, control="rtol", dt_s=float("nan"), rtol=rtol, position_error_max_m=error))
    assert "makes the position error larger, from 1.00×10⁻⁴ to 0.0100 m" in said(tmp_path)


def test_no_success_is_said(tmp_path):
    put(tmp_path, record("aa01", status="diverged", message="it blew up", t_reached_s=0.3))
    text = said(tmp_path)
    assert "No run solved this problem" in text and "ended at 0.3 of 2 s, diverged: it blew up" in text


def test_a_line_drifts_and_a_swing_does_not():
    """A straight line shifts its mean by three quarters of its largest value, a swing by nothing."""
    line = record("a", energy_drift_max_J=1.0, energy_mean_first_quarter_J=0.125, energy_mean_last_quarter_J=0.875)
    swing = record("b", energy_drift_max_J=1.0, energy_mean_first_quarter_J=0.5, energy_mean_last_quarter_J=0.51)
    unknown = record("c", energy_mean_first_quarter_J=float("nan"))
    assert [drifts(Run(r)) for r in (line, swing, unknown)] == [True, False, None]


def test_orientation_counts_where_positions_are_exact():
    """A body that only turns has no position error to compare."""
    turning = [Run(record("a", position_error_max_m=0.0)), Run(record("b", position_error_max_m=1e-15))]
    measure = measure_for(turning)
    assert measure is not None and measure.unit == "rad"
    assert measure_for([Run(record("c", position_error_max_m=float("nan")))]) is None


def test_chaotic_errors_are_compared_while_judged():
    """Beyond the horizon everybody is wrong: the error up to there is what is compared."""
    runs = [Run(record("a", position_error_max_m=1.0, position_error_judged_m=1e-4, judged_to_s=0.5))]
    measure = measure_for(runs)
    assert measure is not None and measure.of(runs[0]) == 1e-4 and "to 0.5 s" in measure.what
