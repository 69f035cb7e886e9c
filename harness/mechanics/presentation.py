"""Present a system in other forms: mirrored, a joint declared twice, bodies and joints renumbered, other units.

A solver gets the presented system; its motion is transformed back before anything is measured, so that runs which
differ only in their presentation can be compared directly. Order: mirror, duplicate, renumber, units.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from .joints import DECLARED, KINDS
from .state import State, States
from .system import GROUND, MultibodySystem
from .time_functions import scale_units
from .user_forces import BODY_MIRROR, present_laws

SPACE_AXES = {"none": -1, "X": 0, "Y": 1, "Z": 2}


@dataclass(frozen=True)
class Presentation:
    """A presentation of a system. The numbers of a length, a mass, a time are multiplied by the ``unit_`` factors."""

    mirror: str = "none"  # the plane through the origin of space with this normal
    duplicate: int = 0  # joint that is declared twice, counted from 1; 0: none
    renumber: int = 0  # seed of the permutations; 0: no change
    unit_length: float = 1.0
    unit_mass: float = 1.0
    unit_time: float = 1.0

    @property
    def speed(self) -> float:
        """Factor by which the numbers of speeds [m/s] are multiplied."""
        return self.unit_length / self.unit_time

    @property
    def force(self) -> float:
        """Factor by which the numbers of forces [N] are multiplied."""
        return self.unit_mass * self.unit_length / self.unit_time**2

    def system(self, s: MultibodySystem) -> MultibodySystem:
        """Return the system ``s`` as a solver gets it; raise ValueError if it has no joint number ``duplicate``."""
        if self.duplicate > s.nj:
            raise ValueError(f"duplicate must be 0..{s.nj}, a joint of this system (got {self.duplicate})")
        return _convert_units(
            _renumber(_repeat_joint(_mirror(s, self._make_mirror()), self.duplicate), *self._list_orders(s)), self
        )

    def state(self, s: MultibodySystem, state: State) -> State:
        """Return ``state``, of the system ``s``, as a solver gets it."""
        bodies, _ = self._list_orders(s)
        m = _mirror_states(States.one(state), self._make_mirror()).at(slice(None))
        return State(
            m.r[0, bodies] * self.unit_length,
            m.R[0, bodies],
            m.v[0, bodies] * self.speed,
            m.Omega[0, bodies] / self.unit_time,
            state.t * self.unit_time,
        )

    def restore_states(self, s: MultibodySystem, presented: States) -> States:
        """Return the states of the system ``s`` for a solver's states of the presented one; it inverts ``state``."""
        back = np.argsort(self._list_orders(s)[0])
        home = States(
            presented.r[:, back] / self.unit_length,
            presented.R[:, back],
            presented.v[:, back] / self.speed,
            presented.Omega[:, back] * self.unit_time,
            presented.times / self.unit_time,
        )
        return _mirror_states(home, self._make_mirror())

    def restore_reaction(
        self, s: MultibodySystem, presented: Float[np.ndarray, "nt n"]
    ) -> Float[np.ndarray, "nt nrows"]:
        """Return the reactions of the rows of ``s`` [N, N m] for a solver's reactions of the presented system.

        For a joint that is declared twice, the reactions of both are added.
        """
        _, joints = self._list_orders(s)
        repeated = _repeat_joint(s, self.duplicate)
        start = repeated.row_start
        # the row of ``repeated`` that each presented row is
        rows = np.concatenate([np.arange(start[j], start[j + 1]) for j in joints]) if s.nj else np.zeros(0, np.int64)
        home = np.empty_like(presented)
        home[:, rows] = presented / self.force
        home[:, repeated.turning_rows] /= self.unit_length
        if self.duplicate:
            k, n = self.duplicate - 1, s.nrows
            home[:, start[k] : start[k + 1]] += home[:, n:]
            home = home[:, :n]
        point_rows = s.point_rows()[1]
        home[:, point_rows] = home[:, point_rows] @ self._make_mirror()
        return home

    def _make_mirror(self) -> Float[np.ndarray, "3 3"]:
        """Return the reflection of space as a diagonal matrix; the identity without a mirror."""
        signs = np.ones(3)
        if self.mirror != "none":
            signs[SPACE_AXES[self.mirror]] = -1.0
        return np.diag(signs)

    def _list_orders(self, s: MultibodySystem) -> tuple[Int[np.ndarray, " nb"], Int[np.ndarray, " nj"]]:
        """Return the indices in ``s`` of the presented bodies and joints, in order; a duplicate is joint ``s.nj``."""
        nj = s.nj + (1 if self.duplicate else 0)
        if self.renumber == 0:
            return np.arange(s.nb), np.arange(nj)
        random = np.random.default_rng(self.renumber)
        return random.permutation(s.nb), random.permutation(nj)


def _mirror(s: MultibodySystem, S: np.ndarray) -> MultibodySystem:
    """Return the system mirrored by the reflection ``S`` of space, and every body frame by ``BODY_MIRROR``.

    With both, R stays a rotation. The system itself is returned if ``S`` is the identity.
    """
    if np.array_equal(S, np.eye(3)):
        return s

    def reflect(a: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return the mirror images of vectors fixed in the bodies ``ends``, or in the ground."""
        at_ground = (ends == GROUND).reshape(-1, *[1] * (a.ndim - 1))
        return _freeze(np.where(at_ground, a @ S, a @ BODY_MIRROR))

    def reflect_loads(a: np.ndarray) -> np.ndarray:
        """Return the mirror images of vectors that follow their bodies or are fixed in space."""
        return _freeze(np.where(s.load_follows[:, None], a @ BODY_MIRROR, a @ S))

    return dataclasses.replace(
        s,
        inertia=_freeze(BODY_MIRROR @ s.inertia @ BODY_MIRROR),
        gravity=_freeze(S @ s.gravity),
        joint_s_i=reflect(s.joint_s_i, s.joint_i),
        joint_s_j=reflect(s.joint_s_j, s.joint_j),
        joint_u=reflect(s.joint_u, s.joint_i),
        joint_w=reflect(s.joint_w, s.joint_i),
        joint_n=reflect(s.joint_n, s.joint_j),
        torsion_u=reflect(s.torsion_u, s.torsion_i),
        torsion_n=reflect(s.torsion_n, s.torsion_j),
        spring_p_i=reflect(s.spring_p_i, s.spring_i),
        spring_p_j=reflect(s.spring_p_j, s.spring_j),
        load_p=_freeze(s.load_p @ BODY_MIRROR),
        load_force=reflect_loads(s.load_force),
        load_torque=_freeze(-reflect_loads(s.load_torque)),  # a pseudovector
        user_law=present_laws(s.user_law, S),
    )


def _mirror_states(s: States, S: np.ndarray) -> States:
    """Return states mirrored in space by ``S``, and every body frame by ``BODY_MIRROR``; it is its own inverse.

    Omega, a pseudovector, changes its sense.
    """
    if np.array_equal(S, np.eye(3)):
        return s
    return States(s.r @ S, S @ s.R @ BODY_MIRROR, s.v @ S, -(s.Omega @ BODY_MIRROR), s.t)


def _repeat_joint(s: MultibodySystem, joint: int) -> MultibodySystem:
    """Return the system with ``joint``, counted from 1, declared again at the end; the system itself for 0."""
    if joint == 0:
        return s
    more: dict[str, Any] = {n: _freeze(np.concatenate((a, a[joint - 1 : joint]))) for n, a in _joint_arrays(s).items()}
    title = f"{s.joint_names[joint - 1]} again" if s.joint_names else ""
    return dataclasses.replace(s, **more, joint_names=(*s.joint_names, title))


def _renumber(s: MultibodySystem, bodies: np.ndarray, joints: np.ndarray) -> MultibodySystem:
    """Return the system with its bodies and joints in the order of these indices; itself if that is its order."""
    if np.array_equal(bodies, np.arange(s.nb)) and np.array_equal(joints, np.arange(s.nj)):
        return s
    new = np.append(np.argsort(bodies), GROUND)  # new number of each body; the last entry, at -1, is the ground
    changes: dict[str, Any] = {n: _freeze(a[joints]) for n, a in _joint_arrays(s).items()}
    changes |= {n: _freeze(new[changes[n]]) for n in ("joint_i", "joint_j")}
    return dataclasses.replace(
        s,
        **changes,
        mass=_freeze(s.mass[bodies]),
        inertia=_freeze(s.inertia[bodies]),
        torsion_i=_freeze(new[s.torsion_i]),
        torsion_j=_freeze(new[s.torsion_j]),
        spring_i=_freeze(new[s.spring_i]),
        spring_j=_freeze(new[s.spring_j]),
        load_i=_freeze(new[s.load_i]),
        user_i=_freeze(new[s.user_i]),
        user_j=_freeze(new[s.user_j]),
        body_names=tuple(s.body_names[b] for b in bodies) if s.body_names else (),
        joint_names=tuple(s.joint_names[j] for j in joints) if s.joint_names else (),
    )


def _joint_arrays(s: MultibodySystem) -> dict[str, np.ndarray]:
    """Return the arrays of a system that have one entry per joint, by name."""
    return {n: a for n, a in vars(s).items() if n.startswith("joint_") and isinstance(a, np.ndarray)}


def _convert_units(s: MultibodySystem, p: Presentation) -> MultibodySystem:
    """Return the system with all numbers converted to the units of ``p``; the system itself if those are SI."""
    L, M, T = p.unit_length, p.unit_mass, p.unit_time
    if L == M == T == 1.0:
        return s
    units = {"m": L, "rad": 1.0, "m/s": L / T, "": 1.0}  # factors of the values of functions of time
    sizes = np.array([units[DECLARED[KINDS[k]].motion] for k in s.joint_sort])
    return dataclasses.replace(
        s,
        joint_motion=_freeze(scale_units(s.joint_motion, sizes, T)),
        load_factor=_freeze(scale_units(s.load_factor, 1.0, T)),
        mass=_freeze(s.mass * M),
        inertia=_freeze(s.inertia * (M * L**2)),
        gravity=_freeze(s.gravity * (L / T**2)),
        joint_s_i=_freeze(s.joint_s_i * L),
        joint_s_j=_freeze(s.joint_s_j * L),
        spring_p_i=_freeze(s.spring_p_i * L),
        spring_p_j=_freeze(s.spring_p_j * L),
        spring_k=_freeze(s.spring_k * (M / T**2)),
        torsion_k=_freeze(s.torsion_k * (M * L**2 / T**2)),
        torsion_c=_freeze(s.torsion_c * (M * L**2 / T)),
        spring_d0=_freeze(s.spring_d0 * L),
        spring_c=_freeze(s.spring_c * (M / T)),
        joint_length=_freeze(s.joint_length * L),
        load_p=_freeze(s.load_p * L),
        load_force=_freeze(s.load_force * (M * L / T**2)),
        load_torque=_freeze(s.load_torque * (M * L**2 / T**2)),
        user_law=present_laws(s.user_law, np.eye(3), (L, M, T)),
    )


def _freeze(a: np.ndarray) -> np.ndarray:
    """Return a read-only copy."""
    out = np.array(a)
    out.setflags(write=False)
    return out
