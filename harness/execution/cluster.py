"""Runs on other machines: an executor over Dask. Each Dask worker keeps a supervisor, as the local pool does.

A worker runs a run in a folder of its own and sends the files back, so no file system need be shared. A worker that
dies takes its supervisor's runs with it; Dask gives them to another. What is measured and judged is the same code:
a worker with other code than this checkout's is refused.
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

from .. import machine
from ..files import FileError
from ..places import Place
from ..results import codes, environment
from ..results.records import RunRecord
from ..results.series import LARGEST
from ..results.store import PARTS, create, digest_of, read_record, record_in, remove_partial, write_record
from ..suites.spec import RunSpec
from ..types import EndedBy
from .job import Job, cut_short
from .pool import TICK, PoolError, TimeLimit, Unbegun
from .protocol import Done, Lost, News, Start, Stop, Supervised, Warm, Warmed
from .warmup import runs_to_warm

PATIENCE = 60.0  # [s] without any worker
AHEAD = 2  # runs sent out per thread of the cluster


@dataclass
class DaskPool:
    """Runs jobs on the Dask cluster at ``address`` (``tcp://host:port``, or a scheduler file)."""

    address: str
    on_start: Callable[[Job], None] = lambda job: None
    on_end: Callable[[Job, str], None] = lambda job, sha256: None  # with the digest of its record
    tick: Callable[[], None] = lambda: None
    on_warmup: Callable[[dict[str, float]], None] = lambda times: None
    _flying: dict[Any, Job] = field(default_factory=dict)
    _unbegun: Unbegun = field(default_factory=Unbegun)
    _foreign: list[str] = field(default_factory=list)

    def run(self, jobs: Sequence[Job], limit: TimeLimit | None = None) -> None:
        """Run all ``jobs``; returns when each has a record, or at the limit, when those that had begun have one."""
        if not jobs:
            return
        client = _client(self.address)
        limit = limit and limit.start()  # workers compile beside runs
        ticket = secrets.token_hex(8)  # names this run to the workers, which may serve others after it
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
                    waiting.clear()  # what has not begun returns without files; sent again for workers that join late
                    client.run(stop_here, ticket)
                while waiting and len(self._flying) < AHEAD * threads:
                    job = waiting.pop()
                    self.on_start(job)
                    future = client.submit(run_run, job.to_json(), ticket, key=f"{ticket}-{job.id}", retries=0)
                    self._flying[future] = job
                self._collect()
                self.tick()
        except OSError as error:
            raise PoolError(f"the cluster at {self.address} is gone: {error}; finished runs are kept") from None
        finally:
            client.close()
        found = "; ".join(self._foreign[:5])
        foreign = f"files that are not of the run that wrote them were not taken: {found}" if found else ""
        try:
            self._unbegun.check()
        except PoolError as error:
            raise PoolError("; ".join(filter(None, (foreign, str(error))))) from None
        if foreign:
            raise PoolError(f"{foreign}; finished runs are kept, run again with --resume for the others")

    def _collect(self) -> None:
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
                sent: Sent = future.result()
                if sent.foreign:
                    self._foreign.append(f"{job.spec.case} wrote {', '.join(sent.foreign[:5])}")
                if sent.unbegun:
                    self._unbegun.add(sent.unbegun)
                if not sent.files:
                    continue
                self._unbegun.in_a_row = 0
                digest = _store(job, sent.files)
            elif isinstance(failed, distributed.KilledWorker):
                digest = digest_of(write_lost(job))
            else:
                raise PoolError(f"a worker cannot execute runs: {failed}")
            self.on_end(job, digest)


def write_lost(job: Job) -> RunRecord:
    """Write the record of a run whose workers were lost."""
    record = cut_short(job, EndedBy.WORKERS_LOST)
    write_record(job.folder, record)
    return record


_stopped: set[str] = set()  # on a worker: tickets of runs that have met their limit
_serving: dict[str, list["_Supervisor"]] = {}  # on a worker: the supervisors that run a ticket's runs


def stop_here(ticket: str) -> None:
    """On a worker: end the runs of that run, and let no other of it begin."""
    _stopped.add(ticket)
    for supervisor in list(_serving.get(ticket, ())):
        with contextlib.suppress(Lost):
            supervisor.send(Stop())


def on_slurm(**options: Any) -> Any:
    """A ``dask_jobqueue.SLURMCluster`` whose workers execute runs: one at a time each, one thread, from this checkout.

    ``options`` are its own: memory, walltime, queue, account, job_extra_directives; ``scale`` it, then give its
    ``scheduler_address`` to ``--cluster``. A job that SLURM would refuse is a PoolError here; without this check the
    cluster has no workers and gives no reason.
    """
    try:
        from dask_jobqueue import SLURMCluster
    except ModuleNotFoundError:
        raise PoolError("SLURM needs dask-jobqueue: pip install -r requirements-cluster.lock") from None
    prologue = [f"cd {shlex.quote(str(environment.ROOT))}"]  # where ``harness`` is found
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
class Sent:
    """What a worker sends of a run: its files by place in the folder, none if it was stopped before or has no result.

    ``unbegun`` says why it did not begin, ``foreign`` which files in its folder are not its own.
    """

    files: Mapping[str, bytes] = field(default_factory=dict)
    unbegun: str = ""
    foreign: Sequence[str] = ()


def run_run(text: str, ticket: str = "") -> Sent:
    """On a worker: run the job and return what it left."""
    job = Job.from_json(text)
    if ticket in _stopped:
        return Sent()
    here = codes.code_of(job.spec.problem, job.spec.solver, job.plugins)
    if here != job.code:
        raise RuntimeError(f"its code {here} is not the runner's {job.code}: use the same checkout and packages")
    with tempfile.TemporaryDirectory() as place:
        own, stamp = _here()
        local = replace(job, folder=Path(place), environment=own)
        create(local.folder)
        supervisor = _supervisor()
        _serving.setdefault(ticket, []).append(supervisor)
        try:
            told = supervisor.run(local)
        finally:
            _serving[ticket].remove(supervisor)
        if told.unbegun:
            return Sent(unbegun=told.unbegun)
        remove_partial(local.folder)  # of a process that was killed while it wrote
        parts = {part: Place(local.folder) / part for part in PARTS}
        places = {f"{part}/{name}": place / name for part, place in parts.items() for name in place.names()}
        record = f"runs/{job.id}.json"
        foreign = [n for n, place in places.items() if place.name.partition(".")[0] != job.id]
        foreign += [n for n, place in places.items() if n == record and not _is_of(place, told)]
        if record in foreign or record not in places:
            return Sent(foreign=foreign)
        files = {n: place.read(LARGEST) for n, place in places.items() if n not in foreign}
        return Sent({f"environment.{own}.json": stamp, **files}, foreign=foreign)


def _is_of(place: Place, told: Done) -> bool:
    """Whether the record is the one of which the supervisor told."""
    with contextlib.suppress(FileError):
        return digest_of(read_record(place)) == told.sha256
    return False


@cache
def _here() -> tuple[str, bytes]:
    """How records name this worker's environment, and its stamp: that of a process as its runs have, not of Dask's."""
    call = (sys.executable, "-m", "mbsbench.harness.results.environment")
    given = {**os.environ, **machine.THREADS}
    done = subprocess.run(call, cwd=environment.ROOT, env=given, stdout=subprocess.PIPE, check=True)
    stamp = json.loads(done.stdout)
    return environment.identity(stamp), json.dumps(stamp, indent=1).encode()


def _store(job: Job, files: Mapping[str, bytes]) -> str:
    """Write what a worker sent, the record last; return the digest of that."""
    for name in sorted(files, key=lambda n: n.startswith("runs/")):
        place = Place(job.folder) / name
        if name.startswith("environment.") and place.is_there():  # of a machine like ours: the runner's own, sealed
            continue
        try:
            place.write(files[name])
        except OSError as e:  # ours, not the cluster's
            raise PoolError(f"cannot write to {job.folder}: {e.strerror or e}; finished runs are kept") from None
    name = f"{job.id}.json"
    return digest_of(record_in(name, files[f"runs/{name}"])) if f"runs/{name}" in files else ""


class _Supervisor(Supervised):
    """A supervisor process of a worker's thread, one run at a time."""

    def __init__(self) -> None:
        super().__init__()
        self.warm: list[RunSpec] = []
        self.news: list[News] = []

    def run(self, job: Job) -> Done:
        """Return the news of the run's end: its record is stored, or it did not begin."""
        specs = [c for c in runs_to_warm([job.spec]) if c not in self.warm]
        self.send(Warm(specs, [job]))
        while not (isinstance(warmed := self._answer(), Warmed) and warmed.over):
            pass
        self.warm += specs
        self.send(Start(job))
        while not isinstance(done := self._answer(), Done):
            pass
        if done.error:
            raise RuntimeError(done.error)
        return done

    def _answer(self) -> News:
        while not self.news:
            self.news += self.receive()
        return self.news.pop(0)


_of_thread = threading.local()


def _supervisor() -> _Supervisor:
    found = getattr(_of_thread, "supervisor", None)
    if found is None or found.process.poll() is not None:
        found = _of_thread.supervisor = _Supervisor()
    return found


def _client(address: str) -> Any:
    try:
        import distributed
    except ModuleNotFoundError:
        raise PoolError("--cluster needs Dask: pip install -r requirements-cluster.lock") from None
    where = {"scheduler_file": address} if address.endswith(".json") else {"address": address}
    if "scheduler_file" in where and not Path(address).is_file():
        raise PoolError(f"there is no scheduler file {address}")
    try:
        client = distributed.Client(**where, timeout=10.0)
        client.wait_for_workers(1, timeout=PATIENCE)
    except (OSError, TimeoutError, ValueError) as error:
        raise PoolError(f"no Dask cluster with workers at {address}: {' '.join(str(error).split())}") from None
    return client
