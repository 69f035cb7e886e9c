"""Runs on a real Dask scheduler with two workers, one of which is killed: every run has its row all the same."""

import os
import signal
import subprocess
import sys
import time
from unittest.mock import MagicMock

import pytest

from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.words import describe_ending
from mbsbench.harness.run.job import Job
from mbsbench.harness.run.pool import PoolError
from mbsbench.harness.run.runner import Request, choose_pool, run_suite
from mbsbench.tests.factories import PLUGIN, Silent

from ..conftest import TIMED

distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
from mbsbench.harness.run import cluster as cluster_module  # noqa: E402
from mbsbench.harness.run.cluster import DaskPool  # noqa: E402

SECONDS = ", ".join(f"0.{k}" for k in range(20, 36))
TEXT = f"""
[[runs]]
problem = "free_fall"
solver = "sleeps"
options = {{ seconds = [{SECONDS}] }}
[[runs]]
problem = "free_fall"
solver = ["segfaults", "gives_up", "refuses", "spins"]
cpu_limit = 1.0
"""


@pytest.fixture
def cluster(tmp_path):
    """A scheduler file and the workers' processes."""
    file = tmp_path / "scheduler.json"
    environment = dict(os.environ)

    def start(*arguments):
        line = (sys.executable, "-m", *arguments)
        quiet = subprocess.DEVNULL
        return subprocess.Popen(line, cwd=tmp_path, env=environment, stdout=quiet, stderr=quiet)

    serving = ("--port", "0", "--scheduler-file", str(file), "--no-dashboard")
    started = [start("distributed.cli.dask_scheduler", *serving)]
    until = time.monotonic() + 30.0
    while not file.exists() and time.monotonic() < until:
        time.sleep(0.1)
    one = ("--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard")
    started += [start("distributed.cli.dask_worker", *one) for _ in range(2)]
    yield file, started[1:]
    for process in started:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_killed_worker_costs_nothing(cluster, tmp_path):
    """SIGKILL to one of two workers in mid-run: the table is that of this machine's own pool."""
    file, workers = cluster
    suite = parse_suite(TEXT, "test", "test", plugins=(str(PLUGIN),))

    class Killer(Silent):
        def on_end(self, job, record):
            super().on_end(job, record)
            if len(self.ran) == 4:
                workers[0].send_signal(signal.SIGKILL)

    watcher = Killer()
    far = run_suite(Request(suite, tmp_path / "far", 2, pool=choose_pool(str(file))), watcher)
    assert workers[0].wait(timeout=10) == -signal.SIGKILL and len(watcher.ran) == 20
    near = run_suite(Request(suite, tmp_path / "near", 2), Silent())
    a, b = (store.table(x.records).drop(columns=TIMED) for x in (far, near))
    assert a.equals(b)
    stderr = next(r.stderr for r in far.records if r.solver == "segfaults")
    assert "native words" in (tmp_path / "far" / stderr).read_text()
    assert not store.load(tmp_path / "far").unreadable


def test_no_cluster_is_reported_in_one_line(tmp_path, monkeypatch):
    """Nobody listens, or the file is not there."""
    with pytest.raises(PoolError, match="scheduler file"):
        DaskPool(str(tmp_path / "x.json")).run([object()])  # type: ignore[list-item]


def test_a_disk_that_is_full_here_is_no_fault_of_the_cluster(tmp_path):
    """A result that cannot be written is reported with its folder, and no rest is left."""
    suite = parse_suite(TEXT, "test", "test", plugins=(str(PLUGIN),))
    job = Job(suite.specs[0], tmp_path / "gone")
    with pytest.raises(PoolError, match=r"cannot write to .*gone: No such file"):
        cluster_module._store_files(job, {"runs/x.json": b""})
    pool = DaskPool("nowhere")
    pool._collect = lambda: cluster_module._store_files(job, {"runs/x.json": b""})  # type: ignore[method-assign]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cluster_module, "_connect_client", lambda address: MagicMock(nthreads=lambda: {"w": 1}))
        with pytest.raises(PoolError, match="cannot write"):
            pool.run([job])


def test_slurm_is_given_the_right_job(tmp_path, monkeypatch):
    """No SLURM is needed to see the script: one thread, one run at a time, this checkout, this Python, our options."""
    pytest.importorskip("dask_jobqueue", reason="needs the extra 'cluster'")
    from mbsbench.harness.base.machine import THREADS
    from mbsbench.harness.run.cluster import on_slurm

    monkeypatch.setenv("PATH", "")  # no sbatch, which would ask a SLURM
    quiet = {"dashboard_address": None, "host": "127.0.0.1"}
    cluster = on_slurm(queue="short", walltime="00:30:00", log_directory=str(tmp_path), scheduler_options=quiet)
    try:
        lines = cluster.job_script().splitlines()
        address = cluster.scheduler_address
    finally:
        cluster.close()
    for words in ("#SBATCH -p short", "#SBATCH -t 00:30:00", "#SBATCH --cpus-per-task=1", f"cd {ROOT}"):
        assert words in lines
    assert all(f"export {name}={value}" in lines for name, value in THREADS.items())
    (worker,) = [line for line in lines if "dask_worker" in line]
    assert worker.startswith(sys.executable) and address in worker and "--nthreads 1" in worker
    assert lines.index(f"cd {ROOT}") < lines.index(worker)


@pytest.mark.slow
def test_a_limit_on_the_whole_run_reaches_the_workers(cluster, tmp_path):
    """Two runs that never return are ended where they run; what has not begun there comes back without a record."""
    file, _ = cluster
    text = 'total_limit = 12\n[[runs]]\nproblem = "free_fall"\nsolver = "spins"\ncpu_limit = [100]\n'
    text = text.replace("cpu_limit = [100]", "cpu_limit = 100\ndt = [0.1, 0.2, 0.25, 0.5, 1.0, 2.0]")
    suite = parse_suite(text, "test", "test", plugins=(str(PLUGIN),))
    watcher = Silent()
    began = time.monotonic()
    done = run_suite(Request(suite, tmp_path / "run", 2, pool=choose_pool(str(file))), watcher)
    assert time.monotonic() - began < 60.0
    assert len(done.records) == 2 and all("total_limit of 12 s" in describe_ending(r) for r in done.records)
    assert {r.status for r in done.records} == {"unfinished"} and len(watcher.left) == 4
