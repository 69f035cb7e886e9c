"""Whether a run that claims success and breaks a law misleads who trusts it."""

import math

from ..types import Law, Status
from .records import RunRecord, reasons_of

RIGHT = 0.01  # of their sizes: errors of motion, velocities and reactions below which nobody is misled
TO_THE_END = 0.98  # of the time, compared with the exact motion


def is_right(r: RunRecord) -> bool:
    """Whether its motion was compared to the end and poses, velocities and reactions, if it has any, are right."""
    pairs = [(r.motion_error_judged_m, r.length_scale_m), (r.rate_error_judged_m_per_s, r.speed_scale_m_per_s)]
    if not math.isnan(r.reaction_error_max_N):
        pairs.append((r.reaction_error_max_N, r.reaction_size_N))
    return r.judged_to_s >= TO_THE_END * r.t_end_s and all(error <= RIGHT * size for error, size in pairs)


def misleads(r: RunRecord) -> bool:
    """Whether it is a false success: wrong by a law of states, or by its own rates where its motion is not right.

    The law on rates judges a derivative of what was recorded. Where that is right by comparison, it is no false
    success, whatever its derivative is.
    """
    laws = {reason.law for reason in reasons_of(r.wrong_because)}
    return r.claimed == Status.SUCCESS and r.status == Status.WRONG and not (laws == {Law.TRUNCATION} and is_right(r))
