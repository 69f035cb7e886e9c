"""Numbers on the page are those of the series, to a bound that follows from the bits kept."""

import base64
import zlib

import numpy as np
import pytest

from mbsbench.reports.mechanism.theatre import packing
from mbsbench.reports.mechanism.theatre.packing import LEVELS, Box, box_of


def unpacked(text: str, dtype: str) -> np.ndarray:
    """The inverse of the last stage."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(np.dtype(dtype).itemsize, -1)
    return np.frombuffer(np.ascontiguousarray(planes.T).tobytes(), dtype)


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


def test_differences_add_up_again():
    """Modulo 2^16, whatever the jumps."""
    a = np.random.default_rng(1).integers(-32768, 32768, (37, 5)).astype(np.int16)
    steps = unpacked(packing.pack_int16(a), "<u2").reshape(5, 37)
    assert np.array_equal(np.cumsum(steps, axis=1, dtype=np.uint16).view(np.int16).T, a)


def test_floats_come_back_with_nan():
    a = np.array([[1.5, np.nan], [-1e-30, 3e8]])
    assert np.array_equal(unpacked(packing.pack_float32(a), "<f4"), a.astype("<f4").ravel(), equal_nan=True)


def test_rounding_of_strips_is_below_a_pixel():
    """DIGITS bits of mantissa: half a unit of the last one."""
    a = np.array([0.0, np.nan, -1.0, *np.random.default_rng(2).normal(0.0, 1.0, 500) * 10.0 ** np.arange(-250, 250)])
    back = packing.rounded(a)
    assert np.array_equal(np.isnan(back), np.isnan(a)) and back[0] == 0.0
    assert np.all(np.abs(back[2:] - a[2:]) <= 2.0**-packing.DIGITS * np.abs(a[2:]))
