"""Define joints and the constraint rows of which each kind consists.

With d = r_i + R_i s_i - r_j - R_j s_j, vectors u, w fixed in body i and n_1, n_2 in body j, the rows of a joint are, in
this order::

    point rows   phi = d, three rows                                          the points coincide
    line rows    phi = (R_j n_k) . d;  of a distance (d . d - L^2) / (2 L)    the point of i stays in a plane of j
    axis rows    phi = (R_i u) . (R_j n_k), k = 1, 2, then (R_i w) . (R_j n_2)    directions stay normal to each other
    moving rows  module ``moving_rows``: drives, which are functions of time, and rows that restrict velocities alone
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from importlib import import_module
from numbers import Integral
from pkgutil import iter_modules
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..declaring import Count, JointDeclaration
from ..naming import name_part
from ..time_functions import NONE, TimeFunction
from . import kinds
from .frames import Directions, Vector, normalise, project_normals

__all__ = [
    "DECLARED",
    "KINDS",
    "ROWS",
    "AxisRows",
    "Count",
    "Joint",
    "JointKind",
    "Kind",
    "LineRows",
    "MovingKind",
    "MovingRows",
    "Vector",
    "find_directions",
    "normalise",
    "project_normals",
]


class JointKind(StrEnum):
    """Kinds of joints between bodies, by the freedom that they leave."""

    SPHERICAL = "spherical"  # all rotation
    UNIVERSAL = "universal"  # rotation about axis_i and axis_j, which stay normal to each other
    REVOLUTE = "revolute"  # rotation about the common axis
    FIXED = "fixed"  # nothing
    CYLINDRICAL = "cylindrical"  # rotation about the common axis and sliding along it
    PRISMATIC = "prismatic"  # sliding along the common axis
    ON_LINE = "point on line"  # all rotation, and the point of i along axis_j through the point of j
    ON_PLANE = "point on plane"  # all but the motion of the point of i along axis_j, the normal of a plane of j
    NORMAL = "normal axes"  # all but the angle of axis_i and axis_j, which stay normal to each other
    DISTANCE = "distance"  # all but the distance of the points: a rigid massless link


class MovingKind(StrEnum):
    """Kinds that prescribe a motion by functions of time, or restrict velocities alone."""

    DRIVEN_POSITION = "driven position"  # prescribes the position of the point of i along axis_j, from the point of j
    DRIVEN_ANGLE = "driven angle"  # prescribes the angle of across_i from across_j, about the axis
    DRIVEN_DISTANCE = "driven distance"  # prescribes the distance of the points: a massless link of varying length
    KNIFE_EDGE = "knife edge"  # the point of i has no velocity along axis_i, the normal of the blade, seen from j
    # a disc of radius ``length``, axis axis_i and centre s_i, on the plane of j with normal axis_j
    ROLLING = "rolling disc"


Kind = JointKind | MovingKind | str  # a name in ``kinds``


DECLARED: dict[str, JointDeclaration] = {
    one.name: one
    for one in sorted(
        (import_module(f"{kinds.__name__}.{found.name}").KIND for found in iter_modules(kinds.__path__)),
        key=lambda one: one.number,
    )
}
NAMED: tuple[Kind, ...] = (*JointKind, *MovingKind)
# the kinds in the order of their numbers in systems
KINDS = tuple(next((kind for kind in NAMED if kind == name), name) for name in DECLARED)
ROWS = {kind: DECLARED[kind].count for kind in KINDS}


@dataclass(frozen=True)
class Joint:
    """Points ``s_i``, ``s_j`` [m] from each C (from the origin for the ground), directions in the frames of i and j.

    Without a ``kind`` it is spherical, with the common axis ``axis_i``, ``axis_j`` revolute. A fixed and a prismatic
    joint also need ``across_i``, ``across_j``: one direction, normal to the axis, as seen from either body. A drive
    needs ``motion``, its position, distance [m] or angle [rad]; a knife edge takes one, its velocity across the
    blade [m/s].
    """

    i: int
    s_i: Vector
    j: int = -1  # the ground
    s_j: Vector = (0.0, 0.0, 0.0)
    axis_i: Vector | None = None
    axis_j: Vector | None = None
    name: str = ""
    kind: Kind | str | None = None
    across_i: Vector | None = None
    across_j: Vector | None = None
    length: float = 0.0  # [m] length of a link, radius of a disc
    motion: TimeFunction | None = None
    rows: Sequence[int] | None = None  # rows in force, numbered from 0 in the order above; None: all

    @property
    def sort(self) -> Kind:
        """The kind of the joint: ``kind`` if given, else spherical, or revolute with axes."""
        if self.kind is not None:
            return self.kind
        return JointKind.SPHERICAL if self.axis_i is None and self.axis_j is None else JointKind.REVOLUTE


class LineRows(NamedTuple):
    """All line rows of a system."""

    joint: Int[np.ndarray, " m"]
    row: Int[np.ndarray, " m"]  # row of phi
    n: Float[np.ndarray, "m 3"]  # in body j; zero for a distance
    length: Float[np.ndarray, " m"]  # length of a distance; zero for the others


class AxisRows(NamedTuple):
    """All axis rows of a system."""

    joint: Int[np.ndarray, " m"]
    row: Int[np.ndarray, " m"]  # row of phi
    u: Float[np.ndarray, "m 3"]  # in body i
    n: Float[np.ndarray, "m 3"]  # in body j


class MovingRows(NamedTuple):
    """All joints with moving rows, and their first rows of phi."""

    joint: Int[np.ndarray, " m"]
    row: Int[np.ndarray, " m"]  # its first row of phi
    kind: tuple[Kind, ...]


def name_joint(k: int, joint: Joint) -> str:
    """Return the name of joint ``k`` in messages: the user's own name if it has one, else its number from 0."""
    return name_part("joint", k, joint.name)


def find_directions(k: int, joint: Joint) -> dict[str, Any]:
    """Return what the rows of joint number ``k`` read, by name; raise ValueError for input that does not fit its kind.

    These are unit vectors u, w (3,) in body i and n (3, 3) in body j, zero where no row reads them; length [m]; and
    motion, the seven numbers of its function of time.
    """
    where = name_joint(k, joint)
    try:
        declared = DECLARED[joint.sort]
    except KeyError:
        raise ValueError(f"{where}: kind must be one of {', '.join(ROWS)} (got {joint.kind!r})") from None
    _check_input(where, declared, joint)
    out: dict[str, Any] = {"u": np.zeros(3), "w": np.zeros(3), "n": np.zeros((3, 3)), "length": 0.0}
    out["motion"] = NONE if joint.motion is None else joint.motion.numbers(where)
    if declared.length:
        out["length"] = joint.length
    found = {} if declared.frame is None else declared.frame(Directions(where, joint))
    out["u"] = found.get("u", out["u"])
    if declared.count.axis == 3:
        out["w"] = found["w"]
    n = found.get("n", out["n"])
    out["n"][: len(n)] = n
    return out


def select_rows(k: int, joint: Joint) -> list[Joint]:
    """Return a list of joint number ``k`` alone or, if the user chose ``rows`` of it, of one joint for each of these.

    A point or line row becomes a point on a plane, an axis row becomes normal axes; point rows are along the axes of j.
    Raise ValueError for a kind whose rows cannot be chosen, and for rows that it does not have.
    """
    if joint.rows is None:
        return [joint]
    made, count = find_directions(k, joint), ROWS[joint.sort]
    if count.moving or joint.sort == JointKind.DISTANCE:
        raise ValueError(
            f"{name_joint(k, joint)}: the rows of a {joint.sort} joint cannot be chosen (got {joint.rows!r})"
        )
    ways = [*np.eye(3)[: count.point], *made["n"][: count.line]]
    tilts = [(made["u"], made["n"][0]), (made["u"], made["n"][1]), (made["w"], made["n"][1])][: count.axis]
    plain = replace(joint, across_i=None, across_j=None)
    each = [replace(plain, kind=JointKind.ON_PLANE, axis_i=None, axis_j=way) for way in ways]
    each += [replace(plain, kind=JointKind.NORMAL, axis_i=u, axis_j=n) for u, n in tilts]
    rows = list(joint.rows) if isinstance(joint.rows, Iterable) else []
    whole = all(isinstance(row, Integral) and not isinstance(row, bool) for row in rows)
    if not (rows and whole and len(set(rows)) == len(rows) and set(rows) <= set(range(len(each)))):
        expected = f"distinct whole numbers from 0 to {len(each) - 1}"
        raise ValueError(f"{name_joint(k, joint)}: rows must be {expected} (got {joint.rows!r})")
    name = joint.name or f"joint {k}"
    single = [replace(one, name=f"{name}, row {row}", rows=None) for row, one in enumerate(each)]
    return [single[row] for row in rows]


def _check_input(where: str, declared: JointDeclaration, joint: Joint) -> None:
    """Raise ValueError, naming ``where``, unless the joint has the axes, directions, length and motion of its kind.

    Axes and motions that the kind does not use are refused, too, where they show a misunderstanding.
    """
    sort, ends = declared.name, [joint.axis_i is not None, joint.axis_j is not None]
    if declared.axes == "i" and ends != [True, False]:
        raise ValueError(f"{where}: a {sort} needs axis_i, {declared.note}, and no axis_j")
    driven = bool(declared.motion) and declared.needs_motion
    if (joint.motion is None) == driven and not (declared.motion and not driven):
        needs = "needs a motion, a TimeFunction" if driven else "takes no motion: add a drive beside it"
        raise ValueError(f"{where}: kind {sort} {needs}")
    if not declared.axes and any(ends):
        raise ValueError(f"{where}: a {sort} joint has no axis")
    if declared.axes == "j" and not ends[1]:
        raise ValueError(f"{where}: a {sort} joint needs axis_j")
    if declared.axes == "ij" and not all(ends):
        raise ValueError(f"{where}: give the axis in both bodies or in none")
    if declared.across and (joint.across_i is None or joint.across_j is None):
        raise ValueError(f"{where}: a {sort} joint needs across_i and across_j, one direction seen from both bodies")
    if declared.length and not (np.isfinite(joint.length) and joint.length > 0.0):
        raise ValueError(f"{where}: length must be finite and > 0 m (got {joint.length})")
