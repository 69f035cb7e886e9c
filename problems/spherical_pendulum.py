"""Rigid pendulum on a spherical joint (Sect. 5.2, Figs. 4 to 7), released horizontally; ``omega_z`` turns it spatial.

Numbers: Sect. 5.2: a solid cylinder of 1 kg, length 2 l = 1 m, radius 0.1 m, gravity along -Y. Its inertia about C
follows from these. ``omega_z`` is in the body frame (body z = -Y at the start), which needs
r_dot_C = Omega x (C - O) to be consistent; ``literal_start`` keeps the printed r_dot_C = 0 instead, with
|phi_dot| = l omega_z = 0.05 m/s. Exact: it is a Lagrange top (problems/exact/lagrange_top).
"""

from functools import partial
from typing import Annotated

import numpy as np

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics import so3
from ..harness.mechanics.motion import angular_momentum
from ..harness.mechanics.state import State
from ..harness.mechanics.system import Joint, RigidBody, assemble
from ..harness.mechanics.types import Invariant, Observable, Problem
from .exact.one_body import find_one_body_motion


@problem("spherical_pendulum")
def spherical_pendulum(
    *,
    omega_z: Annotated[float, Parameter("initial Omega_z, body; 0: planar set, 0.1: spatial set", "rad/s")] = 0.0,
    omega_x: Annotated[float, Parameter("initial Omega_x, about the bar", "rad/s")] = 0.0,
    omega_y: Annotated[float, Parameter("initial Omega_y, in the plane OXY", "rad/s")] = 0.0,
    angle: Annotated[float, Parameter("initial angle of the bar above OX", "deg")] = 0.0,
    mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 1.0,
    half_length: Annotated[float, Parameter("l, distance of C from the joint O", "m", above=0.0)] = 0.5,
    radius: Annotated[float, Parameter("radius of the cylinder", "m", above=0.0)] = 0.1,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
    literal_start: Annotated[bool, Parameter("C starts at rest as printed, also where Omega opens the joint")] = False,
) -> Problem:
    """Release a cylinder on a spherical joint, by default horizontally, under gravity along -Y."""
    axial = 0.5 * mass * radius**2
    transverse = mass * (3.0 * radius**2 + (2.0 * half_length) ** 2) / 12.0
    bar = RigidBody(mass, np.diag([axial, transverse, transverse]), "pendulum")
    system = assemble([bar], [Joint(0, (-half_length, 0.0, 0.0), name="O")], (0.0, -gravity, 0.0))
    R = so3.euler313(np.deg2rad(angle), np.pi / 2, 0.0)
    Omega = np.array([omega_x, omega_y, omega_z])
    arm = np.array([half_length, 0.0, 0.0])
    v = np.zeros(3) if literal_start else R @ np.cross(Omega, arm)
    start = State((R @ arm)[None], R[None], v[None], Omega[None])
    return Problem(
        "spherical_pendulum",
        system,
        start,
        t_end=40.0,
        dt=1e-2,
        section="Sect. 5.2",
        source="Sect. 5.2",
        observables=(
            Observable("C_x", "X_C", "m", lambda s: s.r[:, 0, 0]),
            Observable("C_y", "Y_C", "m", lambda s: s.r[:, 0, 1]),
            Observable("C_z", "Z_C", "m", lambda s: s.r[:, 0, 2]),  # out of the plane of the release
        ),
        invariants=(
            Invariant("L_Y", "kg m2/s", lambda s: angular_momentum(system, s)[:, 1]),
            Invariant("Omega_x", "rad/s", lambda s: s.Omega[:, 0, 0]),
        ),
        reference_from=partial(find_one_body_motion, system),
        literal_start=literal_start,
        planar_normal=np.array([0.0, 0.0, 1.0]) if omega_x == omega_z == 0.0 else None,
    )
