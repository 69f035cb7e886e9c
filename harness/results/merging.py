"""Merge the results folders of shards: every good record with its files; the sources are not changed."""

import contextlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..base.confined_paths import ConfinedPath, UnsafeFile
from ..base.files import FileError
from . import store
from .column_digests import add_column_digests, find_faults, read_stored_digests
from .comparison import compare
from .provenance import describe_differences, find_differences, read_environment
from .records import RunRecord
from .series import LARGEST

# further stamps of a results folder, each named after its time or its environment
STAMP = re.compile(r"environment\..*\.json")


@dataclass(frozen=True)
class MergeOutcome:
    """The outcome of merging results folders."""

    records: tuple[RunRecord, ...]
    added: int
    unreadable: Mapping[Path, str]
    conflicts: tuple[str, ...]  # runs whose numbers differ between folders; the first is kept
    codes: tuple[str, ...]  # digests of code, for problems and solvers with runs of several


def merge(out: Path, sources: Sequence[Path]) -> MergeOutcome:
    """Copy the records of the folders ``sources`` that ``out`` does not have yet, each after its series and stderr.

    Stamps, suites and column digests are copied too, and the table of ``out`` is written anew. A record that both have
    but with other numbers is reported as a conflict; that of ``out``, or of the earlier source, is kept. Damaged files
    are reported; one of ``out`` that is written anew is moved to its ``set_aside/`` first. Raise FileError where
    ``out`` is one of the sources.
    """
    found = [store.load(source) for source in sources]  # before anything is written
    if any(source.resolve() == out.resolve() for source in sources):
        raise FileError(f"{out} is one of the folders to be merged into it")
    store.create_folder(out)
    with store.lock_folder(out):
        there = store.load(out)
        kept = {r.run_id: r for r in there.records}
        origin = dict.fromkeys(kept, out)
        unreadable, conflicts, added = {**there.unreadable, **find_faults(out)}, [], 0
        for source, loaded in zip(sources, found, strict=True):
            unreadable |= loaded.unreadable
            for record in loaded.records:
                if record.run_id in kept:
                    if not compare([kept[record.run_id]], [record]).is_identical:
                        causes = find_differences(read_environment(origin[record.run_id]), read_environment(source))
                        conflicts.append(f"{record.case} ({source}; possible causes: {describe_differences(causes)})")
                    continue
                for file in filter(None, (record.series, record.stderr)):
                    _copy(source, file, out)
                store.list_as_started(out, record.run_id)
                store.write_record(out, record)
                kept[record.run_id], origin[record.run_id] = record, source
                added += 1
            _copy_environment(source, out)
            unreadable |= find_faults(source)
            add_column_digests(out, *read_stored_digests(source).values())
        store.write_table(out, store.load(out, check_series=False).records)
    records = tuple(sorted(kept.values(), key=lambda r: (r.problem, r.solver, r.case)))
    return MergeOutcome(records, added, unreadable, tuple(conflicts), find_mixed_codes(records))


def find_mixed_codes(records: Sequence[RunRecord]) -> tuple[str, ...]:
    """Return the sorted code digests of all problem-solver pairs whose records come from more than one code.

    The digests of the measuring code are added if the records differ in it. Empty if nothing is mixed.
    """
    found = dict[tuple[str, str], set[str]]()
    for r in records:
        found.setdefault((r.problem, r.solver), set()).add(r.code)
    found["", ""] = {r.measured_by for r in records}  # a key that no problem-solver pair has
    return tuple(sorted(set().union(*(codes for codes in found.values() if len(codes) > 1)) - {""}))


def _copy_environment(source: Path, out: Path) -> None:
    """Copy stamp and suite of ``source`` to ``out`` unless it has them, and the further stamps that it lacks.

    A stamp other than that of ``out`` is copied as well, under the name of the source folder.
    """
    for name in ("environment.json", "suite.toml"):
        if not (ConfinedPath(out) / name).is_there():
            _copy(source, name, out)
    stamp, own = (ConfinedPath(folder) / "environment.json" for folder in (source, out))
    if stamp.is_own_file() and own.is_own_file() and stamp.read(LARGEST) != own.read(LARGEST):
        _copy(source, stamp.name, out, f"environment.{source.resolve().name}.json")
    for name in filter(STAMP.fullmatch, ConfinedPath(source).names()):
        if not (ConfinedPath(out) / name).is_there():
            _copy(source, name, out)


def _copy(source: Path, name: str, out: Path, renamed: str = "") -> None:
    """Copy the file ``name`` atomically, as ``renamed`` if given; ignore a missing file, such as a deleted stderr."""
    with contextlib.suppress(FileNotFoundError, UnsafeFile):
        content = (ConfinedPath(source) / name).read(LARGEST)
        (ConfinedPath(out) / (renamed or name)).write(content)
