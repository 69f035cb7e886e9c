"""Measure the work of a run other than by time: by its own counters, and in one unit that all solvers share."""

import math

from .records import RunRecord

# cost of an index-1 evaluation without factorisation, relative to one with it; measured with the compiled kernels on
# top, chain and grid: 0.44, 0.42, 0.86 (gc_weak_form, gc_augmented_lagrangian), 0.58, 0.44, 0.44 (half_explicit)
SHARE = 0.5


def count_evaluations(r: RunRecord) -> float:
    """Return the number of evaluations of the residual or right-hand side in a run.

    A solver that counts only Newton iterations is taken to make one evaluation in each.
    """
    return r.newton_iterations if math.isnan(r.evaluations) else r.evaluations


def count_operations(r: RunRecord) -> float:
    """Return the number of evaluations and factorisations of a run together; factorisations count as 0 if unknown."""
    return count_evaluations(r) + (0.0 if math.isnan(r.factorisations) else r.factorisations)


def count_index_1_evaluations(r: RunRecord) -> float:
    """Return the work of a run in evaluations of the index-1 equations of motion with their factorisation.

    An evaluation without factorisation counts as ``SHARE`` of one. A solver that does not count factorisations is taken
    to make one in each evaluation, as strong forms do.
    """
    total = count_evaluations(r)
    factorised = total if math.isnan(r.factorisations) else r.factorisations
    return factorised + SHARE * max(total - factorised, 0.0)
