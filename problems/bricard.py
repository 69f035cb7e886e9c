"""Bricard's mechanism, the rectangular one (IFToMM library, A04): it moves although a count of its rows forbids it.

Numbers: A04: five bars of 1 m and 1 kg, gravity along -Y, from rest, 10 s; the hinges' axes at P0 .. P5 are
Y Z X Y Z X (github RehabEngGroup/MBSbenchmarksInOpenSim, A04: createModel.cpp, modelProperties.h). 30 rows of rank 29
all along the motion. The models in OpenSim and Exudyn give the bars a square section of 0.1 m; the published curve is
that of thin rods (``section`` thin), 1.1e-2 m away at P3 within 10 s. With the default ``axial_inertia`` of 1e-7 kg m2
P3 is 2.5e-8 m away from that of rods without any at 10 s. Reference: computed; with that default to 0.1 s only, since
rounding is amplified by the ratio of the inertias.
"""

from itertools import pairwise
from typing import Annotated

import numpy as np

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.motion import point_position
from ..harness.mechanics.state import State
from ..harness.mechanics.system import GROUND, Joint, RigidBody, assemble
from ..harness.mechanics.types import Observable, Problem, Trait

MASS, LENGTH, SIDE = 1.0, 1.0, 0.1  # [kg], [m], [m]
THIN = 1e-7  # [kg m2] axial inertia of a thin rod
POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]]) * LENGTH
AXES = np.eye(3)[[1, 2, 0, 1, 2, 0]]  # axis of the hinge at each point


@problem("bricard", tests=(Trait.REDUNDANT,))
def bricard(
    *,
    section: Annotated[str, Parameter("cross-section of the bars", "", choices=("square", "thin"))] = "square",
    axial_inertia: Annotated[float, Parameter("inertia of a thin bar about its axis", "kg m2", above=0.0)] = THIN,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
) -> Problem:
    """Model IFToMM A04: a closed loop of five bars and six hinges, with one degree of freedom and one redundant row."""
    thick = section == "square"
    axial = MASS * SIDE**2 / 6.0 if thick else axial_inertia
    across = MASS * (LENGTH**2 + (SIDE**2 if thick else 0.0)) / 12.0
    R = np.stack([_make_bar_frame(b - a) for a, b in pairwise(POINTS)])
    bars = [RigidBody(MASS, np.diag([axial, across, across]), f"bar {k + 1}") for k in range(5)]
    near, far = (-0.5 * LENGTH, 0.0, 0.0), (0.5 * LENGTH, 0.0, 0.0)
    joints = [Joint(0, near, GROUND, POINTS[0], R[0].T @ AXES[0], AXES[0], "P0")]
    joints += [Joint(k, near, k - 1, far, R[k].T @ AXES[k], R[k - 1].T @ AXES[k], f"P{k}") for k in range(1, 5)]
    joints += [Joint(4, far, GROUND, POINTS[5], R[4].T @ AXES[5], AXES[5], "P5")]
    rest = np.zeros((5, 3))
    P3 = np.array(far)  # in the frame of the second bar
    return Problem(
        "bricard",
        assemble(bars, joints, (0.0, -gravity, 0.0)),
        State(0.5 * (POINTS[:-1] + POINTS[1:]), R, rest, rest),
        t_end=10.0,
        dt=5e-3,
        section="",
        source="IFToMM library of computational benchmarks, A04; axial inertia of thin rods chosen",
        observables=(
            Observable("P3_x", "X_{P3}", "m", lambda s: point_position(s, 1, P3)[:, 0]),
            Observable("P3_y", "Y_{P3}", "m", lambda s: point_position(s, 1, P3)[:, 1]),
            Observable("P3_z", "Z_{P3}", "m", lambda s: point_position(s, 1, P3)[:, 2]),
        ),
    )


def _make_bar_frame(along: np.ndarray) -> np.ndarray:
    """Return R of a bar: body x in the direction ``along`` [space], body z normal to OZ, or OX for a steep bar.

    The attitude is then far from the singularity of 3-1-3 angles.
    """
    x = along / np.linalg.norm(along)
    z = np.array([1.0, 0.0, 0.0]) if abs(x[2]) > 0.5 else np.cross(x, [0.0, 0.0, 1.0])
    return np.stack((x, np.cross(z, x), z), axis=1)
