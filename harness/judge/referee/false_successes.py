"""Find false successes: runs that claim success while a law or a symmetry contradicts it, and that mislead.

A presentation that changes digits below the run's own error is a finding about the method, not a false success. Runs
from a literal start are left out: it opens the joints, and a motion that keeps to it breaks their law.
"""

import math
from collections.abc import Iterable

from ...mechanics.types import Law, Reason, Status
from ...results.judgements.runs import FalseSuccess, Symmetry
from ...results.misleading import is_misleading
from ...results.records import RunRecord, is_literal, parse_reasons

OUT_OF_PLANE = 0.01  # fraction of the mechanism's size, for a motion that is planar and predictable to the end
JUDGED = 0.98  # fraction of the time judged against the reference: beyond it a planar chain may leave its plane


def find_false_successes(records: Iterable[RunRecord], symmetries: Iterable[Symmetry]) -> tuple[FalseSuccess, ...]:
    """Return one entry per run that claims success but breaks a law, leaves its plane, or breaks a symmetry.

    The entry holds the reasons: those on the run's record, and those found here.
    """
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
            *(parse_reasons(r.wrong_because) if is_misleading(r) else ()),
            *_find_out_of_plane(r),
            *broken.get(r.settings_id, ()),
        )
        if r.claimed == Status.SUCCESS and because and not is_literal(r):
            out.append(FalseSuccess(r.case, r.settings_id, r.solver, r.problem, because))
    return tuple(out)


def _find_out_of_plane(r: RunRecord) -> tuple[Reason, ...]:
    """Return the reason, in a tuple of one, if a run of a planar mechanism leaves its plane; else an empty tuple.

    Motions that are not predictable to their end are not judged.
    """
    away, allowed = r.out_of_plane_max_m, OUT_OF_PLANE * r.length_scale_m
    if math.isnan(away) or away <= allowed or not r.judged_to_s >= JUDGED * r.t_end_s:
        return ()
    return (Reason(Law.PLANE, away, allowed, "m"),)
