"""Records that tell how a run ended, not what a run does: runs ended by the run's own limit, or with a process that
many runs share. They stand until the run is resumed, which sets them aside and runs their runs again.
"""

from pathlib import Path

from .records import RunRecord
from .store import Unreadable
from ..types import Status

LIMIT_MET = "when the whole run met its limit"  # in messages: by these words such records are known again
SUPERVISOR_DIED = "the supervisor process died"
WORKERS_DIED = "the workers it was given to died"


def limit_words(limit: float) -> str:
    """The message of runs that ran when the time of the whole run [s] was up."""
    return f"killed {LIMIT_MET} of {limit:g} s (total_limit of the suite)"


def is_provisional(record: RunRecord) -> bool:
    """Whether another run of the same run may well end otherwise."""
    if record.claimed:  # the solver itself said how it ended
        return False
    if record.status == Status.STALLED:
        return f"killed {LIMIT_MET}" in record.message
    return record.status == Status.CRASHED and record.message.startswith((SUPERVISOR_DIED, WORKERS_DIED))


def files_of(folder: Path, record: RunRecord) -> list[Unreadable]:
    """What is to be set aside before the run is run again: its record first, with the reason."""
    why = f"it says how an earlier run ended ({record.message}); the run is run again"
    names = (f"runs/{record.run_id}.json", record.series, record.stderr)
    return [Unreadable(folder / name, why) for name in names if name and (folder / name).is_file()]
