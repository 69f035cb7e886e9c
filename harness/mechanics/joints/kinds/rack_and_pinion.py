"""Rack and pinion: body i, a pinion, turns as far as its centre travels along body j, a rack."""

import numpy as np

from ...declaring import Count, JointDeclaration, gap
from ..frames import make_angle_frame


def phi(i, j, p):  # type: ignore[no-untyped-def]
    """Return the row r theta - x [m], with theta - x / r taken within half a turn of 0, where a motion keeps it.

    x is the travel of the pinion's centre along across_j, theta the angle from across_j to across_i about the axis.
    """
    e, u, d = -j.turn(p.n[1]), i.turn(p.u), gap(i, j, p)
    rolled = (e @ d) / p.length
    x, y = u @ e, u @ j.turn(p.n[0])
    cosine, sine = np.cos(rolled), np.sin(rolled)
    return [p.length * np.arctan2(y * cosine - x * sine, x * cosine + y * sine)]


KIND = JointDeclaration(
    "rack and pinion",
    15,
    Count(moving=1),
    leaves="all but turning the pinion i without the rack j: its teeth hold",
    equation="r theta - x = 0, x = across_j . d",
    axes="ij",
    across=True,
    length="radius of the pinion",
    frame=make_angle_frame,
    phi=phi,
)
