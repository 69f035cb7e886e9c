"""The meter of code counts what is made, once, where it is made; the clock of solvers stands still meanwhile."""

import ast
import contextlib
import math
import resource
import signal
import threading
import time
from pathlib import Path

import pytest

from mbsbench.harness.base import code_meter
from mbsbench.harness.base.code_meter import (
    CodePage,
    CodeReading,
    Stopwatch,
    add_code_below,
    code_seconds,
    is_making_code,
    listen_to_numba,
    making_code,
    prepare_child_page,
)
from mbsbench.harness.base.forked_process import ForkedProcess

WORK = 0.2  # [s] of CPU
FINE = 0.02  # [s]: a tenth of it, on a machine that does other work


def work(seconds: float = WORK) -> float:
    """Use that much CPU time in this thread, and return what was used: on a busy machine some more."""
    begin = time.thread_time()
    while (used := time.thread_time() - begin) < seconds:
        pass
    return used


@contextlib.contextmanager
def block():
    """``making_code``, which tests may not use."""
    code_meter._open_block()
    try:
        yield
    finally:
        code_meter._close_block()


def test_the_clock_of_solvers_stands_still_while_code_is_made():
    """Nested blocks count once; what is done outside counts for the solver alone."""
    watch = Stopwatch()
    work()
    with block(), block():
        work()
        inside = watch.code
        assert is_making_code() and watch.solver == pytest.approx(WORK, abs=FINE)
    assert not is_making_code() and inside == pytest.approx(WORK, abs=FINE)
    assert watch.code == pytest.approx(WORK, abs=FINE) and watch.solver == pytest.approx(WORK, abs=FINE)


def test_a_block_that_raises_is_closed():
    """Otherwise all that follows would be code."""
    with pytest.raises(ZeroDivisionError), block():
        _ = 1 / 0
    assert not is_making_code()


def test_other_threads_work_for_the_solver():
    """A thread that makes code hides nothing of what another one computes."""
    watch = Stopwatch()
    other = threading.Thread(target=work)
    with block():
        other.start()
        other.join()
    assert watch.code < FINE and watch.solver == pytest.approx(WORK, abs=FINE)


def test_a_fork_begins_at_zero():
    """Its CPU time does, too: what its parent has made is no part of it."""
    with block():
        work(0.05)

    def target(send):
        send(str(code_seconds()))

    assert code_seconds() > 0.04 and float(ForkedProcess(target, limit=5.0, memory=500.0).wait().sent) == 0.0


def test_what_numba_compiles_is_counted_without_its_author_knowing():
    """By numba's events: also what a plugin compiles at its first call."""
    import numba

    listen_to_numba()

    @numba.njit
    def cube(x: float) -> float:
        return x * x * x

    watch = Stopwatch()
    assert cube(3.0) == 27.0
    assert watch.code > 10.0 * watch.solver
    before = watch.code
    assert cube(2.0) == 8.0 and watch.code == before


def test_others_may_not_use_the_meter():
    """A plugin says what its set-up takes; only the harness's own code is known to make code."""
    space = {"__name__": "myplugin", "making_code": making_code}
    with pytest.raises(RuntimeError, match="is for mbsbench itself: return setup_time instead"):
        exec("with making_code:\n    pass", space)
    with pytest.raises(RuntimeError, match="is for mbsbench itself"):
        exec("@making_code\ndef work(): pass", space)
    assert not is_making_code()


def test_a_page_tells_what_is_made_while_it_is_made():
    """What a process has used since it began to make code is for code; nonsense is nothing, or over every limit."""
    page = CodePage()
    whole, below = CodeReading(page), CodeReading(page, 1)
    page.report(0, 3.0)
    assert whole.read_seconds(3.5) == 3.0 and not whole.is_making()
    page.report(0, 3.0, since=4.0)
    assert whole.read_seconds(10.0) == 9.0 and whole.is_making()
    page.report(1, 1.0)
    assert whole.read_seconds(10.0) == 10.0 and below.read_seconds(10.0) == 1.0
    for nonsense in (math.nan, -1.0):
        page.report(1, nonsense, since=nonsense)
        assert below.read_seconds(10.0) == 0.0
    page.report(1, math.inf)
    assert below.read_seconds(10.0) == math.inf


def test_an_open_block_holds_nothing_that_other_processes_used_before_it():
    """A young process begins to make code once its elder has used a minute: it has taken what is used from then on."""
    page = CodePage()
    reading = CodeReading(page)
    assert reading.read_seconds(60.0) == 0.0
    page.report(1, 0.0, since=0.1)
    assert reading.read_seconds(60.5) == 0.5 and reading.read_seconds(62.0) == 2.0
    page.report(1, 1.9)
    assert reading.read_seconds(62.5) == 1.9
    page.report(1, 1.9, since=2.5)
    assert reading.read_seconds(63.0) == pytest.approx(1.9 + 0.5)


def test_code_made_below_is_reported_at_once(monkeypatch):
    """Not at the end of the next block, which may never come."""
    page, slot = prepare_child_page()
    monkeypatch.setattr(code_meter, "_process", code_meter._Process(page=page, slot=slot))
    add_code_below(2.0)
    assert CodeReading(page).read_seconds(10.0) == 2.0


@pytest.mark.parametrize("how", ["reports", "ends while it makes code"])
def test_code_takes_no_more_than_the_process(how):
    """By what the system counts, whatever the process says of itself."""

    def target(send):
        page, slot = code_meter._process.page, code_meter._process.slot
        page.report(slot, 1e5 if how == "reports" else 0.0, since=-1.0 if how == "reports" else 0.0)

    ended = ForkedProcess(target, limit=5.0, memory=500.0, code=1e6).wait()
    assert ended.code == 0 and 0.0 <= ended.code_s <= ended.cpu


@pytest.mark.beyond_core
def test_processes_that_make_code_have_an_allowance_for_it():
    """Wherever a solver or a user's force may run; else an empty cache ends what a full one does not."""
    without = set()
    for path in Path(code_meter.__file__).parents[1].rglob("*.py"):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "ForkedProcess":
                limit = next(ast.unparse(k.value) for k in call.keywords if k.arg == "limit")
                without |= {(path.stem, limit)} if all(k.arg != "code" for k in call.keywords) else set()
    assert without == {
        ("fmu", "LIMIT"),  # native code that its author has compiled
        ("submission", "CPU_LIMIT"),  # a submission's limit holds for all (docs/trust.md)
        ("clouds", "100000000.0"),  # no limit
        ("bundling", "CHECK_LIMIT"),  # the checker, which makes no code
    }


def test_numba_is_heard_in_a_process_that_has_an_allowance():
    """Without a word from its target."""

    def target(send):
        import numba.core.event

        with numba.core.event.trigger_event("numba:compile"):
            work()

    assert ForkedProcess(target, limit=5.0, memory=500.0, code=10.0).wait().code_s == pytest.approx(WORK, abs=FINE)


def test_pages_of_processes_above_one_another_are_one(monkeypatch):
    """So that who limits a run sees what its solver makes, two processes below."""
    page, slot = prepare_child_page()
    monkeypatch.setattr(code_meter, "_process", code_meter._Process(page=page, slot=slot))
    below, place = prepare_child_page()
    assert below is page and (slot, place) == (0, 1)


def test_neither_limit_counts_code():
    """A second of CPU is allowed, and as much again goes into code: neither the parent nor the system ends it."""

    def target(send):
        used = 0.0
        for _ in range(2):
            with block():
                used += work(1.5)
        work(0.3)
        send(str(used))

    ended = ForkedProcess(target, limit=1.0, memory=500.0, code=10.0).wait()
    assert (ended.code, ended.over) == (0, "")
    assert ended.code_s == pytest.approx(float(ended.sent), abs=FINE) and ended.cpu > 3.3 - FINE


def test_the_system_ends_a_solver_at_its_own_limit():
    """RLIMIT_CPU moves by what was made, and no further: it holds where nobody looks."""

    def target(send):
        with block():
            work(1.5)
        send(str(resource.getrlimit(resource.RLIMIT_CPU)[0]))

    ended = ForkedProcess(target, limit=2.0, memory=500.0, code=100.0).wait()
    assert 4 <= int(ended.sent) <= 5  # of 2 s from its start, rounded up, and 1.5 s rounded up


@pytest.mark.parametrize("how", ["computes", "sleeps"])
def test_who_says_that_it_makes_code_without_end_is_ended(how):
    """By the limit on code where it computes, by that on wall time where it does not: a false block buys no more."""

    def target(send):
        code_meter._open_block()
        work(60.0) if how == "computes" else time.sleep(60.0)

    began = time.monotonic()
    ended = ForkedProcess(target, limit=0.2, memory=500.0, code=1.0, wall=math.inf if how == "computes" else 1.0).wait()
    assert ended.killed or ended.code == -signal.SIGXCPU  # the system keeps the same limit, and may be first
    assert ended.over == {"computes": "code", "sleeps": "wall"}[how]
    assert time.monotonic() - began < 40.0 and ended.cpu < 5.0


def test_a_process_that_reports_nothing_has_its_limit():
    """Without an allowance for code a block changes no limit."""

    def target(send):
        code_meter._open_block()
        work(60.0)

    ended = ForkedProcess(target, limit=0.3, memory=500.0).wait()
    assert ended.code != 0 and ended.code_s == 0.0 and ended.cpu < 5.0
