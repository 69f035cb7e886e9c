"""Heavy top in cuspidal motion (Sect. 5.4, Figs. 10, 11): released at rest but for its spin, it nutates and precesses.

All numbers: Sect. 5.4. I_t and I_a are about the fixed point O, so about C the transverse inertia is I_t - m l^2.
"""

from typing import Annotated

import numpy as np

from harness.mechanics import so3
from harness.mechanics.state import State
from harness.mechanics.system import Joint, RigidBody, assemble
from harness.options import Parameter
from harness.registry import problem
from harness.types import Problem


@problem("heavy_top")
def heavy_top(
    *,
    mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 5.0,
    length: Annotated[float, Parameter("distance of C from the fixed point O", "m", above=0.0)] = 0.1,
    inertia_transverse: Annotated[float, Parameter("I_t about O", "kg m2", above=0.0)] = 0.1,
    inertia_axial: Annotated[float, Parameter("I_a about the axis", "kg m2", above=0.0)] = 0.01,
    theta0: Annotated[float, Parameter("initial nutation angle", "deg")] = 20.0,
    spin: Annotated[float, Parameter("initial Omega_z", "rad/s")] = 50.0,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Lagrange top released at theta0 with spin about its axis; nutates between 20 and 138.93 deg."""
    about_C = inertia_transverse - mass * length**2
    top = RigidBody(mass, np.diag([about_C, about_C, inertia_axial]), "top")
    system = assemble([top], [Joint(0, (0.0, 0.0, -length), name="O")], (0.0, 0.0, -gravity))
    R = so3.euler313(0.0, np.deg2rad(theta0), 0.0)
    rest = np.zeros((1, 3))
    start = State(length * R[None, :, 2], R[None], rest, np.array([[0.0, 0.0, spin]]))
    return Problem("heavy_top", system, start, t_end=5.0, dt=1e-3, section="Sect. 5.4", source="Sect. 5.4")
