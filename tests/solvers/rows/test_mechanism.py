"""Straight code of a whole mechanism: the judge's accelerations, the kernel's motion, and who is chosen when."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from mbsbench.harness.base.generated import code as objects
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.motion import constraint, constraint_rate
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import MultibodySystem
from mbsbench.harness.mechanics.types import Problem, Status, StepControl, Trajectory
from mbsbench.harness.run.presenting import present_solver
from mbsbench.solvers.formulations.compiled import host, mechanism
from mbsbench.solvers.formulations.compiled.kernel import Kernel, allocate_kernel, make_kernel, set_state
from mbsbench.tests.comparing import assert_same
from mbsbench.tests.factories import solve_run

from ..arbitrary_joints import KINDS, MOVING, all_joints, moving_rows, one_joint
from ..arbitrary_systems import consistent, judge_accelerations, linkage, rounding_of_rows, with_user_forces

SYSTEMS = {"linkage": linkage(springs=True), "all joints": all_joints(), "moving rows": moving_rows(None)}
PROBLEMS = {  # t_end [s]; pins, springs and dampers, line rows, drives, rows of velocities alone, redundant rows
    "heavy_top": 0.3, "chain": 0.1, "flyball_governor": 0.05, "damped_linkage": 0.3, "slider_crank": 0.3,
    "torque_free_body": 0.3, "driven_slider_crank": 0.5, "stewart_platform": 0.2, "rolling_disc": 0.5, "bricard": 0.5,
}  # fmt: skip
PRESENTED = ({"yaw": 0.7}, {"mirror": "X"}, {"renumber": 3}, {"rotation": (0.3, -0.5, 0.7)})
STEP = 1e-3  # [s]
SAME = 1e-9  # [m] of step sizes that differ by rounding
ROUNDING = 1e-12  # relative


def coded(system: MultibodySystem) -> Kernel:
    return mechanism.use_code(system, allocate_kernel(system)).kernel


def solve_by(problem: Problem, code: str, solver: str = "rkmk_dop853", rtol: float = 1e-9) -> Trajectory:
    """A run by this code that must succeed, with steps of ``STEP`` where they are fixed."""
    return solve_run(problem, rtol if make_solver(solver).control == "rtol" else STEP, solver, code=code)


def check_same(one: Trajectory, other: Trajectory) -> None:
    """As many steps, and the same end."""
    assert len(one.t) == len(other.t) and one.reaction is not None and other.reaction is not None
    for name in ("r", "R"):
        assert np.max(np.abs(getattr(one.states, name)[-1] - getattr(other.states, name)[-1])) < SAME
    largest = max(1.0, float(np.max(np.abs(one.reaction), initial=0.0)))
    assert np.max(np.abs(one.reaction[-1] - other.reaction[-1]), initial=0.0) < 1e3 * SAME * largest


def check_accelerations(system: MultibodySystem, s: State) -> None:
    """The judge's accelerations and load of the reactions; those of the kernel to rounding."""
    k, kernel = coded(system), make_kernel(system, ("accelerate",))
    for one in (k, kernel):
        set_state(one, s)
        one.accelerate.run()
    load = (constraint_jacobian(system, s).T @ k.lam[k.order]).reshape(-1, 6)
    for found, (judged, error) in zip((k.v_dot, load), judge_accelerations(system, s), strict=True):
        assert np.max(np.abs(found - judged)) < error + ROUNDING * max(1.0, float(np.max(np.abs(judged))))
    assert np.max(np.abs(k.v_dot - kernel.v_dot)) < ROUNDING * max(1.0, float(np.max(np.abs(kernel.v_dot))))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
def test_accelerations_and_reactions_are_the_judges(system: MultibodySystem, seed: int) -> None:
    """At random states of systems without symmetry."""
    check_accelerations(system, consistent(system, seed))


ENDS = [  # of each kind of joint one, in turn on the ground and between two bodies; the others are slow
    pytest.param(kind, ground, marks=() if k % 2 == ground else pytest.mark.slow)
    for k, kind in enumerate(KINDS)
    for ground in (True, False)
]


@pytest.mark.parametrize(("kind", "ground"), ENDS)
def test_each_kind_of_joint_has_the_judges_accelerations(kind, ground: bool) -> None:
    """Each alone, between two bodies and on the ground."""
    check_accelerations(*one_joint(kind, ground=ground))


@pytest.mark.parametrize("kind", MOVING)
def test_each_kind_of_moving_row_has_the_judges_accelerations(kind: str) -> None:
    """Drives, knife edges and discs."""
    system = moving_rows(kind)
    check_accelerations(system, consistent(system, 3))


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
def test_projection_meets_the_constraints(system: MultibodySystem) -> None:
    """A few passes bring phi and phi_dot to rounding, since each leaves the square of what there was."""
    s, k = consistent(system, 1), coded(system)
    set_state(k, State(s.r + 1e-4, s.R, s.v + 1e-4, s.Omega, s.t))
    for _ in range(4):
        k.accelerate.run()
        k.project.run()
    now = State(k.r, k.R, k.v[:, :3], k.v[:, 3:], k.t[0])
    for rows, rounding in zip((constraint, constraint_rate), rounding_of_rows(now), strict=True):
        assert np.max(np.abs(rows(system, States.one(now)))) < rounding


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", PROBLEMS)
def test_code_gives_the_kernels_motion(name: str) -> None:
    """Straight code instead of loops over joints: the same steps, the same motion and reactions to rounding."""
    problem = dataclasses.replace(make_problem(name, {}), t_end=PROBLEMS[name])
    check_same(*(solve_by(problem, code) for code in ("mechanism", "kernel")))


def test_pairs_of_lower_order_run_on_code() -> None:
    """The pair of Dormand and Prince has the same option."""
    problem = dataclasses.replace(make_problem("chain", {}), t_end=0.1)
    check_same(*(solve_by(problem, code, "rkmk_dopri5", 1e-6) for code in ("mechanism", "kernel")))


def random_numbers(k: Kernel, s: State, seed: int) -> None:
    """A kernel at a state, with numbers in all that its entries read beside the state."""
    random = np.random.default_rng(seed)
    set_state(k, s)
    k.state["shift"] = 1e-4
    for name in ("x", "w", "rhs", "lam"):
        getattr(k, name)[:] = random.standard_normal(getattr(k, name).shape)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
def test_each_entry_of_code_does_what_the_kernels_does(system: MultibodySystem) -> None:
    """One after the other in an order in which methods call them, at a random state, velocities off the rows."""
    s = consistent(system, 4)
    s = State(s.r + 1e-3, s.R, s.v + 1e-2, s.Omega, s.t)
    names = tuple(mechanism.SPLIT)
    k = make_kernel(system, names)
    c = mechanism.use_code(system, allocate_kernel(system), names).kernel
    order = (
        "rows",
        "factorise",
        "keep_rows",
        "push",
        "slips",
        "solve",
        "push_kept",
        "forces",
        "react",
        "applied_forces",
        "project_rates",
        "project",
        "rows",
        "reactions",
        "accelerate",
        "push_kept",
    )
    for one in (k, c):
        random_numbers(one, s, 5)
    for name in order:
        for one in (k, c):
            getattr(one, name).run()
        for array in ("r", "R", "v", "x", "w", "v_dot", "lam", "phi", "slip", "gamma"):
            expected, found = getattr(k, array), getattr(c, array)
            size = max(1.0, float(np.max(np.abs(expected), initial=0.0)))
            assert np.max(np.abs(found - expected), initial=0.0) < ROUNDING * size, (name, array)
        if name in ("solve", "project_rates"):  # else it is room for what an entry does on the way
            assert np.max(np.abs(c.rhs - k.rhs)) < ROUNDING * max(1.0, float(np.max(np.abs(k.rhs))))
        if "forces" in name:
            assert np.max(np.abs(c.force - k.force)) < ROUNDING * max(1.0, float(np.max(np.abs(k.force))))


FIXED = ("rattle", "lie_variational", "generalized_alpha", "energy_momentum", "half_explicit")
RUNS = [
    *((solver, name) for solver in (*FIXED, "al_index3") for name in ("heavy_top", "chain", "damped_linkage")),
    *((solver, "bricard") for solver in FIXED),  # not by ``al_index3``, whose redundant rows share what 1e-7 decides
    *(("radau_ggl", name) for name in ("heavy_top", "chain", "damped_linkage")),
    *((solver, name) for solver in ("gc_composed", "gc_extrapolated") for name in ("heavy_top", "chain", "bricard")),
    ("half_explicit", "rolling_disc"),
    ("rattle", "stewart_platform"),
    ("generalized_alpha", "driven_slider_crank"),
]
SHORT = {  # each solver and each mechanism, those that only one solver moves among them; the rest are slow
    ("rattle", "chain"), ("lie_variational", "damped_linkage"), ("generalized_alpha", "bricard"),
    ("energy_momentum", "heavy_top"), ("half_explicit", "damped_linkage"), ("al_index3", "chain"),
    ("rattle", "bricard"), ("radau_ggl", "damped_linkage"), ("gc_composed", "bricard"),
    ("gc_extrapolated", "heavy_top"), ("half_explicit", "rolling_disc"), ("rattle", "stewart_platform"),
    ("generalized_alpha", "driven_slider_crank"),
}  # fmt: skip
assert set(RUNS) >= SHORT


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("solver", "name"), [pytest.param(*run, marks=() if run in SHORT else pytest.mark.slow) for run in RUNS]
)
def test_every_compiled_solver_has_the_kernels_motion_by_code(solver: str, name: str) -> None:
    """As many steps, the same end and reactions; what made the rows stands in the run."""
    problem = dataclasses.replace(make_problem(name, {}), t_end=PROBLEMS[name])
    new, old = (solve_by(problem, code, solver) for code in ("mechanism", "kernel"))
    check_same(new, old)
    assert any("code of the mechanism" in note for note in new.notes)
    assert not any("code of the mechanism" in note for note in old.notes)


@pytest.mark.sampled(0)
def test_a_symplectic_run_changes_code_within_a_stretch_of_steps(monkeypatch, tmp_path) -> None:
    """Rows and factor that the kernel has left for the next step are made anew by code."""
    problem = dataclasses.replace(make_problem("chain", {"links": 6}), t_end=0.3)
    monkeypatch.setattr(objects, "FOLDER", tmp_path)
    monkeypatch.setattr(host, "STRETCH_BYTES", 1.0)
    monkeypatch.setattr(host, "EVALUATIONS_THAT_PAY", 100)
    for solver in ("rattle", "half_explicit", "generalized_alpha"):
        changed = solve_by(problem, "auto", solver)
        assert "code of the mechanism from t = " in changed.notes[1]
        check_same(changed, solve_by(problem, "kernel", solver))


@pytest.mark.parametrize("solver", ["rattle", "radau_ggl", "energy_momentum", "gc_composed", "gc_extrapolated"])
def test_a_solver_refuses_code_that_would_be_too_large(solver: str) -> None:
    """Before anything is made."""
    one = make_solver(solver, {"code": "mechanism"})
    reason = one.refuses(make_problem("four_bar_grid", {}), StepControl(dt=1e-3))
    assert "30000 operations" in reason


def test_a_tilt_that_leaves_no_zeros_leaves_the_motion() -> None:
    """By 1e-9 rad: more operations, as axes and gravity have no zeros, and the motion tilted by as much."""
    straight, tilted = (
        dataclasses.replace(make_problem("slider_crank", {"rotation": a}), t_end=0.3)
        for a in ((0.0, 0.0, 0.0), (1e-9, -1e-9, 1e-9))
    )
    one, other = (mechanism.use_code(p.system, allocate_kernel(p.system)).operations for p in (straight, tilted))
    assert other > one
    new, old = solve_by(straight, "mechanism"), solve_by(tilted, "mechanism")
    assert np.max(np.abs(new.states.r[-1] - old.states.r[-1])) < 1e-8


SAMPLE = [  # each presentation of one mechanism, in turn; the others are slow
    pytest.param(presented_as, name, id=f"{presented_as}-{name}", marks=() if k % 3 == j else pytest.mark.slow)
    for k, presented_as in enumerate(PRESENTED)
    for j, name in enumerate(("heavy_top", "chain", "slider_crank"))
]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("presented_as", "name"), SAMPLE)
def test_errors_are_the_same_however_a_mechanism_is_presented(name: str, presented_as: dict[str, Any]) -> None:
    """Turned, mirrored and renumbered copies have other code, the same steps, and errors alike but for rounding."""
    errors, steps = [], []
    for more in ({}, presented_as):
        problem = make_problem(name, {**more, "t_end": PROBLEMS[name]})
        solver = present_solver(make_solver("rkmk_dop853", {"code": "mechanism"}), problem)
        runs = [solver.solve(problem, StepControl(rtol=rtol)) for rtol in (1e-6, 1e-13)]
        assert all(out.status is Status.SUCCESS for out in runs)
        errors.append(float(np.max(np.linalg.norm(runs[0].states.r[-1] - runs[1].states.r[-1], axis=1))))
        steps.append(len(runs[0].t))
    assert steps[0] == steps[1]
    assert abs(errors[1] - errors[0]) < 0.01 * errors[0] + SAME


def test_a_run_past_flat_cells_is_the_kernels() -> None:
    """Turning four-bar cells pass the flat position, where the rank of their rows falls."""
    problem = dataclasses.replace(make_problem("n_four_bar", {"windows": 2}), t_end=4.0)
    check_same(*(solve_by(problem, code, rtol=1e-6) for code in ("mechanism", "kernel")))


@pytest.mark.parametrize("angle", [0.1, 1e-3, 1e-5, 1e-7, 0.0])
def test_rank_changes_as_in_the_kernel(angle: float) -> None:
    """Four-bar cells that stand by ``angle`` [rad] above flat: code drops the rows that the kernel drops."""
    problem = make_problem("n_four_bar", {"windows": 2})
    s, turn = problem.initial, so3.exp(np.array([0.0, 0.0, angle - 0.5 * np.pi]))
    up, bridges = np.array([0.0, 1.0, 0.0]), s.r[:, 1] > 0.9  # between the upper ends of bars of 1 m
    r = np.where(bridges[:, None], s.r + turn @ up - up, s.r + 0.5 * (turn @ up - up))
    R = np.where(bridges[:, None, None], s.R, turn @ s.R)
    flat = State(r, R, np.zeros_like(r), np.zeros_like(r), 0.0)
    assert np.max(np.abs(constraint(problem.system, States.one(flat)))) < 1e-15
    k, c = make_kernel(problem.system, ("accelerate",)), coded(problem.system)
    for one in (k, c):
        set_state(one, flat)
        one.accelerate.run()
    assert (k.state["rank"] < 29) == (angle < 1e-4)
    assert np.max(np.abs(k.v_dot - c.v_dot)) < 1e-10
    assert_same(k.lam == 0.0, c.lam == 0.0)


def test_auto_takes_the_kernel_until_code_pays_and_kept_code_at_once(monkeypatch, tmp_path) -> None:
    """The code used stands in the run; making code is set-up, not the run."""
    problem = dataclasses.replace(make_problem("chain", {"links": 6}), t_end=0.5)
    monkeypatch.setattr(objects, "FOLDER", tmp_path)
    monkeypatch.setattr(host, "STRETCH_BYTES", 1.0)
    kernel = solve_by(problem, "auto")
    assert kernel.notes == ("code of the kernel",) and not objects.is_kept("")
    monkeypatch.setattr(host, "EVALUATIONS_THAT_PAY", 100)
    changed = solve_by(problem, "auto")
    assert changed.notes[0] == "code of the kernel" and "code of the mechanism from t = " in changed.notes[1]
    at_once = solve_by(problem, "auto")
    assert at_once.notes[0].startswith("code of the mechanism:") and len(at_once.notes) == 1
    for out in (kernel, changed):
        check_same(out, at_once)
    assert changed.setup_time > changed.cpu_time


def test_without_code_the_kernel_runs_or_the_run_is_refused() -> None:
    """User forces and large mechanisms: ``auto`` says so and runs, ``mechanism`` refuses, at once."""
    solver, control = make_solver("rkmk_dop853", {"code": "mechanism"}), StepControl(rtol=1e-6)
    large = dataclasses.replace(make_problem("four_bar_grid", {}), t_end=0.01)
    assert "30000 operations" in solver.refuses(large, control)
    assert "30000 operations" in solve_by(large, "auto").notes[0]
    system = with_user_forces()
    assert "user forces" in mechanism.find_code_refusal(system, allocate_kernel(system))
    barely = dataclasses.replace(make_problem("four_bar_grid", {"rows": 3, "columns": 2}), t_end=0.01)
    assert solver.solve(barely, control).status is Status.REFUSED
    assert "30000 operations" in solve_by(barely, "auto").notes[0]
