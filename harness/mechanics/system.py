"""Define a multibody system as plain arrays of bodies, joints and forces, independent of how it is solved.

Velocities are ``v = (r_dot [space], Omega [body])`` per body; in them the mass matrix is the constant
``blockdiag(m I, J)``. Joints and their rows: module ``joints``. Body index -1 is the ground (r = 0, R = I).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from ..base.text import check_text
from .added_inertia import compute_added_inertia, find_principal_inertias
from .checks import check_body, check_ends, check_vectors, freeze_array
from .forces import Load, SpringDamper, TorsionSpring
from .joints import (
    DECLARED,
    KINDS,
    ROWS,
    AxisRows,
    Joint,
    Kind,
    LineRows,
    MovingRows,
    Vector,
    find_directions,
    normalise,
    project_normals,
    select_rows,
)
from .naming import name_part
from .time_functions import ONE, find_varying
from .user_forces import UserForce, compile_laws

GROUND = -1


@dataclass(frozen=True)
class RigidBody:
    """Mass [kg] and inertia [kg m2] about the centre of mass C, body frame; none of a point mass (``zero_inertia``)."""

    mass: float
    inertia: Float[np.ndarray, "3 3"]
    name: str = ""


class _Derived(NamedTuple):
    """Arrays that follow from those of a system."""

    added_inertia: Float[np.ndarray, "nb 3 3"]
    gyration: Float[np.ndarray, " nb"]
    row_start: Int[np.ndarray, " starts"]


@dataclass(frozen=True)
class MultibodySystem:
    """A system in arrays, all read-only. Built by ``assemble``; rows of phi are joint by joint (module ``joints``)."""

    mass: Float[np.ndarray, " nb"]  # [kg]
    inertia: Float[np.ndarray, "nb 3 3"]  # [kg m2] about C, body frame
    gravity: Float[np.ndarray, " 3"]  # [m/s2], space frame

    joint_i: Int[np.ndarray, " nj"]  # number of body i
    joint_j: Int[np.ndarray, " nj"]  # number of body j; -1 is the ground
    joint_s_i: Float[np.ndarray, "nj 3"]  # [m] point of the joint from C, in body i
    joint_s_j: Float[np.ndarray, "nj 3"]  # [m] the same in body j
    joint_sort: Int[np.ndarray, " nj"]  # number in ``joints.KINDS``
    joint_points: Int[np.ndarray, " nj"]  # number of point rows: 0 or 3
    joint_lines: Int[np.ndarray, " nj"]  # number of line rows: 0 to 2
    joint_axes: Int[np.ndarray, " nj"]  # number of axis rows: 0 to 3
    joint_moving: Int[np.ndarray, " nj"]  # number of moving rows: 0, 1 or 3
    joint_u: Float[np.ndarray, "nj 3"]  # unit vectors; zero where no row reads them
    joint_w: Float[np.ndarray, "nj 3"]  # u and w in body i
    joint_n: Float[np.ndarray, "nj 3 3"]  # n_1, n_2, n_3 in body j
    joint_length: Float[np.ndarray, " nj"]  # [m] of a link, radius of a disc or pinion; else zero
    joint_motion: Float[np.ndarray, "nj 7"]  # numbers of a ``TimeFunction``; zero where time does not enter

    spring_i: Int[np.ndarray, " ns"]
    spring_j: Int[np.ndarray, " ns"]
    spring_p_i: Float[np.ndarray, "ns 3"]  # [m] ends from C, body frames
    spring_p_j: Float[np.ndarray, "ns 3"]
    spring_k: Float[np.ndarray, " ns"]  # [N/m] stiffness
    spring_d0: Float[np.ndarray, " ns"]  # [m] rest length
    spring_c: Float[np.ndarray, " ns"]  # [N s/m] damping

    torsion_i: Int[np.ndarray, " nr"]
    torsion_j: Int[np.ndarray, " nr"]
    torsion_u: Float[np.ndarray, "nr 3"]  # unit vector in i
    torsion_n: Float[np.ndarray, "nr 2 3"]  # e, and axis x e, in j
    torsion_k: Float[np.ndarray, " nr"]  # [N m/rad] stiffness
    torsion_rest: Float[np.ndarray, " nr"]  # [rad] angle of rest
    torsion_c: Float[np.ndarray, " nr"]  # [N m s/rad] damping
    torsion_wound: Float[np.ndarray, " nr"]  # [rad] added to the angle within half a turn of rest

    load_i: Int[np.ndarray, " nl"]
    load_p: Float[np.ndarray, "nl 3"]  # [m] point from C, body frame
    load_force: Float[np.ndarray, "nl 3"]  # [N] in space, or in the body where it follows
    load_torque: Float[np.ndarray, "nl 3"]  # [N m] likewise
    load_follows: Bool[np.ndarray, " nl"]  # True where the load turns with its body
    load_factor: Float[np.ndarray, "nl 7"]  # numbers of a ``TimeFunction``

    user_i: Int[np.ndarray, " nu"]
    user_j: Int[np.ndarray, " nu"]
    user_law: Shaped[np.ndarray, " nu"]  # objects ``user_forces.ForceLaw``

    body_names: tuple[str, ...] = ()
    joint_names: tuple[str, ...] = ()

    @property
    def added_inertia(self) -> Float[np.ndarray, "nb 3 3"]:
        """Inertia added about axes without any [kg m2]: 0 except for slender rods and point masses."""
        return self._derived.added_inertia.copy()

    @cached_property
    def _derived(self) -> "_Derived":
        """Arrays that follow from the others, computed once, as they are asked for often; properties return copies."""
        added = self._compute_added_inertia()
        gyration = np.sqrt(np.einsum("bii->b", self.inertia + added) / (2.0 * self.mass))
        return _Derived(added, gyration, np.concatenate(([0], np.cumsum(self.joint_rows))).astype(np.int64))

    def _compute_added_inertia(self) -> Float[np.ndarray, "nb 3 3"]:
        """Return the inertia to add about axes without any [kg m2, body]; zeros if every body has inertia.

        The longest joint arm of a body scales that of a point mass; without an arm, the longest length of the system.
        """
        if not np.any(find_principal_inertias(self.inertia)[2]):
            return np.zeros_like(self.inertia)
        arm = np.zeros(self.nb + 1)  # the last one is the ground
        for body, s in ((self.joint_i, self.joint_s_i), (self.joint_j, self.joint_s_j)):
            np.maximum.at(arm, body, np.linalg.norm(s, axis=1))
        arm = arm[:-1]
        longest = float(max(np.max(arm, initial=0.0), np.max(self.joint_length, initial=0.0)))
        longest = longest or float(np.max(np.sqrt(np.einsum("bii->b", self.inertia) / (2.0 * self.mass)))) or 1.0
        return compute_added_inertia(self.mass, self.inertia, np.where(arm > 0.0, arm, longest))

    @property
    def regular_inertia(self) -> Float[np.ndarray, "nb 3 3"]:
        """Inertia of the equations of motion [kg m2], with added inertia: positive definite."""
        return self.inertia + self.added_inertia

    @property
    def gyration(self) -> Float[np.ndarray, " nb"]:
        """Radius of gyration [m] of each body, of ``regular_inertia``, by which angles convert to metres."""
        return self._derived.gyration.copy()

    @property
    def nb(self) -> int:
        """Number of moving bodies."""
        return len(self.mass)

    @property
    def nj(self) -> int:
        """Number of joints."""
        return len(self.joint_i)

    @property
    def joint_rows(self) -> Int[np.ndarray, " nj"]:
        """Number of rows of each joint."""
        return self.joint_points + self.joint_lines + self.joint_axes + self.joint_moving

    @property
    def row_start(self) -> Int[np.ndarray, " starts"]:
        """First row of phi of each joint; the last entry is the number of rows."""
        return self._derived.row_start.copy()

    @property
    def nrows(self) -> int:
        """Number of constraint rows, redundant ones included."""
        return int(self._derived.row_start[-1])

    @property
    def joint_revolute(self) -> Bool[np.ndarray, " nj"]:
        """Flags of the revolute joints: three point rows and two axis rows."""
        return (self.joint_points == 3) & (self.joint_axes == 2)

    def joint_kind(self, k: int) -> Kind:
        """Return the kind of joint ``k``."""
        return KINDS[self.joint_sort[k]]

    @property
    def is_pinned(self) -> bool:
        """True if all joints are spherical or revolute."""
        return bool(np.all(self.joint_points == 3) and np.all(np.isin(self.joint_axes, (0, 2))))

    @property
    def is_conservative(self) -> bool:
        """True when no damper, load or user force acts and nothing is driven, so that T + V is constant."""
        forced = len(self.load_i) or len(self.user_i)
        return not (np.any(self.spring_c) or np.any(self.torsion_c) or forced or np.any(self.joint_motion))

    @property
    def is_timed(self) -> bool:
        """True if drives, loads or user forces are, or may be, functions of time."""
        return bool(np.any(find_varying(self.joint_motion)) or np.any(self.load_factor != ONE) or len(self.user_i))

    @property
    def is_holonomic(self) -> bool:
        """True if every row has a phi: no knife edge, no rolling disc."""
        return all(DECLARED[kind].is_holonomic for kind in self.moving_rows().kind)

    def point_rows(self) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, "m 3"]]:
        """Return the joints that have point rows (m,), and the indices of these rows in phi (m, 3)."""
        joint = np.flatnonzero(self.joint_points)
        return joint, self.row_start[joint][:, None] + np.arange(3)

    def line_rows(self) -> LineRows:
        """Return all line rows, in the order of phi."""
        joint, k = _number_rows(self.joint_lines)
        row = self.row_start[joint] + self.joint_points[joint] + k
        return LineRows(joint, row, self.joint_n[joint, k], self.joint_length[joint])

    def axis_rows(self) -> AxisRows:
        """Return all axis rows, in the order of phi: (u, n_1), (u, n_2), (w, n_2)."""
        joint, k = _number_rows(self.joint_axes)
        row = self.row_start[joint] + self.joint_points[joint] + self.joint_lines[joint] + k
        u = np.where((k == 2)[:, None], self.joint_w[joint], self.joint_u[joint])
        return AxisRows(joint, row, u, self.joint_n[joint, np.minimum(k, 1)])

    def moving_rows(self) -> MovingRows:
        """Return all drives and nonholonomic joints, whose rows are called moving; they have no other rows."""
        joint = np.flatnonzero(self.joint_moving)
        return MovingRows(joint, self.row_start[joint], tuple(KINDS[k] for k in self.joint_sort[joint]))

    @property
    def turning_rows(self) -> Int[np.ndarray, " m"]:
        """Numbers of the rows of phi without unit, whose reactions are torques [N m]: axis rows and driven angles."""
        turns = [turn for k in self.joint_sort for turn in DECLARED[KINDS[k]].turns]
        return np.flatnonzero(np.array(turns, dtype=bool))


def _number_rows(count: Int[np.ndarray, " nj"]) -> tuple[np.ndarray, np.ndarray]:
    """Return for each row of one sort its joint, and its index among the rows of that sort in the joint.

    ``count`` is the number of such rows of each joint.
    """
    joint = np.repeat(np.arange(len(count)), count)
    return joint, np.arange(len(joint)) - np.repeat(np.cumsum(count) - count, count)


def assemble(
    bodies: Sequence[RigidBody],
    joints: Sequence[Joint] = (),
    gravity: Vector = (0.0, 0.0, 0.0),
    springs: Sequence[SpringDamper] = (),
    loads: Sequence[Load] = (),
    torsions: Sequence[TorsionSpring] = (),
    user_forces: Sequence[UserForce] = (),
) -> MultibodySystem:
    """Assemble the arrays of a system from its parts; raise ValueError, naming the part, for one that is invalid.

    ``gravity`` [m/s2] is in space. A joint with chosen ``rows`` becomes a joint for each of them.
    """
    for k, body in enumerate(bodies):
        check_body(name_part("body", k, body.name), body.mass, body.inertia)
    groups: dict[str, Sequence[Joint | SpringDamper | TorsionSpring | UserForce]] = {
        "joint": joints,
        "spring": springs,
        "torsion": torsions,
        "user force": user_forces,
    }
    for kind, parts in groups.items():
        for k, part in enumerate(parts):
            where = name_part(kind, k, getattr(part, "name", ""))
            check_ends(where, part.i, part.j, len(bodies))
            check_vectors(where, vars(part))
    check_vectors("the system", {"gravity": gravity})
    for name, some in (("spring", springs), ("torsion", torsions)):
        for k, spring in enumerate(some):
            for what in ("stiffness", "damping", "rest_length"):
                value = getattr(spring, what, 0.0)
                if not (np.isfinite(value) and value >= 0.0):
                    raise ValueError(f"{name} {k}: {what} must be finite and >= 0 (got {value})")
    for k, load in enumerate(loads):
        check_vectors(f"load {k}", vars(load))
        if not 0 <= load.i < len(bodies):
            raise ValueError(f"load {k}: expected a body in 0..{len(bodies) - 1} (got {load.i})")
    single = [(k, one) for k, joint in enumerate(joints) for one in select_rows(k, joint)]  # k as the user counts
    vectors = [find_directions(k, joint) for k, joint in single]
    names = tuple(joint.name or f"joint {k}" for k, joint in single)
    joints = [joint for _, joint in single]
    counts = [ROWS[j.sort] for j in joints]
    for kind, given in (("body", [b.name for b in bodies]), ("joint", [j.name for j in joints])):
        for name in given:
            check_text(f"name of {kind}", name or "")
    return MultibodySystem(
        mass=freeze_array([b.mass for b in bodies], (len(bodies),)),
        inertia=freeze_array([b.inertia for b in bodies], (len(bodies), 3, 3)),
        gravity=freeze_array(gravity, (3,)),
        joint_i=freeze_array([j.i for j in joints], (len(joints),), np.int64),
        joint_j=freeze_array([j.j for j in joints], (len(joints),), np.int64),
        joint_s_i=freeze_array([j.s_i for j in joints], (len(joints), 3)),
        joint_s_j=freeze_array([j.s_j for j in joints], (len(joints), 3)),
        joint_sort=freeze_array([KINDS.index(j.sort) for j in joints], (len(joints),), np.int64),
        joint_points=freeze_array([c.point for c in counts], (len(joints),), np.int64),
        joint_lines=freeze_array([c.line for c in counts], (len(joints),), np.int64),
        joint_axes=freeze_array([c.axis for c in counts], (len(joints),), np.int64),
        joint_moving=freeze_array([c.moving for c in counts], (len(joints),), np.int64),
        joint_u=freeze_array([v["u"] for v in vectors], (len(joints), 3)),
        joint_w=freeze_array([v["w"] for v in vectors], (len(joints), 3)),
        joint_n=freeze_array([v["n"] for v in vectors], (len(joints), 3, 3)),
        joint_length=freeze_array([v["length"] for v in vectors], (len(joints),)),
        joint_motion=freeze_array([v["motion"] for v in vectors], (len(joints), 7)),
        spring_i=freeze_array([s.i for s in springs], (len(springs),), np.int64),
        spring_j=freeze_array([s.j for s in springs], (len(springs),), np.int64),
        spring_p_i=freeze_array([s.p_i for s in springs], (len(springs), 3)),
        spring_p_j=freeze_array([s.p_j for s in springs], (len(springs), 3)),
        spring_k=freeze_array([s.stiffness for s in springs], (len(springs),)),
        spring_d0=freeze_array([s.rest_length for s in springs], (len(springs),)),
        spring_c=freeze_array([s.damping for s in springs], (len(springs),)),
        torsion_i=freeze_array([s.i for s in torsions], (len(torsions),), np.int64),
        torsion_j=freeze_array([s.j for s in torsions], (len(torsions),), np.int64),
        torsion_u=freeze_array(
            [normalise(s.across_i, f"torsion {k}") for k, s in enumerate(torsions)], (len(torsions), 3)
        ),
        torsion_n=freeze_array(
            [
                project_normals(normalise(s.axis_j, f"torsion {k}"), s.across_j, f"torsion {k}")
                for k, s in enumerate(torsions)
            ],
            (len(torsions), 2, 3),
        ),
        torsion_k=freeze_array([s.stiffness for s in torsions], (len(torsions),)),
        torsion_rest=freeze_array([s.rest_angle for s in torsions], (len(torsions),)),
        torsion_c=freeze_array([s.damping for s in torsions], (len(torsions),)),
        torsion_wound=freeze_array([2.0 * np.pi * s.turns for s in torsions], (len(torsions),)),
        load_i=freeze_array([f.i for f in loads], (len(loads),), np.int64),
        load_p=freeze_array([f.point for f in loads], (len(loads), 3)),
        load_force=freeze_array([f.force for f in loads], (len(loads), 3)),
        load_torque=freeze_array([f.torque for f in loads], (len(loads), 3)),
        load_follows=freeze_array([f.follows for f in loads], (len(loads),), np.bool_),
        load_factor=freeze_array([_read_factor(k, f) for k, f in enumerate(loads)], (len(loads), 7)),
        user_i=freeze_array([f.i for f in user_forces], (len(user_forces),), np.int64),
        user_j=freeze_array([f.j for f in user_forces], (len(user_forces),), np.int64),
        user_law=compile_laws(user_forces),
        body_names=tuple(b.name or f"body {k}" for k, b in enumerate(bodies)),
        joint_names=names,
    )


def _read_factor(k: int, load: Load) -> np.ndarray:
    """Return the seven numbers of the factor of load ``k``, a function of time; those of 1 where it has none."""
    return ONE if load.factor is None else load.factor.numbers(f"load {k}")
