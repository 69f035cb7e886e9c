"""A results folder on disk: records written whole or not at all, read with suspicion, never deleted.

``runs/<run>.json`` is the truth, one file a finished run; ``runs.parquet`` is made from them. What each file
holds: ``docs/results-format.md``.
"""

import contextlib
import fcntl
import hashlib
import itertools
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from .. import files
from ..files import FileError
from ..places import PARTIAL, NotOwn, Place, place_of
from ..shapes import Shape, convert_shape
from ..text import printable
from ..types import Status
from .records import COLUMNS, SCHEMA, RunRecord, from_json, to_json
from .series import Series, read_series
from .stamps import find_changed

if TYPE_CHECKING:
    import pandas as pd  # imported late: a run's process stores its record and needs no tables

LARGEST = 2**22  # [bytes] of a record's file: a hundred times the longest
NATIVE = 2**20  # [bytes] of a standard error, which runs leave trimmed
LOCAL = Path("results") / "local"
PARTS = ("runs", "series", "stderr")
BEGUN = ".begun"  # runs that a runner let begin (``execution.begun``)
LOCK = ".lock"  # held by the one command that makes runs
OTHERS = (
    LOCK, ".spool", BEGUN, "environment.json", "judgement", "report", "runs.parquet", "set_aside", "shadows.json",
    "suite.toml",
)  # fmt: skip
IN_PART = {part: re.compile(rf"{part}/[\w-][\w.-]*") for part in ("series", "stderr")}
SCHEMA_IN_FILE = re.compile(rb'\\"schema\\": (\d{1,9})\b')  # of a record inside its file


class RecordFile(Shape, frozen=True):
    """The content of ``runs/<run_id>.json``: the text of the record and its digest."""

    sha256: str
    record: str


@dataclass(frozen=True)
class Unreadable:
    """A file that is not what its name says."""

    path: Path
    why: str


@dataclass(frozen=True)
class Loaded:
    """The content of a results folder: good records, and files that could not be read."""

    records: tuple[RunRecord, ...]
    unreadable: tuple[Unreadable, ...]


def is_results(folder: Path) -> bool:
    """Whether ``folder`` holds results that this version reads."""
    return (Place(folder) / "runs").kind() == "a folder" and not older_schema(folder)


def older_schema(folder: Path) -> int:
    """The schema of results of an older version, else 0. Runs of schema 1 were called cells."""
    runs = Place(folder) / "runs"
    if not runs.is_folder():
        return int((Place(folder) / "cells").is_folder())
    for name, content in runs.contents(LARGEST):
        if isinstance(content, bytes) and name.endswith(".json") and (found := SCHEMA_IN_FILE.search(content)):
            return int(found[1]) if int(found[1]) < SCHEMA else 0
    return 0


def refuse_older(folder: Path) -> None:
    """FileError for results of an older version."""
    if schema := older_schema(folder):
        suite = Place(folder) / "suite.toml"
        again = f"run the suite again: mbsbench run {suite}" if suite.is_own_file() else "run its suite again"
        raise FileError(f"{folder} holds results of an older version (schema {schema}); {again}")


def refuse_links(folder: Path) -> None:
    """NotOwn for a folder of which a part is a link or the like, before anything is read or written."""
    for name in (*PARTS, *OTHERS):
        (Place(folder) / name).is_there()


def create(folder: Path) -> Path:
    """Make the folder and its parts (an existing one is kept as it is)."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        refuse_older(folder)
        refuse_links(folder)
        for part in PARTS:
            (Place(folder) / part).make()
        (Place(folder) / ".writable").write("")
        (Place(folder) / ".writable").remove_file()
    except NotOwn:
        raise
    except OSError as error:
        raise FileError(f"cannot write results to {folder}: {error.strerror or error}") from None
    return folder


def lock(folder: Path) -> BinaryIO:
    """Hold the folder for one runner; the lock goes with the returned file or the process."""
    try:
        file = (Place(folder) / LOCK).open_file(os.O_RDWR | os.O_CREAT)
    except OSError as error:
        raise FileError(f"cannot lock {folder} by its file {LOCK}: {error.strerror or error}") from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise FileError(f"another runner is writing to {folder}; wait for it or give another --out") from None
    return file


@contextlib.contextmanager
def in_use(folder: Path, *, alone: bool = False) -> Iterator[None]:
    """Hold the folder itself, beside other commands that add pages and verdicts to it, or ``alone``: to remove it.

    OSError if it is not to be had alone; a folder that cannot be held beside others is used as it is.
    """
    with contextlib.ExitStack() as held:
        with contextlib.nullcontext() if alone else contextlib.suppress(OSError):
            descriptor = held.enter_context(Place(folder).open_folder())
            fcntl.flock(descriptor, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        yield


def remove_partial(folder: Path) -> None:
    """Delete partial files of killed processes. Call with the lock held."""
    for part in (Place(folder), *(Place(folder) / name for name in PARTS)):
        for name in filter(PARTIAL.fullmatch, part.names()):
            (part / name).remove_file()


def path_of(folder: Path, run_id: str) -> Place:
    """The file of a run's record."""
    return Place(folder) / "runs" / f"{run_id}.json"


def write_record(folder: Path, record: RunRecord) -> Path:
    """Store one finished run."""
    body = to_json(record)
    place = path_of(folder, record.run_id)
    place.write(files.to_json({"sha256": _digest(body), "record": body}))
    return place.path


def digest_of(record: RunRecord) -> str:
    """Return the digest that stands in the file of a record."""
    return _digest(to_json(record))


def read_record(path: Path | Place) -> RunRecord:
    """The record in ``path``, or FileError; its file name must be its content address."""
    place = place_of(path)
    try:
        return record_in(place.name, place.read(LARGEST))
    except OSError as error:
        raise FileError(f"cannot read record {place}: {error.strerror or error}") from None


def record_in(name: str, text: bytes) -> RunRecord:
    """The record that the file ``name`` holds, or FileError."""
    outer = convert_shape(files.parse_json(text, "record file"), RecordFile, "record file")
    if _digest(outer.record) != outer.sha256:
        raise FileError("its digest does not match: truncated or changed")
    record = from_json(outer.record)
    if f"{record.run_id}.json" != name:
        raise FileError(f"it is the record of run {record.run_id}")
    for column in ("series", "stderr"):  # a name in its part of this folder, and no way out of it
        if (place := getattr(record, column)) and not IN_PART[column].fullmatch(place):
            raise FileError(f"column {column} must be a file in {column}/ (got {place[:80]!r})")
    return record


def admit(folder: Path, run_id: str) -> None:
    """Note a record that a command adds to a folder whose runner was killed: else ``--resume`` sets it aside."""
    listed = Place(folder) / BEGUN
    if listed.is_there():
        with contextlib.suppress(OSError), listed.open_file(os.O_WRONLY | os.O_APPEND) as file:
            file.write(f"{run_id}\n".encode())


def native_of(folder: Path, record: RunRecord) -> str:
    """The standard error of a run as it can be printed; why it cannot be read, or empty if there is none."""
    if not record.stderr:
        return ""
    try:
        text = (Place(folder) / record.stderr).read(NATIVE).decode(errors="replace")
    except OSError as error:
        return f"({record.stderr} cannot be read: {error.strerror or error})"
    return printable(text)


def load(folder: Path, *, check_series: bool = True) -> Loaded:
    """All good records, in order of case; a record whose series file is damaged is not good. Nothing is changed."""
    refuse_links(folder)
    refuse_older(folder)
    runs = Place(folder) / "runs"
    if not runs.is_folder():
        raise FileError(f"{folder} holds no results (it has no runs/)")
    good, bad = [], [Unreadable(*changed) for changed in find_changed(folder)]
    for name, content in runs.contents(LARGEST):
        place = runs / name
        try:
            if isinstance(content, OSError):
                raise FileError(f"cannot read record {place}: {content.strerror or content}")
            record = record_in(name, content)
        except FileError as error:
            bad.append(Unreadable(place.path, str(error)))
            continue
        try:
            if check_series and record.series:
                read_series(Place(folder) / record.series, record.series_sha256)
            good.append(record)
        except FileError as error:
            bad.append(Unreadable(place.path, f"its series file {record.series}: {error}"))
            if (Place(folder) / record.series).kind():
                bad.append(Unreadable(folder / record.series, str(error)))
    return Loaded(tuple(sorted(good, key=lambda r: (r.problem, r.solver, r.case))), tuple(bad))


def newest(records: Iterable[RunRecord]) -> tuple[RunRecord, ...]:
    """The last record of each run: a resumed folder may hold records of older code."""
    found: dict[str, RunRecord] = {}
    for r in records:
        if r.settings_id not in found or end_key(r) > end_key(found[r.settings_id]):
            found[r.settings_id] = r
    return tuple(found.values())


def end_key(record: RunRecord) -> tuple[str, bool]:
    """When a run ended, to sort by; of two at the same time a success is the earlier and cannot hide the other."""
    return record.finished, record.status != Status.SUCCESS


def set_aside(folder: Path, unreadable: Iterable[Unreadable]) -> None:
    """Move what could not be read to ``set_aside/``, with a note that says why, a line a file; nothing is deleted."""
    items, aside = list(unreadable), Place(folder) / "set_aside"
    if not items:
        return
    aside.make()
    taken, lines = set(aside.names()), []
    for item in items:
        name = _free_name(item.path.name, taken)
        (Place(folder) / item.path.relative_to(folder).as_posix()).move_to(aside / name)
        lines.append(f"{name}: {item.why}\n")
    (aside / _free_name("why.txt", taken)).write("".join(lines))


def _free_name(name: str, taken: set[str]) -> str:
    """``name``, or with the first number that is not ``taken``, which it is then."""
    numbered = itertools.chain([name], (f"{name}.{n}" for n in itertools.count(1)))
    free = next(n for n in numbered if n not in taken)
    taken.add(free)
    return free


def series_of(folder: Path, record: RunRecord, *, poses: bool = True) -> Series | None:
    """The series of a run, checked against its record; None for a run that has none."""
    return read_series(Place(folder) / record.series, record.series_sha256, poses=poses) if record.series else None


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
    place = Place(folder) / "runs.parquet"
    with place.whole() as file:
        frame.to_parquet(file, index=False)
    return place.path


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
