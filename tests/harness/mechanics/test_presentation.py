"""The same system presented otherwise moves alike, and what solvers hand over is in the problem's terms."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.judge.metrics.reactions import compute_exact_loads, compute_forces_on_bodies
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.types import StepControl
from mbsbench.harness.run.presenting import present_solver
from mbsbench.tests.comparing import assert_close

from ...solvers.runs import sprung_linkage

PRESENTATIONS = [
    Presentation(mirror="X"),
    Presentation(mirror="Z"),
    Presentation(duplicate=2),
    Presentation(renumber=3),
    Presentation(unit_length=1000.0, unit_mass=0.3, unit_time=60.0),
    Presentation(mirror="Y", duplicate=1, renumber=5, unit_length=0.25, unit_mass=7.0, unit_time=3.0),
]


@pytest.mark.parametrize("presentation", PRESENTATIONS, ids=str)
def test_an_accurate_solver_finds_the_same_motion_and_reactions(presentation):
    """Springs, dampers, spherical and revolute joints: at rtol 1e-11 all that is left is its error."""
    p = sprung_linkage(0.2)
    solver, control = make_solver("rk45_strong_form"), StepControl(rtol=1e-11)
    plain = solver.solve(p, control)
    other = dataclasses.replace(p, presentation=presentation)
    found = present_solver(solver, other).solve(other, control)
    assert found.t[-1] == pytest.approx(plain.t[-1], rel=1e-14)
    for name in ("r", "R", "v", "Omega"):
        gap = getattr(found.states, name)[-1] - getattr(plain.states, name)[-1]
        assert np.max(np.abs(gap)) < 1e-7, name
    ours, theirs = (
        compute_forces_on_bodies(p.system, o.reaction[-1:], o.states.at(slice(-1, None))) for o in (plain, found)
    )
    assert np.max(np.abs(ours - theirs)) < 1e-6 * np.max(np.abs(ours))
    if presentation.duplicate == 0:
        assert found.reaction.shape[1] == p.system.nrows
        gap = np.abs(found.reaction[-1] - plain.reaction[-1])
        assert np.max(gap) < 1e-6 * np.max(np.abs(plain.reaction[-1]))


def test_a_plain_problem_gets_the_solver_itself():
    """Nothing between a solver and a problem as it stands: not a bit changes."""
    solver = make_solver("gc_weak_form")
    assert present_solver(solver, make_problem("chain")) is solver


@pytest.mark.parametrize("given", [{"mirror": "X"}, {"renumber": 2}, {"duplicate": 1}, {"unit_length": 8.0}])
def test_steps_handed_over_on_the_way_are_in_the_problems_terms(given):
    """The rest of a killed run must be readable beside one that ended."""
    problem = make_problem("chain", {"t_end": 0.02, **given})

    class Kept:
        def __init__(self):
            self.rows, self.states = 0, []

        def due(self):
            return True

        def take(self, t, states):
            self.rows += len(t)
            self.states.append(states)

    kept = Kept()
    solver = present_solver(make_solver("ida_index1"), problem)
    out = solver.solve(problem, StepControl(rtol=1e-6, spool=kept))
    handed = np.concatenate([s.r for s in kept.states])
    assert len(handed) > 5
    assert_close(handed[-1], out.states.r[len(handed) - 1], rtol=1e-12, atol=1e-12)


def test_the_way_back_arrives_at_the_start():
    """An accurate solver retraces; a solver that fails on the way back says so and arrives nowhere."""
    problem = make_problem("heavy_top", {"t_end": 0.2, "retrace": True})
    solver = present_solver(make_solver("rk45_strong_form"), problem)
    out = solver.solve(problem, StepControl(rtol=1e-10))
    assert out.t[-1] == 0.2
    assert out.returned is not None
    assert np.max(np.abs(out.returned.r - problem.initial.r)) < 1e-8
    assert np.max(np.abs(out.returned.Omega - problem.initial.Omega)) < 1e-6


@pytest.mark.parametrize(("name", "t_end"), [("spherical_pendulum", 1.0), ("chain", 0.3), ("four_bar_grid", 0.5)])
def test_exact_pulls_are_the_joint_forces(name, t_end):
    """Two routes: index 1 at the exact states, and the multipliers of an accurate index-1 solution."""
    problem = make_problem(name, {"t_end": t_end})
    out = make_solver("ida_index1").solve(problem, StepControl(rtol=1e-9))
    k = np.searchsorted(out.t, 0.8 * t_end)
    exact = compute_exact_loads(problem.system, problem.reference().states(out.t[k : k + 1]))[..., :3]
    found = compute_forces_on_bodies(problem.system, out.reaction[k : k + 1], out.states.at(slice(k, k + 1)))
    assert np.max(np.abs(found - exact)) < 1e-3
