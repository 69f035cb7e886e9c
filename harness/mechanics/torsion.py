"""Evaluate torsional springs and dampers: the angle from a direction of j to one of i about an axis of j, and torque.

    theta = atan2(u . b, u . e),  e = across_j, b = axis x e in j, u = across_i in i
    m = (p u x b - q u x e) / (p^2 + q^2),  p = u . e, q = u . b:   theta_dot = m . (omega_i - omega_j)

The torque on i is -(k (theta - theta_0) + c theta_dot) m, the opposite on j; m is the axis where u is normal to it.
A pose determines the angle up to whole turns: it is taken within half a turn of theta_0, plus the system's
``torsion_wound``; ``follow_turns`` counts the angles of a motion from row to row.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from .ends import append_ground, apply_matrices, turn_vectors
from .state import State, States
from .system import MultibodySystem


def evaluate_torsion(
    system: MultibodySystem, s: States
) -> tuple[Float[np.ndarray, "nt m"], Float[np.ndarray, "nt m"], Float[np.ndarray, "nt m 3"]]:
    """Return theta - theta_0 [rad], theta_dot [rad/s] and m (space) of all torsional springs at each time.

    Angles are within half a turn of rest, plus ``torsion_wound``, unless ``s`` has ``angles`` that count the turns.
    """
    i, j = system.torsion_i, system.torsion_j
    u = turn_vectors(s, i, system.torsion_u)
    e, b = (turn_vectors(s, j, system.torsion_n[:, k]) for k in range(2))
    p, q = np.sum(u * e, axis=-1), np.sum(u * b, axis=-1)
    m = (p[..., None] * np.cross(u, b) - q[..., None] * np.cross(u, e)) / (p * p + q * q)[..., None]
    omega = append_ground(apply_matrices(s.R, s.Omega), np.zeros(3))
    angle = np.arctan2(q, p) - system.torsion_rest
    wound = angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    wound = wound + system.torsion_wound
    if s.angles is not None:
        wound = wound + 2.0 * np.pi * np.round((s.angles - wound) / (2.0 * np.pi))
    return wound, np.sum(m * (omega[:, i] - omega[:, j]), axis=-1), m


def follow_turns(system: MultibodySystem, t: Float[np.ndarray, " nt"], s: States) -> States:
    """Return the motion with its springs' angles counted through all turns.

    It is returned unchanged if all angles stay within half a turn of rest. The rates at both ends of a step decide by
    how many whole turns an angle changes in it.
    """
    angles = count_turns(system, t, s)
    return s if angles is None else s.with_angles(angles)


def count_turns(system: MultibodySystem, t: Float[np.ndarray, " nt"], s: States) -> Float[np.ndarray, "nt m"] | None:
    """Return theta - theta_0 [rad] at each time, with whole turns counted from the first time on.

    None if no angle leaves the half turn about rest, or if there are no springs.
    """
    if not len(system.torsion_k) or len(t) < 2:
        return None
    with np.errstate(all="ignore"):
        angle, rate, _ = evaluate_torsion(system, s)
        change = 0.5 * np.diff(t)[:, None] * (rate[1:] + rate[:-1])
        turns = np.nan_to_num(np.round((change - np.diff(angle, axis=0)) / (2.0 * np.pi)), posinf=0.0, neginf=0.0)
    if not np.any(turns):
        return None
    return angle + 2.0 * np.pi * np.concatenate((np.zeros((1, turns.shape[1])), np.cumsum(turns, axis=0)))


def count_determined_rows(system: MultibodySystem, t: Float[np.ndarray, " nt"], s: States) -> int:
    """Return the number of recorded times, from the start, at which poses alone give the springs' true angles.

    They do until a spring with stiffness leaves the half turn about rest within which the system takes its angle.
    """
    angles = count_turns(system, t, s) if np.any(system.torsion_k) else None
    if angles is None:
        return len(t)
    beyond = np.abs(angles - evaluate_torsion(system, s)[0])[:, system.torsion_k > 0.0] > np.pi
    rows = np.flatnonzero(np.any(beyond, axis=1))
    return int(rows[0]) if len(rows) else len(t)


def rewind_springs(system: MultibodySystem, here: State) -> MultibodySystem:
    """Return the system with the same spring torques, whose angles are taken within half a turn of those at ``here``.

    ``torsion_rest`` becomes theta at that state, ``torsion_wound`` theta - theta_0 there.
    """
    angle = evaluate_torsion(system, States.one(here))[0][0]
    bare = replace(system, torsion_wound=np.zeros_like(angle))
    pose = evaluate_torsion(bare, States.one(here))[0][0] + system.torsion_rest
    for a in (angle, pose):
        a.setflags(write=False)
    return replace(system, torsion_rest=pose, torsion_wound=angle)
