"""Find what misleads: runs that claim success while a law contradicts them, and symmetries that are broken.

A bound of a symmetry follows from the solver's tolerance and step, so that it may be broken by a nanometre. It misleads
nobody where the presented motion is right by comparison with its reference, or where the break is below the error that
the method makes anyway: that of the run as it stands. The presented run's own error is no measure of this: where the
presentation spoils the motion, the two are the same. Such a break is a finding about the method, no false success. Runs
from a literal start are left out: it opens the joints, and a motion that keeps to it breaks their law.
"""

import math
from collections.abc import Iterable

import numpy as np
from msgspec.structs import replace

from ...mechanics.types import Law, Reason, Status
from ...results.judgements.runs import PLANARITY, REVERSAL, FalseSuccess, Symmetry
from ...results.misleading import RIGHT, agrees_with_reference, is_compared_to_end, is_misleading
from ...results.records import RunRecord, is_literal
from ..invariance import OUT_OF_PLANE, find_return_factor


def find_false_successes(records: Iterable[RunRecord], symmetries: Iterable[Symmetry]) -> tuple[FalseSuccess, ...]:
    """Return one entry per run that claims success and misleads: it breaks a law or a symmetry, or leaves its plane.

    The entry holds the reasons. Runs from a literal start are left out.
    """
    broken: dict[str, list[Reason]] = {}
    for s in symmetries:
        if s.contradicts:
            reason = Reason(Law.SYMMETRY, s.deviation, s.bound, s.unit, name=s.title)
            broken.setdefault(s.settings_ids[-1], []).append(reason)
    out = []
    for r in sorted(records, key=lambda r: (r.problem, r.solver, r.case)):
        own = list_contradictions(r)
        because = (*(own if is_misleading(r, own) else ()), *broken.get(r.settings_id, ()))
        if r.claimed == Status.SUCCESS and because and not is_literal(r):
            out.append(FalseSuccess(r.case, r.settings_id, r.solver, r.problem, because))
    return tuple(out)


def list_contradictions(r: RunRecord) -> tuple[Reason, ...]:
    """Return the reasons against a run that need no other run: laws that a wrong run breaks, and leaving its plane."""
    return (*(r.reasons if r.status == Status.WRONG else ()), *_find_out_of_plane(r))


def _find_out_of_plane(r: RunRecord) -> tuple[Reason, ...]:
    """Return the reason, in a tuple of one, if a run of a planar mechanism leaves its plane; else an empty tuple.

    Motions that are not predictable to their end are not judged: beyond, a planar chain may leave its plane.
    """
    away, allowed = r.out_of_plane_max_m, OUT_OF_PLANE * r.length_scale_m
    if math.isnan(away) or away <= allowed or not is_compared_to_end(r):
        return ()
    return (Reason(Law.PLANE, away, allowed, "m"),)


def weigh_break(row: Symmetry, base: RunRecord, presented: RunRecord) -> Symmetry:
    """Return the row of a broken symmetry with the method's own error and whether it misleads; others unchanged.

    It does not mislead if the presented motion agrees with its reference, or if the deviation is below that error.
    ``base`` is the run as it stands, ``presented`` the one in another presentation; for planarity they are the same.
    """
    if row.verdict != "broken":
        return row
    own = measure_own_error(row, base)
    right = agrees_with_reference(presented) and (row.check != REVERSAL or _returns_to_start(presented))
    return replace(row, own_error=own, misleads=not (right or row.deviation <= own))


def measure_own_error(row: Symmetry, base: RunRecord) -> float:
    """Return the error that the method makes anyway [m], in the distance by which the check compares poses.

    It is the largest pose error of ``base`` or, for a run that leaves its plane, the part of it within the plane. For a
    motion that is integrated back, it is multiplied by how much errors grow on the way. NaN if the motion is not
    predictable to its end.
    """
    if not is_compared_to_end(base):
        return math.nan
    if row.check == PLANARITY:
        return math.sqrt(max(base.position_error_judged_m**2 - row.deviation**2, 0.0))
    turned = base.length_scale_m * base.orientation_error_judged_rad
    poses = float(np.maximum(base.position_error_judged_m, turned))
    return poses * (find_return_factor(row.growth) if row.check == REVERSAL else 1.0)


def _returns_to_start(r: RunRecord) -> bool:
    """Return whether a motion that is integrated back ends at its start, with the velocities reversed there.

    Both must agree to ``RIGHT`` of the run's scales of length and speed.
    """
    away = np.maximum(r.return_error_m, r.length_scale_m * r.return_error_rad)
    speed = np.maximum(r.return_error_m_per_s, r.length_scale_m * r.return_error_rad_per_s)
    return bool(away <= RIGHT * r.length_scale_m and speed <= RIGHT * r.speed_scale_m_per_s)
