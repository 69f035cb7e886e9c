"""Thinned poses hold the motion: ends stay, dropped poses lie near what is drawn, turns are measured right."""

import numpy as np
import pytest

from mbsbench.reports.mechanism.theatre import poses as packing
from mbsbench.reports.mechanism.theatre.poses import (
    LEVELS,
    NEAR,
    TURNED,
    Box,
    Poses,
    bound_points,
    choose_poses,
    interpolate_poses,
    measure_deviation,
    measure_rates,
    measure_turns,
    select_finite,
    thin_poses,
)
from mbsbench.reports.plots.browser import format_bundle
from mbsbench.tests.comparing import assert_close, assert_each, assert_same

from ..outline import opened
from .conftest import about_z


def spinning(rate: float, n: int = 300, t_end: float = 3.0) -> Poses:
    """One body on a circle of radius 1, turning evenly about OZ, in steps that are not even."""
    t = t_end * np.linspace(0.0, 1.0, n) ** 1.5
    c, s = np.cos(rate * t), np.sin(rate * t)
    return Poses(t, np.stack((c, s, 0 * t), axis=-1)[:, None], about_z(rate * t)[:, None])


def test_first_and_last_pose_stay():
    """Where a run stopped is its last pose."""
    poses = spinning(5.0)
    for n in (2, 3, 10, 299, 300, 1000):
        rows = thin_poses(poses, n, 1.0)
        assert rows[0] == 0 and rows[-1] == len(poses) - 1
        assert len(rows) <= max(n, 2)
        assert_each(np.diff(rows), ">", 0)


def test_fast_motion_gets_more_poses():
    """At rest for nine tenths of the time, then a whip: half of the poses go there."""
    t = np.linspace(0.0, 1.0, 1001)
    x = np.where(t > 0.9, (t - 0.9) * 50.0, 0.0)
    poses = Poses(t, np.stack((x, 0 * x, 0 * x), axis=-1)[:, None], np.tile([0.0, 0.0, 0.0, 1.0], (1001, 1, 1)))
    rows = thin_poses(poses, 100, 1.0)
    assert np.sum(t[rows] > 0.9) > 50


def test_even_turning_is_drawn_exactly():
    """Great circles between orientations about one axis are that turning; chords are off by the sagitta."""
    poses = spinning(4.0)
    rows = np.arange(0, len(poses), 23)
    rows = np.append(rows, len(poses) - 1)
    distance, angle = measure_deviation(poses, rows)
    widest = np.max(np.diff(4.0 * poses.t[rows]))
    assert angle < 1e-6
    assert 0.5 * (1.0 - np.cos(widest / 2)) < distance <= (1.0 - np.cos(widest / 2)) * (1.0 + 1e-6)
    assert measure_deviation(poses, np.arange(len(poses))) < (1e-12, 1e-6)


def test_as_few_poses_as_the_eye_needs():
    """Drawn poses stay near the stored ones; a slow motion needs fewer than a fast one, never more than allowed."""
    counts = []
    for rate in (0.5, 5.0, 40.0):
        poses = spinning(rate, n=6000)
        chosen = choose_poses(poses, 5000, 1.0)
        rows = chosen.rows
        distance, angle = measure_deviation(poses, rows)
        assert (distance, angle) == (chosen.distance, chosen.angle)
        assert distance <= NEAR and angle <= TURNED
        counts.append(len(rows))
    assert counts[0] < counts[1] < counts[2] <= 5000
    assert len(choose_poses(spinning(300.0, n=1500), 100, 1.0).rows) <= 100


def test_poses_go_where_they_are_needed():
    """A whip of a hundredth of the time at rest else: as many poses as even ones, a tenth of their distance."""
    t = np.linspace(0.0, 1.0, 2001)
    angle = 6.0 * np.clip((t - 0.5) / 0.01, 0.0, 1.0) + 0.05 * t
    r = np.stack((np.cos(angle), np.sin(angle), 0 * t), axis=-1)[:, None]
    poses = Poses(t, r, about_z(angle)[:, None])
    rows = choose_poses(poses, 60, 1.0).rows
    assert (
        len(rows) <= 60
        and measure_deviation(poses, rows)[0] < 0.1 * measure_deviation(poses, thin_poses(poses, 60, 1.0))[0] + NEAR
    )


def test_between_takes_the_shorter_way():
    """q and -q are one orientation."""
    q = about_z(np.array([0.0, 1.0]))[:, None] * np.array([1.0, -1.0])[:, None, None]
    half = interpolate_poses(Poses(np.array([0.0, 2.0]), np.zeros((2, 1, 3)), q), np.array([1.0]))
    assert_close(np.abs(np.sum(half.q[0, 0] * about_z(np.array(0.5)))), 1.0)


def test_rates_of_even_turning():
    """Body and space axis agree; sign and size do."""
    for rate in (7.0, -0.3):
        assert_close(measure_rates(spinning(rate), 0), [0.0, 0.0, rate], atol=1e-9)
    assert_close(measure_turns(spinning(3.0).q)[:, 0], 3.0 * np.diff(spinning(3.0).t), atol=1e-7)


def test_poses_end_before_the_first_that_is_no_number():
    poses = spinning(1.0)
    poses.r[40:, 0, 1] = np.inf
    assert len(select_finite(poses)) == 40


@pytest.mark.parametrize("seed", range(3))
def test_positions_are_off_by_half_a_step_at_most(seed):
    """Rounding to a grid of 2 LEVELS steps over the box."""
    random = np.random.default_rng(seed)
    r = random.normal(0.0, 10.0 ** random.integers(-3, 4), (50, 4, 3))
    box = bound_points(r)
    back = 0.5 * (box.low + box.high) + packing.quantise_positions(r, box) * box.quantum
    assert_each(np.abs(back - r), "<=", 0.5 * box.quantum * (1.0 + 1e-9))
    assert_close(box.quantum, (box.high - box.low) / (2 * LEVELS))


def test_what_leaves_the_box_stays_at_its_wall():
    """int16 must not wrap around: a mechanism that flies off would come back on the other side."""
    box = Box(np.zeros(3), np.ones(3))
    far = np.array([[[1e9, -1e9, 0.5]]])
    assert packing.quantise_positions(far, box).tolist() == [[[LEVELS, -LEVELS, 0]]]


def test_box_of_points_that_are_no_numbers():
    """A motion of NaN alone still has a stage."""
    assert_each(bound_points(np.full((3, 3), np.nan)).quantum, ">", 0.0)


def test_quaternions_keep_the_orientation_and_never_jump():
    """q and -q are one orientation: a jump between them would be a turn on the page and cost bytes."""
    random = np.random.default_rng(0)
    angle = np.cumsum(random.uniform(0.0, 0.3, 200))
    q = np.stack((0 * angle, 0 * angle, np.sin(angle / 2), np.cos(angle / 2)), axis=-1)
    flipped = q * random.choice([-1.0, 1.0], (200, 1))
    back = packing.quantise_quaternions(flipped[:, None])[:, 0] / LEVELS
    assert_each(np.abs(np.abs(np.sum(back * q, axis=1)) - 1.0), "<", 4.0 / LEVELS)
    assert np.max(np.abs(np.diff(back, axis=0))) < 0.16  # half the largest turn


def test_poses_and_strips_come_back():
    """Poses modulo 2^16, whatever the jumps; floats with their NaN."""
    poses = np.random.default_rng(1).integers(-LEVELS, LEVELS + 1, (37, 5)).astype(np.int16)
    strips = np.array([1.5, np.nan, -1e-30, 3e8])
    found = opened(format_bundle("x", {"poses": packing.flatten_columns(poses), "strips": strips}))
    assert_same(found["poses"].astype(int).reshape(5, 37).T - LEVELS, poses)
    assert_same(found["strips"], strips.astype("<f4"), equal_nan=True)


def test_rounding_of_strips_is_below_a_pixel():
    """DIGITS bits of mantissa: half a unit of the last one."""
    a = np.array([0.0, np.nan, -1.0, *np.random.default_rng(2).normal(0.0, 1.0, 500) * 10.0 ** np.arange(-250, 250)])
    back = packing.round_mantissa(a)
    assert_same(np.isnan(back), np.isnan(a))
    assert back[0] == 0.0
    assert_each(np.abs(back[2:] - a[2:]), "<=", 2.0**-packing.DIGITS * np.abs(a[2:]))
