"""Two presentations may differ by the solver's own errors, and by what those allow alone."""

import dataclasses

import pytest

from mbsbench.harness.judge.invariance import (
    CONFIRMED,
    COST,
    ERROR,
    HALVES,
    ROUTES,
    SLACK,
    UNSURE,
    Yardstick,
    describe_rerun,
    do_routes_agree,
    is_fault_confirmed,
)
from mbsbench.tests.factories import make_record

YARD = Yardstick(level=1e-6, halved=1e-3, growth=1.0, steps=100, size=1.0)


@pytest.mark.parametrize(
    ("deviation", "verdict"),
    [(1e-6, "holds"), (2e-3, "holds"), (HALVES * 1e-3 + 2e-5, "undecided"), (1.2 * HALVES * 1e-3, "broken")],
)
def test_a_deviation_is_broken_beyond_the_bound_and_its_uncertainty(deviation, verdict):
    assert YARD.judge(deviation) == verdict and YARD.is_broken(deviation) == (verdict == "broken")


def test_fixed_steps_are_exact_as_far_as_their_equations_are_solved():
    """Under error control nothing is said of exactness."""
    assert YARD.is_exact(0.9 * SLACK * 1e-6) and not YARD.is_exact(2.0 * SLACK * 1e-6)
    assert not dataclasses.replace(YARD, halved=0.0).is_exact(0.0)


def test_a_bound_above_the_size_decides_nothing():
    """Any two ends of a mechanism are nearer; a symmetry that is kept exactly holds all the same."""
    wide = dataclasses.replace(YARD, halved=1.0)
    assert wide.judge(0.5) == "undecided" and wide.judge(1e-6) == "holds"


def test_all_that_is_allowed_grows_on_a_way_there_and_back():
    back = dataclasses.replace(YARD, growth=9.0, grown=10.0, least=1e-4)
    once = dataclasses.replace(back, grown=1.0)
    assert (back.bound, back.exact) == pytest.approx((10.0 * once.bound, 10.0 * once.exact))
    assert once.return_factor == 10.0 and once.exact > 1e-4


def test_a_deviation_that_is_no_number_is_broken():
    """What is not known to be small is not allowed."""
    assert YARD.is_broken(float("nan")) and 0.0 < UNSURE < 0.5


def test_two_answers_apart_cannot_both_be_right():
    """One of two that differ by more than the bound is off by half of it at least, and routes may blur a tenth."""
    assert CONFIRMED + ROUTES <= 0.5
    assert is_fault_confirmed(0.45, 1.0) and not is_fault_confirmed(0.35, 1.0)
    assert do_routes_agree(0.09, 1.0) and not do_routes_agree(0.11, 1.0)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, ""),
        ({"status": "wrong"}, "success when run again"),
        ({"motion_error_max_m": 1.0 - 2.0 * ERROR}, "an error of 1 m when run again"),
        ({"cpu_median_s": 0.9 * COST}, "1 s of CPU when run again"),
        ({"cpu_median_s": 1.1 * COST}, ""),
    ],
)
def test_a_run_made_again_has_the_status_the_error_and_much_of_the_cost(changed, words):
    own = make_record(case="c", status="success", motion_error_max_m=1.0, cpu_median_s=1.0)
    assert describe_rerun(dataclasses.replace(own, **changed), own) == (f"c: {words}" if words else "")
    assert describe_rerun(None, own)
