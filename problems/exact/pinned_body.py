"""Describe one body on a pin O of the ground: its data, and its motion given by the attitude alone.

The pin leaves r = O + R c and r_dot = R (Omega x c), with c the arm from O to C in the body frame.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import States
from ...harness.mechanics.system import GROUND, MultibodySystem
from ...harness.mechanics.types import ReferenceKind
from .theta import PROVABLE

ROUNDING = float(np.finfo(float).eps)
FINAL = 1.01 * 2.0**-53  # rounding of a vector to float64, after a few operations in 64 bits
ROTATION_FINAL = 3**0.5 * FINAL  # rounding of R, whose norm is the root of 3


class Attitude(Protocol):
    """The interface of R and Omega as functions of time, with a proved error of R."""

    def attitude(self, t: Float[np.ndarray, " nt"]) -> tuple[Float[np.ndarray, "nt 3 3"], Float[np.ndarray, "nt 3"]]:
        """Return R in extended precision and Omega in float64 [rad/s, body frame]."""

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a bound on the Frobenius norm of R's error before it is rounded to float64."""


@dataclass(frozen=True)
class RoundingEffect:
    """An estimate of the effect of rounded data on the attitude, as an angle; zero if all data are exact."""

    floor: float = 0.0  # [rad]
    growth: float = 0.0  # [rad/s]

    @staticmethod
    def compute_unless(exact: bool, rate: float) -> "RoundingEffect":
        """Return the effect of rounded data on a motion of ``rate`` [rad/s]; zero if the data are ``exact``."""
        return RoundingEffect() if exact else RoundingEffect(64.0 * ROUNDING, 4.0 * ROUNDING * rate)


@dataclass(frozen=True)
class PinnedBody:
    """Mass, inertia about C and O [kg m2, body], arm c [m, body], pin O [m, space], gravity [m/s2, space]."""

    mass: float
    inertia_C: Float[np.ndarray, "3 3"]
    inertia_O: Float[np.ndarray, "3 3"]
    arm: Float[np.ndarray, " 3"]
    pin: Float[np.ndarray, " 3"]
    gravity: Float[np.ndarray, " 3"]

    @staticmethod
    def from_system(system: MultibodySystem) -> "PinnedBody | None":
        """Return the data of one body on a spherical joint to the ground under gravity; None for any other system."""
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
    def error_radius(self) -> float:
        """The length sqrt(tr J_O / m) [m] by which an error of R becomes one of positions.

        It is sqrt(2) times the radius of gyration about O, and at least sqrt(2) times the arm.
        """
        return float(np.sqrt(np.trace(self.inertia_O) / self.mass))


@dataclass(frozen=True)
class PinnedMotion:
    """A motion given by its attitude, with a bound on its error."""

    formula: str
    body: PinnedBody
    motion: Attitude
    rounded: RoundingEffect  # effect of rounded data
    horizon: float = float("inf")

    @property
    def route(self) -> str:
        """The formula and the kind of its error bound."""
        return f"{self.formula}, {self.kind}"

    @property
    def kind(self) -> ReferenceKind:
        """The kind of reference: proved if no data were rounded, in 64 bits; else a formula."""
        return ReferenceKind.PROVED if self.rounded == RoundingEffect() and PROVABLE else ReferenceKind.FORMULA

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s], rounded to float64."""
        R, Omega = self.motion.attitude(np.asarray(t, dtype=float))
        r = self.body.pin + R @ self.body.arm.astype(np.longdouble)
        R = R.astype(float)
        v = np.einsum("tij,tj->ti", R, np.cross(Omega, self.body.arm))
        return States(r.astype(float)[:, None], R[:, None], v[:, None], Omega[:, None])

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a bound [m] on the position error of C, and of points no farther from O than ``error_radius``."""
        t = np.abs(np.asarray(t, dtype=float))
        return self.body.error_radius * (self.angle_error(t) + FINAL) + FINAL * np.linalg.norm(self.body.pin)

    def angle_error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a bound on the Frobenius norm of R's error, its rounding to float64 included [rad]."""
        t = np.abs(t)
        return self.motion.error(t) + ROTATION_FINAL + self.rounded.floor + self.rounded.growth * t
