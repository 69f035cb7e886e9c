"""Compiled algebra of 3-vectors and rotations: a vector is a row of an array or a tuple, results are tuples.

No kernel of this package allocates: scratch is tuples, or arrays made before the run. Numba may then leave out the
reference counts of arrays (``_nrt``), see docs/decisions/kernels.md.
"""

import math

import numpy as np
from numba import njit

JIT = {"cache": True, "error_model": "numpy", "_nrt": False}
INNER = {**JIT, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # called from kernels only: compiles much faster
ONCE = {**JIT, "inline": "always"}  # called from one place: compiled there, and not a second time on its own


@njit(**INNER)
def cross(a, b):
    """a x b"""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(**INNER)
def dot(a, b):
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**INNER)
def plus(a, b):
    """a + b"""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(**INNER)
def minus(a, b):
    """a - b"""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**INNER)
def times(p, a):
    """p a"""
    return p * a[0], p * a[1], p * a[2]


@njit(**INNER)
def blend(p, a, q, b):
    """p a + q b"""
    return p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2]


@njit(**INNER)
def turn(R, a):
    """R a"""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


@njit(**INNER)
def turn_back(R, a):
    """R^T a"""
    return (
        R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
        R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
        R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2],
    )


@njit(**INNER)
def put(a, out):
    """out := a"""
    out[0], out[1], out[2] = a[0], a[1], a[2]


@njit(**INNER)
def add(p, a, out):
    """out += p a"""
    out[0] += p * a[0]
    out[1] += p * a[1]
    out[2] += p * a[2]


@njit(**INNER)
def copy(source, target):
    """target := source, arrays of one shape. (A slice assignment between arrays would allocate.)"""
    for at, value in np.ndenumerate(source):
        target[at] = value


@njit(**INNER)
def hat_hat(p, a, b):
    """Rows of p hat(a) hat(b) = p (b a^T - (a . b) 1)."""
    d = p * dot(a, b)
    return (
        (p * b[0] * a[0] - d, p * b[0] * a[1], p * b[0] * a[2]),
        (p * b[1] * a[0], p * b[1] * a[1] - d, p * b[1] * a[2]),
        (p * b[2] * a[0], p * b[2] * a[1], p * b[2] * a[2] - d),
    )


@njit(**INNER)
def rows_plus(A, B):
    """Rows of A + B."""
    return plus(A[0], B[0]), plus(A[1], B[1]), plus(A[2], B[2])


@njit(**INNER)
def seen_from(Q, R, A):
    """Rows of Q^T R A, for A given by rows."""
    x = turn_back(Q, turn(R, (A[0][0], A[1][0], A[2][0])))
    y = turn_back(Q, turn(R, (A[0][1], A[1][1], A[2][1])))
    z = turn_back(Q, turn(R, (A[0][2], A[1][2], A[2][2])))
    return (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])


@njit(**INNER)
def turned_by(R, a, out):
    """out := R exp(hat(a)), Rodrigues; sin(a)/a and (1 - cos a)/a^2 by series where a^2 < 1e-4.

    The series are cut at a^8: error below 1e-22 there. ``out`` may be ``R``.
    """
    x, y, z = a
    s = x * x + y * y + z * z
    if s < 1e-4:
        f = 1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0))
        g = 0.5 * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0)))
    else:
        angle = math.sqrt(s)
        f = math.sin(angle) / angle
        half = math.sin(0.5 * angle)
        g = 2.0 * half * half / s
    E00, E11, E22 = 1.0 - g * (y * y + z * z), 1.0 - g * (x * x + z * z), 1.0 - g * (x * x + y * y)
    E01, E10 = g * x * y - f * z, g * x * y + f * z
    E02, E20 = g * x * z + f * y, g * x * z - f * y
    E12, E21 = g * y * z - f * x, g * y * z + f * x
    for k in range(3):
        r0, r1, r2 = R[k, 0], R[k, 1], R[k, 2]
        out[k, 0] = r0 * E00 + r1 * E10 + r2 * E20
        out[k, 1] = r0 * E01 + r1 * E11 + r2 * E21
        out[k, 2] = r0 * E02 + r1 * E12 + r2 * E22


@njit(**INNER)
def close_rotations(R):
    """R := R (3 - R^T R) / 2 of all bodies: leaves of a distance e from the rotations 3/4 e^2, that is rounding."""
    for b in range(len(R)):
        Q = R[b]
        x, y, z = (Q[0, 0], Q[1, 0], Q[2, 0]), (Q[0, 1], Q[1, 1], Q[2, 1]), (Q[0, 2], Q[1, 2], Q[2, 2])
        d0, d1, d2 = 1.5 - 0.5 * dot(x, x), 1.5 - 0.5 * dot(y, y), 1.5 - 0.5 * dot(z, z)
        p, q, r = -0.5 * dot(y, z), -0.5 * dot(z, x), -0.5 * dot(x, y)
        for k in range(3):
            Q[k, 0], Q[k, 1], Q[k, 2] = (
                d0 * x[k] + r * y[k] + q * z[k], r * x[k] + d1 * y[k] + p * z[k], q * x[k] + p * y[k] + d2 * z[k]
            )  # fmt: skip


@njit(**INNER)
def right_differential(a, scale, out):
    """out := scale * dexp(a): exp(a + d) = exp(a) exp(dexp d) to first order.

    dexp = 1 - (1 - cos a)/a^2 hat(a) + (a - sin a)/a^3 hat(a)^2; series where a^2 < 1e-2, cut at a^10:
    error below 1e-18.
    """
    x, y, z = a
    s = x * x + y * y + z * z
    if s < 1e-2:
        g = 0.5 * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0))))
        h = (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))) / 6.0
    else:
        angle = math.sqrt(s)
        half = math.sin(0.5 * angle)
        g = 2.0 * half * half / s
        h = (angle - math.sin(angle)) / (angle * s)
    d = 1.0 - h * s
    g, h, d = scale * g, scale * h, scale * d
    out[0, 0], out[0, 1], out[0, 2] = d + h * x * x, h * x * y + g * z, h * x * z - g * y
    out[1, 0], out[1, 1], out[1, 2] = h * x * y - g * z, d + h * y * y, h * y * z + g * x
    out[2, 0], out[2, 1], out[2, 2] = h * x * z + g * y, h * y * z - g * x, d + h * z * z
