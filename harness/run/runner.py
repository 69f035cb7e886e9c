"""Run a suite into a results folder: finished runs are kept, damaged files are set aside, the rest is run."""

import contextlib
import datetime
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol

from ..base.confined_paths import ConfinedPath
from ..base.files import FileError
from ..catalogue import codes
from ..catalogue.suites.includes import OWN_COPY
from ..catalogue.suites.spec import RunSpec
from ..catalogue.suites.suite import Suite
from ..mechanics.types import EndCause
from ..results import environment, stamps, store
from ..results.column_digests import add_column_digests
from ..results.provisional import is_provisional, list_record_files
from ..results.records import RunRecord
from ..results.store import LoadedResults
from . import origin
from .job import Job
from .pool import LocalPool, PoolError, TimeLimit
from .protocol import Supervised
from .started_runs import StartedRuns, is_as_expected, list_foreign_files


class Executor(Protocol):
    """An executor of runs: ``pool.LocalPool`` on this machine, ``cluster.DaskPool`` on others."""

    def run(self, jobs: Sequence[Job], limit: TimeLimit | None = None) -> None:
        """Run all ``jobs``; return when each has a record in its folder, or raise PoolError when that is impossible.

        At the ``limit`` running runs are ended as unfinished, and those that have not begun are left without a record.
        """


class SuiteObserver(Protocol):
    """An observer of a suite's progress."""

    def begin(self, folder: Path, total: int, waiting: Sequence[Job], unreadable: Mapping[Path, str]) -> None:
        """Begin a suite of ``total`` runs; those ``waiting`` will be run, the others have results already.

        ``unreadable`` are files that were set aside: damaged, foreign or outdated ones.
        """

    def on_start(self, job: Job) -> None:
        """Note that a run begins."""

    def on_end(self, job: Job, record: RunRecord) -> None:
        """Note that a run has its record."""

    def on_warmup(self, times: dict[str, float], references: dict[str, float]) -> None:
        """Note how long [s] solvers took to compile, and references to compute, since the last call."""

    def on_tick(self) -> None:
        """Note that time passes."""

    def on_stop(self, left: Sequence[Job], limit: float) -> None:
        """Note that the suite has reached its limit [s]; the runs ``left`` had not begun and have no record."""


@dataclass(frozen=True)
class Request:
    """Define how a suite is to be run."""

    suite: Suite
    folder: Path
    jobs: int
    resume: bool = False
    only: str | None = None  # run only this suite, which the suite includes
    limit: int | None = None  # run only the first runs
    shard: tuple[int, int] = (1, 1)  # (k, n): run the k-th of every n runs
    lossless: bool = False  # whether series keep the states of every step
    is_newest: bool = False  # whether ``latest`` will point to it, which it does not for a folder chosen by the user
    # the names of the series whose rows the brief file of a run keeps; None for a file of every step
    choose_rows: Callable[[RunSpec], tuple[str, ...] | None] | None = None
    pool: Callable[..., Executor] = LocalPool  # makes the executor of its jobs


def choose_pool(address: str | None = None, environ: Mapping[str, str] | None = None) -> Callable[..., Executor]:
    """Return the constructor of an executor: local processes or, with an ``address``, the workers of that cluster.

    ``environ`` are additional environment variables for local processes.
    """
    if address is None:
        return partial(LocalPool, environ=environ or {})
    from .cluster import DaskPool

    return lambda size, *watching: DaskPool(address, *watching)


@contextlib.contextmanager
def begin_local_pool() -> Iterator[Callable[..., Executor]]:
    """Start the supervisor process of a local pool, and yield the constructor of that pool.

    The process loads its modules while the caller reads the suite and estimates times. At the end of the ``with`` block
    it is killed if it was not used.
    """
    ahead = Supervised()
    try:
        yield partial(LocalPool, ahead=ahead)
    finally:
        ahead.discard()


def run_suite(request: Request, watcher: SuiteObserver) -> LoadedResults:
    """Run the runs that have no valid record yet; return the records of the request's runs, and the files set aside.

    Damaged, foreign, outdated and provisional results are moved to ``set_aside/`` first; the stamp, the suite and the
    table are written. ``watcher`` is called as runs start and end. Raise FileError if the folder holds results and the
    request does not resume, and PoolError if runs have no result, or if results were changed while the suite ran.
    """
    folder, total = request.folder, request.suite.total_limit
    limit = TimeLimit(total) if total else None
    if not request.resume and (ConfinedPath(folder) / "runs").names():
        raise FileError(f"{folder} already holds results; add --resume to continue it, or give another --out")
    store.create_folder(folder)
    with store.lock_folder(folder):
        store.remove_partial(folder)
        before, begun = store.load(folder), StartedRuns(folder)
        store.set_aside(folder, before.unreadable)
        if (listed := begun.read()) is not None:
            before = _set_foreign_aside(folder, before, lambda r: r.run_id in listed)
        (ConfinedPath(folder) / ".spool").remove_folder()  # of runs that a killed runner left half-way
        where, stamped = _write_stamp(request)
        damaged = {**before.unreadable, **add_column_digests(folder, codes.read_column_digests())}
        jobs = _make_jobs(request, folder.resolve(), where)
        own, whole = {job.id for job in jobs}, {spec.settings_id for spec in request.suite.specs}
        again, killed = _set_aside_provisional(folder, own, before.records)
        again |= _set_outdated_aside(folder, jobs, before.records)
        done = {r.run_id for r in before.records} - {path.stem for path in again}
        waiting = [replace(job, alone=job.id in killed) for job in jobs if job.id not in done]
        watcher.begin(folder, len(jobs), waiting, {**damaged, **again})
        # by run_id, the record that must be on disk at the end; None if the one that was written is gone or replaced
        expected_records: dict[str, RunRecord | None] = {r.run_id: r for r in before.records if r.run_id in done}
        begun.begin(expected_records)

        def note_start(job: Job) -> None:
            """Record on disk that a run begins, then report it to the watcher."""
            begun.add(job.id)
            watcher.on_start(job)

        def note_end(job: Job, sha256: str) -> None:
            """Enter the record of a run that ended in ``expected_records``, and report it to the watcher.

            At the end of the suite the record on disk must equal it. If the record is missing, or its digest is not
            ``sha256``, which the supervisor reported, then nothing is reported, None is entered, and the run counts as
            lost.
            """
            expected_records[job.id] = None
            with contextlib.suppress(FileError):  # removed already
                record = store.read_record(store.locate_record(folder, job.id))
                # otherwise something else has replaced the record that the supervisor stored
                if store.digest_record(record) == sha256:
                    expected_records[job.id] = record
                    watcher.on_end(job, record)

        def collect_results() -> LoadedResults:
            """Set foreign records aside, write the table of the suite, and return the results of the requested runs.

            The list of started runs is removed, and ``latest`` is set if that is requested.
            """
            now = store.load(folder, check_series=False)  # a resumed folder may hold runs of another suite or code
            now = _set_foreign_aside(folder, now, lambda r: is_as_expected(r, expected_records.get(r.run_id)))
            begun.end()
            loaded = LoadedResults(tuple(r for r in now.records if r.run_id in own), {**damaged, **now.unreadable})
            store.write_table(folder, tuple(r for r in now.records if r.settings_id in whole))
            if request.is_newest:
                store.point_latest(folder)
            return loaded

        try:
            request.pool(request.jobs, note_start, note_end, watcher.on_tick, watcher.on_warmup).run(waiting, limit)
        except BaseException:  # on Ctrl-C, too, the runs that have ended are collected
            with contextlib.suppress(OSError):  # on a full disk; the reason has been reported already
                collect_results()
            raise
        loaded = collect_results()
        there = {r.run_id: r for r in loaded.records}
        ours = {i: r for i, r in expected_records.items() if i in own}
        lost = [i for i, r in ours.items() if r is None or not stamps.is_intact(folder, r, there.get(i))]
        if lost:
            raise PoolError(
                f"{len(lost)} of {len(jobs)} results in {folder} are gone, or not as they were written; "
                "see what else writes there, then run again with --resume"
            )
        if changed := [name for name, text in stamped.items() if not _has_content(ConfinedPath(folder) / name, text)]:
            raise PoolError(
                f"{', '.join(changed)} in {folder} {'is' if len(changed) == 1 else 'are'} gone, or not as written; "
                "see what else writes there, then run again with --resume"
            )
        left = [job for job in waiting if job.id not in there]
        over = any(r.ended_by == EndCause.TOTAL_LIMIT for r in loaded.records)
        if limit and (left or over):
            watcher.on_stop(left, limit.seconds)
        elif left:
            raise PoolError(f"{len(left)} of {len(jobs)} runs have no result in {folder}; run again with --resume")
    return loaded


def _set_foreign_aside(folder: Path, loaded: LoadedResults, is_ours: Callable[[RunRecord], bool]) -> LoadedResults:
    """Set aside the records for which ``is_ours`` returns False, with their files; return the results without them.

    The record files are listed as unreadable, with the reason.
    """
    foreign = list_foreign_files(folder, [r for r in loaded.records if not is_ours(r)])
    store.set_aside(folder, _join_files(foreign))
    first = _list_first(foreign)
    gone = {path.stem for path in first}
    kept = tuple(r for r in loaded.records if r.run_id not in gone)
    return LoadedResults(kept, {**loaded.unreadable, **first})


def _join_files(found: Sequence[Mapping[Path, str]]) -> dict[Path, str]:
    """Return the files of several records, each with its reason."""
    return {path: why for files in found for path, why in files.items()}


def _list_first(found: Sequence[Mapping[Path, str]]) -> dict[Path, str]:
    """Return the first file of each record, which is the record itself, with the reason."""
    return dict(next(iter(files.items())) for files in found if files)


def list_waiting(request: Request) -> list[RunSpec]:
    """Return the specs that ``run_suite`` would run, those without a record of this code; nothing is changed.

    Without ``resume``, or in a folder without results, these are all runs of the request.
    """
    there = store.is_results(request.folder) and request.resume
    records = store.load(request.folder, check_series=False).records if there else ()
    done = {r.run_id for r in records if not is_provisional(r)}
    jobs = _make_jobs(replace(request, choose_rows=None), request.folder, "")  # rows are chosen for jobs that run
    return [job.spec for job in jobs if job.id not in done]


def _make_jobs(request: Request, folder: Path, where: str) -> list[Job]:
    """Return a job for each requested run, with the digest of the code that its numbers come from.

    From the runs of the suite, or of the included suite ``only``, the request takes those of its shard, and of these
    the first ``limit``. ``where`` is the digest by which records name their environment.
    """
    suite, (shard, shards) = request.suite, request.shard
    part = [s for s in suite.specs if request.only is None or s.settings_id in suite.parts[request.only]]
    specs = part[shard - 1 :: shards][: request.limit]
    pairs = {(s.problem, s.solver) for s in specs}
    code = {pair: codes.digest_run_code(*pair, suite.plugins) for pair in pairs}
    commit, measured_by = environment.read_commit(), codes.read_column_digests().digest
    return [
        Job(
            s,
            folder,
            suite=suite.name,
            code=code[s.problem, s.solver],
            commit=commit,
            plugins=suite.plugins,
            environment=where,
            total_limit=suite.total_limit,
            lossless=request.lossless,
            keep=request.choose_rows and request.choose_rows(s),
            measured_by=measured_by,
        )
        for s in specs
    ]


def _set_outdated_aside(folder: Path, jobs: Sequence[Job], records: Sequence[RunRecord]) -> dict[Path, str]:
    """Set aside the results of these jobs that were made by other code or with other limits: they are run again.

    Return the record file of each with the reason.
    """
    own = {job.spec.settings_id: job for job in jobs}
    old = [r for r in records if r.settings_id in own and r.run_id != own[r.settings_id].id]
    items = []
    for r in old:
        what = "limits" if r.code == own[r.settings_id].code else "code"
        items.append(list_record_files(folder, r, f"the run was made with other {what} and is repeated"))
    store.set_aside(folder, _join_files(items))
    return _list_first(items)


def _set_aside_provisional(
    folder: Path, run_ids: set[str], records: Sequence[RunRecord]
) -> tuple[dict[Path, str], set[str]]:
    """Set aside those records of the runs ``run_ids`` that are provisional (``is_provisional``).

    Return the record files with the reasons, and the run_ids that are to run alone: those that were killed. A run that
    was killed again although it ran alone keeps its record as the result, since it may be the cause.
    """
    found = [r for r in records if r.run_id in run_ids and is_provisional(r) and not _was_killed_twice(folder, r)]
    files = [list_record_files(folder, r) for r in found]
    store.set_aside(folder, _join_files(files))
    return _list_first(files), {r.run_id for r in found if r.ended_by == EndCause.KILLED}


def _was_killed_twice(folder: Path, record: RunRecord) -> bool:
    """Return whether a run was killed from outside, as was its earlier attempt, whose record is in ``set_aside/``."""
    if record.ended_by != EndCause.KILLED:
        return False
    with contextlib.suppress(FileError):
        return (
            store.read_record(ConfinedPath(folder) / "set_aside" / f"{record.run_id}.json").ended_by == EndCause.KILLED
        )
    return False


def name_new_folder(suite: str, local: Path = store.LOCAL) -> Path:
    """Return the path of a new results folder in ``local``, named after the suite and the time; it is not created."""
    time = datetime.datetime.now(datetime.UTC).strftime("%Y%m%d-%H%M%S")
    folder = local / f"{suite}-{time}"
    return folder if not folder.exists() else folder.with_name(f"{folder.name}-{os.getpid()}")


def find_last_folder(suite: str, local: Path = store.LOCAL) -> Path | None:
    """Return the newest results folder of a suite in ``local``; None if there is none."""
    # as name_new_folder names it, which excludes a suite "NAME-2"
    own = re.compile(rf"{re.escape(suite)}-\d{{8}}-\d{{6}}(-\d+)?")
    found = (p for p in local.glob("*") if own.fullmatch(p.name) and store.is_results(p) and not p.is_symlink())
    return max(found, default=None)


def _has_content(place: ConfinedPath, text: str) -> bool:
    """Return whether a file has exactly this content."""
    with contextlib.suppress(OSError):
        return place.read(len(text.encode())) == text.encode()
    return False


def _write_stamp(request: Request) -> tuple[str, dict[str, str]]:
    """Write ``environment.json``, ``suite.toml`` and the suites that it includes; keep a copy of an earlier stamp.

    Return the digest by which records name this environment, and the texts that were written, by file name.
    """
    folder, suite = request.folder, request.suite
    stamp = origin.describe_environment(folder.name, suite.name, request.jobs, suite.plugins)
    stamp["suite_runs"] = len(suite.specs)  # of the whole suite, whatever part of it is requested now
    suites = {f"{name}.toml": text for name, text in ((OWN_COPY, suite.text), *suite.included)}
    stamp = stamps.seal_stamp(stamp, suites)  # included suites are written beside it, so that the copy can be run
    here, own = ConfinedPath(folder), ConfinedPath(folder) / stamps.NAME
    if own.is_there():
        (here / f"environment.{stamp['started'].replace(':', '')}.json").write(own.read(store.LARGEST))
    where = environment.digest_environment(stamp)
    text = json.dumps(stamp, indent=1)
    written = {own.name: text, f"environment.{where}.json": text, **suites}
    # the stamp is written last, because it has the digests of the others
    for name, content in reversed(written.items()):
        (here / name).write(content)
    return where, written
