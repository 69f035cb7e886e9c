"""Radau IIA on stabilised index 2 against exact motions: order, tolerance, constraints, redundancy, frames."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, energy
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory

FIXED = 1e6  # a tolerance that accepts every step: max_step alone sets it


def solve(problem: Problem, rtol: float, **limits: float) -> Trajectory:
    t = make_solver("radau_ggl").solve(problem, StepControl(rtol=rtol, **limits))
    assert t.status is Status.SUCCESS, t.message
    return t


def error(problem: Problem, t: Trajectory) -> float:
    reference = problem.reference()
    assert reference is not None
    return float(np.max(np.linalg.norm(t.states.r - reference.states(t.t).r, axis=2)))


@pytest.mark.parametrize(
    ("name", "t_end", "h"), [("heavy_top", 1.0, 0.02), ("spherical_pendulum", 4.0, 0.16), ("four_bar_grid", 0.3, 0.04)]
)
def test_order_is_five(name, t_end, h):
    """Three halvings of the step; the first ones, grown from 1e-4 s, are shorter and do not matter."""
    p = make_problem(name, {"t_end": t_end})
    errors = np.array([error(p, solve(p, FIXED, max_step=h / 2**k)) for k in range(4)])
    slopes = np.log2(errors[:-1] / errors[1:])
    assert abs(slopes[-1] - 5.0) < 0.2, (errors, slopes)


@pytest.mark.parametrize(
    ("problem", "allowed"),
    [(("heavy_top", {"t_end": 2.0}), 1e-7), (("spherical_pendulum", {"t_end": 10.0, "omega_z": 0.1}), 1e-7),
     (("chain", {"t_end": 1.0}), 1e-7), (("four_bar_grid", {"t_end": 1.0}), 1e-7)],
)  # fmt: skip
def test_errors_are_small_and_constraints_hold_in_every_step(problem, allowed):
    """phi and A v to the tolerance of the iteration, 1e-10, that of A v over the step; 75 redundant rows among 400."""
    p = make_problem(*problem)
    t = solve(p, 1e-7)
    assert t.t[-1] == p.t_end and error(p, t) < allowed
    assert np.max(np.abs(constraint(p.system, t.states))) < 1e-10
    assert np.max(np.abs(constraint_rate(p.system, t.states))) < 1e-8
    E = energy(p.system, t.states)
    assert np.max(np.abs(E - E[0])) < 1e-5


def test_a_turned_frame_changes_nothing():
    """An oblique rotation turns gravity, ground points and start."""
    runs = []
    for frame in ({}, {"rotation": (0.3, -0.5, 0.7)}):
        p = make_problem("heavy_top", {"t_end": 1.0, **frame})
        t = solve(p, 1e-6)
        runs.append((len(t.t), error(p, t)))
    assert abs(runs[0][0] - runs[1][0]) <= 2
    assert runs[1][1] == pytest.approx(runs[0][1], rel=0.05)


def test_reactions_are_those_of_index_1():
    """At the chain's end, against DOP853's: of order 3 in the last step, which is cut to end in time."""
    p = make_problem("chain", {"t_end": 0.4})
    exact = make_solver("rkmk_dop853").solve(p, StepControl(rtol=1e-10)).reaction[-1]
    runs = [solve(p, FIXED, max_step=h) for h in (0.01, 0.0025)]
    errors = [np.max(np.abs(t.reaction[-1] - exact)) for t in runs]
    ratio = np.diff(runs[0].t)[-1] / np.diff(runs[1].t)[-1]
    assert np.log(errors[0] / errors[1]) / np.log(ratio) > 2.5, errors


def test_counts_and_limits():
    p = make_problem("chain", {"t_end": 5.0})
    t = make_solver("radau_ggl").solve(p, StepControl(rtol=1e-8, max_steps=20))
    assert t.status is Status.STALLED and len(t.t) == 21 and "max_steps = 20" in t.message
    assert t.counters["newton_iterations"] > t.counters["steps"] == 20 <= t.counters["factorisations"]
