"""Stiff flyball governor (IFToMM library, A05): two rods swing out on a turning shaft and lift a slider by springs.

Numbers: A05 (github RehabEngGroup/MBSbenchmarksInOpenSim, A05; EXUDYN Examples/stiffFlyballGovernorKT.py): shaft, rods
1 x 0.01 x 0.01 m of 3000 kg/m3, a slider cube of 0.1 m, points of 5 kg on the rods, springs of 8e5 N/m and dampers
of 4e4 N s/m from the slider to the middles of the rods, 2 pi rad/s, gravity along -Z, 10 s. EXUDYN's
TestModels/stiffFlyballGovernor.py has both times 0.005, 0.16 of the rate and soft joints: it is another problem.
The points are part of the rods here. Eigenvalues at the start -8117, -20 and +-7.35i 1/s. Reference: computed.
"""

from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics import so3
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import GROUND, Joint, RigidBody, SpringDamper, assemble
from ..harness.mechanics.types import Observable, Problem, Trait

LENGTH, SIDE, DENSITY = 1.0, 0.01, 3000.0  # [m], [m], [kg/m3] of shaft and rods
BAR = DENSITY * LENGTH * SIDE**2  # [kg]
ACROSS, ALONG = BAR * (LENGTH**2 + SIDE**2) / 12.0, BAR * SIDE**2 / 6.0  # [kg m2]
CUBE, ARM, REST_LENGTH = 0.1, 0.05, 0.5  # [m]
SLIDER = DENSITY * CUBE**3  # [kg]
X, Y, Z = np.eye(3)


@problem("flyball_governor", tests=(Trait.STIFF, Trait.DAMPED))
def flyball_governor(
    *,
    stiffness: Annotated[float, Parameter("stiffness of each spring", "N/m", above=0.0)] = 8e5,
    damping: Annotated[float, Parameter("damping of each damper", "N s/m", at_least=0.0)] = 4e4,
    point_mass: Annotated[float, Parameter("at the end of each rod", "kg", above=0.0)] = 5.0,
    angle: Annotated[float, Parameter("angle of the rods below the horizontal at the start", "deg")] = 30.0,
    rate: Annotated[float, Parameter("angular velocity of the shaft at the start", "rad/s")] = 2.0 * np.pi,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Model IFToMM A05: a governor with a slider and very stiff spring-dampers, four degrees of freedom."""
    mass = BAR + point_mass
    out = (0.5 * BAR + point_mass) * LENGTH / mass  # distance of C from the hinge
    across = ACROSS + BAR * (out - 0.5 * LENGTH) ** 2 + point_mass * (LENGTH - out) ** 2
    rod = np.diag([ALONG, across, across])
    bodies = [
        RigidBody(BAR, np.diag([ACROSS, ACROSS, ALONG]), "shaft"),
        RigidBody(SLIDER, np.eye(3) * SLIDER * CUBE**2 / 6.0, "slider"),
        RigidBody(mass, rod, "rod 1"),
        RigidBody(mass, rod, "rod 2"),
    ]
    top, hinge = 0.5 * LENGTH * Z, (-out, 0.0, 0.0)
    middle = (0.5 * LENGTH - out, 0.0, 0.0)
    joints = [
        Joint(0, -top, GROUND, np.zeros(3), Z, Z, "O"),
        Joint(1, np.zeros(3), 0, np.zeros(3), Z, Z, "guide", "prismatic", X, X),
        Joint(2, hinge, 0, top + ARM * X, Y, Y, "hinge 1"),
        Joint(3, hinge, 0, top - ARM * X, Y, -Y, "hinge 2"),
    ]
    springs = [
        SpringDamper(1, side * ARM * X, 2 + k, middle, stiffness, REST_LENGTH, damping)
        for k, side in enumerate((1.0, -1.0))
    ]
    a, half_turn = np.deg2rad(angle), np.diag([-1.0, -1.0, 1.0])
    down = so3.exp(a * Y)  # body x along the rod, pointing out and down
    R = np.stack((np.eye(3), np.eye(3), down, half_turn @ down))
    reach = top + top + ARM * X + out * down[:, 0]
    r = np.stack((top, top, reach, half_turn @ reach))
    turn = rate * Z
    start = State(r, R, np.cross(turn, r), np.einsum("bji,j->bi", R, turn))
    return Problem(
        "flyball_governor",
        assemble(bodies, joints, (0.0, 0.0, -gravity), springs),
        start,
        t_end=10.0,
        dt=1e-3,
        section="",
        source="IFToMM library of computational benchmarks, A05",
        observables=(
            Observable("s", "s", "m", lambda s: s.r[:, 1, 2]),
            Observable("alpha", r"\alpha", "rad", _measure_rod_angle),
            Observable("omega", r"\omega", "rad/s", lambda s: s.Omega[:, 0, 2]),
        ),
    )


def _measure_rod_angle(s: States) -> Float[np.ndarray, " nt"]:
    """Return the angle alpha of the first rod below the horizontal [rad]."""
    along = s.R[:, 2, :, 0]
    return np.arctan2(-along[:, 2], np.hypot(along[:, 0], along[:, 1]))
