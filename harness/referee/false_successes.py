"""False successes: runs whose solver claims success while a law or a symmetry contradicts it, and which mislead.

A presentation that changes digits below the run's own error is a finding about the method, no false success.

Runs from a literal start are left out: it opens the joints, and what keeps to it breaks their law.
"""

import math
from collections.abc import Iterable

from ..results.judgements.runs import FalseSuccess, Symmetry
from ..results.misleading import misleads
from ..results.records import RunRecord, is_literal, reasons_of
from ..types import Law, Reason, Status

OUT_OF_PLANE = 0.01  # of the mechanism's size, where the motion is planar and predictable to the end
JUDGED = 0.98  # of the time, judged against the reference: beyond it a planar chain may leave its plane


def find_false_successes(records: Iterable[RunRecord], symmetries: Iterable[Symmetry]) -> tuple[FalseSuccess, ...]:
    """One a run: the reasons on its record, and the symmetries that it breaks."""
    broken: dict[str, list[Reason]] = {}
    records = list(records)
    error_of = {r.settings_id: r.motion_error_judged_m for r in records if r.judged_to_s >= JUDGED * r.t_end_s}
    for s in symmetries:
        if s.verdict == "broken" and not s.deviation <= error_of.get(s.settings_ids[-1], math.nan):
            reason = Reason(Law.SYMMETRY, s.deviation, s.bound, s.unit, name=s.title)
            broken.setdefault(s.settings_ids[-1], []).append(reason)
    out = []
    for r in sorted(records, key=lambda r: (r.problem, r.solver, r.case)):
        because = (
            *(reasons_of(r.wrong_because) if misleads(r) else ()),
            *_find_out_of_plane(r),
            *broken.get(r.settings_id, ()),
        )
        if r.claimed == Status.SUCCESS and because and not is_literal(r):
            out.append(FalseSuccess(r.case, r.settings_id, r.solver, r.problem, because))
    return tuple(out)


def _find_out_of_plane(r: RunRecord) -> tuple[Reason, ...]:
    away, allowed = r.out_of_plane_max_m, OUT_OF_PLANE * r.length_scale_m
    if math.isnan(away) or away <= allowed or not r.judged_to_s >= JUDGED * r.t_end_s:
        return ()
    return (Reason(Law.PLANE, away, allowed, "m"),)
