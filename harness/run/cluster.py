"""Execute runs on other machines by Dask; each thread of a worker runs them by a supervisor, as the local pool does.

A worker executes a run in a temporary folder and returns the files, so no file system need be shared. If a worker dies,
its supervisors' runs die too, and Dask assigns them to another. A worker whose code differs from this checkout's is
refused, so that all runs are measured and judged by the same code.
"""

import contextlib
import json
import os
import secrets
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from ..base import machine
from ..base.confined_paths import ConfinedPath
from ..base.files import FileError
from ..catalogue import codes
from ..catalogue.suites.spec import RunSpec
from ..mechanics.types import EndCause
from ..results import environment
from ..results.records import RunRecord
from ..results.series import LARGEST
from ..results.store import PARTS, create_folder, digest_record, parse_record, read_record, remove_partial, write_record
from .job import Job, make_cut_short_record
from .pool import TICK, PoolError, StartFailures, TimeLimit
from .protocol import News, RunEnded, StartOrder, StopOrder, Supervised, SupervisorLost, WarmUpOrder, WarmUpTimes
from .warmup import list_runs_to_warm

PATIENCE = 60.0  # [s] to wait without any worker
# runs sent out per thread of the cluster: one leaves a thread idle between runs, more are lost on an interruption
AHEAD = 2


@dataclass
class DaskPool:
    """Run jobs on the Dask cluster at ``address`` (``tcp://host:port``, or a scheduler file)."""

    address: str
    on_start: Callable[[Job], None] = lambda job: None
    on_end: Callable[[Job, str], None] = lambda job, sha256: None  # with the digest of its record
    tick: Callable[[], None] = lambda: None
    on_warmup: Callable[[dict[str, float]], None] = lambda times: None
    _flying: dict[Any, Job] = field(default_factory=dict)  # jobs sent out, by their Dask future
    _unbegun: StartFailures = field(default_factory=StartFailures)
    _foreign: list[str] = field(default_factory=list)  # files in runs' folders that are not of the run

    def run(self, jobs: Sequence[Job], limit: TimeLimit | None = None) -> None:
        """Run all ``jobs``; return when each has a record, or at the limit, when those that had begun have one.

        Raise PoolError if the cluster or its workers are lost, or if runs have no valid result; finished runs are
        stored.
        """
        if not jobs:
            return
        client = _connect_client(self.address)
        limit = limit and limit.start()  # workers compile while they run
        ticket = secrets.token_hex(8)  # identifies this call to the workers, which may serve others after it
        try:
            waiting = list(jobs)[::-1]
            seen = time.monotonic()
            while waiting or self._flying:
                threads = sum(client.nthreads().values())
                seen = time.monotonic() if threads else seen
                if time.monotonic() - seen > PATIENCE:
                    raise PoolError(
                        f"no worker at {self.address} for {PATIENCE:g} s; finished runs are kept (--resume)"
                    )
                if limit is not None and limit.is_over:
                    # a run that has not begun returns without files; the order is repeated for workers that join late
                    waiting.clear()
                    client.run(stop_ticket, ticket)
                while waiting and len(self._flying) < AHEAD * threads:
                    job = waiting.pop()
                    self.on_start(job)
                    future = client.submit(run_job, job.to_json(), ticket, key=f"{ticket}-{job.id}", retries=0)
                    self._flying[future] = job
                self._collect()
                self.tick()
        except OSError as error:
            raise PoolError(f"the cluster at {self.address} is gone: {error}; finished runs are kept") from None
        finally:
            client.close()
        found = "; ".join(self._foreign[:5])
        foreign = f"files that do not belong to the run that wrote them were discarded: {found}" if found else ""
        try:
            self._unbegun.check()
        except PoolError as error:
            raise PoolError("; ".join(filter(None, (foreign, str(error))))) from None
        if foreign:
            raise PoolError(f"{foreign}; finished runs are kept, run again with --resume for the others")

    def _collect(self) -> None:
        """Wait up to ``TICK`` [s] for a run to end; store the files of each that has ended, and call ``on_end``.

        A run whose workers were lost gets a record that says so. Raise PoolError if a worker cannot execute runs, for
        example because its code differs.
        """
        import distributed

        if not self._flying:
            time.sleep(TICK)
            return
        try:
            distributed.wait(list(self._flying), timeout=TICK, return_when="FIRST_COMPLETED")
        except TimeoutError:
            return
        for future in [f for f in self._flying if f.done()]:
            job = self._flying.pop(future)
            failed = future.exception()
            if failed is None:
                sent: WorkerResult = future.result()
                if sent.foreign:
                    self._foreign.append(f"{job.spec.case} wrote {', '.join(sent.foreign[:5])}")
                if sent.unbegun:
                    self._unbegun.add(sent.unbegun)
                if not sent.files:
                    continue
                self._unbegun.in_a_row = 0
                digest = _store_files(job, sent.files)
            elif isinstance(failed, distributed.KilledWorker):
                digest = digest_record(write_lost_record(job))
            else:
                raise PoolError(f"a worker cannot execute runs: {failed}")
            self.on_end(job, digest)


def write_lost_record(job: Job) -> RunRecord:
    """Write the record of a run whose workers were lost, and return it."""
    record = make_cut_short_record(job, EndCause.WORKERS_LOST)
    write_record(job.folder, record)
    return record


_stopped: set[str] = set()  # on a worker: tickets of runs that have met their limit
_serving: dict[str, list["_Supervisor"]] = {}  # on a worker: the supervisors that run a ticket's runs


def stop_ticket(ticket: str) -> None:
    """End all runs of the call ``ticket`` on this worker, and let none of its others begin."""
    _stopped.add(ticket)
    for supervisor in list(_serving.get(ticket, ())):
        with contextlib.suppress(SupervisorLost):
            supervisor.send(StopOrder())


def on_slurm(**options: Any) -> Any:
    """Return a ``dask_jobqueue.SLURMCluster`` whose workers run one run at a time, on one thread, from this checkout.

    ``options`` are those of the cluster: memory, walltime, queue, account, job_extra_directives; ``scale`` it, then
    give its ``scheduler_address`` to ``--cluster``. A job that SLURM would refuse raises PoolError here; without this
    check the cluster has no workers and gives no reason.
    """
    try:
        from dask_jobqueue import SLURMCluster
    except ModuleNotFoundError:
        raise PoolError("SLURM needs dask-jobqueue: pip install -r locks/requirements-cluster.lock") from None
    prologue = [f"cd {shlex.quote(str(environment.ROOT))}"]  # folder in which Python finds ``harness``
    prologue += [f"export {name}={value}" for name, value in machine.THREADS.items()]
    own = {"cores": 1, "processes": 1, "memory": "8GB", "walltime": "02:00:00", "python": sys.executable}
    prologue += options.pop("job_script_prologue", [])
    cluster = SLURMCluster(**{**own, **options}, job_script_prologue=prologue)
    if shutil.which("sbatch"):
        try_out = ["sbatch", "--test-only"]
        tried = subprocess.run(try_out, input=cluster.job_script(), capture_output=True, text=True, check=False)
        if tried.returncode:
            cluster.close()
            raise PoolError(f"SLURM refuses the job: {' '.join(tried.stderr.split())}")
    return cluster


@dataclass(frozen=True)
class WorkerResult:
    """The result of a run on a worker: the contents of its files, by path in the results folder.

    There are none if the run was stopped or has no record. ``unbegun`` says why the run could not begin; ``foreign``
    lists files in its folder that the run did not write.
    """

    files: Mapping[str, bytes] = field(default_factory=dict)
    unbegun: str = ""
    foreign: Sequence[str] = ()


def run_job(text: str, ticket: str = "") -> WorkerResult:
    """Run the job in the JSON ``text`` on this worker, in a temporary folder, and return the files that it left there.

    ``ticket`` names the call that sent the job: once that has been stopped, nothing is run. Files that are not of the
    run are not returned. Raise RuntimeError if the code or packages of this worker are not those of the job.
    """
    job = Job.from_json(text)
    if ticket in _stopped:
        return WorkerResult()
    here = codes.digest_run_code(job.spec.problem, job.spec.solver, job.plugins)
    if here == job.code and job.measured_by not in ("", codes.read_column_digests().digest):
        raise RuntimeError("its code that measures is not the runner's: use the same checkout and packages")
    if here != job.code:
        raise RuntimeError(f"its code {here} is not the runner's {job.code}: use the same checkout and packages")
    with tempfile.TemporaryDirectory() as place:
        own, stamp = _describe_worker()
        local = replace(job, folder=Path(place), environment=own)
        create_folder(local.folder)
        supervisor = _provide_supervisor()
        _serving.setdefault(ticket, []).append(supervisor)
        try:
            report = supervisor.run(local)
        finally:
            _serving[ticket].remove(supervisor)
        if report.unbegun:
            return WorkerResult(unbegun=report.unbegun)
        remove_partial(local.folder)  # files of a process that was killed while it wrote
        parts = {part: ConfinedPath(local.folder) / part for part in PARTS}
        places = {f"{part}/{name}": place / name for part, place in parts.items() for name in place.names()}
        record = f"runs/{job.id}.json"
        foreign = [n for n, place in places.items() if place.name.partition(".")[0] != job.id]
        foreign += [n for n, place in places.items() if n == record and not _has_reported_digest(place, report)]
        if record in foreign or record not in places:
            return WorkerResult(foreign=foreign)
        files = {n: place.read(LARGEST) for n, place in places.items() if n not in foreign}
        return WorkerResult({f"environment.{own}.json": stamp, **files}, foreign=foreign)


def _has_reported_digest(place: ConfinedPath, report: RunEnded) -> bool:
    """Return whether the record at ``place`` has the digest that the supervisor reported; False if it is invalid."""
    with contextlib.suppress(FileError):
        return digest_record(read_record(place)) == report.sha256
    return False


@cache
def _describe_worker() -> tuple[str, bytes]:
    """Return the digest by which records name this worker's environment, and its stamp as JSON.

    The stamp comes from a new process, with the environment variables of a run.
    """
    call = (sys.executable, "-m", "mbsbench.harness.run.origin")
    given = {**os.environ, **machine.THREADS}
    done = subprocess.run(call, cwd=environment.ROOT, env=given, stdout=subprocess.PIPE, check=True)
    stamp = json.loads(done.stdout)
    return environment.digest_environment(stamp), json.dumps(stamp, indent=1).encode()


def _store_files(job: Job, files: Mapping[str, bytes]) -> str:
    """Write the files that a worker sent into the job's folder, the record last; return the record's digest.

    ``files`` are contents by path in the folder. Without a record the digest is empty. An existing stamp is kept. Raise
    PoolError if a file cannot be written.
    """
    for name in sorted(files, key=lambda n: n.startswith("runs/")):
        place = ConfinedPath(job.folder) / name
        # of an identical machine: the runner's own stamp is sealed and stays
        if name.startswith("environment.") and place.is_there():
            continue
        try:
            place.write(files[name])
        except OSError as e:  # an error of this machine, not of the cluster
            raise PoolError(f"cannot write to {job.folder}: {e.strerror or e}; finished runs are kept") from None
    name = f"{job.id}.json"
    return digest_record(parse_record(name, files[f"runs/{name}"])) if f"runs/{name}" in files else ""


class _Supervisor(Supervised):
    """A supervisor process for one thread of a worker, which runs one run at a time."""

    def __init__(self) -> None:
        super().__init__()
        self.warm: list[RunSpec] = []  # runs whose code is compiled
        self.news: list[News] = []  # received, not yet read

    def run(self, job: Job) -> RunEnded:
        """Compile what the job needs, run it, and return the report of its end: that it has a record, or did not begin.

        Raise RuntimeError if the supervisor reports an error.
        """
        specs = [c for c in list_runs_to_warm([job.spec]) if c not in self.warm]
        self.send(WarmUpOrder(specs, [job]))
        while not (isinstance(warmed := self._await_news(), WarmUpTimes) and warmed.over):
            pass
        self.warm += specs
        self.send(StartOrder(job))
        while not isinstance(done := self._await_news(), RunEnded):
            pass
        if done.error:
            raise RuntimeError(done.error)
        return done

    def _await_news(self) -> News:
        """Return the next message of the supervisor process; wait for it if none has been received."""
        while not self.news:
            self.news += self.receive()
        return self.news.pop(0)


_of_thread = threading.local()


def _provide_supervisor() -> _Supervisor:
    """Return the supervisor of this thread; start a new one if it has none or that has ended."""
    found = getattr(_of_thread, "supervisor", None)
    if found is None or found.process.poll() is not None:
        found = _of_thread.supervisor = _Supervisor()
    return found


def _connect_client(address: str) -> Any:
    """Return a client of the Dask cluster at ``address``; raise PoolError if there is no cluster with workers."""
    try:
        import distributed
    except ModuleNotFoundError:
        raise PoolError("--cluster needs Dask: pip install -r locks/requirements-cluster.lock") from None
    where = {"scheduler_file": address} if address.endswith(".json") else {"address": address}
    if "scheduler_file" in where and not Path(address).is_file():
        raise PoolError(f"there is no scheduler file {address}")
    try:
        client = distributed.Client(**where, timeout=10.0)
        client.wait_for_workers(1, timeout=PATIENCE)
    except (OSError, TimeoutError, ValueError) as error:
        raise PoolError(f"no Dask cluster with workers at {address}: {' '.join(str(error).split())}") from None
    return client
