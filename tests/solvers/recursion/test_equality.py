"""The recursion over bodies beside code made for the mechanism, function by function, and beside the judge."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.joint_tree import Tree, build_spanning_tree
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import GROUND, MultibodySystem
from mbsbench.solvers.formulations.joint_coordinates.code import make_code
from mbsbench.solvers.formulations.joint_coordinates.evaluation import Evaluation
from mbsbench.solvers.formulations.joint_coordinates.hamilton import make_hamilton_code
from mbsbench.solvers.formulations.joint_coordinates.symplectic import make_closing
from mbsbench.solvers.formulations.recursion.evaluation import TreeMechanism
from mbsbench.solvers.formulations.recursion.phases import TreePhase

from ..arbitrary_joints import KINDS, MOVING, all_joints, moving_rows, one_joint
from ..arbitrary_systems import consistent, judge_accelerations, linkage

PROBLEMS: dict[str, dict[str, Any]] = {
    "heavy_top": {},
    "spherical_pendulum": {},
    "cart_pendulum": {},
    "simple_pendulum": {},
    "damped_linkage": {},
    "chain": {"links": 9},
    "bricard": {},
    "slider_crank": {},
    "driven_slider_crank": {},
    "andrews": {},
    "four_bar_grid": {"rows": 2, "columns": 2},
    "n_four_bar": {"windows": 3},
    "stewart_platform": {},
}
pytestmark = pytest.mark.usefixtures("without_whole_steps")
RANDOM = [(seed, 3 + seed % 7, seed % 4) for seed in range(12)]  # seed, bodies, loops
HALVES = (range(7), range(5, 12))  # of these, each with every number of bodies and of loops
CLOSE = 2e-12  # of the largest number, or of 1: sums over a tree in another order


def systems(part: int) -> "list[Any]":
    """All of them, as functions of nothing: a system and its start; those outside of a ``part`` are slow.

    A part, 0 or 1, has every kind of joint once, to the ground or in a pair, and about half of the random mechanisms.
    Both together are all.
    """
    out: list[Any] = [pytest.param(lambda n=n, p=p: _of(n, p), id=n) for n, p in PROBLEMS.items()]
    for seed, bodies, loops in RANDOM:
        given = {"seed": seed, "bodies": bodies, "loops": loops}
        marks = _slow_unless(seed in HALVES[part])
        out.append(pytest.param(lambda given=given: _of("random_mechanism", given), id=f"random-{seed}", marks=marks))
    for k, kind in enumerate(KINDS):
        for ground in (True, False):
            make = lambda kind=kind, ground=ground: one_joint(kind, ground=ground)  # noqa: E731
            marks = _slow_unless((k + ground) % 2 == part)
            out.append(pytest.param(make, id=f"{kind}-{'ground' if ground else 'pair'}", marks=marks))
    for kind in MOVING:
        out.append(pytest.param(lambda kind=kind: _with_start(moving_rows(kind), 3), id=kind))
    out.append(pytest.param(lambda: _with_start(all_joints(), 5), id="all joints"))
    return [*out, pytest.param(lambda: _with_start(linkage(springs=True), 2), id="linkage")]


def _slow_unless(kept: bool) -> Any:
    return () if kept else pytest.mark.slow


def _of(name: str, parameters: dict[str, Any]) -> tuple[MultibodySystem, State]:
    problem = make_problem(name, parameters)
    return problem.system, problem.initial


def _with_start(system: MultibodySystem, seed: int) -> tuple[MultibodySystem, State]:
    return system, dataclasses.replace(consistent(system, seed), t=0.0)


def place(tree: Tree, made: TreeMechanism, t: np.ndarray) -> np.ndarray:
    """Coordinates and velocities away from the start, on the loops."""
    n = len(tree.start)
    y = tree.start + 0.05 * np.random.default_rng(4).standard_normal(n)
    after, y_dot, lam, guard = np.zeros(n), np.zeros(n), np.zeros(made.rows), np.zeros(2)
    onto = made.make_evaluation().finish(t, y, after, y_dot, lam, guard)
    if made.rows > made.rows_in_use:  # off the loops other rows are other motions
        y[: tree.nq] = tree.start[: tree.nq]
    for _ in range(15):
        onto.run()
        y[:] = after
    return y


def check(names: str, found: "list[list[np.ndarray]]") -> None:
    """Each array of the recursion is that of the code."""
    for name, made, swept in zip(names.split(), *found, strict=True):
        size = max(1.0, float(np.max(np.abs(made), initial=0.0)))
        np.testing.assert_allclose(swept, made, rtol=0.0, atol=CLOSE * size, err_msg=name)


@pytest.mark.sampled(0)
@pytest.mark.parametrize("make", systems(0))
def test_accelerations_projections_and_records_are_those_of_code(make: Any) -> None:
    """Loads of joints too; where rows depend on others, those that all of them give together."""
    system, start = make()
    tree, t, nb = build_spanning_tree(system, start), np.array([0.3]), system.nb
    made, swept = make_code(system, tree), TreeMechanism(system, tree)
    assert (swept.rows, swept.rows_in_use) == (made.rows, made.rows_in_use)
    y, n, found = place(tree, swept, t), len(tree.start), []
    for own in (Evaluation(made, tree.nq), swept.make_evaluation()):
        accelerated, y_dot, after, lam, guard = (*np.zeros((3, n)), np.zeros(made.rows), np.zeros(2))
        own.accelerate(t, y, accelerated, guard[:1]).run()
        own.finish(t, y, after, y_dot, lam, guard).run()
        r, R, v, v_dot, reaction = (np.zeros(k) for k in ((nb, 3), (nb, 3, 3), (nb, 6), (nb, 6), system.nrows))
        own.record(t, after, y_dot, lam, r, R, v, v_dot, reaction).run()
        load = constraint_jacobian(system, State(r, R, v[:, :3].copy(), v[:, 3:].copy(), 0.3)).T @ reaction
        sums, error = np.random.default_rng(1).standard_normal((2, n)), np.zeros(1)
        own.measure(np.array([0.3, 1e-3, 1e-4]), y, after + 0.1, sums, error).run()
        found.append([accelerated, y_dot, after, r, R, v, v_dot, load, error])
    check("accelerated y_dot after r R v v_dot load error", found)


@pytest.mark.sampled(0)
@pytest.mark.parametrize("make", systems(1))
def test_canonical_functions_are_those_of_code(make: Any) -> None:
    """q_dot and p_dot, momenta, forces of rows, velocities closed at an end."""
    check_canonical(make, radial=False)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("make", systems(0))
def test_canonical_functions_of_balls_of_any_length_are_those_of_code(make: Any) -> None:
    """The same with free spins, and with rows that close the lengths of quaternions."""
    check_canonical(make, radial=True)


def check_canonical(make: Any, *, radial: bool) -> None:
    """Each canonical function of the recursion is that of the code."""
    system, start = make()
    if not system.is_holonomic:
        pytest.skip("needs phi in every row")
    tree, t = build_spanning_tree(system, start), np.array([0.3])
    code, swept = make_code(system, tree, whole=False), TreeMechanism(system, tree)
    y, nq, random = place(tree, swept, t), tree.nq, np.random.default_rng(2)
    phases = make_hamilton_code(system, tree, radial=radial), TreePhase(swept, radial=radial)
    assert phases[0].rows == phases[1].rows and phases[0].spins == phases[1].spins
    found, p = [], np.zeros(nq)
    phases[0].bind("enter", y, p).run()
    y[:nq] = stretched(tree, y[:nq])
    moved = y[:nq] + (
        1e-3 * random.standard_normal(nq) if code.rows_in_use == code.rows else 0.0
    )  # dependent rows stay shut
    for own, evaluation in zip(phases, (Evaluation(code, nq), swept.make_evaluation()), strict=True):
        entered, q_dot, p_dot, closed, solved = np.zeros((5, nq))
        gaps, rows, answer = np.zeros((3, own.rows))
        z, y_closed = np.stack((y[:nq], p)), np.zeros(len(y))
        own.bind("enter", tree.start, entered).run()
        own.bind("stage", t, z[0], z[1], q_dot, p_dot).run()
        closing = make_closing(evaluation, own, np.zeros(1))
        closing.close(t, z, y_closed, rows).run()
        own.bind("push", t, z[0], rows, closed).run()
        own.bind("gaps", t, moved, gaps).run()
        closing.solve(gaps, answer).run()
        if not all(limb.parent == GROUND for limb in tree.limbs):
            answer[code.rows :] = 0.0  # alpha, how soft lengths are, is a matter of choice where bodies hang on a ball
        own.bind("push", t, z[0], answer, solved).run()
        found.append([entered, q_dot, p_dot, y_closed, closed, solved, gaps[code.rows :]])
    check("entered q_dot p_dot y_closed closed solved lengths", found)


def stretched(tree: Tree, q: np.ndarray) -> np.ndarray:
    """Quaternions of other lengths."""
    out = q.copy()
    for limb in tree.limbs:
        if limb.ball:
            out[limb.q_at + len(limb.slides) : limb.q_at + limb.sizes[0]] *= 1.0 + 0.01 * limb.body
    return out


@pytest.mark.parametrize("seed", range(3))
def test_accelerations_are_the_judges(seed: int) -> None:
    """Newton and Euler in Cartesian coordinates, by another route: neither code nor tree."""
    problem = make_problem("random_mechanism", {"seed": 20 + seed, "bodies": 8, "loops": seed})
    system, tree = problem.system, build_spanning_tree(problem.system, problem.initial)
    own, n, nb = TreeMechanism(system, tree), len(tree.start), system.nb
    t, y, after, y_dot = np.zeros(1), tree.start.copy(), *np.zeros((2, n))
    lam, guard, reaction = np.zeros(own.rows), np.zeros(2), np.zeros(system.nrows)
    r, R, v, v_dot = (np.zeros(k) for k in ((nb, 3), (nb, 3, 3), (nb, 6), (nb, 6)))
    own.make_evaluation().finish(t, y, after, y_dot, lam, guard).run()
    own.make_evaluation().record(t, y, y_dot, lam, r, R, v, v_dot, reaction).run()
    state = State(r, R, v[:, :3].copy(), v[:, 3:].copy(), 0.0)
    load = (constraint_jacobian(system, state).T @ reaction).reshape(nb, 6)
    for found, (judged, doubt) in zip((v_dot, load), judge_accelerations(system, state), strict=True):
        assert np.max(np.abs(found - judged)) < doubt + 1e-11 * max(1.0, float(np.max(np.abs(judged))))
