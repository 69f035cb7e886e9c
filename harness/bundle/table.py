"""The table of a bundle: how runs ended, least errors and least costs, by problem and solver."""

import math
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from ..files import exact
from ..results.records import RunRecord
from ..types import Status

JUDGED = (Status.SUCCESS, Status.INACCURATE, Status.WRONG)
ACCURATE = 1e-3  # of the length of the motion: the error of which the least cost is told


def make_table(records: Sequence[RunRecord]) -> list[dict[str, Any]]:
    """A row a problem and solver, in their order."""
    return [
        {"problem": key[0], "problem_parameters": key[1], "solver": key[2], **_count(list(runs))}
        for key, runs in groupby(sorted(records, key=_key), _key)
    ]


def _key(r: RunRecord) -> tuple[str, str, str]:
    return r.problem, r.problem_parameters, r.solver


def _count(runs: Sequence[RunRecord]) -> dict[str, Any]:
    good = [r for r in runs if r.status == Status.SUCCESS and math.isfinite(r.motion_error_judged_m)]
    near = [r.cpu_median_s for r in good if r.motion_error_judged_m <= ACCURATE * r.length_scale_m]
    return {
        "runs": len(runs),
        **{str(s): sum(r.status == s for r in runs) for s in JUDGED},
        "least_motion_error_m": exact(min((r.motion_error_judged_m for r in good), default=math.inf)),
        "least_cpu_s": exact(min(near, default=math.inf)),
    }
