"""Fixed joint: the two bodies move as one."""

from ...declaring import Count, JointDeclaration, gap, tilts
from ..frames import make_common_axis_frame

KIND = JointDeclaration(
    "fixed",
    3,
    Count(point=3, axis=3),
    leaves="nothing",
    equation="d = 0, u . n_1 = u . n_2 = w . n_2 = 0",
    axes="ij",
    across=True,
    frame=make_common_axis_frame,
    phi=lambda i, j, p: [*gap(i, j, p), *tilts(i, j, (p.u, p.n[0]), (p.u, p.n[1]), (p.w, p.n[1]))],
)
