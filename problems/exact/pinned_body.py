"""One body on a pin O of the ground: its data, and a motion given by its attitude alone.

The pin leaves r = O + R c and r_dot = R (Omega x c), with c the arm from O to C in the body frame.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import States
from ...harness.mechanics.system import GROUND, MultibodySystem
from ...harness.types import ReferenceKind
from .theta import PROVABLE

ROUNDING = float(np.finfo(float).eps)
FINAL = 1.01 * 2.0**-53  # of a vector rounded to float64, with the few operations in 64 bits before
ROTATION_FINAL = 3**0.5 * FINAL  # of R, whose norm is the root of 3


class Attitude(Protocol):
    """R and Omega as functions of time, and the proved error of R."""

    def attitude(self, t: Float[np.ndarray, " nt"]) -> tuple[Float[np.ndarray, "nt 3 3"], Float[np.ndarray, "nt 3"]]:
        """R in extended precision, Omega in float64."""

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Bound on the Frobenius norm of the error of R before it is rounded to float64."""


@dataclass(frozen=True)
class Rounded:
    """Estimate of what data that had to be rounded change, as an angle; nothing where all are exact."""

    floor: float = 0.0  # [rad]
    growth: float = 0.0  # [rad/s]

    @staticmethod
    def unless(exact: bool, rate: float) -> "Rounded":
        """Rounding of data that are not ``exact``, for a motion at ``rate`` [rad/s]."""
        return Rounded() if exact else Rounded(64.0 * ROUNDING, 4.0 * ROUNDING * rate)


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
    """A motion by its attitude, with the bound on its error."""

    formula: str
    body: PinnedBody
    motion: Attitude
    rounded: Rounded
    horizon: float = float("inf")

    @property
    def route(self) -> str:
        """The formula, and what its error is worth."""
        return f"{self.formula}, {self.kind}"

    @property
    def kind(self) -> ReferenceKind:
        """Proved if no data were rounded, in 64 bits."""
        return ReferenceKind.PROVED if self.rounded == Rounded() and PROVABLE else ReferenceKind.FORMULA

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """The motion at ``t`` [s]."""
        R, Omega = self.motion.attitude(np.asarray(t, dtype=float))
        r = self.body.pin + R @ self.body.arm.astype(np.longdouble)
        R = R.astype(float)
        v = np.einsum("tij,tj->ti", R, np.cross(Omega, self.body.arm))
        return States(r.astype(float)[:, None], R[:, None], v[:, None], Omega[:, None])

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Bound [m] on the position error of C, and of points within the radius of gyration of O."""
        t = np.abs(np.asarray(t, dtype=float))
        return self.body.reach * (self.angle_error(t) + FINAL) + FINAL * np.linalg.norm(self.body.pin)

    def angle_error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Bound [rad] on the error of R, its rounding to float64 included."""
        t = np.abs(t)
        return self.motion.error(t) + ROTATION_FINAL + self.rounded.floor + self.rounded.growth * t
