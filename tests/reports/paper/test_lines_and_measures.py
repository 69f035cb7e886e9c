"""Axes and measured numbers on motions of known answer."""

import math

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.reports.mechanism.segments import mechanism_of
from mbsbench.reports.model.curves import Curve
from mbsbench.reports.model.results import Run
from mbsbench.reports.paper import limits, measures
from mbsbench.reports.paper.lines import Line, lines_of, within
from mbsbench.reports.paper.measures import measured
from mbsbench.reports.paper.picking import choose
from mbsbench.reports.paper.spec import Panel, Pick, Says
from mbsbench.reports.plots import palette

from ..conftest import because
from .conftest import record_for, series_for

PICKS = [Pick(f"k{n}", "rk45_strong_form", "heavy_top", rtol=tol) for n, tol in enumerate((1e-3, 1e-6), 1)]


def two(sizes=(1.0, 2.0), **changes) -> list[Line]:
    """Two tops whose observables swing by ``sizes``."""
    runs = [Run(record_for(f"{n:016x}", p, **changes)) for n, p in enumerate(PICKS)]
    problem = registry.make_problem("heavy_top", {})
    series = {c.record.run_id: series_for(problem, 5.0, size) for c, size in zip(runs, sizes, strict=True)}
    return lines_of(choose(PICKS, runs), series, palette.looks(["rk45_strong_form"]))


def test_order_names_the_largest_first():
    fact = measured(Says("x", "order", series="energy_error"), two((1.0, 2.0)))
    assert fact.text.index("rtol 1e-06") < fact.text.index("rtol 0.001")
    assert fact.values["k2"]["largest"] == pytest.approx(2.0, rel=1e-2)


def test_largest_sees_its_window_only():
    """sin(7 t / 5) grows to t = 1.1 s."""
    fact = measured(Says("x", "largest", series="energy_error", window=(0.0, 0.5)), two())
    assert fact.values["k1"]["largest"] < math.sin(0.7) + 1e-12


def test_steps_are_told_in_decades():
    assert "(2.0 decades)" in measures._decades(1e-4, 1e-2)
    assert measures._decades(math.nan, 1.0) == "no step"


def test_the_first_low_point_is_where_it_turns_upwards():
    t = np.linspace(0.0, 10.0, 1001)
    assert t[measures._first_low(np.cos(t))] == pytest.approx(math.pi, abs=0.01)
    assert measures._first_low(-t) == 1000


def test_an_end_is_compared_with_the_papers():
    ends = Says("fails", "end", ("k1",), fails_at=2.0)
    assert measured(ends, two()).differs
    assert not measured(ends, two(status="diverged", message="m", t_reached_s=2.2)).differs
    runs = Says("runs", "end", ("k1",), runs=True)
    assert not measured(runs, two()).differs
    assert measured(runs, two(status="diverged", message="m", t_reached_s=2.2)).differs
    assert not measured(runs, two(status="wrong", wrong_because=because("because"))).differs


def test_every_measure_takes_a_run_that_made_no_step():
    """Refused or killed at once: NaN and words, no exception."""
    nan = float("nan")
    nothing = dict.fromkeys(("t_reached_s", "step_min_s", "step_max_s", "energy_drift_max_J"), nan)
    runs = [Run(record_for("a" * 16, PICKS[0], status="refused", message="no", **nothing))]
    lines = lines_of(choose(PICKS, runs), {}, palette.looks(["rk45_strong_form"]))
    for name in measures.MEASURES:
        text = measured(Says("words", name, series="obs_theta", window=(0.0, 1.0)), lines).text
        assert "not in this run: ODE-45, rtol 1e-06" in text


def test_axes_show_everything_unless_one_line_hides_the_others():
    """All of two lines; of one that blew up, thirty times the energy there is; rounding gives no scale."""
    records = [k.chosen.run.record for k in two()]
    energy, length = Panel("", ("energy",), "", (0.0, 1.0)), Panel("", ("obs_C_z",), "", (0.0, 1.0))
    t = np.linspace(0.0, 1.0, 5)
    calm, wild = Curve(t, 1.0 + t), Curve(t, 1.0 + 1e9 * t)
    low, high = limits.limits_of(energy, records, {"J"}, [calm], None)
    assert low < 1.0 and 2.0 < high < 2.2
    assert limits.limits_of(energy, records, {"J"}, [calm, wild], None)[1] < 400.0
    noise = Curve(t, 1e-15 * t)
    assert limits.is_rounding(length, records, {"m"}, [noise])
    assert limits.limits_of(length, records, {"m"}, [noise], None) == (-1e-3, 1e-3)


def test_steps_at_the_very_start_do_not_stretch_the_axis_but_a_failure_does():
    panel, t = Panel("", ("dt",), "", (0.0, 10.0), log=True), np.linspace(0.01, 10.0, 200)
    small_start = np.where(t < 0.05, 1e-9, 1e-2)
    assert limits.limits_of(panel, [], {"s"}, [Curve(t, small_start)], None)[0] > 1e-3
    small_end = np.where(t > 9.99, 1e-9, 1e-2)
    assert limits.limits_of(panel, [], {"s"}, [Curve(t, small_end)], None)[0] < 1e-9


def test_a_window_keeps_its_peaks():
    t = np.linspace(0.0, 300.0, 100_001)
    a = np.zeros_like(t)
    a[98_000] = 5.0  # at 294 s
    cut = within(t, a, (290.0, 300.0))
    assert cut.y.max() == 5.0 and cut.t[np.argmax(cut.y)] == t[98_000] and 289.9 < cut.t[0] <= 290.0


@pytest.mark.parametrize(
    ("name", "lengths"),
    [
        ("spherical_pendulum", {1.0, 0.36}),  # twice the arm, and the bar by which one sees it spin
        ("chain", {0.3048}),
        ("four_bar_grid", {1.0}),
        ("torque_free_body", {0.5}),
    ],
)
def test_bodies_are_as_long_as_their_joints_say(name, lengths):
    problem = registry.make_problem(name, {})
    m = mechanism_of(series_for(problem, 1.0, 0.0))
    ends = m.segments(0)
    assert {round(float(x), 9) for x in np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)} == lengths
    assert set(m.body) == set(range(problem.system.nb))


def test_joints_of_both_bodies_meet_in_the_drawing():
    """At the start phi = 0: the point of each joint in its first body lies on a segment's end of its second body."""
    m = mechanism_of(series_for(registry.make_problem("chain", {}), 1.0, 0.0))
    ends = m.segments(0).reshape(-1, 3)
    for at in m.joints(0):
        assert np.min(np.linalg.norm(ends - at, axis=1)) < 1e-6  # poses are kept in single precision


def test_no_poses_no_mechanism():
    assert mechanism_of(None) is None
