"""Links and joints in space, as readers of SDFormat and USD find them, as a system and its start.

A joint has a frame on either body; where they coincide its coordinate is zero. Joints that close loops are like all
others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ..mechanics.consistency import project
from ..mechanics.jacobian import constraint_jacobian
from ..mechanics.joints import Joint, JointKind
from ..mechanics.joints.frames import normals_of
from ..mechanics.motion import constraint
from ..mechanics.state import State, States
from ..mechanics.system import GROUND, MultibodySystem, RigidBody, SpringDamper, TorsionSpring, assemble
from ..types import Problem
from .mechanism import BEHIND, NEAR, NO_INERTIA, T_END, Mechanism
from .options import Parameter

OPEN = 1e-4  # of the size: joints open by more at the start are an error, by less (data in float32) are closed


@dataclass(frozen=True)
class Frame:
    """A place: a point and axes, in space or in a body."""

    p: Float[np.ndarray, " 3"]
    R: Float[np.ndarray, "3 3"]

    def __matmul__(self, inner: "Frame") -> "Frame":
        return Frame(self.p + self.R @ inner.p, self.R @ inner.R)

    def seen_from(self, outer: "Frame") -> "Frame":
        """The same place in the coordinates of another frame."""
        return Frame(outer.R.T @ (self.p - outer.p), outer.R.T @ self.R)


HOME = Frame(np.zeros(3), np.eye(3))


@dataclass(frozen=True)
class Link:
    """A body: its centre of mass with the axes of its inertia, in space, and velocities there."""

    name: str
    mass: float  # [kg]
    inertia: Float[np.ndarray, "3 3"]  # about C [kg m2]
    C: Frame
    v: Float[np.ndarray, " 3"]  # [m/s] of C
    omega: Float[np.ndarray, " 3"]  # [rad/s] in space


@dataclass(frozen=True)
class Connection:
    """A joint of links by number, with its frame in space as either link carries it."""

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
    damping: float = 0.0


@dataclass(frozen=True)
class LinkMechanism(Mechanism):
    """Links, connections and gravity of a file."""

    reader: str
    links: Sequence[Link]
    connections: Sequence[Connection]
    gravity: Float[np.ndarray, " 3"]
    dt: float
    omitted: Mapping[str, int]

    @property
    def doc(self) -> str:
        """Parts of the file that were read, and those that were not."""
        return self._describe(self.reader, self.omitted)

    def parameters(self) -> dict[str, tuple[Any, Parameter]]:
        """Rates of the joints with one axis; the other velocities are those of the file."""
        axes = [c.name for c in self.connections if c.kind in (JointKind.REVOLUTE, JointKind.PRISMATIC)]
        words = f"rates of the joints {', '.join(axes)} at the start; all 0: velocities of the file"
        return {"rates": ((0.0,) * len(axes), Parameter(words, "rad/s, m/s"))} if axes else {}

    def system(self) -> MultibodySystem:
        """Every joint has its rows."""
        bodies = [RigidBody(k.mass, _without_dust(k.inertia), k.name) for k in self.links]
        sides = [self._sides(c) for c in self.connections]
        joints = [_joint(*s) for s in sides]
        turning = [s for s in sides if s[0].kind is JointKind.REVOLUTE and (s[0].stiffness or s[0].damping)]
        sliding = [s for s in sides if s[0].kind is JointKind.PRISMATIC and (s[0].stiffness or s[0].damping)]
        return assemble(
            bodies, joints, self.gravity, [_spring(*s) for s in sliding], torsions=[_torsion(*s) for s in turning]
        )

    def problem(self, **given: Any) -> Problem:
        """At rest or moving as in the file, unless ``rates`` are given; joints open by rounding are closed."""
        system = self.system()
        R = np.array([k.C.R for k in self.links])
        v, omega = (np.array([getattr(k, name) for k in self.links]) for name in ("v", "omega"))
        start = State(np.array([k.C.p for k in self.links]), R, v, np.einsum("bji,bj->bi", R, omega))
        gaps = np.abs(constraint(system, States.one(start))[0])
        if (gap := float(np.max(gaps, initial=0.0))) > OPEN * max(
            1.0, float(np.max(np.abs(system.joint_s_i), initial=0.0))
        ):
            name = system.joint_names[int(np.searchsorted(system.row_start, np.argmax(gaps), side="right")) - 1]
            raise ValueError(f"{self.path.name}: joint {name} is open at the start by {gap:.3g} (m or rad)")
        if any(rates := np.array(given.get("rates", ()))):
            start = self._moving(system, start, rates)
        return Problem(self.name, system, project(system, start), T_END, self.dt, "", self.doc)

    def _sides(self, c: Connection) -> tuple[Connection, Frame, Frame, int, int, np.ndarray]:
        """Its frames in the bodies i and j; seen from the other body the axis points the other way."""
        places = ((c.in_child, c.child), (c.in_parent, c.parent))
        child, parent = (f if b == GROUND else f.seen_from(self.links[b].C) for f, b in places)
        if c.child == GROUND:
            return c, parent, child, c.parent, c.child, -c.axis
        return c, child, parent, c.child, c.parent, c.axis

    def _moving(self, system: MultibodySystem, start: State, rates: np.ndarray) -> State:
        """Velocities that all joints allow, with the rates that are not 0, and the others as near to 0 as can be."""
        rows = []
        for c, _, there, i, j, axis in map(self._sides, self.connections):
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
        from scipy.linalg import null_space

        free = null_space(constraint_jacobian(system, start).toarray(), rcond=NEAR)
        B, asked = np.array(rows) @ free, rates != 0.0
        y = np.linalg.lstsq(B[asked], rates[asked], rcond=None)[0]
        if np.max(np.abs(B[asked] @ y - rates[asked])) > 1e-6 * np.max(np.abs(rates)):
            raise ValueError("rates: the loops allow no such rates; give fewer, and 0 for the others")
        rest = null_space(B[asked], rcond=NEAR)
        y -= rest @ np.linalg.lstsq(B[~asked] @ rest, B[~asked] @ y, rcond=None)[0]
        x = (free @ y).reshape(-1, 6)
        return State(start.r, start.R, x[:, :3], x[:, 3:])


def _without_dust(J: np.ndarray) -> np.ndarray:
    """The inertia, zero where it stands for none."""
    moments, axes = np.linalg.eigh(J)
    return J if np.all(moments > NO_INERTIA) else (axes * np.where(moments > NO_INERTIA, moments, 0.0)) @ axes.T


def _joint(c: Connection, here: Frame, there: Frame, i: int, j: int, axis: np.ndarray) -> Joint:
    if c.kind in (JointKind.SPHERICAL, JointKind.DISTANCE):
        return Joint(i, here.p, j, there.p, name=c.name, kind=c.kind, length=c.length)
    if c.kind is JointKind.UNIVERSAL:
        assert c.second is not None
        ways = (c.second, axis) if i == c.child else (axis, c.second)
        return Joint(i, here.p, j, there.p, here.R @ ways[0], there.R @ ways[1], c.name, c.kind)
    across = normals_of(axis)[0] if c.kind in (JointKind.FIXED, JointKind.PRISMATIC) else None
    sides = (None, None) if across is None else (here.R @ across, there.R @ across)
    return Joint(i, here.p, j, there.p, here.R @ axis, there.R @ axis, c.name, c.kind, *sides)


def _torsion(c: Connection, here: Frame, there: Frame, i: int, j: int, axis: np.ndarray) -> TorsionSpring:
    across = normals_of(axis)[0]
    here_in_space, there_in_space = (c.in_child, c.in_parent) if i == c.child else (c.in_parent, c.in_child)
    e, b = there_in_space.R @ across, there_in_space.R @ np.cross(axis, across)
    u = here_in_space.R @ across
    start = float(np.arctan2(u @ b, u @ e))  # the coordinate of the joint, which a pose tells within half a turn of 0
    turns = round((start - c.rest) / (2.0 * np.pi))
    return TorsionSpring(
        i, here.R @ across, j, there.R @ axis, there.R @ across, c.stiffness, c.rest, c.damping, turns
    )  # fmt: skip


def _spring(c: Connection, here: Frame, there: Frame, i: int, j: int, axis: np.ndarray) -> SpringDamper:
    """From a point of the axis far behind, so that its length stays above zero."""
    far = BEHIND * (1.0 + abs(c.rest))
    return SpringDamper(i, here.p, j, there.p - far * (there.R @ axis), c.stiffness, far + c.rest, c.damping)
