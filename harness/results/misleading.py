"""Decide whether a run that claims success misleads its user, by the reasons that contradict it."""

import math
from collections.abc import Collection

from ..mechanics.types import Law, Reason, Status
from .records import RunRecord

# relative errors of motion, velocities and reactions below which nobody is misled. Of the 813 claimed successes of the
# suites ``first`` and ``paper`` 473 are below it to the end; half: 428, twice: 515.
RIGHT = 0.01
TO_THE_END = 0.98  # fraction of the time that must be compared with the exact motion; half, or 1: the same 473
# laws of what is measured at each time without a reference: no comparison excuses a motion that breaks one
STATE_LAWS = frozenset(
    (
        Law.FINITE,
        Law.START,
        Law.END,
        Law.ENERGY,
        Law.CONSTRAINT,
        Law.CONSTRAINT_RATE,
        Law.ORTHOGONALITY,
        Law.INVARIANT,
    )
)


def is_compared_to_end(r: RunRecord) -> bool:
    """Return whether errors are judged for at least the fraction ``TO_THE_END`` of the run's time."""
    return r.judged_to_s >= TO_THE_END * r.t_end_s


def agrees_with_reference(r: RunRecord) -> bool:
    """Return whether the motion was compared to its end and is right: all its relative errors are at most ``RIGHT``.

    They are those of poses and velocities and, where the exact ones are known, of joint forces and moments.
    """
    pairs = [(r.motion_error_judged_m, r.length_scale_m), (r.rate_error_judged_m_per_s, r.speed_scale_m_per_s)]
    for error, size in ((r.reaction_error_max_N, r.reaction_size_N), (r.moment_error_max_Nm, r.moment_size_Nm)):
        if not math.isnan(error):
            pairs.append((error, size))
    return is_compared_to_end(r) and all(error <= RIGHT * size for error, size in pairs)


def breaks_state_law(because: Collection[Reason]) -> bool:
    """Return whether any of the reasons is a broken law of states: of energy, another invariant, joints, or numbers."""
    return not STATE_LAWS.isdisjoint(reason.law for reason in because)


def is_misleading(r: RunRecord, because: Collection[Reason]) -> bool:
    """Return whether the run is a false success for the reasons ``because``: it claims success and its motion misleads.

    A broken law of states always counts. All other laws count only unless the motion agrees with the reference, since
    they judge derivatives of what was recorded. Whether a broken symmetry misleads is decided where it is checked.
    """
    return r.claimed == Status.SUCCESS and (
        breaks_state_law(because) or (len(because) > 0 and not agrees_with_reference(r))
    )
