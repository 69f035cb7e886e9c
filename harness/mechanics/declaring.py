"""Declare kinds of joints and forces by equations, written once, which numbers evaluate and symbols record.

Vectors are NumPy arrays of three scalars, which may be floats or recorded symbols; declarations use ``+ - * / @``, and
``np.sin``, ``np.cos``, ``np.sqrt``, ``np.arctan2`` of scalars. This module depends on no reader of the equations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

Scalar = Any  # a float, or a symbol that records operations
Vec = np.ndarray  # (3,) of scalars


class Count(NamedTuple):
    """Numbers of rows of a joint, by sort."""

    point: int = 0  # points coincide: 0 or 3
    line: int = 0  # a point stays in a plane, or at a distance
    axis: int = 0  # directions stay normal to each other
    moving: int = 0  # drives, and rows that restrict velocities alone


@dataclass(frozen=True)
class Pose:
    """Pose and velocities of one body: r [m], v [m/s] and omega [rad/s] in space, R (3, 3) body to space."""

    r: Vec
    R: np.ndarray
    v: Vec
    omega: Vec

    def at(self, s: Vec) -> Vec:
        """Return the position in space [m] of the body's point ``s`` [m] (from C, body frame)."""
        return self.r + self.R @ s

    def turn(self, u: Vec) -> Vec:
        """Return a direction ``u`` of the body frame, turned to space."""
        out: Vec = self.R @ u
        return out

    def velocity(self, x: Vec) -> Vec:
        """Return the velocity of the body's material point at ``x`` in space [m/s]."""
        return self.v + cross(self.omega, x - self.r)


@dataclass(frozen=True)
class Numbers:
    """Numbers of one joint: points [m], unit vectors u, w in body i and n (3, 3) in body j, length [m], f(t)."""

    s_i: Vec
    s_j: Vec
    u: Vec
    w: Vec
    n: np.ndarray
    length: Scalar
    f: Scalar


Rows = Callable[[Pose, Pose, Numbers], Sequence[Scalar] | Vec]


@dataclass(frozen=True)
class JointDeclaration:
    """A kind of joint: the user's input, its rows as equations, its sentences for the manual.

    ``phi`` gives rows of poses (and of time, by ``Numbers.f``), ``rates`` the rows after them that restrict velocities
    alone, as phi_dot. ``frame`` turns the user's directions into u, w and n.
    """

    name: str
    number: int  # number in ``MultibodySystem.joint_sort``: stored files depend on it
    count: Count
    leaves: str  # freedom that the joint leaves, for the manual
    equation: str  # for the manual
    phi: Rows = lambda i, j, p: ()
    rates: Rows = lambda i, j, p: ()
    axes: str = ""  # "i", "j" or "ij": bodies for which the user gives an axis
    across: bool = False  # whether across_i and across_j are given
    length: str = ""  # meaning of the length [m], where the user gives one
    motion: str = ""  # unit of the function of time, where the user gives one
    needs_motion: bool = True
    given: str = ""  # the manual's words for the user's input, where the fields do not say it
    note: str = ""  # appended to the required input in an error message
    frame: Callable[..., dict[str, np.ndarray]] | None = None
    turning: Sequence[bool] = field(default=())  # which rows have no unit; by default the axis rows

    @property
    def turns(self) -> tuple[bool, ...]:
        """Flags of the joint's rows that have no unit, whose reactions are torques [N m]."""
        point, line, axis, moving = self.count
        return tuple(self.turning) or (False,) * (point + line) + (True,) * axis + (False,) * moving

    @property
    def is_holonomic(self) -> bool:
        """True if every row has a phi, none restricts velocities alone."""
        return self.rates is JointDeclaration.rates


def cross(a: Vec, b: Vec) -> Vec:
    """Return a x b."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], dtype=np.result_type(a, b)
    )


def gap(i: Pose, j: Pose, p: Numbers) -> Vec:
    """Return d = x_i - x_j [m, space]: from the joint's point x_j of body j to its point x_i of body i."""
    return i.at(p.s_i) - j.at(p.s_j)


def slides(i: Pose, j: Pose, p: Numbers, *ways: Vec) -> list[Scalar]:
    """Return the rows n . d [m] for directions n fixed in body j; d is ``gap``."""
    d = gap(i, j, p)
    return [j.turn(n) @ d for n in ways]


def tilts(i: Pose, j: Pose, *pairs: tuple[Vec, Vec]) -> list[Scalar]:
    """Return the rows u . n [-] for pairs of directions fixed in i and in j, zero where they are normal."""
    return [i.turn(u) @ j.turn(n) for u, n in pairs]


def length(a: Vec) -> Scalar:
    """Return |a|."""
    return np.sqrt(a @ a)


class PointLoad(NamedTuple):
    """A force [N] at a point, and a torque [N m], on body i, all in space; the opposite acts on body j."""

    force: Vec
    torque: Vec
    point: Vec


@dataclass(frozen=True)
class ForceDeclaration:
    """A kind of applied force: the arrays of ``MultibodySystem`` that it reads, and its force and torque as equations.

    ``numbers`` are names and sizes of the arrays that the system holds as ``<name>_<number>``; ``factor`` is a function
    of time.
    """

    name: str
    numbers: dict[str, tuple[int, ...]]
    push: Callable[[Pose, Pose, Any], PointLoad]  # from both poses and the numbers
    equation: str  # for the manual
    part: str  # class that the user writes
    energy: str  # for the manual
    pair: bool = True  # whether it acts between two bodies; a load acts on one
    depends_on_velocity: bool = True
    depends_on_time: bool = False


ZERO = np.zeros(3)
