"""Directions c_R and the coefficients they give each constraint row: M_bar, f_bar (Eq. 30).

``a . c = 1`` (Eq. 31) leaves c free; three choices:

- ``a``: c = a / (a . a), defined where M is singular too;
- ``mass``: c = M^-1 a / (a . M^-1 a);
- ``translation``: c = (e_k, 0) on the first body, for spherical joints: M_bar = m, f_bar = applied force.
"""

from numba import njit

from ..methods.choices import ALONG_A, TRANSLATION
from .vectors import INNER, cross, dot, plus, put, times, turn, turn_back


@njit(**INNER)
def masses_and_forces(model, motion, choice):
    """M_bar = c . M c and f_bar = c . f of all rows in closed form; ``size`` is a . a, or a . M^-1 a."""
    for j in range(len(model.body)):
        for k in range(model.row[j + 1] - model.row[j]):
            row = model.row[j] + k
            if choice == TRANSLATION:
                motion.m_bar[row] = model.mass[model.body[j, 0]]
                motion.f_bar[row] = motion.wrench[model.body[j, 0], k]
                continue
            size, inertia, force = 0.0, 0.0, 0.0
            for e in range(2):
                b, sign = model.body[j, e], 1.0 - 2.0 * e
                if b < 0:
                    continue
                t, x = row_on(model, motion, j, e, k)
                torque = turn_back(motion.R[b], motion.wrench[b, 3:])
                if choice == ALONG_A:
                    size += dot(x, x) + dot(t, t)
                    inertia += dot(x, turn(model.J[b], x)) + model.mass[b] * dot(t, t)
                    force += sign * (dot(torque, x) + dot(t, motion.wrench[b]))
                else:
                    y = turn(model.J_inv[b], x)
                    size += dot(x, y) + dot(t, t) / model.mass[b]
                    force += sign * (dot(torque, y) + dot(t, motion.wrench[b]) / model.mass[b])
            scale = 1.0 / size
            motion.m_bar[row] = inertia * scale * scale if choice == ALONG_A else scale
            motion.f_bar[row] = force * scale


@njit(**INNER)
def row_on(model, motion, j, e, k):
    """A's row k of a joint on one end without its sign: translation [space], e_k, f or 0; rotation [body]."""
    R = motion.R[model.body[j, e]]
    if model.lines[j]:
        f = motion.f[j, k]
        return (f[0], f[1], f[2]), turn_back(R, plus(cross(motion.arm[j, e], f), motion.a[j, k]))
    if model.pins[j] and k < 3:
        return (1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)), cross(model.s[j, e], R[k])
    return (0.0, 0.0, 0.0), turn_back(R, motion.a[j, k - 3 * model.pins[j]])


@njit(**INNER)
def direction(model, motion, j, row, choice):
    """Fill ``motion.c[row]``: c_R on both ends (translation [space], rotation [body])."""
    motion.c[row, :, :] = 0.0
    k, size = row - model.row[j], 0.0
    if choice == TRANSLATION:
        motion.c[row, 0, k] = 1.0
        return
    for e in range(2):
        b, sign, c = model.body[j, e], 1.0 - 2.0 * e, motion.c[row, e]
        if b < 0:
            continue
        t, x = row_on(model, motion, j, e, k)
        y = x if choice == ALONG_A else turn(model.J_inv[b], x)
        z = t if choice == ALONG_A else times(1.0 / model.mass[b], t)
        put(times(sign, z), c)
        put(times(sign, y), c[3:])
        size += dot(t, z) + dot(x, y)
    for e in range(2):
        for q in range(6):
            motion.c[row, e, q] /= size
