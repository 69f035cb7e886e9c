"""Normal axes: two directions stay normal to each other."""

from ...declaring import Count, JointDeclaration, tilts
from ..frames import make_axis_frame

KIND = JointDeclaration(
    "normal axes",
    13,
    Count(axis=1),
    leaves="all but the angle of axis_i and axis_j, which stay normal to each other",
    equation="u . n_1 = 0",
    axes="ij",
    frame=make_axis_frame,
    phi=lambda i, j, p: tilts(i, j, (p.u, p.n[0])),
)
