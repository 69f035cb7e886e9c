"""The cost of a run apart from its time: its own counters, and one unit that all solvers are compared in."""

import math

from .records import RunRecord

SHARE = 0.5  # of an index-1 evaluation with its factorisation: one without. Measured with the compiled kernels on top,
# chain and grid: 0.44, 0.42, 0.86 (gc_weak_form, gc_augmented_lagrangian), 0.58, 0.44, 0.44 (half_explicit)


def evaluations(r: RunRecord) -> float:
    """Evaluations of residual or right side; one an iteration where a solver counts iterations alone."""
    return r.newton_iterations if math.isnan(r.evaluations) else r.evaluations


def operations(r: RunRecord) -> float:
    """Evaluations plus factorisations; evaluations alone where a solver does not count the others."""
    return evaluations(r) + (0.0 if math.isnan(r.factorisations) else r.factorisations)


def index_1_evaluations(r: RunRecord) -> float:
    """Work in evaluations of the index-1 equations with their factorisation: those, and ``SHARE`` of each without.

    A solver that counts no factorisations makes one an evaluation, as strong forms do.
    """
    total = evaluations(r)
    factorised = total if math.isnan(r.factorisations) else r.factorisations
    return factorised + SHARE * max(total - factorised, 0.0)
