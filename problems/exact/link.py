"""A point mass on a rigid massless link to the ground: it moves as the end of a massless arm on a ball joint does."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import State, States
from ...harness.types import ReferenceKind
from .balls import apply_matrix, cross, dot, frame_about, in_balls, scale_vector, transpose, vector
from .one_body import pinned_motion
from .pinned_body import PinnedBody, PinnedMotion


@dataclass(frozen=True)
class LinkMotion:
    """The motion of the arm's end; the point mass keeps its attitude ``R``, which nothing acts on."""

    arm: PinnedMotion
    R: Float[np.ndarray, "3 3"]

    @property
    def route(self) -> str:
        """That of the arm."""
        return self.arm.route

    @property
    def kind(self) -> ReferenceKind:
        """That of the arm."""
        return self.arm.kind

    @property
    def horizon(self) -> float:
        """That of the arm [s]."""
        return self.arm.horizon

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """The motion at ``t`` [s]."""
        s = self.arm.states(t)
        return States(s.r, np.broadcast_to(self.R, s.R.shape), s.v, np.zeros_like(s.Omega))

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Bound [m]."""
        return self.arm.error(t)


@in_balls
def link_motion(mass: float, length: float, gravity: Float[np.ndarray, " 3"], start: State) -> LinkMotion | None:
    """From any start; the link's other end is the origin."""
    r, v = vector(start.r[0]), vector(start.v[0])
    R = frame_about(r)  # of the arm, without spin about it
    massless, arm = np.zeros((3, 3)), np.array([0.0, 0.0, length])
    body = PinnedBody(mass, massless, mass * length**2 * np.diag([1.0, 1.0, 0.0]), arm, np.zeros(3), gravity)
    motion = pinned_motion(body, R, apply_matrix(transpose(R), scale_vector(cross(r, v), 1 / dot(r, r))))
    return None if motion is None else LinkMotion(motion, start.R[0])
