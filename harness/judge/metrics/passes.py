"""Compute laws, sizes and errors of a long motion in compiled loops over (t, body, joint), as NumPy does to rounding.

The formulas are stated in NumPy, batched over time, by ``mechanics.motion``, ``scales`` and ``rows``; tests compare
both. NumPy makes some forty temporary arrays over all steps, which costs ten times as much. No compiled function is
imported from another file: numba's cache checks one file alone for changes.
"""

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import numba
import numpy as np
from jaxtyping import Float

from ...base.cache import make_cache_folder
from ...base.seals import remove_unsealed, seal_files
from ...mechanics.state import States
from ...mechanics.system import MultibodySystem, RigidBody, assemble
from ...mechanics.torsion import evaluate_torsion

P = ParamSpec("P")
T = TypeVar("T")
KEPT, FILES = make_cache_folder("laws", Path(__file__).parent / "__pycache__"), "passes.*.nb?"
_before = numba.config.CACHE_DIR
numba.config.CACHE_DIR = str(KEPT)
JIT = {"cache": True, "error_model": "numpy"}
INNER = {**JIT, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # called from here only: compiles faster


def _seal_when_compiled(function: Callable[P, T]) -> Callable[P, T]:
    """Wrap a function that calls compiled code, so that the cache files are sealed after each call that compiled.

    A call compiles if no call before had arrays of these types, for instance read-only ones.
    """

    @functools.wraps(function)
    def call(*given: P.args, **named: P.kwargs) -> T:
        """Call the function, and seal the cache files if it was compiled."""
        before = _count_compiled()
        found = function(*given, **named)
        if _count_compiled() > before:
            seal_files(KEPT, FILES)
        return found

    return call


def _count_compiled() -> int:
    """Return how many compilations this file's functions have had in this process; loads from the cache not counted."""
    passes = (_laws, _displacement, _speeds, _advance_rows, _are_rotations)
    return sum(one.stats.cache_misses.total() for one in passes)


@_seal_when_compiled
def evaluate_laws(system: MultibodySystem, s: States, metres: Float[np.ndarray, " nrows"]) -> tuple[np.ndarray, ...]:
    """Return the seven arrays (nt,) of ``measure._compute_laws``; only for systems that ``covers_rows`` accepts.

    They are T + V [J], five norms of the constraint rows and the largest |R^T R - 1|. ``metres`` are the factors that
    turn constraint rows into metres.
    """
    joint, row = system.point_rows()
    line, axis = system.line_rows(), system.axis_rows()
    out = np.zeros((7, len(s.r)))
    _laws(
        s.r,
        s.R,
        s.v,
        s.Omega,
        system.gravity,
        system.mass,
        system.inertia,
        (system.spring_i, system.spring_j, system.spring_p_i, system.spring_p_j, system.spring_k, system.spring_d0),
        (system.joint_i, system.joint_j, system.joint_s_i, system.joint_s_j),
        (joint, row[:, 0].copy()),
        (line.joint, line.row, line.n, line.length),
        (axis.joint, axis.row, axis.u, axis.n, system.joint_w),
        metres,
        out,
    )
    if len(system.torsion_k):
        out[0] += 0.5 * evaluate_torsion(system, s)[0] ** 2 @ system.torsion_k
    return tuple(out)


def covers_rows(system: MultibodySystem) -> bool:
    """Return whether ``evaluate_laws`` covers all rows of a system: none of a driven joint, or at velocity level."""
    return not np.any(system.joint_moving)


@functools.cache
def load() -> None:
    """Compile all functions of this file, or load them from the cache, once per process; forks inherit them.

    Cache files that have changed since they were sealed are removed first: numba would crash on them.
    """
    remove_unsealed(KEPT, FILES)
    _run_all()


def _run_all() -> None:
    """Call each function once on a body at rest, which compiles it or loads it from the cache."""
    system = assemble([RigidBody(1.0, np.eye(3))], [], (0.0, 0.0, 0.0))
    r, R = np.zeros((2, 1, 3)), np.tile(np.eye(3), (2, 1, 1, 1))
    s = States(r, R, r, r)
    evaluate_laws(system, s, np.zeros(0))
    measure_displacement(system.mass, system.inertia.copy(), s, s)
    measure_speeds(system.mass, system.inertia, s)
    advance_steps(np.ones(2), s, s)
    are_rotations(s.R)


@numba.njit(**INNER)
def _dot(a, b):
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(**INNER)
def _cross(a, b):
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(**INNER)
def _minus(a, b):
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@numba.njit(**INNER)
def _point(x, R, b, p):
    """Return x + R[b] p in space for a point p in the frame of body ``b``; p itself if b is the ground (-1).

    ``x`` is the position of C, or zero if p is a direction.
    """
    if b < 0:
        return p[0], p[1], p[2]
    return (
        x[0] + R[b, 0, 0] * p[0] + R[b, 0, 1] * p[1] + R[b, 0, 2] * p[2],
        x[1] + R[b, 1, 0] * p[0] + R[b, 1, 1] * p[1] + R[b, 1, 2] * p[2],
        x[2] + R[b, 2, 0] * p[0] + R[b, 2, 1] * p[1] + R[b, 2, 2] * p[2],
    )


@numba.njit(**INNER)
def _point_velocity(x, R, W, b, p):
    """Return the velocity x + R[b] (Omega x p) of a point p of body ``b``, with Omega = W[b]; zero for the ground.

    The result is in space, p and Omega are in the body frame; ``x`` is the velocity of C, or zero if p is a direction.
    """
    if b < 0:
        return 0.0, 0.0, 0.0
    return _point(x, R, b, _cross(W[b], p))


@numba.njit(**INNER)
def _to_body_frame(R, b, m):
    """Return R^T m: the space vector ``m`` in the frame of body ``b``."""
    return (
        R[b, 0, 0] * m[0] + R[b, 1, 0] * m[1] + R[b, 2, 0] * m[2],
        R[b, 0, 1] * m[0] + R[b, 1, 1] * m[1] + R[b, 2, 1] * m[2],
        R[b, 0, 2] * m[0] + R[b, 1, 2] * m[1] + R[b, 2, 2] * m[2],
    )


@numba.njit(**INNER)
def _quadratic_form(J, b, a):
    """Return a . J a with the inertia J of body ``b``."""
    return a[0] * _dot(J[b, 0], a) + a[1] * _dot(J[b, 1], a) + a[2] * _dot(J[b, 2], a)


@numba.njit(**INNER)
def _add_row(sums, gap, open_, rate, unit, aa, aMa):
    """Add a constraint row, in place, to five sums of squares: phi, phi_dot, both again in metres, and Eq. (81).

    ``gap`` is phi, ``rate`` phi_dot, ``unit`` the factor that turns the row into metres; ``open_`` is phi as
    ``motion.measure_gaps`` has it, which does not vanish for a joint assembled half a turn off. ``aa`` is a . a of the
    row a of A, and ``aMa`` is a . M a.
    """
    sums[0] += gap * gap
    sums[1] += rate * rate
    sums[2] += (open_ * unit) ** 2
    sums[3] += (rate * unit) ** 2
    sums[4] += aMa / (aa * aa) * (rate * rate)


@numba.njit(**JIT)
def _laws(r, R, v, W, g, mass, J, springs, joints, points, lines, axes, metres, out):
    """Fill ``out`` (7, nt) with T + V [J], five norms of the constraint rows and the largest |R^T R - 1| at each time.

    V is that of gravity ``g`` and point-to-point springs; torsional springs are added by ``evaluate_laws``. The tuples
    ``springs`` to ``axes`` hold arrays of the system, named where they are unpacked: springs; joints; rows that hold a
    point; rows along a line or of a length; rows that hold an axis. ``metres`` are the factors from rows to metres.
    """
    spring_i, spring_j, spring_p_i, spring_p_j, stiffness, rest = springs
    joint_i, joint_j, arm_i, arm_j = joints
    point_joint, point_row = points
    line_joint, line_row, line_n, length = lines
    axis_joint, axis_row, axis_u, axis_n, joint_w = axes
    nt, nb = len(r), len(mass)
    zero, sums = (0.0, 0.0, 0.0), np.zeros(5)
    for t in range(nt):
        rt, Rt, vt, Wt = r[t], R[t], v[t], W[t]
        E = worst = 0.0
        for b in range(nb):
            E += 0.5 * (mass[b] * _dot(vt[b], vt[b]) + _quadratic_form(J, b, Wt[b]))
            E -= mass[b] * _dot(g, rt[b])
            off = 0.0
            for k in range(3):
                for m in range(3):
                    d = Rt[b, 0, k] * Rt[b, 0, m] + Rt[b, 1, k] * Rt[b, 1, m] + Rt[b, 2, k] * Rt[b, 2, m]
                    d -= 1.0 if k == m else 0.0
                    off += d * d
            if off > worst or off != off:
                worst = off
        for k in range(len(stiffness)):
            i, j = spring_i[k], spring_j[k]
            p = _point(rt[i] if i >= 0 else rt[0], Rt, i, spring_p_i[k])
            q = _point(rt[j] if j >= 0 else rt[0], Rt, j, spring_p_j[k])
            d = math.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)
            E += 0.5 * stiffness[k] * (d - rest[k]) ** 2
        sums[:] = 0.0
        for k in range(len(point_joint)):
            n = point_joint[k]
            i, j = joint_i[n], joint_j[n]
            p = _point(rt[i] if i >= 0 else rt[0], Rt, i, arm_i[n])
            q = _point(rt[j] if j >= 0 else rt[0], Rt, j, arm_j[n])
            p_dot = _point_velocity(vt[i] if i >= 0 else vt[0], Rt, Wt, i, arm_i[n])
            q_dot = _point_velocity(vt[j] if j >= 0 else vt[0], Rt, Wt, j, arm_j[n])
            for c in range(3):
                aa = aMa = 0.0
                for end in range(2):
                    b = i if end == 0 else j
                    s = arm_i[n] if end == 0 else arm_j[n]
                    if b >= 0:  # s x R^T e_c
                        x = _cross(s, Rt[b, c])
                        aa += 1.0 + _dot(x, x)
                        aMa += mass[b] + _quadratic_form(J, b, x)
                _add_row(sums, p[c] - q[c], p[c] - q[c], p_dot[c] - q_dot[c], metres[point_row[k] + c], aa, aMa)
        for k in range(len(line_joint)):
            n = line_joint[k]
            i, j = joint_i[n], joint_j[n]
            p = _point(rt[i] if i >= 0 else rt[0], Rt, i, arm_i[n])
            q = _point(rt[j] if j >= 0 else rt[0], Rt, j, arm_j[n])
            p_dot = _point_velocity(vt[i] if i >= 0 else vt[0], Rt, Wt, i, arm_i[n])
            q_dot = _point_velocity(vt[j] if j >= 0 else vt[0], Rt, Wt, j, arm_j[n])
            d, e = _minus(p, q), _minus(p_dot, q_dot)
            if length[k] > 0.0:
                w = (d[0] / length[k], d[1] / length[k], d[2] / length[k])
                gap, gap_dot = 0.5 * (_dot(d, w) - length[k]), _dot(e, w)
            else:
                w = _point(zero, Rt, j, line_n[k])
                gap, gap_dot = _dot(d, w), _dot(e, w) + _dot(d, _point_velocity(zero, Rt, Wt, j, line_n[k]))
            aa = aMa = 0.0
            for end in range(2):
                b = i if end == 0 else j
                if b >= 0:
                    x, ww = _to_body_frame(Rt, b, _cross(_minus(p, rt[b]), w)), _dot(w, w)
                    aa += ww + _dot(x, x)
                    aMa += mass[b] * ww + _quadratic_form(J, b, x)
            _add_row(sums, gap, gap, gap_dot, metres[line_row[k]], aa, aMa)
        for k in range(len(axis_joint)):
            n = axis_joint[k]
            i, j = joint_i[n], joint_j[n]
            u, w = _point(zero, Rt, i, axis_u[k]), _point(zero, Rt, j, axis_n[k])
            gap, m = _dot(u, w), _cross(u, w)
            gap_dot = _dot(_point_velocity(zero, Rt, Wt, i, axis_u[k]), w) + _dot(
                u, _point_velocity(zero, Rt, Wt, j, axis_n[k])
            )
            aa = aMa = 0.0
            for end in range(2):
                b = i if end == 0 else j
                if b >= 0:
                    x = _to_body_frame(Rt, b, m)
                    aa += _dot(x, x)
                    aMa += _quadratic_form(J, b, x)
            open_ = gap
            if k > 1 and axis_joint[k - 2] == n:  # the row vanishes half a turn away as well (``motion.measure_gaps``)
                wn = _dot(_point(zero, Rt, i, joint_w[n]), _point(zero, Rt, j, axis_n[k - 2]))
                open_ = 2.0 - abs(gap) if wn < 0.0 else gap
            _add_row(sums, gap, open_, gap_dot, metres[axis_row[k]], aa, aMa)
        out[0, t], out[6, t] = E, math.sqrt(worst)
        for k in range(5):
            out[1 + k, t] = math.sqrt(sums[k])


@_seal_when_compiled
def measure_displacement(mass: np.ndarray, moments: np.ndarray, a: States, b: States) -> Float[np.ndarray, "nt nb"]:
    """Return the distance [m] between two poses of each body, as ``scales.measure_displacement``.

    ``moments`` are the second moments of the bodies' mass about C [kg m2], body frame; ``b`` may be one instant.
    """
    out = np.empty(a.r.shape[:2])
    _displacement(mass, moments, a.r, a.R, b.r, b.R, out)
    return out


@numba.njit(**JIT)
def _displacement(mass, S, r_a, R_a, r_b, R_b, out):
    """Fill ``out`` (nt, nb) with the root mean square distance [m] of each body's matter between the poses a and b.

    ``S`` are the second moments of the bodies' mass [kg m2]. Pose b may be one instant for all times of a.
    """
    nt, nb = out.shape
    one = len(r_b) == 1
    for t in range(nt):
        u = 0 if one else t
        for b in range(nb):
            turn = 0.0
            for k in range(3):
                turn += _quadratic_form(S, b, _minus(R_a[t, b, k], R_b[u, b, k]))
            turn /= mass[b]
            if turn < 0.0:
                turn = 0.0
            x = _minus(r_a[t, b], r_b[u, b])
            out[t, b] = math.sqrt(_dot(x, x) + turn)


@_seal_when_compiled
def measure_speeds(mass: np.ndarray, inertia: np.ndarray, s: States) -> Float[np.ndarray, "nt nb"]:
    """Return the root mean square speed of each body's matter [m/s], as ``scales.measure_speeds``."""
    out = np.empty(s.r.shape[:2])
    _speeds(mass, inertia, s.v, s.Omega, out)
    return out


@numba.njit(**JIT)
def _speeds(mass, J, v, W, out):
    """Fill ``out`` (nt, nb) with sqrt(2 T / m) of each body [m/s]."""
    nt, nb = out.shape
    for t in range(nt):
        for b in range(nb):
            out[t, b] = math.sqrt(_dot(v[t, b], v[t, b]) + _quadratic_form(J, b, W[t, b]) / mass[b])


@_seal_when_compiled
def advance_steps(h: Float[np.ndarray, " steps"], a: States, b: States) -> States:
    """Advance the poses of ``a`` over steps ``h`` [s], by the mean velocities of ``a`` and ``b``, as ``rows._advance``.

    The states returned have the advanced poses and these mean velocities.
    """
    out = tuple(np.empty_like(x) for x in (a.r, a.R, a.v, a.Omega))
    _advance_rows(h, a.r, a.R, a.v, a.Omega, b.v, b.Omega, *out)
    return States(*out)


@numba.njit(**JIT)
def _advance_rows(h, r, R, v_a, W_a, v_b, W_b, r_out, R_out, v_out, W_out):
    """Fill the arrays ``*_out`` with the poses after each step ``h`` [s] and the mean velocities over it."""
    nt, nb = r.shape[:2]
    for t in range(nt):
        for b in range(nb):
            for k in range(3):
                v_out[t, b, k] = 0.5 * (v_a[t, b, k] + v_b[t, b, k])
                W_out[t, b, k] = 0.5 * (W_a[t, b, k] + W_b[t, b, k])
                r_out[t, b, k] = r[t, b, k] + h[t] * v_out[t, b, k]
            x, y, z = h[t] * W_out[t, b, 0], h[t] * W_out[t, b, 1], h[t] * W_out[t, b, 2]
            angle = math.sqrt(x * x + y * y + z * z)
            half = 0.5 * angle
            f = math.sin(half) / angle if angle > 1e-3 else 0.5 - angle * angle / 48.0 + angle**4 / 3840.0
            w, x, y, z = math.cos(half), f * x, f * y, f * z  # as a quaternion
            e = (
                (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
                (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
                (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
            )
            for k in range(3):
                p, q, s = R[t, b, k, 0], R[t, b, k, 1], R[t, b, k, 2]
                R_out[t, b, k, 0] = p * e[0][0] + q * e[1][0] + s * e[2][0]
                R_out[t, b, k, 1] = p * e[0][1] + q * e[1][1] + s * e[2][1]
                R_out[t, b, k, 2] = p * e[0][2] + q * e[1][2] + s * e[2][2]


@_seal_when_compiled
def are_rotations(R: Float[np.ndarray, "nt nb 3 3"]) -> bool:
    """Return whether det R is finite and positive everywhere; that R is orthogonal is not checked."""
    return bool(_are_rotations(R))


@numba.njit(**JIT)
def _are_rotations(R):
    """Return whether det R is finite and positive of all bodies at all times."""
    for t in range(R.shape[0]):
        for b in range(R.shape[1]):
            A = R[t, b]
            if not (0.0 < _dot(A[0], _cross(A[1], A[2])) < math.inf):
                return False
    return True


numba.config.CACHE_DIR = _before
