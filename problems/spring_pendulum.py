"""Swinging spring: a ball on a spring, tuned so that swinging and bouncing feed each other.

Numbers chosen: a ball of 1 kg, hanging 1 m below O at rest; the bounce is twice as fast as the swing, k l = 4 m g
(Lynch 2002, Int. J. Non-Linear Mech. 37, 345: the resonant swinging spring). No joints. Reference: computed.
"""

from typing import Annotated

import numpy as np

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.motion import angular_momentum
from ..harness.mechanics.state import State
from ..harness.mechanics.system import RigidBody, SpringDamper, assemble
from ..harness.mechanics.types import Invariant, Observable, Problem

RADIUS = 0.05  # [m] radius of the solid ball
HANGING = 1.0  # [m] length of the spring at rest under the weight
GRAVITY = 9.81  # [m/s2]


@problem("spring_pendulum")
def spring_pendulum(
    *,
    mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 1.0,
    tuning: Annotated[float, Parameter("frequency of the bounce by that of the swing", "", above=1.0)] = 2.0,
    drop: Annotated[float, Parameter("depth of the start below the position of rest", "m")] = 0.1,
    aside: Annotated[float, Parameter("distance of the start from the vertical, along OX", "m")] = 0.05,
    speed: Annotated[float, Parameter("at the start, along OZ", "m/s")] = 0.03,
) -> Problem:
    """Hang a ball on a spring without joints; by default its bounce and swing are in 2:1 resonance."""
    stiffness = tuning**2 * mass * GRAVITY / HANGING
    rest_length = HANGING * (1.0 - 1.0 / tuning**2)
    ball = RigidBody(mass, 0.4 * mass * RADIUS**2 * np.eye(3), "ball")
    spring = SpringDamper(0, (0.0, 0.0, 0.0), stiffness=stiffness, rest_length=rest_length)
    system = assemble([ball], (), (0.0, -GRAVITY, 0.0), [spring])
    R = np.array(
        [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    )  # body z = -Y: far from the singular 3-1-3 angles
    start = State(np.array([[aside, -HANGING - drop, 0.0]]), R[None], np.array([[0.0, 0.0, speed]]), np.zeros((1, 3)))
    return Problem(
        "spring_pendulum",
        system,
        start,
        t_end=20.0,
        dt=5e-3,
        section="",
        source="chosen; tuning: Lynch 2002",
        observables=(
            Observable("C_x", "X_C", "m", lambda s: s.r[:, 0, 0]),
            Observable("C_y", "Y_C", "m", lambda s: s.r[:, 0, 1]),
            Observable("C_z", "Z_C", "m", lambda s: s.r[:, 0, 2]),
        ),
        invariants=(Invariant("L_Y", "kg m2/s", lambda s: angular_momentum(system, s)[:, 1]),),
    )
