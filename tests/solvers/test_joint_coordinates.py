"""Code of a mechanism in joint coordinates: the judge's accelerations, orders, symmetries, and no wrong success."""

import dataclasses

import numpy as np
import pytest

from mbsbench import Joint, RigidBody, assemble
from mbsbench.harness.base.generated import Program
from mbsbench.harness.base.generated import code as generated_code
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.joint_tree import MOTIONS, build_spanning_tree
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, kinetic_energy
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import MultibodySystem
from mbsbench.harness.mechanics.types import Problem, Status, StepControl, Trajectory
from mbsbench.harness.run.presenting import present_solver
from mbsbench.solvers.formulations.joint_coordinates import code, marching, relay, symplectic
from mbsbench.solvers.formulations.joint_coordinates.code import make_code
from mbsbench.solvers.formulations.joint_coordinates.counting import estimate_least_operations, refuse_code
from mbsbench.solvers.formulations.joint_coordinates.evaluation import Evaluation
from mbsbench.tests.comparing import assert_each, assert_same
from mbsbench.tests.covering import diagonal
from mbsbench.tests.factories import solve_run

from .arbitrary_joints import KINDS, MOVING, all_joints, moving_rows, one_joint
from .arbitrary_systems import consistent, judge_accelerations, linkage, rounding_of_rows, with_user_forces
from .runs import drift, error
from .singular_linkages import LINKAGES, branch_error

PRESENTED = ({"yaw": 0.7}, {"mirror": "X"}, {"renumber": 3}, {"rotation": (0.3, -0.5, 0.7)})


def check_accelerations(system: MultibodySystem, start: State, *, seed: int = 0) -> None:
    """Those of the code, at coordinates and velocities away from the start, against the judge's."""
    random, tree = np.random.default_rng(seed), build_spanning_tree(system, start)
    made = make_code(system, tree)
    n, nb = len(tree.start), system.nb
    y = tree.start + 0.1 * random.standard_normal(n) * (np.arange(n) >= tree.nq if tree.cuts else 1.0)
    t, after, y_dot, lam, guard = np.array([0.3]), np.zeros(n), np.zeros(n), np.zeros(made.rows), np.zeros(2)
    r, R, v, v_dot = np.zeros((nb, 3)), np.zeros((nb, 3, 3)), np.zeros((nb, 6)), np.zeros((nb, 6))
    reaction = np.zeros(system.nrows)

    evaluation = Evaluation(made, tree.nq)
    finish = evaluation.finish(t, y, after, y_dot, lam, guard)
    for _ in range(12):  # onto the loops
        finish.run()
        y[:] = after
    finish.run()
    Program(evaluation.make_call("record", t, y, y_dot, lam, r, R, v, v_dot, reaction)).run()
    state = State(r, R, v[:, :3].copy(), v[:, 3:].copy(), float(t[0]))
    for rows, rounding in zip((constraint, constraint_rate), rounding_of_rows(state), strict=True):
        assert (
            np.max(np.abs(rows(system, States.one(state))), initial=0.0) < nb * rounding
        )  # poses add up along the tree
    load = (constraint_jacobian(system, state).T @ reaction).reshape(nb, 6)
    judge = judge_accelerations(system, state)
    for found, (judged, doubt), rounding in zip((v_dot, load), judge, (1e-12, 1e-11), strict=True):
        assert np.max(np.abs(found - judged)) < doubt + rounding * max(1.0, float(np.max(np.abs(judged))))


@pytest.mark.usefixtures("without_whole_steps")
@pytest.mark.parametrize(("kind", "ground"), diagonal(KINDS, [True, False]))
def test_accelerations_of_each_joint_are_the_judges(kind: str, ground: bool) -> None:
    """Newton and Euler leave no choice of accelerations, nor of the load of the joints."""
    check_accelerations(*one_joint(kind, ground=ground))


@pytest.mark.usefixtures("without_whole_steps")
@pytest.mark.parametrize("kind", KINDS)
def test_of_a_joint_declared_twice_no_row_of_the_copy_is_kept(kind: str) -> None:
    """Entries of the copy's rows are rounding of what the first leaves: as rows, they held nothing that is there."""
    system, start = one_joint(kind, ground=False, times=2)
    made = make_code(system, build_spanning_tree(system, start))
    assert made.rows_in_use == made.rows - system.nrows // 2


@pytest.mark.usefixtures("without_whole_steps")
@pytest.mark.parametrize("kind", MOVING)
def test_accelerations_with_drives_and_rates_are_the_judges(kind: str) -> None:
    """Rows of drives and of velocities alone are cut, whatever they drive; loads here are functions of time."""
    system = moving_rows(kind)
    check_accelerations(system, dataclasses.replace(consistent(system, 3), t=0.0))


@pytest.mark.usefixtures("without_whole_steps")
def test_accelerations_of_a_row_of_all_joints_are_the_judges() -> None:
    """Trees of hinges behind balls behind slides, and loops where a joint is none of a tree."""
    system = all_joints()
    check_accelerations(system, consistent(system, 5))


@pytest.mark.usefixtures("without_whole_steps")
@pytest.mark.parametrize("springs", [False, True])
def test_accelerations_of_a_closed_linkage_are_the_judges(springs: bool) -> None:
    """Balls on both sides of the cut joint: its moments meet in bodies that pass none on."""
    system = linkage(springs=springs)
    check_accelerations(system, consistent(system, 2))


@pytest.mark.usefixtures("without_whole_steps")
@pytest.mark.parametrize("seed", range(4))
def test_accelerations_of_random_mechanisms_are_the_judges(seed: int) -> None:
    """Trees and loops of all kinds of joints, springs and loads."""
    problem = make_problem("random_mechanism", {"seed": seed, "bodies": 5, "loops": 2})
    check_accelerations(problem.system, problem.initial)


@pytest.mark.parametrize("name", ["heavy_top", "four_bar_grid", "driven_slider_crank"])
def test_errors_fall_with_the_tolerance(name: str) -> None:
    """Each tolerance is a thousandth of the one before; the steps are of order eight, errors of about its power."""
    problem = make_problem(name, {"rows": 2, "columns": 2} if name == "four_bar_grid" else {})
    problem = dataclasses.replace(problem, t_end=1.0)
    fine = solve_run(problem, 1e-13, "rkmk_dop853").states.r[-1]
    errors = [
        float(np.max(np.abs(solve_run(problem, rtol, "dop853_joint").states.r[-1] - fine)))
        for rtol in (1e-4, 1e-7, 1e-10)
    ]
    assert errors[1] < errors[0] / 50.0
    assert errors[2] < errors[1] / 50.0
    assert errors[2] < 1e-8


@pytest.mark.parametrize(("presented_as", "name"), diagonal(PRESENTED, ["heavy_top", "slider_crank", "four_bar_grid"]))
def test_errors_are_the_same_however_a_mechanism_is_presented(name: str, presented_as: dict[str, object]) -> None:
    """The base frame is laid along a hinge and gravity, and vectors have tolerances by their length."""
    size = {"rows": 2, "columns": 2} if name == "four_bar_grid" else {}
    plain, other = (make_problem(name, {**size, "t_end": 1.0, **more}) for more in ({}, presented_as))
    steps = [len(solve_run(problem, 1e-6, "dop853_joint").t) for problem in (plain, other)]
    if "renumber" in presented_as:  # another tree where there are loops
        assert abs(steps[1] - steps[0]) <= 0.2 * steps[0]
    else:
        assert steps[0] == steps[1]
    if name != "slider_crank":
        errors = [error(problem, solve_run(problem, 1e-6, "dop853_joint")) for problem in (plain, other)]
        assert abs(errors[1] - errors[0]) < 0.01 * errors[0]


def test_a_tilt_that_defeats_folding_leaves_the_motion() -> None:
    """A hinge 1e-9 out of line makes spatial code of a planar mechanism, and a motion 1e-9 away."""
    problem = make_problem("damped_linkage", {"t_end": 1.0})
    system = problem.system
    u = system.joint_u.copy()
    u[0] += 1e-9 * np.array([0.6, 0.5, -0.4])
    tilted = dataclasses.replace(problem, system=dataclasses.replace(system, joint_u=u))
    sizes = [make_code(p.system, build_spanning_tree(p.system, p.initial)).operations for p in (problem, tilted)]
    assert sizes[1] > 1.2 * sizes[0]
    planar, spatial = (solve_run(p, 1e-10, "dop853_joint").states.r[-1] for p in (problem, tilted))
    assert np.max(np.abs(planar - spatial)) < 1e-8


def make_thin_bars() -> Problem:
    """Two bars on ball joints, which fall from rest; about their own axes their inertia is 1e-9 of the other one."""
    bodies = [RigidBody(1.0, np.diag([1e-10, 0.1, 0.1]))] * 2
    joints = [Joint(k, (-0.5, 0.0, 0.0), k - 1, (0.5 * k, 0.0, 0.0)) for k in range(2)]
    still = np.zeros((2, 3))
    start = State(np.array([[0.5, 0.0, 0.0], [1.5, 0.0, 0.0]]), np.array([np.eye(3)] * 2), still, still)
    system = assemble(bodies, joints, gravity=(0.0, 0.0, -9.81))
    return Problem("thin bars", system, start, t_end=1.0, dt=1e-3, section="", source="made up")


@pytest.mark.parametrize(
    ("solver", "control", "bound"),
    [
        ("dop853_joint", StepControl(rtol=1e-8), 1e-6),
        ("gauss_joint", StepControl(dt=2e-3), 1e-6),
        ("rattle_joint", StepControl(dt=1e-3), 1e-5),
    ],
)
def test_pivots_are_chosen_anew_where_a_thin_bar_has_no_inertia_left(
    solver: str, control: StepControl, bound: float
) -> None:
    """Without their rows, coordinates of such bars have a singular matrix of inertia in some poses."""
    problem = make_thin_bars()
    true = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-10)).states.r[-1]
    out = make_solver(solver).solve(problem, control)
    assert out.status is Status.SUCCESS, out.message
    assert solver == "dop853_joint" or any("pivots chosen anew" in note for note in out.notes)
    assert_each(np.abs(out.states.r[-1] - true), "<", bound)


@pytest.mark.parametrize(("rtol", "bound"), [(1e-4, 0.05), (1e-6, 5e-3), (1e-7, 1e-4)])
def test_errors_stay_small_where_all_rows_come_into_line(rtol: float, bound: float) -> None:
    """Pivots vanish there: steps go over it or the kernel goes on, and 1e-4 loses 1 % of the reach where rows stop."""
    problem = make_problem("four_bar_grid", {"release": "all_rows"})
    out = solve_run(problem, rtol, "dop853_joint")
    assert error(problem, out) < bound
    assert out.t[-1] == problem.t_end


def test_errors_fall_through_singular_positions_of_parallel_bars() -> None:
    """Forty loops lose rank at once (A02); no step may end there, and none is misled by stages nearby."""
    problem = make_problem("n_four_bar")
    errors = [error(problem, solve_run(problem, rtol, "dop853_joint")) for rtol in (1e-4, 1e-6, 1e-8)]
    assert errors[1] < errors[0] / 5.0
    assert errors[2] < min(errors[1] / 5.0, 1e-5)


def check_energy(problem: Problem, out: Trajectory, rtol: float) -> None:
    """A step errs by at most rtol of its velocities, by twice that of its kinetic energy; none goes by another code."""
    assert not any("kernel" in note or "anew" in note for note in out.notes), (rtol, out.notes)
    T = kinetic_energy(problem.system, out.states)
    assert np.max(np.abs(drift(problem, out))) < 2.0 * rtol * len(out.t) * np.max(T), rtol


@pytest.mark.parametrize(("name", "parameters"), [("n_four_bar", {}), ("four_bar_grid", {"release": "all_rows"})])
def test_singular_positions_are_passed_by_code_at_every_tolerance(name: str, parameters: dict[str, str]) -> None:
    """A passage costs a few steps and no order: errors fall as rtol^(8/9), the power of the pair, or faster, within two
    standard errors of the fit.

    How much an error grows until the end differs with where it is made, a thousandfold on the grid: runs scatter. So do
    rejections: with tolerances that differ by 1e-9 of themselves they are 14 to 28 in 100 steps of the grid.
    """
    problem, rtols = make_problem(name, parameters), 10.0 ** -np.arange(6.0, 10.1, 0.5)
    errors, counts = [], []
    for rtol in rtols:
        out = solve_run(problem, rtol, "dop853_joint")
        check_energy(problem, out, rtol)
        counts.append((out.counters["rejected"], out.counters["steps"]))
        errors.append(error(problem, out))
    rejected, steps = np.sum(counts, axis=0)
    assert rejected < steps / 5
    rejected, steps = np.transpose(counts)
    assert_each(rejected, "<", 0.3 * steps, "rejected steps")
    (slope, _), spread = np.polyfit(np.log10(rtols), np.log10(errors), 1, cov=True)
    assert np.sqrt(spread[0, 0]) < 0.15
    assert slope > 8.0 / 9.0 - 2.0 * np.sqrt(spread[0, 0])


@pytest.mark.parametrize(("number", "rtol"), diagonal(range(len(LINKAGES)), [1e-5, 1e-7, 1e-9, 1e-10]))
def test_linkages_of_other_sizes_keep_their_branch_through_singular_positions(number: int, rtol: float) -> None:
    """Where parallel bars come into line they may cross, where a rod folds onto its crank it may turn with it."""
    of = LINKAGES[number]
    out = solve_run(of.problem, rtol, "dop853_joint")
    check_energy(of.problem, out, rtol)
    angle = np.unwrap(np.arctan2(out.states.R[:, 0, 1, 0], out.states.R[:, 0, 0, 0]))
    assert abs(angle[-1] - angle[0]) > 2.0 * np.pi  # at least two passages
    assert branch_error(of, out.states) < 1e-12


class Spooled:
    """A spool that keeps what it takes."""

    def __init__(self) -> None:
        self.rows, self.t, self.r = 0, list[float](), list[np.ndarray]()

    def due(self) -> bool:
        return True

    def take(self, t: np.ndarray, states: States) -> None:
        self.rows += len(t)
        self.t += list(t)
        self.r += list(states.r)


@pytest.mark.parametrize("name", ["bricard", "driven_slider_crank"])
def test_a_run_that_the_kernel_goes_on_with_is_one_run(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its motion is the exact one, its times go on, drives too, and all of its steps are spooled."""
    problem = make_problem(name, {"t_end": 1.0})
    whole = solve_run(problem, 1e-10, "dop853_joint")
    spool = Spooled()
    monkeypatch.setattr(marching, "LEAST_PIVOT", 0.9)
    monkeypatch.setattr(relay.Relay, "_choose_pivots", lambda _: False)
    out = make_solver("dop853_joint").solve(problem, StepControl(rtol=1e-10, spool=spool))
    assert out.status is Status.SUCCESS, out.message
    assert any("kernel" in note for note in out.notes)
    assert np.max(np.abs(out.states.r[-1] - whole.states.r[-1])) < 1e-7
    assert_each(np.diff(out.t), ">", 0.0)
    assert_same(np.array(spool.t), out.t[1:])
    assert_same(np.array(spool.r), out.states.r[1:])
    assert out.reaction is not None
    assert whole.reaction is not None
    A = constraint_jacobian(problem.system, whole.states[-1])
    load, gone = A.T @ whole.reaction[-1], A.T @ (out.reaction[-1] - whole.reaction[-1])
    assert np.max(np.abs(gone)) < 1e-4 * np.max(np.abs(load))


def test_code_of_other_pivots_goes_on_with_the_same_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where pivots of the start are lost and the rank is not, no kernel is needed."""
    problem = make_problem("bricard", {"t_end": 1.6})
    whole = solve_run(problem, 1e-10, "dop853_joint")
    monkeypatch.setattr(marching, "LEAST_PIVOT", 0.3)
    monkeypatch.setattr(relay, "FAIR", 0.5)
    out = solve_run(problem, 1e-10, "dop853_joint")
    assert any("anew" in note for note in out.notes)
    assert not any("kernel" in note for note in out.notes)
    assert np.max(np.abs(out.states.r[-1] - whole.states.r[-1])) < 1e-7


@pytest.mark.parametrize("name", ["chain", "bricard", "stewart_platform", "four_bar_grid"])
def test_lists_eliminate_as_code_does(name: str) -> None:
    """The same order, and the one found where the mechanism is, give the accelerations that straight code gives."""
    problem = make_problem(name, {"rows": 2, "columns": 2} if name == "four_bar_grid" else {})
    tree = build_spanning_tree(problem.system, problem.initial)
    made = make_code(problem.system, tree)
    random, n = np.random.default_rng(2), len(tree.start)
    moves = np.arange(n) >= (
        tree.nq if made.rows_in_use < made.rows else 0
    )  # off the loops, dependent rows are independent
    t, y = np.array([0.2]), tree.start + 0.01 * random.standard_normal(n) * moves
    found = []
    here = Evaluation(made, tree.nq).find_order(0.2, y, tree.start)
    in_parts = make_code(problem.system, tree, whole=False)
    for one, order in ((made, None), (made, made.order), (in_parts, None), (made, here)):
        y_dot, after, lam, guard = np.zeros(n), np.zeros(n), np.zeros(made.rows), np.zeros(2)
        Evaluation(one, tree.nq, order).accelerate(t, y, y_dot, guard[:1]).run()
        accelerated = y_dot.copy()
        Evaluation(one, tree.nq, order).finish(t, y, after, y_dot, lam, guard).run()
        found.append((accelerated, y_dot[tree.nq :], after, lam, guard))
    for other in found[1:3]:
        for straight, listed in zip(found[0], other, strict=True):
            np.testing.assert_allclose(listed, straight, rtol=0.0, atol=1e-11 * max(1.0, np.max(np.abs(straight))))
    for straight, listed in zip(found[0][:3], found[3], strict=False):
        np.testing.assert_allclose(listed, straight, rtol=0.0, atol=1e-9 * max(1.0, np.max(np.abs(straight))))


def test_pivots_chosen_anew_compile_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lists are read by code that is the same for all mechanisms: compiled for one, it is there for another."""
    monkeypatch.setattr(marching, "LEAST_PIVOT", 0.3)
    monkeypatch.setattr(relay, "FAIR", 2.0)  # no earlier order goes on
    monkeypatch.setattr(symplectic, "POOR_PIVOT", 0.9)

    def run_all(name: str, parameters: dict[str, float]) -> None:
        problem = make_problem(name, parameters)
        solve_run(problem, 1e-8, "dop853_joint")
        for solver in ("gauss_joint", "rattle_joint"):
            out = make_solver(solver).solve(problem, StepControl(dt=0.01))
            assert any("anew" in note for note in out.notes)

    run_all("bricard", {"t_end": 1.3})
    compiled, anew, make, choose = list[str](), list[int](), generated_code._compile, relay.Relay._choose_pivots

    def watch(ir: str, machine: object) -> bytes:
        compiled.append(ir)
        return make(ir, machine)

    def count(march: relay.Relay) -> bool:
        before = len(compiled)
        found = choose(march)
        anew.append(len(compiled) - before)
        return found

    monkeypatch.setattr(generated_code, "_compile", watch)
    monkeypatch.setattr(relay.Relay, "_choose_pivots", count)
    run_all("four_bar_grid", {"rows": 2, "columns": 2, "t_end": 0.4})
    assert anew
    assert not any(anew)


@pytest.mark.parametrize("solver", ["dop853_joint", "gauss_joint", "rattle_joint"])
def test_pivots_of_the_chain_last(solver: str) -> None:
    """Its loop is closed by rows behind all others, whose pivots vanish nowhere: the first order is the only one."""
    problem = make_problem("chain", {"t_end": 2.0})
    control = StepControl(rtol=1e-6) if solver == "dop853_joint" else StepControl(dt=0.004)
    out = make_solver(solver).solve(problem, control)
    assert out.status is Status.SUCCESS
    assert not any("anew" in note for note in out.notes)


def test_a_run_that_the_kernel_cannot_end_says_both(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message has why the code stopped, and what the kernel met."""
    monkeypatch.setattr(marching, "LEAST_PIVOT", 0.9)
    monkeypatch.setattr(relay.Relay, "_choose_pivots", lambda _: False)
    problem = make_problem("bricard", {"t_end": 1.0})
    out = make_solver("dop853_joint").solve(problem, StepControl(rtol=1e-10, max_steps=30))
    assert out.status is Status.STALLED
    assert len(out.t) == 31
    assert any("kernel" in note for note in out.notes)
    assert "max_steps" in out.message


@pytest.mark.parametrize("name", ["heavy_top", "slider_crank"])
def test_stages_in_one_function_make_the_same_steps(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are the same sums in another order."""
    problem = make_problem(name, {"t_end": 0.5})
    at_once = solve_run(problem, 1e-8, "dop853_joint")
    monkeypatch.setattr(code, "SMALL", 0)
    one_by_one = solve_run(problem, 1e-8, "dop853_joint")
    assert len(at_once.t) == len(one_by_one.t)
    assert np.max(np.abs(at_once.states.r[-1] - one_by_one.states.r[-1])) < 1e-10


def test_code_is_refused_where_it_would_be_too_large_or_know_no_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """Known before any is made: code beyond the processor's caches takes a minute; a user's law has no expression."""
    monkeypatch.delattr(code, "_generate_ir")
    assert "operations" in (refuse_code(make_problem("chain", {"links": 300})) or "")
    assert "operations" in (refuse_code(make_problem("four_bar_grid", {"rows": 12, "columns": 12})) or "")
    pushed = dataclasses.replace(make_problem("heavy_top"), system=with_user_forces())
    assert "user forces" in (refuse_code(pushed) or "")


@pytest.mark.parametrize("name", ["four_bar_grid", "andrews", "bricard", "slider_crank", "chain", "stewart_platform"])
def test_code_has_no_fewer_operations_than_were_counted(name: str) -> None:
    """A mechanism whose code is small enough is not refused."""
    problem = make_problem(name)
    counted = estimate_least_operations(problem.system, problem.initial)
    assert counted <= make_code(problem.system, build_spanning_tree(problem.system, problem.initial)).operations


def test_every_kind_of_a_tree_is_declared() -> None:
    """A kind that is renamed would be cut without a word."""
    assert set(MOTIONS) <= {str(kind) for kind in KINDS}


@pytest.mark.parametrize("name", ["rolling_disc", "knife_edge"])
def test_dependent_rows_without_phi_are_refused(name):
    """Declared twice, one row of each pair is left out, and nothing would show that it opens."""
    whole, twice = (make_problem(name, {"t_end": 0.1, "duplicate": k}) for k in (0, 1))
    solver, control = make_solver("dop853_joint"), StepControl(rtol=1e-6)
    assert present_solver(solver, whole).solve(whole, control).status is Status.SUCCESS
    refused = present_solver(solver, twice).solve(twice, control)
    assert refused.status is Status.REFUSED and "rkmk_dop853" in refused.message
