"""Gough-Stewart platform: a disc on six telescopic legs, with springs in them and a load that tilts it.

Numbers: the six-legged platform of MathWorks' multibody demo: base radius 3 m, its points at 120 (i - 1) -+ 2.5 deg;
top radius 1 m at a height of 2 m, its points at 60 + 120 (i - 1) -+ 10 deg; steel of 76e3/9.81 kg/m3, a disc of 0.05 m,
legs of a tube 0.05/0.03 m and a rod of 0.05 m, each 0.75 of a leg. Springs, dampers and load chosen: there is no
published motion.
A leg is universal at the base, cylindrical within, spherical at the top. Reference: computed.
"""

import math
from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import GROUND, Joint, Load, RigidBody, SpringDamper, assemble
from ..harness.mechanics.types import Observable, Problem, Trait

BASE, TOP, HEIGHT, DISC = 3.0, 1.0, 2.0, 0.05  # [m]
OUTER, INNER, PART = 0.05, 0.03, 0.75  # [m] radii of the tube (the rod has the outer one); length of tube or rod / leg
DENSITY = 76e3 / 9.81  # [kg/m3]
ORDER = (6, 1, 2, 3, 4, 5)  # top point of each leg
UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # body y of the disc along OZ
SAG = 0.05  # [m] sag of the springs under the whole weight


@problem("stewart_platform", tests=(Trait.DRIVEN, Trait.DAMPED))
def stewart_platform(
    *,
    push: Annotated[float, Parameter("force along OX at the rim of the disc", "N")] = 2000.0,
    twist: Annotated[float, Parameter("torque on the disc about its axis", "N m")] = 500.0,
    damping: Annotated[float, Parameter("damping of each leg", "N s/m", at_least=0.0)] = 500.0,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Load a platform at rest on six legs, each of a tube and a rod on universal, cylindrical and spherical joints."""
    base = _place_on_circle(BASE, [120.0 * k + e for k in range(3) for e in (-2.5, 2.5)], 0.0)
    top = _place_on_circle(TOP, [60.0 + 120.0 * k + e for k in range(3) for e in (-10.0, 10.0)], HEIGHT)
    centre = np.array([0.0, 0.0, HEIGHT])
    mass = DENSITY * math.pi * TOP**2 * DISC
    flat = mass * (3.0 * TOP**2 + DISC**2) / 12.0
    bodies = [RigidBody(mass, np.diag([flat, 0.5 * mass * TOP**2, flat]), "platform")]
    r, R = [centre], [UPRIGHT]
    joints, legs = [], []
    for k in range(6):
        foot, head = base[k], top[ORDER[k] - 1]
        length = float(np.linalg.norm(head - foot))
        frame = _make_leg_frame((head - foot) / length)
        part, lower, upper = PART * length, 2 * k + 1, 2 * k + 2
        bodies += [_make_tube(part, OUTER, INNER, f"tube {k + 1}"), _make_tube(part, OUTER, 0.0, f"rod {k + 1}")]
        r += [foot + 0.5 * part * frame[:, 0], head - 0.5 * part * frame[:, 0]]
        R += [frame, frame]
        near, far = (-0.5 * part, 0.0, 0.0), (0.5 * part, 0.0, 0.0)
        along = (1.0, 0.0, 0.0)
        joints += [
            Joint(lower, near, GROUND, foot, (0.0, 1.0, 0.0), frame[:, 2], f"base {k + 1}", "universal"),
            Joint(upper, near, lower, far, along, along, f"leg {k + 1}", "cylindrical"),
            Joint(upper, far, 0, UPRIGHT.T @ (head - centre), name=f"top {k + 1}"),
        ]
        legs.append((lower, near, upper, far, length))
    weight = 9.81 * sum(b.mass for b in bodies)
    stiffness = weight / (6.0 * SAG)
    springs = [SpringDamper(i, p, j, q, stiffness, length, damping) for i, p, j, q, length in legs]
    loads = [
        Load(0, (push, 0.0, 0.0), point=UPRIGHT.T @ (TOP * np.eye(3)[1])),
        Load(0, torque=(0.0, twist, 0.0), follows=True),
    ]
    rest = np.zeros((13, 3))
    return Problem(
        "stewart_platform",
        assemble(bodies, joints, (0.0, 0.0, -gravity), springs, loads),
        State(np.array(r), np.array(R), rest, rest),
        t_end=2.0,
        dt=1e-3,
        section="",
        source="MathWorks' six-legged platform; springs and load chosen",
        observables=(
            Observable("platform_x", "X_P", "m", lambda s: s.r[:, 0, 0]),
            Observable("platform_z", "Z_P", "m", lambda s: s.r[:, 0, 2]),
            Observable("tilt", r"\theta_P", "rad", _measure_tilt),
        ),
    )


def _place_on_circle(radius: float, degrees: list[float], height: float) -> Float[np.ndarray, "6 3"]:
    """Return six points on a circle about OZ at this height [m], at the angles ``degrees`` [deg] to OX."""
    angle = np.deg2rad(degrees)
    return np.stack((radius * np.cos(angle), radius * np.sin(angle), np.full(6, height)), axis=1)


def _make_leg_frame(along: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return R of a leg: body x in the unit direction ``along`` [space], body z horizontal."""
    z = np.cross(along, [0.0, 0.0, 1.0])
    z /= np.linalg.norm(z)
    return np.stack((along, np.cross(z, along), z), axis=1)


def _make_tube(length: float, outer: float, inner: float, name: str) -> RigidBody:
    """Return a steel tube along body x with this length, outer and inner radius [m]; a rod for an inner radius of 0."""
    mass = DENSITY * math.pi * (outer**2 - inner**2) * length
    square = outer**2 + inner**2
    across = mass * (3.0 * square + length**2) / 12.0
    return RigidBody(mass, np.diag([0.5 * mass * square, across, across]), name)


def _measure_tilt(s: States) -> Float[np.ndarray, " nt"]:
    """Return the angle of the disc's axis to OZ [rad]."""
    axis = s.R[:, 0, :, 1]
    return np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2])
