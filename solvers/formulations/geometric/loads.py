"""Forces and torques, fixed in space or in a body, times a function of time: wrench and part of the Jacobian."""

from numba import njit

from .moving import function
from .vectors import INNER, add, cross, plus, times, turn, turn_back


@njit(**INNER)
def load(model, R, t, i):
    """Force and torque of load ``i`` in space, on a body at ``R``."""
    factor = function(model.load_factor[i], t)[0]
    F, T = times(factor, model.load_force[i]), times(factor, model.load_torque[i])
    if model.load_follows[i]:
        return turn(R, F), turn(R, T)
    return F, T


@njit(**INNER)
def add_loads(model, motion):
    """``wrench`` += force, and torque about C, in space."""
    for i in range(len(model.load_body)):
        b = model.load_body[i]
        F, T = load(model, motion.R[b], motion.t[0], i)
        add(1.0, F, motion.wrench[b])
        add(1.0, plus(T, cross(turn(motion.R[b], model.load_p[i]), F)), motion.wrench[b, 3:])


@njit(**INNER)
def add_load_slopes(model, motion, half, saddle):
    """-half d(wrench) by Omega1, column by column, in ``saddle.blocks``."""
    for i in range(len(model.load_body)):
        factor = function(model.load_factor[i], motion.t[0])[0]
        b = model.load_body[i]
        R, T, K = motion.R[b], saddle.T[b], saddle.blocks[saddle.body[b]]
        F, _ = load(model, R, motion.t[0], i)
        for c in range(3):
            theta = (T[0, c], T[1, c], T[2, c])
            change, moment = (0.0, 0.0, 0.0), cross(turn(R, cross(theta, model.load_p[i])), F)
            if model.load_follows[i]:
                change = times(factor, turn(R, cross(theta, model.load_force[i])))
                moment = plus(moment, cross(turn(R, model.load_p[i]), change))
                moment = plus(moment, times(factor, turn(R, cross(theta, model.load_torque[i]))))
            add(-half, change, K[:3, 3 + c])
            add(-half, turn_back(R, moment), K[3:, 3 + c])
