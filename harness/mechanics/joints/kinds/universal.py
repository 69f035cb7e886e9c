"""Universal joint: two points coincide, two axes stay normal to each other."""

from ...declaring import Count, JointDeclaration, gap, tilts
from ..frames import make_axis_frame

KIND = JointDeclaration(
    "universal",
    1,
    Count(point=3, axis=1),
    leaves="rotation about axis_i and axis_j, which stay normal to each other",
    equation="d = 0, u . n_1 = 0",
    axes="ij",
    frame=make_axis_frame,
    phi=lambda i, j, p: [*gap(i, j, p), *tilts(i, j, (p.u, p.n[0]))],
)
