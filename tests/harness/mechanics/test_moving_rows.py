"""Drives, knife edges, rolling discs and timed loads: rows, rates, accelerations and power on all routes."""

from functools import cache

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import in_frame
from mbsbench.harness.mechanics import motion, so3, time_functions, work
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.dynamics import accelerations
from mbsbench.harness.mechanics.dynamics import moved as along
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.joints import DECLARED, Joint, MovingKind
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import MultibodySystem, RigidBody, assemble
from mbsbench.harness.mechanics.time_functions import TimeFunction
from mbsbench.harness.types import Problem
from mbsbench.solvers.formulations.charts import CHARTS
from mbsbench.solvers.formulations.compiled.kernel import make_kernel, start_at
from mbsbench.solvers.formulations.layout import Layout
from mbsbench.solvers.formulations.start import Accelerations, coordinates_and_velocities
from mbsbench.solvers.formulations.strong_form import RowTerms, StrongForm

from ...solvers.arbitrary_joints import MOVING, SWAY, moving_rows
from ...solvers.arbitrary_systems import arbitrary

STEP = 1e-5  # [s] of central differences
DIFFERENCES = 1e-6
ROUNDING = 1e-11
ALL = moving_rows(None)
each_kind = pytest.mark.parametrize("kind", MOVING)
ends = pytest.mark.parametrize("ground", [False, True], ids=["two bodies", "ground"])


def at_time(s: State, t: float) -> State:
    return State(s.r, s.R, s.v, s.Omega, t)


def moved(s: State, t: float) -> States:
    return States.one(State(s.r + t * s.v, s.R @ so3.exp(t * s.Omega), s.v, s.Omega, s.t + t))


@cache
def consistent(kind: str | None, *, ground: bool = False) -> tuple[MultibodySystem, State]:
    system = moving_rows(kind, ground=ground)
    return system, project(system, at_time(arbitrary(system, 4), 0.3), 200)


def test_a_function_of_time_has_its_derivatives_and_its_integral() -> None:
    """By central differences; the integral of a speed is the position of a drive."""
    numbers, t = SWAY.numbers()[None], np.array([0.1, 0.7])
    _, f_dot, f_ddot = time_functions.values(numbers, t)
    ahead, behind = (time_functions.values(numbers, t + h) for h in (STEP, -STEP))
    assert np.max(np.abs((ahead[0] - behind[0]) / (2 * STEP) - f_dot)) < 1e-8
    assert np.max(np.abs((ahead[1] - behind[1]) / (2 * STEP) - f_ddot)) < 1e-8
    speed = TimeFunction((1.0, 2.0, 3.0), 0.5, 2.0, 0.4)
    for rate in (speed, TimeFunction((1.0,), 0.5, 0.0, 0.4)):
        whole = rate.integral(0.25).numbers()[None]
        assert time_functions.values(whole, np.zeros(1))[0] == pytest.approx(0.25, abs=1e-15)
        assert time_functions.values(whole, t)[1] == pytest.approx(time_functions.values(rate.numbers()[None], t)[0])


@pytest.mark.parametrize("seed", range(3))
def test_rates_of_the_rows_are_their_derivatives(seed: int) -> None:
    """phi_dot by central differences of phi where there is one, and A v + phi_t, where no constraint holds."""
    state = at_time(arbitrary(ALL, seed), 0.4)
    ahead, behind = (motion.constraint(ALL, moved(state, t))[0] for t in (STEP, -STEP))
    phi_dot = motion.constraint_rate(ALL, States.one(state))[0]
    rows = ALL.moving_rows()
    edge, disc = (rows.row[rows.kind.index(kind)] for kind in (MovingKind.KNIFE_EDGE, MovingKind.ROLLING))
    without = [edge, disc + 1, disc + 2]
    has = np.setdiff1d(np.arange(ALL.nrows), without)
    assert np.max(np.abs((ahead - behind) / (2.0 * STEP) - phi_dot)[has]) < DIFFERENCES
    assert np.all(motion.constraint(ALL, States.one(state))[0][without] == 0.0)
    v = np.concatenate((state.v, state.Omega), axis=1).ravel()
    still = State(state.r, state.R, 0 * state.v, 0 * state.Omega, state.t)
    phi_t = motion.constraint_rate(ALL, States.one(still))[0]
    assert np.max(np.abs(phi_t)) > 0.1
    assert np.max(np.abs(constraint_jacobian(ALL, state) @ v + phi_t - phi_dot)) < ROUNDING


def test_what_the_rows_of_velocities_forbid_is_what_their_names_say() -> None:
    """The disc's lowest material point rests; the knife's point moves along the blade."""
    system, s = consistent(MovingKind.ROLLING, ground=True)
    axis, n, centre = s.R[0] @ system.joint_u[0], system.joint_n[0, 0], s.r[0] + s.R[0] @ system.joint_s_i[0]
    down = n - (n @ axis) * axis
    lowest = centre - 0.4 * down / np.linalg.norm(down)
    assert (lowest - system.joint_s_j[0]) @ n == pytest.approx(0.0, abs=1e-12)
    assert s.v[0] + np.cross(s.R[0] @ s.Omega[0], lowest - s.r[0]) == pytest.approx(np.zeros(3), abs=1e-11)
    system, s = consistent(MovingKind.KNIFE_EDGE, ground=True)
    across = motion.point_velocity(States.one(s), 0, system.joint_s_i[0])[0] @ s.R[0] @ system.joint_u[0]
    assert across == pytest.approx(time_functions.values(SWAY.numbers()[None], np.array([0.3]))[0][0, 0], abs=1e-11)


@ends
def test_a_driven_distance_is_that_of_the_points(ground: bool) -> None:
    """|d| = L(t) and its rate L'(t); the row pulls each body along d, at its own point."""
    system, s = consistent(MovingKind.DRIVEN_DISTANCE, ground=ground)
    one, (a, b) = States.one(s), ((0, system.joint_s_i[0]), (-1 if ground else 1, system.joint_s_j[0]))
    d, d_dot = (of(one, *a)[0] - of(one, *b)[0] for of in (motion.point_position, motion.point_velocity))
    L, L_dot, _ = (a[0, 0] for a in time_functions.values(SWAY.numbers()[None], np.array([0.3])))
    assert (np.linalg.norm(d), d @ d_dot / L) == pytest.approx((L, L_dot), abs=1e-11)
    A = constraint_jacobian(system, s).toarray()[0].reshape(-1, 6)
    for (body, arm), sign in ((a, 1.0), (b, -1.0))[: system.nb]:
        assert A[body, :3] == pytest.approx(sign * d / L, abs=1e-12)
        assert A[body, 3:] == pytest.approx(np.cross(arm, s.R[body].T @ A[body, :3]), abs=1e-12)


@each_kind
@ends
def test_the_power_of_drives_is_the_rate_of_energy(kind: str, ground: bool) -> None:
    """d(T + V)/dt along the motion of index 1, with the powers of drives, timed loads and a damper."""
    system, s = consistent(kind, ground=ground)
    rates = accelerations(system, s)
    ahead, behind = (motion.energy(system, States.one(along(s, rates, h)))[0] for h in (STEP, -STEP))
    power = work.power(system, States.one(s))[0]
    assert (ahead - behind) / (2.0 * STEP) == pytest.approx(power, rel=1e-6)
    if DECLARED[kind].motion:
        assert abs(work.drive_power(system, States.one(s))[0]) > 1e-2 * abs(power)


def test_the_power_of_a_motion_that_is_lost_is_not_a_number() -> None:
    """And that of the instants before stays."""
    system, s = consistent(MovingKind.DRIVEN_ANGLE)
    lost = State(s.r * np.nan, s.R, s.v, s.Omega, s.t)
    both = States(*(np.stack((getattr(s, n), getattr(lost, n))) for n in ("r", "R", "v", "Omega", "t")))
    power = work.drive_power(system, both)
    assert power[0] == work.drive_power(system, States.one(s))[0]
    assert np.isnan(power[1])


@each_kind
def test_rows_stay_satisfied_along_the_accelerations(kind: str) -> None:
    """phi_ddot = 0: phi_dot after a step of h is of the order of h^2."""
    system, s = consistent(kind)
    rates = accelerations(system, s)
    off = [np.max(np.abs(motion.constraint_rate(system, States.one(along(s, rates, h))))) for h in (2e-4, 1e-4)]
    assert np.log2(off[0] / off[1]) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("coordinates", CHARTS)
def test_the_symbolic_rows_are_those_of_motion(coordinates: str) -> None:
    """phi, phi_dot, A and M_bar in either chart, where no constraint holds; the rate of M_bar by differences."""
    at, state = Layout(ALL, CHARTS[coordinates], np.arange(ALL.nrows)), at_time(arbitrary(ALL, 4), 0.4)
    one, form = States.one(state), StrongForm(at)

    def terms(s: State) -> RowTerms:
        p, u = at.chart.coordinates(s)
        return form.terms(np.concatenate((p.ravel(), u.ravel())), s.t)

    here = terms(state)
    assert np.max(np.abs(here.phi - motion.constraint(ALL, one)[0])) < ROUNDING
    assert np.max(np.abs(here.phi_dot - motion.constraint_rate(ALL, one)[0])) < ROUNDING
    assert np.max(np.abs(here.M_bar / motion.scaling_masses(ALL, one)[0] - 1.0)) < ROUNDING
    ahead, behind = (terms(moved(state, h)[0]).M_bar for h in (STEP, -STEP))
    largest = np.max(np.abs(here.M_bar_dot))
    assert np.max(np.abs((ahead - behind) / (2.0 * STEP) - here.M_bar_dot)) < DIFFERENCES * largest


@each_kind
@ends
def test_three_routes_give_one_acceleration(kind: str, ground: bool) -> None:
    """NumPy by differences, CasADi, and the compiled kernel: with timed loads, a spring-damper and gravity."""
    system, s = consistent(kind, ground=ground)
    first = accelerations(system, s)
    expected = np.concatenate((first.v_dot, first.Omega_dot), axis=1)
    layout = Layout(system, CHARTS["quaternion"], np.arange(system.nrows))
    problem = Problem("moving rows", system, s, 1.0, 1e-3, "", "made up")
    u_dot, lam = Accelerations(layout).at(coordinates_and_velocities(layout, problem), s.t)
    assert u_dot == pytest.approx(expected.ravel(), abs=1e-8)
    assert lam == pytest.approx(first.reaction, abs=1e-8)
    made = make_kernel(system)
    start_at(made.kernel, s)
    made.entry("accelerate")()
    assert made.kernel.v_dot == pytest.approx(u_dot.reshape(-1, 6), abs=1e-9)
    assert made.kernel.lam[made.kernel.order] == pytest.approx(lam, abs=1e-9)


@pytest.mark.parametrize("given", [{"mirror": "X"}, {"renumber": 3}, {"unit_length": 100.0, "unit_time": 7.0}])
def test_a_presentation_changes_no_power(given: dict) -> None:
    """Functions of time are presented with the rest, in the presented units of time."""
    asked = Presentation(**given)
    system, state = consistent(None)
    shown, there = asked.system(system), asked.state(system, state)
    unit = asked.force * asked.speed
    P = work.power(system, States.one(state))[0]
    assert work.power(shown, States.one(there))[0] == pytest.approx(P * unit, rel=1e-9)
    assert np.max(np.abs(motion.constraint_rate(shown, States.one(there)))) < 1e-10 * max(asked.speed, 1.0)
    back = asked.states_back(system, States.one(there))
    assert back.times[0] == pytest.approx(state.t)


def test_a_turned_frame_turns_drives_and_torsion() -> None:
    """Power, T + V and phi_dot stay when everything is turned."""
    system, state = consistent(None)
    p = Problem("moving rows", system, state, 1.0, 1e-3, "", "made up")
    q = in_frame(p, so3.exp(np.array([0.3, -0.2, 0.5])))
    for of in (motion.energy, work.power):
        assert of(q.system, States.one(q.initial))[0] == pytest.approx(of(system, States.one(state))[0], rel=1e-9)
    assert np.max(np.abs(motion.constraint_rate(q.system, States.one(q.initial)))) < 1e-10


@pytest.mark.parametrize(
    ("joint", "said"),
    [
        (Joint(0, (0, 0, 0), kind="driven position", axis_j=(1, 0, 0)), "needs a motion"),
        (Joint(0, (0, 0, 0), kind="spherical", motion=TimeFunction()), "takes no motion"),
        (Joint(0, (0, 0, 0), kind="driven distance"), "needs a motion"),
        (Joint(0, (0, 0, 0), axis_j=(1, 0, 0), kind="driven distance", motion=TimeFunction((1,))), "has no axis"),
        (Joint(0, (0, 0, 0), kind="knife edge"), "needs axis_i"),
        (Joint(0, (0, 0, 0), kind="rolling disc", axis_i=(1, 0, 0), axis_j=(0, 0, 1)), "length must be finite and > 0"),
        (Joint(0, (0, 0, 0), kind="driven position", axis_j=(1, 0, 0), motion=TimeFunction((1, 2, 3, 4, 5))), "up to"),
    ],
)  # fmt: skip
def test_an_incomplete_row_is_refused(joint: Joint, said: str) -> None:
    """In one line, with what was expected."""
    with pytest.raises(ValueError, match=said):
        assemble([RigidBody(1.0, np.eye(3))], [joint])
