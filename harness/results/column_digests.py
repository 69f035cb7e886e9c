"""Store beside results which code measured them: the digests of their columns, by what the column measured_by holds.

A record names the state of the code that measured it by one digest. ``columns.json`` has the parts of each such state,
so that a change of one column leaves the others of old records current, and a column that is added leaves all.
"""

from collections.abc import Mapping
from pathlib import Path

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError, parse_json, read_text, to_json
from ..base.shapes import convert_shape
from ..columns.digests import ColumnDigests
from .records import RunRecord

FILE = "columns.json"


def read_column_digests(folder: Path) -> dict[str, ColumnDigests]:
    """Return the states of the code that measured the runs of a folder, by their digests.

    Entries that are invalid, or filed under another digest than their own, are left out.
    """
    place = ConfinedPath(folder) / FILE
    try:
        found = parse_json(read_text(place, "the digests of columns"), FILE) if place.is_there() else {}
        states = convert_shape(found, dict[str, ColumnDigests], FILE)
    except FileError:
        return {}
    return {digest: state for digest, state in states.items() if state.digest == digest}


def add_column_digests(folder: Path, *states: ColumnDigests) -> None:
    """Add states of the code that measures to the file of a folder; call with the folder's lock held."""
    known = read_column_digests(folder)
    new = {state.digest: state for state in states}
    if not new.keys() <= known.keys():
        (ConfinedPath(folder) / FILE).write(f"{to_json(known | new)}\n")


def find_stale_columns(record: RunRecord, known: Mapping[str, ColumnDigests], now: ColumnDigests) -> tuple[str, ...]:
    """Return the columns of a record that the present code ``now`` would measure in another way; empty if none.

    ``known`` are the states of the code in the record's folder; of an unknown one all columns may be stale. Columns
    that are newer than the record are not among them. A record older than the column ``measured_by`` has this digest in
    its ``code``.
    """
    if record.measured_by in ("", now.digest):
        return ()
    then = known.get(record.measured_by)
    return tuple(now.columns) if then is None else then.list_stale(now)
