"""One body on a pin O of the ground: its data, and a motion given by its attitude alone.

The pin leaves r = O + R c and r_dot = R (Omega x c), with c the arm from O to C in the body frame.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import States
from ...harness.mechanics.system import GROUND, MultibodySystem

Attitude = Callable[
    [Float[np.ndarray, " nt"]], tuple[Float[np.ndarray, "nt 3 3"], Float[np.ndarray, "nt 3"]]
]  # t -> R, Omega
ROUNDING = float(np.finfo(float).eps)


@dataclass(frozen=True)
class PinnedBody:
    """Mass, inertia about C and about O [kg m2, body], arm c [m, body], pin O [m, space], gravity [m/s2, space]."""

    mass: float
    inertia_C: Float[np.ndarray, "3 3"]
    inertia_O: Float[np.ndarray, "3 3"]
    arm: Float[np.ndarray, " 3"]
    pin: Float[np.ndarray, " 3"]
    gravity: Float[np.ndarray, " 3"]

    @staticmethod
    def of(system: MultibodySystem) -> "PinnedBody | None":
        """The data, or None if the system is not one body on one spherical joint to the ground, under gravity alone."""
        forces = (system.spring_k, system.torsion_k, system.load_i, system.user_i)
        if (system.nb, system.nj) != (1, 1) or any(map(len, forces)):
            return None
        if (system.joint_points[0], system.joint_axes[0], system.joint_j[0]) != (3, 0, GROUND):
            return None
        c = -system.joint_s_i[0]
        m, J = float(system.mass[0]), system.inertia[0]
        steiner = m * (c @ c * np.eye(3) - np.outer(c, c))
        return PinnedBody(m, J, J + steiner, c, system.joint_s_j[0], system.gravity)

    @property
    def reach(self) -> float:
        """Arm or radius of gyration [m], the larger: turns an angle error into a length."""
        return max(float(np.linalg.norm(self.arm)), float(np.sqrt(np.trace(self.inertia_O) / self.mass)))


@dataclass(frozen=True)
class PinnedMotion:
    """A motion by its attitude, with the bound ``reach * (floor + growth t)`` on its rounding errors."""

    route: str
    body: PinnedBody
    attitude: Attitude
    floor: float  # [rad]
    growth: float  # [rad/s]
    horizon: float = float("inf")

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """The motion at ``t`` [s]."""
        R, Omega = self.attitude(np.asarray(t, dtype=float))
        r = self.body.pin + R @ self.body.arm
        v = np.einsum("tij,tj->ti", R, np.cross(Omega, self.body.arm))
        return States(r[:, None], R[:, None], v[:, None], Omega[:, None])

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Bound [m] on the position error of C, and of points within the radius of gyration of O."""
        return self.body.reach * (self.floor + self.growth * np.abs(np.asarray(t, dtype=float)))


def frame_with(axis: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """A rotation whose third column is the direction of ``axis``."""
    e = axis / np.linalg.norm(axis)
    a = np.cross(e, np.eye(3)[np.argmin(np.abs(e))])
    a /= np.linalg.norm(a)
    return np.stack((a, np.cross(e, a), e), axis=1)


def turn_z(angle: Float[np.ndarray, "*nt"]) -> Float[np.ndarray, "*nt 3 3"]:
    """R_Z by ``angle`` [rad]."""
    R = np.zeros((*np.shape(angle), 3, 3))
    R[..., 0, 0] = R[..., 1, 1] = np.cos(angle)
    R[..., 1, 0], R[..., 0, 1] = np.sin(angle), -np.sin(angle)
    R[..., 2, 2] = 1.0
    return R
