"""Laws of ODE-GC alone: its gauges, two routes to one step, cuts of steps, the refusal of redundant rows."""

import numpy as np
import pytest
from scipy.optimize import root

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import Joint, RigidBody, assemble
from mbsbench.harness.mechanics.types import Problem, Status, StepControl
from mbsbench.tests.comparing import assert_same
from mbsbench.tests.factories import solve_run

from ..runs import drift, error, pendulum


def test_the_b_term_counts_in_the_symmetric_gauge():
    """There it is the difference D_dot1 - D_dot0 times nu: dropping it costs a third more error, but not the order."""
    p = pendulum(3.0)
    assert error(p, solve_run(p, 0.01, b_term=False)) > 1.1 * error(p, solve_run(p, 0.01))


def test_accumulating_gauge_is_the_minimal_lie_trapezoid():
    """With c = (e_k, 0), f_bar on and mu0 = v_C the step is L_O1 - L_O0 = dt/2 (tau_O0 + tau_O1), to rounding."""
    m, s, g = 1.4, np.array([0.3, -0.1, 0.2]), np.array([0.4, -1.0, -9.0])
    J = np.array([[0.05, 0.01, 0.0], [0.01, 0.08, 0.0], [0.0, 0.0, 0.06]])
    system = assemble([RigidBody(m, J)], [Joint(0, tuple(-s))], g)
    R, Omega = so3.exp(np.array([0.3, 0.5, -0.2])), np.array([1.0, -2.0, 0.7])
    v = R @ np.cross(Omega, s)
    start = State((R @ s)[None], R[None], v[None], Omega[None])
    problem = Problem("pin", system, start, t_end=1.0, dt=0.01, section="", source="")
    out = solve_run(problem, 0.01, gauge="accumulate", direction="translation", mu0="velocity", tolerance=1e-13)
    J_O = J + m * (s @ s * np.eye(3) - np.outer(s, s))

    def step(R0, Omega0, dt):
        def balance(Omega1):
            R1 = R0 @ so3.exp(0.5 * dt * (Omega0 + Omega1))
            torque = 0.5 * dt * np.cross(R0 @ s + R1 @ s, m * g)
            return R1 @ J_O @ Omega1 - R0 @ J_O @ Omega0 - torque

        Omega1 = root(balance, Omega0, tol=1e-15, options={"xtol": 1e-15}).x
        return R0 @ so3.exp(0.5 * dt * (Omega0 + Omega1)), Omega1

    worst = 0.0
    for k, dt in enumerate(np.diff(out.t)):
        R, Omega = step(R, Omega, dt)
        after = out.states[k + 1]
        worst = max(worst, np.max(np.abs(after.Omega[0] - Omega)), np.max(np.abs(after.R[0] - R)))
    assert worst < 1e-11  # 100 steps, each to 1e-13 of the Newton tolerance


def test_pendulum_has_no_secular_energy_drift_over_200_s():
    """Mean energy errors of the first and last quarter agree within 3e-4 J; the zero gauge drifts fifty times that."""
    p, away = pendulum(200.0), {}
    for gauge in ("symmetric", "zero"):
        E = drift(p, solve_run(p, 0.01, gauge=gauge))
        away[gauge] = abs(np.mean(E[-(len(E) // 4) :]) - np.mean(E[: len(E) // 4]))
    assert away["symmetric"] < 3e-4
    assert away["zero"] > 5e-3


@pytest.mark.parametrize("loop", [{"loop": "proximal"}, {"loop": "nested", "penalty": 1e3}], ids=str)
@pytest.mark.parametrize(("name", "dt"), [("heavy_top", 1e-3), ("spherical_pendulum", 0.01), ("chain", 1e-3)])
def test_augmented_lagrangian_equals_the_weak_form(name, dt, loop):
    """On independent constraints both loops solve the same equations; the chain amplifies the tolerance."""
    problem = make_problem(name, {"t_end": 0.4})
    plain = solve_run(problem, dt)
    augmented = solve_run(problem, dt, "gc_augmented_lagrangian", **loop)
    assert_same(plain.t, augmented.t)
    assert np.max(np.abs(plain.states.r - augmented.states.r)) < 1e-6


def test_kept_and_exact_newton_agree():
    """How the Newton matrix is renewed changes the path to the solution, not the solution."""
    problem = make_problem("chain", {"t_end": 0.3})
    kept, exact = solve_run(problem, 1e-3, newton="kept"), solve_run(problem, 1e-3, newton="exact")
    assert np.max(np.abs(kept.states.r - exact.states.r)) < 1e-6
    assert exact.counters["newton_iterations"] < kept.counters["newton_iterations"]
    assert exact.counters["factorisations"] > kept.counters["factorisations"]


def test_a_step_that_is_too_long_is_cut_and_regrown():
    """dt = 0.5 s on the pendulum does not converge as it stands: the grid is met all the same, by cuts."""
    problem = pendulum(10.0)
    out = solve_run(problem, 0.5, max_newton=6)
    assert out.counters["step_cuts"] > 0
    assert set(np.arange(0.0, 10.01, 0.5)) <= set(out.t)
    assert out.diagnostics["cut_level"][1:].max() > 0


def test_a_step_that_no_cut_saves_ends_in_step_underflow_with_the_steps_so_far():
    """A failure is a result: status, reason, partial trajectory. The chain's whip is too fast for half of 20 ms."""
    problem = make_problem("chain", {"t_end": 2.0})
    out = make_solver("gc_weak_form", {"max_cuts": 1}).solve(problem, StepControl(dt=0.02))
    assert out.status == Status.STEP_UNDERFLOW
    assert "Newton" in out.message
    assert 0.0 < out.t[-1] < 2.0


def test_a_tolerance_below_rounding_is_raised_to_it():
    """No iteration meets it: the step is solved to 45 roundings of the root of the energy instead, as without it."""
    problem = make_problem("heavy_top", {"t_end": 0.1})
    ends = [
        make_solver("gc_weak_form", {"tolerance": tolerance, "max_cuts": 3}).solve(problem, StepControl(dt=1e-3))
        for tolerance in (3e-16, 1e-13)
    ]
    assert [out.status for out in ends] == [Status.SUCCESS] * 2
    np.testing.assert_allclose(ends[0].states.r[-1], ends[1].states.r[-1], rtol=0.0, atol=1e-11)


def test_max_turn_cuts_fast_rotations():
    """No body turns further than asked in one step."""
    problem = pendulum(2.0)
    out = solve_run(problem, 0.01, max_turn=0.02)
    turned = so3.angle_between(out.states.R[1:, 0], out.states.R[:-1, 0])
    assert np.max(turned) < 0.025  # the rate grows a little within the step
    assert len(out.t) > 201


def test_redundant_constraints_are_refused_with_the_rank():
    """The weak form names the rank and the solver to use instead."""
    problem = make_problem("four_bar_grid", {"rows": 2, "columns": 2})
    reason = make_solver("gc_weak_form").refuses(problem, StepControl(dt=1e-2))
    assert "rank" in reason
    assert "gc_augmented_lagrangian" in reason
