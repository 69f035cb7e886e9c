"""Runs a suite into a results folder: what is done stays done, what is damaged is set aside, the rest is run."""

import contextlib
import datetime
import json
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Protocol

from ..files import FileError
from ..places import Place
from ..results import codes, environment, stamps, store
from ..results.provisional import files_of, is_provisional
from ..results.records import RunRecord
from ..results.store import Loaded, Unreadable
from ..suites.includes import OWN_COPY
from ..suites.spec import RunSpec
from ..suites.suite import Suite
from ..types import EndedBy
from .begun import Begun, is_same, list_foreign
from .job import Job
from .pool import LocalPool, PoolError, TimeLimit


class Executor(Protocol):
    """Executes runs: ``harness.pool`` on this machine, ``harness.cluster`` on others."""

    def run(self, jobs: Sequence[Job], limit: TimeLimit | None = None) -> None:
        """Run all ``jobs``; returns when each has a record in its folder. PoolError when that cannot be.

        At the ``limit`` running runs are ended as stalled with its words, and those that have not begun are left.
        """


class Watcher(Protocol):
    """Is told about the progress of a suite."""

    def begin(self, folder: Path, total: int, waiting: Sequence[Job], unreadable: tuple[Unreadable, ...]) -> None:
        """Begin a suite of ``total`` runs; those ``waiting`` will be run, the others have results already."""

    def on_start(self, job: Job) -> None:
        """A run begins."""

    def on_end(self, job: Job, record: RunRecord) -> None:
        """A run has its record."""

    def on_warmup(self, times: dict[str, float], references: dict[str, float]) -> None:
        """Solvers are compiled or references are there, of some at a time; how long each took [s]."""

    def tick(self) -> None:
        """Time passes."""

    def on_stop(self, left: Sequence[Job], limit: float) -> None:
        """The suite has met its limit [s]; the runs ``left`` had not begun and have no record."""


@dataclass(frozen=True)
class Request:
    """How a suite is to be run."""

    suite: Suite
    folder: Path
    jobs: int
    resume: bool = False
    only: str | None = None  # only the runs of this suite, which the suite includes
    limit: int | None = None  # only the first runs
    shard: tuple[int, int] = (1, 1)  # (k, n): of every n runs the k-th
    lossless: bool = False  # whether series keep the states of every step
    is_newest: bool = False  # whether ``latest`` points to it from now on: not to a folder that its caller chose
    keep: Callable[[RunSpec], tuple[str, ...] | None] | None = None  # names of series whose rows a brief file keeps


def run_suite(request: Request, watcher: Watcher, pool: Callable[..., Executor] = LocalPool) -> Loaded:
    """Run what is not done yet; returns the records of this suite's runs, damaged files apart."""
    folder, total = request.folder, request.suite.total_limit
    limit = TimeLimit(total) if total else None
    if not request.resume and (Place(folder) / "runs").names():
        raise FileError(f"{folder} already holds results; add --resume to continue it, or give another --out")
    store.create(folder)
    with store.lock(folder):
        store.remove_partial(folder)
        before, begun = store.load(folder), Begun(folder)
        store.set_aside(folder, before.unreadable)
        if (listed := begun.read()) is not None:
            before = _set_foreign_aside(folder, before, lambda r: r.run_id in listed)
        (Place(folder) / ".spool").remove_folder()  # of runs that a killed runner left half-way
        where, stamped = _stamp(request)
        jobs = _jobs(request, folder.resolve(), where)
        own, whole = {job.id for job in jobs}, {spec.settings_id for spec in request.suite.specs}
        again, killed = _provisional(folder, own, before.records)
        again += _set_outdated_aside(folder, jobs, before.records)
        done = {r.run_id for r in before.records} - {u.path.stem for u in again}
        waiting = [replace(job, alone=job.id in killed) for job in jobs if job.id not in done]
        watcher.begin(folder, len(jobs), waiting, (*before.unreadable, *again))
        promised: dict[str, RunRecord | None] = {r.run_id: r for r in before.records if r.run_id in done}
        begun.begin(promised)

        def note_start(job: Job) -> None:
            begun.add(job.id)
            watcher.on_start(job)

        def note_end(job: Job, sha256: str) -> None:
            promised[job.id] = None
            with contextlib.suppress(FileError):  # gone already: counted at the end
                record = store.read_record(store.path_of(folder, job.id))
                if store.digest_of(record) == sha256:  # else it is not what the supervisor has stored
                    promised[job.id] = record
                    watcher.on_end(job, record)

        def collect_results() -> Loaded:
            now = store.load(folder, check_series=False)  # a resumed folder may hold runs of another suite or code
            now = _set_foreign_aside(folder, now, lambda r: is_same(r, promised.get(r.run_id)))
            begun.end()
            loaded = Loaded(tuple(r for r in now.records if r.run_id in own), (*before.unreadable, *now.unreadable))
            store.write_table(folder, tuple(r for r in now.records if r.settings_id in whole))
            if request.is_newest:
                store.point_latest(folder)
            return loaded

        try:
            pool(request.jobs, note_start, note_end, watcher.tick, watcher.on_warmup).run(waiting, limit)
        except BaseException:
            with contextlib.suppress(OSError):  # a full disk: what ended the run has been reported already
                collect_results()
            raise
        loaded = collect_results()
        there = {r.run_id: r for r in loaded.records}
        ours = {i: r for i, r in promised.items() if i in own}
        lost = [i for i, r in ours.items() if r is None or not stamps.is_there(folder, r, there.get(i))]
        if lost:
            raise PoolError(
                f"{len(lost)} of {len(jobs)} results in {folder} are gone, or not as they were written; "
                "see what else writes there, then run again with --resume"
            )
        if changed := [name for name, text in stamped.items() if not _holds(Place(folder) / name, text)]:
            raise PoolError(
                f"{', '.join(changed)} in {folder} {'is' if len(changed) == 1 else 'are'} gone, or not as written; "
                "see what else writes there, then run again with --resume"
            )
        left = [job for job in waiting if job.id not in there]
        over = any(r.ended_by == EndedBy.TOTAL_LIMIT for r in loaded.records)
        if limit and (left or over):
            watcher.on_stop(left, limit.seconds)
        elif left:
            raise PoolError(f"{len(left)} of {len(jobs)} runs have no result in {folder}; run again with --resume")
    return loaded


def _set_foreign_aside(folder: Path, loaded: Loaded, is_ours: Callable[[RunRecord], bool]) -> Loaded:
    """Set aside the records that are not ours, with their files."""
    foreign = list_foreign(folder, [r for r in loaded.records if not is_ours(r)])
    store.set_aside(folder, chain.from_iterable(foreign))
    gone = {files[0].path.stem for files in foreign if files}
    kept = tuple(r for r in loaded.records if r.run_id not in gone)
    return Loaded(kept, (*loaded.unreadable, *(files[0] for files in foreign if files)))


def list_waiting(request: Request) -> list[RunSpec]:
    """List the runs that ``run_suite`` would run, those without a record of this code; nothing changes."""
    there = store.is_results(request.folder) and request.resume
    records = store.load(request.folder, check_series=False).records if there else ()
    done = {r.run_id for r in records if not is_provisional(r)}
    return [job.spec for job in _jobs(request, request.folder, "") if job.id not in done]


def _jobs(request: Request, folder: Path, where: str) -> list[Job]:
    """A job a run, each with the digest of the code that its numbers come from."""
    suite, (k, n) = request.suite, request.shard
    specs = [s for s in suite.specs if request.only is None or s.settings_id in suite.parts[request.only]]
    specs = specs[k - 1 :: n][: request.limit]
    code = {k: codes.code_of(*k, suite.plugins) for k in {(s.problem, s.solver) for s in specs}}
    commit = environment.commit()
    of_suite = suite.plugins, where, suite.total_limit, request.lossless
    return [
        Job(s, folder, suite.name, code[s.problem, s.solver], commit, *of_suite, request.keep and request.keep(s))
        for s in specs
    ]


def _set_outdated_aside(folder: Path, jobs: Sequence[Job], records: Sequence[RunRecord]) -> tuple[Unreadable, ...]:
    """Set aside the results of these runs that other code or other limits gave: they are made anew."""
    own = {job.spec.settings_id: job for job in jobs}
    old = [r for r in records if r.settings_id in own and r.run_id != own[r.settings_id].id]
    items = []
    for r in old:
        what = "limits" if r.code == own[r.settings_id].code else "code"
        items.append(files_of(folder, r, f"the run was made with other {what} and is repeated"))
    store.set_aside(folder, chain.from_iterable(items))
    return tuple(i[0] for i in items)


def _provisional(
    folder: Path, specs: set[str], records: Sequence[RunRecord]
) -> tuple[tuple[Unreadable, ...], set[str]]:
    """Set aside what only says how an earlier run of these runs ended; the records that were, and those to run alone.

    A run that is killed again though it ran alone has its result: it may have done it itself.
    """
    found = [r for r in records if r.run_id in specs and is_provisional(r) and not _killed_twice(folder, r)]
    files = [files_of(folder, r) for r in found]
    store.set_aside(folder, chain.from_iterable(files))
    return tuple(f[0] for f in files), {r.run_id for r in found if r.ended_by == EndedBy.KILLED}


def _killed_twice(folder: Path, record: RunRecord) -> bool:
    if record.ended_by != EndedBy.KILLED:
        return False
    with contextlib.suppress(FileError):
        return store.read_record(Place(folder) / "set_aside" / f"{record.run_id}.json").ended_by == EndedBy.KILLED
    return False


def new_folder(suite: str, local: Path = store.LOCAL) -> Path:
    """A name for a new results folder."""
    time = datetime.datetime.now(datetime.UTC).strftime("%Y%m%d-%H%M%S")
    folder = local / f"{suite}-{time}"
    return folder if not folder.exists() else folder.with_name(f"{folder.name}-{os.getpid()}")


def last_folder(suite: str, local: Path = store.LOCAL) -> Path | None:
    """The newest run of a suite."""
    own = re.compile(rf"{re.escape(suite)}-\d{{8}}-\d{{6}}(-\d+)?")  # as new_folder names it: not of a suite "NAME-2"
    found = (p for p in local.glob("*") if own.fullmatch(p.name) and store.is_results(p) and not p.is_symlink())
    return max(found, default=None)


def _holds(place: Place, text: str) -> bool:
    with contextlib.suppress(OSError):
        return place.read(len(text.encode())) == text.encode()
    return False


def _stamp(request: Request) -> tuple[str, dict[str, str]]:
    """Write ``environment.json``, ``suite.toml`` and what it includes; the stamp of an earlier start is kept beside.

    Returns how records name this environment, and what was written, by name.
    """
    folder, suite = request.folder, request.suite
    stamp = environment.stamp(folder.name, suite.name, request.jobs, suite.plugins)
    stamp["suite_runs"] = len(suite.specs)  # of the whole suite, whatever part of it is asked for now
    suites = {f"{name}.toml": text for name, text in ((OWN_COPY, suite.text), *suite.included)}
    stamp = stamps.seal(stamp, suites)  # what is included lies beside it: the copy is a suite that can be run
    here, own = Place(folder), Place(folder) / stamps.NAME
    if own.is_there():
        (here / f"environment.{stamp['started'].replace(':', '')}.json").write(own.read(store.LARGEST))
    where = environment.identity(stamp)
    text = json.dumps(stamp, indent=1)
    written = {own.name: text, f"environment.{where}.json": text, **suites}
    for name, content in reversed(written.items()):  # the stamp last: it has the digests of the others
        (here / name).write(content)
    return where, written
