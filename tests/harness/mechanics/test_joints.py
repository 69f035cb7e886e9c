"""Every kind of joint and of force, on all routes: rows, their rates, accelerations, power, presentations."""

import dataclasses
import importlib.util
from functools import cache
from typing import Any

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import in_frame
from mbsbench.harness.mechanics import motion, so3, work
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.joints import Joint, JointKind
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import GROUND, Load, RigidBody, assemble
from mbsbench.harness.reference.directors import Directors
from mbsbench.harness.reference.newton_euler import NewtonEuler
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.types import Problem
from mbsbench.problems.random_mechanism import closed_joint
from mbsbench.solvers.formulations.charts import CHARTS
from mbsbench.solvers.formulations.compiled.kernel import make_kernel, start_at
from mbsbench.solvers.formulations.layout import Layout
from mbsbench.solvers.formulations.start import Accelerations, coordinates_and_velocities
from mbsbench.solvers.formulations.strong_form import StrongForm
from mbsbench.solvers.formulations.system_elements import equations_of_motion

from ...solvers.arbitrary_joints import KINDS, all_joints, one_joint
from ...solvers.arbitrary_systems import arbitrary

SYSTEM = all_joints()
STEP = 1e-5  # [s] of central differences: truncation and rounding 1e-10 of values of order 10
DIFFERENCES = 1e-6
ROUNDING = 1e-11  # a thousand operations on values of order 10
each_joint = pytest.mark.parametrize("kind", KINDS)
ends = pytest.mark.parametrize("ground", [False, True], ids=["two bodies", "ground"])


def moved(s: State, t: float) -> States:
    return States.one(State(s.r + t * s.v, s.R @ so3.exp(t * s.Omega), s.v, s.Omega))


@pytest.mark.parametrize("seed", range(3))
def test_rates_of_the_rows_are_their_derivatives(seed: int) -> None:
    """phi_dot by central differences of phi, and A v, where no constraint holds."""
    state = arbitrary(SYSTEM, seed)
    ahead, behind = (motion.constraint(SYSTEM, moved(state, t))[0] for t in (STEP, -STEP))
    phi_dot = motion.constraint_rate(SYSTEM, States.one(state))[0]
    assert np.max(np.abs((ahead - behind) / (2.0 * STEP) - phi_dot)) < DIFFERENCES
    v = np.concatenate((state.v, state.Omega), axis=1).ravel()
    assert np.max(np.abs(constraint_jacobian(SYSTEM, state) @ v - phi_dot)) < ROUNDING


@each_joint
@ends
def test_a_joint_leaves_free_what_its_rows_say(kind: JointKind, ground: bool) -> None:
    """Its rows are independent: their number is the freedoms it takes."""
    system, state = one_joint(kind, ground=ground)
    taken = {"spherical": 3, "universal": 4, "revolute": 5, "fixed": 6, "cylindrical": 4, "prismatic": 5}
    taken |= {"point on line": 2, "point on plane": 1, "normal axes": 1, "distance": 1}
    assert np.linalg.matrix_rank(constraint_jacobian(system, state).toarray()) == taken[kind] == system.nrows


@each_joint
@ends
def test_four_routes_give_one_acceleration(kind: JointKind, ground: bool) -> None:
    """Newton-Euler, natural coordinates, CasADi and the compiled kernel: with a spring-damper, two loads, gravity."""
    system, state = one_joint(kind, ground=ground)
    first, second, nb = NewtonEuler(system), Directors(system), system.nb
    rate = first.rate(first.restarted(first.start(state)))[7 * nb :]
    v_dot, Omega_dot = rate.reshape(2, nb, 3)
    z = second.restarted(second.start(state))
    z_dot = second.rate(z[None])[0].reshape(2, nb, 4, 3)[1]
    assert np.max(np.abs(z_dot[:, 0] - v_dot)) < 1e-9
    hat = so3.hat(state.Omega)
    R_ddot = state.R @ (hat @ hat + so3.hat(Omega_dot))
    assert np.max(np.abs(np.swapaxes(z_dot[:, 1:], 1, 2) - R_ddot)) < 1e-9
    problem = Problem("one joint", system, state, 1.0, 1e-3, "", "made up")
    layout = Layout(system, CHARTS["quaternion"], np.arange(system.nrows))
    u_dot, lam = Accelerations(layout).at(coordinates_and_velocities(layout, problem))
    assert np.max(np.abs(u_dot - np.concatenate((v_dot, Omega_dot), axis=1).ravel())) < 1e-9
    made = make_kernel(system, ("accelerate",))
    start_at(made.kernel, state)
    made.entry("accelerate")()
    assert np.max(np.abs(made.kernel.v_dot.ravel() - u_dot)) < 1e-9
    assert np.max(np.abs(made.kernel.lam[made.kernel.order] - lam)) < 1e-9


@cache
def layout(coordinates: str) -> Layout:
    return Layout(SYSTEM, CHARTS[coordinates], np.arange(SYSTEM.nrows))


@pytest.mark.parametrize("coordinates", CHARTS)
def test_the_symbolic_rows_are_those_of_motion(coordinates: str) -> None:
    """phi, phi_dot, M_bar, and phi_ddot by central differences, in either chart."""
    at, state = layout(coordinates), arbitrary(SYSTEM, 4)
    one = States.one(state)
    p, u = at.chart.coordinates(state)
    y = np.concatenate((p.ravel(), u.ravel(), np.zeros(at.k)))
    terms = StrongForm(at).terms(y[: at.n - at.k])
    assert np.max(np.abs(terms.phi - motion.constraint(SYSTEM, one)[0])) < ROUNDING
    assert np.max(np.abs(terms.phi_dot - motion.constraint_rate(SYSTEM, one)[0])) < ROUNDING
    assert np.max(np.abs(terms.M_bar / motion.scaling_masses(SYSTEM, one)[0] - 1.0)) < ROUNDING
    applied = motion.applied(SYSTEM, one)[0]
    c = StrongForm(at)
    weights = c.pattern.matrix(c._motion.values(y[: at.n - at.k], np.zeros(at.n_u))[c._slices[8]])
    assert np.max(np.abs(terms.f_bar - weights @ applied.ravel())) < 1e-9


@pytest.mark.parametrize("coordinates", CHARTS)
def test_the_power_of_loads_and_dampers_is_the_rate_of_energy(coordinates: str) -> None:
    """u . e = d(T + V)/dt - power at any u_dot."""
    at, state = layout(coordinates), arbitrary(SYSTEM, 5)
    motions = equations_of_motion(at, "acceleration", 0.0, 0.0, differentiable=False)
    p, u = at.chart.coordinates(state)
    y, u_dot = np.concatenate((p.ravel(), u.ravel(), np.zeros(at.k))), np.random.default_rng(1).standard_normal(at.n_u)
    out = motions.values(y, u_dot)

    def energy(t: float) -> float:
        z = y + t * np.concatenate((out[at.p], u_dot, np.zeros(at.k)))
        s = at.chart.states(z[at.p].reshape(1, SYSTEM.nb, -1), z[at.u].reshape(1, SYSTEM.nb, 6))
        return float(motion.energy(SYSTEM, s)[0])

    rate = (energy(STEP) - energy(-STEP)) / (2.0 * STEP) - work.power(SYSTEM, States.one(state))[0]
    sharp = DIFFERENCES * (1.0 + abs(rate)) / at.chart.margin(p[None])[0] ** 2
    assert y[at.u] @ out[at.u] == pytest.approx(rate, abs=sharp)


def test_a_row_of_loads_and_dampers_works_along_the_motion() -> None:
    """The work of the cubic is of fourth order in the step: halved steps leave a sixteenth."""
    system, state = one_joint(JointKind.FIXED, ground=False)
    t = np.linspace(0.0, 1.0, 1601)
    turn = np.stack((np.sin(2.0 * t), t**2, np.cos(3.0 * t)), axis=-1)[:, None] * np.array([[1.0], [0.5]])
    rate = np.stack((2.0 * np.cos(2.0 * t), 2.0 * t, -3.0 * np.sin(3.0 * t)), axis=-1)[:, None] * np.array(
        [[1.0], [0.5]]
    )
    s = States(turn + state.r, so3.exp(turn) @ np.eye(3), rate, so3.angular_velocity(turn, rate))

    def along(k: int) -> float:
        return float(np.sum(work.work_along_cubics(system, s.at(slice(None, None, k)), np.diff(t[::k]))))

    exact = along(1)
    off = [abs(along(k) - exact) for k in (160, 80)]
    assert np.log2(off[0] / off[1]) == pytest.approx(4.0, abs=0.4)
    power = work.power(system, s)
    simpson = np.sum(power[:-2:2] + 4.0 * power[1:-1:2] + power[2::2]) * t[1] / 3.0
    assert exact == pytest.approx(simpson, abs=1e-9)


@pytest.mark.parametrize(
    "given", [{"mirror": "X"}, {"renumber": 3}, {"duplicate": 2}, {"unit_length": 100.0, "unit_time": 7.0}]
)
def test_a_presentation_changes_no_acceleration(given: dict) -> None:
    """Joints, springs and loads are presented with the bodies."""
    asked = Presentation(**given)
    state = arbitrary(SYSTEM, 6)
    shown, there = asked.system(SYSTEM), asked.state(SYSTEM, state)
    E, P = motion.energy(SYSTEM, States.one(state))[0], work.power(SYSTEM, States.one(state))[0]
    unit = asked.force * asked.unit_length
    assert motion.energy(shown, States.one(there))[0] == pytest.approx(E * unit, rel=1e-12)
    assert work.power(shown, States.one(there))[0] == pytest.approx(P * unit / asked.unit_time, rel=1e-12)
    sizes = [
        np.linalg.norm(motion.constraint_energy_norm(s, States.one(x))) for s, x in ((SYSTEM, state), (shown, there))
    ]
    if not {"duplicate", "unit_length"} & set(given):  # a mixes metres and numbers: its c depends on the units
        assert sizes[1] == pytest.approx(sizes[0], rel=1e-11)


def test_a_turned_frame_turns_loads() -> None:
    """T + V and the power stay when everything is turned."""
    state = arbitrary(SYSTEM, 7)
    p = Problem("all joints", SYSTEM, state, 1.0, 1e-3, "", "made up")
    q = in_frame(p, so3.exp(np.array([0.3, -0.2, 0.5])))
    for of in (motion.energy, work.power):
        assert of(q.system, States.one(q.initial))[0] == pytest.approx(of(SYSTEM, States.one(state))[0], rel=1e-12)
    assert motion.constraint(q.system, States.one(q.initial))[0] @ np.ones(SYSTEM.nrows) != 0.0


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        (Joint(0, (0, 0, 0), kind="hinge"), "kind must be one of"),
        (Joint(0, (0, 0, 0), kind="distance"), "length must be finite and > 0 m"),
        (Joint(0, (0, 0, 0), kind="prismatic", axis_i=(1, 0, 0), axis_j=(1, 0, 0)), "needs across_i and across_j"),
        (Joint(0, (0, 0, 0), kind="point on plane"), "needs axis_j"),
        (Joint(0, (0, 0, 0), kind="cylindrical", axis_j=(1, 0, 0)), "give the axis in both bodies"),
        (Joint(0, (0, 0, 0), kind="spherical", axis_i=(1, 0, 0), axis_j=(1, 0, 0)), "has no axis"),
        (Joint(0, (0, 0, 0), kind="distance", length=1.0, rows=(0,)), "cannot be chosen"),
        (Joint(0, (0, 0, 0), kind="distance", length=1.0, rows=1), "cannot be chosen"),
    ],
)  # fmt: skip
def test_an_incomplete_joint_is_refused(joint: Joint, said: str) -> None:
    """In one line, with what was expected."""
    with pytest.raises(ValueError, match=said):
        assemble([RigidBody(1.0, np.eye(3))], [joint])


@pytest.mark.parametrize("rows", [(0, 3), (-1,), (0, 0), (), 1, (1.0,), (True,), "01", ((0,),), np.array([0.0])])
def test_rows_that_are_none_are_refused(rows: Any) -> None:
    """By the number of the joint as it was given, also behind one that was taken apart."""
    first = Joint(0, (0, 0, 0), rows=(0, 1))
    with pytest.raises(ValueError, match=r"joint 1: rows must be distinct whole numbers from 0 to 2 \(got "):
        assemble([RigidBody(1.0, np.eye(3))], [first, dataclasses.replace(first, rows=rows)])


def test_joints_behind_chosen_rows_keep_their_numbers() -> None:
    """In names and in errors."""
    body, first = [RigidBody(1.0, np.eye(3))], Joint(0, (0, 0, 0), rows=np.array([2, 0]))
    names = assemble(body, [first, Joint(0, (0.1, 0, 0))]).joint_names
    assert names == ("joint 1, row 2", "joint 1, row 0", "joint 2")
    with pytest.raises(ValueError, match="joint 1: length must be"):
        assemble(body, [first, Joint(0, (0, 0, 0), kind="distance")])
    with pytest.raises(ValueError, match="part 1: expected body i"):
        assemble(body, [first, Joint(3, (0, 0, 0))])


@pytest.mark.parametrize("kind", [k for k in KINDS if k != JointKind.DISTANCE])
def test_all_rows_of_a_joint_one_by_one_are_the_joint(kind: JointKind) -> None:
    """One space of A: the same motion. Point rows are along the axes of j there, along those of space in the joint."""
    bodies, random = [RigidBody(1.0, np.eye(3))] * 2, np.random.default_rng(5)
    r, R = random.standard_normal((2, 3)), so3.exp(random.standard_normal((2, 3)))
    joint = closed_joint(kind, 0, 1, (r, R), random)
    v = random.standard_normal((2, 2, 3))
    state = State(r, R, v[0], v[1])
    whole = assemble(bodies, [joint])
    single = assemble(bodies, [dataclasses.replace(joint, rows=range(whole.nrows))])
    assert np.max(np.abs(motion.constraint(single, States.one(state)))) < ROUNDING
    A, B = (constraint_jacobian(s, state).toarray() for s in (whole, single))
    ranks = [np.linalg.matrix_rank(rows, tol=1e-9) for rows in (A, B, np.concatenate((A, B)))]
    assert ranks == [len(A)] * 3
    if whole.nrows > 1:
        fewer = assemble(bodies, [dataclasses.replace(joint, rows=range(1, whole.nrows))])
        assert np.array_equal(constraint_jacobian(fewer, state).toarray(), B[1:])


def drawing() -> Any:
    found = importlib.util.spec_from_file_location("draw_joints", ROOT / "docs" / "draw_joints.py")
    assert found is not None and found.loader is not None
    made = importlib.util.module_from_spec(found)
    found.loader.exec_module(made)
    return made


def test_pictures_are_those_of_the_rows() -> None:
    """As ``make joints`` draws them: an arrow for each freedom."""
    draws = drawing()
    for kind in draws.drawn():
        drawn = draws.picture(kind)
        assert drawn.count('stroke-width="2"') == 6 - sum(kind.count)
        assert (ROOT / "docs" / "images" / "joints" / draws.name(kind)).read_text(encoding="utf-8") == drawn


def test_the_tables_of_the_manual_are_those_of_the_declarations() -> None:
    """As ``make joints`` writes them."""
    text = (ROOT / "docs" / "joints-and-forces.md").read_text(encoding="utf-8")
    assert drawing().page(text) == text


def test_a_load_on_the_ground_is_refused() -> None:
    """It would move nothing."""
    with pytest.raises(ValueError, match="load 0: expected a body in 0"):
        assemble([RigidBody(1.0, np.eye(3))], loads=[Load(GROUND)])
