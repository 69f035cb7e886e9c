"""Quantities of a motion, whatever computed it: energy, momenta, phi and phi_dot, batched over time.

One code for every solver: it sees only poses and velocities (r, R, v, Omega), never a solver's coordinates.
"""

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
from jaxtyping import Float

from . import so3
from .ends import gaps, points, times, turned, turning
from .joints import LineRows
from .lent import pushed, taken_back
from .moving_rows import moving
from .state import States
from .system import GROUND, MultibodySystem
from .time_functions import values
from .torsion import torsion


def kinetic_energy(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """T [J], Eq. (4) in body velocities."""
    translation = np.einsum("b,tbi,tbi->t", system.mass, s.v, s.v)
    rotation = np.einsum("tbi,bij,tbj->t", s.Omega, system.inertia, s.Omega)
    return 0.5 * (translation + rotation)


def potential_energy(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """V [J]: gravity (zero at the origin) and springs (zero at rest length or angle)."""
    V = -np.einsum("b,i,tbi->t", system.mass, system.gravity, s.r)
    for k in range(len(system.spring_k)):
        d, _ = _spring_line(system, s, k)
        V = V + 0.5 * system.spring_k[k] * (np.linalg.norm(d, axis=-1) - system.spring_d0[k]) ** 2
    if len(system.torsion_k):
        V = V + 0.5 * torsion(system, s)[0] ** 2 @ system.torsion_k
    return V


def energy(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """T + V [J]."""
    return kinetic_energy(system, s) + potential_energy(system, s)


def applied(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nb 6"]:
    """Gravity, springs, dampers, loads, user forces on each body: force [N, space], torque about C [N m, body]."""
    out = np.zeros((len(s.r), system.nb + 1, 6))  # the last one is the ground
    out[:, :-1, :3] = system.mass[:, None] * system.gravity
    for k in range(len(system.spring_k)):
        d, d_dot = _spring_line(system, s, k)
        length = np.linalg.norm(d, axis=-1)
        rate = np.sum(d * d_dot, axis=-1) / length
        pull = system.spring_k[k] * (length - system.spring_d0[k]) + system.spring_c[k] * rate
        force = -(pull / length)[:, None] * d
        for body, p, sign in (
            (system.spring_i[k], system.spring_p_i[k], 1.0),
            (system.spring_j[k], system.spring_p_j[k], -1.0),
        ):
            if body != GROUND:
                out[:, body] += _wrench(s.R[:, body], sign * force, p)
    if len(system.torsion_k):
        angle, rate, m = torsion(system, s)
        pull = -(system.torsion_k * angle + system.torsion_c * rate)[..., None] * m
        for k, ends in enumerate(zip(system.torsion_i, system.torsion_j, strict=True)):
            for body, sign in zip(ends, (1.0, -1.0), strict=True):
                if body != GROUND:
                    out[:, body, 3:] += sign * np.einsum("tij,ti->tj", s.R[:, body], pull[:, k])
    for load, body in enumerate(system.load_i):
        force, torque = _load(system, s, load)
        out[:, body] += _wrench(s.R[:, body], force, system.load_p[load])
        out[:, body, 3:] += np.einsum("tij,ti->tj", s.R[:, body], torque)
    for body, force, torque in _user_forces(system, s):
        out[:, body] += np.concatenate((force, np.einsum("tij,ti->tj", s.R[:, body], torque)), axis=-1)
    return out[:, :-1]


def _user_forces(system: MultibodySystem, s: States) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Bodies, force at C and torque about it, in space (nt, 3)."""
    for i, j, law in zip(system.user_i, system.user_j, system.user_law, strict=True):
        values = law.values(s, i, j)
        yield from ((body, values[:, e], values[:, 2 + e]) for e, body in enumerate((i, j)) if body != GROUND)


def power(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """Power of dampers, loads, user forces and drives [W]: what changes T + V."""
    out = drive_power(system, s) if np.any(system.joint_motion) else np.zeros(len(s.r))
    for k in np.flatnonzero(system.spring_c):
        d, d_dot = _spring_line(system, s, int(k))
        out -= system.spring_c[k] * np.sum(d * d_dot, axis=-1) ** 2 / np.sum(d * d, axis=-1)
    if np.any(system.torsion_c):
        out -= torsion(system, s)[1] ** 2 @ system.torsion_c
    for load, body in enumerate(system.load_i):
        force, torque = _load(system, s, load)
        omega = np.einsum("tij,tj->ti", s.R[:, body], s.Omega[:, body])
        v = point_velocity(s, body, system.load_p[load])
        out += np.sum(force * v, axis=-1) + np.sum(torque * omega, axis=-1)
    for body, force, torque in _user_forces(system, s):
        omega = np.einsum("tij,tj->ti", s.R[:, body], s.Omega[:, body])
        out += np.sum(force * s.v[:, body], axis=-1) + np.sum(torque * omega, axis=-1)
    return out


def work(system: MultibodySystem, t: Float[np.ndarray, " nt"], s: States) -> Float[np.ndarray, " nt"]:
    """Work of all that has power since the start [J]: its integral along the cubic through each step's ends.

    Fourth order: steps of a method of high order are too long for the trapezoidal rule on the power.
    """
    if system.is_conservative:
        return np.zeros(len(t))
    h = np.diff(t)
    gained = sum(w * power(system, between(s, h, x)) for x, w in zip(NODES, WEIGHTS, strict=True))
    return np.concatenate(([0.0], np.cumsum(h * gained)))


NODES = 0.5 + 0.5 * np.array([-1.0, 0.0, 1.0]) * math.sqrt(0.6)  # of Gauss on (0, 1): the work of the cubic's damper
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
REACH = 1e-2  # [rad] that bodies turn at most over a difference; its error is REACH^6 / 140 of the drift
DIFFERENCE = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
PLACES = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)
CHUNK = 500  # instants whose A is held at once


def between(s: States, h: Float[np.ndarray, " nt-1"], x: float) -> States:
    """The motion a part ``x`` into each step of ``h`` [s]: cubic in r, and in theta of R = R_0 exp(theta)."""
    dt = h[:, None, None]
    r, v = _cubic(s.r[:-1], s.r[1:], s.v[:-1], s.v[1:], dt, x)
    turn = so3.log(np.swapaxes(s.R[:-1], -1, -2) @ s.R[1:])
    theta, rate = _cubic(np.zeros_like(turn), turn, s.Omega[:-1], so3.rate_of_vector(turn, s.Omega[1:]), dt, x)
    return States(r, s.R[:-1] @ so3.exp(theta), v, so3.angular_velocity(theta, rate), s.times[:-1] + x * h)


def _cubic(a: np.ndarray, b: np.ndarray, a_dot: np.ndarray, b_dot: np.ndarray, h: np.ndarray, x: float) -> tuple:
    """Value and rate at x of the cubic from a to b over h with these rates at its ends."""
    bend = (b - a) / h - 0.5 * (a_dot + b_dot)  # the rate is a_dot (1 - x) + b_dot x + 6 bend x (1 - x)
    way = a_dot * (x - 0.5 * x * x) + b_dot * 0.5 * x * x + bend * x * x * (3.0 - 2.0 * x)
    return a + h * way, a_dot * (1.0 - x) + b_dot * x + 6.0 * bend * x * (1.0 - x)


def drift(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """The rate of phi_dot at constant velocities, A_dot v + (phi_t)_dot, by sixth-order differences of any rows."""
    rates = (float(np.max(np.abs(a), initial=1.0)) for a in (s.Omega, system.joint_motion[:, 5]))
    dt = REACH / max(rates)

    def ahead(h: float) -> States:
        return States(s.r + h * s.v, s.R @ so3.exp(h * s.Omega), s.v, s.Omega, s.times + h)

    shifted = (c * constraint_rate(system, ahead(x * dt)) for x, c in zip(PLACES, DIFFERENCE, strict=True))
    out: np.ndarray = sum(shifted) / dt
    return out


def drive_power(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """Power of drives [W], -reaction . phi_t with the reaction of index 1: unique where rows are redundant, too."""
    out = np.full(len(s), np.nan)  # stays where a run was no longer finite
    L = np.zeros((system.nb, 6, 6))  # of L L^T = M, with what is lent
    L[:, range(3), range(3)] = np.sqrt(system.mass)[:, None]
    L[:, 3:, 3:] = np.linalg.cholesky(system.regular_inertia)
    inverse = np.linalg.inv(L)
    for k in range(0, len(s), CHUNK):
        part = s.at(slice(k, k + CHUNK))
        push = moving(system, part)
        A = np.zeros((len(part), system.nrows, system.nb, 6))
        for body, rows, translation, rotation in row_parts(system, part):
            A[:, rows, body] += np.concatenate((translation, rotation), axis=-1)
        f = applied(system, part)
        f[:, :, 3:] -= so3.cross(part.Omega, times(system.inertia, part.Omega))
        B = np.einsum("tkbj,bij->tkbi", A, inverse).reshape(len(part), system.nrows, -1)
        A_dot_v = drift(system, part)
        good = (
            np.all(np.isfinite(B), axis=(1, 2)) & np.all(np.isfinite(f), axis=(1, 2)) & np.all(np.isfinite(A_dot_v), 1)
        )
        try:
            reaction = _reaction(system.taken_back, inverse, B[good], f[good], A_dot_v[good])
        except ArithmeticError:  # where a motion went wrong, lent inertia may be all there is
            continue
        out[k + np.flatnonzero(good)] = -np.sum(reaction[:, push.row] * push.phi_t[good], axis=-1)
    return out


def _reaction(P: np.ndarray, inverse: np.ndarray, B: np.ndarray, f: np.ndarray, A_dot_v: np.ndarray) -> np.ndarray:
    """Of index 1, from L^-1 by bodies, B = A L^-T, f and A_dot v; the lent inertia P is taken back."""
    back = np.linalg.pinv(B, rcond=1e-9)

    def solve(load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = np.einsum("bij,tbj->tbi", inverse, f + load).reshape(len(f), -1)
        more = times(back, -A_dot_v - times(B, x))
        a = np.einsum("bji,tbj->tbi", inverse, (x + more).reshape(len(f), -1, 6))
        return a, times(np.swapaxes(back, -1, -2), more)

    reaction: np.ndarray = taken_back(solve, partial(pushed, P))[1]
    return reaction


def _wrench(R: np.ndarray, force: np.ndarray, p: np.ndarray) -> np.ndarray:
    """(force [space], its torque about C [body]) of a force at the point ``p`` of a body."""
    return np.concatenate((force, so3.cross(p, np.einsum("tij,ti->tj", R, force))), axis=-1)


def _load(system: MultibodySystem, s: States, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Force and torque of a load in space (nt, 3)."""
    factor = values(system.load_factor[k : k + 1], s.times)[0]
    R = s.R[:, system.load_i[k]] if system.load_follows[k] else np.broadcast_to(np.eye(3), (len(s.r), 3, 3))
    return factor * (R @ system.load_force[k]), factor * (R @ system.load_torque[k])


def linear_momentum(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt 3"]:
    """sum m r_dot [kg m/s], space frame."""
    return np.einsum("b,tbi->ti", system.mass, s.v)


def angular_momentum(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt 3"]:
    """sum (r x m r_dot + R J Omega) about the origin [kg m2/s], space frame."""
    orbital = np.einsum("b,tbi->ti", system.mass, so3.cross(s.r, s.v))
    return orbital + np.einsum("tbij,bjk,tbk->ti", s.R, system.inertia, s.Omega)


def constraint(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """phi: point and line rows [m], axis rows [-] (module ``joints``); 0 of rows that have none."""
    return _rows(system, s, velocity=False)


def constraint_rate(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """phi_dot = A v + phi_t: point and line rows [m/s], axis rows [1/s]."""
    return _rows(system, s, velocity=True)


def scaling_masses(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """Diagonal of M_bar, Eq. (30), with c = a / (a . a): the weights of the norm of Eq. (81).

    Unit: kg for point and line rows; for axis rows kg m2. Rows a are per body velocities (r_dot [space], Omega [body]).
    """
    aa, aMa = np.zeros((2, len(s.r), system.nrows))
    for body, rows, translation, rotation in row_parts(system, s):
        aa[:, rows] += np.sum(translation**2, axis=-1) + np.sum(rotation**2, axis=-1)
        spin = np.sum(times(system.inertia[body], rotation) * rotation, axis=-1)
        aMa[:, rows] += system.mass[body] * np.sum(translation**2, axis=-1) + spin
    return aMa / aa**2


def row_parts(system: MultibodySystem, s: States) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """A by pieces: bodies (m,), rows (m,), their parts on r_dot [space] and Omega [body] of these bodies (nt, m, 3)."""
    joints, point = system.point_rows()
    line, axis = system.line_rows(), system.axis_rows()
    push = moving(system, s)
    torque = so3.cross(turned(s, system.joint_i[axis.joint], axis.u), turned(s, system.joint_j[axis.joint], axis.n))
    way = _line_ways(system, s, line, velocity=False)[1]
    for ends, arms, sign in ((system.joint_i, system.joint_s_i, 1.0), (system.joint_j, system.joint_s_j, -1.0)):
        m = np.flatnonzero(ends[joints] != GROUND)
        body, arm = ends[joints[m]], arms[joints[m]]
        for c in range(3):  # on Omega: e_c . R (Omega x s) = (s x R^T e_c) . Omega
            unit = np.broadcast_to(sign * np.eye(3)[c], (len(s.r), len(m), 3))
            yield body, point[m, c], unit, sign * so3.cross(arm, s.R[:, body, c])
        m = np.flatnonzero(ends[line.joint] != GROUND)  # a force along the way at the point of i, on both bodies
        body = ends[line.joint[m]]
        x = points(system, s, line.joint[m])[0]
        moment = so3.cross(x - s.r[:, body], way[:, m])
        yield body, line.row[m], sign * way[:, m], sign * times(np.swapaxes(s.R[:, body], -1, -2), moment)
        m = np.flatnonzero(ends[axis.joint] != GROUND)
        body = ends[axis.joint[m]]
        spin = times(np.swapaxes(s.R[:, body], -1, -2), torque[:, m])
        yield body, axis.row[m], np.zeros_like(spin), sign * spin
        m = np.flatnonzero(ends[push.joint] != GROUND)  # a force at the row's own point, on both bodies, and a torque
        body = ends[push.joint[m]]
        moment = push.torque[:, m] + so3.cross(push.point[:, m] - s.r[:, body], push.force[:, m])
        yield body, push.row[m], sign * push.force[:, m], sign * times(np.swapaxes(s.R[:, body], -1, -2), moment)


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
    return s.v[:, body] + np.einsum("tij,tj->ti", s.R[:, body], so3.cross(s.Omega[:, body], p))


def _spring_line(system: MultibodySystem, s: States, k: int) -> tuple[np.ndarray, np.ndarray]:
    i, j = system.spring_i[k], system.spring_j[k]
    d = point_position(s, i, system.spring_p_i[k]) - point_position(s, j, system.spring_p_j[k])
    d_dot = point_velocity(s, i, system.spring_p_i[k]) - point_velocity(s, j, system.spring_p_j[k])
    return d, d_dot


def _line_ways(system: MultibodySystem, s: States, line: LineRows, *, velocity: bool) -> tuple[np.ndarray, np.ndarray]:
    """phi of the line rows (nt, m), or their rates, and the direction of their force: R_j n, or d / L."""
    if not len(line.row):
        return np.zeros((len(s.r), 0)), np.zeros((len(s.r), 0, 3))
    d, n = gaps(system, s, line.joint, velocity=False), turned(s, system.joint_j[line.joint], line.n)
    link = line.length > 0.0
    L = np.where(link, line.length, 1.0)
    way = np.where(link[:, None], d / L[:, None], n)
    if not velocity:
        return np.where(link, 0.5 * (np.sum(d * way, axis=-1) - line.length), np.sum(d * n, axis=-1)), way
    d_dot = gaps(system, s, line.joint, velocity=True)
    n_dot = turning(s, system.joint_j[line.joint], line.n)
    return np.sum(d_dot * way, axis=-1) + np.where(link, 0.0, np.sum(d * n_dot, axis=-1)), way


def _rows(system: MultibodySystem, s: States, *, velocity: bool) -> np.ndarray:
    out = np.empty((len(s.r), system.nrows))
    joints, point = system.point_rows()
    out[:, point] = gaps(system, s, joints, velocity=velocity)
    line, axis = system.line_rows(), system.axis_rows()
    out[:, line.row] = _line_ways(system, s, line, velocity=velocity)[0]
    push = moving(system, s)
    out[:, push.row] = push.rate(system, s) if velocity else push.phi
    ends = (system.joint_i[axis.joint], axis.u), (system.joint_j[axis.joint], axis.n)
    u, n = (turned(s, *end) for end in ends)
    if not velocity:
        out[:, axis.row] = np.sum(u * n, axis=-1)
    else:
        u_dot, n_dot = (turning(s, *end) for end in ends)
        out[:, axis.row] = np.sum(u_dot * n, axis=-1) + np.sum(u * n_dot, axis=-1)
    return out
