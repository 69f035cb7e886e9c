"""The end of a run and why it is wrong, in words made from its record, for terminal and pages alike."""

import math
import signal

from ..text import printable
from ..types import ACCURATE, EndedBy, Law, Reason, Status
from .records import RunRecord, reasons_of

WHOLE = 0.999  # of the time: a motion that was compared up to there was compared
WORKERS = 3  # Dask gives a run up after it has lost that many
LAWS = {
    Law.ENERGY: "the energy error", Law.MOTION: "the motion error", Law.POSITION: "the position error",
    Law.ORIENTATION: "the orientation error",
    Law.CONSTRAINT: "|phi|", Law.CONSTRAINT_RATE: "|phi_dot|", Law.ORTHOGONALITY: "|R^T R - 1|",
    Law.KINEMATIC: "the disagreement of poses and velocities (of the path)", Law.REACTION: "the error of a joint force",
    Law.VELOCITY: "the velocity error", Law.ROWS: "the motion error between recorded steps, which are too few,",
    Law.PLANE: "the distance from the plane of motion", Law.FINITE: "values that are not finite",
    Law.START: "another start", Law.END: "another end",
}  # fmt: skip


def why(record: RunRecord) -> list[str]:
    """Why a run is not a success, never empty for one that is not; for a success what its solver said, if anything."""
    found = [words_of(r) for r in reasons_of(record.wrong_because)] or [words_of_ending(record)]
    said = [w for w in found if w.strip()]
    return said or ([] if record.status == Status.SUCCESS else [f"{record.status or 'unknown'}, without a message"])


def accurate_until(record: RunRecord) -> list[str]:
    """``2.57 s (10 %)``, one a level; ``at least`` where the reference ends before the motion leaves it."""
    return [
        f"{'at least ' if at_least(record, time) else ''}{time:.4g} s ({100.0 * level:g} %)"
        for name, level in ACCURATE.items()
        if not math.isnan(time := getattr(record, name))
    ]


def judged_error(record: RunRecord, name: str, unit: str) -> float:
    """An error of all tables, pages and terminals: up to ``judged_to_s``; over all time where that is not known.

    ``name`` and ``unit`` are those of its columns: ``position_error`` and ``m``.
    """
    value, whole = (float(getattr(record, f"{name}_{kind}_{unit}")) for kind in ("judged", "max"))
    return whole if math.isnan(value) else value


def error_until(record: RunRecord) -> float:
    """[s] the end of the interval of ``judged_error``; NaN without a reference."""
    if math.isnan(record.position_error_judged_m):
        return min(record.reference_horizon_s, record.t_reached_s)
    return min(record.judged_to_s, record.t_reached_s)


def error_words(record: RunRecord) -> str:
    """``0.0159 m, 0.0433 rad (to 1.62 s)``; empty without a reference."""
    position, orientation = (
        judged_error(record, "position_error", "m"),
        judged_error(record, "orientation_error", "rad"),
    )
    if math.isnan(position):
        return ""
    turned = "" if math.isnan(orientation) else f", {orientation:.3e} rad"
    return f"{position:.3e} m{turned} (to {error_until(record):.4g} s)"


def comparison_words(record: RunRecord) -> str:
    """``compared to 58.8 of 2000 s``, of a lawful motion whose end nothing was compared with; else empty."""
    if record.status not in (Status.SUCCESS, Status.INACCURATE):
        return ""
    if math.isnan(end := error_until(record)):
        return "compared with no exact motion"
    return "" if end >= WHOLE * record.t_reached_s else f"compared to {end:.4g} of {record.t_reached_s:.4g} s"


def status_words(record: RunRecord) -> str:
    """The status, with how far its motion was compared where that is not to the end."""
    return ", ".join(filter(None, (record.status, comparison_words(record))))


def at_least(record: RunRecord, accurate_until: float) -> bool:
    """Whether the reference ended before the motion left it: how long it would have stayed is not known."""
    return record.t_reached_s > record.compared_to_s <= accurate_until


def law_of(reason: Reason) -> str:
    """The quantity that breaks its limit."""
    name = printable(reason.name)
    return LAWS.get(reason.law) or (f"the drift of {name}" if reason.law is Law.INVARIANT else name)


def words_of(reason: Reason) -> str:
    """``the energy error reaches 3 J, more than 1 J, first at 0.2 s``."""
    r = reason
    if r.law is Law.FINITE:
        return f"the trajectory holds values that are not finite numbers{_append_time(r, ', from t = ')}"
    if r.law is Law.START:
        return f"the motion does not begin at the given start (off by {r.value:.3g}, at t = {r.time_s:g} s)"
    if r.law is Law.END:
        return f"success claimed, but the last step ends at {r.value:.9g} s of {r.limit:g} s"
    unit = f" {r.unit}" if r.unit else ""
    return f"{law_of(r)} reaches {r.value:.3g}{unit}, more than {r.limit:.3g}{unit}{_append_time(r, ', first at ')}"


def words_of_ending(record: RunRecord) -> str:
    """The solver's own message, or what ended its process and which steps are left of its motion."""
    r = record
    words = {
        EndedBy.WALL_LIMIT: f"not finished here: killed after {r.ended_limit_s:g} s of wall time, "
        "before it had used the CPU time it was given",
        EndedBy.CPU_LIMIT: f"not finished here: {printable(r.message) or _describe_kill(r)}",
        EndedBy.CODE_LIMIT: f"not finished here: compilation took over {r.ended_limit_s:g} s of CPU time, "
        "which is none of the solver's",
        EndedBy.MEASURE_LIMIT: "not finished here: the solver returned, but measuring its motion took too long",
        EndedBy.TOTAL_LIMIT: f"not finished here: killed at the suite's total_limit of {r.ended_limit_s:g} s",
        EndedBy.EXIT: f"the process exited with code {r.exit_code} and no result",
        EndedBy.SIGNAL: _describe_signal(r),
        EndedBy.KILLED: f"{_describe_signal(r)}, sent from outside the run",
        EndedBy.SUSPENDED: "not finished here: its limit passed while the harness was suspended; --resume repeats it",
        EndedBy.MEMORY_LIMIT: printable(r.message) or f"{_describe_signal(r)}, near its memory limit",
        EndedBy.SUPERVISOR_LOST: "the supervisor process died twice "
        f"(code {r.exit_code - r.signal}) during this run, the second time with this run alone",
        EndedBy.WORKERS_LOST: f"its worker died {WORKERS} or more times",
    }.get(r.ended_by, printable(r.message))  # type: ignore[call-overload]
    kept = r.ended_by not in ("", EndedBy.SOLVER) and r.t_reached_s > 0.0
    return f"{words} (steps to t = {r.t_reached_s:.6g} s kept)" if kept else words


def _describe_kill(r: RunRecord) -> str:
    return f"killed past its limit of {r.cpu_limit_s:g} s of CPU time: the solver did not stop when asked"


def _describe_signal(r: RunRecord) -> str:
    name = signal.Signals(r.signal).name if r.signal in set(signal.Signals) else str(r.signal)
    return f"ended by {name}" + ("" if math.isnan(r.peak_memory_MB) else f" with {r.peak_memory_MB:.0f} MB resident")


def _append_time(r: Reason, words: str) -> str:
    return "" if math.isnan(r.time_s) else f"{words}{r.time_s:.4g} s"
