"""Constant forces and torques, fixed in space or in a body: their wrench and its part of the Jacobian."""

from numba import njit

from .vectors import INNER, add, cross, plus, turn, turn_back


@njit(**INNER)
def load(model, R, i):
    """Force and torque of load ``i`` in space, on a body at ``R``."""
    F, T = model.load_force[i], model.load_torque[i]
    if model.load_follows[i]:
        return turn(R, F), turn(R, T)
    return (F[0], F[1], F[2]), (T[0], T[1], T[2])


@njit(**INNER)
def add_loads(model, motion):
    """``wrench`` += force, and torque about C, in space."""
    for i in range(len(model.load_body)):
        b = model.load_body[i]
        F, T = load(model, motion.R[b], i)
        add(1.0, F, motion.wrench[b])
        add(1.0, plus(T, cross(turn(motion.R[b], model.load_p[i]), F)), motion.wrench[b, 3:])


@njit(**INNER)
def add_load_slopes(model, motion, half, saddle):
    """-half d(wrench) by Omega1, column by column, in ``saddle.blocks``."""
    for i in range(len(model.load_body)):
        b = model.load_body[i]
        R, T, K = motion.R[b], saddle.T[b], saddle.blocks[saddle.body[b]]
        F, _ = load(model, R, i)
        for c in range(3):
            theta = (T[0, c], T[1, c], T[2, c])
            change, moment = (0.0, 0.0, 0.0), cross(turn(R, cross(theta, model.load_p[i])), F)
            if model.load_follows[i]:
                change = turn(R, cross(theta, model.load_force[i]))
                moment = plus(moment, cross(turn(R, model.load_p[i]), change))
                moment = plus(moment, turn(R, cross(theta, model.load_torque[i])))
            add(-half, change, K[:3, 3 + c])
            add(-half, turn_back(R, moment), K[3:, 3 + c])
