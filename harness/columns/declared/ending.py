"""Columns of how a run ended: its status, the solver's claim, what ended it, notes."""

import json
from collections.abc import Iterator
from dataclasses import dataclass

from ...base.text import escape_text
from ..declaring import column
from ..measured import DECIDED, MeasuredMotion, MeasuredSeries


def write_notes(run: MeasuredMotion) -> str:
    """Return the notes on a run as a JSON list: by its solver, on the measured series, and on what is not judged."""
    notes = (*run.trajectory.notes, *run.series.notes, *_list_unjudged(run.series))
    return json.dumps([escape_text(n) for n in notes])


def _list_unjudged(m: MeasuredSeries) -> Iterator[str]:
    """Yield notes on what could not be judged: energy over steps of unknown work, and rates at uncertain poses.

    Rates are the accelerations and reactions of ``Truncation``.
    """
    n, steps, rates = m.steps_of_unknown_work, len(m.t) - 1, m.truncation
    if n:
        yield f"energy not judged over {n} of {steps} steps: the work done in them is not known"
    for what, unsure in (("accelerations", rates.unsure), ("reactions", rates.unsure_loads)):
        if unsure:
            known = rates.rows - unsure
            how = "judged" if known >= DECIDED * rates.rows else "not determined, known"
            rows = f"at {known} of {rates.rows} rows looked at"
            yield f"{what} {how} {rows}: elsewhere a pose is not known well enough for them"


@dataclass(frozen=True, repr=False)
class EndingColumns:
    """The end of a run: what its solver claimed, what ended it, and the status that follows."""

    status: str = column("harness.mechanics.types.Status: success, inaccurate, wrong, refused, ...", "")
    claimed: str = column("the status the solver itself gave; empty if it never returned", "")
    ended_by: str = column("harness.mechanics.types.EndedBy: solver, exception, cpu_limit, signal, ...", "")
    ended_limit_s: float = column("the limit on time that ended it, with its grace period")
    message: str = column("the solver's message, or that of the exception it raised", "")
    missing_package: str = column("package that is not installed and without which the solver refused; else empty", "")
    wrong_because: str = column(
        "JSON list of harness.mechanics.types.Reason: why a claimed success is wrong or inaccurate", "[]"
    )
    notes: str = column("JSON list: notes of the solver, e.g. which redundant rows it dropped", "[]", of=write_notes)
    events: int = column(
        "number of events in the series file, e.g. singular passages", 0, of=lambda run: len(run.trajectory.events)
    )
    t_reached_s: float = column(
        "time of the last accepted step",
        of=lambda run: float(run.series.t[-1]),
        head="t reached",
        unit="s",
        show="time",
        order=40,
        tables=("problem", "runs"),
        better="more",
    )
    exit_code: int = column("exit code of the run's process (of the supervisor, if that was lost)", 0)
    signal: int = column("signal that ended the process, 0 if none", 0)
