"""Bodies, joints and forces as plain arrays: what a system is, nothing about how it is solved.

Velocities are ``v = (r_dot [space], Omega [body])`` per body; in them the mass matrix is the constant
``blockdiag(m I, J)``. A joint is a point coincidence (3 rows), with an axis a revolute joint (5 rows)::

    point rows   phi = r_i + R_i s_i - r_j - R_j s_j
    axis rows    phi = (R_i u) . (R_j n_k), k = 1, 2, with n_k normal to the joint axis in j

Body index -1 is the ground (r = 0, R = I).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

GROUND = -1
Vector = Sequence[float] | Float[np.ndarray, " 3"]


@dataclass(frozen=True)
class RigidBody:
    """Mass [kg] and inertia [kg m2] about the centre of mass C, body frame."""

    mass: float
    inertia: Float[np.ndarray, "3 3"]
    name: str = ""


@dataclass(frozen=True)
class Joint:
    """Points ``s_i``, ``s_j`` [m] from each C (from the origin for the ground) that coincide.

    Spherical, unless ``axis_i`` and ``axis_j``, the common axis in the frames of i and j, make it a revolute joint.
    """

    i: int
    s_i: Vector
    j: int = GROUND
    s_j: Vector = (0.0, 0.0, 0.0)
    axis_i: Vector | None = None
    axis_j: Vector | None = None
    name: str = ""


@dataclass(frozen=True)
class SpringDamper:
    """Force ``-(k (d - d0) + c d_dot)`` along the line of two points ``p_i``, ``p_j`` [m], ``d`` their distance."""

    i: int
    p_i: Vector
    j: int = GROUND
    p_j: Vector = (0.0, 0.0, 0.0)
    stiffness: float = 0.0  # k [N/m]
    rest_length: float = 0.0  # d0 [m]
    damping: float = 0.0  # c [N s/m]


@dataclass(frozen=True)
class MultibodySystem:
    """A system in arrays, all read-only. Built by ``assemble``; rows of phi are joint by joint, point rows first."""

    mass: Float[np.ndarray, " nb"]
    inertia: Float[np.ndarray, "nb 3 3"]
    gravity: Float[np.ndarray, " 3"]  # [m/s2], space frame

    joint_i: Int[np.ndarray, " nj"]
    joint_j: Int[np.ndarray, " nj"]
    joint_s_i: Float[np.ndarray, "nj 3"]
    joint_s_j: Float[np.ndarray, "nj 3"]
    joint_revolute: Bool[np.ndarray, " nj"]
    joint_u: Float[np.ndarray, "nj 3"]  # unit axis in i; zero for a spherical joint
    joint_n: Float[np.ndarray, "nj 2 3"]  # two unit normals to the axis in j; zero for a spherical joint

    spring_i: Int[np.ndarray, " ns"]
    spring_j: Int[np.ndarray, " ns"]
    spring_p_i: Float[np.ndarray, "ns 3"]
    spring_p_j: Float[np.ndarray, "ns 3"]
    spring_k: Float[np.ndarray, " ns"]
    spring_d0: Float[np.ndarray, " ns"]
    spring_c: Float[np.ndarray, " ns"]

    body_names: tuple[str, ...] = ()
    joint_names: tuple[str, ...] = ()

    @property
    def nb(self) -> int:
        """Number of moving bodies."""
        return len(self.mass)

    @property
    def nj(self) -> int:
        """Number of joints."""
        return len(self.joint_i)

    @property
    def row_start(self) -> Int[np.ndarray, " nj+1"]:
        """First row of phi of each joint; the last entry is the number of rows."""
        return np.concatenate(([0], np.cumsum(np.where(self.joint_revolute, 5, 3)))).astype(np.int64)

    @property
    def nrows(self) -> int:
        """Number of constraint rows, redundant ones included."""
        return int(self.row_start[-1])

    @property
    def is_conservative(self) -> bool:
        """True when no damper acts, so that T + V is constant."""
        return not np.any(self.spring_c)


def assemble(
    bodies: Sequence[RigidBody],
    joints: Sequence[Joint] = (),
    gravity: Vector = (0.0, 0.0, 0.0),
    springs: Sequence[SpringDamper] = (),
) -> MultibodySystem:
    """Arrays from parts, or ValueError naming the invalid part."""
    for k, body in enumerate(bodies):
        _check_body(k, body)
    parts: tuple[Joint | SpringDamper, ...] = (*joints, *springs)
    for k, part in enumerate(parts):
        _check_ends(k, part.i, part.j, len(bodies))
    for k, spring in enumerate(springs):
        for what in ("stiffness", "damping", "rest_length"):
            value = getattr(spring, what)
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"spring {k}: {what} must be finite and >= 0 (got {value})")
    revolute = [j.axis_i is not None for j in joints]
    for k, joint in enumerate(joints):
        if (joint.axis_i is None) != (joint.axis_j is None):
            raise ValueError(f"joint {k}: give the axis in both bodies or in none")
    u = [_unit(j.axis_i, f"joint {k}") if j.axis_i is not None else np.zeros(3) for k, j in enumerate(joints)]
    n = [_normals(j.axis_j, f"joint {k}") if j.axis_j is not None else np.zeros((2, 3)) for k, j in enumerate(joints)]
    return MultibodySystem(
        mass=_frozen([b.mass for b in bodies], (len(bodies),)),
        inertia=_frozen([b.inertia for b in bodies], (len(bodies), 3, 3)),
        gravity=_frozen(gravity, (3,)),
        joint_i=_frozen([j.i for j in joints], (len(joints),), np.int64),
        joint_j=_frozen([j.j for j in joints], (len(joints),), np.int64),
        joint_s_i=_frozen([j.s_i for j in joints], (len(joints), 3)),
        joint_s_j=_frozen([j.s_j for j in joints], (len(joints), 3)),
        joint_revolute=_frozen(revolute, (len(joints),), np.bool_),
        joint_u=_frozen(u, (len(joints), 3)),
        joint_n=_frozen(n, (len(joints), 2, 3)),
        spring_i=_frozen([s.i for s in springs], (len(springs),), np.int64),
        spring_j=_frozen([s.j for s in springs], (len(springs),), np.int64),
        spring_p_i=_frozen([s.p_i for s in springs], (len(springs), 3)),
        spring_p_j=_frozen([s.p_j for s in springs], (len(springs), 3)),
        spring_k=_frozen([s.stiffness for s in springs], (len(springs),)),
        spring_d0=_frozen([s.rest_length for s in springs], (len(springs),)),
        spring_c=_frozen([s.damping for s in springs], (len(springs),)),
        body_names=tuple(b.name or f"body {k + 1}" for k, b in enumerate(bodies)),
        joint_names=tuple(j.name or f"joint {k + 1}" for k, j in enumerate(joints)),
    )


def _frozen(values: object, shape: tuple[int, ...], dtype: type = np.float64) -> np.ndarray:
    array: np.ndarray = np.array(values, dtype=dtype).reshape(shape)
    if array.dtype == np.float64 and not np.all(np.isfinite(array)):
        raise ValueError(f"system data must be finite numbers (got {array[~np.isfinite(array)][0]})")
    array.setflags(write=False)
    return array


def _check_body(k: int, body: RigidBody) -> None:
    name = body.name or f"body {k + 1}"
    if not (np.isfinite(body.mass) and body.mass > 0.0):
        raise ValueError(f"{name}: mass must be finite and > 0 kg (got {body.mass})")
    J = np.asarray(body.inertia, dtype=float)
    if J.shape != (3, 3) or not np.all(np.isfinite(J)) or not np.allclose(J, J.T, rtol=1e-12, atol=0.0):
        raise ValueError(f"{name}: inertia must be a finite symmetric 3 x 3 matrix (got {J.tolist()})")
    principal = np.linalg.eigvalsh(J)
    if principal[0] <= 0.0:
        raise ValueError(f"{name}: principal inertias must be > 0 kg m2 (got {principal.tolist()})")
    if principal[2] > (principal[0] + principal[1]) * (1.0 + 1e-9):  # of a mass distribution; slack for rounding
        raise ValueError(
            f"{name}: no mass distribution has the principal inertias {principal.tolist()} kg m2 "
            "(the largest exceeds the sum of the others)"
        )


def _check_ends(k: int, i: int, j: int, nb: int) -> None:
    if not (0 <= i < nb and GROUND <= j < nb and i != j):
        raise ValueError(
            f"part {k}: expected body i in 0..{nb - 1} and j another body or -1, the ground (got {i}, {j})"
        )


def _unit(a: Vector, where: str) -> Float[np.ndarray, " 3"]:
    length = float(np.linalg.norm(a))
    if not (np.isfinite(length) and length > 0.0):
        raise ValueError(f"{where}: the axis must have a finite length > 0 (got {list(a)})")
    return np.asarray(a, dtype=float) / length


def _normals(axis: Vector, where: str) -> Float[np.ndarray, "2 3"]:
    """Two orthonormal normals to ``axis``: the coordinate direction furthest from it starts the frame."""
    a = _unit(axis, where)
    n1 = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    n1 /= np.linalg.norm(n1)
    return np.stack((n1, np.cross(a, n1)))
