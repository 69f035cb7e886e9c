"""A few runs tell an order by the finest slope, and Richardson's estimate bounds what a finer step leaves."""

import math

import numpy as np
import pytest

from mbsbench.harness.judge.order import (
    ITERATED,
    LEAST_ORDER,
    ROUNDED,
    SLOPE,
    bound_fine_error,
    bound_remainder,
    find_least_fall,
    grows_or_stays_constant,
    judge_ladder,
    measure_slopes,
    remove_power,
)
from mbsbench.harness.results.findings import Verdict

STEPS = 0.04 * 0.5 ** np.arange(4)
TOLERANCES = (1e-4, 1e-6, 1e-8)


def judged(errors, declared=2.0, control="dt", settings=STEPS):
    return judge_ladder(control, settings, errors, "of it", resolved=ROUNDED, declared=declared)


@pytest.mark.parametrize(("order", "verdict"), [(1.0, "FAILED"), (1.79, "FAILED"), (1.81, "MET"), (2.0, "MET")])
def test_the_finest_of_three_halvings_is_at_most_a_fifth_below_the_declared_order(order, verdict):
    """C dt^p, whatever the coarsest step does."""
    errors = STEPS**order
    errors[0] *= 3.0
    found = judged(errors)
    assert found.verdict is Verdict[verdict] and found.value == pytest.approx(order)
    assert found.count == 4 and found.least == 2.0 - SLOPE


@pytest.mark.parametrize(("order", "said"), [(2.15, False), (2.25, True), (4.0, True)])
def test_an_order_above_the_declared_one_is_met_and_said(order, said):
    """It is no fault, and no certificate either."""
    found = judged(STEPS**order)
    assert found.verdict is Verdict.MET and found.words.startswith("higher than declared") == said


def test_steps_need_not_be_halved():
    """The slope is against the steps themselves: a run that is missing makes no order of twice its size."""
    steps = np.array([0.04, 0.01, 0.0025])
    assert measure_slopes(steps, 5.0 * steps**3) == pytest.approx([3.0, 3.0])
    assert judged(steps**1.0, settings=steps).verdict is Verdict.FAILED


def test_a_floor_of_iterations_hides_an_order_and_one_above_it_does_not():
    """The steepest slope counts below ``ITERATED``; above, an error that stays is a missing term."""
    low, high = 0.5 * ITERATED, 2.0 * ITERATED
    assert judged([64.0 * low, 16.0 * low, low, low], 4.0).verdict is Verdict.MET
    assert judged([256.0 * high, 16.0 * high, high, high], 4.0).verdict is Verdict.FAILED


def test_rounding_alone_tells_no_order():
    """One error above it has no slope; no number is a failure."""
    found = judged([1e-10, 1e-12, 1e-13, 3e-13])
    assert found.verdict is Verdict.OPEN and found.count == 0
    assert judged([1e-3, math.nan, 1e-5, 1e-6]).verdict is Verdict.FAILED


def test_without_a_declared_order_errors_fall_at_least_like_a_first_order():
    """To the same 0.2."""
    assert judged(STEPS**0.85, math.nan).verdict is Verdict.MET
    assert judged(STEPS**0.75, math.nan).verdict is Verdict.FAILED


@pytest.mark.parametrize(
    ("errors", "verdict"),
    [
        ((1e-3, 1e-4, 0.9e-5), "MET"),  # as the root of rtol, which is a hundredth over the ladder
        ((1e-3, 1e-4, 2e-5), "FAILED"),
        ((1e-3, 1e-3, 1e-3), "FAILED"),
        ((5e-11, 2e-11, 1e-13), "MET"),  # nothing finer can be seen
        ((5e-11, 2e-11, 6e-11), "FAILED"),
    ],
)
def test_errors_follow_a_tolerance_at_least_as_its_root_or_to_rounding(errors, verdict):
    assert judged(errors, control="rtol", settings=TOLERANCES).verdict is Verdict[verdict]


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_the_change_at_half_a_step_bounds_the_error_of_this_order_and_of_no_lower_one(order):
    """The error at half the step is the change over 2^p - 1; one that stays, or of half the order, exceeds twice it."""
    assert bound_fine_error(1.0 - 0.5**order, order) == pytest.approx(2.0 * 0.5**order)
    for fine in (1.0, 0.5 ** (0.5 * order)):
        assert fine > bound_fine_error(1.0 - fine, order)


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_what_does_not_fall_is_what_is_left(order):
    """Of C dt^p + D at dt and at half of it, D; without a declared order the first is taken."""
    scheme, stays = np.array([1.0, 3.0, 2.0]), np.array([0.0, 0.5, 0.25])
    fine = scheme / 2.0**order + stays
    assert remove_power(scheme + stays, fine, order) == pytest.approx(stays)
    assert remove_power(scheme + stays, scheme / 2.0 + stays, math.nan) == pytest.approx(stays)


def test_what_stays_should_fall_like_a_convergent_scheme_or_a_tolerance():
    assert bound_remainder(1.0) == pytest.approx(2.0**-LEAST_ORDER)
    assert bound_remainder(1.0, find_least_fall([1e-4, 1e-6, 1e-8])) == pytest.approx(0.01)
    assert bound_remainder(0.0) > 0.0


def test_a_residual_is_of_the_motion_if_it_grows_or_is_constant():
    t = np.linspace(0.0, 1.0, 101)
    assert grows_or_stays_constant(t, t) and grows_or_stays_constant(t, np.ones_like(t))
    assert not grows_or_stays_constant(t, 1.0 + np.sin(40.0 * t))
