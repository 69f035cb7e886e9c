"""What decides is found: a planted dimension, a planted pair, and the always and never of a mixed map."""

import itertools

from mbsbench.harness.referee.claims.conditions import decision, factors, separation
from mbsbench.harness.results.judgements.claims import Condition, Count

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
    found = decision(points(lambda at: at["chart"] == "euler313"))
    assert found.by == {"chart": ("euler313",)} and not found.unless


def test_two_dimensions_that_decide_together_are_named():
    """Neither alone separates; the two do."""
    found = decision(points(lambda at: at["chart"] == "euler313" and at["lambda_in_error_test"]))
    assert found.by == {"chart": ("euler313",), "lambda_in_error_test": (True,)} and not found.unless
    found = decision(points(lambda at: at["chart"] != "euler313" or not at["lambda_in_error_test"]))
    assert found.by == {"chart": ("euler313",), "lambda_in_error_test": (True,)} and found.unless


def test_numbers_at_one_end_are_said_by_their_limit():
    """Two of three tolerances are the looser ones; the one in the middle is named."""
    assert decision(points(lambda at: at["tolerance"] >= 1e-4)).by == {"tolerance": ("at least 0.0001",)}
    assert decision(points(lambda at: at["tolerance"] <= 1e-4)).by == {"tolerance": ("at most 0.0001",)}
    assert decision(points(lambda at: at["tolerance"] == 1e-4)).by == {"tolerance": (1e-4,)}


def test_a_pattern_that_no_line_says_is_no_condition():
    """Two dimensions separate, but not as values of the one with values of the other: a diagonal."""
    found = decision(points(lambda at: (at["chart"] == "euler313") == at["lambda_in_error_test"]))
    assert found.by == {} and found.telling and separation(points(lambda at: at["chart"] == "euler313"))
    assert separation(points(lambda at: (at["chart"] == "euler313") == at["lambda_in_error_test"])) is None
    many = [({"case": f"{k}"}, k < 8) for k in range(16)]
    assert separation(many) is None  # eight names are no line


def test_a_mixed_map_names_what_always_and_never_holds():
    """Three dimensions at once: no pair separates, yet the quaternion never holds."""

    def holds(at):
        return at["chart"] == "euler313" and at["lambda_in_error_test"] and at["tolerance"] == 1e-3

    extra = [({**at, "gain": g}, h if g else False) for at, h in points(holds) for g in (0.0, 5.0)]
    found = decision(extra)
    assert found.by == {} and found.telling
    assert Condition({"chart": "quaternion"}, 0, 12) in found.conditions


def test_the_same_settings_are_not_said_twice():
    """A dimension that follows from another (the solver's form) adds nothing."""
    both = [({**at, "form": at["chart"][:2]}, h) for at, h in points(lambda at: at["chart"] == "euler313")]
    assert decision(both).by == {"chart": ("euler313",)}


def test_factors_count_every_value():
    counts = factors(points(lambda at: at["chart"] == "euler313"))
    assert counts["chart"] == (Count("euler313", 6, 6), Count("quaternion", 0, 6))
    assert counts["tolerance"][-1] == Count(1e-3, 2, 4)


def test_the_order_of_points_does_not_matter():
    """Verdicts are a function of the records, not of their order."""
    some = points(lambda at: at["chart"] == "euler313" or at["tolerance"] == 1e-3)
    assert decision(some) == decision(some[::-1])
