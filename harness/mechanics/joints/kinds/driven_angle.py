"""Driven angle: the angle between two bodies about an axis follows a function of time."""

import numpy as np

from ...declaring import Count, JointDeclaration
from ..frames import make_angle_frame


def phi(i, j, p):  # type: ignore[no-untyped-def]
    """Return the row u . (n_1 cos f + n_2 sin f) = sin(theta - f) [-]; theta leads from across_j to u = across_i."""
    return [i.turn(p.u) @ j.turn(p.n[0] * np.cos(p.f) + p.n[1] * np.sin(p.f))]


KIND = JointDeclaration(
    "driven angle",
    10,
    Count(moving=1),
    leaves="all but the angle of across_i from across_j, about the axis",
    equation="sin(theta - f(t)) = 0",
    axes="ij",
    across=True,
    motion="rad",
    given="the axis in both bodies, `across_i`, `across_j`, `motion` f [rad]",
    frame=make_angle_frame,
    phi=phi,
    turning=(True,),
)
