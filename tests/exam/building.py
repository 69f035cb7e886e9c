"""Mechanisms of the exam: bodies in places, hinges and guides between them, velocities from those of a few hinges.

What was declared stays in ``DECLARED``, for the truth, which reads nothing that the harness made of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbsbench import Joint, Problem, RigidBody, State, assemble

X, Y, Z = np.eye(3)
O = np.zeros(3)
EARTH = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Declared:
    """A mechanism as it was declared: velocities ``v``, ``w`` in space."""

    bodies: Sequence[RigidBody]
    joints: Sequence[Joint]
    gravity: np.ndarray
    r: np.ndarray
    R: np.ndarray
    v: np.ndarray
    w: np.ndarray
    t_end: float
    dt: float
    springs: Sequence[Any] = ()
    loads: Sequence[Any] = ()
    torsions: Sequence[Any] = ()


DECLARED: dict[str, Declared] = {}


@dataclass
class Parts:
    """Bodies in their places, and pairs of them; -1 is the ground."""

    r: list[np.ndarray] = field(default_factory=list)
    R: list[np.ndarray] = field(default_factory=list)
    bodies: list[RigidBody] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    rows: list[tuple[int, int, np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)

    def body(self, mass: float, moments: Sequence[float], r: Any, R: Any = None) -> int:
        """Add a body with these principal moments; its number."""
        self.bodies.append(RigidBody(mass, np.diag(np.array(moments, dtype=float))))
        self.r.append(np.array(r, dtype=float))
        self.R.append(np.eye(3) if R is None else np.array(R, dtype=float))
        return len(self.bodies) - 1

    def bar(self, mass: float, a: Any, b: Any, beside: Any, thick: float = 0.05) -> int:
        """Add a bar from ``a`` to ``b``: its x along it, its z as near to ``beside`` as that leaves."""
        a, b = np.array(a, dtype=float), np.array(b, dtype=float)
        length = float(np.linalg.norm(b - a))
        x = (b - a) / length
        z = np.array(beside) - x * (x @ beside)
        z /= np.linalg.norm(z)
        J = mass * length**2 / 12.0
        R = np.stack((x, np.cross(z, x), z), 1)
        return self.body(mass, (2.0 * thick * J, (1.0 + thick) * J, J), 0.5 * (a + b), R)

    def seen(self, k: int, point: Any) -> np.ndarray:
        """A point of space from C of body ``k``, in its frame."""
        return np.array(point, dtype=float) if k < 0 else self.R[k].T @ (np.array(point) - self.r[k])

    def along(self, k: int, way: Any) -> np.ndarray:
        """A direction of space in the frame of body ``k``."""
        way = np.array(way, dtype=float) / np.linalg.norm(way)
        return way if k < 0 else self.R[k].T @ way

    def hinge(self, i: int, j: int, point: Any, axis: Any, rate: float | None = None) -> None:
        """Join two bodies by a hinge, ``rate`` [rad/s] of i against j where it is known."""
        axis = np.array(axis, dtype=float) / np.linalg.norm(axis)
        name, ends = f"{i + 1} on {j + 1}", (self.along(i, axis), self.along(j, axis))
        self.joints.append(Joint(i, self.seen(i, point), j, self.seen(j, point), *ends, name))
        across = np.linalg.svd(axis[None])[2][1:]
        held = across if rate is None else np.concatenate((across, axis[None]))
        told = np.zeros(len(held)) if rate is None else np.array([0.0, 0.0, rate])
        self.rows.append((i, j, np.array(point, dtype=float), np.eye(3), held, told))

    def guide(self, i: int, j: int, point: Any, axis: Any, across: Any) -> None:
        """Let ``i`` slide along ``axis`` of ``j``."""
        self.joints.append(
            Joint(
                i,
                self.seen(i, point),
                j,
                self.seen(j, point),
                self.along(i, axis),
                self.along(j, axis),
                "guide",
                "prismatic",
                self.along(i, across),
                self.along(j, across),
            )
        )
        normal = np.linalg.svd((np.array(axis) / np.linalg.norm(axis))[None])[2][1:]
        self.rows.append((i, j, np.array(point, dtype=float), normal, np.eye(3), np.zeros(3)))

    def velocities(self) -> tuple[np.ndarray, np.ndarray]:
        """v and w of all bodies in space: the only ones that all pairs and the known rates allow."""
        n = len(self.bodies)
        A, b = [], []
        for i, j, point, normal, turned, told in self.rows:
            for d in normal:
                A.append(self._row(i, j, d, point))
                b.append(0.0)
            for d, value in zip(turned, told, strict=True):
                A.append(self._row(i, j, d))
                b.append(value)
        # lengths of order one, so that no metre decides a rank
        places = np.array([*self.r, *(row[2] for row in self.rows)])
        size = float(np.max(np.abs(places - self.r[0])))
        scale = np.tile(np.repeat((size, 1.0), 3), n)
        M = np.array(A) * scale
        M /= np.linalg.norm(M, axis=1, keepdims=True)
        told = np.array(b) / np.linalg.norm(np.array(A) * scale, axis=1)
        x, _, rank, _ = np.linalg.lstsq(M, told, rcond=1e-9)
        assert rank == 6 * n, f"the known rates leave {6 * n - rank} freedoms"
        assert np.max(np.abs(M @ x - told)) <= 1e-12 * np.max(np.abs(x), initial=1e-300), "rates that no pair allows"
        x = (x * scale).reshape(n, 6)
        return x[:, :3], x[:, 3:]

    def _row(self, i: int, j: int, d: np.ndarray, point: np.ndarray | None = None) -> np.ndarray:
        """The velocity of ``point`` along ``d``, or without one the turning about it, of i against j."""
        row = np.zeros((len(self.bodies) + 1, 2, 3))  # the last one is the ground
        for k, sign in ((i, 1.0), (j, -1.0)):
            if point is None:
                row[k, 1] += sign * d
            elif k >= 0:
                row[k] += sign * np.array([d, np.cross(point - self.r[k], d)])
        return row[:-1].reshape(-1)

    def problem(
        self,
        name: str,
        *,
        t_end: float,
        dt: float,
        gravity: Any = EARTH,
        motion: Any = None,
        springs: Sequence[Any] = (),
        loads: Sequence[Any] = (),
        torsions: Sequence[Any] = (),
        joints: Sequence[Joint] = (),
    ) -> Problem:
        """The problem, with ``motion`` (v, w) or that of the pairs."""
        v, w = self.velocities() if motion is None else motion
        r, R, gravity = np.array(self.r), np.array(self.R), np.array(gravity, dtype=float)
        every = [*self.joints, *joints]
        DECLARED[name] = Declared(self.bodies, every, gravity, r, R, v, w, t_end, dt, springs, loads, torsions)
        system = assemble(self.bodies, every, tuple(gravity), list(springs), list(loads), list(torsions))
        start = State(r, R, v, np.einsum("bji,bj->bi", R, w))
        return Problem(name, system, start, t_end=t_end, dt=dt, section="", source="made for the exam")


def turn(axis: Any, angle: float) -> np.ndarray:
    """The rotation about ``axis``."""
    x, y, z = np.array(axis, dtype=float) / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)


def meet(a: Any, b: Any, la: float, lb: float) -> np.ndarray:
    """The point of the plane at ``la`` from a and ``lb`` from b, to the left of the way from a to b."""
    a, b = np.array(a, dtype=float), np.array(b, dtype=float)
    d = float(np.linalg.norm(b - a))
    x = 0.5 * (d + (la**2 - lb**2) / d)
    e = (b - a) / d
    return a + x * e + np.sqrt(la**2 - x**2) * np.array([-e[1], e[0]])


def crank_and_rocker(
    parts: Parts,
    ground: float,
    crank: float,
    coupler: float,
    rocker: float,
    angle: float,
    rate: float | None,
    *,
    frame: np.ndarray,
    foot: Any = O,
    masses: Sequence[float] = (1.0, 2.0, 1.5),
) -> list[np.ndarray]:
    """Add a four-bar linkage in the x-y plane of ``frame`` through ``foot``; its points."""
    flat = [np.zeros(2), crank * np.array([np.cos(angle), np.sin(angle)]), np.zeros(2), np.array([ground, 0.0])]
    flat[2] = meet(flat[1], flat[3], coupler, rocker)
    p = [np.array(foot) + frame @ np.array([*q, 0.0]) for q in flat]
    n, k = frame[:, 2], len(parts.bodies)
    for mass, (a, b) in zip(masses, ((0, 1), (1, 2), (2, 3)), strict=True):
        parts.bar(mass, p[a], p[b], n)
    parts.hinge(k, -1, p[0], n, rate)
    parts.hinge(k + 1, k, p[1], n)
    parts.hinge(k + 2, k + 1, p[2], n)
    parts.hinge(k + 2, -1, p[3], n)
    return p
