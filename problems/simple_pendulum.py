"""Simple pendulum in the plane (IFToMM library of computational benchmarks, A01), released horizontally.

Numbers: A01: 1 kg, 1 m, from (-1, 0) at rest, gravity along -Y, 10 s (González, Dopico, Pastorino, Cuadrado;
github RehabEngGroup/MBSbenchmarksInOpenSim, A01_SimplePendulum). By default a small body whose centre of oscillation is
P, ``length`` from the joint: P moves exactly as the point mass; with ``support`` link it is the point mass.
Exact: elliptic functions (problems/exact/lagrange_top), of the same body on a spherical joint.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Annotated

import numpy as np

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.joints import JointKind
from ..harness.mechanics.motion import point_position
from ..harness.mechanics.state import State
from ..harness.mechanics.system import GROUND, Joint, MultibodySystem, RigidBody, assemble
from ..harness.mechanics.types import Observable, Problem, Reference
from .exact.link import find_link_motion
from .exact.one_body import find_one_body_motion
from .exact.pinned_body import PinnedMotion
from .exact.planar import AXIS, OZ, make_bar_frames

IN_PLANE = np.array([[1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])  # entries of R that are not zero


@problem("simple_pendulum")
def simple_pendulum(
    *,
    mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 1.0,
    length: Annotated[float, Parameter("distance of P from the joint", "m", above=0.0)] = 1.0,
    support: Annotated[
        str, Parameter("an arm on a hinge, or a link to a point mass", "", choices=("hinge", "link"))
    ] = "hinge",
    gyration: Annotated[float, Parameter("radius of gyration of the hinged body about C", "m", above=0.0)] = 1e-3,
    angle: Annotated[float, Parameter("angle of the rod to OX at the start", "deg")] = 180.0,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
) -> Problem:
    """Model IFToMM A01: a pendulum equivalent to a point mass on a rod, released from rest, by default horizontally.

    With ``support`` hinge it is a small body on a revolute joint, with link a point mass at a fixed distance from O.
    Raise ValueError if ``gyration`` exceeds half the length.
    """
    if gyration > 0.5 * length:
        raise ValueError(f"gyration must be <= length/2 = {0.5 * length:g} m (got {gyration:g})")
    gyration = gyration if support == "hinge" else 0.0
    arm = 0.5 * (length + math.sqrt(length**2 - 4.0 * gyration**2))  # arm + gyration^2 / arm = length
    body = RigidBody(mass, mass * gyration**2 * np.eye(3), "mass")
    O, foot, weight = (0.0, 0.0, 0.0), (-arm, 0.0, 0.0), np.array([0.0, -gravity, 0.0])
    exact: Callable[[State], Reference | None]
    if support == "hinge":
        joint = Joint(0, foot, GROUND, O, AXIS, OZ, "O")
        exact = partial(_find_planar_motion, assemble([body], [Joint(0, foot)], weight))
    else:
        joint = Joint(0, O, GROUND, O, name="O", kind=JointKind.DISTANCE, length=length)
        exact = partial(find_link_motion, mass, length, weight)
    system = assemble([body], [joint], weight)
    R = make_bar_frames(np.deg2rad([angle]))
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
        reference_from=exact,
        planar_normal=np.array([0.0, 0.0, 1.0]),
    )


def _find_planar_motion(system: MultibodySystem, start: State) -> PinnedMotion | None:
    """Return the exact motion from ``start``; ``system`` has a spherical joint in place of the hinge.

    As a hinge keeps the body in the plane, components of R and Omega out of the plane, which are rounding, are dropped.
    """
    return find_one_body_motion(system, State(start.r, IN_PLANE * start.R, start.v, np.array(AXIS) * start.Omega))
