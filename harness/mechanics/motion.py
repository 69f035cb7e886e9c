"""Compute quantities of a motion of any origin: energy, momenta, phi and phi_dot, batched over time.

The code is the same for every solver: it uses poses and velocities (r, R, v, Omega) alone, never its coordinates.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from . import so3
from .ends import apply_matrices, find_gap_vectors, find_points, find_vector_rates, turn_vectors
from .joints import LineRows
from .moving_rows import evaluate_moving_rows
from .state import States
from .system import GROUND, MultibodySystem
from .time_functions import evaluate_functions
from .torsion import evaluate_torsion


def kinetic_energy(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """Return T [J] of all bodies at each time, Eq. (4) in body velocities."""
    translation = np.einsum("b,tbi,tbi->t", system.mass, s.v, s.v)
    rotation = np.einsum("tbi,bij,tbj->t", s.Omega, system.inertia, s.Omega)
    return 0.5 * (translation + rotation)


def potential_energy(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """Return V [J] at each time: of gravity (zero at the origin) and springs (zero at rest length or angle)."""
    V = -np.einsum("b,i,tbi->t", system.mass, system.gravity, s.r)
    for k in range(len(system.spring_k)):
        d, _ = evaluate_spring_line(system, s, k)
        V = V + 0.5 * system.spring_k[k] * (np.linalg.norm(d, axis=-1) - system.spring_d0[k]) ** 2
    if len(system.torsion_k):
        V = V + 0.5 * evaluate_torsion(system, s)[0] ** 2 @ system.torsion_k
    return V


def energy(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """Return the mechanical energy T + V [J] at each time."""
    return kinetic_energy(system, s) + potential_energy(system, s)


def applied_loads(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nb 6"]:
    """Return the sum of applied forces on each body [N, space], and of torques about C [N m, body].

    These are gravity, springs, dampers, loads and user forces; reactions of joints are left out.
    """
    out = np.zeros((len(s.r), system.nb + 1, 6))  # the last one is the ground
    out[:, :-1, :3] = system.mass[:, None] * system.gravity
    for k in range(len(system.spring_k)):
        d, d_dot = evaluate_spring_line(system, s, k)
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
        angle, rate, m = evaluate_torsion(system, s)
        pull = -(system.torsion_k * angle + system.torsion_c * rate)[..., None] * m
        for k, ends in enumerate(zip(system.torsion_i, system.torsion_j, strict=True)):
            for body, sign in zip(ends, (1.0, -1.0), strict=True):
                if body != GROUND:
                    out[:, body, 3:] += sign * np.einsum("tij,ti->tj", s.R[:, body], pull[:, k])
    for load, body in enumerate(system.load_i):
        force, torque = evaluate_load(system, s, load)
        out[:, body] += _wrench(s.R[:, body], force, system.load_p[load])
        out[:, body, 3:] += np.einsum("tij,ti->tj", s.R[:, body], torque)
    for body, force, torque in list_user_loads(system, s):
        out[:, body] += np.concatenate((force, np.einsum("tij,ti->tj", s.R[:, body], torque)), axis=-1)
    return out[:, :-1]


def list_user_loads(system: MultibodySystem, s: States) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield for each body of a user force: the body, its force at C [N] and torque about it [N m], in space (nt, 3)."""
    for i, j, law in zip(system.user_i, system.user_j, system.user_law, strict=True):
        values = law.evaluate(s, i, j)
        yield from ((body, values[:, e], values[:, 2 + e]) for e, body in enumerate((i, j)) if body != GROUND)


# [rad] bodies turn at most over a difference, whose error is REACH^6 / 140 of the drift. Half changes accelerations of
# Bricard's linkage by 2e-13 of the largest, twice by 1e-11.
REACH = 1e-2
DIFFERENCE = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
POSES = 2**11  # of a difference at once, times its places: more does not stay in a processor's cache
PLACES = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)


def choose_difference_step(system: MultibodySystem, s: States) -> float:
    """Return the step [s] of differences of a motion's rates: no body or drive turns by more than ``REACH`` in it."""
    return REACH / max(float(np.max(np.abs(a), initial=1.0)) for a in (s.Omega, system.joint_motion[:, 5]))


def evaluate_acceleration_bias(
    system: MultibodySystem, s: States, steps: Float[np.ndarray, " nt"] | None = None
) -> Float[np.ndarray, "nt nrows"]:
    """Return A_dot v + (phi_t)_dot, the rate of phi_dot at constant velocities, by sixth-order differences.

    ``steps`` [s] are the steps of the differences at each time, by default ``choose_difference_step`` of the motion.
    """
    dt = np.full(len(s), choose_difference_step(system, s)) if steps is None else steps
    if (most := max(1, POSES // system.nb)) < len(s):
        some = (slice(k, k + most) for k in range(0, len(s), most))
        return np.concatenate([evaluate_acceleration_bias(system, s.at(k), dt[k]) for k in some])
    h = np.array(PLACES)[:, None] * dt  # all places at once: few instants cost the calls alone
    x, n = h[:, :, None, None], len(PLACES)
    r, R, times = s.r + x * s.v, s.R @ so3.exp(x * s.Omega), s.times + h
    v, Omega = (np.tile(a, (n, 1, 1)) for a in (s.v, s.Omega))
    angles = None if s.angles is None else np.tile(s.angles, (n, 1))
    ahead = States(r.reshape(v.shape), R.reshape(-1, *R.shape[2:]), v, Omega, times.ravel(), angles)
    rates = constraint_rate(system, ahead).reshape(n, len(s), system.nrows)
    out: np.ndarray = sum(c * rate for rate, c in zip(rates, DIFFERENCE, strict=True)) / dt[:, None]
    return out


def _wrench(R: np.ndarray, force: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return (force [space], its torque about C [body]) for a force at the point ``p`` of a body."""
    return np.concatenate((force, so3.cross(p, np.einsum("tij,ti->tj", R, force))), axis=-1)


def evaluate_load(system: MultibodySystem, s: States, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return force [N] and torque [N m] of load ``k`` in space (nt, 3), at the times and poses of ``s``."""
    factor = evaluate_functions(system.load_factor[k : k + 1], s.times)[0]
    R = s.R[:, system.load_i[k]] if system.load_follows[k] else np.broadcast_to(np.eye(3), (len(s.r), 3, 3))
    return factor * (R @ system.load_force[k]), factor * (R @ system.load_torque[k])


def linear_momentum(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt 3"]:
    """Return sum m r_dot [kg m/s], space frame."""
    return np.einsum("b,tbi->ti", system.mass, s.v)


def angular_momentum(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt 3"]:
    """Return sum (r x m r_dot + R J Omega) about the origin [kg m2/s], space frame."""
    orbital = np.einsum("b,tbi->ti", system.mass, so3.cross(s.r, s.v))
    return orbital + np.einsum("tbij,bjk,tbk->ti", s.R, system.inertia, s.Omega)


def constraint(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """Return phi: point and line rows [m], axis rows [-] (module ``joints``); 0 for rows that have none."""
    return _evaluate_rows(system, s, velocity=False)


def measure_gaps(
    system: MultibodySystem, s: States, phi: Float[np.ndarray, "nt nrows"] | None = None
) -> Float[np.ndarray, "nt nrows"]:
    """Return phi, but 2 - |phi| with the sign of phi for joints assembled half a turn away, so that it does not vanish.

    Half a turn away two kinds of rows vanish as well: of driven angles, sin(theta - f), and the last row of fixed and
    prismatic joints, the sine of the turn about the axis. The others have no second root, or one that is the same
    joint: the axis of a hinge is a line. ``phi`` is what ``constraint`` returns, if it is known already.
    """
    phi = constraint(system, s) if phi is None else phi.copy()
    if not np.any(system.joint_axes) and not np.any(system.joint_moving):
        return phi
    moving, axis = evaluate_moving_rows(system, s), system.axis_rows()
    # the first of the three axis rows of a joint; w . n_1 is the cosine of the turn about the axis
    first = np.flatnonzero(np.append(axis.joint[:-2] == axis.joint[2:], [False, False]))
    joint = axis.joint[first]
    w, n = (
        turn_vectors(s, system.joint_i[joint], system.joint_w[joint]),
        turn_vectors(s, system.joint_j[joint], axis.n[first]),
    )
    for row, cosine in ((axis.row[first + 2], np.sum(w * n, axis=-1)), (moving.row, moving.cosine)):
        sign = np.where(phi[:, row] < 0.0, -1.0, 1.0)
        phi[:, row] = np.where(cosine < 0.0, sign * (2.0 - np.abs(phi[:, row])), phi[:, row])
    return phi


def constraint_rate(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """Return phi_dot = A v + phi_t: point and line rows [m/s], axis rows [1/s]."""
    return _evaluate_rows(system, s, velocity=True)


def evaluate_scaling_masses(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nrows"]:
    """Return the diagonal of M_bar, Eq. (30), with c = a / (a . a): the weights of the norm of Eq. (81).

    It is in kg for point and line rows, in kg m2 for axis rows; a are the rows of A for (r_dot [space], Omega [body]).
    """
    aa, aMa = np.zeros((2, len(s.r), system.nrows))
    for body, rows, translation, rotation in list_jacobian_parts(system, s):
        aa[:, rows] += np.sum(translation**2, axis=-1) + np.sum(rotation**2, axis=-1)
        spin = np.sum(apply_matrices(system.inertia[body], rotation) * rotation, axis=-1)
        aMa[:, rows] += system.mass[body] * np.sum(translation**2, axis=-1) + spin
    return aMa / aa**2


def list_jacobian_parts(
    system: MultibodySystem, s: States
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Yield A in pieces: bodies (m,), constraint rows (m,), and A's entries there for r_dot [space] and Omega [body].

    The entries are (nt, m, 3) each; a pair of a body and a row occurs once at most in a piece.
    """
    joints, point = system.point_rows()
    line, axis = system.line_rows(), system.axis_rows()
    moving = evaluate_moving_rows(system, s)
    torque = so3.cross(
        turn_vectors(s, system.joint_i[axis.joint], axis.u), turn_vectors(s, system.joint_j[axis.joint], axis.n)
    )
    direction = _evaluate_line_rows(system, s, line, velocity=False)[1]
    for ends, arms, sign in ((system.joint_i, system.joint_s_i, 1.0), (system.joint_j, system.joint_s_j, -1.0)):
        m = np.flatnonzero(ends[joints] != GROUND)
        body, arm = ends[joints[m]], arms[joints[m]]
        for c in range(3):  # on Omega: e_c . R (Omega x s) = (s x R^T e_c) . Omega
            unit = np.broadcast_to(sign * np.eye(3)[c], (len(s.r), len(m), 3))
            yield body, point[m, c], unit, sign * so3.cross(arm, s.R[:, body, c])
        m = np.flatnonzero(ends[line.joint] != GROUND)  # a force along it at the point of i, on both bodies
        body = ends[line.joint[m]]
        x = find_points(system, s, line.joint[m])[0]
        moment = so3.cross(x - s.r[:, body], direction[:, m])
        rotation = apply_matrices(np.swapaxes(s.R[:, body], -1, -2), moment)
        yield body, line.row[m], sign * direction[:, m], sign * rotation
        m = np.flatnonzero(ends[axis.joint] != GROUND)
        body = ends[axis.joint[m]]
        spin = apply_matrices(np.swapaxes(s.R[:, body], -1, -2), torque[:, m])
        yield body, axis.row[m], np.zeros_like(spin), sign * spin
        m = np.flatnonzero(ends[moving.joint] != GROUND)  # a force at the row's own point, on both bodies, and a torque
        body = ends[moving.joint[m]]
        moment = moving.torque[:, m] + so3.cross(moving.point[:, m] - s.r[:, body], moving.force[:, m])
        yield (
            body,
            moving.row[m],
            sign * moving.force[:, m],
            sign * apply_matrices(np.swapaxes(s.R[:, body], -1, -2), moment),
        )


def constraint_energy_norm(
    system: MultibodySystem, s: States, rate: Float[np.ndarray, "nt nrows"] | None = None
) -> Float[np.ndarray, " nt"]:
    """Return the norm of Eq. (81), sqrt(phi_dot^T M_bar phi_dot) [sqrt(J)], at each time.

    ``rate`` is phi_dot as ``constraint_rate`` returns it, if it is known already.
    """
    rate = constraint_rate(system, s) if rate is None else rate
    return np.sqrt(np.sum(evaluate_scaling_masses(system, s) * rate**2, axis=-1))


def point_position(s: States, body: int, p: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "nt 3"]:
    """Return the space position [m] of the point ``p`` of a body (from C, body frame); the ground is body -1."""
    if body == GROUND:
        return np.broadcast_to(np.asarray(p, dtype=float), (len(s.r), 3))
    return s.r[:, body] + s.R[:, body] @ p


def point_velocity(s: States, body: int, p: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "nt 3"]:
    """Return the space velocity [m/s] of the point ``p`` of a body (from C, body frame); the ground is body -1."""
    if body == GROUND:
        return np.zeros((len(s.r), 3))
    return s.v[:, body] + np.einsum("tij,tj->ti", s.R[:, body], so3.cross(s.Omega[:, body], p))


def evaluate_spring_line(system: MultibodySystem, s: States, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the vector from the end on j to the end on i of spring ``k`` [m], and its rate [m/s], in space (nt, 3)."""
    i, j = system.spring_i[k], system.spring_j[k]
    d = point_position(s, i, system.spring_p_i[k]) - point_position(s, j, system.spring_p_j[k])
    d_dot = point_velocity(s, i, system.spring_p_i[k]) - point_velocity(s, j, system.spring_p_j[k])
    return d, d_dot


def _evaluate_line_rows(
    system: MultibodySystem, s: States, line: LineRows, *, velocity: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return phi of the line rows (nt, m), or phi_dot if ``velocity``, and the direction of their force (nt, m, 3).

    The direction, in space, is R_j n, or d / L for a distance.
    """
    if not len(line.row):
        return np.zeros((len(s.r), 0)), np.zeros((len(s.r), 0, 3))
    d, n = find_gap_vectors(system, s, line.joint, velocity=False), turn_vectors(s, system.joint_j[line.joint], line.n)
    link = line.length > 0.0
    L = np.where(link, line.length, 1.0)
    direction = np.where(link[:, None], d / L[:, None], n)
    if not velocity:
        return np.where(link, 0.5 * (np.sum(d * direction, axis=-1) - line.length), np.sum(d * n, axis=-1)), direction
    d_dot = find_gap_vectors(system, s, line.joint, velocity=True)
    n_dot = find_vector_rates(s, system.joint_j[line.joint], line.n)
    return np.sum(d_dot * direction, axis=-1) + np.where(link, 0.0, np.sum(d * n_dot, axis=-1)), direction


def _evaluate_rows(system: MultibodySystem, s: States, *, velocity: bool) -> np.ndarray:
    """Return phi (nt, nrows), or phi_dot if ``velocity``: point, line, moving and axis rows, each in its place."""
    out = np.empty((len(s.r), system.nrows))
    joints, point = system.point_rows()
    out[:, point] = find_gap_vectors(system, s, joints, velocity=velocity)
    line, axis = system.line_rows(), system.axis_rows()
    out[:, line.row] = _evaluate_line_rows(system, s, line, velocity=velocity)[0]
    if np.any(system.joint_moving):
        moving = evaluate_moving_rows(system, s)
        out[:, moving.row] = moving.rate(system, s) if velocity else moving.phi
    if not len(axis.row):
        return out
    ends = (system.joint_i[axis.joint], axis.u), (system.joint_j[axis.joint], axis.n)
    u, n = (turn_vectors(s, *end) for end in ends)
    if not velocity:
        out[:, axis.row] = np.sum(u * n, axis=-1)
    else:
        u_dot, n_dot = (find_vector_rates(s, *end) for end in ends)
        out[:, axis.row] = np.sum(u_dot * n, axis=-1) + np.sum(u * n_dot, axis=-1)
    return out
