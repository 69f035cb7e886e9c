"""Times of runs are as fine in the sandbox as outside it."""

import os

from mbsbench.harness.base import clock
from mbsbench.harness.base.clock import cpu_seconds
from mbsbench.harness.base.forked_process import ForkedProcess

SPENT = 0.1  # [s] of CPU: 25 ticks of 4 ms
READINGS = 500  # at least, if it moves by less than 0.2 ms


def test_cpu_time_has_no_ticks_under_a_limit_on_it():
    """Under RLIMIT_CPU the process clock of Linux moves 25 times in a tenth of a second; runs may be shorter."""

    def target(send):
        began = last = cpu_seconds()
        seen = 0
        while last - began < SPENT:
            now = cpu_seconds()
            seen += now != last
            last = now
        send(str(seen))

    ended = ForkedProcess(target, limit=50.0, memory=500.0).wait()
    assert ended.code == 0 and int(ended.sent) > READINGS


def test_a_process_that_ends_while_it_is_looked_at_has_no_children(monkeypatch):
    """Its folder is listed, and gone when it is opened."""
    before = clock.list_descendants(os.getpid())
    own = os.listdir(f"/proc/{os.getpid()}/task")
    monkeypatch.setattr(os, "listdir", lambda folder: [*own, "0"])
    assert set(clock.list_descendants(os.getpid())) <= set(before)  # of earlier tests, some end meanwhile
    monkeypatch.undo()
    assert clock.list_descendants(2**22 + 1) == []
