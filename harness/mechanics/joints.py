"""Kinds of joints, and the constraint rows that each is made of.

With d = r_i + R_i s_i - r_j - R_j s_j, vectors u, w fixed in body i and n_1, n_2 in body j, the rows of a joint are, in
this order::

    point rows   phi = d, three rows                                          the points coincide
    line rows    phi = (R_j n_k) . d;  of a distance (d . d - L^2) / (2 L)    the point of i stays in a plane of j
    axis rows    phi = (R_i u) . (R_j n_k), k = 1, 2, then (R_i w) . (R_j n_2)    directions stay normal to each other
    moving rows  module ``moving_rows``: drives, which are functions of time, and rows of velocities alone
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .time_functions import NONE, TimeFunction

Vector = Sequence[float] | Float[np.ndarray, " 3"]


class JointKind(StrEnum):
    """What a joint leaves free."""

    SPHERICAL = "spherical"  # all rotation
    UNIVERSAL = "universal"  # rotation about axis_i and axis_j, which stay normal to each other
    REVOLUTE = "revolute"  # rotation about the common axis
    FIXED = "fixed"  # nothing
    CYLINDRICAL = "cylindrical"  # rotation about the common axis and sliding along it
    PRISMATIC = "prismatic"  # sliding along the common axis
    ON_LINE = "point on line"  # all rotation, and the point of i along axis_j through the point of j
    ON_PLANE = "point on plane"  # all but the way of the point of i along axis_j, the normal of a plane of j
    NORMAL = "normal axes"  # all but the angle of axis_i and axis_j, which stay normal to each other
    DISTANCE = "distance"  # all but the distance of the points: a rigid massless link


class MovingKind(StrEnum):
    """What prescribes a motion by functions of time, or restricts velocities alone: beside the joints of a pair."""

    DRIVEN_POSITION = "driven position"  # of the point of i along axis_j, from the point of j
    DRIVEN_ANGLE = "driven angle"  # of across_i from across_j, about the axis
    DRIVEN_DISTANCE = "driven distance"  # of the points: a massless link of varying length
    KNIFE_EDGE = "knife edge"  # the point of i has no velocity along axis_i, the normal of the blade, seen from j
    ROLLING = "rolling disc"  # of radius ``length``, axis axis_i and centre s_i, on the plane of j with normal axis_j


Kind = JointKind | MovingKind


class Count(NamedTuple):
    """Rows of a joint."""

    point: int
    line: int
    axis: int
    moving: int = 0


ROWS: dict[Kind, Count] = {
    JointKind.SPHERICAL: Count(3, 0, 0), JointKind.UNIVERSAL: Count(3, 0, 1), JointKind.REVOLUTE: Count(3, 0, 2),
    JointKind.FIXED: Count(3, 0, 3), JointKind.CYLINDRICAL: Count(0, 2, 2), JointKind.PRISMATIC: Count(0, 2, 3),
    JointKind.ON_LINE: Count(0, 2, 0), JointKind.ON_PLANE: Count(0, 1, 0), JointKind.DISTANCE: Count(0, 1, 0),
    MovingKind.DRIVEN_POSITION: Count(0, 0, 0, 1), MovingKind.DRIVEN_ANGLE: Count(0, 0, 0, 1),
    MovingKind.KNIFE_EDGE: Count(0, 0, 0, 1), MovingKind.ROLLING: Count(0, 0, 0, 3),
    JointKind.NORMAL: Count(0, 0, 1), MovingKind.DRIVEN_DISTANCE: Count(0, 0, 0, 1),
}  # fmt: skip
KINDS = tuple(ROWS)  # the order in which a system numbers them: kept numbers depend on it, so add at the end
ONE_AXIS = (JointKind.ON_LINE, JointKind.ON_PLANE, MovingKind.DRIVEN_POSITION)  # need axis_j alone
NO_AXIS = (JointKind.SPHERICAL, JointKind.DISTANCE, MovingKind.DRIVEN_DISTANCE)
ACROSS = (JointKind.FIXED, JointKind.PRISMATIC, MovingKind.DRIVEN_ANGLE)  # need across_i, across_j
LENGTH = (JointKind.DISTANCE, MovingKind.ROLLING)
DRIVES = (MovingKind.DRIVEN_POSITION, MovingKind.DRIVEN_ANGLE, MovingKind.DRIVEN_DISTANCE)


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
    length: float = 0.0  # [m] of a distance, radius of a disc
    motion: TimeFunction | None = None
    rows: Sequence[int] | None = None  # those that hold, numbered from 0 in the order above; None: all

    @property
    def sort(self) -> Kind:
        """``kind``, or what the axes say."""
        if self.kind is not None:
            return MovingKind(self.kind) if self.kind in tuple(MovingKind) else JointKind(self.kind)
        return JointKind.SPHERICAL if self.axis_i is None and self.axis_j is None else JointKind.REVOLUTE


class LineRows(NamedTuple):
    """All line rows of a system."""

    joint: Int[np.ndarray, " m"]
    row: Int[np.ndarray, " m"]  # of phi
    n: Float[np.ndarray, "m 3"]  # in body j; zero for a distance
    length: Float[np.ndarray, " m"]  # of a distance; zero for the others


class AxisRows(NamedTuple):
    """All axis rows of a system."""

    joint: Int[np.ndarray, " m"]
    row: Int[np.ndarray, " m"]
    u: Float[np.ndarray, "m 3"]  # in body i
    n: Float[np.ndarray, "m 3"]  # in body j


class MovingRows(NamedTuple):
    """All joints with moving rows, and their first rows of phi."""

    joint: Int[np.ndarray, " m"]
    row: Int[np.ndarray, " m"]
    kind: tuple[MovingKind, ...]


def title(k: int, joint: Joint) -> str:
    """How messages call joint ``k``, counted from 0: with its name, if it has one."""
    return f"joint {k} ({joint.name})" if joint.name else f"joint {k}"


def directions(k: int, joint: Joint) -> dict[str, Any]:
    """u, w (3,), n (3, 3), length and motion of a checked joint, or ValueError."""
    where = title(k, joint)
    try:
        sort = joint.sort
    except ValueError:
        raise ValueError(f"{where}: kind must be one of {', '.join(ROWS)} (got {joint.kind!r})") from None
    _check_given(where, sort, joint)
    out: dict[str, Any] = {"u": np.zeros(3), "w": np.zeros(3), "n": np.zeros((3, 3)), "length": 0.0}
    out["motion"] = NONE if joint.motion is None else joint.motion.numbers(where)
    if sort in LENGTH:
        out["length"] = joint.length
    if sort == MovingKind.KNIFE_EDGE and joint.axis_i is not None:
        return {**out, "u": unit(joint.axis_i, where)}
    if sort in NO_AXIS or joint.axis_j is None:
        return out
    axis = unit(joint.axis_j, where)
    if sort in (JointKind.ON_PLANE, JointKind.UNIVERSAL, JointKind.NORMAL, MovingKind.DRIVEN_POSITION):
        out["n"][0] = axis
    elif sort == MovingKind.ROLLING:  # the normal of the plane and its two tangents
        out["n"][0], out["n"][1:] = axis, _normals(axis)
    elif sort == MovingKind.DRIVEN_ANGLE:  # axis x across, and what it turns to: axis x (axis x across)
        assert joint.axis_i is not None and joint.across_i is not None and joint.across_j is not None  # checked
        across, ahead = beside(axis, joint.across_j, where)
        out["n"][:2] = ahead, -across
        return {**out, "u": beside(unit(joint.axis_i, where), joint.across_i, where)[0]}
    else:
        out["n"][:2] = _normals(axis) if joint.across_j is None else beside(axis, joint.across_j, where)
    if joint.axis_i is not None:
        out["u"] = unit(joint.axis_i, where)
        if ROWS[sort].axis == 3 and joint.across_i is not None:
            out["w"] = beside(out["u"], joint.across_i, where)[0]
    return out


def chosen(k: int, joint: Joint) -> list[Joint]:
    """The joint, or one of a single row for each of its ``rows``: rows of points along the axes of j."""
    if joint.rows is None:
        return [joint]
    made, count = directions(k, joint), ROWS[joint.sort]
    if count.moving or joint.sort == JointKind.DISTANCE:
        raise ValueError(f"{title(k, joint)}: the rows of a {joint.sort} joint cannot be chosen (got {joint.rows!r})")
    ways = [*np.eye(3)[: count.point], *made["n"][: count.line]]
    tilts = [(made["u"], made["n"][0]), (made["u"], made["n"][1]), (made["w"], made["n"][1])][: count.axis]
    plain = replace(joint, across_i=None, across_j=None)
    each = [replace(plain, kind=JointKind.ON_PLANE, axis_i=None, axis_j=way) for way in ways]
    each += [replace(plain, kind=JointKind.NORMAL, axis_i=u, axis_j=n) for u, n in tilts]
    rows = list(joint.rows) if isinstance(joint.rows, Iterable) else []
    whole = all(isinstance(row, Integral) and not isinstance(row, bool) for row in rows)
    if not (rows and whole and len(set(rows)) == len(rows) and set(rows) <= set(range(len(each)))):
        expected = f"distinct whole numbers from 0 to {len(each) - 1}"
        raise ValueError(f"{title(k, joint)}: rows must be {expected} (got {joint.rows!r})")
    name = joint.name or f"joint {k + 1}"
    single = [replace(one, name=f"{name}, row {row}", rows=None) for row, one in enumerate(each)]
    return [single[row] for row in rows]


def _check_given(where: str, sort: Kind, joint: Joint) -> None:
    ends = [joint.axis_i is not None, joint.axis_j is not None]
    if sort == MovingKind.KNIFE_EDGE:
        if ends != [True, False]:
            raise ValueError(f"{where}: a {sort} needs axis_i, the normal of its blade, and no axis_j")
        return
    if (joint.motion is None) == (sort in DRIVES):
        needs = "needs a motion, a TimeFunction" if sort in DRIVES else "takes no motion: add a drive beside it"
        raise ValueError(f"{where}: kind {sort} {needs}")
    if sort in NO_AXIS and any(ends):
        raise ValueError(f"{where}: a {sort} joint has no axis")
    if sort in ONE_AXIS and not ends[1]:
        raise ValueError(f"{where}: a {sort} joint needs axis_j")
    if sort not in (*NO_AXIS, *ONE_AXIS) and not all(ends):
        raise ValueError(f"{where}: give the axis in both bodies or in none")
    if sort in ACROSS and (joint.across_i is None or joint.across_j is None):
        raise ValueError(f"{where}: a {sort} joint needs across_i and across_j, one direction seen from both bodies")
    if sort in LENGTH and not (np.isfinite(joint.length) and joint.length > 0.0):
        raise ValueError(f"{where}: length must be finite and > 0 m (got {joint.length})")


def unit(a: Vector, where: str) -> Float[np.ndarray, " 3"]:
    """``a`` of length 1, or ValueError."""
    length = float(np.linalg.norm(a))
    if not (np.isfinite(length) and length > 0.0):
        raise ValueError(f"{where}: the axis must have a finite length > 0 (got {list(a)})")
    return np.asarray(a, dtype=float) / length


def _normals(a: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "2 3"]:
    """Two orthonormal normals to the unit vector ``a``: the coordinate direction furthest from it starts the frame."""
    n1 = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    n1 /= np.linalg.norm(n1)
    return np.stack((n1, np.cross(a, n1)))


def beside(a: Float[np.ndarray, " 3"], across: Vector, where: str) -> Float[np.ndarray, "2 3"]:
    """The part of ``across`` normal to the unit vector ``a``, of length 1, and a x that."""
    n1 = np.asarray(across, dtype=float) - (np.asarray(across, dtype=float) @ a) * a
    n1 = unit(n1, f"{where}: across, less its part along the axis")
    return np.stack((n1, np.cross(a, n1)))
