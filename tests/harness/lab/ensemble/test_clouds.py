"""Clouds of a pendulum: true, biased, coarse, crashing."""

import dataclasses
import os

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.lab.ensemble.clouds import ConfiguredSolver, make_ensemble, run_cloud
from mbsbench.harness.lab.ensemble.sampling import interpolate_state
from mbsbench.harness.lab.ensemble.verdict import ALL_C, NO_DIFFERENCE, compare_clouds, judge_comparisons
from mbsbench.harness.mechanics.motion import constraint, constraint_rate
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.mechanics.types import Status, StepControl

N, SPREAD = 40, 1e-3
AT = (0.2, 0.5)


@pytest.fixture(scope="module")
def ensemble():
    """Forty starts around that of a plane pendulum."""
    return make_ensemble(registry.make_problem("simple_pendulum"), SPREAD, 1, AT)


def make_code(name: str, **control: float) -> ConfiguredSolver:
    """A solver of the catalogue."""
    return ConfiguredSolver(name, "", registry.make_solver(name), StepControl(**control))


@pytest.fixture(scope="module")
def true(ensemble):
    """The true clouds from the starts of solvers and from others."""
    code = make_code("rkmk_dop853", rtol=1e-10)
    return run_cloud(ensemble, code, range(N), 1), run_cloud(ensemble, code, range(N, 2 * N), 1)


def test_starts_are_consistent_and_depend_on_seed_and_member_alone(ensemble):
    """Each is drawn by its own number, so an ensemble of any size has the same first members."""
    system = ensemble.problem.system
    starts = [ensemble.draw_start(k) for k in (0, 1, 0)]
    np.testing.assert_array_equal(starts[0].r, starts[2].r)
    assert np.max(np.abs(starts[0].r - starts[1].r)) > 0.0
    assert np.max(np.abs(dataclasses.replace(ensemble, seed=2).draw_start(0).r - starts[0].r)) > 0.0
    for s in map(States.one, starts):
        assert max(np.abs(constraint(system, s)).max(), np.abs(constraint_rate(system, s)).max()) < 1e-9


def test_observables_are_functions_of_the_state_alone():
    """The chain's energy of the mean velocity needs a step, which solvers choose; energy itself is always there."""
    names = [o.name for o in make_ensemble(registry.make_problem("chain"), SPREAD, 1, AT).observables]
    assert names == ["E_x", "E_y", "E_z", "out_of_plane", "energy"]


def test_a_perfect_solver_differs_by_chance_alone(ensemble, true):
    """The same integrator from other starts; its members are exact at its own starts."""
    found = compare_clouds(ensemble, true[0], *true)
    assert judge_comparisons(found) == NO_DIFFERENCE
    assert all(c.error == 0.0 and c.missing == 0 for c in found)


def test_gravity_one_percent_off_is_found(ensemble, true):
    """Energy scales with gravity: 1 % is ten times the spread of 1e-3."""
    heavy = registry.make_problem("simple_pendulum", {"gravity": 1.01 * 9.81})
    wrong = make_ensemble(heavy, SPREAD, 1, AT)
    cloud = run_cloud(wrong, true[0].code, range(N), 1)
    assert "P_y at 0.5 s" in judge_comparisons(compare_clouds(ensemble, cloud, *true))


def test_without_chaos_the_error_of_members_is_that_of_the_run(ensemble, true):
    """Neighbours have the same error to the first order: the spread changes it by a share of its own size."""
    code = make_code("rattle", dt=0.01)
    found = compare_clouds(ensemble, run_cloud(ensemble, code, range(12), 1), *(_first(c, 12) for c in true))
    (last,) = (c for c in found if c.quantity == ALL_C and c.t_s == AT[-1])
    runs = [c.solver.solve(ensemble.problem, c.control) for c in (code, true[0].code)]
    single, exact = (interpolate_state(run.states, AT[-1]).r for run in runs)
    assert last.error == pytest.approx(np.linalg.norm(single - exact), rel=20.0 * SPREAD)


def test_states_between_steps_are_those_of_the_motion(ensemble):
    """Steps of 0.02 s joined by degree 7 are as good as the integrator; at a step it is the step's own state."""
    problem = ensemble.problem
    code = make_code("rkmk_dop853", rtol=1e-12, max_step=0.02)
    s = code.solver.solve(problem, code.control).states
    for t in (0.0131, 0.211, 0.487):
        end = dataclasses.replace(problem, t_end=t)
        wanted, found = code.solver.solve(end, code.control).states[-1], interpolate_state(s, t)
        for name in ("r", "R", "v", "Omega"):
            np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), atol=1e-9)
    np.testing.assert_array_equal(interpolate_state(s, s.times[3]).R, s.R[3])
    with pytest.raises(ValueError, match="ends at"):
        interpolate_state(s, 1.0)


def test_missing_members_are_counted_and_leave_no_clean_verdict(ensemble, true):
    """A member that raises, one that kills its process, one that stops early: each costs itself alone."""
    inner, starts = true[0].code.solver, [ensemble.draw_start(k).R for k in range(20)]

    class Fragile:
        name, paper_label, control = "fragile", "", "rtol"

        def refuses(self, problem, control):
            return None

        def solve(self, problem, control):
            (member,) = (k for k, R in enumerate(starts) if np.array_equal(R, problem.initial.R))
            if member == 1:
                raise RuntimeError("no")
            if member == 3:
                os._exit(9)
            if member == 4:
                short = inner.solve(dataclasses.replace(problem, t_end=0.3), control)
                return dataclasses.replace(short, status=Status.STALLED, message="at 0.3 s")
            return inner.solve(problem, control)

    code = dataclasses.replace(true[0].code, name="fragile", solver=Fragile())
    cloud = run_cloud(ensemble, code, range(20), 1)
    assert [line.split(":")[0] for line in cloud.failures] == ["member 1", "member 3", "member 4"]
    found = compare_clouds(ensemble, cloud, *(_first(c, 20) for c in true))
    assert {(c.t_s, c.missing, c.members) for c in found} == {(AT[0], 2, 18), (AT[1], 3, 17)}
    assert judge_comparisons(found).startswith("incomplete")


def _first(cloud, n):
    """The first members."""
    return dataclasses.replace(cloud, values=cloud.values[:n], C=cloud.C[:n], drawn=cloud.drawn[:n])
