"""Charts of the symbolic route: coordinates p and velocities u of a body, and the maps to and from (r, R, v, Omega).

``R_dot = R hat(Omega)`` with ``V = (r_dot, Omega) = B(p) u`` and ``p_dot = G(p) u``. Two charts:

- **euler313**, the paper's: p = (r, phi, theta, psi), R = R_Z(phi) R_X(theta) R_Z(psi), u = p_dot, so that M(q) =
  blockdiag(m I, T^T J T) with Omega = T theta_dot. T is singular at sin(theta) = 0; nothing here hides that.
- **quaternion**: p = (r, q), u = V itself, q_dot = 1/2 q o Omega. R is homogeneous of degree 0 in q and the rate of
  degree 1, so R_dot = R hat(Omega) holds exactly at any |q|: the norm carries no physics. It is kept near 1 by the
  term (1 - |q|^2) q / 2 in q_dot, which is along q and so does not turn the body either.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...harness.mechanics.fixed_order import apply
from ...harness.mechanics.naming import NamedSystem, name_body
from ...harness.mechanics.state import State, States

# [1/s] rate at which |q| returns to 1: slower than every motion here, it never limits the step. On a free body, a
# pendulum and a top half and twice change the evaluations by -4 to 3 %, where the step's choice is disturbed.
NORM_RATE = 1.0
SINGULAR_CHART = 1e-6  # |sin(theta)| below which T^-1 amplifies rounding to 1e-10


@dataclass(frozen=True)
class Chart(ABC):
    """Coordinates of one body: symbolic maps for CasADi, numeric maps for starts and records."""

    name: ClassVar[str]
    size: ClassVar[int]  # coordinates per body; velocities are always 6
    constant_mass: ClassVar[bool]  # M does not depend on p: u is V

    @abstractmethod
    def rotation(self, p: ca.SX) -> ca.SX:
        """Return the rotation matrix R (3, 3), from body to space, at a body's coordinates ``p``."""

    @abstractmethod
    def body_velocity(self, p: ca.SX, u: ca.SX) -> ca.SX:
        """Return V = B(p) u = (r_dot [m/s, in space], Omega [rad/s, in the body])."""

    @abstractmethod
    def flow(self, p: ca.SX, u: ca.SX) -> ca.SX:
        """Return the coordinate rates p_dot = G(p) u of a body, without the term ``restoring``."""

    def restoring(self, p: ca.SX) -> ca.SX:
        """Return the term added to p_dot that draws p back to its manifold and moves no body; zero by default."""
        return ca.SX.zeros(self.size)

    def rotation_rates(self, p: Float[np.ndarray, "*batch size"]) -> Float[np.ndarray, "*batch 3 3"]:
        """Return the matrix T of Omega = T u_rot, with u_rot the last three velocities; the identity where u = V."""
        return np.broadcast_to(np.eye(3), (*p.shape[:-1], 3, 3))

    @property
    @abstractmethod
    def at_rest(self) -> Float[np.ndarray, " size"]:
        """Coordinates of the ground: r = 0, R = 1."""

    @abstractmethod
    def coordinates(self, state: State) -> tuple[Float[np.ndarray, "nb size"], Float[np.ndarray, "nb 6"]]:
        """Return coordinates p and velocities u of all bodies in ``state``."""

    @abstractmethod
    def states(self, p: Float[np.ndarray, "nt nb size"], u: Float[np.ndarray, "nt nb 6"]) -> States:
        """Return positions, rotations and velocities in space of all bodies at nt times.

        R is orthogonal to rounding.
        """

    @abstractmethod
    def margin(self, p: Float[np.ndarray, "nt nb size"]) -> Float[np.ndarray, " nt"]:
        """Return how far the chart is from its singularity at each time: about 1 far from it, 0 on it.

        The value is the least over all bodies.
        """

    def refuse_start(self, system: NamedSystem, state: State) -> str | None:
        """Return why the chart cannot represent ``state``, naming the body of ``system`` at fault; None if it can."""
        return None


@dataclass(frozen=True)
class Euler313(Chart):
    """3-1-3 angles (precession, nutation, spin) and their rates."""

    name: ClassVar[str] = "euler313"
    size: ClassVar[int] = 6
    constant_mass: ClassVar[bool] = False

    def rotation(self, p: ca.SX) -> ca.SX:
        """Return R = R_Z(phi) R_X(theta) R_Z(psi), from body to space."""
        return _turn_z(p[3]) @ _turn_x(p[4]) @ _turn_z(p[5])

    def body_velocity(self, p: ca.SX, u: ca.SX) -> ca.SX:
        """Return (r_dot [m/s, in space], Omega [rad/s, in the body])."""
        (theta, psi), (a, b, c) = (p[4], p[5]), (u[3], u[4], u[5])
        transverse = ca.sin(theta) * a
        return ca.vertcat(
            u[:3],
            ca.sin(psi) * transverse + ca.cos(psi) * b,
            ca.cos(psi) * transverse - ca.sin(psi) * b,
            ca.cos(theta) * a + c,
        )

    def flow(self, p: ca.SX, u: ca.SX) -> ca.SX:
        """Return p_dot, which is ``u`` itself in this chart."""
        return u

    def rotation_rates(self, p: np.ndarray) -> np.ndarray:
        """Return T (..., 3, 3) of Omega = T (phi_dot, theta_dot, psi_dot), Omega in the body."""
        T = np.zeros((*p.shape[:-1], 3, 3))
        theta, psi = p[..., 4], p[..., 5]
        T[..., 0, 0], T[..., 1, 0] = np.sin(theta) * np.sin(psi), np.sin(theta) * np.cos(psi)
        T[..., 2, 0], T[..., 2, 2] = np.cos(theta), 1.0
        T[..., 0, 1], T[..., 1, 1] = np.cos(psi), -np.sin(psi)
        return T

    @property
    def at_rest(self) -> np.ndarray:
        """Coordinates of the ground: r = 0 and all angles 0."""
        return np.zeros(6)

    def coordinates(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Return p = (r, phi, theta, psi) and u = p_dot of all bodies.

        It divides by sin(theta); ``refuse_start`` excludes starts at which that vanishes.
        """
        R = state.R
        theta = np.arctan2(np.hypot(R[:, 0, 2], R[:, 1, 2]), R[:, 2, 2])
        phi, psi = np.arctan2(R[:, 0, 2], -R[:, 1, 2]), np.arctan2(R[:, 2, 0], R[:, 2, 1])
        p = np.concatenate((state.r, np.stack((phi, theta, psi), axis=1)), axis=1)
        a, b, c = state.Omega.T
        phi_dot = (np.sin(psi) * a + np.cos(psi) * b) / np.sin(theta)
        theta_dot = np.cos(psi) * a - np.sin(psi) * b
        rates = np.stack((phi_dot, theta_dot, c - np.cos(theta) * phi_dot), axis=1)
        return p, np.concatenate((state.v, rates), axis=1)

    def states(self, p: np.ndarray, u: np.ndarray) -> States:
        """Return the states in space of all bodies at nt times, from angles and their rates."""
        R = Rotation.from_euler("ZXZ", p[..., 3:].reshape(-1, 3)).as_matrix().reshape(*p.shape[:-1], 3, 3)
        Omega = apply(self.rotation_rates(p), u[..., 3:])
        return States(p[..., :3], R, u[..., :3], Omega)

    def margin(self, p: np.ndarray) -> np.ndarray:
        """Return the least abs(sin(theta)) over the bodies at each time."""
        return np.min(np.abs(np.sin(p[..., 4])), axis=-1)

    def refuse_start(self, system: NamedSystem, state: State) -> str | None:
        """Return a refusal if a body starts at |sin(theta)| below ``SINGULAR_CHART``, else None.

        Angles are not unique where sin(theta) = 0.
        """
        sine = np.hypot(state.R[:, 0, 2], state.R[:, 1, 2])
        if np.min(sine) >= SINGULAR_CHART:
            return None
        worst = int(np.argmin(sine))
        return (
            f"3-1-3 Euler angles cannot represent the start: {name_body(system, worst)} has |sin(theta)| = "
            f"{sine[worst]:.3g}, where precession and spin are one rotation; "
            "use coordinates=quaternion or turn the problem"
        )


@dataclass(frozen=True)
class Quaternion(Chart):
    """Unit quaternion (w, x, y, z) and Omega."""

    name: ClassVar[str] = "quaternion"
    size: ClassVar[int] = 7
    constant_mass: ClassVar[bool] = True

    def rotation(self, p: ca.SX) -> ca.SX:
        """Return R of the quaternion p[3:] divided by its squared norm, so that any length gives a rotation."""
        w, v = p[3], p[4:]
        R = (w * w - ca.dot(v, v)) * ca.SX.eye(3) + 2 * (v @ v.T) + 2 * w * ca.skew(v)
        return R / (w * w + ca.dot(v, v))

    def body_velocity(self, p: ca.SX, u: ca.SX) -> ca.SX:
        """Return (r_dot, Omega), which is ``u`` itself in this chart."""
        return u

    def flow(self, p: ca.SX, u: ca.SX) -> ca.SX:
        """Return (r_dot, q_dot) with q_dot = 1/2 q o Omega, without the restoring term."""
        w, v, Omega = p[3], p[4:], u[3:]
        return ca.vertcat(u[:3], -0.5 * ca.dot(v, Omega), 0.5 * (w * Omega + ca.cross(v, Omega)))

    def restoring(self, p: ca.SX) -> ca.SX:
        """Return (0, (1 - q . q) q / 2), which brings the norm of q back to 1."""
        q = p[3:]
        return ca.vertcat(ca.SX.zeros(3), 0.5 * NORM_RATE * (1 - ca.dot(q, q)) * q)

    @property
    def at_rest(self) -> np.ndarray:
        """Coordinates of the ground: r = 0 and the quaternion 1."""
        return np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])

    def coordinates(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Return p = (r, q) with unit quaternions q, and u = (r_dot, Omega), of all bodies."""
        q = Rotation.from_matrix(state.R).as_quat(scalar_first=True)
        return np.concatenate((state.r, q), axis=1), np.concatenate((state.v, state.Omega), axis=1)

    def states(self, p: np.ndarray, u: np.ndarray) -> States:
        """Return the states in space of all bodies at nt times; quaternions of any length are normalised."""
        q = p[..., 3:].reshape(-1, 4)
        R = Rotation.from_quat(q, scalar_first=True).as_matrix().reshape(*p.shape[:-1], 3, 3)
        return States(p[..., :3], R, u[..., :3], u[..., 3:])

    def margin(self, p: np.ndarray) -> np.ndarray:
        """Return the least norm of a quaternion over the bodies at each time; the chart is singular at norm 0."""
        return np.min(np.linalg.norm(p[..., 3:], axis=-1), axis=-1)


CHARTS: dict[str, Chart] = {"quaternion": Quaternion(), "euler313": Euler313()}


def _turn_z(angle: ca.SX) -> ca.SX:
    """Return the matrix of a rotation about z by ``angle`` [rad]."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))


def _turn_x(angle: ca.SX) -> ca.SX:
    """Return the matrix of a rotation about x by ``angle`` [rad]."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(ca.horzcat(1, 0, 0), ca.horzcat(0, c, -s), ca.horzcat(0, s, c))
