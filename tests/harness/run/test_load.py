"""No result depends on what else the machine does: limits are on CPU time."""

import dataclasses
import multiprocessing
import os
import time

import pytest

from mbsbench.tests.factories import PLUGIN, run_suite_text

from .. import cheating

BUSY = 2  # processes a core that do nothing but work
LONGEST = 120.0  # [s] after which they end by themselves
SUITE = """
[[runs]]
problem = "free_fall"
solver = "cheats"
cpu_limit = 1.5
options = { where = ["call", "daemon"] }
[[runs]]
problem = "free_fall"
solver = "spins"
cpu_limit = 0.4
"""


def spin(until: float) -> None:
    while time.monotonic() < until:
        pass


@pytest.fixture(params=[1, pytest.param(0, marks=pytest.mark.slow)], ids=["one core", "all cores"])
def busy(request, own_supervisor):
    """Have so many cores (0: all) for the test and what it starts, each wanted by ``BUSY`` others: their number."""
    until, cores = time.monotonic() + LONGEST, os.sched_getaffinity(0)
    own = set(sorted(cores)[: request.param or None])
    os.sched_setaffinity(0, own)
    context = multiprocessing.get_context("fork")
    others = [context.Process(target=spin, args=(until,), daemon=True) for _ in range(BUSY * len(own))]
    for p in others:
        p.start()
    yield len(own)
    os.sched_setaffinity(0, cores)
    for p in others:
        p.terminate()
        p.join()


def ends(folder, jobs):
    found = run_suite_text(folder, SUITE, jobs, plugins=(PLUGIN, cheating.__file__))[0].records
    return {r.solver + r.solver_options: r.status for r in found}


@pytest.mark.sampled(0)
def test_a_busy_machine_changes_no_status(tmp_path, busy):
    """Each run gets a third of a core or less: what needs half of its CPU time ends well, however long it waits."""
    status = ends(tmp_path / "run", 2 * busy)
    assert status == {"cheats{}": "success", 'cheats{"where": "daemon"}': "success", "spins{}": "unfinished"}


def test_what_the_harness_ended_is_in_no_count():
    """Not in those of pages and tables, and no mark against its solver."""
    from mbsbench.harness.results.records import RunRecord
    from mbsbench.harness.results.words import list_reasons
    from mbsbench.reports.model.results import StoredRun
    from mbsbench.reports.model.scores import count_outcomes
    from mbsbench.reports.model.words import mark_status

    good = RunRecord(run_id="a", solver="alpha", status="success", claimed="success", ended_by="solver")
    cut = dataclasses.replace(
        good,
        run_id="b",
        status="unfinished",
        claimed="stalled",
        ended_by="cpu_limit",
        message="CPU limit of 60 s reached at t = 3 s",
    )
    counted = count_outcomes([StoredRun(good), StoredRun(cut)])
    assert (counted.runs, counted.succeeded, counted.stopped) == (1, 1, 0) and counted.words == "1 succeeded"
    assert mark_status("unfinished").word == "not finished here" and list_reasons(cut)[0].startswith(
        "not finished here: CPU limit"
    )
