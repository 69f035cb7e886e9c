"""Solvers that reach for the process above them: it is out of reach; where it is not, their own run alone is lost."""

import contextlib
import ctypes
import math
import os
import time

import psutil
import pytest

from mbsbench.harness.base import isolation
from mbsbench.harness.base.forked_process import CHUNK, MOST, ForkedProcess
from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.results import store
from mbsbench.harness.run import run, supervisor
from mbsbench.harness.run.job import Job
from mbsbench.tests.factories import PLUGIN

from ..conftest import HOSTILE
from ..hostile import ATTACKS

SUITE = '[[runs]]\nproblem = "free_fall"\nsolver = "attacks"\ncpu_limit = 3.0\noptions = {{ what = "{}" }}'
SIGNALS = ("kills", "stops", "leaves_child")
SCOPED = 6  # version of landlock that keeps signals in


def attacked(folder, what, **patches):
    """The record of such a run under a supervisor of its own, where ``patches`` replace functions of the sandbox."""
    store.create_folder(folder)
    spec = parse_suite(SUITE.format(what), "t", "t").specs[0]
    job = Job(spec, folder, plugins=(str(PLUGIN), str(HOSTILE)))
    job.stderr.parent.make_folder()

    def work(send):
        for name, function in patches.items():
            for module in (isolation, supervisor):
                if hasattr(module, name):
                    setattr(module, name, function)
        if patches:
            isolation._prctl(isolation.PR_SET_DUMPABLE, 1)
        run.SLACK = 0.5
        isolation.adopt_orphans()
        one = supervisor.Supervisor()
        one.start(job)
        done = []
        while not done:
            done = list(one.step(0.02))
        left = folder / "left"
        send(str(left.exists() and psutil.pid_exists(int(left.read_text()))))

    began = time.monotonic()
    ended = ForkedProcess(work, limit=60.0, memory=math.inf, wall=100.0).wait()
    assert ended.code == 0 and time.monotonic() - began < 60.0, ended
    return store.read_record(store.locate_record(folder, job.id)), ended.sent.strip()


def nothing():
    """A remedy switched off."""


@pytest.mark.parametrize("what", ATTACKS)
def test_the_process_above_a_solver_is_out_of_its_reach(tmp_path, what):
    """Its memory, its open files, and signals to it: the attempt fails, and the honest motion is judged."""
    version = ctypes.CDLL(None).syscall(isolation.CREATE_RULESET, None, ctypes.c_size_t(0), 1)
    if version < (SCOPED if what in SIGNALS else 1):
        pytest.skip("this kernel cannot keep a process from signalling others of its user")
    record, *_ = attacked(tmp_path / "run", what)
    assert record.status == "success", record


@pytest.mark.sampled(2)
@pytest.mark.parametrize("what", ATTACKS)
def test_what_reaches_it_all_the_same_loses_its_own_run_and_no_more(tmp_path, what):
    """Where no system keeps it in: no success is forged, no limit escaped, and kept steps are measured."""
    record, left = attacked(tmp_path / "run", what, isolate_process=nothing, protect_process=nothing)
    assert record.status not in ("success", "inaccurate") and left == "False", record
    if what in ("kills", "leaves_child"):
        assert record.ended_by == "killed"
    if what in (*SIGNALS, "forges_ending"):
        assert record.t_reached_s == 1.0 and record.position_error_max_m < 1e-12


def test_a_pipe_takes_no_more_than_a_run_has_to_say():
    """It is closed then: the process learns it at its next line, and nobody's memory fills."""
    ended = ForkedProcess(lambda send: [send("x" * 2**20) for _ in range(64)], limit=20.0, memory=500.0).wait()
    assert ended.code == 70 and MOST < len(ended.sent) <= MOST + CHUNK


@pytest.mark.parametrize("shut", [True, False])
def test_memory_and_files_are_shut_without_landlock_too(shut, monkeypatch):
    """A user without capabilities, as most are, opens nothing of a process that is not dumpable."""
    if os.getuid():
        pytest.skip("only root can become another user")
    monkeypatch.setattr(isolation, "isolate_process", nothing)

    def reach(send):
        os.setuid(65534)
        isolation._prctl(isolation.PR_SET_DUMPABLE, 1)
        if shut:
            isolation.protect_process()
        own = os.getpid()
        if os.fork() == 0:
            for part in ("fd/0", "mem"):
                with contextlib.suppress(PermissionError):
                    os.close(os.open(f"/proc/{own}/{part}", os.O_RDONLY))
                    send(part)
            os._exit(0)
        os.wait()

    ended = ForkedProcess(reach, limit=5.0, memory=500.0).wait()
    assert ended.sent.split() == ([] if shut else ["fd/0", "mem"])
