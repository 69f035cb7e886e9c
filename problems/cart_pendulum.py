"""Double pendulum on a cart: the cart slides along OX, two bars swing below it, and the motion is chaotic.

Numbers chosen: cart of 1 kg, bars of 0.5 kg and 0.5 m, gravity along -Y, both bars horizontal at the start. No force
acts along OX: the momentum is kept. Reference: computed.
"""

from typing import Annotated

import numpy as np

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.motion import linear_momentum, point_position
from ..harness.mechanics.state import State
from ..harness.mechanics.system import GROUND, Joint, RigidBody, assemble
from ..harness.mechanics.types import Invariant, Observable, Problem, Trait
from .exact.planar import AXIS, OZ, make_bar_frames, make_slender_bar

MASS, LENGTH, AXIAL = 0.5, 0.5, 1e-3  # [kg], [m], [kg m2] mass, length and axial inertia of a bar
OX, ALONG = (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)  # in space and in the cart's frame


@problem("cart_pendulum", tests=(Trait.CHAOTIC,))
def cart_pendulum(
    *,
    cart: Annotated[float, Parameter("mass of the cart", "kg", above=0.0)] = 1.0,
    angle: Annotated[float, Parameter("angle of the first bar to OX at the start", "deg")] = 0.0,
    angle_2: Annotated[float, Parameter("angle of the second bar to OX at the start", "deg")] = 0.0,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
) -> Problem:
    """Swing two bars below a cart on a rail, from rest: a chaotic motion in a plane."""
    bodies = [
        RigidBody(cart, 0.01 * np.eye(3), "cart"),
        *(make_slender_bar(MASS, LENGTH, AXIAL, f"bar {k}") for k in (1, 2)),
    ]
    near, far = (-0.5 * LENGTH, 0.0, 0.0), (0.5 * LENGTH, 0.0, 0.0)
    centre = (0.0, 0.0, 0.0)
    joints = [
        Joint(0, centre, GROUND, centre, ALONG, OX, "rail", "prismatic", AXIS, OZ),
        Joint(1, near, 0, centre, AXIS, AXIS, "A"),
        Joint(2, near, 1, far, AXIS, AXIS, "B"),
    ]
    system = assemble(bodies, joints, (0.0, -gravity, 0.0))
    R = make_bar_frames(np.deg2rad([0.0, angle, angle_2]))
    half = 0.5 * LENGTH * R[:, :, 0]
    rest = np.zeros((3, 3))
    tip = np.array(far)
    return Problem(
        "cart_pendulum",
        system,
        State(np.stack((np.zeros(3), half[1], 2.0 * half[1] + half[2])), R, rest, rest),
        t_end=10.0,
        dt=2e-3,
        section="",
        source="chosen",
        observables=(
            Observable("cart_x", "X_A", "m", lambda s: s.r[:, 0, 0]),
            Observable("tip_x", "X_T", "m", lambda s: point_position(s, 2, tip)[:, 0]),
            Observable("tip_y", "Y_T", "m", lambda s: point_position(s, 2, tip)[:, 1]),
        ),
        invariants=(Invariant("p_X", "kg m/s", lambda s: linear_momentum(system, s)[:, 0]),),
        planar_normal=np.array([0.0, 0.0, 1.0]),
    )
