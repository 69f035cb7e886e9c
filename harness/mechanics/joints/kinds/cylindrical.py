"""Cylindrical joint: a shaft in a bush."""

from ...declaring import Count, JointDeclaration, slides, tilts
from ..frames import make_common_axis_frame

KIND = JointDeclaration(
    "cylindrical",
    4,
    Count(line=2, axis=2),
    leaves="rotation about the common axis and sliding along it",
    equation="n_1 . d = n_2 . d = 0, u . n_1 = u . n_2 = 0",
    axes="ij",
    frame=make_common_axis_frame,
    phi=lambda i, j, p: [*slides(i, j, p, p.n[0], p.n[1]), *tilts(i, j, (p.u, p.n[0]), (p.u, p.n[1]))],
)
