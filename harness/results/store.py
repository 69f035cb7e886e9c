"""A results folder on disk: records written whole or not at all, read with suspicion, never deleted.

``runs/<run>.json`` is the truth, one file a finished run; ``runs.parquet`` is made from them. What each file
holds: ``docs/results-format.md``.
"""

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

LOCAL = Path("results") / "local"
PARTS = ("runs", "series", "stderr")
SCHEMA_IN_FILE = re.compile(rb'\\"schema\\": (\d+)')  # of a record inside its file


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
    texts = (path.read_bytes() for path in sorted((folder / "runs").glob("*.json")))
    found = next((int(m[1]) for text in texts if (m := SCHEMA_IN_FILE.search(text))), SCHEMA)
    return found if found < SCHEMA else 0


def refuse_older(folder: Path) -> None:
    """StoreError for results of an older version."""
    if schema := older(folder):
        suite = folder / "suite.toml"
        again = f"run the suite again: mbsbench run {suite}" if suite.is_file() else "run its suite again"
        raise StoreError(f"{folder} holds results of an older version (schema {schema}); {again}")


def create(folder: Path) -> Path:
    """Make the folder and its parts (an existing one is kept as it is)."""
    refuse_older(folder)
    try:
        for part in PARTS:
            (folder / part).mkdir(parents=True, exist_ok=True)
        write_text(folder / ".writable", "")
        (folder / ".writable").unlink()
    except OSError as error:
        raise StoreError(f"cannot write results to {folder}: {error.strerror or error}") from None
    return folder


def lock(folder: Path) -> IO[str]:
    """Hold the folder for one runner; the lock goes with the returned file or the process."""
    file = (folder / ".lock").open("w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise StoreError(f"another runner is writing to {folder}; wait for it or give another --out") from None
    return file


def write_record(folder: Path, record: RunRecord) -> Path:
    """Store one finished run."""
    body = to_json(record)
    path = folder / "runs" / f"{record.run_id}.json"
    write_text(path, files.to_json({"sha256": _digest(body), "record": body}))
    return path


def read_record(path: Path) -> RunRecord:
    """The record in ``path``, or BadRecord; its file name must be its content address."""
    text = files.read_text(path, "record", BadRecord)
    outer = shaped(files.parse_json(text, "record file", BadRecord), RecordFile, "record file", BadRecord)
    if _digest(outer.record) != outer.sha256:
        raise BadRecord("its digest does not match: truncated or changed")
    record = from_json(outer.record)
    if record.run_id != path.stem:
        raise BadRecord(f"it is the record of run {record.run_id}")
    return record


def load(folder: Path, *, check_series: bool = True) -> Loaded:
    """All good records, in order of case; a record whose series file is damaged is not good. Nothing is changed."""
    refuse_older(folder)
    if not is_results(folder):
        raise StoreError(f"{folder} holds no results (it has no runs/)")
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
            if (folder / record.series).exists():
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
        while target.exists():
            n += 1
            target = aside / f"{item.path.name}.{n}"
        shutil.move(item.path, target)
        write_text(target.with_name(target.name + ".why"), item.why + "\n")


def series_of(folder: Path, record: RunRecord) -> Series | None:
    """The series of a run, checked against its record; None for a run that has none."""
    return read_series(folder / record.series, record.series_sha256) if record.series else None


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
