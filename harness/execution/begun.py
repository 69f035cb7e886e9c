"""The runs that a runner has let begin, on disk while it works: a record of any other run was made by somebody else.

``.begun`` lists the runs that had results before, then each that begins. An orderly end removes it. The list of a
runner that was killed is read by ``--resume``: it keeps the records of these runs and sets all others aside.
"""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

from ..places import Place
from ..results.provisional import files_of
from ..results.records import RunRecord, to_json
from ..results.store import BEGUN, Unreadable

LARGEST = 2**26  # [bytes] of a list: a million runs
WHY = "no runner let this run begin, or it ended with another record: something else wrote its record"


class Begun:
    """The list of one runner."""

    def __init__(self, folder: Path) -> None:
        self.place = Place(folder) / BEGUN

    def read(self) -> set[str] | None:
        """Return the runs on the list that a killed runner left; None where there is no list."""
        return set(self.place.read(LARGEST).decode(errors="replace").split()) if self.place.is_there() else None

    def begin(self, runs: Iterable[str]) -> None:
        """Write a new list of ``runs``."""
        self.place.write("".join(f"{run_id}\n" for run_id in sorted(runs)))

    def add(self, run_id: str) -> None:
        """Note that a run begins; a disk that is full costs the note alone."""
        with contextlib.suppress(OSError), self.place.open_file(os.O_WRONLY | os.O_APPEND) as file:
            file.write(f"{run_id}\n".encode())
            file.flush()
            os.fsync(file.fileno())

    def end(self) -> None:
        """Remove the list."""
        with contextlib.suppress(OSError):
            self.place.remove_file(missing_ok=True)


def is_same(found: RunRecord, promised: RunRecord | None) -> bool:
    """Whether a record is the one of which the supervisor told, or that was there before."""
    return promised is not None and to_json(found) == to_json(promised)


def list_foreign(folder: Path, records: Iterable[RunRecord]) -> list[list[Unreadable]]:
    """List the files of each record that something else wrote."""
    return [files_of(folder, r, WHY) for r in records]
