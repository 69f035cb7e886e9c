"""Theta functions against the second route: integration in extended precision that shares no equation with them."""

from collections.abc import Sequence

import numpy as np
import pytest

from mbsbench import Joint, RigidBody, State, assemble, make_problem, so3
from mbsbench.harness.reference.extrapolation import gbs
from mbsbench.problems.exact.one_body import find_one_body_motion
from mbsbench.problems.exact.pinned_body import PinnedBody
from mbsbench.tests.comparing import assert_close, assert_each

TOPS = [
    ("heavy_top", {}),
    ("heavy_top", {"perturb": 1e-6}),
    ("heavy_top", {"perturb": 0.1, "seed": 3}),
    ("heavy_top", {"spin": 0.0}),  # a planar pendulum swinging over the top
    ("heavy_top", {"theta0": 179.9}),  # hardly off the lowest place
    ("heavy_top", {"theta0": 180.0}),  # off it by rounding
    ("heavy_top", {"theta0": 0.0}),  # asleep, upright
    ("heavy_top", {"gravity": 0.0}),
    ("heavy_top", {"gravity": -9.81, "phi_dot0": 1.0}),
    ("heavy_top", {"theta0": 30.0, "phi_dot0": 20.0, "spin": 40.0}),
    ("spherical_pendulum", {}),
    ("spherical_pendulum", {"omega_z": 0.1}),
    ("spherical_pendulum", {"omega_z": 1e-9}),  # passes the lowest place at 2e-10 m
    ("spherical_pendulum", {"omega_z": 5.0}),
    ("spherical_pendulum", {"perturb": 1e-14}),
    ("spherical_pendulum", {"perturb": 0.3}),
    ("spherical_pendulum", {"angle": 80.0, "omega_y": 3.0}),  # over the top
    ("spherical_pendulum", {"angle": -90.0, "omega_y": 1.0, "omega_x": 5.0}),  # starts at a pole
]
INERTIAS = [(1.0, 2.0, 2.5), (2.5, 1.0, 2.0), (2.0, 2.5, 1.0), (1.0, 1.001, 1.002), (1.0, 1.0, 1.5), (1.0, 1.5, 1.0)]
RATES = [(1.0, 2.0, 3.0), (3.0, -2.0, 1.0), (0.01, 5.0, -0.01), (0.0, 0.0, 3.0)]
FREE = [("torque_free_body", {"inertia_factors": J, "omega": w}) for J in INERTIAS for w in RATES]
ROUTE = 2e-14  # relative rounding of the second route's comparison in float64


def compare(cases: list, t: np.ndarray, substeps: int) -> None:
    presented = [make_problem(*case) for case in cases]
    bodies = [PinnedBody.from_system(p.system) for p in presented]
    R, Omega = integrated(bodies, [p.initial for p in presented], t, substeps)
    for k, (p, body) in enumerate(zip(presented, bodies, strict=True)):
        exact = find_one_body_motion(p.system, p.initial)
        s = exact.states(t)
        angle = so3.angle_between(s.R[:, 0], R[k])
        radius = body.error_radius
        allowed = exact.error(t) + ROUTE * radius * (1.0 + np.abs(t) * np.max(np.abs(Omega[k])))
        assert_each(radius * angle, "<=", allowed, (cases[k], np.max(radius * angle / allowed)))
        rate = 1.0 + np.max(np.abs(Omega[k])) ** 2
        assert_each(np.linalg.norm(s.Omega[:, 0] - Omega[k], axis=1), "<=", rate * allowed / radius, cases[k])


def test_tops_and_pendulums_agree_with_the_second_route() -> None:
    """Both start from the same float64 numbers; what differs is within the stated bound and the route's rounding."""
    compare(TOPS, np.linspace(0.0, 5.0, 26), 25)


def test_free_bodies_agree_with_the_second_route() -> None:
    """Euler's motion about the least and the greatest inertia, near the separatrix, symmetric, about one axis."""
    compare(FREE, np.linspace(0.0, 10.0, 21), 25)


@pytest.mark.slow
def test_the_bound_holds_for_hundreds_of_periods() -> None:
    """The spatial pendulum of Sect. 5.2 over 200 s, the top over 50 s."""
    compare([("spherical_pendulum", {}), ("spherical_pendulum", {"omega_z": 0.1})], np.linspace(0.0, 200.0, 41), 250)
    compare([("heavy_top", {})], np.linspace(0.0, 50.0, 26), 200)


def test_the_top_nutates_to_138_93_degrees() -> None:
    """The other root of (1 - u^2) beta = a^2 (u0 - u) for a cuspidal start: 138.931 deg."""
    p = make_problem("heavy_top")
    theta = p.observe(p.reference().states(np.linspace(0.0, 5.0, 20001)))["theta"]
    beta, a = 2.0 * 5.0 * 9.81 * 0.1 / 0.1, 0.01 * 50.0 / 0.1
    u0 = np.cos(np.deg2rad(20.0))
    lowest = min(np.roots([-1.0, a * a / beta, 1.0 - a * a / beta * u0]))
    assert_close(np.max(theta), np.rad2deg(np.arccos(lowest)), atol=1e-5)  # sampled beside the extreme
    assert_close(np.max(theta), 138.93, atol=0.01)
    assert_close(np.min(theta), 20.0, atol=1e-9)


def test_a_planar_release_stays_planar() -> None:
    """Gravity and the release lie in OXY (Sect. 5.2): Z stays at the rounding of the series for 200 s."""
    p = make_problem("spherical_pendulum")
    reference = p.reference()
    t = np.linspace(0.0, 200.0, 4001)
    assert np.max(np.abs(p.observe(reference.states(t))["C_z"])) < float(reference.error(t[-1:])[0])


def test_a_spherical_body_keeps_its_axis() -> None:
    """Sect. 5.1: J = J 1, so Omega is constant and R turns about it."""
    p = make_problem("torque_free_body")
    t = np.array([0.0, 1.0, 300.0])
    s = p.reference().states(t)
    expected = p.initial.R[0] @ so3.exp(t[:, None] * p.initial.Omega[0])
    assert np.max(np.abs(s.R[:, 0] - expected)) < 1e-12  # rounding of |Omega| t = 1100 rad
    assert np.max(p.observe(s)["axis_error"]) < 1e-14


def test_there_is_no_formula_for_an_asymmetric_top() -> None:
    """Euler's, Lagrange's and Kovalevskaya's cases are the only integrable ones: None, not a wrong motion."""
    body = RigidBody(1.0, np.diag([0.1, 0.12, 0.05]))
    system = assemble([body], [Joint(0, (0.0, 0.0, -0.5))], (0.0, 0.0, -9.81))
    start = State(np.array([[0.0, 0.0, 0.5]]), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    assert find_one_body_motion(system, start) is None


EXTENDED = np.longdouble


def integrated(
    bodies: Sequence[PinnedBody], starts: Sequence[State], t: np.ndarray, substeps: int
) -> tuple[np.ndarray, np.ndarray]:
    """R (ncases, nt, 3, 3) and Omega (ncases, nt, 3): J_O Omega_dot + Omega x J_O Omega = c x R^T m g, J_O diagonal."""
    J = np.array([np.diag(b.inertia_O) for b in bodies], dtype=EXTENDED).T
    c = np.array([b.mass * b.arm for b in bodies], dtype=EXTENDED).T
    g = np.array([b.gravity for b in bodies], dtype=EXTENDED).T
    R0 = np.array([s.R[0] for s in starts], dtype=EXTENDED)

    def rate(y: np.ndarray) -> np.ndarray:
        A, W = y[:9].reshape(3, 3, -1), y[9:]  # columns of R are A[:, k]
        down = np.einsum("ikn,in->kn", A, g)
        W_dot = (_cross(c, down) - _cross(W, J * W)) / J
        A_dot = np.stack(
            [A[:, 1] * W[2] - A[:, 2] * W[1], A[:, 2] * W[0] - A[:, 0] * W[2], A[:, 0] * W[1] - A[:, 1] * W[0]], axis=1
        )
        return np.concatenate((A_dot.reshape(9, -1), W_dot))

    W0 = np.array([s.Omega[0] for s in starts], dtype=EXTENDED)
    out = gbs(rate, np.concatenate((R0.reshape(-1, 9).T, W0.T)), t, substeps)
    R = np.moveaxis(out[:, :9].reshape(len(t), 3, 3, -1), -1, 0)
    return R.astype(float), np.moveaxis(out[:, 9:], -1, 0).astype(float)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
