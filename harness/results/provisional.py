"""Records of how the harness ended, not of what a run does: a limit on the suite, or a lost process that many runs
share. They stand until the suite is resumed, which moves them aside and repeats the runs.
"""

from collections.abc import Iterable
from pathlib import Path

from ..places import Place
from ..types import EndedBy, Status
from .records import RunRecord
from .store import Unreadable, end_key

PROVISIONAL = (
    EndedBy.TOTAL_LIMIT, EndedBy.SUPERVISOR_LOST, EndedBy.WORKERS_LOST, EndedBy.KILLED, EndedBy.SUSPENDED
)  # fmt: skip


def is_provisional(record: RunRecord) -> bool:
    """Whether the same run may well end differently next time."""
    return record.ended_by in PROVISIONAL


def latest_of_each(records: Iterable[RunRecord]) -> tuple[RunRecord, ...]:
    """The latest record of each run; beside a success, records cut short or crashed do not count."""
    found: dict[str, list[RunRecord]] = {}
    for r in sorted(records, key=lambda r: (end_key(r), r.run_id)):
        found.setdefault(r.settings_id, []).append(r)
    return tuple(map(_pick_latest, found.values()))


def _pick_latest(same: list[RunRecord]) -> RunRecord:
    whole = [r for r in same if not (is_provisional(r) or r.status == Status.CRASHED)]
    succeeded = any(r.status == Status.SUCCESS for r in whole)
    return (whole if succeeded else same)[-1]


def files_of(folder: Path, record: RunRecord, why: str = "") -> list[Unreadable]:
    """Files to set aside before the run is repeated: its record first, with the reason."""
    why = why or f"the run was cut short ({record.ended_by}) and is repeated"
    names = (f"runs/{record.run_id}.json", record.series, record.stderr)
    return [Unreadable(folder / name, why) for name in names if name and (Place(folder) / name).is_own_file()]
