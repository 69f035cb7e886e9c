"""Revolute joint: a hinge."""

from ...declaring import Count, JointDeclaration, gap, tilts
from ..frames import make_common_axis_frame

KIND = JointDeclaration(
    "revolute",
    2,
    Count(point=3, axis=2),
    leaves="rotation about the common axis",
    equation="d = 0, u . n_1 = u . n_2 = 0",
    axes="ij",
    frame=make_common_axis_frame,
    phi=lambda i, j, p: [*gap(i, j, p), *tilts(i, j, (p.u, p.n[0]), (p.u, p.n[1]))],
)
