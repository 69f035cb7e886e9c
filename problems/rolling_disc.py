"""Rolling disc on a circle without slip, leaning inwards: one row of position, two rows of velocities only.

Numbers: Le Saux, Leine and Glocker 2005 (J. Nonlinear Sci. 15), Eqs. (5.8) to (5.12), as in the package cardillo,
rolling_disc_DMS: m = 0.3048 kg, r = 0.05 m, circle of contact 0.5 m, leaning by 5 deg, J = m r^2 (1/4, 1/2, 1/4) about
the axis y. Steady rolling, rho = r / R::

    gamma_dot^2 = 4 (g / r) sin(beta) / ((6 - 5 rho sin(beta)) rho cos(beta)),   alpha_dot = -rho gamma_dot

Exact: the steady motion; one turn takes 5.852 s and closes the circle.
"""

from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics import so3
from ..harness.mechanics.joints import Joint, MovingKind
from ..harness.mechanics.state import States
from ..harness.mechanics.system import GROUND, RigidBody, assemble
from ..harness.mechanics.types import Observable, Problem, Trait
from .exact.closed_form import ClosedForm

MASS = 0.3048  # [kg]
GRAVITY = 9.81  # [m/s2]


@problem("rolling_disc", tests=(Trait.NONHOLONOMIC,))
def rolling_disc(
    *,
    radius: Annotated[float, Parameter("radius of the disc", "m", above=0.0)] = 0.05,
    circle: Annotated[float, Parameter("radius of the circle of contact points", "m", above=0.0)] = 0.5,
    lean: Annotated[
        float, Parameter("lean of the disc from the vertical, inwards", "deg", above=0.0, at_most=80.0)
    ] = 5.0,
) -> Problem:
    """Roll a disc steadily on a circle, with gravity and gyroscopic torque in balance, for one turn.

    Raise ValueError unless the disc is smaller than the circle.
    """
    if radius >= circle:
        raise ValueError(f"radius must be below circle = {circle:g} m (got {radius:g})")
    rho, beta = radius / circle, np.deg2rad(lean)
    sine, cosine = float(np.sin(beta)), float(np.cos(beta))
    spin = float(np.sqrt(4.0 * GRAVITY / radius * sine / ((6.0 - 5.0 * rho * sine) * rho * cosine)))
    turn = -rho * spin
    disc = RigidBody(MASS, MASS * radius**2 * np.diag([0.25, 0.5, 0.25]), "disc")
    contact = Joint(0, (0, 0, 0), GROUND, (0, 0, 0), (0, 1, 0), (0, 0, 1), "contact", MovingKind.ROLLING, length=radius)

    def motion(t: Float[np.ndarray, " nt"]) -> States:
        """Return the steady motion at ``t`` [s], from directions outwards, ahead and up of the circle of contact."""
        c, s, zero, one = np.cos(turn * t), np.sin(turn * t), np.zeros(len(t)), np.ones(len(t))
        out, ahead, up = (np.stack(a, axis=1) for a in ((c, s, zero), (-s, c, zero), (zero, zero, one)))
        axis, rise = cosine * out + sine * up, cosine * up - sine * out
        B = np.stack((ahead, axis, -rise), axis=2)
        R = B @ so3.exp(np.stack((zero, spin * t, zero), axis=1))
        Omega = np.array([0.0, spin, 0.0]) + turn * R[:, 2]
        way = circle - radius * sine
        r, v = way * out + radius * cosine * up, way * turn * ahead
        return States(r[:, None], R[:, None], v[:, None], Omega[:, None])

    exact = ClosedForm("closed form: steady rolling", motion, 2.0 * circle, circle * (abs(turn) + spin))
    return Problem(
        "rolling_disc",
        assemble([disc], [contact], (0.0, 0.0, -GRAVITY)),
        exact.start(),
        t_end=2.0 * np.pi / abs(turn),
        dt=1e-3,
        section="",
        source="Le Saux, Leine, Glocker 2005; cardillo, rolling_disc_DMS",
        observables=(
            Observable("C_x", "X_C", "m", lambda s: s.r[:, 0, 0]),
            Observable("C_y", "Y_C", "m", lambda s: s.r[:, 0, 1]),
            Observable("C_z", "Z_C", "m", lambda s: s.r[:, 0, 2]),
        ),
        reference_from=exact.match_start,
    )
