"""What the solvers on the symbolic route refuse, and how their failures come back as results."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import RigidBody, assemble
from mbsbench.harness.types import Problem, Status, StepControl
from mbsbench.solvers.formulations.recording import Clock, StepFailure

ALL = ["rk45_strong_form", "ndf_index1", "ida_index1", "ida_index2", "ida_index3"]


def free_body(theta: float, Omega: tuple[float, float, float]) -> Problem:
    """A symmetric body in free rotation from 3-1-3 angles (0, theta, 0)."""
    system = assemble([RigidBody(1.0, np.eye(3))])
    rest = np.zeros((1, 3))
    start = State(rest, so3.euler313(0.0, theta, 0.0)[None], rest, np.array([Omega]))
    return Problem("free_body", system, start, t_end=3.0, dt=0.1, section="", source="")


@pytest.mark.parametrize("solver", ALL)
def test_a_fixed_step_is_refused_in_words(solver):
    """Error control takes rtol; solve() then hands back the start alone."""
    p, control = make_problem("heavy_top"), StepControl(dt=1e-3)
    made = make_solver(solver)
    assert "rtol" in made.refuses(p, control)
    t = made.solve(p, control)
    assert t.status is Status.REFUSED and len(t.t) == 1 and "rtol" in t.message


@pytest.mark.parametrize("solver", ALL)
def test_a_start_on_the_charts_singularity_is_refused(solver):
    """At theta = 0 precession and spin cannot be told apart: 3-1-3 angles have no rates there, quaternions do."""
    p, control = free_body(0.0, (0.1, 0.2, 0.3)), StepControl(rtol=1e-6)
    assert "sin(theta)" in make_solver(solver, {"coordinates": "euler313"}).refuses(p, control)
    t = make_solver(solver).solve(p, control)
    assert t.status is Status.SUCCESS, t.message


@pytest.mark.parametrize("solver", ["rk45_strong_form", "ndf_index1", "ida_index1"])
def test_steps_shrink_near_the_charts_singularity_only(solver):
    """A body in free rotation passes theta = 0.02 and its angles jump there, which quaternions do not notice."""
    p = free_body(0.5, (-1.0, 0.02, 0.0))
    angles = make_solver(solver, {"coordinates": "euler313"}).solve(p, StepControl(rtol=1e-6))
    quaternions = make_solver(solver).solve(p, StepControl(rtol=1e-6))
    near = np.argmin(angles.diagnostics["chart_margin"])
    assert angles.diagnostics["chart_margin"][near] < 0.05
    assert np.abs(angles.t[near] - 0.5) < 0.05
    here, there = np.diff(angles.t)[near - 1], np.diff(quaternions.t)[np.searchsorted(quaternions.t, 0.5) - 1]
    assert here < 0.2 * there


@pytest.mark.parametrize("solver", ALL)
def test_redundant_rows_are_refused_on_request(solver):
    """One cell of the grid has 14 redundant rows of 20: named in the refusal, dropped by default with a note."""
    p = make_problem("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.01})
    control = StepControl(rtol=1e-5)
    rank = make_solver(solver, {"redundancy": "refuse"}).refuses(p, control)
    assert "rank" in rank and "drop" in rank
    t = make_solver(solver).solve(p, control)
    assert t.status is Status.SUCCESS, t.message
    assert t.notes[0].startswith("dropped ")
    dropped = [int(row) for row in t.notes[0].split(": ")[1].split(",")]
    assert not np.any(t.reaction[:, dropped])


@pytest.mark.parametrize("solver", ALL)
def test_a_limit_on_steps_leaves_a_partial_trajectory(solver):
    """Stalled, with exactly the steps allowed and the time reached in the message."""
    t = make_solver(solver).solve(make_problem("heavy_top"), StepControl(rtol=1e-6, max_steps=7))
    assert t.status is Status.STALLED and len(t.t) == 8 and f"{t.t[-1]:.6g}" in t.message


@pytest.mark.parametrize("solver", ALL)
def test_a_wall_limit_is_kept(solver):
    """A run of hours stops at 50 ms with what it has."""
    t = make_solver(solver).solve(make_problem("heavy_top", {"t_end": 1e4}), StepControl(rtol=1e-9, cpu_limit=0.05))
    assert t.status is Status.STALLED and "CPU limit" in t.message and t.t[-1] < 1e4


@pytest.mark.parametrize("solver", ALL)
def test_the_clock_is_looked_at_at_every_evaluation(solver, monkeypatch):
    """A step near a singular pose may take any number of evaluations: the CPU limit ends it inside."""
    looks = 0

    def check(clock: Clock) -> None:
        nonlocal looks
        looks += 1
        if looks > 400:
            raise StepFailure(Status.STALLED, "the CPU limit was reached")

    monkeypatch.setattr(Clock, "check", check)
    problem = make_problem("n_four_bar", {"windows": 2, "t_end": 10.0})
    t = make_solver(solver).solve(problem, StepControl(rtol=1e-6))
    assert t.status is Status.STALLED and "CPU limit" in t.message
    assert 0 < t.counters["evaluations"] <= looks + t.counters.get("difference_evaluations", 0)


def test_lambda_in_the_error_test_stalls_the_fully_implicit_form():
    """The noise of u' in lambda drives the step down: 10,000 steps do not bring the top to 0.3 s."""
    p, control = make_problem("heavy_top", {"t_end": 0.3}), StepControl(rtol=1e-8, max_steps=10_000)
    inside = make_solver("ida_index1", {"lambda_in_error_test": True}).solve(p, control)
    outside = make_solver("ida_index1").solve(p, control)
    assert inside.status is Status.STALLED and inside.t[-1] < 0.3
    assert outside.status is Status.SUCCESS and len(outside.t) < 2000


def test_lambda_zero_at_the_start_fails_the_first_step_when_lambda_is_tested():
    """The jump to the true lambda does not shrink with the step, so no step is small enough."""
    options = {"consistent_start": False, "lambda_in_error_test": True}
    t = make_solver("ida_index1", options).solve(make_problem("heavy_top"), StepControl(rtol=1e-6))
    assert t.status is Status.STEP_UNDERFLOW and len(t.t) == 1 and "IDA" in t.message


@pytest.mark.parametrize("solver", ["rk45_strong_form", "ndf_index1"])
def test_a_run_that_loses_its_rows_says_so(solver):
    """Two runs swing through aligned bars, where the rows kept at the start lose rank: the run ends there in words."""
    parameters = {"rows": 2, "columns": 1, "release": "all_rows", "rate": 5.0, "t_end": 4.0}
    t = make_solver(solver).solve(make_problem("four_bar_grid", parameters), StepControl(rtol=1e-6, max_steps=5000))
    assert t.status in (Status.SINGULAR, Status.DIVERGED)
    assert "came apart" in t.message or "dependent" in t.message
    assert 0.5 < t.t[-1] < 4.0
