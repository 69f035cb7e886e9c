"""Torsional spring and damper: the angle from a direction of j to one of i about an axis of j, and their torque.

    theta = atan2(u . b, u . e),  e = across_j, b = axis x e in j, u = across_i in i
    m = (p u x b - q u x e) / (p^2 + q^2),  p = u . e, q = u . b:   theta_dot = m . (omega_i - omega_j)

m is the axis where u is normal to it. A state determines the angle up to whole turns: the law takes it within half a
turn of theta_0, and adds ``wound``, the angle by which the spring is wound there. Motions beyond that are followed turn
by turn (modules ``mechanics.torsion`` and ``catalogue.turns``).
"""

from dataclasses import dataclass

import numpy as np

from ..declaring import ZERO, ForceDeclaration, PointLoad, cross
from ..joints.frames import Vector


@dataclass(frozen=True)
class TorsionSpring:
    """Torque ``-(k (theta - theta_0) + c theta_dot)`` on i about ``axis_j``, the opposite on j.

    theta [rad] is the angle from ``across_j`` to ``across_i`` about the axis: at the start within half a turn of
    theta_0, and ``turns`` whole turns more. From there on it is counted through all turns that the motion makes.
    """

    i: int
    across_i: Vector
    j: int = -1  # the ground
    axis_j: Vector = (0.0, 0.0, 1.0)
    across_j: Vector = (1.0, 0.0, 0.0)
    stiffness: float = 0.0  # k [N m/rad]
    rest_angle: float = 0.0  # theta_0 [rad]
    damping: float = 0.0  # c [N m s/rad]
    turns: int = 0


def push(i, j, p):  # type: ignore[no-untyped-def]
    """Return the torque on body i, -(k (theta - theta_0) + c theta_dot) m, with m as in the module's equations."""
    u, e, b = i.turn(p.u), j.turn(p.n[0]), j.turn(p.n[1])
    x, y = u @ e, u @ b
    m = (x * cross(u, b) - y * cross(u, e)) / (x * x + y * y)
    cosine, sine = np.cos(p.rest), np.sin(p.rest)
    angle = np.arctan2(y * cosine - x * sine, x * cosine + y * sine) + p.wound
    return PointLoad(ZERO, -(p.k * angle + p.c * (m @ (i.omega - j.omega))) * m, i.r)


KIND = ForceDeclaration(
    "torsion",
    {"u": (3,), "n": (2, 3), "k": (), "rest": (), "c": (), "wound": ()},
    push,
    "-(k (theta - theta_0) + c theta_dot) about an axis of j; theta from `across_j` to `across_i`, counted in turns",
    "TorsionSpring",
    "potential of k; the work of c enters the balance",
)
