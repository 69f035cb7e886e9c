"""Torsional spring-dampers (``mechanics.torsion``): their torque, and its part of the Jacobian by differences."""

import math

from numba import njit

from .moving import DIFFERENCE, fixed_in, row_of, spin_of
from .vectors import INNER, add, blend, cross, dot, minus, put, times, turn_back, turned_by


@njit(**INNER)
def torque(model, R, v, i):
    """On body i of spring ``i``, in space: -(k (theta - theta_0) + c theta_dot) m."""
    a, g = model.torsion_body[i, 0], model.torsion_body[i, 1]
    u = fixed_in(R, a, model.torsion_u[i])
    e, b = fixed_in(R, g, model.torsion_n[i, 0]), fixed_in(R, g, model.torsion_n[i, 1])
    p, q = dot(u, e), dot(u, b)
    m = times(1.0 / (p * p + q * q), blend(p, cross(u, b), -q, cross(u, e)))
    cosine, sine = math.cos(model.torsion_rest[i]), math.sin(model.torsion_rest[i])
    angle = math.atan2(q * cosine - p * sine, p * cosine + q * sine)
    rate = dot(m, minus(spin_of(R, v, a), spin_of(R, v, g)))
    return times(-model.torsion_stiffness[i] * angle - model.torsion_damping[i] * rate, m)


@njit(**INNER)
def add_torsions(model, motion):
    """``wrench`` += torques in space."""
    for i in range(len(model.torsion_body)):
        T = torque(model, motion.R, motion.v, i)
        for e in range(2):
            b = model.torsion_body[i, e]
            if b >= 0:
                add(1.0 - 2.0 * e, T, motion.wrench[b, 3:])


@njit(**INNER)
def add_torsion_slopes(model, motion, half, saddle):
    """-half d(wrench) by Omega1, column by column, in ``saddle.blocks``."""
    R, v, first = motion.R, motion.v, len(model.stiffness)
    for i in range(len(model.torsion_body)):
        for o in range(2):  # the end that moves
            b = model.torsion_body[i, o]
            if b < 0:
                continue
            T = saddle.T[b]
            Q0, Q1, Q2 = row_of(R, b, 0), row_of(R, b, 1), row_of(R, b, 2)
            for c in range(3):
                before, change = v[b, 3 + c], (0.0, 0.0, 0.0)
                for side in (1.0, -1.0):
                    h = side * DIFFERENCE
                    v[b, 3 + c] = before + h
                    turned_by(R[b], (h * T[0, c], h * T[1, c], h * T[2, c]), R[b])
                    change = blend(1.0, change, 0.5 / h, torque(model, R, v, i))
                    put(Q0, R[b, 0])
                    put(Q1, R[b, 1])
                    put(Q2, R[b, 2])
                v[b, 3 + c] = before
                for e in range(2):  # the end on which it acts
                    other = model.torsion_body[i, e]
                    if other >= 0:
                        K = saddle.blocks[saddle.body[other] if e == o else saddle.spring[first + i, e]]
                        add(-half * (1.0 - 2.0 * e), turn_back(R[other], change), K[3:, 3 + c])
