"""Compute the motion of a point mass on a rigid massless link: that of the end of a massless arm on a ball joint."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import State, States
from ...harness.mechanics.types import ReferenceKind
from .balls import apply_matrix, cross, dot, make_frame_about, run_in_balls, scale_vector, to_balls, transpose
from .one_body import find_pinned_motion
from .pinned_body import PinnedBody, PinnedMotion


@dataclass(frozen=True)
class LinkMotion:
    """The motion of the arm's end; the point mass keeps its attitude ``R``, since no torque acts on it."""

    arm: PinnedMotion
    R: Float[np.ndarray, "3 3"]

    @property
    def route(self) -> str:
        """The route of the arm's motion."""
        return self.arm.route

    @property
    def kind(self) -> ReferenceKind:
        """The kind of the arm's motion."""
        return self.arm.kind

    @property
    def horizon(self) -> float:
        """The horizon of the arm's motion [s]."""
        return self.arm.horizon

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s]."""
        s = self.arm.states(t)
        return States(s.r, np.broadcast_to(self.R, s.R.shape), s.v, np.zeros_like(s.Omega))

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a bound on the position error [m]."""
        return self.arm.error(t)


@run_in_balls
def find_link_motion(mass: float, length: float, gravity: Float[np.ndarray, " 3"], start: State) -> LinkMotion | None:
    """Return the exact motion of a point mass on a massless link to the origin; None if no formula is known.

    It begins at position and velocity of ``start``. ``mass`` is in kg, ``length`` in m, ``gravity`` in m/s2 [space].
    """
    r, v = to_balls(start.r[0]), to_balls(start.v[0])
    R = make_frame_about(r)  # frame of the arm, without spin about it
    massless, arm = np.zeros((3, 3)), np.array([0.0, 0.0, length])
    body = PinnedBody(mass, massless, mass * length**2 * np.diag([1.0, 1.0, 0.0]), arm, np.zeros(3), gravity)
    motion = find_pinned_motion(body, R, apply_matrix(transpose(R), scale_vector(cross(r, v), 1 / dot(r, r))))
    return None if motion is None else LinkMotion(motion, start.R[0])
