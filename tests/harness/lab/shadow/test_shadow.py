"""Shadows against problems whose nearest true motion is known, and their order in the step."""

import dataclasses
import functools

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.judge.distance import GAP
from mbsbench.harness.lab.shadow.coordinates import compute_coordinates
from mbsbench.harness.lab.shadow.corrections import Continuity
from mbsbench.harness.lab.shadow.equations import FlowEquations
from mbsbench.harness.lab.shadow.findings import describe_shadow
from mbsbench.harness.lab.shadow.flow import integrate_flow, transport_changes
from mbsbench.harness.lab.shadow.plane import add_hinges
from mbsbench.harness.lab.shadow.refinement import Refinement
from mbsbench.harness.lab.shadow.shadow import find_shadow
from mbsbench.harness.mechanics.forces import SpringDamper
from mbsbench.harness.mechanics.joint_tree import build_spanning_tree
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import RigidBody, assemble
from mbsbench.harness.mechanics.types import Problem, Status, StepControl, Trajectory
from mbsbench.harness.results.findings import Verdict
from mbsbench.tests.comparing import assert_close, assert_each, assert_same

OMEGA = 3.0  # [rad/s]


def oscillator() -> Problem:
    """A ball on a spring without length about the origin: linear, of frequency OMEGA in every direction."""
    ball = RigidBody(2.0, 0.01 * np.eye(3), "ball")
    system = assemble([ball], (), (0.0, 0.0, 0.0), [SpringDamper(0, (0.0, 0.0, 0.0), stiffness=2.0 * OMEGA**2)])
    start = State(np.array([[0.3, 0.1, 0.0]]), np.eye(3)[None], np.array([[0.0, 0.5, 0.2]]), np.zeros((1, 3)))
    return Problem("oscillator", system, start, t_end=4.0, dt=1e-2, section="", source="test")


def rotation(t: np.ndarray, omega: float) -> np.ndarray:
    """(position, velocity) at t from those at 0, (nt, 2, 2)."""
    c, s = np.cos(omega * t), np.sin(omega * t)
    return np.moveaxis(np.array([[c, s / omega], [-omega * s, c]]), 2, 0)


@functools.cache
def shadow_of(name: str, solver: str, dt: float, t_end: float, parameters: tuple = (), **options: str):
    problem = registry.make_problem(name, {"t_end": t_end, **dict(parameters)})
    trajectory = registry.make_solver(solver, options).solve(problem, StepControl(dt=dt))
    return problem, trajectory, find_shadow(problem, trajectory)


def equations_of(name: str) -> tuple[Problem, FlowEquations]:
    problem = registry.make_problem(name, {})
    system = problem.system
    if problem.planar_normal is not None:
        system = add_hinges(system, problem.initial, problem.frame @ problem.planar_normal)
    return problem, FlowEquations(system, build_spanning_tree(system, problem.initial))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["heavy_top", "bricard", "spring_pendulum", "cart_pendulum", "slider_crank"])
def test_coordinates_of_bodies_are_those_that_move_them(name):
    """Poses and velocities of random joint coordinates, closed, come back from the coordinates read off them."""
    _, E = equations_of(name)
    y = E.tree.start + 0.1 * np.random.default_rng(1).normal(size=(5, E.ny))
    for _ in range(30):
        y = E.project(np.zeros(5), y)
    given = E.evaluate_bodies(np.zeros(5), y)
    again = E.evaluate_bodies(np.zeros(5), compute_coordinates(E.tree, given))
    for part in ("r", "R", "v", "Omega"):
        assert_close(getattr(again, part), getattr(given, part), atol=1e-11)


@pytest.mark.parametrize("name", ["heavy_top", "bricard"])
def test_tangents_are_the_slopes_of_the_flow(name):
    """Central differences of the flow; their own error is of the square of the change."""
    _, E = equations_of(name)
    y, t, h, d = E.tree.start[None], np.zeros(1), np.full(1, 0.02), 1e-5
    many = np.full(1, 8)
    Y = np.random.default_rng(2).normal(size=(1, 1, E.ny))
    ahead, behind = (integrate_flow(E, t, h, y + s * d * Y[:, 0], many.copy()) for s in (1.0, -1.0))
    assert_close(transport_changes(E, t, h, y, Y, many)[:, 0], (ahead - behind) / (2.0 * d), atol=1e-6, rtol=1e-6)


def test_corrections_are_the_least_that_join_segments():
    """B z = b with the least weighted sum of squares: the pseudo-inverse of the dense matrix."""
    rng = np.random.default_rng(3)
    A, w, b = rng.normal(size=(5, 3, 3)), rng.uniform(0.5, 2.0, 6), rng.normal(size=(5, 3))
    B = np.zeros((15, 18))
    for k in range(5):
        B[3 * k : 3 * k + 3, 3 * k : 3 * k + 3], B[3 * k : 3 * k + 3, 3 * k + 3 : 3 * k + 6] = A[k], -np.eye(3)
    root = np.repeat(np.sqrt(w), 3)
    expected = np.linalg.pinv(B / root) @ b.ravel() / root
    linear = Continuity(A, w)
    assert_close(linear.find_least_corrections(b).ravel(), expected)
    assert_close(linear.apply(linear.find_least_corrections(b)), b)


def test_a_motion_that_goes_astray_costs_later_ones_nothing():
    """The steps that it took are forgotten, and its distance is no distance."""
    problem, E = equations_of("cart_pendulum")
    trajectory = registry.make_solver("rattle").solve(dataclasses.replace(problem, t_end=1.0), StepControl(dt=1e-3))
    rows = np.arange(0, 1001, 50)
    refinement = Refinement(E, trajectory.t[rows], compute_coordinates(E.tree, trajectory.states)[rows], 0.1)
    assert refinement.close_gaps()
    linear, y = refinement._linearise(), refinement.y
    assert np.isfinite(refinement._close_after_move(linear, y))
    before = refinement._steps[True].copy()
    assert refinement._close_after_move(linear, y + 30.0 * np.random.default_rng(4).normal(size=y.shape)) == np.inf
    assert_same(refinement._steps[True], before)


@pytest.mark.parametrize("factor", [1.01, 1.0 + 1e-10])  # of the frequency; by the latter no gap is open
def test_shadow_of_a_linear_problem_is_its_least_squares(factor):
    """Of x'' = -OMEGA^2 x the true motions are linear in their start, and the nearest is a linear regression."""
    problem = oscillator()
    t = np.linspace(0.0, problem.t_end, 401)
    start = np.stack((problem.initial.r[0], problem.initial.v[0]))
    x = rotation(t, factor * OMEGA) @ start
    R = np.broadcast_to(np.eye(3), (len(t), 1, 3, 3))
    given = States(x[:, :1], R, x[:, 1:], np.zeros((len(t), 1, 3)), t)
    shadow = find_shadow(problem, Trajectory(t, given, Status.SUCCESS, "", {}))
    h = np.diff(shadow.t)
    w = 0.5 * (np.append(h, 0.0) + np.insert(h, 0, 0.0))
    weight = np.sqrt(w)[:, None, None] * np.diag([1.0, shadow.tau])
    exact = rotation(shadow.t, OMEGA)
    at = rotation(shadow.t, factor * OMEGA) @ start
    best = np.linalg.lstsq((weight @ exact).reshape(-1, 2), (weight @ at).reshape(-1, 3), rcond=None)[0]
    assert shadow.is_complete
    assert_close(shadow.true.r[:, 0], (exact @ best)[:, 0], atol=1e-3 * np.max(shadow.distance))


def test_distance_without_chaos_is_the_error_less_a_shift_of_start():
    """Small errors e: the shadow is the true motion from a start shifted by the d that leaves least of e - Phi d."""
    problem, trajectory, shadow = shadow_of("simple_pendulum", "rattle", 5e-3, 3.0)
    _, E = equations_of("simple_pendulum")
    t, h = shadow.t, np.diff(shadow.t)
    given = compute_coordinates(E.tree, shadow.given)

    def follow(start: np.ndarray) -> np.ndarray:
        out = [start]
        for k in range(len(h)):
            out.append(integrate_flow(E, t[k : k + 1], h[k : k + 1], out[-1][None], np.ones(1, dtype=np.int64))[0])
        return np.array(out)

    exact, d = follow(E.tree.start), 1e-5
    Phi = np.stack([(follow(E.tree.start + d * e) - follow(E.tree.start - d * e)) / (2.0 * d) for e in np.eye(2)], 2)
    w = 0.5 * (np.append(h, 0.0) + np.insert(h, 0, 0.0))
    weight = np.sqrt(w)[:, None] * np.array([1.0, shadow.tau])
    error = given - exact
    shift = np.linalg.lstsq((weight[:, :, None] * Phi).reshape(-1, 2), (weight * error).ravel(), rcond=None)[0]
    arm = np.linalg.norm(problem.initial.r[0])
    expected = arm * np.abs((error - Phi @ shift)[:, 0])
    assert np.max(shadow.distance) < 0.5 * arm * np.max(np.abs(error[:, 0]))  # the larger part of the error is a shift
    assert_close(shadow.distance[:, 0], expected, atol=0.02 * np.max(expected))
    assert trajectory.status is Status.SUCCESS


def test_false_motion_has_a_far_shadow():
    """A pendulum in a stronger gravity keeps no phase with any true one; one that is right is near."""
    problem, right, near = shadow_of("simple_pendulum", "rattle", 1e-2, 5.0)
    _, wrong, _ = shadow_of("simple_pendulum", "rattle", 1e-2, 5.0, (("gravity", 14.0),))
    start = dataclasses.replace(wrong, states=wrong.states.at(slice(len(right.t))))
    far = find_shadow(problem, start)
    assert np.max(near.distance) < 1e-3 * near.reach
    assert any(f.verdict is Verdict.FAILED for f in describe_shadow(far))
    assert all(f.verdict is not Verdict.FAILED for f in describe_shadow(near))


@pytest.mark.parametrize(
    ("solver", "order", "slack", "steps"),
    [
        ("rattle", 2.0, 0.2, (2e-3, 1e-3)),
        ("gc_weak_form", 2.0, 0.2, (2e-3, 1e-3)),
        ("generalized_alpha", 2.0, 0.2, (2e-3, 1e-3)),
        ("gc_composed", 4.0, 0.3, (4e-3, 2e-3)),
    ],
)
def test_distance_has_the_order_of_the_solver(solver, order, slack, steps):
    """A method of order p has a true motion within C dt^p, before chaos as well as after."""
    found = [shadow_of("chain", solver, dt, 0.6, (("links", 6),))[2] for dt in steps]
    assert all(s.is_complete for s in found)
    assert_each([s.gap for s in found], "<", GAP, "gaps")
    first, second = (np.sqrt(np.mean(s.distance**2)) for s in found)
    assert np.log2(first / second) == pytest.approx(order, abs=slack)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["rattle", "gc_weak_form"])
def test_chain_is_shadowed_where_its_error_says_nothing(solver):
    """Over 5 s the error is the size of the mechanism at both steps; the distance of the shadow falls with the step.

    By a factor near 4, not by 4: the two motions are different ones of a chaotic mechanism.
    """
    found = [shadow_of("chain", solver, dt, 5.0)[2] for dt in (1e-3, 5e-4)]
    assert all(s.is_complete for s in found)
    first, second = (np.sqrt(np.mean(s.distance**2)) for s in found)
    assert 2.0 < first / second < 8.0
    assert np.max(found[1].distance) < 1e-3


def test_rest_and_short_motions_are_refused():
    """There is nothing to scale distances with, or to refine."""
    problem = oscillator()
    at = States.one(problem.initial)
    for rows, words in ((9, "at rest"), (3, "at least 8 rows")):
        still = States(*(np.repeat(getattr(at, k), rows, axis=0) for k in ("r", "R", "v", "Omega")))
        with pytest.raises(ValueError, match=words):
            find_shadow(problem, Trajectory(np.linspace(0.0, 1.0, rows), still, Status.SUCCESS, "", {}))
