"""Memory is limited for a run with all that it starts, and whatever kind it is; what is shared counts once.

Each attack holds a few hundred megabytes for some seconds at most.
"""

import math
import mmap
import os
import signal
import tempfile
import time

import pytest

from mbsbench.harness.base import isolation
from mbsbench.harness.base.forked_process import ForkedProcess, ProcessEnd
from mbsbench.harness.base.memory import measure_own_memory
from mbsbench.harness.results.words import describe_ending
from mbsbench.tests.factories import run_suite_text

LIMIT = 120.0  # [MB]
MB = 2**20
PIECE, PIECES = 60 * MB, 6  # each below the limit, all of them three times as much
PLUGIN = """
import mmap
import time
from mbsbench import accelerations, rhs

@rhs("shares")
def shares(system, state):
    held = [mmap.mmap(-1, 60 * 2**20) for _ in range(6)]
    for one in held:
        one.write(b"x" * len(one))
    time.sleep(20.0)
    return accelerations(system, state)

@rhs("honest")
def honest(system, state):
    return accelerations(system, state)
"""
SUITE = """
[[runs]]
problem = "spherical_pendulum"
solver = ["shares", "honest"]
rtol = 1e-8
cpu_limit = 10.0
memory = 120.0
parameters = { t_end = 0.1 }
"""


def count_pieces():
    """As many as are more than the limit and all that a fork of this process begins with, of which half may count."""
    return PIECES + math.ceil(measure_own_memory() * MB / PIECE)


def fill(buffer, size=PIECE):
    for at in range(0, size, mmap.PAGESIZE):
        buffer[at] = 1


def in_children(target):
    """Fork one a piece, and wait until all are killed."""
    for _ in range(count_pieces()):
        if os.fork() == 0:
            target()
            os._exit(0)
    time.sleep(30.0)


def share_anonymous():
    held = [mmap.mmap(-1, PIECE) for _ in range(count_pieces())]
    for one in held:
        fill(one)
    time.sleep(30.0)


def share_named():
    """As shm_open(3): a file in memory, gone by its name at once."""
    held = []
    for _ in range(count_pieces()):
        with tempfile.TemporaryFile(dir="/dev/shm") as file:
            file.truncate(PIECE)
            one = mmap.mmap(file.fileno(), PIECE)
        fill(one)
        held.append(one)
    time.sleep(30.0)


def share_unnamed():
    held = []
    for _ in range(count_pieces()):
        file = os.memfd_create("mbsbench")
        os.ftruncate(file, PIECE)
        one = mmap.mmap(file, PIECE)
        fill(one)
        held.append(one)
    time.sleep(30.0)


def hold_its_own():
    """As much as a piece, until it is killed."""
    held = bytearray(PIECE)
    fill(held)
    time.sleep(30.0)
    return held


def children_of_their_own():
    in_children(hold_its_own)


def children_in_sessions():
    """Not in its group any more, nor its children."""

    def leave():
        os.setsid()
        if os.fork() == 0:
            hold_its_own()
        os._exit(0)

    in_children(leave)


ATTACKS = (share_anonymous, share_named, share_unnamed, children_of_their_own, children_in_sessions)


@pytest.fixture(autouse=True)
def limited():
    """Skip where nothing is limited."""
    if isolation.describe_missing_protection():
        pytest.skip("memory is limited on Linux alone")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("attack", ATTACKS, ids=lambda a: a.__name__)
def test_memory_beyond_the_limit_ends_it_with_all_that_it_started(attack):
    """At the next look, not when its time is over."""
    began = time.monotonic()
    ended = ForkedProcess(lambda send: attack(), limit=20.0, memory=LIMIT, wall=25.0).wait()
    assert (ended.over, ended.killed, ended.code) == ("memory", True, -signal.SIGKILL), ended
    assert ended.peak > LIMIT and time.monotonic() - began < 20.0
    assert ended.describe_limit(20.0, LIMIT) == "took more than 120 MB"


def test_what_processes_share_counts_once():
    """An array that a fork inherits, and a segment that all have mapped: each in seven processes, within the limit."""

    def work(send):
        inherited, shared = bytearray(PIECE // 2), mmap.mmap(-1, PIECE // 2)
        fill(inherited, PIECE // 2)
        fill(shared, PIECE // 2)
        for _ in range(PIECES):
            if os.fork() == 0:
                read = sum(inherited[at] + shared[at] for at in range(0, PIECE // 2, mmap.PAGESIZE))
                time.sleep(2.0)
                os._exit(read == 0)
        for _ in range(PIECES):
            os.wait()
        send("done")

    ended = ForkedProcess(work, limit=20.0, memory=LIMIT, wall=60.0).wait()
    assert (ended.sent.strip(), ended.over, ended.code) == ("done", "", 0)


def test_without_a_limit_nothing_is_ended():
    """Infinite: none is kept."""
    ended = ForkedProcess(lambda send: [fill(mmap.mmap(-1, PIECE)), send("done")], limit=20.0, memory=math.inf).wait()
    assert (ended.sent.strip(), ended.code) == ("done", 0)


def test_a_run_that_shares_too_much_has_the_status_of_memory(tmp_path):
    """That run alone: the one beside it is judged."""
    plugin = tmp_path / "shares.py"
    plugin.write_text(PLUGIN)
    loaded, _ = run_suite_text(tmp_path / "run", SUITE, plugins=(plugin,))
    found = {r.solver: r for r in loaded.records}
    assert (found["shares"].status, found["shares"].ended_by) == ("memory", "memory_limit")
    words = describe_ending(found["shares"])
    assert "with all that it started, more than its limit of 120 MB" in words and "\n" not in words
    assert found["shares"].peak_memory_MB > LIMIT and found["honest"].status == "success"


@pytest.mark.parametrize(
    ("ended", "words"),
    [
        (ProcessEnd(-signal.SIGXCPU, False, "", 0.0), "timed out after 30 s"),
        (ProcessEnd(-signal.SIGKILL, True, "", 0.0, over="cpu"), "timed out after 30 s"),
        (ProcessEnd(-signal.SIGKILL, True, "", 0.0, over="memory"), "took more than 100 MB"),
        (ProcessEnd(-signal.SIGKILL, False, "", 0.0), ""),
        (ProcessEnd(0, False, "", 0.0), ""),
    ],
)
def test_the_end_at_a_limit_has_one_name(ended, words):
    """Whoever kept the limit, this process or the system."""
    assert ended.describe_limit(30.0, 100.0) == words and ended.at_limit == bool(words)
