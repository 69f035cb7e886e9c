"""Measure how errors and residuals fall from run to run of a ladder of steps or tolerances.

Errors are of motions and reactions. Residuals of constraints are judged by what stays of them as steps or tolerances
get smaller, where no error of the motion tells it.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from ...mechanics.types import ALLOWED, Law, Status
from ...results.findings import Finding, judge_value, leave_open
from ...results.records import RunRecord
from ...results.series import Series
from ..order import (
    DIFFERENCED,
    LEAST_ORDER,
    ROUNDED,
    SECOND_ORDER,
    SLOPE,
    bound_remainder,
    find_least_fall,
    grows_or_stays_constant,
    judge_ladder,
    remove_power,
)
from .trials import Evidence, find_missing

RESIDUALS = (  # roles of runs that differ in the step or tolerance alone: of point rows, and of axis rows
    ("finer 0", "finer 1", "finer 2", "finer 3"),
    ("hinge 0", "hinge 1", "easy hinge"),
)
SAME_TIME = 1e-9  # relative: times of different steps are rounded differently
Residual = tuple[np.ndarray, np.ndarray]  # times [s], and the size at each, in parts of what the motion reaches


def check_order(e: Evidence) -> Finding:
    """Measure the order of the motion in dt at the finest halving, or the decrease of its errors with rtol.

    The error is that of positions over the length of the motion, or that of orientations [rad] if it is larger.
    """

    def error(r: RunRecord) -> float:
        """Return the larger of a run's position error over the length of the motion and its orientation error [rad]."""
        return max(r.position_error_max_m / r.length_scale_m, r.orientation_error_max_rad)

    return _judge_errors(e, error, "of the length, or rad,", ROUNDED, declared=e.order)


def check_reaction_order(e: Evidence) -> Finding:
    """Measure the order of reactions in dt at the finest halving, or the decrease of their errors with rtol.

    Required is order 1, or ``SECOND_ORDER`` of a solver that declares a second or higher order: its reactions have
    order 1 if they are one step late.
    """

    def error(r: RunRecord) -> float | None:
        """Return the reaction error of a run as a fraction of the largest reaction; None if it has no reactions."""
        share = r.reaction_error_max_N / r.reaction_size_N
        return share if math.isfinite(share) else None

    first = math.isnan(e.order) or e.order < SECOND_ORDER + SLOPE
    return _judge_errors(e, error, "of the largest", DIFFERENCED, least=LEAST_ORDER if first else SECOND_ORDER)


def _judge_errors(
    e: Evidence, error: Callable[[RunRecord], float | None], what: str, resolved: float, **limits: float
) -> Finding:
    """Judge the ladder by the ``error`` of its runs, None for a run without one; the first run may be too coarse.

    ``what`` names the scale of the errors in words; ``resolved`` and ``limits`` are passed on to ``judge_ladder``.
    """
    runs = e.select_runs("finer")
    if missing := find_missing(*runs[1:]):
        return missing
    done = [(e.find_setting(r), error(r)) for r in runs if r.claimed == Status.SUCCESS]
    found = [(setting, x) for setting, x in done if x is not None]
    if not found:
        return leave_open("no reactions")
    settings, errors = zip(*found, strict=True)
    return judge_ladder(e.control, settings, errors, what, resolved=resolved, **limits)


def check_residuals(e: Evidence) -> Finding:
    """Measure what remains of |phi|, |phi_dot| and |R^T R - 1| as steps get smaller, relative to the motion's scales.

    With dt it is the residual at the finest step without its part in proportion to dt^order, which must fall with dt
    or be as small as iterations leave it; with rtol it is the residual itself, which must fall with rtol. The finding
    is left open for a residual that varies about one size, as a tolerance of the solver may leave it.
    """
    if missing := find_missing(*e.select_runs("finer")[1:]):
        return missing
    found = [x for roles in RESIDUALS for x in _judge_residuals(e, roles)]
    if not found:
        return leave_open("too few runs with steps at the same times")
    _, _, finding = max(found, key=lambda x: x[:2])
    return finding


def _judge_residuals(e: Evidence, roles: Sequence[str]) -> Iterator[tuple[bool, float, Finding]]:
    """Yield, for each residual, whether it fails, what remains of it over its limit, and the finding.

    ``roles`` are those of runs that differ in the step or tolerance alone, the coarsest first. Nothing is yielded if
    too few of them reached the end.
    """
    recorded = [(r, s) for k in roles if (r := e.records.get(k)) is not None and (s := e.series[k]) is not None]
    runs = [(r, s) for r, s in recorded if r.claimed == Status.SUCCESS]
    if len(runs) < (3 if e.control == "dt" else 2):
        return
    settings = [e.find_setting(r) for r, _ in runs]
    each = [_measure_residuals(r, series) for r, series in runs]
    for name in each[-1]:
        sizes = [one[name] for one in each if name in one]
        if len(sizes) < len(runs):
            continue
        largest = [float(np.max(size)) for _, size in sizes]
        if e.control == "rtol":
            (t, remainder), limit = sizes[-1], bound_remainder(largest[0], find_least_fall(settings))
        else:
            # the remainders of the last two pairs of runs
            (_, coarse), (t, remainder) = (_find_remainder(one, other, e.order) for one, other in pairwise(sizes[-3:]))
            if len(t) < 2 or len(coarse) < 2:
                continue
            limit = bound_remainder(float(np.max(coarse)))
        at = ", ".join(f"{x:g}" for x in settings)
        words = f"{name} up to {', '.join(f'{x:.3g}' for x in largest)} of it at {e.control} {at}: {runs[-1][0].case}"
        most = float(np.max(remainder))
        exceeds = most > limit
        if exceeds and not grows_or_stays_constant(t, remainder):
            yield False, most / limit, leave_open(f"as a tolerance leaves it, {words}")
        else:
            yield exceeds, most / limit, judge_value(most, "of the motion's size", most=limit, words=words)


def _measure_residuals(r: RunRecord, series: Series) -> dict[str, Residual]:
    """Return the residuals of a run by name, each relative to the scale that its law compares it with."""
    joints = {"|phi|": (Law.CONSTRAINT, r.gap_share_max, "phi_norm")}
    joints["|phi_dot|"] = Law.CONSTRAINT_RATE, r.gap_rate_share_max, "phi_dot_norm"
    out = {"|R^T R - 1|": series.points("orthogonality")}
    for name, (law, share, column) in joints.items():
        t, norm = series.points(column)
        top = float(np.max(norm))
        if math.isfinite(share) and top > 0.0:  # the norms count rows in their own units, the shares count metres
            out[name] = t, norm * (share * ALLOWED[law] / top)
    return out


def _find_remainder(coarse: Residual, fine: Residual, order: float) -> Residual:
    """Return the finer run's residual without its part in proportion to dt^order, at the times that both runs have.

    ``fine`` is the residual of a run with half the step of ``coarse``.
    """
    (t, size), (t_fine, size_fine) = coarse, fine
    near = np.minimum(np.searchsorted(t_fine, t * (1.0 - SAME_TIME)), len(t_fine) - 1)
    common = np.abs(t_fine[near] - t) <= SAME_TIME * t_fine[-1]
    return t[common], remove_power(size[common], size_fine[near[common]], order)
