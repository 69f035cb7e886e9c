"""List the runs that a runner has started, on disk while it works, to recognise records that something else made.

``.begun`` lists the runs that had results before, then each that begins. It is removed at a regular end. The list of a
runner that was killed is read by ``--resume``: it keeps the records of these runs and sets all others aside.
"""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

from ..base.confined_paths import ConfinedPath
from ..results.provisional import list_record_files
from ..results.records import RunRecord, format_record
from ..results.store import BEGUN

LARGEST = 2**26  # [bytes] of a list, enough for a million runs
WHY = "no runner let this run begin, or it ended with another record: something else wrote its record"


class StartedRuns:
    """The list of runs that one runner has started, in the file ``.begun`` of a results folder."""

    def __init__(self, folder: Path) -> None:
        self.place = ConfinedPath(folder) / BEGUN

    def read(self) -> set[str] | None:
        """Return the run_ids on the list that a killed runner left; None if there is no list."""
        return set(self.place.read(LARGEST).decode(errors="replace").split()) if self.place.is_there() else None

    def begin(self, runs: Iterable[str]) -> None:
        """Write a new list with these run_ids."""
        self.place.write("".join(f"{run_id}\n" for run_id in sorted(runs)))

    def add(self, run_id: str) -> None:
        """Add a run that begins to the list on disk; if it cannot be written, the run is missing there and goes on."""
        with contextlib.suppress(OSError), self.place.open_file(os.O_WRONLY | os.O_APPEND) as file:
            file.write(f"{run_id}\n".encode())
            file.flush()
            os.fsync(file.fileno())

    def end(self) -> None:
        """Remove the list, as at a regular end."""
        with contextlib.suppress(OSError):
            self.place.remove_file(missing_ok=True)


def is_as_expected(found: RunRecord, expected: RunRecord | None) -> bool:
    """Return whether the record ``found`` on disk equals the one that the supervisor reported or that existed before.

    That one is ``expected``; False if there is none.
    """
    return expected is not None and format_record(found) == format_record(expected)


def list_foreign_files(folder: Path, records: Iterable[RunRecord]) -> list[dict[Path, str]]:
    """Return, for each of these records, which no runner's run wrote, its files with that reason for setting aside."""
    return [list_record_files(folder, r, WHY) for r in records]
