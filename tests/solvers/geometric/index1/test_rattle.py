"""RATTLE and its compositions: order, reversibility, the free body, constraints, energy over hundreds of periods."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, energy
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory
from mbsbench.solvers.formulations.methods.compositions import COMPOSITIONS

from ...arbitrary_systems import consistent, linkage


def solve(problem: Problem, dt: float, composition: str = "plain", **limits: float) -> Trajectory:
    t = make_solver("rattle", {"composition": composition}).solve(problem, StepControl(dt=dt, **limits))
    assert t.status is Status.SUCCESS, t.message
    return t


def error(problem: Problem, t: Trajectory) -> float:
    reference = problem.reference()
    assert reference is not None
    return float(np.max(np.linalg.norm(t.states.r - reference.states(t.t).r, axis=2)))


STEPS = {"plain": 0.02, "suzuki4": 0.04, "kahan_li6": 0.08, "kahan_li8": 0.16}


@pytest.mark.parametrize("composition", COMPOSITIONS)
def test_order_on_the_spatial_pendulum(composition):
    """Three halvings, positions, last slope within 0.2; order 8 reaches rounding in two."""
    p = make_problem("spherical_pendulum", {"t_end": 4.0, "omega_z": 0.1})
    dt = STEPS[composition]
    halvings = 3 if composition == "kahan_li8" else 4
    errors = np.array([error(p, solve(p, dt / 2**k, composition)) for k in range(halvings)])
    slopes = np.log2(errors[:-1] / errors[1:])
    assert abs(slopes[-1] - COMPOSITIONS[composition][1]) < 0.2, (errors, slopes)


@pytest.mark.parametrize("composition", ["plain", "suzuki4"])
def test_order_on_the_redundant_grid(composition):
    """400 rows of rank 325, all of them kept in the problem."""
    p = make_problem("four_bar_grid", {"t_end": 0.5})
    errors = np.array([error(p, solve(p, dt, composition)) for dt in (0.05, 0.025, 0.0125)])
    assert abs(np.log2(errors[1] / errors[2]) - COMPOSITIONS[composition][1]) < 0.2


def test_asymmetric_inertias_turned_axes_springs_and_dampers_keep_the_order():
    """No two principal inertias alike, axes not those of the bodies, spring-dampers: 2 and 4 against finer steps."""
    for composition, order, dt in (("plain", 2, 4e-3), ("suzuki4", 4, 2e-2)):
        system = linkage(springs=True)
        p = dataclasses.replace(
            make_problem("heavy_top", {"t_end": 0.2}), system=system, initial=consistent(system, 5), reference_from=None
        )
        ends = [solve(p, dt, composition).states.r[-1] for dt in (dt, dt / 2.0, dt / 4.0, dt / 16.0)]
        errors = [np.max(np.abs(e - ends[-1])) for e in ends[:-1]]
        assert abs(np.log2(errors[1] / errors[2]) - order) < 0.2, errors


def test_constraints_hold_to_rounding_in_every_step():
    p = make_problem("chain", {"t_end": 0.6})
    t = solve(p, 1e-3)
    assert np.max(np.abs(constraint(p.system, t.states))) < 1e-13
    assert np.max(np.abs(constraint_rate(p.system, t.states))) < 1e-13


def test_a_symmetric_free_body_is_exact_in_any_step():
    """The drift is the exact motion; one step of 50 s differs from the theta functions by rounding of its phase."""
    p = make_problem("torque_free_body", {"t_end": 50.0})
    t = solve(p, 50.0)
    exact = p.reference().states(t.t)
    np.testing.assert_allclose(t.states.R[-1], exact.R[-1], atol=1e-12)


def back(problem: Problem, t: Trajectory, dt: float, composition: str) -> float:
    s = t.states[len(t.t) - 1]
    home = dataclasses.replace(problem, initial=State(s.r, s.R, -s.v, -s.Omega), reference_from=None)
    end = solve(home, dt, composition).states[-1]
    return float(np.max(np.abs(end.r - problem.initial.r)))


@pytest.mark.parametrize("composition", ["plain", "suzuki4", "kahan_li6"])
@pytest.mark.parametrize(("name", "t_end", "dt"), [("spherical_pendulum", 5.0, 0.01), ("chain", 0.5, 1e-3)])
def test_there_and_back_ends_at_the_start(name, t_end, dt, composition):
    """Velocities reversed, the same steps lead back, to rounding that the motion has let grow."""
    p = make_problem(name, {"t_end": t_end})
    assert back(p, solve(p, dt, composition), dt, composition) < 1e-11


def test_energy_stays_bounded_over_hundreds_of_periods():
    """Mean energy errors of the first and the last quarter of 200 s agree to 1 %: no drift."""
    p = make_problem("spherical_pendulum", {"t_end": 200.0})
    t = solve(p, 0.01)
    E = energy(p.system, t.states) - energy(p.system, t.states)[0]
    quarter = len(E) // 4
    first, last = np.mean(E[:quarter]), np.mean(E[-quarter:])
    assert abs(last - first) < 0.01 * abs(first)


def test_a_step_that_is_too_long_says_so():
    t = make_solver("rattle").solve(make_problem("heavy_top", {"t_end": 1.0}), StepControl(dt=0.5))
    assert t.status in (Status.STEP_UNDERFLOW, Status.DIVERGED) and "t = " in t.message
