"""Every measure finds the number that was put into the series, and has none where the run has none."""

import math
from dataclasses import replace

import numpy as np
import pytest

from mbsbench.harness.judge.referee.claims.measures import MEASURES, evaluate
from mbsbench.tests.factories import change_series, make_record, make_series

T = np.linspace(0.0, 10.0, 101)
SHORT = np.linspace(0.0, 4.0, 41)
WAVE = 2.0 - np.abs(T - 3.0)  # lowest at the ends; -WAVE is lowest at 3 s


@pytest.mark.parametrize(
    ("name", "arguments", "value"),
    [
        ("largest", {"series": "a"}, 7.0),
        ("largest", {"series": "a", "to": 4.0}, 3.0),
        ("highest", {"series": "a"}, 5.0),
        ("lowest", {"series": "a"}, -7.0),
        ("extent", {"series": "a"}, 12.0),
        ("value", {"series": "a", "at": 2.05}, 3.0),
        ("change", {"series": "a", "from": 2.0, "to": 6.0}, 2.0),
        ("leaves at", {"series": "a", "limit": 4.0}, 5.0),
        ("leaves at", {"series": "a", "limit": 70.0}, math.inf),
        ("grows", {"series": "a"}, 7.0 / 3.0),
        ("grows", {"series": "a", "floor": 8.0}, 1.0),
        ("keeps growing", {"series": "slope"}, 4.0 / 3.0),
        ("keeps growing", {"series": "a"}, 1.0),
        ("beginning", {"series": "a", "to": 4.0}, 3.0 / 7.0),
        ("peak over median", {"series": "a"}, 7.0 / 5.0),
        ("rate", {"series": "slope", "at": 0.0}, 2.0),
        ("drop at lowest", {"series": "fall", "low": "low", "within": 0.5}, -4.0),
        ("peak after lowest", {"series": "bump", "low": "low", "to": 9.0}, 0.2),
        ("energy ratio", {}, 3.0),
        ("away", {"of": "theta"}, 0.5),
    ],
)
def test_measures_find_what_was_put_in(name, arguments, value):
    """3 to 5 s, then 5, then -7 from 8 s on; a fall of 4 and a bump at the lowest point, at 3 s."""
    a = np.where(T < 4.95, 3.0, np.where(T < 7.95, 5.0, -7.0))
    theta = np.sin(T)
    s = make_series(
        T,
        a=a,
        slope=2.0 * T,
        low=-WAVE,
        fall=np.where(T < 2.95, 1.0, -3.0),
        bump=np.exp(-((T - 3.2) ** 2)),
        energy=np.linspace(2.0, 6.0, 101),
        obs_theta=theta + 0.5,
        ref_theta=np.where(T > 8.0, np.nan, theta),
    )
    assert evaluate(name, make_record(), s, arguments) == pytest.approx(value, rel=1e-9, nan_ok=True)


WHOLE = ("largest", "highest", "lowest", "extent", "grows", "keeps growing")
STEPS = ("step ratio", "irregularity", "typical step", "smallest step")


@pytest.mark.parametrize("name", [*WHOLE, *STEPS])
def test_a_run_that_stopped_has_no_number_of_the_whole_time(name):
    """Stopped at 4 of 10 s it must not look accurate; ``partial`` and a stretch it got through have a number."""
    stopped, of = (
        (make_record(t_reached_s=4.0), make_series(SHORT, a=np.ones(41))),
        {} if name in STEPS else {"series": "a"},
    )
    assert math.isnan(evaluate(name, *stopped, of))
    if "to" in MEASURES[name].takes:
        assert math.isnan(evaluate(name, *stopped, {**of, "to": 4.5}))
        assert not math.isnan(evaluate(name, *stopped, {**of, "to": 3.5}))
    if "partial" in MEASURES[name].takes:
        assert not math.isnan(evaluate(name, *stopped, {**of, "partial": True}))


def test_partial_takes_what_is_there_of_a_column():
    stopped = make_record(t_reached_s=4.0, phi_max=1.0)
    assert math.isnan(evaluate("column", stopped, None, {"name": "phi_max"}))
    assert evaluate("column", stopped, None, {"name": "phi_max", "partial": True}) == 1.0


def test_a_motion_that_became_nan_is_unbounded():
    """No number in a series is the largest of all errors; beyond a reference's horizon it is nothing.

    An observable is unbounded although its name ends as errors against a reference do.
    """
    names = ("a", "obs_axis_error", "position_error", "orientation_error")
    s = make_series(T, **dict.fromkeys(names, np.where(T > 5.0, np.nan, 1.0)))
    found = [evaluate("largest", make_record(), s, {"series": name}) for name in names]
    assert found == [math.inf, math.inf, 1.0, 1.0]


def test_ends_of_runs():
    """Failure times, parts reached, and losses of runs that stopped."""
    stopped = make_record(t_reached_s=4.0, position_error_judged_m=0.1, energy_mean_last_quarter_J=-0.2)
    ended = make_record(position_error_judged_m=0.1, energy_mean_last_quarter_J=-0.2)
    assert evaluate("stops at", stopped, None, {}) == 4.0 and evaluate("stops at", ended, None, {}) == math.inf
    assert evaluate("reached", stopped, None, {}) == 0.4 and evaluate("reached", ended, None, {}) == 1.0
    assert evaluate("stops at", make_record(t_reached_s=math.nan), None, {}) == 0.0
    assert evaluate("loss", stopped, None, {}) == math.inf and evaluate("loss", ended, None, {}) == 0.1
    turned = make_record(orientation_error_judged_rad=0.3)
    assert evaluate("orientation loss", stopped, None, {}) == math.inf
    assert evaluate("orientation loss", turned, None, {}) == 0.3
    assert math.isnan(evaluate("late energy", stopped, None, {})) and evaluate("late energy", ended, None, {}) == 0.2


def test_an_oscillation_rises_and_falls():
    """A sine of amplitude 2 rises and falls by 4; a drift, however large, does one of them alone."""
    wave, drift = 2.0 * np.sin(T), 50.0 * T
    assert evaluate("swing", make_record(), make_series(T, a=wave), {"series": "a"}) == pytest.approx(4.0, rel=1e-2)
    assert evaluate("swing", make_record(), make_series(T, a=drift), {"series": "a"}) == 0.0
    assert evaluate("swing", make_record(), make_series(T, a=drift + 40.0 * np.sin(3.0 * T)), {"series": "a"}) > 1.0


def test_corrections_are_counted_per_step_of_a_whole_run():
    counted = {"newton_iterations": 30.0, "steps": 10}
    assert evaluate("corrections per step", make_record(**counted), None, {}) == 3.0
    assert math.isnan(evaluate("corrections per step", make_record(t_reached_s=4.0, **counted), None, {}))


def test_steps_are_judged_after_the_start_up_and_without_the_last():
    """Steps 1e-6 at the start and 1e-9 at the end are not the solver's choice; 0.01 to 0.1 s between are."""
    dt = np.concatenate([np.full(9, 1e-6), np.full(20, 0.1), np.full(20, 0.01), np.full(20, 0.1), [1e-9]])
    t = np.concatenate([[0.0], np.cumsum(dt)])
    s, r = make_series(t), make_record(t_end_s=float(t[-1]))
    begin = {"from": 1e-4}
    assert evaluate("step ratio", r, s, begin) == pytest.approx(10.0)
    assert evaluate("smallest step", r, s, begin) == pytest.approx(0.01)
    assert evaluate("typical step", r, s, begin) == pytest.approx(0.1)
    assert evaluate("irregularity", r, s, begin) == pytest.approx(2.0 / 59.0)


def measure_apart(one, other, **arguments):
    """The distance of two runs, each a record with its series."""
    return evaluate("apart", *one, arguments, *other)


def test_distance_of_two_runs_on_different_steps():
    """Two straight lines 3 and 4 m apart are 5 m apart."""
    one = make_record(), make_series(T, x=T, y=T)
    other = make_series(np.linspace(0.0, 10.0, 77), x=np.linspace(3.0, 13.0, 77), y=np.linspace(4.0, 14.0, 77))
    assert measure_apart(one, (make_record(), other), series=["x", "y"]) == pytest.approx(5.0)
    holed = make_record(), change_series(other, x=np.full(77, np.nan))
    assert math.isnan(measure_apart(one, holed, series=["z"]))
    bent = make_record(), make_series(T, x=np.where(T > 5.0, 100.0, 3.0), y=np.full(101, 4.0))
    assert measure_apart(bent, bent, series=["x"], to=5.0) == 0.0
    assert measure_apart(bent, (make_record(), other), series=["x", "y"], to=5.0) < 10.0


def test_a_run_that_stopped_is_not_close_to_another():
    """Stopped at 4 of 10 s, on the other's path so far: neither as the one judged nor as the other is it near."""
    whole, stopped = (make_record(), make_series(T, x=T)), (make_record(t_reached_s=4.0), make_series(SHORT, x=SHORT))
    for one, other in ((stopped, whole), (whole, stopped), (stopped, stopped)):
        assert math.isnan(measure_apart(one, other, series=["x"]))
    assert measure_apart(whole, whole, series=["x"]) == 0.0


def test_a_run_that_stopped_in_the_passage_has_no_drop():
    """Lowest at 3 s: 0.5 s later it must still run, or the fall to come would be missed."""
    for t_reached, known in ((3.2, False), (3.6, True)):
        t = np.linspace(0.0, t_reached, 10 * int(t_reached * 10) + 1)
        s = make_series(t, low=np.abs(t - 3.0), a=np.zeros_like(t))
        arguments = {"series": "a", "low": "low", "within": 0.5}
        assert math.isnan(evaluate("drop at lowest", make_record(t_reached_s=t_reached), s, arguments)) != known


def test_without_a_series_there_is_no_number():
    """Refused runs have none; every measure that reads series says so."""
    for name, m in MEASURES.items():
        if m.needs_series and not m.of_pair:
            assert math.isnan(evaluate(name, make_record(), None, dict.fromkeys(m.wants, "x")))


def test_sizes_and_operators_are_those_of_the_problem():
    """Sects. 5.3, 5.5 print sizes. (47): Lagrange's operator is Newton's in a natural basis, not in a body frame."""
    chain, grid, top = (
        replace(make_record(), problem=p, problem_parameters="{}") for p in ("chain", "four_bar_grid", "heavy_top")
    )
    assert [evaluate("number", chain, None, {"of": k}) for k in ("coordinates", "rows", "bodies")] == [90, 48, 15]
    assert [evaluate("number", grid, None, {"of": k}) for k in ("bodies", "joints", "freedoms")] == [55, 80, 5]
    assert evaluate("operators", top, None, {"of": "natural basis"}) < 1e-12
    assert evaluate("operators", top, None, {"of": "corrected"}) < 1e-12
    assert evaluate("operators", top, None, {"of": "body frame"}) > 0.1
    assert math.isnan(evaluate("operators", top, None, {"of": "none"}))


def test_a_stop_later_than_asked_is_another_event():
    """A claim on the stop at 5.5 s says nothing of a run that stops at 8 s."""
    stopped = make_record(t_reached_s=8.0)
    assert evaluate("stop time", stopped, None, {}) == 8.0 == evaluate("stop time", stopped, None, {"by": 8.0})
    assert math.isnan(evaluate("stop time", stopped, None, {"by": 6.0}))
