"""Slider-crank whose crank is driven: an angle as a function of time, so that no freedom is left.

Numbers chosen. The crank of 0.1 m turns at 10 rad/s with a wobble of 0.2 rad at 7 rad/s; rod of 0.3 m, gravity along
-Y. In the plane OXY on a revolute, a spherical, a universal and a prismatic joint: 17 rows, and one of the drive, whose
torque carries the inertia of all bodies. Exact: x_C = a cos(theta) + sqrt(b^2 - a^2 sin^2(theta)).
"""

from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.joints import Joint, MovingKind
from ..harness.mechanics.state import States
from ..harness.mechanics.system import GROUND, RigidBody, assemble
from ..harness.mechanics.time_functions import TimeFunction, evaluate_functions
from ..harness.mechanics.types import Observable, Problem, Trait
from .exact import planar
from .exact.closed_form import ClosedForm

CRANK, ROD = 0.1, 0.3  # [m]
MASS = (1.0, 1.5, 2.0)  # [kg] crank, rod, slider
AXIAL = 1e-3  # [kg m2] inertia of the bars about their axes
X, Y, Z = np.eye(3)


@problem("driven_slider_crank", tests=(Trait.DRIVEN,))
def driven_slider_crank(
    *,
    rate: Annotated[float, Parameter("mean rate of the crank", "rad/s")] = 10.0,
    wobble: Annotated[float, Parameter("amplitude of the crank's wobble", "rad", at_least=0.0)] = 0.2,
    wobble_rate: Annotated[float, Parameter("circular frequency of the wobble", "rad/s", at_least=0.0)] = 7.0,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
) -> Problem:
    """Drive the crank of a slider-crank by a function of time, so that no freedom is left.

    The motion is known from kinematics; the torque of the drive is a reaction that solvers compute.
    """
    angle = TimeFunction((0.5, rate), wobble, wobble_rate)
    end, half = np.array([0.5 * CRANK, 0.0, 0.0]), np.array([0.5 * ROD, 0.0, 0.0])
    bodies = [
        planar.make_slender_bar(MASS[0], CRANK, AXIAL, "crank"),
        planar.make_slender_bar(MASS[1], ROD, AXIAL, "rod"),
        RigidBody(MASS[2], 1e-3 * np.eye(3), "slider"),
    ]
    joints = [
        Joint(0, -end, GROUND, (0, 0, 0), Y, Z, "O"),
        Joint(1, -half, 0, end, name="B"),
        Joint(1, half, 2, (0, 0, 0), Z, Y, "C", "universal"),
        Joint(2, (0, 0, 0), GROUND, (0, 0, 0), X, X, "guide", "prismatic", Y, Z),
        Joint(0, -end, GROUND, (0, 0, 0), Y, Z, "drive", MovingKind.DRIVEN_ANGLE, X, X, motion=angle),
    ]
    numbers = angle.numbers()[None]

    def motion(t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s], by the kinematics of the slider-crank from the angle of the crank."""
        theta, theta_dot, _ = (a[:, 0] for a in evaluate_functions(numbers, t))
        cosine, sine = np.cos(theta), np.sin(theta)
        beta = -np.arcsin(CRANK / ROD * sine)
        beta_dot = -CRANK * cosine * theta_dot / (ROD * np.cos(beta))
        B, B_dot = CRANK * np.stack((cosine, sine)), CRANK * theta_dot * np.stack((-sine, cosine))
        x = B[0] + ROD * np.cos(beta)
        x_dot = B_dot[0] - ROD * np.sin(beta) * beta_dot
        C, C_dot = (np.stack((a, np.zeros(len(t)))) for a in (x, x_dot))
        centre, velocity = (
            np.stack((0.5 * b, 0.5 * (b + c), c)).transpose(2, 0, 1) for b, c in ((B, C), (B_dot, C_dot))
        )
        still = np.zeros(len(t))
        turned, turning = (np.stack(a, axis=1) for a in ((theta, beta, still), (theta_dot, beta_dot, still)))
        return planar.make_planar_states(centre, turned, velocity, turning)

    exact = ClosedForm("closed form: kinematics of the slider-crank", motion, 1.0, CRANK * abs(rate))
    return Problem(
        "driven_slider_crank",
        assemble(bodies, joints, (0.0, -gravity, 0.0)),
        exact.start(),
        t_end=2.0,
        dt=1e-3,
        section="",
        source="chosen",
        observables=(
            Observable("slider_x", "X_C", "m", lambda s: s.r[:, 2, 0]),
            Observable("rod_y", "Y_{rod}", "m", lambda s: s.r[:, 1, 1]),
        ),
        reference_from=exact.match_start,
        planar_normal=Z,
    )
