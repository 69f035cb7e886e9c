"""The grid of four-bar linkages (Sect. 5.5): 75 of 400 rows redundant; all rows turning, 32 singular passages."""

from functools import cache

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import energy, point_position
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory
from mbsbench.problems.exact.passages import singular_passages

ALLOWED = 1.0  # [J] the benchmark's own limit
SINGULAR_STEP, SMALL_TURN = 1e-3, 0.005  # [s]; [rad] largest turn of a bar in a step
NEAR = 2e-3  # [s] of an exact passage: two steps


@cache
def grid(release: str = "top_row", **parameters: float) -> Problem:
    return make_problem("four_bar_grid", {"release": release, **parameters})


@cache
def augmented(release: str, dt: float, max_turn: float = 0.0, **parameters: float) -> Trajectory:
    solver = make_solver("gc_augmented_lagrangian", {"max_turn": max_turn})
    t = solver.solve(grid(release, **parameters), StepControl(dt=dt))
    assert t.status is Status.SUCCESS, t.message
    return t


def drift(problem: Problem, t: Trajectory) -> float:
    """max |E - E0| [J] over all steps, the benchmark's rule."""
    E = energy(problem.system, t.states)
    return float(np.max(np.abs(E - E[0])))


def bottom_error(problem: Problem, t: Trajectory) -> float:
    """Largest distance [m] of the two bottom joints from the reference."""
    reference = problem.reference()
    assert reference is not None
    ours, exact = problem.observe(t.states), problem.observe(reference.states(t.t))
    away = [np.hypot(*(ours[f"{p}_{c}"] - exact[f"{p}_{c}"] for c in "yz")) for p in ("bottom_left", "bottom_right")]
    return float(np.max(away))


def node_error(problem: Problem, t: Trajectory) -> float:
    """Largest distance [m] of any node, the lower end of a vertical bar (local x), from the reference."""
    reference = problem.reference()
    assert reference is not None
    exact, foot = reference.states(t.t), np.array([0.5, 0.0, 0.0])
    verticals = [row * 11 + column for row in range(5) for column in range(6)]
    away = [point_position(t.states, b, foot) - point_position(exact, b, foot) for b in verticals]
    return float(np.max(np.linalg.norm(away, axis=-1)))


def test_plain_weak_form_refuses_with_the_rank():
    """The saddle of Sect. 4.2 is singular with 75 dependent rows; the reason names the rank and the way out."""
    reason = make_solver("gc_weak_form").refuses(grid(), StepControl(dt=1e-2))
    assert reason is not None
    assert "325" in reason and "gc_augmented_lagrangian" in reason


def test_top_row_keeps_energy_and_reference():
    """dt = 5e-3, 10 s: drift under 0.03 J, bottom joints within 1e-3 m."""
    t = augmented("top_row", 5e-3)
    assert drift(grid(), t) < 0.03
    assert bottom_error(grid(), t) < 1e-3


@pytest.mark.xfail(strict=True, reason="1.05e-3 m in the top row: the scheme's own dt^2, see the observed order")
def test_every_node_of_the_top_row_release_is_within_a_millimetre():
    """All 30 nodes, not the bottom joints alone; the ends of the verticals move most."""
    problem, t = grid(), augmented("top_row", 5e-3)
    assert node_error(problem, t) < 1e-3


def test_error_falls_with_the_square_of_the_step():
    """Three halvings over 10 s; the last slope within 0.2 of 2."""
    errors = [bottom_error(grid(), augmented("top_row", dt)) for dt in (2e-2, 1e-2, 5e-3, 2.5e-3)]
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert abs(slopes[-1] - 2.0) < 0.2, slopes


@pytest.mark.parametrize("solver", ["rk45_strong_form", "ndf_index1", "ida_index1"])
def test_independent_rows_carry_error_control(solver):
    """Rows chosen at the start stay independent while no row folds; the drift at 1e-6 is far below the limit."""
    problem = make_problem("four_bar_grid", {"t_end": 2.0})
    t = make_solver(solver).solve(problem, StepControl(rtol=1e-6))
    assert t.status is Status.SUCCESS, t.message
    assert "rank 325" in t.notes[0]
    assert drift(problem, t) < 0.02 * ALLOWED


@pytest.mark.parametrize(
    ("t_end", "passages", "max_turn"),
    [(5.3, 16, 0.0), *(pytest.param(10.0, 32, turn, marks=pytest.mark.slow) for turn in (0.0, SMALL_TURN))],
    ids=["beyond the closest two", "by itself", "small turns"],
)
def test_all_singular_passages_are_crossed(t_end, passages, max_turn):
    """32 passages in 10 s, 16 to beyond two that are 8 ms apart: each found where the reference has it, with drift
    under 0.5 J and nodes within 2 cm.
    """
    problem = grid("all_rows", t_end=t_end)
    t = augmented("all_rows", SINGULAR_STEP, max_turn, t_end=t_end)
    exact = np.array([time for time, _ in singular_passages(problem, problem.t_end)])
    found = np.array([e["t"] for e in t.events])
    assert len(exact) == len(found) == passages
    away = np.min(np.abs(found[:, None] - exact), axis=0)
    assert np.max(away) < NEAR, exact[away > NEAR]
    assert drift(problem, t) < 0.5
    assert node_error(problem, t) < 0.02
