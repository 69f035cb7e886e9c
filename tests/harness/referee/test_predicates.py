"""Bands hold up to their ends, and no number lies in no band."""

import math

import pytest

from mbsbench.harness.referee.claims.predicates import COMBINE, COMPARE, Band

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("low", "high", "value", "holds"),
    [
        (-INF, 1.0, 1.0, True),
        (-INF, 1.0, 1.0 + 1e-12, False),
        (1.0, INF, 1.0, True),
        (1.0, INF, INF, True),
        (65.0, 79.0, 72.0, True),
        (65.0, 79.0, INF, False),
        (-INF, 1.0, NAN, False),
        (1.0, INF, NAN, False),
    ],
)
def test_bands(low, high, value, holds):
    assert Band(low, high).holds(value) is holds


@pytest.mark.parametrize(
    ("how", "values", "one"),
    [
        ("last over first", [4.0, 9.0, 2.0], 0.5),
        ("last over first", [0.0, 0.0], 1.0),
        ("last over first", [INF, INF], NAN),
        ("worst step", [INF, INF, 1.0], NAN),
        ("last over first", [1.0, INF], INF),
        ("last over first", [INF, 1.0], 0.0),
        ("worst step", [4.0, 2.0, 3.0, 1.0], 1.5),
        ("worst step", [4.0, NAN, 1.0], NAN),
        ("largest", [4.0, 5.0], 5.0),
        ("largest", [4.0, NAN], NAN),
        ("smallest", [4.0, 5.0], 4.0),
        ("spread", [4.0, 5.0, 4.5], 1.0),
        ("relative spread", [4.0, 6.0], 0.4),
    ],
)
def test_values_along_a_dimension_become_one(how, values, one):
    """A run without the number must not be passed over: the whole has none then. Two failures cannot be compared."""
    assert COMBINE[how](values) == pytest.approx(one, nan_ok=True)


def test_a_value_against_others():
    assert COMPARE["over largest"](6.0, [1.0, 3.0]) == 2.0
    assert COMPARE["over smallest"](6.0, [1.0, 3.0]) == 6.0
    assert COMPARE["minus largest"](6.0, [1.0, 3.0]) == 3.0
    assert COMPARE["largest distance"](0.0, [1.0, 3.0]) == 3.0
    assert math.isnan(COMPARE["over largest"](6.0, [])) and math.isnan(COMPARE["over smallest"](6.0, [NAN, 1.0]))
