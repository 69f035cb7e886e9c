"""Torque-free body with spherical inertia (Sect. 5.1, Figs. 1 to 3): it keeps rotating about its initial axis.

Numbers: Sect. 5.1: three rods of 1 kg and 1 m along the body axes, J = m l^2 / 6 times the identity, held at its
centre by a spherical joint (r = 0), which the motion never loads. ``inertia_factors`` make it Euler's asymmetric body.
Exact: uniform rotation, or theta functions (problems/exact/euler_top).
"""

from functools import partial
from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics import so3
from ..harness.mechanics.motion import angular_momentum
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import Joint, MultibodySystem, RigidBody, assemble
from ..harness.mechanics.types import Invariant, Observable, Problem, Trait
from .exact.one_body import find_one_body_motion

Triple = tuple[float, float, float]


@problem("torque_free_body", tests=(Trait.LONG,))
def torque_free_body(
    *,
    rod_mass: Annotated[float, Parameter("mass of each of the three rods", "kg", above=0.0)] = 1.0,
    rod_length: Annotated[float, Parameter("length of each rod", "m", above=0.0)] = 1.0,
    inertia_factors: Annotated[Triple, Parameter("principal inertias per m l^2/6", "", above=0.0)] = (1.0, 1.0, 1.0),
    angles: Annotated[Triple, Parameter("initial 3-1-3 angles", "deg")] = (0.0, 90.0, 0.0),
    omega: Annotated[Triple, Parameter("initial Omega, body frame", "rad/s")] = (1.0, 2.0, 3.0),
) -> Problem:
    """Rotate three equal crossed rods freely about their fixed centre; unequal ``inertia_factors`` make Euler's top."""
    inertia = rod_mass * rod_length**2 / 6.0 * np.diag(inertia_factors)
    system = assemble([RigidBody(3.0 * rod_mass, inertia, "rods")], [Joint(0, (0.0, 0.0, 0.0), name="O")])
    R = so3.euler313(*np.deg2rad(angles))
    rest = np.zeros((1, 3))
    start = State(rest, R[None], rest, np.array([omega], dtype=float))
    rates = [(f"Omega_{a}", rf"\Omega_{a}", partial(_measure_rate, k)) for k, a in enumerate("xyz")]
    kept = [Invariant(f"L_{a}", "kg m2/s", partial(_measure_momentum, system, k)) for k, a in enumerate("XYZ")]
    if len(set(inertia_factors)) == 1:
        kept += [Invariant(name, "rad/s", of) for name, _, of in rates]
    return Problem(
        "torque_free_body",
        system,
        start,
        t_end=50.0,
        dt=0.1,
        section="Sect. 5.1",
        source="Sect. 5.1",
        observables=(
            *(Observable(name, symbol, "rad/s", of) for name, symbol, of in rates),
            Observable("axis_error", r"\angle(L, L_0)", "rad", partial(_measure_axis_error, system)),
        ),
        invariants=tuple(kept),
        reference_from=partial(find_one_body_motion, system),
    )


def _measure_rate(k: int, s: States) -> Float[np.ndarray, " nt"]:
    """Return component k of Omega, body frame [rad/s]."""
    return s.Omega[:, 0, k]


def _measure_momentum(system: MultibodySystem, k: int, s: States) -> Float[np.ndarray, " nt"]:
    """Return component k of the angular momentum about O, space frame [kg m2/s]."""
    return angular_momentum(system, s)[:, k]


def _measure_axis_error(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """Return the angle [rad] between the angular momentum and that at the start.

    For spherical inertia the angular momentum is along the axis of rotation.
    """
    L = angular_momentum(system, s)
    return np.arctan2(np.linalg.norm(np.cross(L[0], L), axis=1), L @ L[0])  # exact to rounding for small angles
