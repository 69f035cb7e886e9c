"""Solvers on drives, knife edges, rolling discs, torsional springs and timed loads; what they refuse, and why."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import motion, work
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.dynamics import accelerations
from mbsbench.harness.mechanics.joints import Joint, MovingKind
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import GROUND, MultibodySystem, RigidBody, assemble
from mbsbench.harness.mechanics.time_functions import TimeFunction
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory

from ..arbitrary_joints import moving_rows
from ..arbitrary_systems import arbitrary

SHORT = 0.032  # [s]
FIXED = ("gc_weak_form", "gc_augmented_lagrangian", "half_explicit", "rattle", "lie_variational", "generalized_alpha",
         "al_index3")  # fmt: skip
CONTROLLED = ("rkmk_dopri5", "radau_ggl", "ida_index1", "ida_index2", "ida_index3", "ndf_index1", "rk45_strong_form")
NEED_PHI = ("rattle", "lie_variational", "generalized_alpha", "al_index3", "radau_ggl", "ida_index2", "ida_index3")
WITHOUT_PHI = (MovingKind.KNIFE_EDGE, MovingKind.ROLLING)


@cache
def swing(kind: MovingKind) -> tuple[Problem, State]:
    """Two bodies, and where the accelerations of NumPy take them."""
    system = moving_rows(kind)
    start = project(system, arbitrary(system, 4), 200)
    nb = system.nb

    def state(t: float, y: np.ndarray) -> State:
        r, q, v, Omega = (a.reshape(nb, -1) for a in np.split(y, np.cumsum([3, 4, 3]) * nb))
        return State(r, Rotation.from_quat(q).as_matrix(), v, Omega, t)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        rates, q = accelerations(system, state(t, y)), y[3 * nb : 7 * nb].reshape(nb, 4)
        W, vector, w = rates.Omega, q[:, :3], q[:, 3:]
        turning = 0.5 * np.concatenate((w * W + np.cross(vector, W), -np.sum(vector * W, 1)[:, None]), axis=1)
        return np.concatenate([a.ravel() for a in (rates.v, turning, rates.v_dot, rates.Omega_dot)])

    y = [a.ravel() for a in (start.r, Rotation.from_matrix(start.R).as_quat(), start.v, start.Omega)]
    end = solve_ivp(rate, (0.0, SHORT), np.concatenate(y), method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    return Problem("moving rows", system, start, SHORT, 1e-3, "", "made up"), state(SHORT, end)


def off(out: Trajectory, end: State) -> float:
    assert out.status == Status.SUCCESS, out.message
    return float(np.max(np.abs(out.states.r[-1] - end.r)) + np.max(np.abs(out.states.R[-1] - end.R)))


def refused(name: str, kind: MovingKind, p: Problem, control: StepControl) -> bool:
    """Whether it is, with the reason; no other pair is."""
    said = make_solver(name).refuses(p, control)
    assert (said is not None) == (name in NEED_PHI and kind in WITHOUT_PHI)
    assert said is None or "by their phi" in said
    return said is not None


@pytest.mark.parametrize("name", FIXED)
@pytest.mark.parametrize("kind", MovingKind)
def test_fixed_steps_converge_with_their_order(kind: MovingKind, name: str) -> None:
    """Against accelerations that share no equation with the kernels, order 4 at shorter steps; or refused."""
    p, end = swing(kind)
    solver = make_solver(name)
    coarse = 4e-3 if solver.order < 3.0 else 2e-3
    if refused(name, kind, p, StepControl(dt=coarse)):
        return
    errors = [off(solver.solve(p, StepControl(dt=dt)), end) for dt in (coarse, 0.5 * coarse)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(solver.order, abs=0.25)


@pytest.mark.parametrize("name", CONTROLLED)
@pytest.mark.parametrize("kind", MovingKind)
def test_error_control_holds_its_tolerance(kind: MovingKind, name: str) -> None:
    """A local tolerance of 1e-8 over a thirtieth of a second: a thousand of them at most."""
    p, end = swing(kind)
    if not refused(name, kind, p, StepControl(rtol=1e-8)):
        assert off(make_solver(name).solve(p, StepControl(rtol=1e-8)), end) < 1e-5


@pytest.mark.parametrize("name", ["gc_composed", "gc_extrapolated", "energy_momentum"])
def test_what_a_method_has_no_equations_for_is_refused(name: str) -> None:
    """With the reason, before the first step."""
    p, _ = swing(MovingKind.DRIVEN_ANGLE)
    control = StepControl(rtol=1e-8) if name == "gc_extrapolated" else StepControl(dt=1e-3)
    assert "use gc_weak_form" in (make_solver(name).refuses(p, control) or "")


CLOSING = {"rkmk_dop853": {"rtol": 1e-9}, "half_explicit": {"dt": 4e-3}, "radau_index1": {"rtol": 1e-8},
           "scipy_strong_form": {"rtol": 1e-9}}  # fmt: skip


@pytest.mark.parametrize("name", CLOSING)
def test_a_disc_that_rolls_one_turn_closes_its_circle(name: str) -> None:
    """To 1e-6 m after 5.85 s, by four families; nothing drives it, so T + V is constant."""
    p = make_problem("rolling_disc")
    out = make_solver(name).solve(p, StepControl(**CLOSING[name]))
    assert out.status == Status.SUCCESS, out.message
    assert np.max(np.abs(out.states.r[-1] - out.states.r[0])) < 1e-6
    assert np.ptp(motion.energy(p.system, out.states)) < 1e-7


@pytest.mark.parametrize("name", ["rolling_disc", "knife_edge", "driven_slider_crank"])
def test_the_weak_form_is_of_second_order_on_them(name: str) -> None:
    """Three halvings against the closed form: mu enters through phi_dot alone, with or without a phi."""
    p = make_problem(name, {"t_end": 0.4})
    solver, errors = make_solver("gc_weak_form", {"tolerance": 1e-11}), []
    for dt in (8e-3, 4e-3, 2e-3):
        out = solver.solve(p, StepControl(dt=dt))
        assert out.status == Status.SUCCESS, out.message
        errors.append(np.max(np.abs(out.states.r - p.reference().states(out.t).r)))
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.1)


def shaken(acceleration: float) -> Problem:
    """A pendulum whose support is driven along X by half the acceleration times t^2."""
    table, bob = (RigidBody(m, 0.01 * m * np.diag([1.0, 1.2, 1.1])) for m in (2.0, 1.0))
    X, Y, Z = np.eye(3)
    drive = TimeFunction((0.0, 0.0, 0.5 * acceleration))
    joints = [
        Joint(0, (0, 0, 0), GROUND, (0, 0, 0), X, X, "rail", "prismatic", Y, Y),
        Joint(0, (0, 0, 0), GROUND, (0, 0, 0), None, X, "drive", MovingKind.DRIVEN_POSITION, motion=drive),
        Joint(1, (0, 0.5, 0), 0, (0, 0, 0), Z, Z, "hinge"),
    ]
    system: MultibodySystem = assemble([table, bob], joints, (0.0, -9.81, 0.0))
    rest = np.zeros((2, 3))
    return Problem(
        "shaken", system, State(np.array([[0, 0, 0], [0, -0.5, 0]]), np.tile(np.eye(3), (2, 1, 1)), rest, rest), 1.0,
        1e-3, "", "made up",
    )  # fmt: skip


@pytest.mark.parametrize("name", ["rkmk_dop853", "ida_index1"])
def test_an_accelerated_support_tilts_gravity(name: str) -> None:
    """Einstein: seen from the support, a pendulum of m, J swings in g - a; its energy there is constant."""
    p = shaken(4.0)
    out = make_solver(name).solve(p, StepControl(rtol=1e-10))
    relative = out.states.r[:, 1] - out.states.r[:, 0]
    v = out.states.v[:, 1] - out.states.v[:, 0]
    spin = out.states.Omega[:, 1, 2]
    seen = 0.5 * np.sum(v * v, axis=1) + 0.5 * 0.011 * spin**2 + relative @ np.array([4.0, 9.81, 0.0])
    assert np.max(spin) > 0.5 or np.min(spin) < -0.5
    assert np.ptp(seen) < 1e-6
    assert out.states.r[-1, 0, 0] == pytest.approx(2.0, abs=1e-7)


@pytest.mark.parametrize("name", ["rkmk_dop853", "ida_index1"])
def test_the_work_of_a_drive_is_the_energy_that_it_gives(name: str) -> None:
    """E - E(0) - W vanishes although E multiplies: the reaction comes from the motion, not from the solver."""
    p = make_problem("driven_slider_crank", {"t_end": 0.3})
    out = make_solver(name).solve(p, StepControl(rtol=1e-9, max_step=2e-3))
    E = motion.energy(p.system, out.states)
    W, *_ = work.work(p.system, out.t, out.states, E)
    assert np.ptp(E) > 0.5
    assert np.max(np.abs(E - E[0] - W)) < 1e-6 * np.ptp(E)
