"""Measure how errors, reactions and open joints fall from run to run of a ladder of steps or tolerances."""

import itertools
import math

import numpy as np

from ...mechanics.types import Status
from ...results.findings import Finding, judge_value, leave_open, make_failure
from .trials import Evidence, find_missing

WITHIN = 0.2  # tolerance on the declared order
LEAST_ORDER = 0.8  # least order if none is declared: a first-order scheme may show a little less
ROUNDED = 1e-11  # error below which no order is observable
ITERATED = 1e-8  # below, corrections that end at their tolerance may leave errors independent of the step
REACTION_SEEN = 1e-7  # relative: below, errors of the reference's differences dominate
SECOND_ORDER = 1.5  # between 1, as of reactions one step late, and 2, the least of correct second-order schemes


def check_order(e: Evidence) -> Finding:
    """Measure the order in dt at the finest halving, the best if errors reach a floor; or the decrease with rtol."""
    finer = e.select_runs("finer")
    if missing := find_missing(*finer[1:]):
        return missing
    finer = [r for r in finer if r.claimed == Status.SUCCESS]  # the first run may be too coarse
    errors = [max(r.position_error_max_m / r.length_scale_m, r.orientation_error_max_rad) for r in finer]
    at = ", ".join(f"{r.dt_s if e.control == 'dt' else r.rtol:g}" for r in finer)
    words = f"errors {', '.join(f'{x:.3g}' for x in errors)} (of the length, or rad) at {e.control} {at}"
    if not np.all(np.isfinite(errors)):
        return make_failure(words)
    seen = [x for x in errors if x >= ROUNDED]
    if len(seen) < 2:
        return leave_open(f"rounding alone: {words}")
    if e.control == "rtol":
        least = math.sqrt(finer[0].rtol / finer[-1].rtol)  # errors follow rtol^(p/(p + 1)) at order p >= 1
        return judge_value(errors[0] / max(errors[-1], ROUNDED), "times smaller", least=least, words=words)
    orders = [math.log2(a / b) for a, b in itertools.pairwise(seen)]
    order = orders[-1] if seen[-1] > ITERATED else max(orders)
    if math.isnan(e.order):
        return judge_value(order, "order, none declared", least=LEAST_ORDER, words=words)
    higher = "higher than declared: " if order > e.order + WITHIN else ""
    return judge_value(order, f"order, {e.order:g} declared", least=e.order - WITHIN, words=higher + words)


def check_reaction_order(e: Evidence) -> Finding:
    """Measure the order of reactions in dt at the finest halving, or the decrease of their errors with rtol."""
    finer = e.select_runs("finer")
    if missing := find_missing(*finer[1:]):
        return missing
    finer = [r for r in finer if r.claimed == Status.SUCCESS and math.isfinite(r.reaction_size_N)]
    shares = [r.reaction_error_max_N / r.reaction_size_N for r in finer]
    seen = [(x, r) for x, r in zip(shares, finer, strict=True) if x >= REACTION_SEEN]
    at = ", ".join(f"{r.dt_s if e.control == 'dt' else r.rtol:g}" for r in finer)
    words = f"off by {', '.join(f'{x:.3g}' for x in shares)} of the largest at {e.control} {at}"
    if len(seen) < 2:
        return leave_open(f"rounding alone: {words}" if finer else "no reactions")
    (a, coarse), (b, fine) = (seen[-2], seen[-1]) if e.control == "dt" else (seen[0], seen[-1])
    if e.control == "rtol":
        return judge_value(a / b, "times smaller", least=math.sqrt(coarse.rtol / fine.rtol), words=words)
    order = math.log(a / b) / math.log(coarse.dt_s / fine.dt_s)
    return judge_value(order, "order", least=_find_least_order(e), words=words)


def _find_least_order(e: Evidence) -> float:
    """Return the least order of reactions and of |phi|, which tells the order declared from one below, or from none."""
    first = math.isnan(e.order) or e.order < SECOND_ORDER + WITHIN
    return LEAST_ORDER if first else SECOND_ORDER
