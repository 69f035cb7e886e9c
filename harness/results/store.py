"""Store results in a folder: records are written atomically, validated when read, and never deleted.

``runs/<run>.json`` is the truth, one file per finished run; ``runs.parquet`` is derived. The contents of each file are
described in ``docs/results-format.md``.
"""

import contextlib
import fcntl
import hashlib
import itertools
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from ..base import files
from ..base.confined_paths import PARTIAL, ConfinedPath, UnsafeFile, confine_path
from ..base.files import FileError
from ..base.shapes import Shape, convert_shape
from ..base.text import escape_text
from ..mechanics.types import Status
from .records import COLUMNS, SCHEMA, RunRecord, format_record, parse_record_json
from .series import Series, read_series
from .stamps import find_changed

if TYPE_CHECKING:
    import pandas as pd  # imported late: a run's process stores its record and needs no tables

LARGEST = 2**22  # [bytes] of a record's file: a hundred times the largest one
NATIVE = 2**20  # [bytes] of a standard error, which runs trim
LOCAL = Path("results") / "local"
PARTS = ("runs", "series", "stderr")
BEGUN = ".begun"  # runs that a runner started (``run.started_runs``)
LOCK = ".lock"  # locked by the one command that makes runs
OTHERS = (  # further files and folders of a results folder
    LOCK,
    ".spool",
    BEGUN,
    "columns.json",
    "environment.json",
    "judgement",
    "report",
    "runs.parquet",
    "set_aside",
    "shadows.json",
    "suite.toml",
)
# paths that a record may name: files directly in their part of the results folder
IN_PART = {part: re.compile(rf"{part}/[\w-][\w.-]*") for part in ("series", "stderr")}
SCHEMA_IN_FILE = re.compile(rb'\\"schema\\": (\d{1,9})\b')  # schema of a record inside its file


class RecordFile(Shape, frozen=True):
    """The content of ``runs/<run_id>.json``: the text of the record and its digest."""

    sha256: str
    record: str


@dataclass(frozen=True)
class LoadedResults:
    """The content of a results folder: valid records, and files that are invalid or foreign, with the reason."""

    records: tuple[RunRecord, ...]
    unreadable: Mapping[Path, str]


def is_results(folder: Path) -> bool:
    """Return whether ``folder`` holds results in the format of this version."""
    return (ConfinedPath(folder) / "runs").kind() == "a folder" and not find_older_schema(folder)


def find_older_schema(folder: Path) -> int:
    """Return the schema of the results in ``folder`` if an older version wrote them; else, or without results, 0.

    The first record decides. Results of schema 1 are in a folder ``cells``.
    """
    runs = ConfinedPath(folder) / "runs"
    if not runs.is_folder():
        return int((ConfinedPath(folder) / "cells").is_folder())
    for name, content in runs.contents(LARGEST):
        if isinstance(content, bytes) and name.endswith(".json") and (found := SCHEMA_IN_FILE.search(content)):
            return int(found[1]) if int(found[1]) < SCHEMA else 0
    return 0


def refuse_older(folder: Path) -> None:
    """Raise FileError if an older version wrote the results in ``folder``; the message says how to make them anew."""
    if schema := find_older_schema(folder):
        suite = ConfinedPath(folder) / "suite.toml"
        again = f"run the suite again: mbsbench run {suite}" if suite.is_own_file() else "run its suite again"
        raise FileError(f"{folder} holds results of an older version (schema {schema}); {again}")


def refuse_links(folder: Path) -> None:
    """Raise UnsafeFile if a part of the results folder is a link or a special file.

    Call it before anything is read or written.
    """
    for name in (*PARTS, *OTHERS):
        (ConfinedPath(folder) / name).is_there()


def create_folder(folder: Path) -> Path:
    """Create the results folder and its parts, and return it; an existing folder is kept.

    Raise FileError if it cannot be written to or holds results of an older version, UnsafeFile if a part is a link.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        refuse_older(folder)
        refuse_links(folder)
        for part in PARTS:
            (ConfinedPath(folder) / part).make_folder()
        (ConfinedPath(folder) / ".writable").write("")
        (ConfinedPath(folder) / ".writable").remove_file()
    except UnsafeFile:
        raise
    except OSError as error:
        raise FileError(f"cannot write results to {folder}: {error.strerror or error}") from None
    return folder


def lock_folder(folder: Path) -> BinaryIO:
    """Lock the folder for one runner and return the open lock file.

    The lock is released when the file is closed or the process ends. Raise FileError if another runner holds the lock.
    """
    try:
        file = (ConfinedPath(folder) / LOCK).open_file(os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise FileError(f"cannot lock {folder} by its file {LOCK}: {error.strerror or error}") from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise FileError(f"another runner is writing to {folder}; wait for it or give another --out") from None
    return file


@contextlib.contextmanager
def hold_folder(folder: Path, *, alone: bool = False) -> Iterator[None]:
    """Hold a lock on the folder within a ``with`` block: shared to read it or add to it, exclusive to remove it.

    ``alone`` asks for the exclusive lock; raise OSError if another command holds the folder. If a shared lock is
    impossible, the block is executed without it.
    """
    with contextlib.ExitStack() as held:
        with contextlib.nullcontext() if alone else contextlib.suppress(OSError):
            descriptor = held.enter_context(ConfinedPath(folder).open_folder())
            fcntl.flock(descriptor, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        yield


def remove_partial(folder: Path) -> None:
    """Delete partial files of killed processes; call with the lock held."""
    for part in (ConfinedPath(folder), *(ConfinedPath(folder) / name for name in PARTS)):
        for name in filter(PARTIAL.fullmatch, part.names()):
            (part / name).remove_file()


def locate_record(folder: Path, run_id: str) -> ConfinedPath:
    """Return the path of a run's record in a results folder, whether it exists or not."""
    return ConfinedPath(folder) / "runs" / f"{run_id}.json"


def write_record(folder: Path, record: RunRecord) -> Path:
    """Write the record of a finished run with its digest; return its path."""
    body = format_record(record)
    place = locate_record(folder, record.run_id)
    place.write(files.to_json({"sha256": _digest(body), "record": body}))
    return place.path


def digest_record(record: RunRecord) -> str:
    """Return the sha256 of a record's JSON text, which the file of the record contains too."""
    return _digest(format_record(record))


def read_record(path: Path | ConfinedPath) -> RunRecord:
    """Read the record in ``path``; raise FileError unless it is valid and the file is named after its run_id."""
    place = confine_path(path)
    try:
        return parse_record(place.name, place.read(LARGEST))
    except OSError as error:
        raise FileError(f"cannot read record {place}: {error.strerror or error}") from None


def parse_record(name: str, text: bytes) -> RunRecord:
    """Return the record in ``text``, the content of the file ``name``.

    Raise FileError if it is invalid, does not have its digest, has another run_id than the file's name, or names files
    outside the results folder.
    """
    outer = convert_shape(files.parse_json(text, "record file"), RecordFile, "record file")
    if _digest(outer.record) != outer.sha256:
        raise FileError("its digest does not match: truncated or changed")
    record = parse_record_json(outer.record)
    if f"{record.run_id}.json" != name:
        raise FileError(f"it is the record of run {record.run_id}")
    for column in ("series", "stderr"):  # a name in its part of this folder; a path could lead outside
        if (place := getattr(record, column)) and not IN_PART[column].fullmatch(place):
            raise FileError(f"column {column} must be a file in {column}/ (got {place[:80]!r})")
    return record


def list_as_started(folder: Path, run_id: str) -> None:
    """Add a run, whose record another command writes, to the list of started runs that a killed runner left, if any.

    Otherwise ``--resume`` would set its record aside as foreign.
    """
    listed = ConfinedPath(folder) / BEGUN
    if listed.is_there():
        with contextlib.suppress(OSError), listed.open_file(os.O_WRONLY | os.O_APPEND) as file:
            file.write(f"{run_id}\n".encode())


def read_stderr(folder: Path, record: RunRecord) -> str:
    """Return a run's standard error as printable text, or in brackets why it cannot be read; empty if there is none."""
    if not record.stderr:
        return ""
    try:
        text = (ConfinedPath(folder) / record.stderr).read(NATIVE).decode(errors="replace")
    except OSError as error:
        return f"({record.stderr} cannot be read: {error.strerror or error})"
    return escape_text(text)


def load(folder: Path, *, check_series: bool = True) -> LoadedResults:
    """Return all valid records of a results folder, in order of problem, solver and case, and list invalid files.

    Nothing is changed. A record with a damaged series file is invalid; without ``check_series`` these files are not
    read. Raise FileError if the folder holds no results, or those of an older version.
    """
    refuse_links(folder)
    refuse_older(folder)
    runs = ConfinedPath(folder) / "runs"
    if not runs.is_folder():
        raise FileError(f"{folder} holds no results (it has no runs/)")
    good, bad = [], dict(find_changed(folder))
    for name, content in runs.contents(LARGEST):
        place = runs / name
        try:
            if isinstance(content, OSError):
                raise FileError(f"cannot read record {place}: {content.strerror or content}")
            record = parse_record(name, content)
        except FileError as error:
            bad[place.path] = str(error)
            continue
        try:
            if check_series and record.series:
                read_series(ConfinedPath(folder) / record.series, record.series_sha256)
            good.append(record)
        except FileError as error:
            bad[place.path] = f"its series file {record.series}: {error}"
            if (ConfinedPath(folder) / record.series).kind():
                bad[folder / record.series] = str(error)
    return LoadedResults(tuple(sorted(good, key=lambda r: (r.problem, r.solver, r.case))), bad)


def select_newest(records: Iterable[RunRecord]) -> tuple[RunRecord, ...]:
    """Return the newest record of each ``settings_id``, as a resumed folder may hold records of older code."""
    found: dict[str, RunRecord] = {}
    for r in records:
        if r.settings_id not in found or make_end_key(r) > make_end_key(found[r.settings_id]):
            found[r.settings_id] = r
    return tuple(found.values())


def make_end_key(record: RunRecord) -> tuple[str, bool]:
    """Return a sort key that orders records by the end of their runs.

    Of two at the same time a success comes first, so that the newest one, which is kept, is the failure.
    """
    return record.finished, record.status != Status.SUCCESS


def set_aside(folder: Path, unreadable: Mapping[Path, str]) -> None:
    """Move files to ``set_aside/``, under free names, with a note that gives the reasons; nothing is deleted."""
    if not unreadable:
        return
    aside = ConfinedPath(folder) / "set_aside"
    aside.make_folder()
    taken, lines = set(aside.names()), []
    for path, why in unreadable.items():
        name = _free_name(path.name, taken)
        (ConfinedPath(folder) / path.relative_to(folder).as_posix()).move_to(aside / name)
        lines.append(f"{name}: {why}\n")
    (aside / _free_name("why.txt", taken)).write("".join(lines))


def _free_name(name: str, taken: set[str]) -> str:
    """Return ``name``, with a number appended if it is in ``taken``, and add the returned name to ``taken``."""
    numbered = itertools.chain([name], (f"{name}.{n}" for n in itertools.count(1)))
    free = next(n for n in numbered if n not in taken)
    taken.add(free)
    return free


def read_run_series(folder: Path, record: RunRecord, *, poses: bool = True) -> Series | None:
    """Return the series of a run, checked against the digest in its record; None for a run without a series file.

    Without ``poses``, those of the run and of the exact motion are not read. Raise FileError if the file is invalid.
    """
    return (
        read_series(ConfinedPath(folder) / record.series, record.series_sha256, poses=poses) if record.series else None
    )


def table(records: Iterable[RunRecord]) -> "pd.DataFrame":
    """Return a data frame with a row per record and the columns of ``RunRecord``, typed even without rows."""
    import pandas as pd

    rows = [[getattr(r, c.name) for c in COLUMNS] for r in records]
    types: dict[Any, str] = {c.name: {int: "int64", float: "float64", str: "object"}[c.type] for c in COLUMNS}  # type: ignore[index]
    return pd.DataFrame(rows, columns=[c.name for c in COLUMNS]).astype(types)


def write_table(folder: Path, records: Iterable[RunRecord]) -> Path:
    """Write the records as the table ``runs.parquet`` of the folder, atomically; return its path."""
    frame = table(records)
    frame.attrs["schema"] = SCHEMA
    place = ConfinedPath(folder) / "runs.parquet"
    with place.write_atomically() as file:
        frame.to_parquet(file, index=False)
    return place.path


def point_latest(folder: Path) -> None:
    """Make the link ``latest`` beside ``folder`` point to it, unless a file or folder that is no link has that name."""
    link = folder.parent / "latest"
    if link.exists() and not link.is_symlink():
        return  # a user's own folder of that name is left
    partial = folder.parent / f".latest.{os.getpid()}"
    partial.symlink_to(folder.name)
    os.replace(partial, link)


def _digest(text: str) -> str:
    """Return the sha256 of ``text``."""
    return hashlib.sha256(text.encode()).hexdigest()
