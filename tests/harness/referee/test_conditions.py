"""What decides is found: a planted dimension, a planted pair, and the always and never of a mixed map."""

import itertools

from mbsbench.harness.referee.claims.conditions import decision, factors

DIMENSIONS = {
    "tolerance": [1e-3, 1e-4, 1e-6],
    "chart": ["euler313", "quaternion"],
    "lambda_in_error_test": [True, False],
}


def points(holds):
    """Every combination, holding where ``holds`` says."""
    all_of = [dict(zip(DIMENSIONS, v, strict=True)) for v in itertools.product(*DIMENSIONS.values())]
    return [(at, holds(at)) for at in all_of]


def test_one_dimension_that_decides_is_named_with_counts():
    words = decision(points(lambda at: at["chart"] == "euler313"))
    assert words == "chart decides alone: holds with chart euler313 (6 of 6), not with chart quaternion (0 of 6)"


def test_two_dimensions_that_decide_together_are_named():
    """Neither alone separates; the two do."""
    words = decision(points(lambda at: at["chart"] == "euler313" and at["lambda_in_error_test"]))
    assert words.startswith("chart and lambda in error test decide together")
    assert "holds with chart euler313 and multipliers in the error test (3 of 3)" in words
    assert "chart euler313 and multipliers outside the error test (0 of 3)" in words


def test_a_mixed_map_names_what_always_and_never_holds():
    """Three dimensions at once: no pair separates, yet the quaternion never holds."""

    def holds(at):
        return at["chart"] == "euler313" and at["lambda_in_error_test"] and at["tolerance"] == 1e-3

    extra = [({**at, "gain": g}, h if g else False) for at, h in points(holds) for g in (0.0, 5.0)]
    words = decision(extra)
    assert "never with chart quaternion (0 of 12)" in words and "tells most" in words


def test_the_same_settings_are_not_said_twice():
    """A dimension that follows from another (the solver's form) adds nothing."""
    both = [({**at, "form": at["chart"][:2]}, h) for at, h in points(lambda at: at["chart"] == "euler313")]
    assert "form" not in decision(both)


def test_factors_count_every_value():
    counts = factors(points(lambda at: at["chart"] == "euler313"))
    assert counts["chart"] == {"chart euler313": [6, 6], "chart quaternion": [0, 6]}
    assert counts["tolerance"]["tolerance 0.001"] == [2, 4]


def test_the_order_of_points_does_not_matter():
    """Verdicts are a function of the records, not of their order."""
    some = points(lambda at: at["chart"] == "euler313" or at["tolerance"] == 1e-3)
    assert decision(some) == decision(some[::-1])
