"""Spring-dampers: tension, its change with the motion, Eq. (32), and their part of the Jacobian."""

from typing import NamedTuple

import numpy as np
from numba import njit

from .vectors import INNER, add, blend, cross, dot, minus, plus, times, turn, turn_back


class Line(NamedTuple):
    """A spring at one instant. It pulls end i with -tension along, end j with +tension along."""

    along: tuple  # unit vector from end j to end i, space
    rate: tuple  # velocity of end i seen from end j [m/s]
    length: float  # [m]
    tension: float  # [N]


@njit(**INNER)
def line(model, motion, i):
    """Spring ``i``: tension = k (length - free length) + c d(length)/dt."""
    x, x_dot = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for e in range(2):
        sign, b, p = 1.0 - 2.0 * e, model.spring_body[i, e], model.p[i, e]
        if b < 0:
            x = plus(x, times(sign, p))
        else:
            x = plus(x, times(sign, plus(motion.r[b], turn(motion.R[b], p))))
            x_dot = plus(x_dot, times(sign, plus(motion.v[b], turn(motion.R[b], cross(motion.v[b, 3:], p)))))
    d = np.sqrt(dot(x, x))
    along = (x[0] / d, x[1] / d, x[2] / d)
    tension = model.stiffness[i] * (d - model.free_length[i]) + model.damping[i] * dot(along, x_dot)
    return Line(along, x_dot, d, tension)


@njit(**INNER)
def pull_change(spring, k, c, dx, dx_dot):
    """Change of ``tension along`` as end i moves by dx from end j, and faster by dx_dot."""
    e, d = spring.along, spring.length
    stretch = dot(e, dx)
    stretch_dot = (dot(spring.rate, dx) - dot(e, spring.rate) * stretch) / d + dot(e, dx_dot)
    return blend(k * stretch + c * stretch_dot, e, spring.tension / d, minus(dx, times(stretch, e)))


@njit(**INNER)
def coefficients(model, motion, j, row):
    """Eq. (32): C_bar = -c . (df/dv) c and K_bar = -c . (df/dq) c of a row, f = (force, torque in the body)."""
    motion.c_bar[row] = 0.0
    motion.k_bar[row] = 0.0
    for i in range(len(model.stiffness)):
        spring = line(model, motion, i)
        x, x_dot = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # motion of end i from end j along c; change of x_dot by it
        for e in range(2):
            b, end = model.spring_body[i, e], _end_on(model.body[j], model.spring_body[i, e])
            if end >= 0:
                sign, p, R, c = 1.0 - 2.0 * e, model.p[i, e], motion.R[b], motion.c[row, end]
                x = plus(x, times(sign, plus(c, turn(R, cross(c[3:], p)))))
                x_dot = plus(x_dot, times(sign, turn(R, cross(c[3:], cross(motion.v[b, 3:], p)))))
        by_velocity = pull_change(spring, model.stiffness[i], model.damping[i], (0.0, 0.0, 0.0), x)
        by_position = pull_change(spring, model.stiffness[i], model.damping[i], x, x_dot)
        for e in range(2):
            b, end = model.spring_body[i, e], _end_on(model.body[j], model.spring_body[i, e])
            if end >= 0:
                sign, p, R, c = 1.0 - 2.0 * e, model.p[i, e], motion.R[b], motion.c[row, end]
                pull = turn_back(R, times(spring.tension, spring.along))
                # the torque p x R^T F in the body changes with R, too: -p x (c_r x R^T F)
                turning = plus(turn_back(R, by_position), cross(pull, c[3:]))
                motion.c_bar[row] += sign * (dot(c, by_velocity) + dot(c[3:], cross(p, turn_back(R, by_velocity))))
                motion.k_bar[row] += sign * (dot(c, by_position) + dot(c[3:], cross(p, turning)))


@njit(**INNER)
def _end_on(bodies, b):
    """Which of a joint's two ends is on body ``b``; -1 for none and for the ground."""
    if b < 0:
        return -1
    return 0 if bodies[0] == b else 1 if bodies[1] == b else -1


@njit(**INNER)
def add_jacobian(model, motion, half, saddle):
    """-half d(wrench) by v1, column by column of (dr_dot, dOmega), in ``saddle.blocks``."""
    for i in range(len(model.stiffness)):
        spring = line(model, motion, i)
        for o in range(2):  # the end that moves
            other, p = model.spring_body[i, o], model.p[i, o]
            for c in range(6 if other >= 0 else 0):
                R, T = motion.R[other], saddle.T[other]
                unit = (1.0 * (c % 3 == 0), 1.0 * (c % 3 == 1), 1.0 * (c % 3 == 2))
                if c < 3:
                    theta, dx, dx_dot = (0.0, 0.0, 0.0), times(half, unit), unit
                else:
                    theta = turn(T, unit)
                    dx = turn(R, cross(theta, p))
                    dx_dot = turn(R, plus(cross(theta, cross(motion.v[other, 3:], p)), cross(unit, p)))
                pull = pull_change(spring, model.stiffness[i], model.damping[i], dx, dx_dot)
                for e in range(2):  # the end on which the force acts
                    b = model.spring_body[i, e]
                    if b < 0:
                        continue
                    K = saddle.blocks[saddle.body[b] if e == o else saddle.spring[i, e]]
                    weight = half * (1.0 - 2.0 * e) * (1.0 - 2.0 * o)
                    add(weight, pull, K[:3, c])
                    add(weight, cross(model.p[i, e], turn_back(motion.R[b], pull)), K[3:, c])
                    if e == o:  # the arm turns: (theta x p) x R^T F
                        F = turn_back(R, times(-(1.0 - 2.0 * e) * spring.tension, spring.along))
                        add(-half, cross(cross(theta, p), F), K[3:, c])
