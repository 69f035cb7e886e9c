"""Proved references against Taylor series in 50 digits, which share no equation with them."""

from dataclasses import replace

import numpy as np
import pytest
from mpmath import mp, mpf

from mbsbench import make_problem
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.types import ReferenceKind, classify_reference
from mbsbench.problems.exact.balls import find_nearest_rotation, run_in_balls, to_balls
from mbsbench.problems.exact.one_body import find_pinned_motion
from mbsbench.problems.exact.pinned_body import PinnedBody, PinnedMotion
from mbsbench.tests.comparing import assert_each

DIGITS, ORDER = 50, 25
SKEWED = np.diag([1.0 + 1e-11, 1.0, 1.0])
LEVER = 1e-15  # [m]
ANGLE = 1e-14  # [rad]
CASES = [
    ("heavy_top", {}, 0.2),
    ("heavy_top", {"theta0": 30.0, "phi_dot0": 20.0, "spin": 40.0}, 0.2),
    ("geradin_cardona_top", {}, 0.2),
    ("spherical_pendulum", {}, 0.2),
    ("spherical_pendulum", {"omega_z": 0.1}, 0.2),
    ("spherical_pendulum", {"angle": 80.0, "omega_y": 3.0}, 0.2),
    ("torque_free_body", {}, 0.2),
    ("torque_free_body", {"inertia_factors": (1.0, 2.0, 2.5)}, 0.2),
    ("torque_free_body", {"inertia_factors": (2.5, 2.0, 1.0), "omega": (3.0, -2.0, 1.0)}, 0.2),
]


@run_in_balls
def motion_of(body: PinnedBody, start: State) -> PinnedMotion:
    return find_pinned_motion(body, find_nearest_rotation(start.R[0]), to_balls(start.Omega[0]))


def sum_series(body: PinnedBody, start: State, t_end: float) -> np.ndarray:
    """R at ``t_end`` (mpf): rows of R turn as rho_dot = rho x Omega, J Omega_dot = J Omega x Omega + c x R^T m g."""
    exact = np.vectorize(mpf, otypes=[object])
    R = exact(start.R[0])
    for _ in range(7):
        R = R @ (3 * exact(np.eye(3)) - R.T @ R) / 2
    c, g = exact(body.arm), exact(body.gravity) * mpf(body.mass)
    J = exact(np.diag(body.inertia_C)) + mpf(body.mass) * (c @ c - c * c)
    W = exact(start.Omega[0])
    steps = int(np.ceil(t_end * (25.0 + np.max(np.abs(start.Omega)))))
    for _ in range(steps):
        rows, rates = [R], [W]
        for k in range(ORDER):
            R_dot = sum(np.cross(rows[j], rates[k - j]) for j in range(k + 1))
            turn = sum(np.cross(J * rates[j], rates[k - j]) for j in range(k + 1)) + np.cross(c, g @ rows[k])
            rows.append(R_dot / (k + 1))
            rates.append(turn / J / (k + 1))
        h = mpf(t_end) / steps
        R, W = (sum(a * h**k for k, a in enumerate(terms)) for terms in (rows, rates))
    return R


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "options", "t_end"), CASES)
def test_the_true_pose_is_within_the_proved_radius(name: str, options: dict, t_end: float) -> None:
    """Before and after the final rounding; the same pose with a moment of inertia off by 1e-11 is far outside."""
    p = make_problem(name, options)
    body, t = PinnedBody.from_system(p.system), np.array([t_end])
    motion = motion_of(body, p.initial)
    with mp.workdps(DIGITS):
        R = sum_series(body, p.initial, t_end)

        def distance(given: np.ndarray) -> float:
            parts = given.astype(float)  # two parts hold 64 bits
            rest = (given - parts).astype(float)
            exact = np.vectorize(mpf, otypes=[object])
            return float(mp.sqrt(sum(x * x for x in (exact(parts) + exact(rest) - R).ravel())))

        assert distance(motion.motion.attitude(t)[0][0]) <= motion.motion.error(t)[0]
        s = motion.states(t)
        assert distance(s.R[0, 0]) <= motion.angle_error(t)[0]
        C = np.vectorize(mpf, otypes=[object])(body.pin) + R @ np.vectorize(mpf, otypes=[object])(body.arm)
        assert max(abs(C - np.vectorize(mpf, otypes=[object])(s.r[0, 0]))) <= motion.error(t)[0]
        pull = (1.0 + 1e-11) * body.gravity
        wrong = replace(body, gravity=pull) if np.any(pull) else replace(body, inertia_O=body.inertia_O * SKEWED)
        if name != "torque_free_body" or options:  # a sphere turns alike at any inertia
            other = motion_of(wrong, p.initial)
            assert distance(other.motion.attitude(t)[0][0]) > other.motion.error(t)[0]


@pytest.mark.parametrize(
    ("name", "options"),
    [*(c[:2] for c in CASES), ("simple_pendulum", {}), ("simple_pendulum", {"support": "link"}), ("free_body", {})],
)
def test_the_radius_is_small_to_the_horizon(name: str, options: dict) -> None:
    """Of C 1e-15 m beside the rounding of its coordinates, which are up to 33 m; of angles 1e-14 rad."""
    p = make_problem(name, options)
    reference = p.reference()
    t = np.linspace(0.0, p.t_end, 1001)
    size = np.maximum(1.0, np.max(np.abs(reference.states(t).r), axis=(1, 2)))
    assert classify_reference(reference) is ReferenceKind.PROVED
    assert_each(reference.error(t), "<=", LEVER * size)
    home = reference.home
    attitude = getattr(home, "about_C", getattr(home, "arm", home))
    assert np.max(attitude.angle_error(t)) <= ANGLE
