"""Model a gyroscope in steady precession: a top on a spherical joint, its axis turning steadily about the vertical.

The body is a thin disc of 1 kg and 0.1 m radius, 0.2 m from the joint. The spin follows from the rate of precession: I3
w3 rate = m g l + I1 rate^2 cos(theta), I1 about the joint.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from mbsbench import (
    Invariant,
    Joint,
    Observable,
    Parameter,
    Problem,
    RigidBody,
    State,
    States,
    angular_momentum,
    assemble,
    problem,
    so3,
)

MASS, RADIUS, ARM = 1.0, 0.1, 0.2  # [kg], [m], [m]
AXIAL, TRANSVERSE = MASS * RADIUS**2 / 2.0, MASS * RADIUS**2 / 4.0  # [kg m2] of a thin disc, about C
E_3 = np.array([0.0, 0.0, 1.0])  # the axis in the body, the vertical in space


@dataclass(frozen=True)
class Precession:
    """Evaluate R(t) = exp(rate t e_Z) R(0) exp(spin t e_3), the joint at the origin."""

    start: State
    rate: float
    spin: float  # [rad/s] relative to the precessing frame
    route: str = "closed form"
    horizon: float = math.inf

    def states(self, t: np.ndarray) -> States:
        """Return the motion."""
        turn = so3.exp(self.rate * t[:, None] * E_3)
        R = turn @ self.start.R[0] @ so3.exp(self.spin * t[:, None] * E_3)
        r = turn @ self.start.r[0]
        omega = self.rate * E_3 + self.spin * R[:, :, 2]
        Omega = np.einsum("tji,tj->ti", R, omega)
        return States(r[:, None], R[:, None], np.cross(self.rate * E_3, r)[:, None], Omega[:, None])

    def error(self, t: np.ndarray) -> np.ndarray:
        """Return the rounding [m] of angles that grow."""
        return 1e-15 * (1.0 + abs(self.spin) * np.abs(t)) * ARM


@problem("gyroscope")
def gyroscope(
    *,
    theta: Annotated[float, Parameter("angle of the axis from the vertical", "deg", above=0.0)] = 60.0,
    rate: Annotated[float, Parameter("of the precession", "rad/s", above=0.0)] = 2.0,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Model a disc on a spherical joint in steady precession."""
    disc = RigidBody(MASS, np.diag([TRANSVERSE, TRANSVERSE, AXIAL]), "disc")
    system = assemble([disc], [Joint(0, (0.0, 0.0, -ARM), name="O")], (0.0, 0.0, -gravity))
    angle = math.radians(theta)
    about_joint = TRANSVERSE + MASS * ARM**2
    total = (MASS * gravity * ARM + about_joint * rate**2 * math.cos(angle)) / (AXIAL * rate)
    spin = total - rate * math.cos(angle)
    R = so3.exp(np.array([angle, 0.0, 0.0]))
    r, omega = ARM * R[:, 2], rate * E_3 + spin * R[:, 2]
    start = State(r[None], R[None], np.cross(omega, r)[None], (R.T @ omega)[None])

    def exact(begin: State) -> Precession | None:
        """Return the exact motion for this start only: a perturbed one nutates."""
        same = all(np.allclose(getattr(begin, f), getattr(start, f), atol=1e-12) for f in ("r", "R", "v", "Omega"))
        return Precession(begin, rate, spin) if same else None

    return Problem(
        "gyroscope",
        system,
        start,
        t_end=2.0,
        dt=1e-3,
        section="",
        source="steady precession of a symmetric top, any textbook",
        observables=(Observable("height", "Z_C", "m", lambda s: s.r[:, 0, 2]),),
        invariants=(
            Invariant("L_Z", "kg m2/s", lambda s: angular_momentum(system, s)[:, 2]),
            Invariant("Omega_3", "rad/s", lambda s: s.Omega[:, 0, 2]),
        ),
        reference_from=exact,
    )
