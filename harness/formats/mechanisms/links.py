"""Convert links and joints in space, as the readers of SDFormat and USD find them, to a system and its start.

A joint has a frame on each body; where these coincide its coordinate is zero. Joints that close loops are treated like
all others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...catalogue.options import Parameter
from ...mechanics.consistency import project
from ...mechanics.joints import Joint, JointKind
from ...mechanics.joints.frames import choose_normals
from ...mechanics.state import State
from ...mechanics.system import GROUND, MultibodySystem, RigidBody, SpringDamper, TorsionSpring, assemble
from ...mechanics.types import Problem
from .mechanism import BEHIND, T_END, MechanismFile
from .mujoco_bodies import NO_INERTIA
from .rates import complete_velocities, describe_open_joint, keep_velocities


@dataclass(frozen=True)
class Frame:
    """A point p [m] and axes R, in space or in a body."""

    p: Float[np.ndarray, " 3"]
    R: Float[np.ndarray, "3 3"]

    def __matmul__(self, inner: "Frame") -> "Frame":
        """Return the frame ``inner``, given relative to this one, in the coordinates in which this one is given."""
        return Frame(self.p + self.R @ inner.p, self.R @ inner.R)

    def seen_from(self, outer: "Frame") -> "Frame":
        """Return this frame relative to ``outer``, both given in the same coordinates."""
        return Frame(outer.R.T @ (self.p - outer.p), outer.R.T @ self.R)


HOME = Frame(np.zeros(3), np.eye(3))  # the frame of space


@dataclass(frozen=True)
class Link:
    """A body: its centre of mass with the axes of its inertia, in space, and its velocities."""

    name: str
    mass: float  # [kg]
    inertia: Float[np.ndarray, "3 3"]  # about C [kg m2]
    C: Frame
    v: Float[np.ndarray, " 3"]  # [m/s] of C
    omega: Float[np.ndarray, " 3"]  # [rad/s] in space


@dataclass(frozen=True)
class Connection:
    """A joint between links, given by number, with its frame in space as fixed to either link."""

    name: str
    kind: JointKind
    child: int
    parent: int
    in_child: Frame
    in_parent: Frame
    axis: Float[np.ndarray, " 3"]  # in the frame of the joint
    second: Float[np.ndarray, " 3"] | None = None  # axis of a universal joint that turns with the child
    length: float = 0.0  # [m] of a distance
    stiffness: float = 0.0  # [N m/rad or N/m]
    rest: float = 0.0  # [rad or m]
    damping: float = 0.0  # [N m s/rad or N s/m]


class OrderedConnection(NamedTuple):
    """A connection as a joint of body i on body j, of which only j may be the ground."""

    connection: Connection
    frame_i: Frame  # of the joint, relative to C of body i and its axes of inertia
    frame_j: Frame  # the same for body j; in space if that is the ground
    i: int
    j: int
    axis: Float[np.ndarray, " 3"]  # in the frame of the joint; i moves relative to j about or along it


@dataclass(frozen=True)
class LinkMechanism(MechanismFile):
    """A mechanism file that was read as links, connections and gravity."""

    reader: str
    links: Sequence[Link]
    connections: Sequence[Connection]
    gravity: Float[np.ndarray, " 3"]  # [m/s2, space]
    dt: float  # [s] default step
    omitted: Mapping[str, int]  # number of omitted parts, by their kind

    @property
    def doc(self) -> str:
        """The source of the problem: the file, its reader, and what was omitted."""
        return self._describe(self.reader, self.omitted)

    def parameters(self) -> dict[str, tuple[Any, Parameter]]:
        """Return the parameter ``rates``, one for each revolute [rad/s] and prismatic [m/s] joint; none without them.

        All 0, its default, stands for the velocities in the file.
        """
        axes = [c.name for c in self.connections if c.kind in (JointKind.REVOLUTE, JointKind.PRISMATIC)]
        words = f"rates of the joints {', '.join(axes)} at the start; all 0: velocities of the file"
        return {"rates": ((0.0,) * len(axes), Parameter(words, "rad/s, m/s"))} if axes else {}

    def system(self) -> MultibodySystem:
        """Return the system of all links and joints, those that close loops included, with gravity and springs."""
        bodies = [RigidBody(k.mass, _drop_tiny_moments(k.inertia), k.name) for k in self.links]
        ordered = [self._order_bodies(c) for c in self.connections]
        joints = [_make_joint(o) for o in ordered]
        sprung = [o for o in ordered if o.connection.stiffness or o.connection.damping]
        springs = [_make_linear_spring(o) for o in sprung if o.connection.kind is JointKind.PRISMATIC]
        torsions = [_make_torsion_spring(o) for o in sprung if o.connection.kind is JointKind.REVOLUTE]
        return assemble(bodies, joints, self.gravity, springs, torsions=torsions)

    def problem(self, *, rates: Sequence[float] = (), **_: Any) -> Problem:
        """Return the problem that starts at the poses of the file, with its joints closed.

        If any of ``rates`` [rad/s, m/s] (see ``parameters``) is not 0, these replace the velocities of the file. Raise
        ValueError if a joint is open by more than printed digits explain, or if joints do not allow the velocities.
        """
        system = self.system()
        R = np.array([k.C.R for k in self.links])
        v, omega = (np.array([getattr(k, name) for k in self.links]) for name in ("v", "omega"))
        start = State(np.array([k.C.p for k in self.links]), R, v, np.einsum("bji,bj->bi", R, omega))
        if gap := describe_open_joint(system, start):
            raise ValueError(f"{self.path.name}: {gap}")
        if any(rates):
            start = project(system, self._set_rates(system, start, np.array(rates)))
        else:
            start = keep_velocities(system, start, f"{self.path.name}: velocities of centres of mass")
        return Problem(self.name, system, start, T_END, self.dt, "", self.doc)

    def _order_bodies(self, c: Connection) -> OrderedConnection:
        """Return the connection with its child as body i and its parent as body j.

        If the child is the ground, the two change places, and the axis is reversed.
        """
        ends = ((c.in_child, c.child), (c.in_parent, c.parent))
        child, parent = (frame if b == GROUND else frame.seen_from(self.links[b].C) for frame, b in ends)
        if c.child == GROUND:
            return OrderedConnection(c, parent, child, c.parent, c.child, -c.axis)
        return OrderedConnection(c, child, parent, c.child, c.parent, c.axis)

    def _set_rates(self, system: MultibodySystem, start: State, rates: np.ndarray) -> State:
        """Return the start with the nonzero ``rates`` of its joints, and all other velocities as near to 0 as possible.

        ``rates`` has one number for each revolute [rad/s] and prismatic [m/s] joint. Raise ValueError if loops do not
        allow them.
        """
        rows = []  # the rate of a joint is its row times the velocities (v [space], Omega [body]) of all bodies
        for c, _, frame_j, i, j, axis in map(self._order_bodies, self.connections):
            if c.kind not in (JointKind.REVOLUTE, JointKind.PRISMATIC):
                continue
            row = np.zeros((system.nb, 6))
            in_space = frame_j if j == GROUND else self.links[j].C @ frame_j
            a = in_space.R @ axis
            for b, sign in ((i, 1.0), (j, -1.0)):
                if b != GROUND:
                    r, R = self.links[b].C.p, self.links[b].C.R
                    turning, sliding = (0.0 * a, R.T @ a), (a, R.T @ np.cross(in_space.p - r, a))
                    row[b] = sign * np.concatenate(turning if c.kind is JointKind.REVOLUTE else sliding)
            rows.append(row.ravel())
        return complete_velocities(system, start, np.array(rows), rates)


def _drop_tiny_moments(J: np.ndarray) -> np.ndarray:
    """Return the inertia with each principal moment of at most ``NO_INERTIA``, by which files mean none, set to 0."""
    moments, axes = np.linalg.eigh(J)
    return J if np.all(moments > NO_INERTIA) else (axes * np.where(moments > NO_INERTIA, moments, 0.0)) @ axes.T


def _make_joint(ordered: OrderedConnection) -> Joint:
    """Return the joint of a connection between bodies i and j."""
    c, frame_i, frame_j, i, j, axis = ordered
    if c.kind in (JointKind.SPHERICAL, JointKind.DISTANCE):
        return Joint(i, frame_i.p, j, frame_j.p, name=c.name, kind=c.kind, length=c.length)
    if c.kind is JointKind.UNIVERSAL:
        assert c.second is not None
        axis_i, axis_j = (c.second, axis) if i == c.child else (axis, c.second)
        return Joint(i, frame_i.p, j, frame_j.p, frame_i.R @ axis_i, frame_j.R @ axis_j, c.name, c.kind)
    across = choose_normals(axis)[0] if c.kind in (JointKind.FIXED, JointKind.PRISMATIC) else None
    normals = (None, None) if across is None else (frame_i.R @ across, frame_j.R @ across)
    return Joint(i, frame_i.p, j, frame_j.p, frame_i.R @ axis, frame_j.R @ axis, c.name, c.kind, *normals)


def _make_torsion_spring(ordered: OrderedConnection) -> TorsionSpring:
    """Return the torsional spring and damper of a revolute connection, wound by as many turns as at the start."""
    c, frame_i, frame_j, i, j, axis = ordered
    across = choose_normals(axis)[0]
    i_in_space, j_in_space = (c.in_child, c.in_parent) if i == c.child else (c.in_parent, c.in_child)
    e, b = j_in_space.R @ across, j_in_space.R @ np.cross(axis, across)
    u = i_in_space.R @ across
    # the coordinate of the joint, which a pose determines within half a turn of 0
    start = float(np.arctan2(u @ b, u @ e))
    turns = round((start - c.rest) / (2.0 * np.pi))
    n = frame_j.R @ across
    return TorsionSpring(i, frame_i.R @ across, j, frame_j.R @ axis, n, c.stiffness, c.rest, c.damping, turns)


def _make_linear_spring(ordered: OrderedConnection) -> SpringDamper:
    """Return the spring and damper of a prismatic connection, from a point of the axis far behind the body.

    It is so far behind that the spring's length stays positive.
    """
    c, frame_i, frame_j, i, j, axis = ordered
    far = BEHIND * (1.0 + abs(c.rest))
    return SpringDamper(i, frame_i.p, j, frame_j.p - far * (frame_j.R @ axis), c.stiffness, far + c.rest, c.damping)
