"""Line rows on the index-1 kernel: X, f, gamma and phi (compiled); the mean rows of a discrete gradient.

With d = x_i - x_j and its part b of d_ddot without accelerations, b = w x (w x s) of i less that of j::

    plane      phi = n . d                     gamma = n . b + 2 n_dot . d_dot + n_ddot . d, n_ddot = w x (w x n)
    distance   phi = (d . d - L^2) / (2 L)     gamma = (d . b + d_dot . d_dot) / L
"""

from numba import njit

from ..moving import gamma, moving_row
from ..vectors import INNER, cross, dot, minus, plus, put, times, turn, turn_back

ZERO = (0.0, 0.0, 0.0)


@njit(**INNER)
def line_rows(model, k, j):
    """Rows of a joint with line or moving rows, from the poses and velocities of ``k``."""
    if model.kind[j]:
        _moving_rows(model, k, j)
        return
    x, x_dot, bend = _point(model, k, j, 0)
    y, y_dot, other = _point(model, k, j, 1)
    d, d_dot, bend = minus(x, y), minus(x_dot, y_dot), minus(bend, other)
    for c in range(model.lines[j]):
        row, L, n = model.row[j] + c, model.length[j], model.normal[j, c]
        if L > 0.0:
            f = times(1.0 / L, d)
            k.phi[row] = 0.5 * (dot(d, d) / L - L)
            k.gamma[row] = dot(f, bend) + dot(d_dot, d_dot) / L
        else:
            f, n_dot, n_ddot = _direction(k, model.body[j, 1], n)
            k.phi[row] = dot(f, d)
            k.gamma[row] = dot(f, bend) + 2.0 * dot(n_dot, d_dot) + dot(n_ddot, d)
        put(f, k.way[j, c])
        put_moments(model, k.r, k.R, k.X, j, c, x, f)


@njit(**INNER)
def _moving_rows(model, k, j):
    for c in range(model.lines[j]):
        row = model.row[j] + c
        (phi, phi_t, phi_tt), f, f_dot, m, m_dot, x, x_dot = moving_row(model, k.r, k.R, k.v, k.t[0], j, c)
        k.phi[row], k.slip[row] = phi, phi_t
        k.gamma[row] = gamma(model, k.r, k.R, k.v, j, phi_tt, f, f_dot, m_dot, x, x_dot)
        put(f, k.way[j, c])
        for e in range(2):
            b = model.body[j, e]
            if b >= 0:
                moment = plus(cross(minus(x, k.r[b]), f), m)
                put(times(1.0 - 2.0 * e, turn_back(k.R[b], moment)), k.X[j, e, c])


@njit(**INNER)
def put_moments(model, r, R, X, j, c, x, f):
    """X of the force f at the point x, on both ends."""
    for e in range(2):
        b = model.body[j, e]
        if b >= 0:
            put(times(1.0 - 2.0 * e, turn_back(R[b], cross(minus(x, r[b]), f))), X[j, e, c])


@njit(**INNER)
def _direction(k, b, n):
    """n, n_dot and n_ddot (without Omega_dot) in space."""
    if b < 0:
        return (n[0], n[1], n[2]), ZERO, ZERO
    W = k.v[b, 3:]
    n_dot = cross(W, n)
    return turn(k.R[b], n), turn(k.R[b], n_dot), turn(k.R[b], cross(W, n_dot))


@njit(**INNER)
def _point(model, k, j, e):
    """Point of an end: x, x_dot, and x_ddot without accelerations."""
    b, s = model.body[j, e], model.s[j, e]
    if b < 0:
        return (s[0], s[1], s[2]), ZERO, ZERO
    W = k.v[b, 3:]
    s_dot = cross(W, s)
    x, x_dot = plus(k.r[b], turn(k.R[b], s)), plus(k.v[b], turn(k.R[b], s_dot))
    return x, x_dot, turn(k.R[b], cross(W, s_dot))
