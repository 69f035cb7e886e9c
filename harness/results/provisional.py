"""Identify records of runs that ended for a reason outside them: a limit on the suite, a shared process, a signal.

They stand until the suite is resumed, which moves them aside and repeats the runs.
"""

from collections.abc import Iterable
from pathlib import Path

from ..base.confined_paths import ConfinedPath
from ..mechanics.types import EndCause, Status
from .records import RunRecord
from .store import make_end_key

PROVISIONAL = (  # causes outside a run, which say nothing about it
    EndCause.TOTAL_LIMIT,
    EndCause.SUPERVISOR_LOST,
    EndCause.WORKERS_LOST,
    EndCause.KILLED,
    EndCause.SUSPENDED,
)


def is_provisional(record: RunRecord) -> bool:
    """Return whether a run ended for a reason outside it, so that it may end differently if repeated."""
    return record.ended_by in PROVISIONAL


def select_latest(records: Iterable[RunRecord]) -> tuple[RunRecord, ...]:
    """Return the latest record of each run, runs being distinguished by ``settings_id``.

    If a run has succeeded, its provisional records and its crashes do not count.
    """
    found: dict[str, list[RunRecord]] = {}
    for r in sorted(records, key=lambda r: (make_end_key(r), r.run_id)):
        found.setdefault(r.settings_id, []).append(r)
    return tuple(map(_pick_latest, found.values()))


def _pick_latest(same: list[RunRecord]) -> RunRecord:
    """Return the latest of the records of one run, which are sorted by their ends.

    If one of them is a success, the latest that is neither provisional nor a crash.
    """
    whole = [r for r in same if not (is_provisional(r) or r.status == Status.CRASHED)]
    succeeded = any(r.status == Status.SUCCESS for r in whole)
    return (whole if succeeded else same)[-1]


def list_record_files(folder: Path, record: RunRecord, why: str = "") -> dict[Path, str]:
    """Return the existing files of a run, the record first, each with the reason ``why`` it is to be set aside.

    By default the reason is that the run was cut short and is repeated.
    """
    why = why or f"the run was cut short ({record.ended_by}) and is repeated"
    names = (f"runs/{record.run_id}.json", record.series, record.stderr)
    return {folder / name: why for name in names if name and (ConfinedPath(folder) / name).is_own_file()}
