"""Describe the end of a run and why it is wrong, from its record, for the terminal and for pages."""

import math
import signal

from ..base.text import escape_text
from ..mechanics.types import ACCURATE, PASSAGE, RIGHT_REACTION, EndCause, Law, Reason, Status
from .records import RunRecord

# fraction of the energy scale (for a moment [J = N m]), or of it over the length scale (for a force [N]): smaller joint
# loads are rounding, and errors are relative to this
ROUNDED = 1e-9
WHOLE = 0.999  # fraction of the time up to which a motion must be compared to count as compared
WORKERS = 3  # Dask gives up a run after losing this many workers
LAWS = {
    Law.ENERGY: "the energy error",
    Law.MOTION: "the motion error",
    Law.POSITION: "the position error",
    Law.ORIENTATION: "the orientation error",
    Law.CONSTRAINT: "|phi|",
    Law.CONSTRAINT_RATE: "|phi_dot|",
    Law.ORTHOGONALITY: "|R^T R - 1|",
    Law.KINEMATIC: "what poses and velocities disagree by beyond the exact motion (of the path)",
    Law.REACTION: "the error of a joint force",
    Law.MOMENT: "the error of the joints' moment on a body",
    Law.VELOCITY: "the velocity error",
    Law.ROWS: "the motion error between recorded steps, which are too few,",
    Law.PLANE: "the distance from the plane of motion",
    Law.FINITE: "values that are not finite",
    Law.START: "another start",
    Law.END: "another end",
}


def list_reasons(record: RunRecord) -> list[str]:
    """Return the reasons why a run is not a success, at least one.

    For a success the list has the solver's message, or is empty without one.
    """
    found = [describe_breach(r) for r in record.reasons] or [describe_ending(record)]
    said = [w for w in found if w.strip()]
    return said or ([] if record.status == Status.SUCCESS else [f"{record.status or 'unknown'}, without a message"])


def format_accurate_times(record: RunRecord) -> list[str]:
    """Return the times up to which the motion tracks the reference, by level of motion error: ``2.57 s (10 %)``.

    Where the reference ends first, it is ``at least 2.57 s (10 %)``. Levels without a time are left out.
    """
    return [
        f"{'at least ' if is_lower_bound(record, time) else ''}{time:.4g} s ({100.0 * level:g} %)"
        for name, level in ACCURATE.items()
        if not math.isnan(time := getattr(record, name))
    ]


def select_judged_error(record: RunRecord, name: str, unit: str) -> float:
    """Return the error that tables, pages and terminals show: its maximum up to ``judged_to_s``, else over all time.

    ``name`` and ``unit`` are those of its columns, such as ``position_error`` and ``m``; the result has that unit.
    """
    value, whole = (float(getattr(record, f"{name}_{kind}_{unit}")) for kind in ("judged", "max"))
    return whole if math.isnan(value) else value


def find_error_end(record: RunRecord) -> float:
    """Return the time [s] up to which ``select_judged_error`` is taken; NaN without a reference."""
    if math.isnan(record.position_error_judged_m):
        return min(record.reference_horizon_s, record.t_reached_s)
    return min(record.judged_to_s, record.t_reached_s)


def describe_errors(record: RunRecord) -> str:
    """Format position and orientation error, ``0.0159 m, 0.0433 rad (to 1.62 s)``; empty without a reference."""
    position, orientation = (
        select_judged_error(record, "position_error", "m"),
        select_judged_error(record, "orientation_error", "rad"),
    )
    if math.isnan(position):
        return ""
    turned = "" if math.isnan(orientation) else f", {orientation:.3e} rad"
    return f"{position:.3e} m{turned} (to {find_error_end(record):.4g} s)"


def describe_comparison(record: RunRecord) -> str:
    """Return how far a lawful motion was compared, ``compared to 58.8 of 2000 s`` or ``compared with no exact motion``.

    Empty if it was compared to its end, and for a motion that is not lawful.
    """
    if record.status not in (Status.SUCCESS, Status.INACCURATE):
        return ""
    if math.isnan(end := find_error_end(record)):
        return "compared with no exact motion"
    return describe_span(end, record.t_reached_s)


def describe_span(end: float, whole: float) -> str:
    """Return ``compared to 58.8 of 2000 s`` for a motion of ``whole`` [s] compared to ``end`` [s]; "" if to its end."""
    return "" if end >= WHOLE * whole else f"compared to {end:.4g} of {whole:.4g} s"


def describe_status(record: RunRecord) -> str:
    """Return the status of a run, followed by its qualifications (``qualify_status``)."""
    return ", ".join(filter(None, (record.status, qualify_status(record))))


def qualify_status(record: RunRecord) -> str:
    """Return the qualifications that are shown beside a run's status, separated by commas; empty if there are none.

    They are how far the motion was compared, a singular pose that it passed, and wrong reactions.
    """
    words = (describe_comparison(record), describe_passage(record), describe_reactions(record))
    return ", ".join(filter(None, words))


def describe_passage(record: RunRecord) -> str:
    """Return ``passes a singular pose at t = 0.73 s`` if a note of the run says so, or "".

    More than one motion continues from such a pose.
    """
    notes = [escape_text(n) for n in record.note_lines]
    begin, end = PASSAGE
    return next((n.split(end)[0] for n in notes if n.startswith(begin) and end in n), "")


def describe_reactions(record: RunRecord) -> str:
    """Return text such as ``reactions off by 176 %`` if joint loads of a lawful motion are wrong, else ""."""
    error, lawful = compute_reaction_error(record), record.status in (Status.SUCCESS, Status.INACCURATE)
    return f"reactions off by {100.0 * error:.3g} %" if lawful and error > RIGHT_REACTION else ""


def compute_reaction_error(record: RunRecord) -> float:
    """Return the larger of the relative errors of the joints' force and moment on a body; NaN if both are unknown.

    Each is relative to the largest such load of the exact motion, or to ``ROUNDED`` times its scale if that is larger.
    """
    r, relative = record, []
    for error, size, scale in (
        (r.reaction_error_max_N, r.reaction_size_N, r.energy_scale_J / (r.length_scale_m or math.nan)),
        (r.moment_error_max_Nm, r.moment_size_Nm, r.energy_scale_J),
    ):
        # avoids a division by about zero where no joint carries a load
        size = max(size, ROUNDED * scale) if scale > 0.0 else size
        relative.append(error / size if size > 0.0 else math.nan)
    known = [x for x in relative if not math.isnan(x)]  # older records have forces but no moments
    return max(known, default=math.nan)


def is_lower_bound(record: RunRecord, accurate_until: float) -> bool:
    """Return whether the time up to which a motion tracks the reference is only a lower bound.

    It is if the motion went on after the comparison had ended and was accurate until then. ``accurate_until`` is
    that time [s], a column of the record.
    """
    return record.t_reached_s > record.compared_to_s <= accurate_until


def find_broken_law(reason: Reason) -> str:
    """Return in words the quantity of a reason, which exceeds its limit: ``the energy error``."""
    name = escape_text(reason.name)
    return LAWS.get(reason.law) or (f"the drift of {name}" if reason.law is Law.INVARIANT else name)


def describe_breach(reason: Reason) -> str:
    """Describe the breach of a law or limit: ``the energy error reaches 3 J, more than 1 J, first at 0.2 s``.

    Values that are not finite, another start and another end have sentences of their own.
    """
    r = reason
    if r.law is Law.FINITE:
        return f"the trajectory holds values that are not finite numbers{_append_time(r, ', from t = ')}"
    if r.law is Law.START:
        return f"the motion does not begin at the given start (off by {r.value:.3g}, at t = {r.time_s:g} s)"
    if r.law is Law.END:
        return f"success claimed, but the last step ends at {r.value:.9g} s of {r.limit:g} s"
    unit = f" {r.unit}" if r.unit else ""
    words = f"{find_broken_law(r)} reaches {r.value:.3g}{unit}, more than {r.limit:.3g}{unit}"
    return words + _append_time(r, ", first at ")


def describe_ending(record: RunRecord) -> str:
    """Describe how a run ended: by the solver's own message, or by what ended its process.

    For a run that was cut short, the time up to which its steps are kept is added.
    """
    r = record
    words = {
        EndCause.WALL_LIMIT: f"not finished here: killed after {r.ended_limit_s:g} s of wall time, "
        "before it had used the CPU time it was given",
        EndCause.CPU_LIMIT: f"not finished here: {escape_text(r.message) or _describe_kill(r)}",
        EndCause.CODE_LIMIT: f"not finished here: compilation took over {r.ended_limit_s:g} s of CPU time, "
        "which is none of the solver's",
        EndCause.MEASURE_LIMIT: "not finished here: the solver returned, but measuring its motion took too long",
        EndCause.TOTAL_LIMIT: f"not finished here: killed at the suite's total_limit of {r.ended_limit_s:g} s",
        EndCause.EXIT: f"the process exited with code {r.exit_code} and no result",
        EndCause.SIGNAL: _describe_signal(r),
        EndCause.KILLED: f"{_describe_signal(r)}, sent from outside the run",
        EndCause.SUSPENDED: "not finished here: its limit passed while the harness was suspended; --resume repeats it",
        EndCause.MEMORY_LIMIT: escape_text(r.message) or f"{_describe_signal(r)}, near its memory limit",
        EndCause.SUPERVISOR_LOST: "the supervisor process died twice "
        f"(code {r.exit_code - r.signal}) during this run, the second time with this run alone",
        EndCause.WORKERS_LOST: f"its worker died {WORKERS} or more times",
    }.get(r.ended_by, escape_text(r.message))  # type: ignore[call-overload]
    kept = r.ended_by not in ("", EndCause.SOLVER) and r.t_reached_s > 0.0
    return f"{words} (steps to t = {r.t_reached_s:.6g} s kept)" if kept else words


def _describe_kill(r: RunRecord) -> str:
    """Return in words that the run was killed at its limit on CPU time."""
    return f"killed past its limit of {r.cpu_limit_s:g} s of CPU time: the solver did not stop when asked"


def _describe_signal(r: RunRecord) -> str:
    """Return in words the signal that ended the run's process, and the memory of that process, if known."""
    name = signal.Signals(r.signal).name if r.signal in set(signal.Signals) else str(r.signal)
    return f"ended by {name}" + ("" if math.isnan(r.peak_memory_MB) else f" with {r.peak_memory_MB:.0f} MB resident")


def _append_time(r: Reason, words: str) -> str:
    """Return ``words`` followed by the time of a reason [s]; empty if it has no time."""
    return "" if math.isnan(r.time_s) else f"{words}{r.time_s:.4g} s"
