"""Directions c_R and the coefficients they give each constraint row: M_bar, f_bar (Eq. 30).

``a . c = 1`` (Eq. 31) leaves c free; three choices:

- ``a``: c = a / (a . a), defined where M is singular too;
- ``mass``: c = M^-1 a / (a . M^-1 a);
- ``translation``: c = (e_k, 0) on the first body, for spherical joints: M_bar = m, f_bar = applied force.
"""

from numba import njit

from .vectors import INNER, cross, dot, put, times, turn, turn_back

CHOICES = ("a", "mass", "translation")
ALONG_A, ALONG_MASS, TRANSLATION = range(3)


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
                x = rotation_part(model.s[j, e], motion.R[b], motion.a[j], k)
                torque = turn_back(motion.R[b], motion.wrench[b, 3:])
                if choice == ALONG_A:
                    size += dot(x, x)
                    inertia += dot(x, turn(model.J[b], x))
                    force += sign * dot(torque, x)
                    if k < 3:
                        size += 1.0
                        inertia += model.mass[b]
                        force += sign * motion.wrench[b, k]
                else:
                    y = turn(model.J_inv[b], x)
                    size += dot(x, y)
                    force += sign * dot(torque, y)
                    if k < 3:
                        size += 1.0 / model.mass[b]
                        force += sign * motion.wrench[b, k] / model.mass[b]
            scale = 1.0 / size
            motion.m_bar[row] = inertia * scale * scale if choice == ALONG_A else scale
            motion.f_bar[row] = force * scale


@njit(**INNER)
def rotation_part(s, R, a, k):
    """Rotational part of A's row k on one end, in its body's frame and without its sign: s x R^T e_k, or R^T a."""
    return cross(s, R[k]) if k < 3 else turn_back(R, a[k - 3])


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
        x = times(sign, rotation_part(model.s[j, e], motion.R[b], motion.a[j], k))
        y = x if choice == ALONG_A else turn(model.J_inv[b], x)
        put(y, c[3:])
        if k < 3:
            c[k] = sign if choice == ALONG_A else sign / model.mass[b]
            size += sign * c[k]
        size += dot(x, y)
    for e in range(2):
        for q in range(6):
            motion.c[row, e, q] /= size
