"""Every kind of joint, drive and force on all routes: rows, their rates, accelerations, power, presentations."""

from functools import cache

import numpy as np
import pytest

from mbsbench import MultibodySystem, Problem, State, States, TimeFunction, constraint_jacobian
from mbsbench.harness.catalogue.registry import rotate_problem
from mbsbench.harness.mechanics import motion, so3, time_functions, work
from mbsbench.harness.mechanics.dynamics import accelerations
from mbsbench.harness.mechanics.dynamics import advance as along
from mbsbench.harness.mechanics.joints import DECLARED, JointKind, MovingKind
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.reference.directors import Directors
from mbsbench.harness.reference.newton_euler import NewtonEuler
from mbsbench.solvers.formulations.charts import CHARTS
from mbsbench.solvers.formulations.compiled.kernel import make_kernel, set_state
from mbsbench.solvers.formulations.layout import Layout
from mbsbench.solvers.formulations.start import Accelerations, pack_start
from mbsbench.solvers.formulations.strong_form import RowTerms, StrongForm
from mbsbench.solvers.formulations.system_elements import assemble_equations
from mbsbench.tests.comparing import assert_close, assert_each
from mbsbench.tests.covering import diagonal, few

from ...solvers.arbitrary_joints import KINDS, MOVING, SWAY, all_joints, moving_rows, one_joint
from ...solvers.arbitrary_systems import arbitrary, linkage, settle, with_user_forces

STEP = 1e-5  # [s] of central differences: truncation and rounding 1e-10 of values of order 10
DIFFERENCES = 1e-6
ROUNDING = 1e-11  # a thousand operations on values of order 10
SYSTEMS = {
    "joints": all_joints(),
    "moving rows": moving_rows(None),
    "linkage": linkage(springs=True),
    "user forces": with_user_forces(),
}
TAKEN = {"spherical": 3, "universal": 4, "revolute": 5, "fixed": 6, "cylindrical": 4, "prismatic": 5,
         "point on line": 2, "point on plane": 1, "normal axes": 1, "distance": 1}  # fmt: skip
each_system = pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)
each_chart = pytest.mark.parametrize("coordinates", CHARTS)
ends = pytest.mark.parametrize("ground", [False, True], ids=["two bodies", "ground"])


def test_numbers_of_kinds_are_taken_once_and_leave_no_gap() -> None:
    """Systems and kept files name a kind by its place among the numbers."""
    assert [kind.number for kind in DECLARED.values()] == list(range(len(DECLARED)))


def timed(system: MultibodySystem, seed: int, t: float = 0.4) -> State:
    s = arbitrary(system, seed)
    return State(s.r, s.R, s.v, s.Omega, t)


def moved(s: State, h: float) -> States:
    return States.one(State(s.r + h * s.v, s.R @ so3.exp(h * s.Omega), s.v, s.Omega, s.t + h))


@cache
def consistent(kind: str | None, *, ground: bool = False) -> tuple[MultibodySystem, State]:
    """Two bodies, or one and the ground, with one kind of rows; all moving rows without a kind."""
    if kind in KINDS:
        return one_joint(kind, ground=ground)
    system = moving_rows(kind, ground=ground)
    return system, settle(system, timed(system, 4, 0.3))


@pytest.mark.parametrize("seed", range(3))
@each_system
def test_rates_of_the_rows_are_their_derivatives(system, seed) -> None:
    """phi_dot by central differences of phi where there is one, and A v + phi_t, where no constraint holds."""
    state = timed(system, seed)
    ahead, behind = (motion.constraint(system, moved(state, h))[0] for h in (STEP, -STEP))
    phi_dot = motion.constraint_rate(system, States.one(state))[0]
    rows = system.moving_rows()
    start = {kind: rows.row[rows.kind.index(kind)] for kind in MovingKind if kind in rows.kind}
    without = (
        [start[MovingKind.KNIFE_EDGE], start[MovingKind.ROLLING] + 1, start[MovingKind.ROLLING] + 2] if start else []
    )
    has = np.setdiff1d(np.arange(system.nrows), without)
    assert np.max(np.abs((ahead - behind) / (2.0 * STEP) - phi_dot)[has]) < DIFFERENCES
    assert_each(motion.constraint(system, States.one(state))[0][without], "==", 0.0)
    v = np.concatenate((state.v, state.Omega), axis=1).ravel()
    still = State(state.r, state.R, 0 * state.v, 0 * state.Omega, state.t)
    phi_t = motion.constraint_rate(system, States.one(still))[0]
    assert (np.max(np.abs(phi_t)) > 0.1) == bool(start)
    assert np.max(np.abs(constraint_jacobian(system, state) @ v + phi_t - phi_dot)) < ROUNDING


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("kind", "ground"), diagonal([*KINDS, *MOVING], [False, True]))
def test_all_routes_give_one_acceleration(kind, ground) -> None:
    """NumPy, CasADi and the compiled kernel, with springs, dampers, loads and gravity.

    Also Newton-Euler and natural coordinates, the routes of the reference; rows of joints at rest are independent.
    """
    system, s = consistent(kind, ground=ground)
    first, nb = accelerations(system, s), system.nb
    expected = np.concatenate((first.v_dot, first.Omega_dot), axis=1)
    layout = Layout(system, CHARTS["quaternion"], np.arange(system.nrows))
    problem = Problem("one kind", system, s, 1.0, 1e-3, "", "made up")
    u_dot, lam = Accelerations(layout).compute_accelerations(pack_start(layout, problem), s.t)
    assert u_dot == pytest.approx(expected.ravel(), abs=1e-8)
    assert lam == pytest.approx(first.reaction, abs=1e-8)
    k = make_kernel(system, ("accelerate",))
    set_state(k, s)
    k.accelerate.run()
    assert k.v_dot == pytest.approx(u_dot.reshape(-1, 6), abs=1e-9)
    assert k.lam[k.order] == pytest.approx(lam, abs=1e-9)
    if kind in KINDS:
        assert np.linalg.matrix_rank(constraint_jacobian(system, s).toarray()) == TAKEN[kind] == system.nrows
    one, two = NewtonEuler(system), Directors(system)
    v_dot, Omega_dot = one.rate(one.project_state(one.pack_state(s)))[7 * nb : -1].reshape(2, nb, 3)
    assert np.concatenate((v_dot, Omega_dot), axis=1).ravel() == pytest.approx(u_dot, abs=1e-9)
    z_ddot = two.rate(two.project_state(two.pack_state(s))[None])[0, :-1].reshape(2, nb, 4, 3)[1]
    hat = so3.hat(s.Omega)
    assert np.max(np.abs(z_ddot[:, 0] - v_dot)) < 1e-9
    assert np.max(np.abs(np.swapaxes(z_ddot[:, 1:], 1, 2) - s.R @ (hat @ hat + so3.hat(Omega_dot)))) < 1e-9


@cache
def layout_of(name: str, coordinates: str) -> tuple[Layout, StrongForm]:
    system = SYSTEMS[name]
    at = Layout(system, CHARTS[coordinates], np.arange(system.nrows))
    return at, StrongForm(at)


@pytest.mark.parametrize("name", ["joints", "moving rows", "linkage"])
@each_chart
def test_the_symbolic_rows_are_those_of_motion(name, coordinates) -> None:
    """phi, phi_dot, A, M_bar and f_bar in either chart, where no constraint holds; the rate of M_bar by differences."""
    system, (at, form) = SYSTEMS[name], layout_of(name, coordinates)
    state = timed(system, 4)
    one = States.one(state)

    def unknowns(s: State) -> np.ndarray:
        return np.concatenate([part.ravel() for part in at.chart.coordinates(s)])

    def terms(s: State) -> RowTerms:
        return form.terms(unknowns(s), s.t)

    here = terms(state)
    assert np.max(np.abs(here.phi - motion.constraint(system, one)[0])) < ROUNDING
    assert np.max(np.abs(here.phi_dot - motion.constraint_rate(system, one)[0])) < ROUNDING
    assert np.max(np.abs(here.M_bar / motion.evaluate_scaling_masses(system, one)[0] - 1.0)) < ROUNDING
    B = np.zeros((at.n_u, at.n_u))
    for b, T in enumerate(at.chart.rotation_rates(unknowns(state)[at.p].reshape(system.nb, -1))):
        B[6 * b : 6 * b + 3, 6 * b : 6 * b + 3], B[6 * b + 3 : 6 * b + 6, 6 * b + 3 : 6 * b + 6] = np.eye(3), T
    A = constraint_jacobian(system, state).toarray() @ B
    assert np.max(np.abs(form.pattern.make_matrix(here.A).toarray() - A)) < ROUNDING
    ahead, behind = (terms(moved(state, h)[0]).M_bar for h in (STEP, -STEP))
    largest = np.max(np.abs(here.M_bar_dot))
    assert np.max(np.abs((ahead - behind) / (2.0 * STEP) - here.M_bar_dot)) < DIFFERENCES * largest
    if name == "joints":
        weights = form.pattern.make_matrix(form._motion.values(unknowns(state), np.zeros(at.n_u))[form._slices[8]])
        assert np.max(np.abs(here.f_bar - weights @ motion.applied_loads(system, one)[0].ravel())) < 1e-9


@pytest.mark.parametrize("name", ["joints", "linkage", "user forces"])
@each_chart
def test_the_power_of_the_unbalanced_load_is_the_rate_of_energy(name, coordinates) -> None:
    """u . e = d(T + V)/dt - power at any u_dot: Newton, gravity, springs, dampers, loads and laws at once."""
    system, at = SYSTEMS[name], layout_of(name, coordinates)[0]
    motions = assemble_equations(at, "acceleration", 0.0, 0.0, differentiable=False)
    for seed in range(3):
        state = arbitrary(system, seed)
        p, u = at.chart.coordinates(state)
        y, u_dot = np.concatenate((p.ravel(), u.ravel(), np.zeros(at.k))), np.cos(seed + np.arange(at.n_u))
        out = motions.values(y, u_dot)

        def energy(h: float, y: np.ndarray = y, p_dot: np.ndarray = out[at.p], u_dot: np.ndarray = u_dot) -> float:
            z = y + h * np.concatenate((p_dot, u_dot, np.zeros(at.k)))
            s = at.chart.states(z[at.p].reshape(1, system.nb, -1), z[at.u].reshape(1, system.nb, 6))
            return float(motion.energy(system, s)[0])

        rate = (energy(STEP) - energy(-STEP)) / (2.0 * STEP) - work.compute_power(system, States.one(state))[0]
        sharp = DIFFERENCES * (1.0 + abs(rate)) / at.chart.margin(p[None])[0] ** 2
        assert y[at.u] @ out[at.u] == pytest.approx(rate, abs=sharp)


@pytest.mark.parametrize("seed", range(5))
@each_chart
def test_charts_move_as_bodies_turn_and_rows_are_those_of_eq_94(coordinates, seed) -> None:
    """R_dot = R hat(Omega), r_dot = v; c = phi_ddot + 2 alpha phi_dot + beta^2 phi: all by central differences.

    (r, R, v, Omega) -> (p, u) -> (r, R, v, Omega) is the identity away from the chart's singularity.
    """
    alpha, beta, system, at = 3.0, 7.0, SYSTEMS["linkage"], layout_of("linkage", coordinates)[0]
    state = arbitrary(system, seed)
    p, u = at.chart.coordinates(state)
    y, u_dot = np.concatenate((p.ravel(), u.ravel(), np.zeros(at.k))), np.cos(seed + np.arange(at.n_u))
    out = assemble_equations(at, "acceleration", alpha, beta, differentiable=False).values(y, u_dot)

    def after(h: float) -> States:
        z = y + h * np.concatenate((out[at.p], u_dot, np.zeros(at.k)))
        return at.chart.states(z[at.p].reshape(1, system.nb, -1), z[at.u].reshape(1, system.nb, 6))

    for name in ("r", "R", "v", "Omega"):
        np.testing.assert_allclose(getattr(after(0.0)[0], name), getattr(state, name), atol=ROUNDING)
    ahead, behind = after(STEP), after(-STEP)
    spin = np.swapaxes(state.R, 1, 2) @ (ahead.R - behind.R)[0] / (2.0 * STEP)
    sharp = DIFFERENCES / at.chart.margin(p[None])[0] ** 3  # derivatives of angles grow with its inverse
    np.testing.assert_allclose(spin, so3.hat(state.Omega), atol=sharp)
    np.testing.assert_allclose((ahead.r - behind.r)[0] / (2.0 * STEP), state.v, atol=DIFFERENCES)
    phi_ddot = (motion.constraint_rate(system, ahead) - motion.constraint_rate(system, behind))[0] / (2.0 * STEP)
    one = States.one(state)
    rates = 2.0 * alpha * motion.constraint_rate(system, one)[0] + beta**2 * motion.constraint(system, one)[0]
    np.testing.assert_allclose(out[at.lam] - rates, phi_ddot, atol=sharp, rtol=1e-5)


@pytest.mark.parametrize("kind", MOVING)
@ends
def test_along_the_accelerations_rows_hold_and_the_power_of_drives_is_the_rate_of_energy(kind, ground) -> None:
    """d(T + V)/dt with the powers of drives, timed loads and a damper; phi_dot after a step of h is of order h^2."""
    system, s = consistent(kind, ground=ground)
    rates = accelerations(system, s)
    ahead, behind = (motion.energy(system, States.one(along(s, rates, h)))[0] for h in (STEP, -STEP))
    power = work.compute_power(system, States.one(s))[0]
    assert (ahead - behind) / (2.0 * STEP) == pytest.approx(power, rel=1e-6)
    if DECLARED[kind].motion:
        assert abs(work.compute_drive_power(system, States.one(s))[0]) > 1e-2 * abs(power)
    off = [np.max(np.abs(motion.constraint_rate(system, States.one(along(s, rates, h))))) for h in (2e-4, 1e-4)]
    assert np.log2(off[0] / off[1]) == pytest.approx(2.0, abs=0.05)


def test_the_power_of_a_motion_that_is_lost_is_not_a_number() -> None:
    """And that of the instants before stays."""
    system, s = consistent(MovingKind.DRIVEN_ANGLE)
    lost = State(s.r * np.nan, s.R, s.v, s.Omega, s.t)
    both = States(*(np.stack((getattr(s, n), getattr(lost, n))) for n in ("r", "R", "v", "Omega", "t")))
    power = work.compute_drive_power(system, both)
    assert power[0] == work.compute_drive_power(system, States.one(s))[0] and np.isnan(power[1])


def test_a_function_of_time_has_its_derivatives_and_its_integral() -> None:
    """By central differences; the integral of a speed is the position of a drive."""
    numbers, t = SWAY.numbers()[None], np.array([0.1, 0.7])
    _, f_dot, f_ddot = time_functions.evaluate_functions(numbers, t)
    ahead, behind = (time_functions.evaluate_functions(numbers, t + h) for h in (STEP, -STEP))
    assert np.max(np.abs((ahead[0] - behind[0]) / (2 * STEP) - f_dot)) < 1e-8
    assert np.max(np.abs((ahead[1] - behind[1]) / (2 * STEP) - f_ddot)) < 1e-8
    for rate in (TimeFunction((1.0, 2.0, 3.0), 0.5, 2.0, 0.4), TimeFunction((1.0,), 0.5, 0.0, 0.4)):
        whole = rate.integral(0.25).numbers()[None]
        assert time_functions.evaluate_functions(whole, np.zeros(1))[0] == pytest.approx(0.25, abs=1e-15)
        assert time_functions.evaluate_functions(whole, t)[1] == pytest.approx(
            time_functions.evaluate_functions(rate.numbers()[None], t)[0]
        )


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
    assert across == pytest.approx(
        time_functions.evaluate_functions(SWAY.numbers()[None], np.array([0.3]))[0][0, 0], abs=1e-11
    )


@ends
def test_a_driven_distance_is_that_of_the_points(ground) -> None:
    """|d| = L(t) and its rate L'(t); the row pulls each body along d, at its own point."""
    system, s = consistent(MovingKind.DRIVEN_DISTANCE, ground=ground)
    one, (a, b) = States.one(s), ((0, system.joint_s_i[0]), (-1 if ground else 1, system.joint_s_j[0]))
    d, d_dot = (of(one, *a)[0] - of(one, *b)[0] for of in (motion.point_position, motion.point_velocity))
    L, L_dot, _ = (a[0, 0] for a in time_functions.evaluate_functions(SWAY.numbers()[None], np.array([0.3])))
    assert (np.linalg.norm(d), d @ d_dot / L) == pytest.approx((L, L_dot), abs=1e-11)
    A = constraint_jacobian(system, s).toarray()[0].reshape(-1, 6)
    for (body, arm), sign in ((a, 1.0), (b, -1.0))[: system.nb]:
        assert A[body, :3] == pytest.approx(sign * d / L, abs=1e-12)
        assert A[body, 3:] == pytest.approx(np.cross(arm, s.R[body].T @ A[body, :3]), abs=1e-12)


def test_a_row_of_loads_and_dampers_works_along_the_motion() -> None:
    """The work of the cubic is of fourth order in the step: halved steps leave a sixteenth."""
    system, state = one_joint(JointKind.FIXED, ground=False)
    t, share = np.linspace(0.0, 1.0, 1601), np.array([[1.0], [0.5]])
    turn = np.stack((np.sin(2.0 * t), t**2, np.cos(3.0 * t)), axis=-1)[:, None] * share
    rate = np.stack((2.0 * np.cos(2.0 * t), 2.0 * t, -3.0 * np.sin(3.0 * t)), axis=-1)[:, None] * share
    s = States(turn + state.r, so3.exp(turn) @ np.eye(3), rate, so3.angular_velocity(turn, rate))

    def work_in(k: int) -> float:
        return float(np.sum(work.integrate_power_along_cubics(system, s.at(slice(None, None, k)), np.diff(t[::k]))))

    exact = work_in(1)
    off = [abs(work_in(k) - exact) for k in (160, 80)]
    assert np.log2(off[0] / off[1]) == pytest.approx(4.0, abs=0.4)
    power = work.compute_power(system, s)
    simpson = np.sum(power[:-2:2] + 4.0 * power[1:-1:2] + power[2::2]) * t[1] / 3.0
    assert exact == pytest.approx(simpson, abs=1e-9)


OTHERWISE = [
    {"mirror": "X"},
    {"mirror": "Z"},
    {"renumber": 3},
    {"duplicate": 2},
    {"unit_length": 100.0, "unit_time": 7.0},
    {"mirror": "Y", "duplicate": 1, "renumber": 5, "unit_length": 0.25, "unit_mass": 7.0, "unit_time": 3.0},
]
PRESENTED = [
    (name, given)
    for name in SYSTEMS
    for given in (OTHERWISE if name != "user forces" else (OTHERWISE[0], OTHERWISE[4]))
]


def differences(system: MultibodySystem, s: State) -> float:
    """Error of the power [W] by differences of the rows, whose reach is a time and depends on its unit.

    Over half their reach it is a 64th: the change is the error.
    """
    power = work.compute_power(system, States.one(s))[0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(motion, "REACH", 0.5 * motion.REACH)
        return 1.1 * abs(float(work.compute_power(system, States.one(s))[0] - power))


@pytest.mark.parametrize(
    ("name", "given"),
    few(PRESENTED, lambda case: case != ("user forces", OTHERWISE[0])),  # each compiles the law anew
)
def test_a_presentation_changes_no_energy_and_no_power(name, given) -> None:
    """Joints, functions of time, springs, loads and laws are presented with the bodies: E as M L^2 / T^2."""
    system = SYSTEMS[name]
    asked, s = Presentation(**given), settle(system, timed(system, 6))
    shown, there = asked.system(system), asked.state(system, s)
    joule = asked.force * asked.unit_length
    E, P = motion.energy(system, States.one(s))[0], work.compute_power(system, States.one(s))[0]
    assert motion.energy(shown, States.one(there))[0] == pytest.approx(E * joule, rel=1e-9)
    watt, P_there = joule / asked.unit_time, work.compute_power(shown, States.one(there))[0]
    doubt = differences(system, s) * watt + differences(shown, there)
    assert abs(P_there - P * watt) < doubt + 1e-9 * abs(P * watt)
    assert np.max(np.abs(motion.constraint(shown, States.one(there)))) < 1e-12 * max(asked.unit_length, 1.0)
    assert np.max(np.abs(motion.constraint_rate(shown, States.one(there)))) < 1e-10 * max(asked.speed, 1.0)
    assert_each(np.linalg.eigvalsh(shown.inertia)[:, 0], ">", 0.0)
    back = asked.restore_states(system, States.one(there))
    assert back.times[0] == pytest.approx(s.t)
    for name in ("r", "R", "v", "Omega"):
        assert_close(getattr(back[0], name), getattr(s, name), rtol=1e-14, atol=0.0, what=name)
    apart = arbitrary(system, 6)
    sizes = [
        np.linalg.norm(motion.constraint_energy_norm(x, States.one(y)))
        for x, y in ((system, apart), (shown, asked.state(system, apart)))
    ]
    if set(given) <= {"mirror", "renumber"}:  # a mixes metres and numbers: its c depends on the units
        assert sizes[1] == pytest.approx(sizes[0], rel=1e-11)


@each_system
def test_a_turned_frame_changes_no_energy_and_no_power(system) -> None:
    """T + V, the power and phi_dot stay when everything is turned."""
    s = settle(system, timed(system, 7))
    p = Problem("turned", system, s, 1.0, 1e-3, "", "made up")
    q = rotate_problem(p, so3.exp(np.array([0.3, -0.2, 0.5])))
    there = States(*(getattr(States.one(q.initial), n) for n in ("r", "R", "v", "Omega")), np.array([s.t]))
    for of in (motion.energy, work.compute_power):
        assert of(q.system, there)[0] == pytest.approx(of(system, States.one(s))[0], rel=1e-9)
    assert np.max(np.abs(motion.constraint_rate(q.system, there))) < 1e-10
