"""Tabulate how runs ended, with the least errors and least costs, by problem and solver."""

import math
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from ...base.files import encode_nonfinite
from ...mechanics.types import Status
from ...results.least_cost import find_cheapest
from ...results.records import RunRecord

JUDGED = (Status.SUCCESS, Status.INACCURATE, Status.WRONG)
ACCURATE = 1e-3  # relative to the length of the motion: error within which the least cost is reported


def make_table(records: Sequence[RunRecord]) -> list[dict[str, Any]]:
    """Return a row of the table for each problem, its parameters and solver, sorted by these."""
    return [
        {"problem": key[0], "problem_parameters": key[1], "solver": key[2], **_summarise_runs(list(runs))}
        for key, runs in groupby(sorted(records, key=_make_key), _make_key)
    ]


def _make_key(r: RunRecord) -> tuple[str, str, str]:
    """Return problem, parameters and solver of a run: runs that share them share a row of the table."""
    return r.problem, r.problem_parameters, r.solver


def _summarise_runs(runs: Sequence[RunRecord]) -> dict[str, Any]:
    """Return how many runs ended with each judged status, the least motion error [m], and the least CPU time [s].

    Errors are those of successes; times are those of successes within ``ACCURATE``. Where there is none, the number is
    the text ``inf``.
    """
    good = [r for r in runs if r.status == Status.SUCCESS and math.isfinite(r.motion_error_judged_m)]
    best = find_cheapest(
        good, 0.0, lambda r: r.motion_error_judged_m - ACCURATE * r.length_scale_m, lambda r: r.cpu_median_s
    )
    return {
        "runs": len(runs),
        **{str(s): sum(r.status == s for r in runs) for s in JUDGED},
        "least_motion_error_m": encode_nonfinite(min((r.motion_error_judged_m for r in good), default=math.inf)),
        "least_cpu_s": encode_nonfinite(math.inf if best is None else best.cpu_median_s),
    }
