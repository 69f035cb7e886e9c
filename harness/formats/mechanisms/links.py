"""Convert links and joints in space, as the readers of SDFormat and USD find them, to a system and its start.

A joint has a frame on each body; where these coincide its coordinate is zero. Joints that close loops are treated like
all others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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
from .rates import find_gap, follow_rates, hold_velocities


@dataclass(frozen=True)
class Frame:
    """A point p [m] and axes R, in space or in a body."""

    p: Float[np.ndarray, " 3"]
    R: Float[np.ndarray, "3 3"]

    def __matmul__(self, inner: "Frame") -> "Frame":
        """Return ``inner``, which is given relative to this frame, in the coordinates in which this frame is given."""
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
        """The parts of the file that were read, and those that were omitted."""
        return self._describe(self.reader, self.omitted)

    def parameters(self) -> dict[str, tuple[Any, Parameter]]:
        """Return the parameter for the rates of joints with one axis; all 0 mean the velocities of the file."""
        axes = [c.name for c in self.connections if c.kind in (JointKind.REVOLUTE, JointKind.PRISMATIC)]
        words = f"rates of the joints {', '.join(axes)} at the start; all 0: velocities of the file"
        return {"rates": ((0.0,) * len(axes), Parameter(words, "rad/s, m/s"))} if axes else {}

    def system(self) -> MultibodySystem:
        """Return the system of all links and joints, those that close loops included, with gravity and springs."""
        bodies = [RigidBody(k.mass, _drop_tiny_moments(k.inertia), k.name) for k in self.links]
        sides = [self._find_frames(c) for c in self.connections]
        joints = [_joint(*s) for s in sides]
        turning = [s for s in sides if s[0].kind is JointKind.REVOLUTE and (s[0].stiffness or s[0].damping)]
        sliding = [s for s in sides if s[0].kind is JointKind.PRISMATIC and (s[0].stiffness or s[0].damping)]
        return assemble(
            bodies, joints, self.gravity, [_spring(*s) for s in sliding], torsions=[_torsion(*s) for s in turning]
        )

    def problem(self, **given: Any) -> Problem:
        """Return the problem with velocities of the file, or with ``rates`` of joints if given; its joints are closed.

        Raise ValueError if a joint is open by more than printed digits explain, or if joints do not allow the
        velocities.
        """
        system = self.system()
        R = np.array([k.C.R for k in self.links])
        v, omega = (np.array([getattr(k, name) for k in self.links]) for name in ("v", "omega"))
        start = State(np.array([k.C.p for k in self.links]), R, v, np.einsum("bji,bj->bi", R, omega))
        if gap := find_gap(system, start):
            raise ValueError(f"{self.path.name}: {gap}")
        if any(rates := np.array(given.get("rates", ()))):
            start = project(system, self._set_rates(system, start, rates))
        else:
            start = hold_velocities(system, start, f"{self.path.name}: velocities of centres of mass")
        return Problem(self.name, system, start, T_END, self.dt, "", self.doc)

    def _find_frames(self, c: Connection) -> tuple[Connection, Frame, Frame, int, int, np.ndarray]:
        """Return the connection, its frames relative to the bodies i and j, the numbers i and j, and its axis.

        Body i is the child; if that is the ground it is the parent, and the axis has the opposite direction.
        """
        places = ((c.in_child, c.child), (c.in_parent, c.parent))
        child, parent = (f if b == GROUND else f.seen_from(self.links[b].C) for f, b in places)
        if c.child == GROUND:
            return c, parent, child, c.parent, c.child, -c.axis
        return c, child, parent, c.child, c.parent, c.axis

    def _set_rates(self, system: MultibodySystem, start: State, rates: np.ndarray) -> State:
        """Return the start with the nonzero ``rates`` of its joints, and all other velocities as near to 0 as possible.

        ``rates`` has one number for each revolute [rad/s] and prismatic [m/s] joint. Raise ValueError if loops do not
        allow them.
        """
        rows = []
        for c, _, there, i, j, axis in map(self._find_frames, self.connections):
            if c.kind not in (JointKind.REVOLUTE, JointKind.PRISMATIC):
                continue
            turning, row = c.kind is JointKind.REVOLUTE, np.zeros((system.nb, 6))
            frame = there if j == GROUND else self.links[j].C @ there
            a = frame.R @ axis
            for b, sign in ((i, 1.0), (j, -1.0)):
                if b != GROUND:
                    r, R = self.links[b].C.p, self.links[b].C.R
                    both = (0.0 * a, R.T @ a) if turning else (a, R.T @ np.cross(frame.p - r, a))
                    row[b] = sign * np.concatenate(both)
            rows.append(row.ravel())
        return follow_rates(system, start, np.array(rows), rates)


def _drop_tiny_moments(J: np.ndarray) -> np.ndarray:
    """Return the inertia with principal moments of at most ``NO_INERTIA``, by which files mean none, set to zero."""
    moments, axes = np.linalg.eigh(J)
    return J if np.all(moments > NO_INERTIA) else (axes * np.where(moments > NO_INERTIA, moments, 0.0)) @ axes.T


def _joint(c: Connection, here: Frame, there: Frame, i: int, j: int, axis: np.ndarray) -> Joint:
    """Return the joint of a connection, with frames, bodies and axis as ``_find_frames`` returns them."""
    if c.kind in (JointKind.SPHERICAL, JointKind.DISTANCE):
        return Joint(i, here.p, j, there.p, name=c.name, kind=c.kind, length=c.length)
    if c.kind is JointKind.UNIVERSAL:
        assert c.second is not None
        ways = (c.second, axis) if i == c.child else (axis, c.second)
        return Joint(i, here.p, j, there.p, here.R @ ways[0], there.R @ ways[1], c.name, c.kind)
    across = choose_normals(axis)[0] if c.kind in (JointKind.FIXED, JointKind.PRISMATIC) else None
    sides = (None, None) if across is None else (here.R @ across, there.R @ across)
    return Joint(i, here.p, j, there.p, here.R @ axis, there.R @ axis, c.name, c.kind, *sides)


def _torsion(c: Connection, here: Frame, there: Frame, i: int, j: int, axis: np.ndarray) -> TorsionSpring:
    """Return the torsional spring and damper of a revolute connection, wound by as many turns as at the start."""
    across = choose_normals(axis)[0]
    here_in_space, there_in_space = (c.in_child, c.in_parent) if i == c.child else (c.in_parent, c.in_child)
    e, b = there_in_space.R @ across, there_in_space.R @ np.cross(axis, across)
    u = here_in_space.R @ across
    # the coordinate of the joint, which a pose determines within half a turn of 0
    start = float(np.arctan2(u @ b, u @ e))
    turns = round((start - c.rest) / (2.0 * np.pi))
    return TorsionSpring(i, here.R @ across, j, there.R @ axis, there.R @ across, c.stiffness, c.rest, c.damping, turns)


def _spring(c: Connection, here: Frame, there: Frame, i: int, j: int, axis: np.ndarray) -> SpringDamper:
    """Return the spring and damper of a prismatic connection, from a point of the axis far behind the body.

    It is so far behind that the spring's length stays positive.
    """
    far = BEHIND * (1.0 + abs(c.rest))
    return SpringDamper(i, here.p, j, there.p - far * (there.R @ axis), c.stiffness, far + c.rest, c.damping)
