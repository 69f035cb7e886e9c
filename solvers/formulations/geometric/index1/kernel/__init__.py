"""Rows, S = A M^-1 A^T, its factor and what follows from it: accelerations, multipliers, projections.

Row of joint j at end e, sign +1 for i and -1 for j: translation ``sign e_k`` (point rows), rotation X, in the body::

    point row k   X = sign (s x R^T e_k)
    line row      X = sign R^T (arm x f), translation sign f (module ``lines``); so are moving rows, with a torque
    axis row k    X = sign R^T (u x n_k)

    S = sum over bodies  X_a J^-1 X_c^T  (+ sign_a sign_c f_a . f_c / m, f = e_k on point rows)
    S lam = -gamma - A M^-1 f,   v_dot = M^-1 (f + A^T lam),   gamma = A_dot v

A pivot below ``DEPENDENT`` of its own diagonal is that of a redundant row: its multiplier is 0 and the other rows are
exact for right-hand sides that belong to a motion. The rank may change with the configuration.
"""

from .cholesky import factorise, solve
from .evaluation import accelerate, evaluate, project, reactions
from .forces import add_gyroscopic, applied
from .products import add_back, add_rows_back, clear, minus_rates, times_inverse_mass, times_rows
from .room import HOT, Kernel, empty_kernel
from .rows import fill_Y, rows

__all__ = [
    "HOT", "Kernel", "accelerate", "add_back", "add_gyroscopic", "add_rows_back", "applied", "clear",
    "empty_kernel", "evaluate", "factorise", "fill_Y", "minus_rates", "project", "reactions", "rows", "solve",
    "times_inverse_mass", "times_rows",
]  # fmt: skip
