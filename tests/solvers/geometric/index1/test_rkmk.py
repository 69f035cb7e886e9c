"""Runge-Kutta-Munthe-Kaas pairs against exact motions: order, tolerance, constraints, redundancy, symmetry."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, energy
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory

SOLVERS = {"rkmk_dopri5": 5.0, "rkmk_dop853": 8.0}
FIXED = 1e6  # a tolerance that accepts every step: max_step alone sets it


def solve(name: str, problem: Problem, rtol: float, **limits: float) -> Trajectory:
    return make_solver(name).solve(problem, StepControl(rtol=rtol, **limits))


def error(problem: Problem, t: Trajectory) -> float:
    reference = problem.reference()
    assert reference is not None
    return float(np.max(np.linalg.norm(t.states.r - reference.states(t.t).r, axis=2)))


@pytest.mark.parametrize(("name", "steps"), [("rkmk_dopri5", (8e-3, 4e-3, 2e-3, 1e-3)),
                                             ("rkmk_dop853", (3.2e-2, 1.6e-2, 8e-3, 4e-3))])  # fmt: skip
def test_order_is_that_of_the_tableau(name, steps):
    """Three halvings on the top; the first steps, grown from 1e-4 s, are shorter and do not matter.

    DOP853's own error constant is so small that poses still fall like h^9 when rounding is reached: at least 8, then.
    """
    problem = make_problem("heavy_top", {"t_end": 1.0})
    errors = [error(problem, solve(name, problem, FIXED, max_step=h)) for h in steps]
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert -0.2 < slopes[-1] - SOLVERS[name] < (0.2 if name == "rkmk_dopri5" else 1.2), slopes


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize(
    ("problem", "allowed"),
    [(("heavy_top", {"t_end": 2.0}), 1e-5), (("spherical_pendulum", {"t_end": 10.0, "omega_z": 0.1}), 1e-5),
     (("chain", {"t_end": 1.0}), 1e-4), (("four_bar_grid", {"t_end": 1.0}), 1e-5)],
)  # fmt: skip
def test_errors_are_small_and_constraints_hold_in_every_step(name, problem, allowed):
    """Projected to rounding in every step, redundant rows with them; energy is as exact as the motion."""
    p = make_problem(*problem)
    t = solve(name, p, 1e-7)
    assert t.status is Status.SUCCESS and t.t[-1] == p.t_end, t.message
    assert error(p, t) < allowed
    assert np.max(np.abs(constraint(p.system, t.states))) < 1e-12
    assert np.max(np.abs(constraint_rate(p.system, t.states))) < 1e-10
    E = energy(p.system, t.states)
    assert np.max(np.abs(E - E[0])) < 1e-3


@pytest.mark.parametrize("name", SOLVERS)
def test_a_turned_frame_changes_nothing(name):
    """Yaw turns gravity, ground points and start: the same steps, the same errors to the digits rounding leaves."""
    runs = []
    for yaw in (0.0, 0.7):
        p = make_problem("heavy_top", {"t_end": 1.0, "yaw": yaw})
        t = solve(name, p, 1e-7)
        runs.append((len(t.t), error(p, t)))
    assert abs(runs[0][0] - runs[1][0]) <= 1
    assert runs[1][1] == pytest.approx(runs[0][1], rel=0.05)


@pytest.mark.parametrize("name", SOLVERS)
def test_limits_are_kept_and_the_steps_so_far_handed_back(name):
    p = make_problem("chain", {"t_end": 5.0})
    t = solve(name, p, 1e-8, max_steps=20)
    assert t.status is Status.STALLED and len(t.t) == 21 and "max_steps = 20" in t.message
    assert t.reaction is not None and t.reaction.shape == (21, p.system.nrows)


def test_reactions_are_those_of_the_exact_motion():
    """Two pairs of other order, at tolerances of other size, agree to the error of the coarser one."""
    p = make_problem("four_bar_grid", {"t_end": 0.5})
    ends = []
    for name, rtol in (("rkmk_dopri5", 1e-8), ("rkmk_dop853", 1e-11)):
        t = solve(name, p, rtol)
        assert t.reaction is not None
        ends.append(t.states.v[-1])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)
