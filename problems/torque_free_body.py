"""Torque-free body with spherical inertia (Sect. 5.1, Figs. 1 to 3): it must keep turning about its first axis.

Numbers: Sect. 5.1: three rods of 1 kg and 1 m along the body axes, J = m l^2 / 6 times the identity, held at its
centre by a spherical joint (r = 0), which the motion never loads.
"""

from typing import Annotated

import numpy as np

from harness.mechanics import so3
from harness.mechanics.state import State
from harness.mechanics.system import Joint, RigidBody, assemble
from harness.options import Parameter
from harness.registry import problem
from harness.types import Problem


@problem("torque_free_body")
def torque_free_body(
    *,
    rod_mass: Annotated[float, Parameter("mass of each of the three rods", "kg", above=0.0)] = 1.0,
    rod_length: Annotated[float, Parameter("length of each rod", "m", above=0.0)] = 1.0,
    omega: Annotated[tuple[float, float, float], Parameter("initial Omega, body frame", "rad/s")] = (1.0, 2.0, 3.0),
) -> Problem:
    """Three equal crossed rods turning freely about a held centre."""
    body = RigidBody(3.0 * rod_mass, rod_mass * rod_length**2 / 6.0 * np.eye(3), "rods")
    system = assemble([body], [Joint(0, (0.0, 0.0, 0.0), name="O")])
    R = so3.euler313(0.0, np.pi / 2, 0.0)
    rest = np.zeros((1, 3))
    start = State(rest, R[None], rest, np.array([omega], dtype=float))
    return Problem("torque_free_body", system, start, t_end=50.0, dt=0.1, section="Sect. 5.1", source="Sect. 5.1")
