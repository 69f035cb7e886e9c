"""Rotations and plain loops over arrays (compiled): vectors are rows of an array or tuples, results are tuples."""

import math

import numpy as np

from .entries import compile_inline


@compile_inline
def copy(source, target):
    """Copy the source to the target, arrays of one shape."""
    for a in range(source.size):
        target.flat[a] = source.flat[a]


@compile_inline
def clear(a):
    """Set all entries of the array ``a`` to zero."""
    for at in np.ndindex(a.shape):
        a[at] = 0.0


@compile_inline
def find_largest(a):
    """Return the largest absolute entry of an array, 0 for an empty one, NaN if any entry is NaN."""
    size = 0.0
    for at in np.ndindex(a.shape):
        size = take_larger(size, abs(a[at]))
    return size


@compile_inline
def take_larger(x, y):
    """Return the larger of two numbers, NaN if either is (``max`` loses a NaN that comes second)."""
    return x if x > y or x != x else y


@compile_inline
def multiply(A, x, y, z):
    """Return the product A (x, y, z) of a matrix (3, 3) and a vector."""
    return (
        A[0, 0] * x + A[0, 1] * y + A[0, 2] * z, A[1, 0] * x + A[1, 1] * y + A[1, 2] * z,
        A[2, 0] * x + A[2, 1] * y + A[2, 2] * z,
    )  # fmt: skip


@compile_inline
def multiply_transposed(A, x, y, z):
    """Return the product A^T (x, y, z) of a transposed matrix (3, 3) and a vector."""
    return (
        A[0, 0] * x + A[1, 0] * y + A[2, 0] * z, A[0, 1] * x + A[1, 1] * y + A[2, 1] * z,
        A[0, 2] * x + A[1, 2] * y + A[2, 2] * z,
    )  # fmt: skip


@compile_inline
def evaluate_sine_ratios(s):
    """Return sin(a) / a and (1 - cos a) / a^2 for the squared angle s = a^2 [rad^2].

    Below s = 1 they are series up to s^9, with a truncation error below 1e-17.
    """
    if s < 1.0:
        f = 1.0 - s * (1.0 / 342.0)
        f = 1.0 - s * (1.0 / 272.0) * f
        f = 1.0 - s * (1.0 / 210.0) * f
        f = 1.0 - s * (1.0 / 156.0) * f
        f = 1.0 - s * (1.0 / 110.0) * f
        f = 1.0 - s * (1.0 / 72.0) * f
        f = 1.0 - s * (1.0 / 42.0) * f
        f = 1.0 - s * (1.0 / 20.0) * f
        f = 1.0 - s * (1.0 / 6.0) * f
        g = 1.0 - s * (1.0 / 380.0)
        g = 1.0 - s * (1.0 / 306.0) * g
        g = 1.0 - s * (1.0 / 240.0) * g
        g = 1.0 - s * (1.0 / 182.0) * g
        g = 1.0 - s * (1.0 / 132.0) * g
        g = 1.0 - s * (1.0 / 90.0) * g
        g = 1.0 - s * (1.0 / 56.0) * g
        g = 1.0 - s * (1.0 / 30.0) * g
        g = 0.5 * (1.0 - s * (1.0 / 12.0) * g)
        return f, g
    angle = math.sqrt(s)
    half = math.sin(0.5 * angle)
    return math.sin(angle) / angle, 2.0 * half * half / s


@compile_inline
def turn_rotation(R, x, y, z, out):
    """Set out := R exp(hat(x, y, z)), a rotation by the vector (x, y, z) [rad] in the body; ``out`` may be ``R``."""
    f, g = evaluate_sine_ratios(x * x + y * y + z * z)
    E00, E11, E22 = 1.0 - g * (y * y + z * z), 1.0 - g * (x * x + z * z), 1.0 - g * (x * x + y * y)
    E01, E10 = g * x * y - f * z, g * x * y + f * z
    E02, E20 = g * x * z + f * y, g * x * z - f * y
    E12, E21 = g * y * z - f * x, g * y * z + f * x
    for k in range(3):
        r0, r1, r2 = R[k, 0], R[k, 1], R[k, 2]
        out[k, 0] = r0 * E00 + r1 * E10 + r2 * E20
        out[k, 1] = r0 * E01 + r1 * E11 + r2 * E21
        out[k, 2] = r0 * E02 + r1 * E12 + r2 * E22


@compile_inline
def orthogonalise_rotations(R):
    """Make the matrices ``R`` (nb, 3, 3) more nearly orthogonal, in place: R := R (3 - R^T R) / 2.

    A distance e from a rotation becomes 3/4 e^2, plus rounding.
    """
    for b in range(len(R)):
        Q = R[b]
        # the columns x, y, z of R, and the entries of (3 - R^T R) / 2: d on its diagonal, p, q, r at yz, zx, xy
        x0, x1, x2, y0, y1, y2, z0, z1, z2 = (
            Q[0, 0], Q[1, 0], Q[2, 0], Q[0, 1], Q[1, 1], Q[2, 1], Q[0, 2], Q[1, 2], Q[2, 2],
        )  # fmt: skip
        d0 = 1.5 - 0.5 * (x0 * x0 + x1 * x1 + x2 * x2)
        d1 = 1.5 - 0.5 * (y0 * y0 + y1 * y1 + y2 * y2)
        d2 = 1.5 - 0.5 * (z0 * z0 + z1 * z1 + z2 * z2)
        p = -0.5 * (y0 * z0 + y1 * z1 + y2 * z2)
        q = -0.5 * (z0 * x0 + z1 * x1 + z2 * x2)
        r = -0.5 * (x0 * y0 + x1 * y1 + x2 * y2)
        Q[0, 0], Q[0, 1], Q[0, 2] = d0 * x0 + r * y0 + q * z0, r * x0 + d1 * y0 + p * z0, q * x0 + p * y0 + d2 * z0
        Q[1, 0], Q[1, 1], Q[1, 2] = d0 * x1 + r * y1 + q * z1, r * x1 + d1 * y1 + p * z1, q * x1 + p * y1 + d2 * z1
        Q[2, 0], Q[2, 1], Q[2, 2] = d0 * x2 + r * y2 + q * z2, r * x2 + d1 * y2 + p * z2, q * x2 + p * y2 + d2 * z2


@compile_inline
def theta_dot(x, y, z, p, q, r):
    """Return the rate [rad/s] of the rotation vector theta = (x, y, z) [rad] at Omega = (p, q, r) [rad/s, body].

    It is dexp^-1(theta) Omega = Omega + theta x Omega / 2 + c theta x (theta x Omega), with c by a series where theta^2
    is below 1e-2.
    """
    s = x * x + y * y + z * z
    if s < 1e-2:
        c = (1.0 + s / 60.0 * (1.0 + s / 42.0 * (1.0 + s / 40.0))) / 12.0
    else:
        half = 0.5 * math.sqrt(s)
        c = (1.0 - half / math.tan(half)) / s
    u, v, w = y * r - z * q, z * p - x * r, x * q - y * p  # theta x Omega
    return (p + 0.5 * u + c * (y * w - z * v), q + 0.5 * v + c * (z * u - x * w), r + 0.5 * w + c * (x * v - y * u))


@compile_inline
def set_dexp(x, y, z, scale, out):
    """Set out (9,) := scale dexp(a), a = (x, y, z), by rows: exp(a + d) = exp(a) exp(dexp d) to first order.

    dexp = 1 - (1 - cos a)/a^2 hat(a) + (a - sin a)/a^3 hat(a)^2; series where a^2 < 1e-2, cut at a^10.
    """
    s = x * x + y * y + z * z
    f, g = evaluate_sine_ratios(s)
    if s < 1e-2:
        h = (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))) / 6.0
    else:
        h = (1.0 - f) / s
    d = 1.0 - h * s
    g, h, d = scale * g, scale * h, scale * d
    out[0], out[1], out[2] = d + h * x * x, h * x * y + g * z, h * x * z - g * y
    out[3], out[4], out[5] = h * x * y - g * z, d + h * y * y, h * y * z + g * x
    out[6], out[7], out[8] = h * x * z + g * y, h * y * z - g * x, d + h * z * z
