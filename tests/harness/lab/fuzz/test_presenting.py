"""Every form of a mechanism is the same mechanism: its matter has the same accelerations and the same energy."""

import importlib.util
from dataclasses import replace
from functools import cache
from itertools import islice

import numpy as np
import pytest

from mbsbench import JointKind, MultibodySystem, Problem, State, States, make_problem
from mbsbench.harness.catalogue.registry import rotate_problem
from mbsbench.harness.lab.fuzz.cases import format_mjcf
from mbsbench.harness.lab.fuzz.drawing import draw_mechanism
from mbsbench.harness.lab.fuzz.mechanism import RandomMechanism
from mbsbench.harness.lab.fuzz.presenting import Form, _SplitBody
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.consistency import check_start
from mbsbench.harness.mechanics.dynamics import RANK, Rates, accelerations, equations
from mbsbench.harness.mechanics.motion import energy, kinetic_energy
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.state import rotate_states
from mbsbench.tests.comparing import assert_each, assert_same

KNOWN = 1000.0  # largest condition of the equations
TURN = (0.3, -0.5, 0.7)
UNITS = Presentation(unit_length=1000.0, unit_mass=0.1, unit_time=10.0)
FORMS = [
    Form(rotation=TURN),
    Form(split=1),
    Form(split=1, weld="pinned"),
    Form(plain=UNITS),
    Form(plain=Presentation(mirror="Y", renumber=5)),
    Form(2, "fixed", TURN, Presentation("Z", 1, 7, 0.1, 10.0, 0.1)),
]


@cache
def mechanisms() -> tuple[RandomMechanism, ...]:
    """Ten of two bodies and more whose accelerations are known to twelve digits."""
    drawn = (m for m in (draw_mechanism(3, k) for k in range(200)) if len(m.bodies) > 1 and m.connections)
    return tuple(islice((m for m in drawn if condition(m.problem()) < KNOWN), 10))


def condition(problem: Problem) -> float:
    """By which accelerations amplify rounding: of an inertia, and of the rows of length one in x of ``in_masses``."""
    s, e = problem.system, equations(problem.system, problem.initial)
    rows = np.stack([in_masses(s, np.linalg.solve(e.M, row.reshape(-1, 6, 1))) for row in e.A])
    values = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None], compute_uv=False)
    inertia = max(np.linalg.cond(J) for J in s.regular_inertia)
    return float(max(inertia, values[0] / values[values > RANK * values[0]].min()))


def in_masses(system: MultibodySystem, rates: np.ndarray) -> np.ndarray:
    """x = L^T a with L L^T = M, where accelerations of all bodies and axes have one unit."""
    v, Omega = np.hsplit(rates.reshape(-1, 6), 2)
    L = np.linalg.cholesky(system.regular_inertia)
    return np.hstack((np.sqrt(system.mass)[:, None] * v, np.einsum("bji,bj->bi", L, Omega))).ravel()


def rounding(problem: Problem, rates: Rates) -> float:
    """A bound of the error of x: n roundings, amplified, of what the solution is the sum of.

    That are the free accelerations, the sought ones, and terms in Omega^2, which may cancel in f and A_dot v.
    """
    s, start = problem.system, problem.initial
    e = equations(s, start)
    free = np.linalg.solve(e.M, e.f[:, :, None])
    terms = [np.linalg.norm(in_masses(s, a)) for a in (free, np.hstack((rates.v_dot, rates.Omega_dot)))]
    turning = np.linalg.norm(start.Omega, axis=1).max() * np.sqrt(2.0 * kinetic_energy(s, States.one(start))[0])
    return float(6 * s.nb * np.finfo(float).eps * condition(problem) * (sum(terms) + turning))


def accelerations_in(form: Form, problem: Problem, rates: Rates) -> State:
    """Accelerations of all matter in a form, in the place of velocities."""
    s, start = problem.system, problem.initial
    out = State(start.r, start.R, rates.v_dot, rates.Omega_dot)
    if form.split:
        b, parts = form.split - 1, _SplitBody(s, form.split - 1)
        out, Omega = parts.split_state(out), start.Omega[b]
        v = out.v.copy()
        for k, arm in zip((b, s.nb), parts.offsets, strict=True):
            v[k] += start.R[b] @ np.cross(Omega, np.cross(Omega, arm))
        out = replace(out, v=v)
    turned = rotate_states(States.one(out), so3.exp(np.array(form.rotation)))[0]
    seen = form.plain.state(replace(form, plain=Presentation()).present_problem(problem).system, turned)
    return replace(seen, v=seen.v / form.plain.unit_time, Omega=seen.Omega / form.plain.unit_time)


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_forms_keep_accelerations_and_energy(form):
    """Newton's laws know no numbers, units or frames, and a weld does not move."""
    for m in mechanisms():
        problem = m.problem()
        seen, plain = form.present_problem(problem), form.plain
        check_start(seen.system, seen.initial)
        ours, theirs = accelerations(problem.system, problem.initial), accelerations(seen.system, seen.initial)
        expected = accelerations_in(form, problem, ours)
        apart = np.hstack((expected.v - theirs.v_dot, expected.Omega - theirs.Omega_dot))
        assert np.linalg.norm(in_masses(seen.system, apart)) < rounding(seen, theirs)
        joule = plain.unit_mass * (plain.unit_length / plain.unit_time) ** 2
        for law in (kinetic_energy, energy):
            mine, other = (float(law(p.system, States.one(p.initial))[0]) for p in (problem, seen))
            lift = float(problem.system.mass @ np.linalg.norm(problem.initial.r, axis=1)) * 9.81
            assert abs(other / joule - mine) < 1e-12 * (abs(mine) + lift + 1.0)


def test_a_split_body_is_two_bodies_that_can_exist():
    """Second moments of both parts stay positive."""
    for m in mechanisms():
        s = Form(split=1).present_problem(m.problem()).system
        for J in (s.inertia[0], s.inertia[-1]):
            assert_each(np.linalg.eigvalsh(0.5 * np.trace(J) * np.eye(3) - J), ">", 0.0)
        assert s.joint_kind(s.nj - 1) == JointKind.FIXED
        assert s.mass[0] + s.mass[-1] == pytest.approx(m.bodies[0].mass, rel=1e-15)


@pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None, reason="mujoco reads MJCF: pip install mbsbench[mujoco]"
)
def test_mjcf_is_the_same_mechanism(tmp_path):
    """MuJoCo's compiler makes of the file a system with the same energy and accelerations."""
    for k, m in enumerate(mechanisms()):
        problem = m.problem()
        if not problem.system.is_pinned:
            continue
        path = tmp_path / f"m{k}.xml"
        path.write_text(format_mjcf(problem))
        read = make_problem(str(path), {"keyframe": "start"})
        order = [int(name.split()[1]) - 1 for name in read.system.body_names]
        ours, theirs = (accelerations(p.system, p.initial) for p in (problem, read))
        scale = 1.0 + np.abs(ours.v_dot).max()
        assert np.max(np.abs(ours.v_dot[order] - theirs.v_dot)) < 1e-10 * scale


def test_turning_is_that_of_the_catalogue():
    """``rotation`` of a problem and of a form are one thing."""
    problem = mechanisms()[0].problem()
    turned = rotate_problem(problem, so3.exp(np.array(TURN)))
    assert_same(Form(rotation=TURN).present_problem(problem).initial.r, turned.initial.r)
