"""Point on line: a bead on a wire that is fixed in body j."""

from ...declaring import Count, JointDeclaration, slides
from ..frames import make_common_axis_frame

KIND = JointDeclaration(
    "point on line",
    6,
    Count(line=2),
    leaves="all rotation, and the point of i along axis_j through the point of j",
    equation="n_1 . d = n_2 . d = 0",
    axes="j",
    frame=make_common_axis_frame,
    phi=lambda i, j, p: slides(i, j, p, p.n[0], p.n[1]),
)
