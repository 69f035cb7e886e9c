"""The closed form of a bar on a fixed hinge, about any axis, against two routes of integration and the laws."""

import dataclasses

import numpy as np
import pytest
from scipy.special import ellipk

from mbsbench import Joint, Problem, RigidBody, SpringDamper, State, assemble, so3, solve
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, energy
from mbsbench.harness.mechanics.system import GROUND
from mbsbench.harness.reference.computation import Source, compute_reference, describe_source, find_reference
from mbsbench.problems.exact.hinged import HingedMotion, find_hinged_motion
from mbsbench.tests.comparing import assert_each

GRAVITY = np.array([1.0, -2.0, -9.0])
AXIS = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
ARM, POINT = np.array([0.2, 0.4, -0.1]), np.array([0.5, -1.0, 2.0])
TURN = so3.exp(np.array([0.2, 1.0, -0.4]))


def bar(rate: float, t_end: float = 3.0, gravity: np.ndarray = GRAVITY, **more) -> Problem:
    """A body of three moments whose hinge is oblique to its own axes, to gravity and to space."""
    R = so3.exp(np.array([0.7, -0.3, 1.1]))
    J = R.T @ np.diag([0.02, 0.1, 0.11]) @ R
    joint = Joint(0, ARM, GROUND, POINT, AXIS, TURN @ AXIS)
    system = assemble([RigidBody(1.3, 0.5 * (J + J.T))], [joint], gravity, **more)
    r, spin = POINT - TURN @ ARM, rate * (TURN @ AXIS)
    start = State(r[None], TURN[None], np.cross(spin, r - POINT)[None], (rate * AXIS)[None])
    return Problem("bar", system, start, t_end=t_end, dt=1e-3, section="", source="")


def upright_rate(p: Problem) -> float:
    """The rate at the start whose energy is that of the upright rest."""
    axis, arm = TURN @ AXIS, p.initial.r[0] - POINT
    across, weight = arm - (arm @ axis) * axis, GRAVITY - (GRAVITY @ axis) * axis
    d, g = np.linalg.norm(across), np.linalg.norm(weight)
    inertia = AXIS @ p.system.inertia[0] @ AXIS + 1.3 * d * d
    return float(np.sqrt(2.0 * 1.3 * (g * d + weight @ across) / inertia))


SHARES = (0.0, 0.5, -0.9, 0.999, 1.001, 1.5, -4.0)  # of the rate that separates swinging from turning over


@pytest.mark.sampled(1)
@pytest.mark.parametrize("share", SHARES)
def test_two_routes_that_know_no_closed_form_agree_within_what_is_stated(share):
    p = bar(share * upright_rate(bar(0.0)))
    exact, found = find_hinged_motion(p.system, p.initial, p.t_end), compute_reference(p)
    t = np.linspace(0.0, found.horizon, 301)
    a, b = exact.states(t), found.states(t)
    bound = exact.error(t) + found.error(t)
    assert exact.horizon == p.t_end and np.max(exact.error(t)) < 1e-9
    assert_each(np.linalg.norm(a.r - b.r, axis=2)[:, 0], "<=", bound)
    assert_each(p.system.gyration[0] * so3.angle_between(a.R, b.R)[:, 0], "<=", 2.0 * bound)
    assert np.max(np.abs(a.v - b.v)) < 1e-8 and np.max(np.abs(a.Omega - b.Omega)) < 1e-8


@pytest.mark.parametrize("share", SHARES)
def test_two_thousand_seconds_keep_laws_and_state_their_error(share):
    p = bar(share * upright_rate(bar(0.0)), 2000.0)
    exact = find_reference(p)
    assert isinstance(exact, HingedMotion) and describe_source(p) is Source.HINGED
    assert exact.horizon == 2000.0 and exact.ends == "" and 0.0 < exact.error(np.array([2000.0]))[0] < 1e-6
    t = np.linspace(0.0, 2000.0, 4001)
    s = exact.states(t)
    E = energy(p.system, s)
    assert np.max(np.abs(E - E[0])) < 1e-11 * np.max(np.abs(E))
    assert np.max(np.abs(constraint(p.system, s))) < 1e-13 and np.max(np.abs(constraint_rate(p.system, s))) < 1e-11
    h = 1e-4
    rates = (exact.states(t[1:-1] + h).r - exact.states(t[1:-1] - h).r) / (2.0 * h)
    assert np.max(np.abs(rates - s.v[1:-1])) < 1e-3 * np.max(np.abs(s.v))


def test_small_swings_have_the_period_of_the_elliptic_integral():
    """T = 4 K(sin^2(A/2)) / w from a turning point, counted over 1,000 swings."""
    p = bar(0.0, 5000.0)
    exact = find_hinged_motion(p.system, p.initial, p.t_end)
    w = np.sqrt(exact.swing.pull)
    period = 4.0 * ellipk(np.sin(0.5 * exact.swing.phi) ** 2) / w
    s = exact.states(np.array([0.0, 1000.0 * period, 1000.5 * period]))
    assert np.max(np.abs(s.r[1] - s.r[0])) < 1e-9 and np.max(np.abs(s.r[2] - s.r[0])) > 0.1


def test_between_swinging_and_turning_over_it_ends_and_says_why():
    p = bar(upright_rate(bar(0.0)), 2000.0)
    exact = find_reference(p)
    assert 3.0 < exact.horizon < 30.0 and "rounding" in exact.ends
    found = compute_reference(dataclasses.replace(p, t_end=3.0))
    t = np.linspace(0.0, min(found.horizon, exact.horizon), 100)
    gap = np.linalg.norm(exact.states(t).r - found.states(t).r, axis=2)[:, 0]
    assert_each(gap, "<=", exact.error(t) + found.error(t))


def test_gravity_along_the_axis_turns_it_steadily():
    p = bar(2.0, 100.0, gravity=9.81 * TURN @ AXIS)
    s = find_reference(p).states(np.array([0.0, np.pi, 25.0 * np.pi]))
    assert np.max(np.abs(s.R[1:] - s.R[0])) < 1e-12 and np.max(np.abs(s.v - s.v[0])) < 1e-12


def test_a_spring_makes_it_another_problem():
    p = bar(1.0, springs=[SpringDamper(0, (0.0, 0.0, 0.0), GROUND, (0.0, 0.0, 0.0), 10.0, 1.0)])
    assert find_hinged_motion(p.system, p.initial, p.t_end) is None and describe_source(p) is Source.COMPUTED


@pytest.mark.sampled(0)
def test_a_long_run_is_compared_to_its_end():
    run = solve(bar(1.0, 60.0), "gauss_joint", dt=2e-3)
    assert run.record.reference_horizon_s == 60.0 and run.record.position_error_max_m < 1e-9
