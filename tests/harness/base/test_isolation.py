"""A solver that misbehaves costs its own run only."""

import os
import signal
import time

import psutil
import pytest

from mbsbench.harness.base.forked_process import ForkedProcess
from mbsbench.harness.base.isolation import describe_missing_protection, fork
from mbsbench.harness.mechanics.types import EndCause, Status
from mbsbench.harness.results import store
from mbsbench.harness.results.words import describe_ending, list_reasons
from mbsbench.tests.comparing import assert_same
from mbsbench.tests.factories import run_suite_text

LIMIT = 1.0  # [s]

BAD = [
    "raises",
    "exits",
    "segfaults",
    "spins",
    "not_numbers",
    "stops_early",
    "gives_up",
    "returns_nonsense",
    "chatters",
    "refuses",
]
SUITE = f"""
[[runs]]
problem = "free_fall"
solver = {[*BAD, "exact"]}
cpu_limit = {LIMIT}
[[runs]]
problem = "free_fall"
solver = "eats_memory"
cpu_limit = 20.0
memory = 300.0
[[runs]]
problem = "free_fall"
solver = "hangs_later"
options = {{ end = ["loop", "segfault", "raise"] }}
cpu_limit = {LIMIT}
"""
EXPECTED = {
    "raises": (Status.CRASHED, "RuntimeError: a bug of mine"),
    "exits": (Status.CRASHED, "code 0"),
    "segfaults": (Status.CRASHED, "SIGSEGV"),
    "spins": (Status.UNFINISHED, "CPU"),
    "not_numbers": (Status.WRONG, "not finite"),
    "stops_early": (Status.WRONG, "last step"),
    "gives_up": (Status.STEP_UNDERFLOW, "too small"),
    "returns_nonsense": (Status.CRASHED, "must return a Trajectory"),
    "chatters": (Status.CRASHED, "SystemExit: 3"),
    "refuses": (Status.REFUSED, "on principle"),
    "eats_memory": (Status.MEMORY, ""),
    "exact": (Status.SUCCESS, ""),
}


@pytest.fixture(scope="module")
def outcome(own_supervisor, tmp_path_factory):
    """All kinds in one run, shared by the tests below."""
    folder = tmp_path_factory.mktemp("bad") / "run"
    return folder, run_suite_text(folder, SUITE)[0]


@pytest.mark.slow
def test_a_run_that_waits_without_end_is_ended(tmp_path):
    """It uses no CPU time, so the limit on that never ends it: the net of wall time does."""
    text = '[[runs]]\nproblem = "free_fall"\nsolver = "sleeps"\noptions = { seconds = 600.0 }\ncpu_limit = 0.1\n'
    (record,) = run_suite_text(tmp_path / "run", text)[0].records
    assert record.status == Status.UNFINISHED and record.ended_by == EndCause.WALL_LIMIT, record


@pytest.mark.sampled(0)
@pytest.mark.parametrize("solver", EXPECTED)
def test_each_ends_as_its_own_row(outcome, solver):
    """Failures are results: a row each, with status and reason, within the limit and 5 s."""
    _, loaded = outcome
    (record,) = [r for r in loaded.records if r.solver == solver]
    status, words = EXPECTED[solver]
    assert record.status == status, record
    assert words in "; ".join(list_reasons(record))
    assert record.wall_s < record.wall_limit_s + 5.0
    assert "\n" not in record.message


def test_nothing_of_a_killed_run_goes_on(outcome):
    """The group is killed, so a child that a solver started dies with it."""
    ours = [
        p for p in psutil.process_iter(["cmdline"]) if "mbsbench.harness.run.supervisor" in (p.info["cmdline"] or [])
    ]
    assert not [p for p in ours if p.parent() is None or p.parent().pid in (1, os.getpid())]


def test_native_words_are_kept(outcome):
    """The last that a solver writes to descriptor 2 may be all there is to find out why it died."""
    folder, loaded = outcome
    (record,) = [r for r in loaded.records if r.solver == "segfaults"]
    assert "native words" in (folder / record.stderr).read_text()


def test_long_output_keeps_both_ends(outcome):
    """A megabyte of chatter becomes a file one can open."""
    folder, loaded = outcome
    (record,) = [r for r in loaded.records if r.solver == "chatters"]
    text = (folder / record.stderr).read_text()
    assert len(text) < 200_000 and "left out" in text and "SystemExit: 3" in text


def test_partial_motion_is_kept(outcome):
    """An honest failure hands back its steps, and they are measured like any other."""
    folder, loaded = outcome
    (record,) = [r for r in loaded.records if r.solver == "gives_up"]
    series = store.read_run_series(folder, record)
    assert series is not None and series["t"][-1] == record.t_reached_s == 1.0
    assert record.position_error_max_m < 1e-14


@pytest.mark.parametrize(
    ("end", "status", "words"),
    [
        ("", Status.UNFINISHED, "CPU"),
        ("[end=segfault]", Status.CRASHED, "SIGSEGV"),
        ("[end=raise]", Status.CRASHED, "after half"),
    ],
)
def test_steps_of_a_killed_run_are_kept(outcome, end, status, words):
    """A native loop that holds the interpreter, a segfault, an exception: what was handed over is measured."""
    folder, loaded = outcome
    (record,) = [r for r in loaded.records if r.case == f"free_fall hangs_later{end} dt=0.5"]
    assert record.status == status and words in describe_ending(record) and record.claimed == ""
    series = store.read_run_series(folder, record)
    assert series is not None and list(series["t"]) == [0.0, 0.5, 1.0] and record.t_reached_s == 1.0
    assert record.position_error_max_m < 1e-14 and record.wall_s < record.wall_limit_s + 5.0
    assert not list((folder / ".spool").glob("*.rows"))


def test_our_solvers_hand_their_steps_over(tmp_path, monkeypatch):
    """Both routes: what is on disk when the run ends is a beginning of what is handed back."""
    from mbsbench.harness.catalogue import registry
    from mbsbench.harness.mechanics.types import StepControl
    from mbsbench.harness.run import spool as spooling
    from mbsbench.harness.run.spool import FileSpool, read_spool

    monkeypatch.setattr(spooling, "EVERY", 0.0)  # no clock: a busy machine hands over more seldom
    monkeypatch.setattr(spooling, "SHARE", float("inf"))
    problem = registry.make_problem("spherical_pendulum", {"t_end": 1.0, "omega_z": 0.1})
    for name, step in (("gc_weak_form", {"dt": 1e-3}), ("rk45_strong_form", {"rtol": 1e-10})):
        spool = FileSpool(tmp_path / name)
        done = registry.make_solver(name).solve(problem, StepControl(**step, spool=spool))
        left = read_spool(spool.path, problem, Status.CRASHED, "x")
        assert left is not None and len(left.t) > 0.5 * len(done.t)
        assert_same(left.t, done.t[: len(left.t)])
        assert_same(left.states.v, done.states.v[: len(left.t)])


def test_fork_needs_a_single_thread():
    """A fork of a process with threads may copy a lock that nobody will release."""
    import threading

    stop = threading.Event()
    thread = threading.Thread(target=stop.wait)
    thread.start()
    try:
        with pytest.raises(ValueError, match="without threads"):
            fork(lambda tell: None, None, 1.0, 1.0)  # type: ignore[arg-type]
    finally:
        stop.set()
        thread.join()


def test_cpu_time_is_limited_too(tmp_path):
    """By rlimit (SIGXCPU), or by who watches, if it looks first; its run did not finish here, in words."""
    from mbsbench.harness.catalogue.suites.suite import parse_suite
    from mbsbench.harness.run.job import Job, record_unfinished

    def work(tell):
        while True:
            pass

    began = time.monotonic()
    ended = ForkedProcess(work, limit=0.0, memory=500.0, wall=60.0).wait()  # [s], rounded up to the next whole one
    assert (ended.code == -signal.SIGXCPU or ended.over == "cpu") and time.monotonic() - began > 0.9
    job = Job(parse_suite('[[runs]]\nproblem = "free_fall"\nsolver = "exact"', "t", "t").specs[0], tmp_path)
    record = record_unfinished(job, ended, 1.0, EndCause.WALL_LIMIT, 60.0)
    assert record.status == Status.UNFINISHED and record.ended_by == EndCause.CPU_LIMIT


def test_garbage_in_the_pipe_of_a_run_costs_that_run_alone(tmp_path):
    """A solver can find its parent's pipe: what is no record is left out, and how the process ended is the record."""
    from mbsbench.harness.catalogue.suites.suite import parse_suite
    from mbsbench.harness.run.job import Job
    from mbsbench.harness.run.run import RunProcess
    from mbsbench.harness.run.supervisor import read_outcome

    def work(send):
        send("measuring garbage")
        os.kill(os.getpid(), signal.SIGSEGV)

    job = Job(parse_suite('[[runs]]\nproblem = "free_fall"\nsolver = "exact"', "t", "t").specs[0], tmp_path)
    run = RunProcess(job, work)
    record, stored = read_outcome(run, run.wait())
    assert not stored and record.status == Status.CRASHED and record.ended_by == EndCause.SIGNAL


def test_a_process_is_ended_with_all_that_it_started_and_what_it_sent_is_kept(begun_here):
    """At its limit, when it is unwanted, and when its parent is interrupted."""

    def hang(send):
        send("began")
        if os.fork() == 0:
            time.sleep(600.0)
        send(str(os.getpid()))
        time.sleep(600.0)

    def interrupted():
        raise KeyboardInterrupt

    began = time.monotonic()
    ended = ForkedProcess(hang, limit=5.0, memory=500.0, wall=0.5).wait()
    assert ended.killed and ended.code == -signal.SIGKILL and ended.sent.startswith("began\n")
    assert ForkedProcess(hang, limit=60.0, memory=500.0).wait(lambda: True).killed
    with pytest.raises(KeyboardInterrupt):
        ForkedProcess(hang, limit=60.0, memory=500.0).wait(interrupted)
    assert time.monotonic() - began < 30.0 and not begun_here()


def test_a_long_message_arrives_whole():
    """Longer than a pipe holds."""
    ended = ForkedProcess(lambda send: send("x" * 2**20), limit=60.0, memory=500.0).wait()
    assert ended.sent == "x" * 2**20 + "\n" and ended.code == 0 and ended.words == "exited with code 0"


def test_a_run_ends_with_its_parent(tmp_path):
    """Even by SIGKILL, which no ``finally`` sees: nobody is left who could end it at its limits."""
    middle = os.fork()
    if not middle:
        try:
            child, _ = fork(lambda tell: time.sleep(600.0), tmp_path / "stderr", 500.0, 60.0)
            (tmp_path / "pid").write_text(str(child))
        finally:
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(middle, 0)
    pid, until = int((tmp_path / "pid").read_text()), time.monotonic() + 10.0
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != "zombie" and time.monotonic() < until:
        time.sleep(0.02)
    assert not psutil.pid_exists(pid) or psutil.Process(pid).status() == "zombie"


def test_another_system_is_told_what_it_lacks():
    """One line, which no suite prints on Linux."""
    assert describe_missing_protection("linux") == ""
    for system in ("darwin", "freebsd14"):
        words = describe_missing_protection(system)
        assert "memory is not limited" in words and "\n" not in words
