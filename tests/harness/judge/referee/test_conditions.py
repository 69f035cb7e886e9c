"""Bands, values along dimensions, and what decides: a planted dimension or pair, and the always of a mixed map."""

import itertools
import math

import numpy as np
import pytest

from mbsbench.harness.judge.referee.claims.bands import COMBINE, COMPARE, Band
from mbsbench.harness.judge.referee.claims.conditions import (
    count_factors,
    decide_along,
    find_decision,
    find_separation,
    find_sufficient,
)
from mbsbench.harness.results.judgements.claims import Condition, SettingsCount

DIMENSIONS = {
    "tolerance": [1e-3, 1e-4, 1e-6],
    "chart": ["euler313", "quaternion"],
    "lambda_in_error_test": [True, False],
}


def points(holds):
    """Every combination, holding where ``holds`` says."""
    all_of = [dict(zip(DIMENSIONS, v, strict=True)) for v in itertools.product(*DIMENSIONS.values())]
    return [(at, holds(at)) for at in all_of]


EULER, LAMBDA = {"chart": ("euler313",)}, {"lambda_in_error_test": (True,)}


@pytest.mark.parametrize(
    ("holds", "by", "unless"),
    [
        (lambda at: at["chart"] == "euler313", EULER, False),
        (lambda at: at["chart"] == "euler313" and at["lambda_in_error_test"], EULER | LAMBDA, False),
        (lambda at: at["chart"] != "euler313" or not at["lambda_in_error_test"], EULER | LAMBDA, True),
        (lambda at: at["tolerance"] >= 1e-4, {"tolerance": ("at least 0.0001",)}, False),
        (lambda at: at["tolerance"] <= 1e-4, {"tolerance": ("at most 0.0001",)}, False),
        (lambda at: at["tolerance"] == 1e-4, {"tolerance": (1e-4,)}, False),
        (
            lambda at: (at["chart"] == "euler313") == at["lambda_in_error_test"],
            {},
            False,
        ),  # a diagonal: no line says it
    ],
)
def test_one_dimension_or_two_that_decide_are_named(holds, by, unless):
    """Alone, together, or as where it does not hold; the order of points does not matter, nor what follows from one."""
    found = find_decision(points(holds))
    assert (found.by, found.unless) == (by, unless)
    assert find_decision(points(holds)[::-1]) == found
    assert bool(find_separation(points(holds))) is bool(by) and (by or found.telling)
    if by == EULER:
        assert find_decision([({**at, "form": at["chart"][:2]}, h) for at, h in points(holds)]).by == by


def test_a_dimension_of_many_names_is_no_line():
    assert find_separation([({"case": f"{k}"}, k < 8) for k in range(16)]) is None


def test_a_mixed_map_names_what_always_and_never_holds():
    """Three dimensions at once: no pair separates, yet the quaternion never holds."""

    def holds(at):
        return at["chart"] == "euler313" and at["lambda_in_error_test"] and at["tolerance"] == 1e-3

    extra = [({**at, "gain": g}, h if g else False) for at, h in points(holds) for g in (0.0, 5.0)]
    found = find_decision(extra)
    assert found.by == {} and found.telling
    assert Condition({"chart": "quaternion"}, 0, 12) in found.conditions


def test_factors_count_every_value():
    counts = count_factors(points(lambda at: at["chart"] == "euler313"))
    assert counts["chart"] == (SettingsCount("euler313", 6, 6), SettingsCount("quaternion", 0, 6))
    assert counts["tolerance"][-1] == SettingsCount(1e-3, 2, 4)


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
        ("worst step", [1.0, INF, INF], INF),  # it ended, then it did not: two failures after that take nothing back
        ("worst step", [1.0, 2.0, INF, INF], INF),
        ("worst step", [4.0, 2.0], 0.5),
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


def test_bands_move_by_their_ends_or_about_their_middle():
    assert Band(-math.inf, 2.0).move(1.5) == Band(-math.inf, 3.0)
    assert Band(3.0, math.inf).move(1.5) == Band(2.0, math.inf)
    assert Band(-math.inf, -0.3).move(1.5).high == pytest.approx(-0.2)
    assert Band(-1.0, 1.0).move(1.5) == Band(-1.5, 1.5)
    low, high = Band(1.0, 100.0).move(0.5).low, Band(1.0, 100.0).move(0.5).high
    assert (low, high) == pytest.approx((10**0.5, 10**1.5))
    for band in (Band(2.0, 3.0), Band(-1.0, 4.0), Band(-math.inf, -1.0), Band(0.5, math.inf)):
        narrow, wide = band.move(1 / 1.5), band.move(1.5)
        assert wide.low <= band.low <= narrow.low <= narrow.high <= band.high <= wide.high


def test_values_that_suffice_cover_what_holds():
    """Each named condition holds always; together with the rest they are all settings that hold, in any order."""
    random = np.random.default_rng(3)
    for _ in range(20):
        own = [({"a": a, "b": b, "c": c}, bool(random.random() < 0.4)) for a in (0, 1, 2) for b in "xy" for c in "uvw"]
        found, rest = find_sufficient(own)
        for c in found:
            inside = [holds for at, holds in own if all(at[n] == v for n, v in c.at.items())]
            assert inside and all(inside) and len(inside) == c.settings
        covered = sum(holds and any(all(at[n] == v for n, v in c.at.items()) for c in found) for at, holds in own)
        d = find_decision(own)
        assert covered + rest == sum(holds for _, holds in own)
        assert d.by or d.rest == rest
        assert find_sufficient(own[::-1]) == (found, rest)


def test_values_along_a_dimension_are_named_one_by_one_or_by_their_range():
    """Three of them, a run of neighbours, and scattered ones, each run of neighbours for itself."""
    tried = [10.0**-k for k in range(1, 9)]
    assert decide_along("tolerance", [1e-2, 1e-4], tried).by == {"tolerance": (1e-4, 1e-2)}
    assert decide_along("tolerance", tried[:5], tried).by == {"tolerance": ("1e-05 to 0.1",)}
    assert decide_along("tolerance", [*tried[:4], tried[7]], tried).by == {"tolerance": ("1e-08", "0.0001 to 0.1")}


MOTIONS = [
    ({"problem": problem, "duration": t, "max_step": h, "solver": solver} | more, problem == "top" and h == 1e-3)
    for problem, t, h in (("top", 5.0, 1e-3), ("top", 5.0, 2e-4), ("chain", 2.0, 2e-3), ("chain", 2.0, 5e-3))
    for solver, more in (("gc", {"direction": "a"}), ("gc", {"direction": "mass"}), ("rk", {}))
]


def test_a_condition_names_the_problem_it_is_about():
    """Not its duration, which the problem determines, nor its step limit alone, which no other problem has."""
    found = find_separation(MOTIONS)
    assert found.by == {"problem": ("top",), "max_step": (1e-3,)}
    by_problem = find_separation([(at, at["problem"] == "top") for at, _ in MOTIONS])
    assert by_problem.by == {"problem": ("top",)}


def test_an_option_is_said_of_the_solver_that_has_it():
    """c_R is one solver's: that the claim holds with it says nothing of the other."""
    points = [(at, at.get("direction") == "a" and at["max_step"] != 5e-3) for at, _ in MOTIONS]
    for c in find_sufficient(points)[0]:
        assert c.at["solver"] == "gc" and c.at["direction"] == "a"
    assert all(c.at.get("solver") == "gc" for c in find_decision(points).conditions if "direction" in c.at)
