"""Numbers on the page are those of the series, to a bound that follows from the bits kept."""

import numpy as np
import pytest

from mbsbench.reports.mechanism.theatre import poses as packing
from mbsbench.reports.mechanism.theatre.poses import LEVELS, Box, box_of
from mbsbench.reports.plots.browser import bundle

from ..bundles import opened


@pytest.mark.parametrize("seed", range(3))
def test_positions_are_off_by_half_a_step_at_most(seed):
    """Rounding to a grid of 2 LEVELS steps over the box."""
    random = np.random.default_rng(seed)
    r = random.normal(0.0, 10.0 ** random.integers(-3, 4), (50, 4, 3))
    box = box_of(r)
    back = 0.5 * (box.low + box.high) + packing.positions(r, box) * box.quantum
    assert np.all(np.abs(back - r) <= 0.5 * box.quantum * (1.0 + 1e-9))
    assert np.allclose(box.quantum, (box.high - box.low) / (2 * LEVELS))


def test_what_leaves_the_box_stays_at_its_wall():
    """int16 must not wrap around: a mechanism that flies off would come back on the other side."""
    box = Box(np.zeros(3), np.ones(3))
    far = np.array([[[1e9, -1e9, 0.5]]])
    assert packing.positions(far, box).tolist() == [[[LEVELS, -LEVELS, 0]]]


def test_box_of_points_that_are_no_numbers():
    """A motion of NaN alone still has a stage."""
    assert np.all(box_of(np.full((3, 3), np.nan)).quantum > 0.0)


def test_quaternions_keep_the_orientation_and_never_jump():
    """q and -q are one orientation: a jump between them would be a turn on the page and cost bytes."""
    random = np.random.default_rng(0)
    angle = np.cumsum(random.uniform(0.0, 0.3, 200))
    q = np.stack((0 * angle, 0 * angle, np.sin(angle / 2), np.cos(angle / 2)), axis=-1)
    flipped = q * random.choice([-1.0, 1.0], (200, 1))
    back = packing.quaternions(flipped[:, None])[:, 0] / LEVELS
    assert np.all(np.abs(np.abs(np.sum(back * q, axis=1)) - 1.0) < 4.0 / LEVELS)
    assert np.max(np.abs(np.diff(back, axis=0))) < 0.16  # half the largest turn


def test_poses_and_strips_come_back():
    """Poses modulo 2^16, whatever the jumps; floats with their NaN."""
    poses = np.random.default_rng(1).integers(-LEVELS, LEVELS + 1, (37, 5)).astype(np.int16)
    strips = np.array([1.5, np.nan, -1e-30, 3e8])
    found = opened(bundle("x", {"poses": packing.columns(poses), "strips": strips}))
    assert np.array_equal(found["poses"].astype(int).reshape(5, 37).T - LEVELS, poses)
    assert np.array_equal(found["strips"], strips.astype("<f4"), equal_nan=True)


def test_rounding_of_strips_is_below_a_pixel():
    """DIGITS bits of mantissa: half a unit of the last one."""
    a = np.array([0.0, np.nan, -1.0, *np.random.default_rng(2).normal(0.0, 1.0, 500) * 10.0 ** np.arange(-250, 250)])
    back = packing.rounded(a)
    assert np.array_equal(np.isnan(back), np.isnan(a)) and back[0] == 0.0
    assert np.all(np.abs(back[2:] - a[2:]) <= 2.0**-packing.DIGITS * np.abs(a[2:]))
