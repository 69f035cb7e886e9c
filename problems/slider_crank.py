"""Slider-crank, planar or spatial: a standard textbook mechanism.

Spatial: IFToMM's rigid slider-crank (github jgerstmayr/EXUDYN, TestModels/sliderCrank3Dbenchmark.py): crank of 0.08 m
and 0.12 kg about X at (0, 0.1, 0.12), upright at the start with 6 rad/s; rod of 0.3 m and 0.5 kg on a spherical joint
B and a universal joint at the slider of 2 kg, which slides along X from 0.2 m at 0.24 m/s; gravity along -Z, 5 s. The
cross has X of the slider: then the rod starts with the published rates (1.92, -0.96, 0.48) rad/s.
Planar: numbers chosen, in OXZ, the same masses; revolute joints, three of whose rows are redundant.
Reference: computed.
"""

from typing import Annotated

import numpy as np

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.jacobian import constraint_jacobian
from ..harness.mechanics.motion import point_position
from ..harness.mechanics.state import State
from ..harness.mechanics.system import GROUND, Joint, MultibodySystem, RigidBody, assemble
from ..harness.mechanics.types import Observable, Problem

MASS = (0.12, 0.5, 2.0)  # [kg] crank, rod, slider
CRANK, ROD = np.diag([1e-4, 1e-4, 1e-5]), np.diag([4e-4, 4e-3, 4e-3])  # [kg m2] about C, rod along x
SLIDER = 1e-4 * np.eye(3)  # [kg m2]
X, Y, Z = np.eye(3)
TURN = np.array([X, Z, -Y]).T  # frame of crank and slider: body y along Z, far from singular 3-1-3 angles


@problem("slider_crank")
def slider_crank(
    *,
    variant: Annotated[str, Parameter("shape", "", choices=("spatial", "planar"))] = "spatial",
    rate: Annotated[float, Parameter("angular velocity of the crank at the start", "rad/s")] = 6.0,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Couple crank, rod and slider by joints that leave one degree of freedom, and let the crank turn.

    The spatial variant has a revolute, a spherical, a universal and a prismatic joint, the planar one has three
    revolute joints and a prismatic one.
    """
    planar = variant == "planar"
    O = np.zeros(3) if planar else np.array([0.0, 0.1, 0.12])
    axis = Y if planar else X
    B = O + 0.08 * Z
    C = np.array([np.sqrt(0.3**2 - 0.08**2), 0.0, 0.0]) if planar else np.array([0.2, 0.0, 0.0])
    along = (C - B) / np.linalg.norm(C - B)
    across = np.cross(along, Z if planar else X)
    across /= np.linalg.norm(across)
    rod = np.stack((along, across, np.cross(along, across)), axis=1)
    R = np.stack((TURN, rod, TURN))
    inertia = (TURN.T @ CRANK @ TURN, ROD, SLIDER)
    bodies = [RigidBody(m, J, n) for m, J, n in zip(MASS, inertia, ("crank", "rod", "slider"), strict=True)]
    end, half = TURN.T @ (0.04 * Z), np.array([0.15, 0.0, 0.0])
    joints = [Joint(0, -end, GROUND, O, TURN.T @ axis, axis, "O")]
    if planar:
        joints += [
            Joint(1, -half, 0, end, rod.T @ Y, TURN.T @ Y, "B"),
            Joint(1, half, 2, (0, 0, 0), rod.T @ Y, TURN.T @ Y, "C"),
        ]
    else:
        joints += [
            Joint(1, -half, 0, end, name="B"),
            Joint(1, half, 2, (0, 0, 0), rod.T @ across, TURN.T @ X, "C", "universal"),
        ]
    joints += [Joint(2, (0, 0, 0), GROUND, (0, 0, 0), TURN.T @ X, X, "guide", "prismatic", TURN.T @ Z, Z)]
    system = assemble(bodies, joints, (0.0, 0.0, -gravity))
    r, rest = np.stack((0.5 * (O + B), 0.5 * (B + C), C)), np.zeros((3, 3))
    return Problem(
        "slider_crank",
        system,
        _set_crank_rate(system, State(r, R, rest, rest), TURN.T @ axis, rate),
        t_end=5.0,
        dt=2e-3,
        section="",
        source="IFToMM spatial rigid slider-crank; planar: chosen",
        observables=(
            Observable("slider_x", "X_C", "m", lambda s: s.r[:, 2, 0]),
            Observable("B_y", "Y_B", "m", lambda s: point_position(s, 0, end)[:, 1]),
            Observable("B_z", "Z_B", "m", lambda s: point_position(s, 0, end)[:, 2]),
        ),
        planar_normal=Y if planar else None,
    )


def _set_crank_rate(system: MultibodySystem, still: State, axis: np.ndarray, rate: float) -> State:
    """Return the state in the poses of ``still`` in which the crank turns at ``rate`` [rad/s] about ``axis``.

    ``axis`` is a unit vector in the crank's frame. The state is unique, as the mechanism has one degree of freedom.
    """
    A = constraint_jacobian(system, still).toarray()
    motion = np.linalg.svd(A)[2][-1].reshape(3, 6)  # spans the null space of A
    motion *= rate / (motion[0, 3:] @ axis)
    return State(still.r, still.R, motion[:, :3], motion[:, 3:])
