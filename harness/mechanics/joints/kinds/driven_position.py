"""Driven position: the point of i moves along an axis of j as a function of time prescribes."""

from ...declaring import Count, JointDeclaration, slides
from ..frames import make_axis_frame

KIND = JointDeclaration(
    "driven position",
    9,
    Count(moving=1),
    leaves="all but the motion of the point of i along axis_j, from that of j",
    equation="n_1 . d - f(t) = 0",
    axes="j",
    motion="m",
    frame=make_axis_frame,
    phi=lambda i, j, p: [slides(i, j, p, p.n[0])[0] - p.f],
)
