"""Compiled methods take the steps of the plain ones, which are the definition: every joint, force and option.

A failure names method, joint or force, and the quantity that differs with both numbers.
"""

import re
from itertools import pairwise

import numpy as np
import pytest

from mbsbench import Problem, StepControl, so3
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.joints import DECLARED
from mbsbench.harness.mechanics.joints import KINDS as ALL_KINDS
from mbsbench.harness.mechanics.types import Status
from mbsbench.harness.results.environment import ROOT
from mbsbench.solvers.plain import energy_momentum
from mbsbench.solvers.plain.march import Node
from mbsbench.solvers.plain.mechanics import Mechanism
from mbsbench.tests.covering import diagonal, every, few

from ..arbitrary_joints import KINDS, MOVING, moving_rows, one_joint
from ..arbitrary_systems import consistent, linkage

SHARP = {"tolerance": 1e-13}
EQUAL_LOADS = 1e-7  # of their size: what 1e-13 of velocities, or phi of 1e-12 m, is over steps of 1e-3 and 1e-4 s
EQUAL = 1e-11  # of the size of a quantity, a step: what the stop test and rounding leave
AS_PRINTED = {"newton": "exact", "gauge": "accumulate", "sigma0": "carried"}
CHOICES = [
    {},
    {"newton": "kept"},
    {"newton": "exact"},
    {"gauge": "zero"},
    {"gauge": "accumulate"},
    {"gauge": "accumulate", "mu0": "velocity", "newton": "kept"},
    {"direction": "mass"},
    {"direction": "mass", "newton": "exact"},
    {"f_bar": False},
    {"b_term": False},
    {"estimate": "start"},
    {"final_iterate": "corrected"},
    {"final_iterate": "after_correction"},
    {"c_bar": 2.0, "k_bar": 5.0},
    AS_PRINTED,
    {**AS_PRINTED, "direction": "mass", "final_iterate": "after_correction"},
]


QUANTITIES = {"r": "position r", "R": "pose R", "v": "velocity v", "Omega": "velocity Omega"}


def problem_of(name, system, start, steps, dt=1e-3):
    """A problem of so many steps."""
    return Problem(name, system, start, t_end=steps * dt, dt=dt, section="", source="made up")


def compare(problem, solver, options, codes=("kernel",), steps=20, left=0.0, by_means=False):
    """Compare poses, velocities (to ``left`` [m/s] a step more) and loads with those of the plain method."""
    control = StepControl(dt=problem.t_end / steps)
    plain = make_solver(solver, {**options, "code": "plain"}).solve(problem, control)
    assert plain.status is Status.SUCCESS, plain.message
    for code in codes:
        made = make_solver(solver, {**options, "code": code})
        if code != "kernel" and made.refuses(problem, control):
            continue
        found = made.solve(problem, control)
        assert found.status is Status.SUCCESS, f"{solver}, {code}, {problem.name}: {found.message}"
        where = f"{solver} {options}, {code}, {problem.name}"
        index3 = options.get("form") == "index3"
        phi = 1e-12 / problem.dt if index3 else 0.0  # [m/s] phi to 1e-12 leaves of velocities
        loads = EQUAL_LOADS + (1e-6 if index3 else 0.0) + left / control.dt
        compare_runs(problem, where, found, plain, left + phi, loads, by_means)


def compare_runs(problem, where, found, plain, left=0.0, loads=EQUAL_LOADS, by_means=False):
    """Compare two runs at each node: velocities may differ by ``left`` [m/s] more, loads by ``loads`` of their size.

    ``by_means``: loads are those of ``compare_mean_loads``.
    """
    assert len(found.t) == len(plain.t), f"{where}: {len(found.t)} nodes, the plain method has {len(plain.t)}"
    size = max(1.0, float(np.max(np.abs(plain.states.r))))
    speed = max(1.0, *(float(np.max(np.abs(a))) for a in (plain.states.v, plain.states.Omega)))
    differing = []
    for order, (name, scale) in enumerate((("r", size), ("R", 1.0), ("v", speed), ("Omega", speed))):
        one, two = getattr(found.states, name), getattr(plain.states, name)
        gap = np.abs(one - two).reshape(len(one), -1)
        allowed = (EQUAL * scale + left) * np.maximum(np.arange(len(one)), 1)
        wrong = np.flatnonzero(~(np.max(gap, axis=1) <= allowed))  # NaN is wrong
        if len(wrong):
            worst = np.unravel_index(np.argmax(gap[wrong[0]]), one.shape[1:])
            numbers = float(one[wrong[0]][worst]), float(two[wrong[0]][worst])
            differing.append((wrong[0], order, f"{QUANTITIES[name]} of body {worst[0]}", *numbers))
    if differing:
        step, _, quantity, by_code, by_hand = min(differing)
        others = [other for at, _, other, *_ in sorted(differing)[1:] if at == step]
        there = f"{', '.join(others)} differ there, too" if others else "all others agree there"
        numbers = f"is {by_code!r}, by the plain method {by_hand!r}"
        raise AssertionError(f"{where}: {quantity} after step {step} {numbers}; {there}")
    (compare_mean_loads if by_means else compare_loads)(problem, where, found, plain, loads)


def compare_loads(problem, where, found, plain, allowed):
    """Compare the loads A^T lam of the reactions at each node: redundant rows share them by any rule."""
    A = [Mechanism(problem.system).rows(t, s.r, s.R, np.hstack((s.v, s.Omega))).A for t, s in steps_of(plain)]
    _compare_products(where, A, (found.reaction, plain.reaction), allowed)


def compare_mean_loads(problem, where, found, plain, allowed):
    """Compare the loads A_m^T F of energy-momentum's steps on the rows of their mean poses.

    Where rows are redundant on the constraints alone, what a rule leaves open is in the null space of A_m^T. That of
    the next node is another one, by O(h): loads of the recorded multipliers there differ by as much.
    """
    step, A = energy_momentum.Step(problem, 0.0), [np.zeros((problem.system.nrows, 6 * problem.system.nb))]
    for (t0, a), (t1, b) in pairwise(steps_of(plain)):
        v0, v1 = (np.hstack((s.v, s.Omega)) for s in (a, b))
        node, h, v_m = Node(t0, a.r, a.R, v0), t1 - t0, 0.5 * (v0 + v1)
        D = step.mechanism.rows(t0 + 0.5 * h, 0.5 * (a.r + b.r), 0.5 * (a.R + b.R), v_m).D
        A.append(np.array([step.turn_to_bodies(h, node, v_m, row) for row in D.T]))
    _compare_products(where, A, [multipliers_of_means(x.reaction) for x in (found, plain)], allowed)


def multipliers_of_means(recorded):
    """The multipliers F of mean poses from those recorded, F + (F' - F'') / 2, which begin with those of the start."""
    F = [recorded[0], recorded[0]]
    for lam in recorded[1:]:
        F.append(lam - 0.5 * (F[-1] - F[-2]))
    return F[1:]


def _compare_products(where, A, reactions, allowed):
    """Compare loads A^T lam of two runs at each node."""
    one, two = (np.array(list(map(load_of, A, x))) for x in reactions)
    known = np.flatnonzero(np.isfinite(one).all(axis=1) & np.isfinite(two).all(axis=1))
    assert len(known) >= len(A) - 1
    size = max(1.0, float(np.max(np.abs(two[known]))))
    gap = np.abs(one - two)[known]
    node, place = np.unravel_index(np.argmax(gap), gap.shape)
    at, of = known[node], "torque" if place % 6 > 2 else "force"
    assert gap[node, place] <= allowed * size, (
        f"{where}: {of} of the multipliers on body {place // 6} at node {at} is {float(one[at, place])!r}, "
        f"by the plain method {float(two[at, place])!r}"
    )


def load_of(A, reaction):
    """A^T lam"""
    return A.T @ reaction


def steps_of(motion):
    """Times and states."""
    return [(t, motion.states[k]) for k, t in enumerate(motion.t)]


OF_JOINTS = ({}, {"corrective": False}, {**AS_PRINTED, "direction": "mass"})


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("kind", "ground", "options"), diagonal(KINDS, [True, False], OF_JOINTS), ids=str)
def test_one_joint_with_a_spring_and_loads(kind, ground, options):
    """Each kind of joint, beside a spring with a damper and two loads: by the full Newton method."""
    problem = problem_of(kind, *one_joint(kind, ground=ground), 10)
    compare(problem, "gc_weak_form", {**SHARP, **options}, steps=10)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("kind", "options"), diagonal(MOVING, [{}, AS_PRINTED]), ids=str)
def test_one_moving_row_with_timed_loads(kind, options):
    """Drives and rows of velocities, beside a torsional spring and loads that are functions of time."""
    system = moving_rows(kind)
    problem = problem_of(kind, system, consistent(system, 4), 10)
    compare(problem, "gc_weak_form", {**SHARP, **options}, steps=10)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("options", CHOICES, ids=str)
def test_every_choice_on_an_arbitrary_linkage(options):
    """Three bodies, pins and hinges under gravity."""
    system = linkage(springs=False)
    compare(problem_of("linkage", system, consistent(system, 2), 10), "gc_weak_form", {**SHARP, **options}, steps=10)


@pytest.mark.sampled(0)
@pytest.mark.parametrize("options", every(CHOICES, 5), ids=str)
def test_choices_on_an_arbitrary_linkage_by_code_of_the_mechanism(options):
    """The same, where such code serves, and over more steps."""
    system = linkage(springs=False)
    problem = problem_of("linkage", system, consistent(system, 2), 20)
    compare(problem, "gc_weak_form", {**SHARP, **options}, ("mechanism",))


@pytest.mark.parametrize("options", [{}, {"gauge": "zero"}, AS_PRINTED], ids=str)
def test_directions_along_translations(options):
    """c_R = (e_k, 0), which pins alone have."""
    problem = make_problem("spherical_pendulum", {"omega_z": 3.0, "t_end": 0.02})
    compare(problem, "gc_weak_form", {**SHARP, **options, "direction": "translation"})


METHODS = [
    ("rattle", {}),
    ("lie_variational", {}),
    ("generalized_alpha", {}),
    ("generalized_alpha", {"form": "index3", "rho_inf": 0.7}),
    ("al_index3", {}),
    ("half_explicit", {}),
    ("energy_momentum", {}),
]


ON_JOINTS = [(kind, *method) for kind in (*KINDS, *MOVING) for method in METHODS]


def is_on_the_diagonal(case):
    """Each joint by a method and each method on some joints; what moves by the one method that takes all of it, too."""
    kind, *method = case
    return METHODS[[*KINDS, *MOVING].index(kind) % len(METHODS)] == (*method,) or (
        kind in MOVING and method == ["half_explicit", {}]
    )


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("kind", "solver", "options"), few(ON_JOINTS, is_on_the_diagonal), ids=str)
def test_other_methods_on_every_joint(kind, solver, options):
    """Between two bodies and to the ground, beside springs and loads; rows that a method refuses are left out."""
    systems = [one_joint(kind, ground=ground) for ground in (True, False)] if kind in KINDS else []
    if not systems:
        system = moving_rows(kind)
        systems = [(system, consistent(system, 4))]
    for system, start in systems:
        problem = problem_of(kind, system, start, 10, 1e-4)
        if make_solver(solver, options).refuses(problem, StepControl(dt=problem.dt)) is None:
            compare(problem, solver, options, ("kernel", "mechanism"), steps=10)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("solver", "options"), METHODS, ids=str)
def test_other_methods_on_redundant_rows(solver, options):
    """Redundant rows share a reaction by any rule: the motion is one."""
    problem = make_problem("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.01})
    compare(problem, solver, options, steps=10)


NESTED = {"loop": "nested", "correct_pose": "never", "penalty": 1e3, "max_augmentations": 40, "tolerance": 1e-11}


GIVEN = {"c_bar": 2.0, "k_bar": 5.0}
OF_LOOPS = (
    {},
    {"gauge": "zero"},
    {"k_bar": 5.0, "lambda_bar": True},
    {"k_bar": 2e3, "lambda_bar": True, "penalty": 0.1, "penalty_growth": 100.0},
    {**GIVEN, "lambda_bar": True, "penalty": 1.0, "penalty_growth": 2.0, "max_augmentations": 3, "accept": 1e9},
    {"penalty_growth": 10.0},
    AS_PRINTED,
    GIVEN,
    {**AS_PRINTED, **GIVEN, "lambda_bar": True},
)


@pytest.mark.parametrize(("options", "name"), diagonal(OF_LOOPS, ["linkage", "four_bar_grid"]), ids=str)
def test_the_nested_loop_of_section_4_3(options, name):
    """(84) and (85) on a mechanism with independent rows, and on one with redundant ones."""
    system = linkage(springs=False)
    problem = (
        problem_of(name, system, consistent(system, 2), 10)
        if name == "linkage"
        else make_problem(name, {"rows": 1, "columns": 1, "t_end": 0.01})
    )
    compare(problem, "gc_augmented_lagrangian", {**NESTED, **options}, steps=10)


@pytest.mark.parametrize("kind", ALL_KINDS)
def test_rates_of_wrenches_are_those_of_the_wrenches(kind):
    """D_dot of each kind is the change of D along the motion, and D^T u the change of phi: by differences."""
    system = moving_rows(kind) if kind in MOVING else one_joint(kind, ground=False)[0]
    m, start = Mechanism(system), consistent(system, 4)
    v, h = np.concatenate((start.v, start.Omega), axis=1), 1e-5
    ends = []
    for t in (-h, h):
        ends.append(m.rows(t, start.r + t * v[:, :3], start.R @ so3.exp(t * v[:, 3:]), v))
    here = m.rows(0.0, start.r, start.R, v)
    D_dot = (ends[1].D - ends[0].D) / (2.0 * h)
    assert np.max(np.abs(here.D_dot - D_dot)) < 1e-8 * max(1.0, np.max(np.abs(D_dot)))
    phi_dot = (ends[1].phi - ends[0].phi) / (2.0 * h)
    holonomic = np.array([turns for kind in system.joint_sort for turns in rows_with_phi(kind)])
    assert np.any(holonomic) or not DECLARED[ALL_KINDS[system.joint_sort[0]]].is_holonomic
    assert np.max(np.abs((here.phi_dot - phi_dot)[holonomic]), initial=0.0) < 1e-8
    u = np.hstack((start.v, np.einsum("bij,bj->bi", start.R, start.Omega))).ravel()
    still = m.rows(0.0, start.r, start.R, np.zeros_like(v))
    assert np.max(np.abs(here.phi_dot - still.phi_dot - here.D.T @ u)) < 1e-12 * max(1.0, float(np.max(np.abs(u))))
    twice = m.rows(0.0, start.r, start.R, 2.0 * v)  # gamma is quadratic in velocities, without drives
    if not np.any(system.joint_motion):
        assert np.max(np.abs(twice.gamma - 4.0 * here.gamma)) < 1e-9 * max(1.0, float(np.max(np.abs(here.gamma))))


def rows_with_phi(sort):
    """Which rows of a kind have a phi, by its declaration."""
    declared, (point, line, axis, moving) = DECLARED[ALL_KINDS[sort]], DECLARED[ALL_KINDS[sort]].count
    own = moving if declared.is_holonomic else moving - 2 if moving == 3 else 0
    return [True] * (point + line + axis + own) + [False] * (moving - own)


def test_the_page_on_methods_shows_each_file_as_it_is():
    """Included by name, so that text and code cannot part."""
    page = (ROOT / "docs" / "methods.md").read_text(encoding="utf-8")
    methods = {p.name for p in (ROOT / "solvers" / "plain").glob("*.py") if "def integrate" in p.read_text("utf-8")}
    assert len(methods) >= 5 and methods == set(re.findall(r'^--8<-- "solvers/plain/(\w+\.py)"$', page, re.MULTILINE))
