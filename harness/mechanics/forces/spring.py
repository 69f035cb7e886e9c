"""Spring and damper along the line of two points."""

from dataclasses import dataclass

from ..declaring import ZERO, ForceDeclaration, PointLoad, length
from ..joints.frames import Vector


@dataclass(frozen=True)
class SpringDamper:
    """Force ``-(k (d - d0) + c d_dot)`` along the line of two points ``p_i``, ``p_j`` [m], ``d`` their distance."""

    i: int
    p_i: Vector
    j: int = -1  # the ground
    p_j: Vector = (0.0, 0.0, 0.0)
    stiffness: float = 0.0  # k [N/m]
    rest_length: float = 0.0  # d0 [m]
    damping: float = 0.0  # c [N s/m]


def push(i, j, p):  # type: ignore[no-untyped-def]
    """Return the force on body i, -(k (l - d0) + c l_dot) d / l at its point x: d = x - y from body j's y, l = |d|."""
    x, y = i.at(p.p_i), j.at(p.p_j)
    d = x - y
    l = length(d)
    rate = d @ (i.velocity(x) - j.velocity(y)) / l
    return PointLoad(-((p.k * (l - p.d0) + p.c * rate) / l) * d, ZERO, x)


KIND = ForceDeclaration(
    "spring",
    {"p_i": (3,), "p_j": (3,), "k": (), "d0": (), "c": ()},
    push,
    "-(k (d - d_0) + c d_dot) along the line of two points",
    "SpringDamper",
    "potential of k; the work of c enters the balance",
)
