"""A driven distance: the pendulum of driven length against its equation in one angle."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import motion, time_functions, work
from mbsbench.harness.types import Problem, Status, StepControl

G = 9.81


def swings(p: Problem, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """theta, its rate and the tension, from the angular momentum m L^2 theta' and its rate, the moment of gravity."""
    numbers = p.system.joint_motion

    def length(t: float | np.ndarray) -> list[np.ndarray]:
        return [a[:, 0] for a in time_functions.values(numbers, np.atleast_1d(t))]

    def rate(t: float, y: np.ndarray) -> list[float]:
        L = float(length(t)[0][0])
        return [y[1] / L**2, -G * L * math.sin(y[0])]

    start = p.observe(motion.States.one(p.initial))["theta"][0]
    theta, momentum = solve_ivp(rate, (0.0, p.t_end), [start, 0.0], "DOP853", t, rtol=1e-12, atol=1e-13).y
    L, _, L_ddot = length(t)
    return theta, momentum / L**2, p.system.mass[0] * (momentum**2 / L**3 + G * np.cos(theta) - L_ddot)


def test_the_reference_is_the_equation_of_the_angle() -> None:
    """L theta'' + 2 L' theta' + g sin(theta) = 0, integrated here as a momentum; pumped swings grow fivefold."""
    p, t = make_problem("pumped_pendulum"), np.linspace(0.0, 10.0, 501)
    theta, rate, _ = swings(p, t)
    exact = p.reference()
    states = exact.states(t)
    assert np.max(np.abs(p.observe(states)["theta"] - theta)) < 1e-9
    e = np.stack((np.cos(theta), np.sin(theta)), axis=1)
    length = time_functions.values(p.system.joint_motion, t)[0][:, 0]
    assert np.max(np.abs(np.sum(states.v[:, 0, :2] * e, axis=1) - length * rate)) < 1e-8
    assert np.max(exact.error(t)) < 1e-9
    assert np.max(np.abs(theta)) > 5.0 * theta[0]


@pytest.mark.parametrize(
    ("name", "control", "off"),
    [("rkmk_dop853", {"rtol": 1e-10}, 1e-7), ("ida_index1", {"rtol": 1e-10}, 1e-6), ("rattle", {"dt": 1e-3}, 2e-4),
     ("gc_weak_form", {"dt": 1e-3}, 2e-4)],
)  # fmt: skip
def test_solvers_find_the_angle_and_the_tension(name: str, control: dict, off: float) -> None:
    """theta and m (L theta'^2 + g cos(theta) - L''), which is minus the force conjugate to phi, as it pulls."""
    p = make_problem("pumped_pendulum", {"t_end": 2.0})
    out = make_solver(name).solve(p, StepControl(**control))
    assert out.status == Status.SUCCESS, out.message
    theta, _, tension = swings(p, out.t)
    assert np.max(np.abs(p.observe(out.states)["theta"] - theta)) < off
    assert np.max(np.abs(-out.reaction[:, 0] - tension)) < 100.0 * off
    E = motion.energy(p.system, out.states)
    assert np.max(np.abs(E - E[0] - work.work(p.system, out.t, out.states, E)[0])) < 100.0 * off * np.ptp(E)


@pytest.mark.parametrize(("given", "when"), [({"amplitude": 1.0}, 0.752), ({"amplitude": 2.0, "t_end": 0.8}, 0.586)])
def test_a_length_that_vanishes_is_refused(given: dict, when: float) -> None:
    """l + a sin(w t) with a = l vanishes at three quarters of a period; in one line with the time."""
    end = f"{given.get('t_end', 10.0):g}"
    said = (
        rf"the driven distance of joint 'rod' must be above 0 m up to t_end = {end} s \(got -?[\d.e-]+ m at 0\.\d+ s\)"
    )
    with pytest.raises(ValueError, match=said) as error:
        make_problem("pumped_pendulum", given)
    assert float(str(error.value).split(" at ")[1].split(" s")[0]) == pytest.approx(when, abs=0.01)


@pytest.mark.parametrize("given", [{"amplitude": 2.0, "t_end": 0.5}, {"tuning": 1e6}])
def test_a_length_that_stays_above_zero_is_taken(given: dict) -> None:
    """A motion that ends before the length vanishes; a swing of a tenth of it, however fast, which has no reference."""
    made = make_problem("pumped_pendulum", given)
    assert ("tuning" in given) == (made.reference_from is None)
    with pytest.raises(ValueError, match="must be above 0 m"):
        make_problem("pumped_pendulum", {**given, "amplitude": 2.0, "t_end": 10.0})
