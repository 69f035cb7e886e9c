"""Point on plane: the point of i stays in a plane of j."""

from ...declaring import Count, JointDeclaration, slides
from ..frames import make_axis_frame

KIND = JointDeclaration(
    "point on plane",
    7,
    Count(line=1),
    leaves="all but the motion of the point of i along axis_j, the normal of a plane of j",
    equation="n_1 . d = 0",
    axes="j",
    frame=make_axis_frame,
    phi=lambda i, j, p: slides(i, j, p, p.n[0]),
)
