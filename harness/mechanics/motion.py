"""Quantities of a motion, whatever computed it: energy, momenta, phi and phi_dot, batched over time.

One code for every solver: it sees only poses and velocities (r, R, v, Omega), never a solver's coordinates.
"""

import numpy as np
from jaxtyping import Float

from .state import States
from .system import GROUND, MultibodySystem


def kinetic_energy(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """T [J], Eq. (4) in body velocities."""
    translation = np.einsum("b,tbi,tbi->t", system.mass, s.v, s.v)
    rotation = np.einsum("tbi,bij,tbj->t", s.Omega, system.inertia, s.Omega)
    return 0.5 * (translation + rotation)


def potential_energy(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """V [J]: gravity (zero at the origin) and springs (zero at rest length)."""
    V = -np.einsum("b,i,tbi->t", system.mass, system.gravity, s.r)
    for k in range(len(system.spring_k)):
        d, _ = _spring_line(system, s, k)
        V = V + 0.5 * system.spring_k[k] * (np.linalg.norm(d, axis=-1) - system.spring_d0[k]) ** 2
    return V


def energy(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """T + V [J]."""
    return kinetic_energy(system, s) + potential_energy(system, s)


def damping_power(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """Power of the dampers [W], never positive: the only force here that changes T + V."""
    return -(damper_lines(system, s)[1] ** 2) @ system.spring_c


def damping_work(
    system: MultibodySystem,
    t: Float[np.ndarray, " nt"],
    d: Float[np.ndarray, "nt ns"],
    rate: Float[np.ndarray, "nt ns"],
) -> Float[np.ndarray, " nt"]:
    """Work of the dampers since the start [J], of the cubic with ``damper_lines`` at both ends of each step.

    Fourth order: steps of a method of high order are too long for the trapezoidal rule on the power.
    """
    a, b, h = rate[:-1], rate[1:], np.diff(t)[:, None]
    bend = np.diff(d, axis=0) / h - 0.5 * (a + b)  # the rate is a (1 - x) + b x + 6 bend x (1 - x)
    square = (a * a + a * b + b * b) / 3.0 + bend * (a + b) + 1.2 * bend**2  # its mean
    return np.concatenate(([0.0], np.cumsum(-(h * square) @ system.spring_c)))


def damper_lines(system: MultibodySystem, s: States) -> tuple[Float[np.ndarray, "nt ns"], Float[np.ndarray, "nt ns"]]:
    """Lengths [m] of the springs and dampers, and their rates [m/s]."""
    lengths, rates = np.zeros((2, len(s.r), len(system.spring_k)))
    for k in range(len(system.spring_k)):
        d, d_dot = _spring_line(system, s, k)
        lengths[:, k] = np.linalg.norm(d, axis=-1)
        rates[:, k] = np.sum(d * d_dot, axis=-1) / lengths[:, k]
    return lengths, rates


def linear_momentum(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt 3"]:
    """sum m r_dot [kg m/s], space frame."""
    return np.einsum("b,tbi->ti", system.mass, s.v)


def angular_momentum(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt 3"]:
    """sum (r x m r_dot + R J Omega) about the origin [kg m2/s], space frame."""
    orbital = np.einsum("b,tbi->ti", system.mass, np.cross(s.r, s.v))
    return orbital + np.einsum("tbij,bjk,tbk->ti", s.R, system.inertia, s.Omega)


def constraint(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """phi: point rows [m], axis rows [-] (module ``system``)."""
    return _rows(system, s, velocity=False)


def constraint_rate(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """phi_dot = A v: point rows [m/s], axis rows [1/s]."""
    return _rows(system, s, velocity=True)


def scaling_masses(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """Diagonal of M_bar, Eq. (30), with c = a / (a . a): the weights of the norm of Eq. (81).

    Unit: kg for point rows; for axis rows kg m2. Rows a are per body velocities (r_dot [space], Omega [body]).
    """
    point, axis = _row_sizes(system, s)
    return _scatter(system, point, axis)


def constraint_energy_norm(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """sqrt(phi_dot^T M_bar phi_dot), Eq. (81) [sqrt(J)]."""
    return np.sqrt(np.sum(scaling_masses(system, s) * constraint_rate(system, s) ** 2, axis=-1))


def point_position(s: States, body: int, p: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "nt 3"]:
    """Space position [m] of the point ``p`` of a body (from C, body frame); the ground is body -1."""
    if body == GROUND:
        return np.broadcast_to(np.asarray(p, dtype=float), (len(s.r), 3))
    return s.r[:, body] + s.R[:, body] @ p


def point_velocity(s: States, body: int, p: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "nt 3"]:
    """Space velocity [m/s] of the point ``p`` of a body."""
    if body == GROUND:
        return np.zeros((len(s.r), 3))
    return s.v[:, body] + np.einsum("tij,tj->ti", s.R[:, body], np.cross(s.Omega[:, body], p))


def _spring_line(system: MultibodySystem, s: States, k: int) -> tuple[np.ndarray, np.ndarray]:
    i, j = system.spring_i[k], system.spring_j[k]
    d = point_position(s, i, system.spring_p_i[k]) - point_position(s, j, system.spring_p_j[k])
    d_dot = point_velocity(s, i, system.spring_p_i[k]) - point_velocity(s, j, system.spring_p_j[k])
    return d, d_dot


def _gather(system: MultibodySystem, s: States, ends: np.ndarray) -> tuple[np.ndarray, ...]:
    """r, R, v, Omega of the bodies ``ends`` (nt, nj, ...), the ground being a body at rest."""
    nt = len(s.r)
    at = np.where(ends == GROUND, s.nb, ends)
    rest, eye = np.zeros((nt, 1, 3)), np.broadcast_to(np.eye(3), (nt, 1, 3, 3))
    pad = (np.concatenate((a, b), axis=1)[:, at] for a, b in ((s.r, rest), (s.R, eye), (s.v, rest), (s.Omega, rest)))
    return tuple(pad)


def _rows(system: MultibodySystem, s: States, *, velocity: bool) -> np.ndarray:
    r_i, R_i, v_i, W_i = _gather(system, s, system.joint_i)
    r_j, R_j, v_j, W_j = _gather(system, s, system.joint_j)
    if velocity:
        point = (
            v_i + _turned(R_i, np.cross(W_i, system.joint_s_i)) - v_j - _turned(R_j, np.cross(W_j, system.joint_s_j))
        )
    else:
        point = r_i + _turned(R_i, system.joint_s_i) - r_j - _turned(R_j, system.joint_s_j)
    h = np.flatnonzero(system.joint_revolute)
    R_i, R_j, W_i, W_j, u, n = R_i[:, h], R_j[:, h], W_i[:, h], W_j[:, h], system.joint_u[h], system.joint_n[h]
    u_space, n_space = _turned(R_i, u)[:, :, None], _turned(R_j[:, :, None], n)
    if velocity:
        u_dot, n_dot = (
            _turned(R_i, np.cross(W_i, u))[:, :, None],
            _turned(R_j[:, :, None], np.cross(W_j[:, :, None], n)),
        )
        return _scatter(system, point, np.sum(u_dot * n_space + u_space * n_dot, axis=-1))
    return _scatter(system, point, np.sum(u_space * n_space, axis=-1))


def _turned(R: np.ndarray, p: np.ndarray) -> np.ndarray:
    """R p of vectors in the last axis."""
    return np.matmul(R, p[..., None])[..., 0]


def _row_sizes(system: MultibodySystem, s: States) -> tuple[np.ndarray, np.ndarray]:
    """c^T M c = a^T M a / (a . a)^2 of the point rows (nt, nj, 3) and of the hinges' axis rows (nt, nh, 2)."""
    _, R_i, _, _ = _gather(system, s, system.joint_i)
    _, R_j, _, _ = _gather(system, s, system.joint_j)
    mass = np.append(system.mass, 0.0)
    J = np.concatenate((system.inertia, np.zeros((1, 3, 3))))
    h = np.flatnonzero(system.joint_revolute)
    aa_point, aMa_point = np.zeros((2, len(s.r), system.nj, 3))
    aa_axis, aMa_axis = np.zeros((2, len(s.r), len(h), 2))
    torque_axis = np.cross(
        _turned(R_i[:, h], system.joint_u[h])[:, :, None], _turned(R_j[:, h, None], system.joint_n[h])
    )  # (nt, nh, 2, 3), space
    for ends, R, arm in ((system.joint_i, R_i, system.joint_s_i), (system.joint_j, R_j, system.joint_s_j)):
        moves = (ends != GROUND).astype(float)[None, :, None]
        # row k of A on Omega: e_k . R (Omega x s) = (s x R^T e_k) . Omega
        a = np.cross(arm[None, :, None], R)  # R[..., k, :] is R^T e_k
        aa_point += moves * (1.0 + np.sum(a * a, axis=-1))
        aMa_point += moves * (mass[ends][None, :, None] + np.sum(np.matmul(a, J[ends]) * a, axis=-1))
        b = np.matmul(torque_axis, R[:, h])  # R^T of each
        aa_axis += moves[:, h] * np.sum(b * b, axis=-1)
        aMa_axis += moves[:, h] * np.sum(np.matmul(b, J[ends[h]]) * b, axis=-1)
    return aMa_point / aa_point**2, aMa_axis / aa_axis**2


def _scatter(system: MultibodySystem, point: np.ndarray, axis: np.ndarray) -> np.ndarray:
    out = np.empty((len(point), system.nrows))
    start = system.row_start[:-1]
    for k in range(3):
        out[:, start + k] = point[:, :, k]
    hinge = np.flatnonzero(system.joint_revolute)
    for k in range(2):
        out[:, start[hinge] + 3 + k] = axis[:, :, k]
    return out
