"""Pendulum of driven length, pumped like a swing: parametric resonance.

A ball on a massless rod from O whose length is L(t) = l + a sin(w t). Rod and gravity act at its centre C, which moves
as a point mass, and the ball does not turn. With theta from the vertical and N the tension of the rod::

    L theta'' + 2 L' theta' + g sin(theta) = 0,    N = m (L theta'^2 + g cos(theta) - L'')

Small swings grow where w is about twice their own frequency sqrt(g / l) (Landau and Lifshitz, Mechanics, 27). Numbers
chosen. Reference: theta by DOP853, certified by the position of C with N as the multiplier (exact/certification).
"""

import math
from functools import partial
from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.joints import Joint, MovingKind
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import RigidBody, assemble
from ..harness.mechanics.time_functions import TimeFunction, evaluate_functions
from ..harness.mechanics.types import Observable, Problem, Trait
from ..harness.reference.extrapolation import vectorize_rate
from ..harness.reference.orbit import Pair
from .exact import planar
from .exact.certification import CertifiedMotion, certify_orbit

LENGTH = 1.0  # [m], l
RADIUS = 0.1  # [m] radius of the solid ball
GRAVITY = 9.81  # [m/s2]
SOUGHT, SPAN = 20.0, 0.25  # [s] duration to certify, and its chunks
FASTEST = 20.0  # largest tuning with a reference: above, certification takes too long
SAME = 1e-12  # difference of equal starts: rounding of rotated frames


@problem("pumped_pendulum", tests=(Trait.DRIVEN,))
def pumped_pendulum(
    *,
    mass: Annotated[float, Parameter("mass of the ball", "kg", above=0.0)] = 1.0,
    angle: Annotated[float, Parameter("angle of the rod from the vertical at the start, at rest", "deg")] = 10.0,
    amplitude: Annotated[float, Parameter("a, of the length", "m", at_least=0.0)] = 0.1,
    tuning: Annotated[float, Parameter("frequency w by that of small swings", "", above=0.0)] = 2.0,
) -> Problem:
    """Drive the length of a pendulum's rod, by default at twice the frequency of its swings, which then grow."""
    length = TimeFunction((LENGTH,), amplitude, tuning * math.sqrt(GRAVITY / LENGTH))
    ball = RigidBody(mass, 0.4 * mass * RADIUS**2 * np.eye(3), "ball")
    rod = Joint(0, (0, 0, 0), name="rod", kind=MovingKind.DRIVEN_DISTANCE, motion=length)
    numbers = length.numbers()[None]
    start = _find_ball_states(numbers, np.array([[math.radians(angle), 0.0, 0.0]]))[0]
    return Problem(
        "pumped_pendulum",
        assemble([ball], [rod], (0.0, -GRAVITY, 0.0)),
        start,
        t_end=10.0,
        dt=5e-3,
        section="",
        source="chosen",
        observables=(
            Observable("theta", r"\theta", "rad", lambda s: np.arctan2(s.r[:, 0, 0], -s.r[:, 0, 1])),
            Observable("length", "L", "m", lambda s: np.linalg.norm(s.r[:, 0], axis=1)),
        ),
        reference_from=partial(_certify_motion, numbers, start, math.radians(angle)) if tuning <= FASTEST else None,
        planar_normal=np.array([0.0, 0.0, 1.0]),
    )


def _find_ball_states(numbers: Float[np.ndarray, "1 7"], y: Float[np.ndarray, "nt 3"]) -> States:
    """Return the states of the ball from rows ``y`` of theta [rad], theta' [rad/s] and t [s].

    ``numbers`` are the coefficients of the function L(t).
    """
    theta, rate, t = y.T
    L, L_dot, _ = (a[:, 0] for a in evaluate_functions(numbers, t))
    along, across = np.stack((np.sin(theta), -np.cos(theta)), axis=1), np.stack((np.cos(theta), np.sin(theta)), axis=1)
    still = np.zeros((len(y), 1))
    v = L_dot[:, None] * along + (L * rate)[:, None] * across
    return planar.make_planar_states((L[:, None] * along)[:, None], still, v[:, None], still)


def _certify_motion(
    numbers: Float[np.ndarray, "1 7"], own: State, theta: float, start: State
) -> CertifiedMotion | None:
    """Return the certified motion from ``start`` if that is the problem's ``own`` start, else None.

    From another start the ball may turn and leave the plane. ``theta`` [rad] is the angle of the rod at the start,
    ``numbers`` are the coefficients of the function L(t).
    """
    if max(float(np.max(np.abs(getattr(own, n) - getattr(start, n)))) for n in ("r", "R", "v", "Omega")) > SAME:
        return None

    def by_angle(y: np.ndarray) -> np.ndarray:
        """Return the time derivatives of y = (theta, theta', t): route 1."""
        L, L_dot, _ = (float(a[0, 0]) for a in evaluate_functions(numbers, y[2:]))
        return np.array([y[1], -(2.0 * L_dot * y[1] + GRAVITY * np.sin(y[0])) / L, 1.0])

    def by_position(z: np.ndarray) -> np.ndarray:
        """Return the time derivatives of z = (x, y, their rates, t), x and y the position of C: route 2."""
        x, v, g = z[:2], z[2:4], np.array([0.0, -GRAVITY])
        distance, L_ddot = float(np.linalg.norm(x)), float(evaluate_functions(numbers, z[4:])[2][0, 0])
        e = x / distance
        pull = L_ddot - e @ g - (v @ v - (e @ v) ** 2) / distance  # -N / m, from the second derivative of |x| = L
        return np.concatenate((v, g + pull * e, [1.0]))

    def apart(y: np.ndarray, z: np.ndarray) -> float:
        """Return the distance [m] of the two routes' balls."""
        return float(np.linalg.norm(_find_ball_states(numbers, y[None]).r[0, 0, :2] - z[:2]))

    y0, z0 = np.array([theta, 0.0, 0.0]), np.concatenate((own.r[0, :2], own.v[0, :2], [0.0]))
    pair = Pair(by_angle, vectorize_rate(by_position), y0, z0, apart)
    data = repr(("pumped pendulum", GRAVITY, numbers.tolist()))
    return CertifiedMotion(certify_orbit(pair, data, SOUGHT, SPAN), partial(_find_ball_states, numbers))
