"""ODE-GC by the laws it must obey: exactness, order, reversal, momentum, power, and two routes to one step."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import root

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.motion import angular_momentum, constraint, energy
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import Joint, RigidBody, assemble
from mbsbench.harness.mechanics.work import power
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory

from ..arbitrary_systems import consistent, linkage


def run(problem: Problem, dt: float, solver: str = "gc_weak_form", **options) -> Trajectory:
    """A run that must succeed."""
    out = make_solver(solver, options).solve(problem, StepControl(dt=dt))
    assert out.status == Status.SUCCESS, out.message
    return out


def orders(errors: list[float]) -> np.ndarray:
    """Observed orders from halvings of dt."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def test_torque_free_sphere_is_exact_in_one_step_of_300_s():
    """The step turns about a fixed axis at constant rate, which is the exact motion (Sect. 5.1)."""
    problem = make_problem("torque_free_body", {"t_end": 300.0})
    out = run(problem, 300.0)
    exact = problem.reference().states(out.t)
    assert len(out.t) == 2
    assert np.max(so3.angle_between(out.states.R, exact.R)) < 1e-11
    assert np.max(np.abs(out.states.Omega - exact.Omega)) < 1e-11


@pytest.mark.parametrize("solver", ["gc_weak_form", "gc_augmented_lagrangian"])
def test_second_order_on_the_spatial_pendulum(solver):
    """The spatial pendulum alone exercises the B term; positions and velocities within 1.9..2.1 in three halvings."""
    problem = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 3.0})
    reference = problem.reference()
    position, velocity = [], []
    for dt in (0.02, 0.01, 0.005, 0.0025):
        out = run(problem, dt, solver)
        exact = reference.states(out.t)
        position.append(np.max(np.abs(out.states.r - exact.r)))
        velocity.append(np.max(np.abs(out.states.v - exact.v)))
    assert np.all(np.abs(orders(position) - 2.0) < 0.1)
    assert np.all(np.abs(orders(velocity) - 2.0) < 0.1)


def test_without_the_b_term_the_order_is_lost():
    """The planted error is seen in the zero gauge, where nu is of order dt and its B term of order dt^2 a step.

    In the symmetric gauge the term is the difference D_dot1 - D_dot0 times nu: dropping it costs a third more error
    in 3 s but not the order, so the order alone does not guard it; the error does.
    """
    problem = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 3.0})
    reference = problem.reference()

    def error(dt, **options):
        out = run(problem, dt, **options)
        return np.max(np.abs(out.states.r - reference.states(out.t).r))

    without = [error(dt, gauge="zero", b_term=False) for dt in (0.01, 0.005, 0.0025)]
    assert np.all(orders(without) < 1.2)
    assert error(0.01, b_term=False) > 1.1 * error(0.01)


@pytest.mark.parametrize("gauge", ["symmetric", "zero", "accumulate"])
def test_every_gauge_has_order_two(gauge):
    """Only increments of mu are physical: the gauge changes the error, not its order."""
    problem = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 1.0})
    reference = problem.reference()
    more = {"direction": "translation", "mu0": "velocity"} if gauge == "accumulate" else {}
    errors = []
    for dt in (0.01, 0.005, 0.0025):
        out = run(problem, dt, gauge=gauge, **more)
        errors.append(np.max(np.abs(out.states.r - reference.states(out.t).r)))
    assert abs(orders(errors)[-1] - 2.0) < 0.2


def test_accumulating_gauge_is_the_minimal_lie_trapezoid():
    """With c = (e_k, 0), f_bar on and mu0 = v_C the step is L_O1 - L_O0 = dt/2 (tau_O0 + tau_O1), to rounding."""
    m, s, g = 1.4, np.array([0.3, -0.1, 0.2]), np.array([0.4, -1.0, -9.0])
    J = np.array([[0.05, 0.01, 0.0], [0.01, 0.08, 0.0], [0.0, 0.0, 0.06]])
    system = assemble([RigidBody(m, J)], [Joint(0, tuple(-s))], g)
    R, Omega = so3.exp(np.array([0.3, 0.5, -0.2])), np.array([1.0, -2.0, 0.7])
    v = R @ np.cross(Omega, s)
    start = State((R @ s)[None], R[None], v[None], Omega[None])
    problem = Problem("pin", system, start, t_end=1.0, dt=0.01, section="", source="")
    out = run(problem, 0.01, gauge="accumulate", direction="translation", mu0="velocity", tolerance=1e-13)
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


def test_time_reversal_returns_to_the_start():
    """The symmetric gauge makes the step its own inverse under reversed velocities, as far as (74) is solved: to 1e-12.

    At the default tolerance of 1e-8 the positions return to 5e-9 m, the free spin about the bar to 3e-6 rad only.
    """
    problem = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 5.0})
    there = run(problem, 0.01, tolerance=1e-12)
    last = there.states[-1]
    turned = dataclasses.replace(problem, initial=State(last.r, last.R, -last.v, -last.Omega))
    back = run(turned, 0.01, tolerance=1e-12).states[-1]
    assert np.max(np.abs(back.r - problem.initial.r)) < 1e-9
    assert np.max(np.abs(back.R - problem.initial.R)) < 1e-9
    assert np.max(np.abs(back.v + problem.initial.v)) < 1e-9


def test_pendulum_stays_within_its_bounds_for_40_s():
    """dt = 0.01: within 2 cm of the exact motion, |phi| < 3e-4 m."""
    problem = make_problem("spherical_pendulum", {"omega_z": 0.1})
    out = run(problem, 0.01)
    assert np.max(np.linalg.norm(out.states.r - problem.reference().states(out.t).r, axis=-1)) < 0.02
    assert np.max(np.abs(constraint(problem.system, out.states))) < 3e-4


def test_pendulum_has_no_secular_energy_drift_over_200_s():
    """Mean energy errors of the first and last quarter agree within 3e-4 J; the zero gauge drifts fifty times that."""
    problem = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 200.0})
    drift = {}
    for gauge in ("symmetric", "zero"):
        out = run(problem, 0.01, gauge=gauge)
        E = energy(problem.system, out.states)
        quarter = len(E) // 4
        drift[gauge] = abs(np.mean(E[-quarter:]) - np.mean(E[:quarter]))
    assert drift["symmetric"] < 3e-4
    assert drift["zero"] > 5e-3


def test_top_follows_the_exact_nutation():
    """dt = 1e-3: nutation within 0.5 deg over 5 s (Fig. 11a), and order two."""
    problem = make_problem("heavy_top")
    reference = problem.reference()
    theta = next(o for o in problem.observables if o.name == "theta")
    errors = []
    for dt in (1e-3, 5e-4, 2.5e-4):
        out = run(problem, dt)
        errors.append(np.max(np.abs(theta.of(out.states) - theta.of(reference.states(out.t)))))
    assert errors[0] < 0.5
    assert np.all(np.abs(orders(errors) - 2.0) < 0.2)


def test_asymmetric_free_body_keeps_momentum_and_energy():
    """Both exactly, to the Newton tolerance of 1e-12 over 2000 steps.

    Momentum is what (74) balances. Energy: with E = exp(dt/2 (Omega0 + Omega1)^), J Omega1 = E^T J Omega0 and E leaves
    Omega0 + Omega1 alone, so (Omega0 + Omega1) . J (Omega1 - Omega0) = 0. The motion itself has order two.
    """
    problem = make_problem("torque_free_body", {"inertia_factors": (1.0, 1.4, 1.9), "t_end": 20.0})
    reference = problem.reference()
    errors = []
    for dt in (0.02, 0.01, 0.005):
        out = run(problem, dt, tolerance=1e-12)
        H, E = angular_momentum(problem.system, out.states), energy(problem.system, out.states)
        assert np.max(np.abs(H - H[0])) < 1e-9
        assert np.max(np.abs(E - E[0])) < 1e-9
        errors.append(np.max(so3.angle_between(out.states.R, reference.states(out.t).R)))
    assert np.all(np.abs(orders(errors) - 2.0) < 0.2)


def spring_problem(t_end: float) -> Problem:
    """A linkage of spherical and revolute joints with springs and dampers, from an arbitrary consistent start."""
    system = linkage(springs=True)
    return Problem("springs", system, consistent(system, 2), t_end=t_end, dt=1e-3, section="", source="")


@pytest.mark.parametrize("corrective", [True, False])
def test_springs_and_dampers_converge_with_order_two_to_the_strong_form(corrective):
    """With C_bar, K_bar of Eq. (32) or without, the motion is that of Eq. (65), which another route integrates."""
    problem = spring_problem(0.3)
    strong = make_solver("rk45_strong_form").solve(problem, StepControl(rtol=1e-12))
    assert strong.status == Status.SUCCESS
    errors = []
    for dt in (4e-3, 2e-3, 1e-3):
        out = run(problem, dt, corrective=corrective)
        errors.append(np.max(np.abs(out.states.r[-1] - strong.states.r[-1])))
    assert errors[-1] < 1e-4
    assert np.all(np.abs(orders(errors) - 2.0) < 0.2)


def test_dampers_take_the_energy_that_is_lost():
    """Power = dE/dt: the integral of the dampers' power is the change of T + V, to O(dt^2)."""
    problem = spring_problem(0.3)
    gaps = []
    for dt in (1e-3, 5e-4):
        out = run(problem, dt)
        E = energy(problem.system, out.states)
        work = np.trapezoid(power(problem.system, out.states), out.t)
        gaps.append(abs(E[-1] - E[0] - work))
    assert E[-1] < E[0] - 0.01
    assert gaps[-1] < 1e-3 * abs(E[-1] - E[0])


def test_reaction_is_the_constraint_force():
    """Newton's law for C: reaction = m (a_C - g), to O(dt^2)."""
    problem = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 2.0})
    gaps = []
    for dt in (0.01, 0.005):
        out = run(problem, dt)
        a = np.gradient(problem.reference().states(out.t).v[:, 0], out.t, axis=0)[5:-5]
        gaps.append(np.max(np.abs(out.reaction[5:-5] - problem.system.mass[0] * (a - problem.system.gravity))))
    assert gaps[0] < 0.05
    assert orders(gaps)[0] > 1.8


@pytest.mark.parametrize("loop", [{"loop": "proximal"}, {"loop": "nested", "penalty": 1e3}], ids=str)
@pytest.mark.parametrize(("name", "dt"), [("heavy_top", 1e-3), ("spherical_pendulum", 0.01), ("chain", 1e-3)])
def test_augmented_lagrangian_equals_the_weak_form(name, dt, loop):
    """On independent constraints both loops solve the same equations; the chain amplifies the tolerance."""
    problem = make_problem(name, {"t_end": 0.4})
    plain = run(problem, dt)
    augmented = run(problem, dt, "gc_augmented_lagrangian", **loop)
    assert np.array_equal(plain.t, augmented.t)
    assert np.max(np.abs(plain.states.r - augmented.states.r)) < 1e-6


def test_kept_and_exact_newton_agree():
    """How the Newton matrix is renewed changes the path to the solution, not the solution."""
    problem = make_problem("chain", {"t_end": 0.3})
    kept, exact = run(problem, 1e-3, newton="kept"), run(problem, 1e-3, newton="exact")
    assert np.max(np.abs(kept.states.r - exact.states.r)) < 1e-6
    assert exact.counters["newton_iterations"] < kept.counters["newton_iterations"]
    assert exact.counters["factorisations"] > kept.counters["factorisations"]


def test_two_runs_agree_to_the_last_bit():
    """Nothing in a run depends on what ran before it."""
    problem = make_problem("chain", {"t_end": 0.2})
    one, two = run(problem, 1e-3), run(problem, 1e-3)
    assert np.array_equal(one.states.r, two.states.r)
    assert np.array_equal(one.states.R, two.states.R)


def test_a_step_that_is_too_long_is_cut_and_regrown():
    """dt = 0.5 s on the pendulum does not converge as it stands: the grid is met all the same, by cuts."""
    problem = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 10.0})
    out = run(problem, 0.5, max_newton=6)
    assert out.counters["step_cuts"] > 0
    assert np.all(np.isin(np.arange(0.0, 10.01, 0.5), out.t))
    assert out.diagnostics["cut_level"][1:].max() > 0


def test_a_tolerance_below_rounding_ends_in_step_underflow_with_the_steps_so_far():
    """A failure is a result: status, reason, partial trajectory."""
    problem = make_problem("heavy_top", {"t_end": 1.0})
    out = make_solver("gc_weak_form", {"tolerance": 3e-16, "max_cuts": 3}).solve(problem, StepControl(dt=1e-3))
    assert out.status == Status.STEP_UNDERFLOW
    assert "Newton" in out.message
    assert 0.0 < out.t[-1] < 1.0


def test_max_turn_cuts_fast_rotations():
    """No body turns further than asked in one step."""
    problem = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 2.0})
    out = run(problem, 0.01, max_turn=0.02)
    turned = so3.angle_between(out.states.R[1:, 0], out.states.R[:-1, 0])
    assert np.max(turned) < 0.025  # the rate grows a little within the step
    assert len(out.t) > 201


def test_redundant_constraints_are_refused_with_the_rank():
    """The weak form names the rank and the solver to use instead."""
    problem = make_problem("four_bar_grid", {"rows": 2, "columns": 2})
    reason = make_solver("gc_weak_form").refuses(problem, StepControl(dt=1e-2))
    assert "rank" in reason
    assert "gc_augmented_lagrangian" in reason
