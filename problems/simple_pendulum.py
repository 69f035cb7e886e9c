"""Simple pendulum in the plane (IFToMM library of computational benchmarks, A01), released horizontally.

Numbers: A01: 1 kg, 1 m, from (-1, 0) at rest, gravity along -Y, 10 s (González, Dopico, Pastorino, Cuadrado;
github RehabEngGroup/MBSbenchmarksInOpenSim, A01_SimplePendulum). A point mass has no inertia to hold an attitude, so
here it is a small body whose centre of oscillation is P, ``length`` from the joint: P moves exactly as the point mass.
Exact: elliptic functions (problems/exact/lagrange_top), of the same body on a spherical joint.
"""

import math
from functools import partial
from typing import Annotated

import numpy as np

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.motion import point_position
from ..harness.mechanics.state import State
from ..harness.mechanics.system import GROUND, Joint, RigidBody, assemble
from ..harness.types import Observable, Problem
from .exact.one_body import one_body_motion
from .exact.planar import AXIS, OZ, frames


@problem("simple_pendulum")
def simple_pendulum(
    *,
    mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 1.0,
    length: Annotated[float, Parameter("distance of P from the joint", "m", above=0.0)] = 1.0,
    gyration: Annotated[float, Parameter("radius of gyration about C; the point mass has none", "m", above=0.0)] = 1e-3,
    angle: Annotated[float, Parameter("of the rod to OX at the start", "deg")] = 180.0,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
) -> Problem:
    """IFToMM A01: a point mass on a rod and a revolute joint, released horizontally."""
    if gyration > 0.5 * length:
        raise ValueError(f"gyration must be <= length/2 = {0.5 * length:g} m (got {gyration:g})")
    arm = 0.5 * (length + math.sqrt(length**2 - 4.0 * gyration**2))  # arm + gyration^2 / arm = length
    body = RigidBody(mass, mass * gyration**2 * np.eye(3), "mass")
    foot, weight = (-arm, 0.0, 0.0), (0.0, -gravity, 0.0)
    system = assemble([body], [Joint(0, foot, GROUND, (0.0, 0.0, 0.0), AXIS, OZ, "O")], weight)
    R = frames(np.deg2rad([angle]))
    rest = np.zeros((1, 3))
    P = np.array([length - arm, 0.0, 0.0])
    return Problem(
        "simple_pendulum",
        system,
        State(arm * R[:, :, 0], R, rest, rest),
        t_end=10.0,
        dt=1e-2,
        section="",
        source="IFToMM library of computational benchmarks, A01",
        observables=(
            Observable("P_x", "X_P", "m", lambda s: point_position(s, 0, P)[:, 0]),
            Observable("P_y", "Y_P", "m", lambda s: point_position(s, 0, P)[:, 1]),
        ),
        reference_from=partial(one_body_motion, assemble([body], [Joint(0, foot)], weight)),
        planar_normal=np.array([0.0, 0.0, 1.0]),
    )
