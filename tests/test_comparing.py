"""A comparison that fails prints both numbers, the place, and what they are."""

import numpy as np
import pytest

from .comparing import assert_close, assert_each, assert_same


@pytest.mark.parametrize(
    ("compare", "words"),
    [
        (lambda: assert_each([0.5, 2.5, np.nan], "<=", 2.0, "gap"), r"gap: .*nan.* at \(2,\) is not <= .*2\.0"),
        (lambda: assert_each([0.5, 2.5], "<=", [1.0, 2.0]), r"values: .*2\.5.* at \(1,\) is not <= .*2\.0"),
        (lambda: assert_same([1.0, 2.0], [1.0, 3.0], what="r"), r"r: .*2\.0.* at \(1,\) is not == .*3\.0"),
        (lambda: assert_same([1.0, 2.0], [1.0]), r"shape \(2,\) is not \(1,\)"),
        (lambda: assert_same(np.nan, np.nan), "nan"),
        (lambda: assert_same([np.nan, 1.0], [np.nan, 2.0], equal_nan=True, what="v"), r"(?s)v.*1\..*2\."),
        (lambda: assert_close([1.0, 2.0], [1.0, 2.1], what="E"), r"(?s)E.*2\..*2\.1"),
    ],
)
def test_a_failure_says_what_was_compared(compare, words):
    with pytest.raises(AssertionError, match=words):
        compare()


def test_what_holds_is_silent():
    assert_each([], "<", 0.0)
    assert_same([[np.nan]], [[np.nan]], equal_nan=True)
    assert_same([True, False], [True, False])
    assert_close(1.0, 1.0 + 1e-9)
