"""Functions of time in CasADi, from the seven numbers of ``mechanics.time_functions``."""

import casadi as ca


def time_function(numbers: ca.SX, t: ca.SX) -> ca.SX:
    """c_0 + c_1 t + c_2 t^2 + c_3 t^3 + a sin(w t + p)."""
    c0, c1, c2, c3, a, w, p = (numbers[k] for k in range(7))
    return c0 + t * (c1 + t * (c2 + t * c3)) + a * ca.sin(w * t + p)
