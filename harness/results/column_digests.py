"""Store beside results which code measured them: the digests of their columns, by what the column measured_by holds.

A record names the state of the code that measured it by one digest. ``columns.json`` has the parts of each such state,
so that a change of one column leaves the others of old records current, and a column that is added leaves all.
"""

from collections.abc import Mapping
from pathlib import Path

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError, parse_json, read_text, to_json
from ..base.hints import format_value
from ..base.shapes import convert_shape
from ..columns.digests import ColumnDigests
from .records import RunRecord
from .store import set_aside

FILE = "columns.json"


def read_stored_digests(folder: Path) -> dict[str, ColumnDigests]:
    """Return the states of the code that measured the runs of a folder, by their digests; empty without a file.

    An entry that is invalid, or stored under another digest than its own, is left out, and so is a file that is no
    table of entries: runs measured by those states count as measured by unknown code. ``find_faults`` reports it.
    """
    states, _ = _read(folder)
    return states


def find_faults(folder: Path) -> dict[Path, str]:
    """Return the path of the file with the first reason why ``read_stored_digests`` leaves out something, or {}."""
    _, faults = _read(folder)
    return faults


def add_column_digests(folder: Path, *states: ColumnDigests) -> dict[Path, str]:
    """Add ``states`` of the measuring code to the file of a folder; call with the folder's lock held.

    The file is left alone if it has them all. Otherwise it is written anew with its valid entries; if it has invalid
    ones, it is moved to ``set_aside/`` first, so that nothing is lost. Return what was set aside, with the reason.
    """
    known, faults = _read(folder)
    new = {state.digest: state for state in states}
    if new.keys() <= known.keys():
        return {}
    set_aside(folder, faults)
    (ConfinedPath(folder) / FILE).write(f"{to_json(known | new)}\n")
    return faults


def _read(folder: Path) -> tuple[dict[str, ColumnDigests], dict[Path, str]]:
    """Return the valid entries of a folder's file, and the file with the reason of its first fault, if it has one.

    Each entry is converted by itself, so that a fault in one leaves the others.
    """
    place = ConfinedPath(folder) / FILE
    if not place.is_there():
        return {}, {}
    try:
        entries = parse_json(read_text(place, "the digests of columns"), FILE)
        if not isinstance(entries, dict):
            raise FileError(f"{FILE}: must be a table of digests")
    except FileError as error:
        return {}, {place.path: str(error)}
    states, reasons = dict[str, ColumnDigests](), list[str]()
    for digest, entry in entries.items():
        where = f"{FILE}: {format_value(digest)}"
        try:
            state = convert_shape(entry, ColumnDigests, where)
        except FileError as error:
            reasons.append(str(error))
            continue
        if state.digest == digest:
            states[digest] = state
        else:
            reasons.append(f"{where}: the digest of this entry is {state.digest}")
    return states, {place.path: reasons[0]} if reasons else {}


def find_stale_columns(record: RunRecord, known: Mapping[str, ColumnDigests], now: ColumnDigests) -> tuple[str, ...]:
    """Return the columns of a record that the present code ``now`` would measure in another way; empty if none.

    ``known`` are the states of the code in the record's folder, by digest. If the record's own is not among them, all
    columns are returned. Columns that are newer than the record never are, and a record older than the column
    ``measured_by`` has no stale columns, since its ``code`` covers the measuring too.
    """
    if record.measured_by in ("", now.digest):
        return ()
    then = known.get(record.measured_by)
    return tuple(now.columns) if then is None else then.list_stale(now)
