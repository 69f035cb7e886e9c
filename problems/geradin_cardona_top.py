"""Heavy top of Géradin and Cardona: the example that integrators on Lie groups are compared on.

Numbers: github jgerstmayr/EXUDYN, TestModels/heavyTop.py, after Brüls and Cardona 2010 (J. Comput. Nonlinear Dyn. 5):
15 kg, C at (0, 1, 0) from the pin, inertia about C diag(0.234375, 0.46875, 0.234375), R(0) = 1, Omega(0) =
(0, 150, -4.61538), gravity 9.81 along -Z. Exact: Lagrange's top by theta functions (problems/exact/lagrange_top).
"""

from functools import partial
from typing import Annotated

import numpy as np

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.motion import angular_momentum
from ..harness.mechanics.state import State
from ..harness.mechanics.system import Joint, RigidBody, assemble
from ..harness.mechanics.types import Invariant, Observable, Problem
from .exact.one_body import find_one_body_motion

MASS, INERTIA = 15.0, np.diag([0.234375, 0.46875, 0.234375])  # [kg], [kg m2] about C
ARM = np.array([0.0, 1.0, 0.0])  # [m] from the pin to C, body frame


@problem("geradin_cardona_top")
def geradin_cardona_top(
    *,
    spin: Annotated[float, Parameter("initial Omega_y, about the axis", "rad/s")] = 150.0,
    omega_z: Annotated[float, Parameter("initial Omega_z", "rad/s")] = -4.61538,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Release a fast symmetric top on a pin with its axis horizontal."""
    system = assemble([RigidBody(MASS, INERTIA, "top")], [Joint(0, -ARM, name="O")], (0.0, 0.0, -gravity))
    Omega = np.array([0.0, spin, omega_z])
    return Problem(
        "geradin_cardona_top",
        system,
        State(ARM[None], np.eye(3)[None], np.cross(Omega, ARM)[None], Omega[None]),
        t_end=2.0,
        dt=1e-3,
        section="",
        source="EXUDYN TestModels/heavyTop.py, after Brüls and Cardona 2010",
        observables=(
            Observable("C_x", "X_C", "m", lambda s: s.r[:, 0, 0]),
            Observable("C_y", "Y_C", "m", lambda s: s.r[:, 0, 1]),
            Observable("C_z", "Z_C", "m", lambda s: s.r[:, 0, 2]),
        ),
        invariants=(
            Invariant("L_Z", "kg m2/s", lambda s: angular_momentum(system, s)[:, 2]),
            Invariant("Omega_y", "rad/s", lambda s: s.Omega[:, 0, 1]),
        ),
        reference_from=partial(find_one_body_motion, system),
    )
