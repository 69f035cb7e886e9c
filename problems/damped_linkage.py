"""Two bars in space with spring-dampers at their joints: the rows of Eq. (32), C_bar and K_bar, are not zero.

Numbers chosen: bars of 1 kg and 1 m; the first on a revolute joint about OZ, the second on a spherical joint at its
end; one spring-damper from the ground to the tip of the second, one between the bars, beside their joint.
Published problems have no damper on a joint's bodies that is soft enough to compare all solvers. Reference: computed.
"""

from typing import Annotated

import numpy as np

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.motion import point_position
from ..harness.mechanics.state import State
from ..harness.mechanics.system import GROUND, Joint, SpringDamper, assemble
from ..harness.mechanics.types import Observable, Problem, Trait
from .exact.planar import AXIS, OZ, make_bar_frames, make_slender_bar

MASS, LENGTH, AXIAL = 1.0, 1.0, 1e-2  # [kg], [m], [kg m2]
POST = (1.0, 1.0, 0.5)  # [m] end of the first spring on the ground


@problem("damped_linkage", tests=(Trait.DAMPED,))
def damped_linkage(
    *,
    stiffness: Annotated[float, Parameter("stiffness of both springs", "N/m", at_least=0.0)] = 40.0,
    damping: Annotated[float, Parameter("damping of both dampers", "N s/m", at_least=0.0)] = 0.5,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
) -> Problem:
    """Release two bars on a revolute and a spherical joint, with a spring-damper to the ground and one between them."""
    bars = [make_slender_bar(MASS, LENGTH, AXIAL, f"bar {k + 1}") for k in range(2)]
    near, far = (-0.5 * LENGTH, 0.0, 0.0), (0.5 * LENGTH, 0.0, 0.0)
    joints = [Joint(0, near, GROUND, (0.0, 0.0, 0.0), AXIS, OZ, "O"), Joint(1, near, 0, far, name="A")]
    springs = [
        SpringDamper(1, far, GROUND, POST, stiffness, 0.8, damping),
        SpringDamper(1, (0.0, 0.1, 0.0), 0, (0.0, 0.1, 0.0), stiffness, 0.5, damping),
    ]
    R = make_bar_frames(np.array([0.0, -0.25 * np.pi]))
    half = 0.5 * LENGTH * R[:, :, 0]
    rest = np.zeros((2, 3))
    tip = np.array(far)
    return Problem(
        "damped_linkage",
        assemble(bars, joints, (0.0, -gravity, 0.0), springs),
        State(np.stack((half[0], 2.0 * half[0] + half[1])), R, rest, rest),
        t_end=10.0,
        dt=5e-3,
        section="",
        source="chosen, for Eq. (32)",
        observables=(
            Observable("tip_x", "X_T", "m", lambda s: point_position(s, 1, tip)[:, 0]),
            Observable("tip_y", "Y_T", "m", lambda s: point_position(s, 1, tip)[:, 1]),
            Observable("tip_z", "Z_T", "m", lambda s: point_position(s, 1, tip)[:, 2]),
        ),
    )
