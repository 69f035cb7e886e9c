"""Run folders of shards become one: every good record with its files, nothing of a source changed."""

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..files import FileError
from ..places import NotOwn, Place
from . import store
from .comparison import compare
from .provenance import describe_differences, find_differences, stamp_of
from .records import RunRecord
from .series import LARGEST

STAMP = re.compile(r"environment\..*\.json")


@dataclass(frozen=True)
class Merged:
    """The outcome of merging."""

    records: tuple[RunRecord, ...]
    added: int
    unreadable: tuple[store.Unreadable, ...]
    conflicts: tuple[str, ...]  # runs that two folders have with other numbers; the first is kept
    codes: tuple[str, ...]  # digests of the code of those problems and solvers whose runs are not all of one


def merge(out: Path, sources: Sequence[Path]) -> Merged:
    """Copy the records of ``sources`` that ``out`` does not have yet; a record is written after its files."""
    found = [store.load(source) for source in sources]  # before anything is written
    if any(source.resolve() == out.resolve() for source in sources):
        raise FileError(f"{out} is one of the folders to be merged into it")
    store.create(out)
    with store.lock(out):
        there = store.load(out)
        kept = {r.run_id: r for r in there.records}
        origin = dict.fromkeys(kept, out)
        unreadable, conflicts, added = list(there.unreadable), [], 0
        for source, loaded in zip(sources, found, strict=True):
            unreadable += loaded.unreadable
            for record in loaded.records:
                if record.run_id in kept:
                    if not compare([kept[record.run_id]], [record]).same:
                        causes = find_differences(stamp_of(origin[record.run_id]), stamp_of(source))
                        conflicts.append(f"{record.case} ({source}; possible causes: {describe_differences(causes)})")
                    continue
                for file in filter(None, (record.series, record.stderr)):
                    _copy(source, file, out)
                store.admit(out, record.run_id)
                store.write_record(out, record)
                kept[record.run_id], origin[record.run_id] = record, source
                added += 1
            _copy_environment(source, out)
        store.write_table(out, store.load(out, check_series=False).records)
    records = tuple(sorted(kept.values(), key=lambda r: (r.problem, r.solver, r.case)))
    return Merged(records, added, tuple(unreadable), tuple(conflicts), find_codes(records))


def find_codes(records: Sequence[RunRecord]) -> tuple[str, ...]:
    """Return the digests, sorted, of the code of each problem with each solver whose runs are of more than one."""
    found = dict[tuple[str, str], set[str]]()
    for r in records:
        found.setdefault((r.problem, r.solver), set()).add(r.code)
    return tuple(sorted(set().union(*(codes for codes in found.values() if len(codes) > 1))))


def _copy_environment(source: Path, out: Path) -> None:
    """The first source's stamp and suite become those of ``out``; further stamps are kept beside it."""
    for name in ("environment.json", "suite.toml"):
        if not (Place(out) / name).is_there():
            _copy(source, name, out)
    stamp, own = (Place(folder) / "environment.json" for folder in (source, out))
    if stamp.is_own_file() and own.is_own_file() and stamp.read(LARGEST) != own.read(LARGEST):
        _copy(source, stamp.name, out, f"environment.{source.resolve().name}.json")
    for name in filter(STAMP.fullmatch, Place(source).names()):
        if not (Place(out) / name).is_there():
            _copy(source, name, out)


def _copy(source: Path, name: str, out: Path, renamed: str = "") -> None:
    """Whole or not at all; a file that is gone (a stderr somebody deleted) is no reason to lose a record."""
    with contextlib.suppress(FileNotFoundError, NotOwn):
        content = (Place(source) / name).read(LARGEST)
        (Place(out) / (renamed or name)).write(content)
