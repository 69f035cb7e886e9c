"""A point mass on a rigid massless link to the ground: it moves as the end of a massless arm on a ball joint does."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import State, States
from ...harness.mechanics.system import Joint, RigidBody, assemble
from .one_body import one_body_motion
from .pinned import PinnedMotion, frame_with


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


def link_motion(mass: float, length: float, gravity: Float[np.ndarray, " 3"], start: State) -> LinkMotion | None:
    """From any start; the link's other end is the origin."""
    r, v = start.r[0], start.v[0]
    R = frame_with(r)  # of the arm, without spin about it
    system = assemble([RigidBody(mass, np.zeros((3, 3)))], [Joint(0, (0.0, 0.0, -length))], gravity)
    spin = R.T @ np.cross(r, v) / length**2
    arm = one_body_motion(system, State(start.r, R[None], start.v, spin[None]))
    return None if arm is None else LinkMotion(arm, start.R[0])
