"""RK45, NDF and IDA on the symbolic route, against exact references and against each other."""

from dataclasses import replace

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import motion, work
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import RigidBody, assemble
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory

ALL = ["rk45_strong_form", "ndf_index1", "ida_index1", "ida_index2", "ida_index3"]
INDEX_1, UP_TO_INDEX_2 = ALL[:3], ALL[:4]
IMPLICIT = ALL[1:]


def solve(solver: str, problem: Problem, rtol: float, options: dict | None = None, **limits: float) -> Trajectory:
    return make_solver(solver, options).solve(problem, StepControl(rtol=rtol, **limits))


def top(t_end: float = 2.0) -> Problem:
    return make_problem("heavy_top", {"t_end": t_end})


def pendulum(t_end: float = 10.0) -> Problem:
    return make_problem("spherical_pendulum", {"t_end": t_end, "omega_z": 0.1})


def error(problem: Problem, t: Trajectory) -> float:
    """Largest distance [m] from the exact motion."""
    reference = problem.reference()
    assert reference is not None
    return float(np.max(np.abs(t.states.r - reference.states(t.t).r)))


@pytest.mark.parametrize("coordinates", ["quaternion", "euler313"])
@pytest.mark.parametrize("solver", UP_TO_INDEX_2)
@pytest.mark.parametrize(("problem", "allowed"), [(top, 1e-4), (pendulum, 1e-3)])
def test_tight_tolerance_reaches_the_exact_motion(problem, allowed, solver, coordinates):
    """At rtol 1e-8 the top stays within 1e-4 m for 2 s, the spatial pendulum within 1e-3 m for 10 s, in both charts."""
    p = problem()
    t = solve(solver, p, 1e-8, {"coordinates": coordinates})
    assert t.status is Status.SUCCESS, t.message
    assert t.t[-1] == p.t_end
    assert error(p, t) < allowed


@pytest.mark.parametrize("solver", ALL)
def test_errors_follow_the_tolerance(solver):
    """A tolerance 1e4 times tighter makes the error at least 50 times smaller: an order of 0.4, even at index 3."""
    p = pendulum(4.0)
    loose, tight = (error(p, solve(solver, p, rtol)) for rtol in (1e-4, 1e-8))
    assert tight < loose / 50.0


@pytest.mark.parametrize(
    ("solver", "options"),
    [
        ("ida_index1", {"form": "se"}),
        ("ida_index1", {"lambda_in_error_test": True, "form": "se"}),
        ("ida_index1", {"alpha": 0.0, "beta": 0.0}),
        ("ida_index1", {"consistent_start": False}),
        ("ida_index2", {"form": "velocity"}),
        ("ida_index2", {"form": "velocity", "alpha": 0.0}),
        ("ndf_index1", {"accelerations": "eliminated"}),
        ("ndf_index1", {"lambda_in_error_test": True, "accelerations": "eliminated"}),
        ("ndf_index1", {"accelerations": "mass_matrix"}),
        ("ndf_index1", {"accelerations": "mass_matrix", "coordinates": "euler313"}),
        ("ndf_index1", {"accelerations": "mass_matrix", "jacobian": "finite_difference", "norm": "max"}),
        ("rk45_strong_form", {"alpha": 5.0, "beta": 5.0}),
        ("rk45_strong_form", {"lambda_in_error_test": True}),
    ],
)
def test_options_change_the_numbers_not_the_motion(solver, options):
    """Every form has the same exact solution."""
    p = pendulum(4.0)
    t = solve(solver, p, 1e-8, options)
    assert t.status is Status.SUCCESS, t.message
    assert error(p, t) < 1e-4


def test_the_mass_matrix_form_costs_jacobians_where_the_mass_depends_on_the_state():
    """d(E y')/dy is left out of Newton's matrix: the same motion to 1e-6 m, more evaluations in Euler angles.

    At Euler angles E depends on the angles; the solver with the exact matrix is the same formula on the same residual.
    """
    p, made = pendulum(4.0), {}
    for form in ("unknown", "mass_matrix"):
        made[form] = solve("ndf_index1", p, 1e-9, {"accelerations": form, "coordinates": "euler313"})
        assert made[form].status is Status.SUCCESS, made[form].message
    assert abs(error(p, made["mass_matrix"]) - error(p, made["unknown"])) < 1e-6
    assert made["mass_matrix"].counters["linear_solves"] > made["unknown"].counters["linear_solves"]


@pytest.mark.parametrize("solver", ALL)
def test_the_reaction_is_the_force_that_bends_the_motion(solver):
    """m v_dot = m g + (A^T reaction)_r: the recorded reaction against differences of the recorded velocity.

    The differences between unequal steps err by their size: 2 % of the largest force at steps below 5 ms.
    """
    p = pendulum(2.0)
    t = solve(solver, p, 1e-7, max_step=5e-3)
    middle = 0.5 * (t.t[1:] + t.t[:-1])
    late = middle > 0.1  # index 3 starts with noise in lambda that its first steps damp
    acceleration = np.diff(t.states.v[:, 0], axis=0) / np.diff(t.t)[:, None]
    force = p.system.mass[0] * (acceleration - p.system.gravity)
    load = np.array([constraint_jacobian(p.system, t.states[k]).T @ t.reaction[k] for k in range(len(t.t))])[:, :3]
    expected = 0.5 * (load[1:] + load[:-1])
    assert np.max(np.abs(force - expected)[late]) < 0.02 * np.max(np.abs(force))


def test_baumgarte_keeps_what_plain_index_1_loses():
    """phi grows quadratically without stabilisation and stays at the tolerance with it."""
    p = make_problem("spherical_pendulum", {"t_end": 20.0, "omega_z": 0.1})
    phi = {}
    for stabilised in (0.0, 5.0):
        t = solve("ida_index1", p, 1e-6, {"alpha": stabilised, "beta": stabilised})
        phi[stabilised] = np.linalg.norm(motion.constraint(p.system, t.states), axis=1)[-1]
    assert phi[5.0] < 1e-5 < phi[0.0]


@pytest.mark.parametrize("solver", UP_TO_INDEX_2)
def test_springs_and_dampers_lose_what_the_dampers_take(solver):
    """E(t) - E(0) = integral of the damping power, by the trapezoid rule on the recorded steps (1 ms: 1e-5 J)."""
    from .arbitrary_systems import consistent, linkage

    system = linkage(springs=True)
    p = Problem("linkage", system, consistent(system, 3), t_end=0.5, dt=1e-3, section="", source="")
    t = solve(solver, p, 1e-8, max_step=1e-3)
    assert t.status is Status.SUCCESS, t.message
    E, power = motion.energy(system, t.states), work.power(system, t.states)
    lost = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(t.t))
    assert E[-1] - E[0] == pytest.approx(lost, abs=1e-5 * abs(E[0]))
    assert lost < -1e-2


@pytest.mark.parametrize("solver", IMPLICIT)
def test_either_jacobian_gives_the_same_motion(solver):
    """A Jacobian decides how Newton's iteration converges, not where to: steps and motion agree within the tolerance.

    The evaluations spent on differences are counted, and are part of the evaluations.
    """
    p = pendulum(2.0)
    exact, differenced = (solve(solver, p, 1e-7, {"jacobian": j}) for j in ("exact", "finite_difference"))
    assert abs(error(p, exact) - error(p, differenced)) < 0.2 * error(p, exact)
    assert differenced.counters["steps"] == pytest.approx(exact.counters["steps"], rel=0.1)
    spent = differenced.counters["difference_evaluations"]
    assert exact.counters["difference_evaluations"] == 0 < spent < differenced.counters["evaluations"]


@pytest.mark.parametrize("coordinates", ["quaternion", "euler313"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-7])
def test_the_stabilised_index_2_keeps_both_levels_and_more_energy_than_index_3(rtol, coordinates):
    """phi = 0 and A u = 0 are rows of their own: both hold to Newton's error, some tolerances; index 3 has phi alone.

    So index 3 loses velocity out of the joint and with it energy, ten times more of each.
    """
    p, kept = pendulum(4.0), {}
    for solver in ("ida_index2", "ida_index3"):
        t = solve(solver, p, rtol, {"coordinates": coordinates})
        E = motion.energy(p.system, t.states)
        norms = [np.max(np.abs(f(p.system, t.states))) for f in (motion.constraint, motion.constraint_rate)]
        kept[solver] = (*norms, np.max(np.abs(E - E[0])))
    (phi, phi_dot, drift), (_, phi_dot_3, drift_3) = kept["ida_index2"], kept["ida_index3"]
    assert phi < 10.0 * rtol and phi_dot < 20.0 * rtol
    assert 10.0 * phi_dot < phi_dot_3 and 10.0 * drift < drift_3


def test_phi_decays_at_the_rate_of_velocity_level_baumgarte():
    """A u + alpha phi = 0 is phi_dot = -alpha phi: from an open joint with that velocity, phi0 exp(-alpha t)."""
    alpha, p = 4.0, pendulum(1.0)
    apart = State(p.initial.r + 0.02, p.initial.R, p.initial.v - alpha * 0.02, p.initial.Omega)
    t = solve("ida_index2", replace(p, initial=apart), 1e-8, {"form": "velocity", "alpha": alpha})
    assert t.status is Status.SUCCESS, t.message
    expected = np.broadcast_to(0.02 * np.exp(-alpha * t.t)[:, None], (len(t.t), 3))
    np.testing.assert_allclose(motion.constraint(p.system, t.states), expected, atol=1e-6)


def spinning_beside(idle: int) -> Problem:
    """One unsymmetric free body in rotation, and ``idle`` bodies at rest."""
    n = 1 + idle
    system = assemble([RigidBody(1.0, np.diag([1.0, 2.0, 2.5]))] * n)
    Omega = np.zeros((n, 3))
    Omega[0] = 1.0, 2.0, 3.0
    start = State(np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), Omega)
    return Problem("free_bodies", system, start, t_end=2.0, dt=0.1, section="", source="")


def test_bodies_at_rest_dilute_the_root_mean_square_not_the_maximum():
    """Of 26 bodies one turns: its error in the mean is sqrt(26) times smaller, in the maximum it is what it was."""
    steps = {
        (norm, idle): solve("ndf_index1", spinning_beside(idle), 1e-7, {"norm": norm}).counters["steps"]
        for norm in ("rms", "max")
        for idle in (0, 25)
    }
    assert steps["max", 25] == pytest.approx(steps["max", 0], abs=2)  # the first step is chosen in the mean
    assert steps["rms", 25] < 0.9 * steps["rms", 0]
    assert steps["rms", 0] < steps["max", 0]


@pytest.mark.parametrize("solver", ALL)
def test_a_run_is_repeatable_to_the_last_bit(solver):
    """No thread, cache or random number takes part."""
    p = top(0.1)
    a, b = (solve(solver, p, 1e-6) for _ in range(2))
    assert np.array_equal(a.t, b.t) and np.array_equal(a.states.r, b.states.r)
    assert np.array_equal(a.reaction, b.reaction) and a.counters == b.counters
