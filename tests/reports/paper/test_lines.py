"""Axes, windows, mechanisms and their view on motions of known answer."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbsbench.harness.catalogue import registry
from mbsbench.reports.mechanism.segments import choose_view, project_points, read_mechanism
from mbsbench.reports.model.curves import Curve
from mbsbench.reports.paper.catalogue import Panel
from mbsbench.reports.paper.lines import clip_points, find_limits, is_rounding
from mbsbench.reports.plots.spec import Axis
from mbsbench.tests.comparing import assert_close

from .conftest import asked, make_numbered_record, make_still_series


def test_axes_show_everything_unless_one_line_hides_the_others():
    """All of two lines; of one that blew up, thirty times the energy there is; rounding gives no scale."""
    records = [make_numbered_record(asked("fig11")[0])]
    energy, length = Panel("", ("energy",), Axis("E"), (0.0, 1.0)), Panel("", ("obs_C_z",), Axis("Z"), (0.0, 1.0))
    t = np.linspace(0.0, 1.0, 5)
    calm, wild = Curve(t, 1.0 + t), Curve(t, 1.0 + 1e9 * t)
    low, high = find_limits(energy, records, {"J"}, [calm], None)
    assert low < 1.0 and 2.0 < high < 2.2
    assert find_limits(energy, records, {"J"}, [calm, wild], None)[1] < 400.0
    noise = Curve(t, 1e-15 * t)
    assert is_rounding(records, {"m"}, [noise])
    assert find_limits(length, records, {"m"}, [noise], None) == (-1e-3, 1e-3)


def test_steps_at_the_very_start_do_not_stretch_the_axis_but_a_failure_does():
    panel, t = Panel("", ("dt",), Axis("step", log=True), (0.0, 10.0)), np.linspace(0.01, 10.0, 200)
    small_start = np.where(t < 0.05, 1e-9, 1e-2)
    assert find_limits(panel, [], {"s"}, [Curve(t, small_start)], None)[0] > 1e-3
    small_end = np.where(t > 9.99, 1e-9, 1e-2)
    assert find_limits(panel, [], {"s"}, [Curve(t, small_end)], None)[0] < 1e-9


def test_a_window_keeps_its_peaks():
    t = np.linspace(0.0, 300.0, 100_001)
    a = np.zeros_like(t)
    a[98_000] = 5.0  # at 294 s
    cut = clip_points(t, a, (290.0, 300.0))
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
    m = read_mechanism(make_still_series(problem, 1.0, 0.0))
    ends = m.segments(0)
    assert {round(float(x), 9) for x in np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)} == lengths
    assert set(m.body) == set(range(problem.system.nb))


def test_joints_of_both_bodies_meet_in_the_drawing():
    """At the start phi = 0: the point of each joint in its first body lies on a segment's end of its second body."""
    m = read_mechanism(make_still_series(registry.make_problem("chain", {}), 1.0, 0.0))
    ends = m.segments(0).reshape(-1, 3)
    for at in m.joints(0):
        assert np.min(np.linalg.norm(ends - at, axis=1)) < 1e-6  # poses are kept in single precision


def test_no_poses_no_mechanism():
    assert read_mechanism(None) is None


def turning(t_end: float = 2.0, n: int = 81):
    """A pendulum that turns once about OZ in two seconds, as a series file."""
    still = make_still_series(registry.make_problem("spherical_pendulum", {}), t_end, 1e-3)
    t = np.linspace(0.0, t_end, n)
    Q = Rotation.from_rotvec(np.outer(np.pi * t, [0.0, 0.0, 1.0]))
    R = Q * Rotation.from_quat(np.tile(still["frame_q"][0, 0], (n, 1)))
    poses = {
        "frame_t": t,
        "frame_r": Q.apply(np.tile(still["frame_r"][0, 0], (n, 1)))[:, None],
        "frame_q": R.as_quat()[:, None],
    }
    return dataclasses.replace(still, arrays={**still.arrays, **poses})


def test_the_body_is_where_its_pose_says():
    """At 0.5 s it has turned by a quarter: upright, seen from the front."""
    mechanism = read_mechanism(turning())
    view = choose_view(mechanism)
    assert_close(view, [[1, 0, 0], [0, 1, 0]], atol=1e-6)
    ends = project_points(mechanism.segments(int(np.argmin(np.abs(mechanism.t - 0.5)))), view)[0]
    assert_close(ends[1] - ends[0], [0.0, 1.0], atol=1e-6)


def test_spatial_motion_is_seen_at_an_angle():
    """Right and up stay square and of unit length, whatever the view."""
    m = read_mechanism(make_still_series(registry.make_problem("torque_free_body", {}), 1.0, 0.0))
    view = choose_view(m)
    assert_close(view @ view.T, np.eye(2), atol=1e-12)
    assert np.abs(view).max() < 0.999
