"""A worker's run, without a cluster: the files of its result, or none after the limit."""

import threading
import time

from mbsbench.harness.execution import cluster
from mbsbench.harness.execution.job import Job
from mbsbench.harness.results import store
from mbsbench.harness.results.codes import code_of
from mbsbench.harness.suites.suite import parse_suite

from ..conftest import PLUGIN

TEXT = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "raises", "spins"]\ncpu_limit = 100\n'


def test_a_worker_runs_a_run_and_ends_it_at_the_limit_of_the_suite(tmp_path):
    """Two runs one after the other in one supervisor; the third never returns and is ended from another thread."""
    store.create(tmp_path)
    plugins = (str(PLUGIN),)
    suite = parse_suite(TEXT, "test", "test", plugins=plugins)
    codes_of = [code_of(s.problem, s.solver, plugins) for s in suite.specs]
    jobs = [
        Job(s, tmp_path, "test", code, "", plugins, total_limit=7.0).to_json()
        for s, code in zip(suite.specs, codes_of, strict=True)
    ]

    def ends(text: str):
        job = Job.from_json(text)
        cluster._store(job, cluster.run_run(text, "ticket"))
        return store.read_record(tmp_path / "runs" / f"{job.id}.json")

    try:
        assert [ends(text).status for text in jobs[:2]] == ["success", "crashed"]
        threading.Thread(target=lambda: (time.sleep(1.0), cluster.stop_here("ticket"))).start()
        last = ends(jobs[2])
        assert last.ended_by == "total_limit" and last.ended_limit_s == 7.0 and last.status == "unfinished"
        assert cluster.run_run(jobs[0], "ticket") == {}
    finally:
        cluster._supervisor().close()
