"""Cases of the contract that cost little: a few long steps of each method, with each kind of force and each option.

Steps are of a hundredth of a second, where terms of the second order in them are far above what tests leave. Runs of
plain methods are kept on disk until a file of ``MAKERS`` changes.
"""

import dataclasses
import hashlib
import os
from collections.abc import Callable, Collection
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from mbsbench import Joint, MultibodySystem, Problem, StepControl, Trajectory, assemble, so3
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.joints import JointKind
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.mechanics.types import Status
from mbsbench.harness.results.environment import ROOT
from mbsbench.problems.random_mechanism import draw_body
from mbsbench.solvers.formulations.methods.gc_weak_form import FallbackMarcher, move_reactions_to_nodes
from mbsbench.solvers.plain import ode_gc
from mbsbench.solvers.plain.march import march
from mbsbench.solvers.plain.mechanics import Mechanism

from ..arbitrary_joints import moving_rows, one_joint
from ..arbitrary_systems import consistent, with_user_forces
from .laws import Law, make_laws
from .newton_laws import make_newton_laws
from .test_contract import AS_PRINTED, EQUAL_LOADS, NESTED, SHARP, compare_runs, problem_of
from .test_error_controlled import (
    CLOSE,
    LEFT,
    Replay,
    close_start,
    compare_steps,
    leave_start_out,
    move_off,
    step_plainly,
)
from .test_error_controlled import SHARP as RTOL

DT, STEPS = 1e-2, 3
KEPT = ROOT / "results" / "local" / "plain_runs"
MAKERS = (
    "solvers/plain/*.py",
    "harness/mechanics/**/*.py",
    "problems/*.py",
    "tests/solvers/arbitrary*.py",
    "tests/solvers/plain/cases.py",
    "tests/solvers/plain/test_error_controlled.py",
)


class Case(NamedTuple):
    """A run, and the plain one with which ``compare_runs`` compares it by ``left``, ``loads`` and ``by_means``."""

    name: str
    solve: Callable[[], Trajectory]
    problem: Problem
    plain: Trajectory
    left: float
    loads: float
    ends: float = 0.0  # share of time by which ends of steps may differ, where the method chooses them
    by_means: bool = False
    determined: bool = False  # whether log10 det S is compared with its definition

    def compare(self, found: Trajectory) -> None:
        """Raise AssertionError where a run differs from the plain one: method, mechanism, quantity, both numbers."""
        ended = f"the last time is {float(found.t[-1])!r}, by the plain method {float(self.plain.t[-1])!r}"
        assert found.status is Status.SUCCESS, f"{self.name}: {ended}: {found.message}"
        if self.ends:
            compare_steps(self.name, found, self.plain, self.ends)
        else:
            compare_runs(self.problem, self.name, found, self.plain, self.left, self.loads, self.by_means)
        if "newton_iterations" in found.diagnostics:
            counted = np.nansum(found.diagnostics["newton_iterations"]), found.counters["newton_iterations"]
            assert counted[0] <= counted[1], f"{self.name}: iterations of steps are {counted[0]}, in all {counted[1]}"
        if self.name.startswith("radau_ggl"):
            factors, tried = found.counters["factorisations"], found.counters["steps"] + found.counters["rejected"]
            assert factors == 1 + tried, f"{self.name}: factorisations are {factors}, steps tried are {tried}"
        if self.determined:
            compare_determinants(self.problem.system, self.name, found)

    def describe_change(self, before: Trajectory, after: Trajectory) -> str:
        """Return how two runs differ that both equal the plain one, in words; empty for the same bits."""
        pairs = ((k, n, after.counters[k]) for k, n in before.counters.items() if n != after.counters[k])
        gap = float(np.max(np.abs(after.states.v - before.states.v)))
        words = ", ".join(f"{k} {a} -> {b}" for k, a, b in pairs) or (f"velocities differ by {gap:.1e}" if gap else "")
        return words and f"{self.name}: {words}"


def _of_system(name: str, system: Any, seed: int = 2) -> Problem:
    return problem_of(name, system, consistent(system, seed), STEPS, DT)


def _of_catalogue(name: str, given: dict[str, Any]) -> Problem:
    return dataclasses.replace(make_problem(name, given), t_end=STEPS * DT, dt=DT)


def two_bodies() -> MultibodySystem:
    """Ground - spherical - body 0 - revolute - body 1, under gravity alone."""
    random, gravity = np.random.default_rng(7), (1.1, -2.3, -9.5)
    joints = [
        Joint(0, (0.3, 0.1, 0.0), s_j=(0.1, -0.2, 0.3)),
        Joint(1, (0.2, 0.0, -0.3), 0, (-0.4, 0.1, 0.2), axis_i=(1.0, 2.0, 3.0), axis_j=(0.5, -1.0, 0.2)),
    ]
    return assemble([draw_body(random), draw_body(random)], joints, gravity)


def make_problems() -> dict[str, Problem]:
    """Make the mechanisms by name, of one to three bodies."""
    springs, timed = (one_joint(JointKind.REVOLUTE, ground=False, timed=timed) for timed in (False, True))
    repeated = {"bodies": 2, "loops": 1, "repeated": 1, "mechanism_seed": 5}
    return {
        "linkage": _of_system("linkage", two_bodies()),
        "springs": problem_of("revolute", *springs, STEPS, DT),
        "timed loads": problem_of("timed loads", *timed, STEPS, DT),
        "user forces": _of_system("user forces", with_user_forces(), 3),
        "driven": _of_system("driven position", moving_rows("driven position"), 4),
        "top": _of_catalogue("heavy_top", {}),
        "repeated joint": _of_catalogue("random_mechanism", repeated),
        "last step short": dataclasses.replace(problem_of("last step short", *springs, 1, 2.6 * DT), dt=DT),
        "planar loop": _of_catalogue("random_linkage", {"linkage": "planar"}),
    }


GC, AL = "gc_weak_form", "gc_augmented_lagrangian"
FIXED: list[tuple[str, dict[str, Any], tuple[str, ...]]] = [
    (GC, SHARP, ("linkage", "springs", "user forces", "driven", "top", "last step short")),
    (GC, {**SHARP, "gauge": "zero"}, ("linkage", "springs")),
    (GC, {**SHARP, "gauge": "accumulate"}, ("linkage",)),
    (GC, {**SHARP, "b_term": False, "f_bar": False}, ("linkage", "springs")),
    (GC, {**SHARP, "gauge": "accumulate", "mu0": "velocity", "newton": "kept"}, ("linkage",)),
    (GC, {**SHARP, **AS_PRINTED, "direction": "mass", "final_iterate": "after_correction"}, ("springs",)),
    (GC, {**SHARP, **AS_PRINTED, "final_iterate": "corrected"}, ("springs",)),
    (GC, {**SHARP, "c_bar": 2.0, "k_bar": 5.0, "mu0": "velocity"}, ("linkage", "springs")),
    (GC, {**SHARP, "estimate": "start"}, ("springs",)),
    (AL, {**NESTED, "penalty": 10.0, "penalty_growth": 10.0}, ("planar loop",)),
    (AL, {**NESTED, "k_bar": 5.0, "lambda_bar": True}, ("springs",)),
    (AL, {**NESTED, "k_bar": 2e3, "lambda_bar": True, "penalty": 0.1, "penalty_growth": 100.0}, ("linkage",)),
    (AL, {**NESTED, **AS_PRINTED, "c_bar": 2.0, "k_bar": 5.0}, ("linkage",)),
    ("rattle", {}, ("springs", "linkage", "top", "repeated joint", "user forces")),
    ("lie_variational", {}, ("springs", "linkage", "planar loop")),
    ("generalized_alpha", {}, ("springs", "user forces", "repeated joint")),
    ("generalized_alpha", {"form": "index3", "rho_inf": 0.7}, ("springs", "planar loop")),
    ("al_index3", {}, ("springs", "repeated joint")),
    ("half_explicit", {}, ("springs", "driven", "top", "repeated joint", "user forces")),
    ("energy_momentum", {}, ("springs", "linkage", "planar loop", "timed loads")),
]
BY_MEANS = ("energy_momentum", "random_linkage")  # rows are redundant at closed poses alone
PROXIMAL = {**SHARP, "correct_pose": "never"}  # where it converges, its motion is that of the weak form
BY_TURNS: list[tuple[str, dict[str, Any]]] = [  # of the simplified method and of the full one, on the linkage
    (GC, SHARP),
    (GC, {**SHARP, "gauge": "accumulate"}),
    (AL, PROXIMAL),
]
CODES: tuple[dict[str, Any], ...] = ({}, {"code": "mechanism"})
SHORT, MOST_TURN = 1e-3, 0.9 * 0.3745 * DT  # [s]; [rad]: the springs' bodies turn at 0.3745 rad/s at first
LONG = 0.15  # [s] a step that the simplified method does not solve
CORRECTED = {**SHARP, "correct_pose": "always"}
DETERMINED = 0.01  # of log10 det S: it is that of a pose of the last step, or of one before it
CONTROLLED = {
    "rkmk_dopri5": ("springs", "driven", "user forces"),
    "rkmk_dop853": ("springs", "repeated joint"),
    "radau_ggl": ("springs", "driven", "repeated joint", "user forces"),
}


def make_cases(solvers: Collection[str]) -> list[Case | Law]:
    """Make all cases of some solvers, with the plain runs, and the laws of that name."""
    problems = make_problems()
    fixed = [one for one in FIXED if one[0] in solvers]
    found: list[Case | Law] = [*make_laws(solvers), *make_newton_laws(solvers)]
    found += [_fix(solver, options, problems[name]) for solver, options, names in fixed for name in names]
    found += [_alternate(solver, options, problems["linkage"]) for solver, options in BY_TURNS if solver in solvers]
    if AL in solvers:
        found += [
            _augment({**options, **code}, problems["linkage"]) for options in (PROXIMAL, CORRECTED) for code in CODES
        ]
        found += [_share(), _correct_by_saddle(problems["linkage"])]
    if GC in solvers:
        found += [_leave(problems["top"]), _limit_turns(problems["springs"])]
    for solver, names in ((solver, names) for solver, names in CONTROLLED.items() if solver in solvers):
        found += [_replay(solver, problems[name]) for name in names]
        found.append(_control(solver))
    if "radau_ggl" in solvers:
        found.append(start_off(problems["springs"]))
    return found


def _keep(name: str, solve: Callable[[], Trajectory]) -> Trajectory:
    """Return the plain run of a case, kept on disk or made now."""
    path = KEPT / f"{hashlib.sha256(f'{name} {_digest_makers()}'.encode()).hexdigest()[:32]}.npz"
    if path.exists():
        with np.load(path) as kept:
            t, *states, reaction = (kept[key] for key in ("t", "r", "R", "v", "Omega", "reaction"))
        return Trajectory(t, States(*states), Status.SUCCESS, "", {}, reaction=reaction)
    plain = solve()
    assert plain.status is Status.SUCCESS, f"{name}: {plain.message}"
    KEPT.mkdir(parents=True, exist_ok=True)
    s, part = plain.states, path.with_suffix(f".{os.getpid()}.npz")
    np.savez(part, t=plain.t, r=s.r, R=s.R, v=s.v, Omega=s.Omega, reaction=plain.reaction)
    part.rename(path)
    return plain


@cache
def _digest_makers() -> str:
    """Return a digest of all files on which plain runs depend."""
    paths = sorted(path for pattern in MAKERS for path in ROOT.glob(pattern))
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()


def _fix(solver: str, options: dict[str, Any], problem: Problem) -> Case:
    """Fixed steps."""
    control = StepControl(dt=DT)
    name = f"{solver} {options}, {problem.name}"
    plain = _keep(name, lambda: make_solver(solver, {**options, "code": "plain"}).solve(problem, control))
    made, index3 = make_solver(solver, options), options.get("form") == "index3"
    return Case(
        name,
        lambda: _solve_alone(made, problem, control),
        problem,
        plain,
        1e-12 / DT if index3 else 0.0,
        EQUAL_LOADS + (1e-6 if index3 else 0.0),
        by_means=(solver, problem.name) == BY_MEANS,
    )


def _replay(solver: str, problem: Problem) -> Case:
    """Steps of the plain method over times that the compiled one has chosen."""
    control, made = StepControl(rtol=RTOL, max_step=2e-3), make_solver(solver)
    problem = dataclasses.replace(problem, t_end=5e-3)
    t, name = made.solve(problem, control).t, f"{solver}, {problem.name}"
    plain = _keep(f"{name} {t.tolist()}", lambda: step_plainly(solver, problem, control, t))
    control = dataclasses.replace(control, max_steps=2 * len(t))
    return Case(name, lambda: made.solve(problem, control), problem, plain, LEFT[solver] / 1e-3, EQUAL_LOADS)


def _control(solver: str) -> Case:
    """Steps that the plain method chooses by itself, by errors far above rounding."""
    problem, control = make_problem("heavy_top", {"t_end": 0.04}), StepControl(rtol=1e-5)
    made, name = make_solver(solver), f"{solver}, {problem.name}"
    plain = _keep(f"{name} by itself", lambda: make_solver(solver, {"code": "plain"}).solve(problem, control))
    control = dataclasses.replace(control, max_steps=2 * len(plain.t))
    return Case(name, lambda: made.solve(problem, control), problem, plain, 0.0, np.inf, CLOSE[solver])


def start_off(problem: Problem) -> Case:
    """Steps from a start off the constraints, from which no step passes the error test: it is moved back onto them."""
    control, made = StepControl(rtol=RTOL, max_step=2e-3), make_solver("radau_ggl")
    problem = dataclasses.replace(problem, t_end=1e-3)
    off = move_off(problem)
    t, name = made.solve(off, control).t, f"radau_ggl, {problem.name} off its constraints"
    plain = _keep(f"{name} {t.tolist()}", lambda: step_plainly("radau_ggl", close_start(off), control, t))
    control, left = dataclasses.replace(control, max_steps=2 * len(t)), LEFT["radau_ggl"] / 1e-3

    def solve() -> Trajectory:
        return leave_start_out(made.solve(off, control))

    return Case(name, solve, problem, leave_start_out(plain), left, EQUAL_LOADS)


def _solve_alone(made: Any, problem: Problem, control: StepControl) -> Trajectory:
    """Solve where simplified steps of ODE-GC have to converge: the full method would hide what is wrong in them."""

    def refuse(self: Any) -> None:
        raise AssertionError(f"the simplified method is left at t = {float(self.state['t']):g} s")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FallbackMarcher, "_hand_over", refuse)
        return made.solve(problem, control)


def _alternate(solver: str, options: dict[str, Any], problem: Problem) -> Case:
    """Two steps of the simplified method, two of the full one, and so on: what each has to tell the other."""
    problem, control = dataclasses.replace(problem, t_end=6 * DT), StepControl(dt=DT)
    made, stretch = make_solver(solver, options), FallbackMarcher.stretch

    def take_two(self: FallbackMarcher, n: int) -> Any:
        if not self._stuck and self.state["steps"] == 2:
            self._stuck = True
            self._hand_over()
        return stretch(self, min(n, 2))

    def solve() -> Trajectory:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(FallbackMarcher, "stretch", take_two)
            return made.solve(problem, control)

    name = f"{solver} {options}, {problem.name}, by turns"
    plain = _keep(name, lambda: _step_weak_form(problem, control, options))
    return Case(name, solve, problem, plain, 0.0, EQUAL_LOADS, determined=solver == AL)


def _leave(problem: Problem) -> Case:
    """Steps that are too long for the simplified method, so that the full one has to take them."""
    problem, control, name = dataclasses.replace(problem, t_end=2 * LONG, dt=LONG), StepControl(dt=LONG), f"{GC}, long"
    made, plain = make_solver(GC, SHARP), _keep(name, lambda: _step_weak_form(problem, control, SHARP))
    return Case(name, lambda: made.solve(problem, control), problem, plain, 0.0, EQUAL_LOADS)


def _augment(options: dict[str, Any], problem: Problem) -> Case:
    """The proximal saddle, with poses corrected after each step or not."""
    control, made, name = StepControl(dt=DT), make_solver(AL, options), f"{AL} {options}, {problem.name}"
    plain = _keep(name, lambda: _step_weak_form(problem, control, options))
    return Case(name, lambda: _solve_alone(made, problem, control), problem, plain, 0.0, EQUAL_LOADS, determined=True)


def _share() -> Case:
    """A joint declared twice, by the proximal saddle: its copies share the load that it has alone in the weak form."""
    options, control = {**SHARP, "f_bar": False, "corrective": False}, StepControl(dt=DT)
    once, twice = (
        problem_of("revolute, twice", *one_joint(JointKind.REVOLUTE, ground=False, times=times), STEPS, DT)
        for times in (1, 2)
    )
    made, name = (
        make_solver(AL, {**options, "correct_pose": "never", "newton": "exact"}),
        f"{AL} {options}, {twice.name}",
    )

    def solve() -> Trajectory:
        found = made.solve(twice, control)
        return dataclasses.replace(found, reaction=sum(np.hsplit(found.reaction, 2)))

    name = f"{AL} {options}, {twice.name}"
    plain = _keep(name, lambda: _step_weak_form(once, control, options))
    return Case(name, solve, once, plain, 0.0, EQUAL_LOADS)


def _correct_by_saddle(problem: Problem) -> Case:
    """Poses corrected once after each step by the factor of the saddle, which leaves the square of phi: short steps.

    Its determinant is that of S where c_R is M^-1 a and no nu0 = -nu doubles the columns of nu.
    """
    options = {**CORRECTED, "newton": "exact", "direction": "mass", "gauge": "zero"}
    problem, control = dataclasses.replace(problem, t_end=3 * SHORT, dt=SHORT), StepControl(dt=SHORT)
    name = f"{AL} {options}, {problem.name}"
    made, plain = make_solver(AL, options), _keep(name, lambda: _step_weak_form(problem, control, options))
    return Case(name, lambda: made.solve(problem, control), problem, plain, 0.0, EQUAL_LOADS, determined=True)


def _limit_turns(problem: Problem) -> Case:
    """Steps cut where a body would turn too far: plain ones over the same times, of which each is as long as it may."""
    options, control = {**SHARP, "newton": "exact"}, StepControl(dt=DT)
    made, name = make_solver(GC, {**options, "max_turn": MOST_TURN}), f"{GC}, {problem.name}, turns limited"
    found = made.solve(problem, control)
    h, speed = np.diff(found.t), np.max(np.linalg.norm(found.states.Omega[:-1], axis=2), axis=1)
    assert np.all(speed * h <= MOST_TURN) and np.any(speed * np.where(h < DT, 2.0 * h, 0.0) > MOST_TURN)
    choices = make_solver(GC, {**options, "code": "plain"})

    def step_plainly() -> Trajectory:
        step = ode_gc.Step(problem, choices, choices.make_settings(problem))
        return move_reactions_to_nodes(march(problem, control, step, Replay(found.t)))

    plain = _keep(f"{name} {found.t.tolist()}", step_plainly)
    return Case(name, lambda: made.solve(problem, control), problem, plain, 0.0, EQUAL_LOADS)


def _step_weak_form(problem: Problem, control: StepControl, options: dict[str, Any]) -> Trajectory:
    """Plain steps of the weak form, and corrections of poses after each where ``options`` have them."""
    options = {name: x for name, x in options.items() if name != "code"}
    step = _CorrectedStep if options.pop("correct_pose", "never") == "always" else ode_gc.Step
    choices = make_solver(GC, {**options, "code": "plain"})
    if step is ode_gc.Step:
        return choices.solve(problem, control)
    return move_reactions_to_nodes(march(problem, control, step(problem, choices, choices.make_settings(problem))))


class _CorrectedStep(ode_gc.Step):
    """A step, and the least change of its poses, in the norm of M, onto phi = 0."""

    def __call__(self, dt: float, a: Any, old: Any) -> Any:
        b, carried, reaction = super().__call__(dt, a, old)  # type: ignore[misc]
        m, r, R, v = self.mechanism, b.r, b.R, b.v
        for _ in range(4):
            rows = m.rows(b.t, r, R, v)
            pushed = np.array([m.divide_by_inertia(one) for one in rows.A])
            change = (-np.linalg.solve(rows.A @ pushed.T, rows.phi) @ pushed).reshape(-1, 6)
            r, R = r + change[:, :3], R @ so3.exp(change[:, 3:])
        return self.make_node(b.t, r, R, v), carried, reaction


def compare_determinants(system: MultibodySystem, where: str, found: Trajectory) -> None:
    """Compare log10 det S, of rows scaled to a unit diagonal, with that at the end of each step."""
    m = Mechanism(system)
    for k in range(1, len(found.t)):
        s = found.states[k]
        A = m.rows(found.t[k], s.r, s.R, np.hstack((s.v, s.Omega))).A
        S = A @ np.array([m.divide_by_inertia(one) for one in A]).T
        size = np.sqrt(np.diag(S))
        plain, told = np.log10(np.linalg.det(S / np.outer(size, size))), found.diagnostics["log_determinant"][k]
        words = f"{where}: log10 of the determinant after step {k} is {told}, by its definition {plain}"
        assert abs(told - plain) < DETERMINED, words
