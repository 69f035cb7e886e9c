"""Decide whether a run that claims success and breaks a law misleads its user."""

import math

from ..mechanics.types import Law, Status
from .records import RunRecord, parse_reasons

RIGHT = 0.01  # relative errors of motion, velocities and reactions below which nobody is misled
TO_THE_END = 0.98  # fraction of the time that must be compared with the exact motion


def agrees_with_reference(r: RunRecord) -> bool:
    """Return whether the motion was compared to its end, with right poses, velocities and, if known, reactions."""
    pairs = [(r.motion_error_judged_m, r.length_scale_m), (r.rate_error_judged_m_per_s, r.speed_scale_m_per_s)]
    for error, size in ((r.reaction_error_max_N, r.reaction_size_N), (r.moment_error_max_Nm, r.moment_size_Nm)):
        if not math.isnan(error):
            pairs.append((error, size))
    return r.judged_to_s >= TO_THE_END * r.t_end_s and all(error <= RIGHT * size for error, size in pairs)


def is_misleading(r: RunRecord) -> bool:
    """Return whether the run is a false success: it claims success but breaks a law of states.

    The law on rates alone counts only if the motion is not right. It judges a derivative of what was recorded; if the
    motion is right by comparison, its derivative does not matter.
    """
    laws = {reason.law for reason in parse_reasons(r.wrong_because)}
    return (
        r.claimed == Status.SUCCESS
        and r.status == Status.WRONG
        and not (laws == {Law.TRUNCATION} and agrees_with_reference(r))
    )
