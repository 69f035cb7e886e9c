"""Wrong but successful: runs whose solver claims success while laws, symmetry or the reference say no."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from ..results.records import RunRecord, reasons_of
from ..results.words import words_of
from ..types import Law, Reason

OUT_OF_PLANE = 0.01  # of the mechanism's size, where the motion is planar and predictable to the end
JUDGED = 0.98  # of the time, judged against the reference: beyond it a planar chain may leave its plane


def wrong(records: Iterable[RunRecord], card: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One entry a run, as in ``wrong.json``: what the verdict on its record says, and what the scorecard adds."""
    broken: dict[str, list[str]] = {}
    for row in card:
        if row["verdict"] == "broken":
            broken.setdefault(row["runs"][-1], []).append(f"{row['check']}: {row['words']}")
    out = []
    for r in sorted(records, key=lambda r: (r.problem, r.solver, r.case)):
        because = [*map(words_of, reasons_of(r.wrong_because)), *_out_of_plane(r), *broken.get(r.settings_id, [])]
        if r.claimed == "success" and because:
            out.append({"case": r.case, "run": r.settings_id, "solver": r.solver, "problem": r.problem,
                        "because": because})  # fmt: skip
    return out


def _out_of_plane(r: RunRecord) -> list[str]:
    away, allowed = r.out_of_plane_max_m, OUT_OF_PLANE * r.length_scale_m
    if math.isnan(away) or away <= allowed or not r.judged_to_s >= JUDGED * r.t_end_s:
        return []
    return [words_of(Reason(Law.PLANE, away, allowed, "m"))]
