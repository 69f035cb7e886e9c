"""Applied forces of all bodies, and the gyroscopic term."""

import math

from numba import njit

from ...loads import load
from ...torsion import torque
from ...user_forces import evaluate_law
from ...vectors import INNER, add, cross, plus, turn_back
from .room import HOT
from .rows import turned


@njit(**HOT)
def applied(model, k):
    """Fill ``k.force``: gravity, springs, dampers, loads and user forces; torques in the body."""
    for b in range(len(model.mass)):
        for a in range(3):
            k.force[b, a] = model.mass[b] * model.gravity[a]
            k.force[b, 3 + a] = 0.0
    for s in range(len(model.stiffness)):
        _spring(model, k, s)
    for i in range(len(model.torsion_body)):
        _torsion(model, k, i)
    for i in range(len(model.load_body)):
        _load(model, k, i)
    for i in range(len(model.user_body)):
        _user_force(model, k, i)


@njit(**INNER)
def _torsion(model, k, i):
    T = torque(model, k.R, k.v, i)
    for e in range(2):
        b = model.torsion_body[i, e]
        if b >= 0:
            add(1.0 - 2.0 * e, turn_back(k.R[b], T), k.force[b, 3:])


@njit(**INNER)
def _load(model, k, i):
    b = model.load_body[i]
    F, T = load(model, k.R[b], k.t[0], i)
    torque = plus(turn_back(k.R[b], T), cross(model.load_p[i], turn_back(k.R[b], F)))
    for a in range(3):
        k.force[b, a] += F[a]
        k.force[b, 3 + a] += torque[a]


@njit(**INNER)
def _user_force(model, k, i):
    evaluate_law(model, k.r, k.R, k.v, k.t[0], i)
    for e in range(2):
        b = model.user_body[i, e]
        if b >= 0:
            add(1.0, model.user_load[e], k.force[b])
            add(1.0, turn_back(k.R[b], model.user_load[2 + e]), k.force[b, 3:])


@njit(**HOT)
def add_gyroscopic(model, k):
    """``k.force`` -= Omega x J Omega"""
    J = model.J
    for b in range(len(model.mass)):
        w0, w1, w2 = k.v[b, 3], k.v[b, 4], k.v[b, 5]
        h0 = J[b, 0, 0] * w0 + J[b, 0, 1] * w1 + J[b, 0, 2] * w2
        h1 = J[b, 1, 0] * w0 + J[b, 1, 1] * w1 + J[b, 1, 2] * w2
        h2 = J[b, 2, 0] * w0 + J[b, 2, 1] * w1 + J[b, 2, 2] * w2
        k.force[b, 3] += w2 * h1 - w1 * h2
        k.force[b, 4] += w0 * h2 - w2 * h0
        k.force[b, 5] += w1 * h0 - w0 * h1


@njit(**HOT)
def _spring(model, k, s):
    l0 = l1 = l2 = d0 = d1 = d2 = 0.0
    for e in range(2):
        sign, b = 1.0 - 2.0 * e, model.spring_body[s, e]
        x, x_dot = turned(k, b, model.p[s, e, 0], model.p[s, e, 1], model.p[s, e, 2])[:3], (0.0, 0.0, 0.0)
        r0 = r1 = r2 = v0 = v1 = v2 = 0.0
        if b >= 0:
            x_dot = turned(k, b, model.p[s, e, 0], model.p[s, e, 1], model.p[s, e, 2])[3:6]
            r0, r1, r2, v0, v1, v2 = k.r[b, 0], k.r[b, 1], k.r[b, 2], k.v[b, 0], k.v[b, 1], k.v[b, 2]
        l0 += sign * (r0 + x[0])
        l1 += sign * (r1 + x[1])
        l2 += sign * (r2 + x[2])
        d0 += sign * (v0 + x_dot[0])
        d1 += sign * (v1 + x_dot[1])
        d2 += sign * (v2 + x_dot[2])
    d = math.sqrt(l0 * l0 + l1 * l1 + l2 * l2)
    rate = (l0 * d0 + l1 * d1 + l2 * d2) / d
    tension = (model.stiffness[s] * (d - model.free_length[s]) + model.damping[s] * rate) / d
    for e in range(2):
        b = model.spring_body[s, e]
        if b < 0:
            continue
        f = -(1.0 - 2.0 * e) * tension
        f0, f1, f2 = f * l0, f * l1, f * l2
        k.force[b, 0] += f0
        k.force[b, 1] += f1
        k.force[b, 2] += f2
        R, p0, p1, p2 = k.R, model.p[s, e, 0], model.p[s, e, 1], model.p[s, e, 2]
        g0 = R[b, 0, 0] * f0 + R[b, 1, 0] * f1 + R[b, 2, 0] * f2
        g1 = R[b, 0, 1] * f0 + R[b, 1, 1] * f1 + R[b, 2, 1] * f2
        g2 = R[b, 0, 2] * f0 + R[b, 1, 2] * f1 + R[b, 2, 2] * f2
        k.force[b, 3] += p1 * g2 - p2 * g1
        k.force[b, 4] += p2 * g0 - p0 * g2
        k.force[b, 5] += p0 * g1 - p1 * g0
