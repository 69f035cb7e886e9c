"""A number that two problems share if all their numbers are the same."""

import numpy as np

from ..types import Problem

LEAST = 1e-6  # of any unit: below it a number counts by its value, above by its digits
GOLDEN = 0.6180339887498949  # its multiples, modulo 1, are all different


def fingerprint(problem: Problem) -> float:
    """Weighted sum of asinh(x / ``LEAST``) over masses, inertias, joints, springs, gravity, start and times.

    A relative change of 1e-4 in any one number changes it by about as much, rounding by 1e-12.
    """
    start, system = problem.initial, vars(problem.system)
    arrays = [system[k] for k in sorted(system) if isinstance(system[k], np.ndarray)]
    arrays += [start.r, start.R, start.v, start.Omega, np.array([problem.t_end, problem.dt])]
    x = np.concatenate([np.asarray(a, dtype=float).ravel() for a in arrays])
    return float(np.sum((1.0 + np.arange(1, len(x) + 1) * GOLDEN % 1.0) * np.arcsinh(x / LEAST)))
