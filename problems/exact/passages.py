"""Find singular passages of the grid: the instants at which a row folds flat, with its bars along one line."""

import numpy as np
from scipy.optimize import brentq

from ...harness.mechanics.types import Problem

SAMPLING = 1e-3  # [s] sampling; a row that folds and unfolds within it is missed


def find_singular_passages(problem: Problem, t_end: float) -> tuple[tuple[float, int], ...]:
    """Return time [s] and row, counted from 1, of every singular passage of the reference, in order of time.

    These are the zeros of cos(angle of the row) up to ``t_end`` [s] or the horizon; empty without a reference.
    """
    reference = problem.reference()
    if reference is None:
        return ()
    names = [o.name for o in problem.observables if o.name.startswith("angle_")]
    t = np.linspace(0.0, min(t_end, reference.horizon), max(2, round(t_end / SAMPLING) + 1))

    def cosine(time: float, name: str) -> float:
        """Return the cosine of a row's angle at a time [s]."""
        return float(np.cos(problem.observe(reference.states(np.array([time])))[name][0]))

    angles = problem.observe(reference.states(t))
    found = []
    for row, name in enumerate(names, start=1):
        sign = np.cos(angles[name]) > 0.0
        for k in np.flatnonzero(sign[1:] != sign[:-1]):
            time = float(brentq(cosine, t[k], t[k + 1], args=(name,), xtol=1e-12))
            found.append((time, row))
    return tuple(sorted(found))
