"""Rack and pinion: body i, a pinion, turns as far as its centre travels along body j, a rack."""

import numpy as np

from ...declaring import Count, JointDeclaration, gap
from ..frames import frame_ahead


def phi(i, j, p):  # type: ignore[no-untyped-def]
    """Return the row r theta - x [m], taken within half a turn, which no motion leaves.

    x is the travel along across_j, theta the angle from there to across_i.
    """
    e, u, way = -j.turn(p.n[1]), i.turn(p.u), gap(i, j, p)
    rolled = (e @ way) / p.length
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
    frame=frame_ahead,
    phi=phi,
)
