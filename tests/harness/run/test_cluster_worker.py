"""A worker's run, without a cluster: the files of its result, or none after the limit."""

import sys
import threading
import time
from concurrent.futures import Future
from dataclasses import replace
from types import ModuleType

import pytest

from mbsbench.harness.catalogue.codes import digest_run_code
from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.results import store
from mbsbench.harness.run import cluster
from mbsbench.harness.run.job import Job
from mbsbench.harness.run.pool import PoolError
from mbsbench.harness.run.protocol import RunEnded
from mbsbench.harness.run.runner import Request, choose_pool, run_suite
from mbsbench.tests.factories import PLUGIN, Silent

TEXT = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "raises", "spins"]\ncpu_limit = 100\n'


@pytest.mark.sampled(0)
def test_a_worker_runs_a_run_and_ends_it_at_the_limit_of_the_suite(tmp_path):
    """Two runs one after the other in one supervisor; the third never returns and is ended from another thread."""
    store.create_folder(tmp_path)
    plugins = (str(PLUGIN),)
    suite = parse_suite(TEXT, "test", "test", plugins=plugins)
    codes_of = [digest_run_code(s.problem, s.solver, plugins) for s in suite.specs]
    jobs = [
        Job(s, tmp_path, "test", code, "", plugins, total_limit=7.0).to_json()
        for s, code in zip(suite.specs, codes_of, strict=True)
    ]

    def ends(text: str):
        job = Job.from_json(text)
        cluster._store_files(job, cluster.run_job(text, "ticket").files)
        return store.read_record(tmp_path / "runs" / f"{job.id}.json")

    try:
        assert [ends(text).status for text in jobs[:2]] == ["success", "crashed"]
        threading.Thread(target=lambda: (time.sleep(1.0), cluster.stop_ticket("ticket"))).start()
        last = ends(jobs[2])
        assert last.ended_by == "total_limit" and last.ended_limit_s == 7.0 and last.status == "unfinished"
        assert cluster.run_job(jobs[0], "ticket") == cluster.WorkerResult()
    finally:
        cluster._provide_supervisor().close()


class FakeCluster:
    """A Dask client and its module: each run is over when it is submitted."""

    def __init__(self, monkeypatch):
        module = ModuleType("distributed")
        module.wait = lambda *_, **__: None  # type: ignore[attr-defined]
        module.KilledWorker = LookupError  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "distributed", module)
        monkeypatch.setattr(cluster, "_connect_client", lambda address: self)

    def nthreads(self):
        return {"worker": 1}

    def submit(self, function, *arguments, **_):
        future = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future

    def run(self, *_):
        """Stop nothing."""

    def close(self):
        """Close nothing."""


def lay(folder, name, text="{}"):
    (folder / "runs" / name).write_text(text)


def change(folder, job):
    path = folder / "runs" / f"{job.id}.json"
    path.write_text(path.read_text().replace("success", "refused"))


HOSTILE = {  # what the first run does in the folder of its worker: how many results there are, and what is said
    "another run's record": (lambda folder, job, others: lay(folder, f"{others[0].id}.json"), 2, "exact.*wrote runs/"),
    "another run's series": (
        lambda folder, job, others: (folder / "series" / f"{others[0].id}.npz").write_bytes(b""),
        2,
        "wrote series/",
    ),
    "its own record": (lambda folder, job, others: change(folder, job), 1, "wrote runs/"),
    "no record": (lambda folder, job, others: (folder / "runs" / f"{job.id}.json").unlink(), 1, "no result in"),
    "nothing: it cannot begin": (None, 1, "1 run could not begin, which says nothing of their solvers: no room"),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("how", HOSTILE)
def test_one_run_costs_a_clusters_suite_no_other(tmp_path, monkeypatch, how):
    """The others are run and kept; what it wrote elsewhere is not taken, and is told at the end."""
    FakeCluster(monkeypatch)
    act, count, words = HOSTILE[how]
    text = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "gives_up"]'
    suite = parse_suite(text, "test", "test", plugins=(str(PLUGIN),))
    honest, begun = cluster._Supervisor.run, []

    def run(self, job):
        begun.append(job)
        if len(begun) > 1:
            return honest(self, job)
        if act is None:
            return RunEnded(job.id, unbegun="no room")
        told = honest(self, job)
        other = next(s for s in suite.specs if s.solver != job.spec.solver)
        act(
            job.folder,
            job,
            [replace(job, spec=other, code=digest_run_code(other.problem, other.solver, suite.plugins))],
        )
        return told

    monkeypatch.setattr(cluster._Supervisor, "run", run)
    request = Request(suite, tmp_path / "run", 1, pool=choose_pool(""))
    try:
        with pytest.raises(PoolError, match=words):
            run_suite(request, Silent())
        assert len(begun) == 2 and len(store.load(request.folder).records) == count
        done = run_suite(replace(request, resume=True), Silent())
    finally:
        cluster._provide_supervisor().close()
    assert {r.status for r in done.records} == {"success", "step_underflow"} and len(begun) == 4 - count
