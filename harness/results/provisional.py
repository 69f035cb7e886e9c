"""Records of how the harness ended, not of what a run does: a limit on the suite, or a lost process that many runs
share. They stand until the suite is resumed, which sets them aside and runs their runs again.
"""

from pathlib import Path

from ..types import EndedBy
from .records import RunRecord
from .store import Unreadable

PROVISIONAL = (
    EndedBy.TOTAL_LIMIT, EndedBy.SUPERVISOR_LOST, EndedBy.WORKERS_LOST, EndedBy.KILLED, EndedBy.SUSPENDED
)  # fmt: skip


def is_provisional(record: RunRecord) -> bool:
    """Whether the same run may well end differently next time."""
    return record.ended_by in PROVISIONAL


def files_of(folder: Path, record: RunRecord) -> list[Unreadable]:
    """What is set aside before the run is repeated: its record first, with the reason."""
    why = f"the run was cut short ({record.ended_by}) and is repeated"
    names = (f"runs/{record.run_id}.json", record.series, record.stderr)
    return [Unreadable(folder / name, why) for name in names if name and (folder / name).is_file()]
