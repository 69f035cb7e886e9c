"""A results folder on disk: records written whole or not at all, read with suspicion, never deleted.

``runs/<run>.json`` is the truth, one file a finished run; ``runs.parquet`` is made from them. What each file
holds: ``docs/results-format.md``.
"""

import contextlib
import fcntl
import hashlib
import os
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from .. import files
from ..files import write_text
from ..shapes import Shape, shaped
from .records import COLUMNS, SCHEMA, BadRecord, RunRecord, from_json, to_json
from .series import BadSeries, Series, read_series

if TYPE_CHECKING:
    import pandas as pd  # imported late: a run's process stores its record and needs no tables

LARGEST = 2**22  # [bytes] of a record's file: a hundred times the longest
NATIVE = 2**20  # [bytes] of a standard error, which runs leave trimmed
LOCAL = Path("results") / "local"
PARTS = ("runs", "series", "stderr")
IN_PART = {part: re.compile(rf"{part}/[\w-][\w.-]*") for part in ("series", "stderr")}
SCHEMA_IN_FILE = re.compile(rb'\\"schema\\": (\d{1,9})\b')  # of a record inside its file


class StoreError(files.FileError):
    """A folder that cannot be used; the message says what to do."""


class RecordFile(Shape, frozen=True):
    """What ``runs/<run_id>.json`` holds: the text of the record and its digest."""

    sha256: str
    record: str


@dataclass(frozen=True)
class Unreadable:
    """A file that is not what its name says."""

    path: Path
    why: str


@dataclass(frozen=True)
class Loaded:
    """What a results folder holds: the good records by run, and what could not be read."""

    records: tuple[RunRecord, ...]
    unreadable: tuple[Unreadable, ...]


def is_results(folder: Path) -> bool:
    """Whether ``folder`` holds results that this version reads."""
    return (folder / "runs").is_dir() and not older(folder)


def older(folder: Path) -> int:
    """The schema of results of an older version, else 0. Runs of schema 1 were called cells."""
    if not (folder / "runs").is_dir():
        return int((folder / "cells").is_dir())
    for path in sorted((folder / "runs").glob("*.json")):
        with contextlib.suppress(OSError):
            if found := SCHEMA_IN_FILE.search(files.read_own(path, LARGEST)):
                return int(found[1]) if int(found[1]) < SCHEMA else 0
    return 0


def refuse_older(folder: Path) -> None:
    """StoreError for results of an older version."""
    if schema := older(folder):
        suite = folder / "suite.toml"
        again = f"run the suite again: mbsbench run {suite}" if suite.is_file() else "run its suite again"
        raise StoreError(f"{folder} holds results of an older version (schema {schema}); {again}")


def refuse_links(folder: Path) -> None:
    """StoreError for a folder whose parts are elsewhere: files would be read and written there."""
    for part in PARTS:
        if (folder / part).is_symlink():
            raise StoreError(f"{folder / part} is a link; a results folder holds its own files")


def create(folder: Path) -> Path:
    """Make the folder and its parts (an existing one is kept as it is)."""
    refuse_older(folder)
    refuse_links(folder)
    try:
        for part in PARTS:
            (folder / part).mkdir(parents=True, exist_ok=True)
        write_text(folder / ".writable", "")
        (folder / ".writable").unlink()
    except OSError as error:
        raise StoreError(f"cannot write results to {folder}: {error.strerror or error}") from None
    return folder


def lock(folder: Path) -> IO[bytes]:
    """Hold the folder for one runner; the lock goes with the returned file or the process."""
    try:
        file = files.open_own(folder / ".lock", os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise StoreError(f"cannot lock {folder} by its file .lock: {error.strerror or error}") from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise StoreError(f"another runner is writing to {folder}; wait for it or give another --out") from None
    return file


def remove_partial(folder: Path) -> None:
    """What killed processes left half-written; for who holds the lock: nobody writes."""
    for part in (".", *PARTS):
        for path in (folder / part).iterdir():
            if files.PARTIAL.fullmatch(path.name):
                path.unlink()


def path_of(folder: Path, run_id: str) -> Path:
    """The file of a run's record."""
    return folder / "runs" / f"{run_id}.json"


def write_record(folder: Path, record: RunRecord) -> Path:
    """Store one finished run."""
    body = to_json(record)
    path = path_of(folder, record.run_id)
    write_text(path, files.to_json({"sha256": _digest(body), "record": body}))
    return path


def read_record(path: Path) -> RunRecord:
    """The record in ``path``, or BadRecord; its file name must be its content address."""
    try:
        text = files.read_own(path, LARGEST)
    except OSError as error:
        raise BadRecord(f"cannot read record {path}: {error.strerror or error}") from None
    outer = shaped(files.parse_json(text, "record file", BadRecord), RecordFile, "record file", BadRecord)
    if _digest(outer.record) != outer.sha256:
        raise BadRecord("its digest does not match: truncated or changed")
    record = from_json(outer.record)
    if record.run_id != path.stem:
        raise BadRecord(f"it is the record of run {record.run_id}")
    for column in ("series", "stderr"):  # a name in its part of this folder, and no way out of it
        if (place := getattr(record, column)) and not IN_PART[column].fullmatch(place):
            raise BadRecord(f"column {column} must be a file in {column}/ (got {place[:80]!r})")
    return record


def is_there(folder: Path, promised: RunRecord, found: RunRecord | None) -> bool:
    """Whether a record that was written is still the one on disk, with its series."""
    return (
        found is not None and to_json(found) == to_json(promised)
        and (not found.series or (folder / found.series).is_file())
    )  # fmt: skip


def native_of(folder: Path, record: RunRecord) -> str:
    """The standard error of a run as it can be printed; why it cannot be read, or empty if there is none."""
    if not record.stderr:
        return ""
    try:
        text = files.read_own(folder / record.stderr, NATIVE).decode(errors="replace")
    except OSError as error:
        return f"({record.stderr} cannot be read: {error.strerror or error})"
    return files.printable(text)


def load(folder: Path, *, check_series: bool = True) -> Loaded:
    """All good records, in order of case; a record whose series file is damaged is not good. Nothing is changed."""
    refuse_older(folder)
    if not is_results(folder):
        raise StoreError(f"{folder} holds no results (it has no runs/)")
    refuse_links(folder)
    good, bad = [], []
    for path in sorted((folder / "runs").iterdir()):
        if path.name.startswith("."):
            continue
        try:
            record = read_record(path)
            if check_series and record.series:
                read_series(folder / record.series, record.series_sha256)
            good.append(record)
        except BadRecord as error:
            bad.append(Unreadable(path, str(error)))
        except BadSeries as error:
            bad.append(Unreadable(path, f"its series file {record.series}: {error}"))
            if os.path.lexists(folder / record.series):
                bad.append(Unreadable(folder / record.series, str(error)))
    return Loaded(tuple(sorted(good, key=lambda r: (r.problem, r.solver, r.case))), tuple(bad))


def newest(records: Iterable[RunRecord]) -> tuple[RunRecord, ...]:
    """Of records with the same settings the one that ended last: a resumed folder may hold those of older code."""
    found: dict[str, RunRecord] = {}
    for r in records:
        if r.settings_id not in found or r.finished > found[r.settings_id].finished:
            found[r.settings_id] = r
    return tuple(found.values())


def set_aside(folder: Path, unreadable: Iterable[Unreadable]) -> None:
    """Move what could not be read to ``set_aside/``, each with a note why; nothing is deleted."""
    for item in unreadable:
        aside = folder / "set_aside"
        aside.mkdir(exist_ok=True)
        target, n = aside / item.path.name, 0
        while os.path.lexists(target):
            n += 1
            target = aside / f"{item.path.name}.{n}"
        shutil.move(item.path, target)
        write_text(target.with_name(target.name + ".why"), item.why + "\n")


def series_of(folder: Path, record: RunRecord, *, poses: bool = True) -> Series | None:
    """The series of a run, checked against its record; None for a run that has none."""
    return read_series(folder / record.series, record.series_sha256, poses=poses) if record.series else None


def table(records: Iterable[RunRecord]) -> "pd.DataFrame":
    """One row a run, the columns of ``RunRecord`` with their types, even when there is no row."""
    import pandas as pd

    rows = [[getattr(r, c.name) for c in COLUMNS] for r in records]
    types: dict[Any, str] = {c.name: {int: "int64", float: "float64", str: "object"}[c.type] for c in COLUMNS}  # type: ignore[index]
    return pd.DataFrame(rows, columns=[c.name for c in COLUMNS]).astype(types)


def write_table(folder: Path, records: Iterable[RunRecord]) -> Path:
    """``runs.parquet``, replaced whole."""
    frame = table(records)
    frame.attrs["schema"] = SCHEMA
    path = folder / "runs.parquet"
    with files.whole(path) as partial:
        frame.to_parquet(partial, index=False)
    return path


def point_latest(folder: Path) -> None:
    """Let ``latest`` beside ``folder`` point to it."""
    link = folder.parent / "latest"
    if link.exists() and not link.is_symlink():
        return  # somebody's own folder of that name: leave it
    partial = folder.parent / f".latest.{os.getpid()}"
    partial.symlink_to(folder.name)
    os.replace(partial, link)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
