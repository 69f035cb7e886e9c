"""The cost of a short solve is measured in a loop, by a clock that the tests keep: how often, how long, which count."""

import json

import numpy as np
import pytest

from mbsbench import StepControl
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.run import worker
from mbsbench.harness.run.contract import Cost, average_loop_times, make_cost_columns
from mbsbench.tests.factories import run_suite_text

OURS = registry.make_solver("rattle", {})  # whose solves the clock replaces
SET_UP = 0.003  # [s] of each call, beside integration
TIMED = ("work", "frontier", "engines", "paper", "bench", "bench_engines")  # suites made for the times of the frontier


class Clock:
    """Each solve takes the next of ``times`` [s], then ``else_`` for ever, and ``waits`` [s] more by the wall."""

    def __init__(self, times=(), else_=0.01, waits=0.0, code=0.0):
        self.times, self.else_, self.waits, self.code = list(times), else_, waits, code
        self.solves, self.cpu = 0, 0.0

    def solve(self, solver, problem, control):
        integration = self.times[self.solves] if self.solves < len(self.times) else self.else_
        self.solves += 1
        assert self.solves < 5000, "the loop does not end"
        self.cpu += integration + SET_UP + self.code
        found = registry.make_solver("exact", {}).solve(problem, control)
        return found, Cost(integration, SET_UP + self.code, self.code)

    def cpu_seconds(self):
        return self.cpu

    def monotonic(self):
        return self.cpu + self.waits * self.solves


@pytest.fixture
def timed(monkeypatch):
    """The trajectory and cost columns of a run whose solves take the times of ``clock``; reading it takes nothing."""

    def time(clock, repeats=1, min_time=0.2, limit=None, solver=OURS):
        monkeypatch.setattr(worker, "_solve_timed", clock.solve)
        monkeypatch.setattr(worker, "cpu_seconds", clock.cpu_seconds)
        monkeypatch.setattr(worker.time, "monotonic", clock.monotonic)
        monkeypatch.setattr(worker, "_measure_reading_time", lambda: 0.0)
        control = StepControl(dt=0.1, cpu_limit=limit)
        problem = registry.make_problem("free_fall", {})
        return worker.solve_repeatedly(solver, problem, control, repeats, min_time)[1]

    return time


@pytest.mark.parametrize("cost", [1e-3, 5e-3, 0.0199])
def test_short_solves_are_repeated_until_the_calls_took_the_time(timed, cost):
    """All calls together, set-up and the first included; that one warms up and does not count."""
    clock = Clock(else_=cost)
    found = timed(clock)
    assert (clock.solves - 1) * (cost + SET_UP) < 0.2 <= clock.solves * (cost + SET_UP)
    assert found["repeats"] == clock.solves - 1 and found["cpu_median_s"] == pytest.approx(cost)


@pytest.mark.parametrize(
    ("cost", "min_time", "repeats"), [(0.02, 0.2, 1), (0.02, 0.2, 3), (1e-3, 0.0, 1), (1e-3, 0.0, 3)]
)
def test_other_solves_are_repeated_as_often_as_their_run_asks(timed, cost, min_time, repeats):
    """And all count, the first too."""
    clock = Clock(else_=cost)
    assert timed(clock, repeats, min_time)["repeats"] == clock.solves == repeats


def test_costs_are_median_and_quartiles_of_the_warm_solves(timed):
    """Neither the first, twenty times as slow, nor one that was interrupted moves them; the extremes show that one."""
    warm = [1e-3 * (1.0 + 0.01 * k) for k in range(20)]
    found = timed(Clock([0.0199, *warm, 0.019], else_=1.1e-3), min_time=0.12)
    counted = [*warm, 0.019]
    assert found["repeats"] == len(counted)
    assert found["cpu_median_s"] == pytest.approx(np.median(counted))
    assert (found["cpu_min_s"], found["cpu_max_s"]) == (1e-3, 0.019)
    assert warm[4] <= found["cpu_q1_s"] <= warm[5] and warm[14] <= found["cpu_q3_s"] <= warm[16]


def test_more_repeats_do_not_widen_the_spread():
    """Of the same scatter, the quartiles of many are as far apart as those of few; the extremes are not."""
    draw = np.random.default_rng(1).lognormal(0.0, 0.1, (2000, 300))

    def mean_spread(low, high, n):
        columns = [make_cost_columns(row[:n], n) for row in draw]
        return np.mean([c[high] / c[low] for c in columns])

    quartiles, extremes = (
        [mean_spread(*pair, n) for n in (11, 300)] for pair in (("cpu_q1_s", "cpu_q3_s"), ("cpu_min_s", "cpu_max_s"))
    )
    assert quartiles[1] <= quartiles[0] and extremes[1] > 1.2 * extremes[0]


@pytest.mark.parametrize("times", [(3.0,), (2.0, 3.0), (2.0, 9.0, 3.0)])
def test_quartiles_of_up_to_three_are_the_extremes(times):
    """So the spread of results with three repeats is what it was."""
    c = make_cost_columns(times, len(times))
    assert (c["cpu_q1_s"], c["cpu_median_s"], c["cpu_q3_s"]) == (min(times), np.median(times), max(times))


def test_the_limit_on_cpu_time_holds(timed):
    """The next solve would pass it: costs of fewer than three warm solves are those of repeats."""
    clock = Clock(else_=0.01)
    assert timed(clock, limit=0.1)["repeats"] == clock.solves - 1 == 6  # 7 of 13 ms
    clock = Clock(else_=0.01)
    assert timed(clock, limit=0.03)["repeats"] == clock.solves == 2


def test_a_solver_that_waits_is_not_waited_for(timed):
    """Five times the time asked for, after the first, and what has quartiles."""
    clock = Clock(else_=1e-4, waits=0.1)
    assert timed(clock)["repeats"] == clock.solves - 1 == 10
    clock = Clock(else_=1e-4, waits=100.0)
    assert timed(clock)["repeats"] == 3


def test_code_made_in_each_call_is_part_of_the_loop(timed):
    """An engine is built anew; the first building, with cold caches, leaves the others their time."""
    clock = Clock(else_=1e-3, code=0.036)  # 40 ms a call, 4 ms the first
    assert timed(clock)["repeats"] == clock.solves - 1 == 5


def test_solves_without_a_cost_end_too(timed, monkeypatch):
    """Of a clock that stands still, no more than 1000."""
    monkeypatch.setattr(worker, "SHORT", 1.0)
    clock = Clock(else_=-SET_UP)
    assert timed(clock)["repeats"] == 999 == clock.solves - 1


def test_solves_below_the_grain_of_the_clock_count_in_groups():
    """A clock that moves by 1 us gives 21.3 us as 21 or 22; of groups that take 0.1 ms each is right to 1 %."""
    ends = np.floor(21.3 * np.arange(1, 102) + 0.01) * 1e-6
    costs = average_loop_times([1e-4, *np.diff(ends)], OURS, 0.0)
    assert len(costs) == 20 and costs == pytest.approx([21.3e-6] * 20, rel=0.01)
    assert make_cost_columns(costs, 100)["cpu_q3_s"] / make_cost_columns(costs, 100)["cpu_q1_s"] < 1.01
    few = average_loop_times([1e-4, 2e-5, 2e-5, 2e-5, 2e-5], OURS, 0.0)
    assert len(few) >= 3


def test_reading_the_clock_is_not_the_solvers_cost():
    """It is left out of each solve, and leaves nothing below zero."""
    assert average_loop_times([1e-3] * 9, OURS, 1e-6) == pytest.approx([0.999e-3] * 8)
    assert average_loop_times([0.0] * 10, OURS, 1e-6) == [0.0] * 3
    assert 0.0 < worker._measure_reading_time() < 1e-4


def test_what_a_plugin_prepared_in_its_first_solve_is_its_cost(timed):
    """Later solves that take less than half: of ours it was warming up, of a plugin it may be a kept answer."""

    class Plugin:
        """Of no module of this package."""

    Plugin.__module__ = "somebody"
    times = [0.015] + [1e-4] * 2000
    ours, theirs = timed(Clock(times)), timed(Clock(times), solver=Plugin())
    assert ours["cpu_median_s"] == pytest.approx(1e-4) and not ours["left_out"]
    assert (theirs["cpu_median_s"], theirs["repeats"], theirs["left_out"]) == (0.015, 1, True)
    even = timed(Clock([0.015], else_=0.008), solver=Plugin())
    assert even["cpu_median_s"] == 0.008 and even["repeats"] > 1 and not even["left_out"]


@pytest.mark.beyond_core
@pytest.mark.parametrize("name", TIMED)
def test_suites_of_which_a_frontier_is_shown_time_in_loops(name):
    """Every run, since which of them stand in the frontier is known afterwards; ladders of the bench half as long."""
    shortest = 0.1 if name.startswith("bench") else 0.2
    assert {spec.min_time for spec in load_suite(name).specs} == {0.2, shortest}


def test_a_run_in_a_loop_has_the_motion_and_the_counters_of_a_single_solve(tmp_path):
    """Only its costs are of many."""
    text = """
[[runs]]
problem = "spherical_pendulum"
parameters = { t_end = 0.1 }
solver = "rk45_strong_form"
rtol = 1e-4
"""
    once, loop = (
        run_suite_text(tmp_path / name, text + more, plugins=())[0].records[0]
        for name, more in (("a", ""), ("b", "min_time = 0.05\n"))
    )
    assert once.repeats == 1 < loop.repeats and loop.status == "success"
    assert (once.series_sha256, once.steps, once.counters) == (loop.series_sha256, loop.steps, loop.counters)
    assert 0.0 < loop.cpu_min_s <= loop.cpu_q1_s <= loop.cpu_median_s <= loop.cpu_q3_s <= loop.cpu_max_s < 0.02
    assert worker.FIRST not in json.loads(loop.notes)
