"""Asymmetric body thrown in the air: no joints, C on a parabola, the attitude that of Euler's top.

Numbers chosen: a brick of 3 kg, 0.6 x 0.4 x 0.2 m, turning near its middle axis, where it tumbles (Dzhanibekov).
Exact: the parabola and theta functions (problems/exact/euler_top).
"""

import math
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics import so3
from ..harness.mechanics.motion import angular_momentum
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import MultibodySystem, RigidBody, assemble
from ..harness.mechanics.types import Invariant, Observable, Problem, ReferenceKind
from .exact.balls import find_nearest_rotation, run_in_balls, to_balls
from .exact.one_body import find_pinned_motion
from .exact.pinned_body import FINAL, PinnedBody, PinnedMotion
from .exact.theta import UNIT

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class ThrownBody:
    """The parabola of C and the motion about it."""

    about_C: PinnedMotion
    r0: Float[np.ndarray, " 3"]  # [m] C at the start
    v0: Float[np.ndarray, " 3"]  # [m/s]
    gravity: Float[np.ndarray, " 3"]
    horizon: float = math.inf

    @property
    def route(self) -> str:
        """The route of C and of the attitude."""
        return f"parabola of C and {self.about_C.route}"

    @property
    def kind(self) -> ReferenceKind:
        """The kind of the attitude's motion; the parabola is proved."""
        return self.about_C.kind

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s]; the parabola is computed in extended precision and rounded."""
        s, t = self.about_C.states(t), np.asarray(t, dtype=np.longdouble)[:, None]
        r, v = self.r0 + self.v0 * t + self.gravity * t**2 / 2, self.v0 + self.gravity * t
        return States(r.astype(float)[:, None], s.R, v.astype(float)[:, None], s.Omega)

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a bound on the position error [m] at ``t`` [s]: that of the attitude, and the rounding of C.

        C is computed with 64 bits and rounded to float64.
        """
        t = np.asarray(t, dtype=float)
        size = np.linalg.norm(self.r0) + np.linalg.norm(self.v0) * np.abs(t) + np.linalg.norm(self.gravity) * t**2
        r = self.r0 + self.v0 * t[:, None] + 0.5 * self.gravity * t[:, None] ** 2
        rounding = FINAL * np.maximum.accumulate(np.linalg.norm(r, axis=1))  # the bound does not decrease
        return self.about_C.error(t) + rounding + 8.0 * UNIT * size


@problem("free_body")
def free_body(
    *,
    mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 3.0,
    sides: Annotated[Triple, Parameter("edges of the brick along body x, y, z", "m", above=0.0)] = (0.6, 0.4, 0.2),
    velocity: Annotated[Triple, Parameter("velocity of C at the start", "m/s")] = (2.0, 0.0, 24.525),
    omega: Annotated[Triple, Parameter("initial Omega, body frame", "rad/s")] = (0.05, 6.0, 0.1),
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Throw a brick without joints so that it tumbles about its middle axis."""
    square = np.array(sides) ** 2
    body = RigidBody(mass, mass / 12.0 * np.diag(np.sum(square) - square), "brick")
    system = assemble([body], (), (0.0, 0.0, -gravity))
    R = so3.euler313(0.0, np.pi / 2, 0.0)
    start = State(np.zeros((1, 3)), R[None], np.array([velocity]), np.array([omega]))
    return Problem(
        "free_body",
        system,
        start,
        t_end=5.0,
        dt=1e-2,
        section="",
        source="chosen; Euler's top: Whittaker, Analytical Dynamics, sect. 69",
        observables=(
            Observable("C_z", "Z_C", "m", lambda s: s.r[:, 0, 2]),
            *(
                Observable(f"Omega_{a}", rf"\Omega_{a}", "rad/s", partial(_measure_rate, k))
                for k, a in enumerate("xyz")
            ),
        ),
        invariants=tuple(
            Invariant(f"L_{a}_about_C", "kg m2/s", partial(_measure_spin, system, k)) for k, a in enumerate("XYZ")
        ),
        reference_from=partial(_find_exact_motion, system),
    )


def _measure_rate(k: int, s: States) -> Float[np.ndarray, " nt"]:
    """Return component k of Omega, body frame [rad/s]."""
    return s.Omega[:, 0, k]


def _measure_spin(system: MultibodySystem, k: int, s: States) -> Float[np.ndarray, " nt"]:
    """Return component k of the angular momentum about C, space frame [kg m2/s]."""
    at_C = States(np.zeros_like(s.r), s.R, np.zeros_like(s.v), s.Omega)
    return angular_momentum(system, at_C)[:, k]


@run_in_balls
def _find_exact_motion(system: MultibodySystem, start: State) -> ThrownBody | None:
    """Return the exact motion from ``start``; None on the separatrix of Euler's top, which has no formula here."""
    inertia, nowhere = system.inertia[0], np.zeros(3)
    body = PinnedBody(float(system.mass[0]), inertia, inertia, nowhere, nowhere, nowhere)
    about_C = find_pinned_motion(body, find_nearest_rotation(start.R[0]), to_balls(start.Omega[0]))
    return None if about_C is None else ThrownBody(about_C, start.r[0], start.v[0], system.gravity)
