"""Systems as trees with cut joints: the same bodies, motions and equations as in absolute coordinates."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as sl

from mbsbench import Joint, RigidBody, State, assemble
from mbsbench.harness.lab.fuzz.drawing import draw_mechanism
from mbsbench.harness.mechanics.cut_trees.tree import EngineTree, Kind, build_spanning_tree
from mbsbench.harness.mechanics.motion import (
    applied_loads,
    constraint,
    constraint_rate,
    evaluate_spring_line,
    kinetic_energy,
    potential_energy,
)
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.mechanics.system import GROUND
from mbsbench.harness.mechanics.torsion import evaluate_torsion
from mbsbench.solvers.engines.export.model_check import EngineModel, measure_differences, refuse_model

from .systems import PROBLEMS


@pytest.fixture(params=[name for name in PROBLEMS if name not in ("guided", "tilting", "rolling")])
def problem(request):
    return PROBLEMS[request.param]()


def tree_of(problem) -> EngineTree:
    return build_spanning_tree(problem.system, problem.initial)


def wandering(tree: EngineTree, seed: int):
    """Any coordinates and velocities of the tree."""
    random = np.random.default_rng(seed)
    q, u = (
        tree.start + 0.3 * random.standard_normal(tree.start.shape),
        random.standard_normal(tree.start_velocity.shape),
    )
    return q, u


def moved(tree: EngineTree, q: np.ndarray, u: np.ndarray, h: float) -> np.ndarray:
    """q after a short time h at velocities u, to first order in h."""
    out = q.copy()
    for limb in tree.limbs:
        own = u[limb.u_at : limb.u_at + limb.kind.nu]
        at = limb.q_at
        if not limb.kind.has_quaternion:
            out[at : at + limb.kind.nq] += h * own
            continue
        if limb.kind is Kind.FREE:
            out[at : at + 3] += h * own[:3]
            at, own = at + 3, own[3:]
        w, vector = q[at], q[at + 1 : at + 4]
        out[at] -= 0.5 * h * vector @ own
        out[at + 1 : at + 4] += 0.5 * h * (w * own + np.cross(vector, own))
    return out


def test_the_start_is_the_problems(problem):
    """Coordinates, velocities and what they mean for bodies are inverse to each other."""
    tree = tree_of(problem)
    here = tree.states(tree.start[None], tree.start_velocity[None])[0]
    for name in ("r", "R", "v", "Omega"):
        np.testing.assert_allclose(getattr(here, name), getattr(problem.initial, name), atol=1e-12)


def test_joints_of_the_tree_hold_everywhere(problem):
    """Whatever the coordinates, only cut joints open; velocities likewise."""
    tree, system = tree_of(problem), problem.system
    q, u = wandering(tree, 1)
    one = tree.states(q[None], u[None])
    phi, rate = constraint(system, one)[0], constraint_rate(system, one)[0]
    hung = {(limb.body, limb.parent) for limb in tree.limbs if limb.kind is not Kind.FREE}
    held = 0
    for k in range(system.nj):
        ends = int(system.joint_i[k]), int(system.joint_j[k])
        first = next(j for j in range(system.nj) if {system.joint_i[j], system.joint_j[j]} == set(ends))
        if (ends in hung or ends[::-1] in hung) and first == k:
            rows = slice(system.row_start[k], system.row_start[k + 1])
            assert np.max(np.abs(phi[rows])) < 1e-12 and np.max(np.abs(rate[rows])) < 1e-11
            held += 1
    assert held == sum(limb.kind is not Kind.FREE for limb in tree.limbs)


def test_velocities_are_the_rates_of_poses(problem):
    """Central differences of poses along the coordinates' own rates, of second order in h."""
    tree = tree_of(problem)
    q, u = wandering(tree, 2)
    for at in [limb.q_at + (3 if limb.kind is Kind.FREE else 0) for limb in tree.limbs if limb.kind.has_quaternion]:
        q[at : at + 4] /= np.linalg.norm(q[at : at + 4])
    h, zero = 1e-6, np.zeros((1, len(u)))
    fore, aft = (tree.states(moved(tree, q, u, s * h)[None], zero)[0] for s in (1.0, -1.0))
    here = tree.states(q[None], u[None])[0]
    size = 1.0 + np.max(np.abs(here.Omega)) ** 3
    np.testing.assert_allclose((fore.r - aft.r) / (2 * h), here.v, atol=1e-8 * size)
    spin = np.swapaxes(here.R, 1, 2) @ (fore.R - aft.R) / (2 * h)
    np.testing.assert_allclose(np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]), 1), here.Omega, atol=1e-8 * size)


def own_model(problem) -> EngineModel:
    """The model that a correct engine makes of the tree, from body matrices and the applied forces."""
    tree, system, one = tree_of(problem), problem.system, States.one(problem.initial)
    T = tree.jacobian()
    M = sl.block_diag(*[b for m, J in zip(system.mass, system.inertia, strict=True) for b in (m * np.eye(3), J)])
    rest = replace(problem.initial, v=0.0 * problem.initial.v, Omega=0.0 * problem.initial.Omega)
    load, bias = applied_loads(system, one)[0], tree.bias(problem.initial)
    Omega = problem.initial.Omega
    load[:, 3:] -= np.cross(Omega, np.einsum("bij,bj->bi", system.inertia, Omega))
    forces = T.T @ (load.ravel() - M @ bias.ravel())
    return EngineModel(
        T,
        T.T @ M @ T,
        T.T @ applied_loads(system, States.one(rest))[0].ravel(),
        float(kinetic_energy(system, one)[0]),
        float(potential_energy(system, one)[0]),
        bias,
        forces,
        tree.loop_jacobian(),
    )


def test_equations_of_the_tree_are_those_of_the_bodies(problem):
    """Accelerations by joint coordinates and cut joints, and by all rows in absolute coordinates: two routes."""
    found = measure_differences(problem, own_model(problem))
    assert max(found.values()) < 1e-10, found


PLANTED = {
    "inertia": lambda s: {"inertia": s.inertia * (1.0 + 1e-8)},
    "mass": lambda s: {"mass": s.mass * (1.0 - 1e-8)},
    "gravity": lambda s: {"gravity": s.gravity * (1.0 + 1e-8)},
    "arm": lambda s: {"joint_s_i": s.joint_s_i * (1.0 + 1e-8)},
    "spring": lambda s: {"spring_k": s.spring_k * (1.0 + 1e-6)},
    "damper": lambda s: {"spring_c": s.spring_c * (1.0 + 1e-6)},
}


@pytest.mark.parametrize("planted", PLANTED)
def test_a_planted_fault_is_found(planted):
    """An engine's model with any datum off by 1e-8 of itself is not ours."""
    problem = PROBLEMS["closed_chain"]()
    assert refuse_model("itself", problem, own_model(problem)) is None
    other = dataclasses.replace(problem, system=dataclasses.replace(problem.system, **PLANTED[planted](problem.system)))
    said = refuse_model("an engine", problem, own_model(other))
    assert said is not None and "differs by" in said


def test_a_row_left_out_is_found():
    """A model with one loop less open has more freedom."""
    problem = PROBLEMS["closed_chain"]()
    model = own_model(problem)
    found = measure_differences(problem, dataclasses.replace(model, constraints=model.constraints[1:]))
    assert found["degrees of freedom"] > 0.1


@pytest.mark.parametrize(("name", "kind"), [("sprung", "spring_k"), ("jointed", "torsion_k")])
def test_springs_at_rest_are_measured_by_what_cancels_in_them(name, kind):
    """k (d - d_0) of a spring at its length is rounding of k d: an engine's other rounding is no other model."""
    problem = PROBLEMS[name]()
    s, start = problem.system, problem.initial
    if kind == "torsion_k":
        s = replace(
            s,
            torsion_i=np.array([2]),
            torsion_j=np.array([1]),
            torsion_u=np.array([[0.6, 0.8, 0.0]]),
            torsion_n=np.eye(3)[None, :2],
            torsion_k=np.array([3.0]),
            torsion_rest=np.zeros(1),
            torsion_c=np.zeros(1),
            torsion_wound=np.zeros(1),
        )
    still = States.one(replace(start, v=0.0 * start.v, Omega=0.0 * start.Omega))
    lengths = np.array([np.linalg.norm(evaluate_spring_line(s, still, k)[0]) for k in range(len(s.spring_k))])
    angles = evaluate_torsion(s, still)[0][0] + s.torsion_rest
    s = replace(s, spring_d0=np.nextafter(lengths, 9.0), torsion_rest=np.nextafter(angles, 9.0), gravity=np.zeros(3))
    largest = float(np.max(getattr(s, kind)))
    assert 0.0 < np.max(np.abs(applied_loads(s, still))) < 1e-15 * largest
    problem = replace(problem, system=s)
    model = own_model(problem)
    off = replace(model, rest_forces=model.rest_forces + 1e-15 * largest)
    assert measure_differences(problem, off)["forces at rest"] < 1e-12
    wrong = replace(model, rest_forces=model.rest_forces + 1e-6 * largest)
    assert measure_differences(problem, wrong)["forces at rest"] > 1e-8


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_a_joint_declared_twice_is_held_by_the_tree_alone(joint):
    """The rows of its points would be rounding, of which an engine makes a force."""
    problem = draw_mechanism(1, 8).problem()  # two hinges in a row and a ball joint, nothing closes a loop
    twice = Presentation(duplicate=joint).system(problem.system)
    assert twice.nj == problem.system.nj + 1 and not build_spanning_tree(twice, problem.initial).cuts


def test_a_second_hinge_on_another_axis_is_held():
    """It welds the body: a point on that axis says what the tree does not."""
    body, at = RigidBody(1.0, 0.1 * np.eye(3)), (0.5, 0.0, 0.0)
    hinges = [Joint(0, at, GROUND, at, axis, axis) for axis in ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))]
    tree = build_spanning_tree(
        assemble([body], hinges), State(*np.zeros((1, 1, 3)), np.eye(3)[None], *np.zeros((2, 1, 3)))
    )
    assert len(tree.cuts) == 1 and np.linalg.matrix_rank(tree.loop_jacobian()) == 1
