"""Compiled algebra of 3-vectors and rotations, writing into given arrays: no allocation in the hot loops."""

import math

from numba import njit

JIT = {"cache": True, "error_model": "numpy"}
INNER = {**JIT, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # called from kernels only: compiles much faster


@njit(**INNER)
def cross(a, b, out):
    """out = a x b; ``out`` may not be ``a`` or ``b``."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(**INNER)
def dot(a, b):
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**INNER)
def turn(R, a, out):
    """out = R a"""
    for k in range(3):
        out[k] = R[k, 0] * a[0] + R[k, 1] * a[1] + R[k, 2] * a[2]


@njit(**INNER)
def turn_back(R, a, out):
    """out = R^T a"""
    for k in range(3):
        out[k] = R[0, k] * a[0] + R[1, k] * a[1] + R[2, k] * a[2]


@njit(**INNER)
def times_hat(A, b, out):
    """out = A hat(b): column by column, hat(b) = [[0, -b2, b1], [b2, 0, -b0], [-b1, b0, 0]]."""
    for k in range(3):
        out[k, 0] = A[k, 1] * b[2] - A[k, 2] * b[1]
        out[k, 1] = A[k, 2] * b[0] - A[k, 0] * b[2]
        out[k, 2] = A[k, 0] * b[1] - A[k, 1] * b[0]


@njit(**INNER)
def hat_hat(a, b, out):
    """out = hat(a) hat(b) = b a^T - (a . b) 1"""
    ab = dot(a, b)
    for k in range(3):
        for c in range(3):
            out[k, c] = b[k] * a[c]
        out[k, k] -= ab


@njit(**INNER)
def product(A, B, out):
    """out = A B; ``out`` may not be ``A`` or ``B``."""
    for k in range(3):
        for c in range(3):
            out[k, c] = A[k, 0] * B[0, c] + A[k, 1] * B[1, c] + A[k, 2] * B[2, c]


@njit(**INNER)
def turned_by(R, b, x, y, z, out):
    """out[b] = R[b] exp(hat(x, y, z)), Rodrigues; sin(a)/a and (1 - cos a)/a^2 by series where a^2 < 1e-4.

    The series are cut at a^8: error below 1e-22 there.
    """
    s = x * x + y * y + z * z
    if s < 1e-4:
        f = 1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0))
        g = 0.5 * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0)))
    else:
        a = math.sqrt(s)
        f = math.sin(a) / a
        half = math.sin(0.5 * a)
        g = 2.0 * half * half / s
    E00, E11, E22 = 1.0 - g * (y * y + z * z), 1.0 - g * (x * x + z * z), 1.0 - g * (x * x + y * y)
    E01, E10 = g * x * y - f * z, g * x * y + f * z
    E02, E20 = g * x * z + f * y, g * x * z - f * y
    E12, E21 = g * y * z - f * x, g * y * z + f * x
    for k in range(3):
        r0, r1, r2 = R[b, k, 0], R[b, k, 1], R[b, k, 2]
        out[b, k, 0] = r0 * E00 + r1 * E10 + r2 * E20
        out[b, k, 1] = r0 * E01 + r1 * E11 + r2 * E21
        out[b, k, 2] = r0 * E02 + r1 * E12 + r2 * E22


@njit(**INNER)
def right_differential(x, y, z, scale, out, b):
    """out[b] = scale * dexp(x, y, z): exp(a + d) = exp(a) exp(dexp d) to first order.

    dexp = 1 - (1 - cos a)/a^2 hat(x) + (a - sin a)/a^3 hat(x)^2; series where a^2 < 1e-2, cut at a^10:
    error below 1e-18.
    """
    s = x * x + y * y + z * z
    if s < 1e-2:
        g = 0.5 * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0))))
        h = (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))) / 6.0
    else:
        a = math.sqrt(s)
        half = math.sin(0.5 * a)
        g = 2.0 * half * half / s
        h = (a - math.sin(a)) / (a * s)
    d = 1.0 - h * s
    g, h, d = scale * g, scale * h, scale * d
    out[b, 0, 0], out[b, 0, 1], out[b, 0, 2] = d + h * x * x, h * x * y + g * z, h * x * z - g * y
    out[b, 1, 0], out[b, 1, 1], out[b, 1, 2] = h * x * y - g * z, d + h * y * y, h * y * z + g * x
    out[b, 2, 0], out[b, 2, 1], out[b, 2, 2] = h * x * z + g * y, h * y * z - g * x, d + h * z * z


# The same without views of arrays (each view costs more than the arithmetic): components in, components out.


@njit(**INNER)
def cross3(a0, a1, a2, b0, b1, b2):
    """Components of a x b."""
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@njit(**INNER)
def turn3(R, b, x0, x1, x2):
    """Components of R[b] x."""
    return (
        R[b, 0, 0] * x0 + R[b, 0, 1] * x1 + R[b, 0, 2] * x2,
        R[b, 1, 0] * x0 + R[b, 1, 1] * x1 + R[b, 1, 2] * x2,
        R[b, 2, 0] * x0 + R[b, 2, 1] * x1 + R[b, 2, 2] * x2,
    )


@njit(**INNER)
def back3(R, b, x0, x1, x2):
    """Components of R[b]^T x."""
    return (
        R[b, 0, 0] * x0 + R[b, 1, 0] * x1 + R[b, 2, 0] * x2,
        R[b, 0, 1] * x0 + R[b, 1, 1] * x1 + R[b, 2, 1] * x2,
        R[b, 0, 2] * x0 + R[b, 1, 2] * x1 + R[b, 2, 2] * x2,
    )


@njit(**INNER)
def quadratic3(J, b, x0, x1, x2):
    """x . J[b] x"""
    y0, y1, y2 = turn3(J, b, x0, x1, x2)
    return x0 * y0 + x1 * y1 + x2 * y2


@njit(**INNER)
def add_hat_hat(w, a0, a1, a2, b0, b1, b2, out):
    """out += w hat(a) hat(b) = w (b a^T - (a . b) 1)"""
    d = w * (a0 * b0 + a1 * b1 + a2 * b2)
    out[0, 0] += w * b0 * a0 - d
    out[0, 1] += w * b0 * a1
    out[0, 2] += w * b0 * a2
    out[1, 0] += w * b1 * a0
    out[1, 1] += w * b1 * a1 - d
    out[1, 2] += w * b1 * a2
    out[2, 0] += w * b2 * a0
    out[2, 1] += w * b2 * a1
    out[2, 2] += w * b2 * a2 - d


@njit(**INNER)
def add_product(A, T, b, S, sign, blocks, p):
    """Rotational part of block ``p`` += sign (A T[b] + S)."""
    for k in range(3):
        for c in range(3):
            blocks[p, 3 + k, 3 + c] += sign * (
                A[k, 0] * T[b, 0, c] + A[k, 1] * T[b, 1, c] + A[k, 2] * T[b, 2, c] + S[k, c]
            )
