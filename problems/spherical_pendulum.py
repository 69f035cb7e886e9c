"""Rigid pendulum on a spherical joint (Sect. 5.2, Figs. 4 to 7), released horizontally; with ``omega_z`` it turns spatial.

Numbers: Sect. 5.2: a solid cylinder of 1 kg, length 2 l = 1 m, radius 0.1 m, gravity along -Y. Its inertia about C
follows from these. ``omega_z`` is in the body frame (body z = -Y at the start), which needs
r_dot_C = Omega x (C - O) to be consistent.
"""

from typing import Annotated

import numpy as np

from harness.mechanics import so3
from harness.mechanics.state import State
from harness.mechanics.system import Joint, RigidBody, assemble
from harness.options import Parameter
from harness.registry import problem
from harness.types import Problem


@problem("spherical_pendulum")
def spherical_pendulum(
    *,
    omega_z: Annotated[float, Parameter("initial Omega_z, body frame; 0 is the planar set, 0.1 the spatial one", "rad/s")] = 0.0,
    mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 1.0,
    half_length: Annotated[float, Parameter("l, distance of C from the joint O", "m", above=0.0)] = 0.5,
    radius: Annotated[float, Parameter("radius of the cylinder", "m", above=0.0)] = 0.1,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
) -> Problem:
    """Cylinder on a spherical joint, released horizontally under gravity -Y."""
    axial = 0.5 * mass * radius**2
    transverse = mass * (3.0 * radius**2 + (2.0 * half_length) ** 2) / 12.0
    bar = RigidBody(mass, np.diag([axial, transverse, transverse]), "pendulum")
    system = assemble([bar], [Joint(0, (-half_length, 0.0, 0.0), name="O")], (0.0, -gravity, 0.0))
    R = so3.euler313(0.0, np.pi / 2, 0.0)
    Omega = np.array([0.0, 0.0, omega_z])
    v = R @ np.cross(Omega, [half_length, 0.0, 0.0])
    start = State(np.array([[half_length, 0.0, 0.0]]), R[None], v[None], Omega[None])
    return Problem("spherical_pendulum", system, start, t_end=40.0, dt=1e-2, section="Sect. 5.2", source="Sect. 5.2")
