"""Knife edge on an inclined plane: the textbook example of a row A(q) v = 0 without phi.

A plate turns uniformly on a plane of 30 deg, its C on a blade along body x that does not slip sideways (Neimark and
Fufaev 1972, Dynamics of Nonholonomic Systems; Bloch 2003, Nonholonomic Mechanics and Control, 1.6). X points down the
slope, Z away from the plane. It does not slide down: C drifts across the slope, along a cycloid where v_0 = 0.

    v = v_0 + g_s sin(w t) / w along the blade,  g_s = g sin(slope)
    X = v_0 sin(w t) / w + g_s (1 - cos(2 w t)) / (4 w^2)
    Y = v_0 (1 - cos(w t)) / w + g_s (t - sin(2 w t) / (2 w)) / (2 w)

Numbers chosen.
"""

from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.joints import Joint, MovingKind
from ..harness.mechanics.state import States
from ..harness.mechanics.system import RigidBody, assemble
from ..harness.mechanics.types import Invariant, Observable, Problem, Trait
from .exact import planar
from .exact.closed_form import ClosedForm

GRAVITY = 9.81  # [m/s2]
INERTIA = np.diag([0.02, 0.04, 0.03])  # [kg m2] of a plate of 1 kg; it turns about y, whose inertia is the largest


@problem("knife_edge", tests=(Trait.NONHOLONOMIC,))
def knife_edge(
    *,
    slope: Annotated[float, Parameter("slope of the plane", "deg", at_least=0.0, at_most=80.0)] = 30.0,
    rate: Annotated[float, Parameter("about the normal of the plane", "rad/s", above=0.0)] = 2.0,
    speed: Annotated[float, Parameter("speed along the blade at the start", "m/s")] = 0.5,
) -> Problem:
    """Release a plate on a blade, which turns uniformly and drifts across the slope of a plane."""
    down, w = float(GRAVITY * np.sin(np.deg2rad(slope))), rate
    joints = [
        Joint(0, (0, 0, 0), axis_j=(0, 0, 1), name="plane", kind="point on plane"),
        Joint(0, (0, 0, 0), axis_i=(0, 0, 1), name="blade", kind=MovingKind.KNIFE_EDGE),
    ]
    gravity = (down, 0.0, -GRAVITY * np.cos(np.deg2rad(slope)))

    def motion(t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s] by the module's equations."""
        along = speed + down / w * np.sin(w * t)
        x = speed * np.sin(w * t) / w + down * (1.0 - np.cos(2.0 * w * t)) / (4.0 * w**2)
        y = speed * (1.0 - np.cos(w * t)) / w + down * (t - np.sin(2.0 * w * t) / (2.0 * w)) / (2.0 * w)
        r, v = np.stack((x, y), axis=1), along[:, None] * np.stack((np.cos(w * t), np.sin(w * t)), axis=1)
        return planar.make_planar_states(r[:, None], (w * t)[:, None], v[:, None], np.full((len(t), 1), w))

    exact = ClosedForm("closed form: cycloid", motion, 1.0 + down / w**2, w + down / w + abs(speed))
    return Problem(
        "knife_edge",
        assemble([RigidBody(1.0, INERTIA, "plate")], joints, gravity),
        exact.start(),
        t_end=10.0,
        dt=5e-3,
        section="",
        source="Neimark and Fufaev 1972; numbers chosen",
        observables=(
            Observable("C_x", "X_C", "m", lambda s: s.r[:, 0, 0]),
            Observable("C_y", "Y_C", "m", lambda s: s.r[:, 0, 1]),
        ),
        invariants=(Invariant("Omega_y", "rad/s", lambda s: s.Omega[:, 0, 1]),),
        reference_from=exact.match_start,
        planar_normal=np.array([0.0, 0.0, 1.0]),
    )
