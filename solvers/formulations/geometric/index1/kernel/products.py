"""Products with M^-1, A and A^T."""

import numpy as np
from numba import njit

from ...vectors import dot
from .room import HOT


@njit(**HOT)
def times_inverse_mass(model, w):
    """w (nb, 6) := M^-1 w"""
    for b in range(len(model.mass)):
        t0, t1, t2 = w[b, 3], w[b, 4], w[b, 5]
        for a in range(3):
            w[b, a] /= model.mass[b]
            w[b, 3 + a] = model.J_inv[b, a, 0] * t0 + model.J_inv[b, a, 1] * t1 + model.J_inv[b, a, 2] * t2


@njit(**HOT)
def times_rows(model, k, w, sign, x):
    """x (nrows,) += sign A w"""
    for j in range(len(model.body)):
        first = model.row[j]
        for e in range(2):
            b = model.body[j, e]
            if b < 0:
                continue
            for a in range(model.row[j + 1] - first):
                y = k.X[j, e, a, 0] * w[b, 3] + k.X[j, e, a, 1] * w[b, 4] + k.X[j, e, a, 2] * w[b, 5]
                if model.pins[j]:
                    if a < 3:
                        y += (1.0 - 2.0 * e) * w[b, a]
                elif model.lines[j]:
                    y += (1.0 - 2.0 * e) * dot(k.way[j, a], w[b])
                x[first + a] += sign * y


@njit(**HOT)
def minus_rates(model, k, v, x):
    """x (nrows,) := -(A v + phi_t)"""
    for a in range(len(x)):
        x[a] = -k.slip[a]
    times_rows(model, k, v, -1.0, x)


@njit(**HOT)
def add_back(model, way, Y, x, w):
    """w (nb, 6) += M^-1 A^T x with the rows whose f and Y = X J^-1 are given."""
    for j in range(len(model.body)):
        first = model.row[j]
        for e in range(2):
            b = model.body[j, e]
            if b < 0:
                continue
            share = (1.0 - 2.0 * e) / model.mass[b]
            for a in range(model.row[j + 1] - first):
                y = x[first + a]
                if model.pins[j]:
                    if a < 3:
                        w[b, a] += share * y
                elif model.lines[j]:
                    for q in range(3):
                        w[b, q] += share * y * way[j, a, q]
                w[b, 3] += Y[j, e, a, 0] * y
                w[b, 4] += Y[j, e, a, 1] * y
                w[b, 5] += Y[j, e, a, 2] * y


@njit(**HOT)
def add_rows_back(model, k, x, w):
    """w (nb, 6) += M^-1 A^T x"""
    add_back(model, k.way, k.Y, x, w)


@njit(**HOT)
def clear(a):
    """a := 0"""
    for at in np.ndindex(a.shape):
        a[at] = 0.0
