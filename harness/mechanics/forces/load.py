"""Load: a force and a torque on one body, fixed in space or following the body, times a function of time."""

from dataclasses import dataclass

from ..declaring import ForceDeclaration, PointLoad
from ..joints.frames import Vector
from ..time_functions import TimeFunction


@dataclass(frozen=True)
class Load:
    """A force [N] at ``point`` [m, from C, body frame] and a torque [N m] on body ``i``.

    Both in the space frame, or with ``follows`` in the body's, with which they turn; times ``factor``, if given.
    """

    i: int
    force: Vector = (0.0, 0.0, 0.0)
    torque: Vector = (0.0, 0.0, 0.0)
    point: Vector = (0.0, 0.0, 0.0)
    follows: bool = False
    factor: TimeFunction | None = None  # factor of both; 1 if omitted


def push(i, j, p):  # type: ignore[no-untyped-def]
    """Return the load's force f(t) F at its point, and its torque f(t) T, in space.

    F and T turn with body i if ``p.follows`` is 1; they are fixed in space if it is 0.
    """
    force, torque = (p.follows * i.turn(a) + (1.0 - p.follows) * a for a in (p.force, p.torque))
    return PointLoad(p.factor * force, p.factor * torque, i.at(p.p))


KIND = ForceDeclaration(
    "load",
    {"p": (3,), "force": (3,), "torque": (3,), "follows": (), "factor": ()},
    push,
    "f(t) F at a point, and f(t) T, fixed in space or (`follows`) in the body; f is `factor`",
    "Load",
    "its work enters the balance",
    pair=False,
    depends_on_velocity=False,
    depends_on_time=True,
)
