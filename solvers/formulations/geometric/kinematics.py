"""Joints and applied wrench at one instant: arms, axes, phi, phi_dot, gravity, springs, loads and user forces."""

from numba import njit

from .loads import add_loads
from .springs import line
from .torsion import add_torsions
from .user_forces import add_user_forces
from .vectors import INNER, add, cross, dot, plus, put, times, turn


@njit(**INNER)
def points(model, motion):
    """Arms of all joints and the point rows: phi = r_i + R_i s_i - r_j - R_j s_j, and its rate."""
    for j in range(len(model.body)):
        if not model.pins[j]:
            continue
        phi, phi_dot = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for e in range(2):
            sign, b, s = 1.0 - 2.0 * e, model.body[j, e], model.s[j, e]
            if b < 0:
                put(s, motion.arm[j, e])
                phi = plus(phi, times(sign, s))
                continue
            arm, arm_dot = turn(motion.R[b], s), turn(motion.R[b], cross(motion.v[b, 3:], s))
            put(arm, motion.arm[j, e])
            put(arm_dot, motion.arm_dot[j, e])
            phi = plus(phi, times(sign, plus(motion.r[b], arm)))
            phi_dot = plus(phi_dot, times(sign, plus(motion.v[b], arm_dot)))
        put(phi, motion.phi[model.row[j] :])
        put(phi_dot, motion.phi_dot[model.row[j] :])


@njit(**INNER)
def axes(model, motion):
    """Axis rows: phi = u_k . n_k, and its rate."""
    for j in range(len(model.body)):
        b, other = model.body[j, 0], model.body[j, 1]
        for k in range(model.axes[j]):
            u, n = model.u[j, k], model.n[j, k]
            put(turn(motion.R[b], u), motion.u[j, k])
            put(turn(motion.R[b], cross(motion.v[b, 3:], u)), motion.u_dot[j, k])
            if other < 0:
                put(n, motion.n[j, k])
            else:
                put(turn(motion.R[other], n), motion.n[j, k])
                put(turn(motion.R[other], cross(motion.v[other, 3:], n)), motion.n_dot[j, k])
            a_dot = plus(cross(motion.u_dot[j, k], motion.n[j, k]), cross(motion.u[j, k], motion.n_dot[j, k]))
            put(cross(motion.u[j, k], motion.n[j, k]), motion.a[j, k])
            put(a_dot, motion.a_dot[j, k])
            row = model.row[j] + 3 * model.pins[j] + k
            motion.phi[row] = dot(motion.u[j, k], motion.n[j, k])
            motion.phi_dot[row] = 0.0
            for q in range(3):
                motion.phi_dot[row] += motion.u_dot[j, k, q] * motion.n[j, k, q]
                motion.phi_dot[row] += motion.u[j, k, q] * motion.n_dot[j, k, q]


@njit(**INNER)
def applied(model, motion):
    """Wrench of all applied forces on each body: force, and torque about C, both in space."""
    for b in range(len(model.mass)):
        put(times(model.mass[b], model.gravity), motion.wrench[b])
        put((0.0, 0.0, 0.0), motion.wrench[b, 3:])
    for i in range(len(model.stiffness)):
        spring = line(model, motion, i)
        for e in range(2):
            b = model.spring_body[i, e]
            if b >= 0:
                force = times(-(1.0 - 2.0 * e) * spring.tension, spring.along)
                add(1.0, force, motion.wrench[b])
                add(1.0, cross(turn(motion.R[b], model.p[i, e]), force), motion.wrench[b, 3:])
    add_torsions(model, motion)
    add_loads(model, motion)
    add_user_forces(model, motion)
