"""Poses are apart by what moved most: a centre, or an arm times an angle."""

import numpy as np
import pytest

from mbsbench.harness.judge.distance import LEVEL, find_significant_tests, measure_distance
from mbsbench.harness.mechanics import so3


def test_the_largest_of_shifts_and_of_arms_times_angles_counts():
    """At two times, of two bodies whose arms differ; the sense of the comparison does not matter."""
    r, R = np.zeros((2, 2, 3)), np.tile(np.eye(3), (2, 2, 1, 1))
    moved, turned = r.copy(), R.copy()
    moved[0, 1] = [0.0, 0.3, 0.4]
    turned[1, 0] = so3.exp(np.array([0.0, 0.0, 0.2]))
    turned[1, 1] = so3.exp(np.array([0.1, 0.0, 0.0]))
    arms = np.array([0.5, 4.0])
    for a, b in (((r, R), (moved, turned)), ((moved, turned), (r, R))):
        assert measure_distance(a, b, arms) == pytest.approx([0.5, 0.4])
        assert measure_distance(a, b, 1.0) == pytest.approx([0.5, 0.2])


@pytest.mark.parametrize("part", [0, 1])
def test_a_pose_that_is_no_number_has_no_distance(part):
    """Whichever part of it, beside a distance that is known."""
    home = np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1))
    lost = tuple(a.copy() for a in home)
    lost[0][0] = 1.0
    lost[part][1] = np.nan
    assert np.isnan(measure_distance(home, lost, 1.0))


def test_many_tests_need_smaller_chances_each():
    """A chance below the level counts alone, and not as one of several; a quantity is named once."""
    least = 0.5 * LEVEL
    assert find_significant_tests([(least, "x")]) == ["x"]
    assert find_significant_tests([(least, "x"), (0.9, "y"), (0.5, "z")]) == []
    assert find_significant_tests([(least / 4.0, "x"), (0.9, "y"), (least / 4.0, "x")]) == ["x"]
