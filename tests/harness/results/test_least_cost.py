"""The cheapest run for an error: among runs, and between the runs of a ladder."""

import math

import pytest

from mbsbench.harness.results.least_cost import find_cheapest, find_least_cost

RUNS = [(1e-2, 3.0), (1e-3, 5.0), (1e-3, 4.0), (math.nan, 1.0), (1e-6, 4.0)]  # error, cost


def cheapest(target):
    return find_cheapest(RUNS, target, lambda r: r[0], lambda r: r[1])


def test_the_cheapest_run_reaches_the_error():
    """At most the target; the first of equal cost; an error that is not known reaches nothing."""
    assert [cheapest(t) for t in (0.1, 1e-2, 1e-3, 1e-6)] == [RUNS[0], RUNS[0], RUNS[2], RUNS[4]]
    assert cheapest(1e-7) is None and find_cheapest([], 1.0, float, float) is None


def test_between_two_runs_costs_follow_a_power():
    """Second order: a tenth of the error costs root ten times as much; a run that is cheaper anyway counts."""
    ladder = [(1e-2 / 4.0**k, 2.0**k) for k in range(4)]
    cost, is_bound, index = find_least_cost(ladder, 1e-3)
    assert cost == pytest.approx(math.sqrt(10.0)) and not is_bound and index == 2
    assert find_least_cost(ladder, 1e-2) == (1.0, True, 0)
    assert find_least_cost(ladder, 1e-5) is None
    cheap = [*ladder, (1e-3, 0.5)]
    assert find_least_cost(cheap, 1e-3) == (0.5, True, 4)
