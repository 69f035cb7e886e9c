"""Prismatic joint: a slider."""

from ...declaring import Count, JointDeclaration, slides, tilts
from ..frames import make_common_axis_frame

KIND = JointDeclaration(
    "prismatic",
    5,
    Count(line=2, axis=3),
    leaves="sliding along the common axis",
    equation="n_1 . d = n_2 . d = 0, u . n_1 = u . n_2 = w . n_2 = 0",
    axes="ij",
    across=True,
    frame=make_common_axis_frame,
    phi=lambda i, j, p: [
        *slides(i, j, p, p.n[0], p.n[1]),
        *tilts(i, j, (p.u, p.n[0]), (p.u, p.n[1]), (p.w, p.n[1])),
    ],
)
