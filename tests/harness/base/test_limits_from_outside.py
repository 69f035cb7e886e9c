"""What ends before a solver begins is no result of it; lower limits from outside, as of batch systems, are kept."""

import errno
import math
import os
import resource
from pathlib import Path

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.base import isolation
from mbsbench.harness.base.code_meter import HARD
from mbsbench.harness.base.forked_process import ForkedProcess, NotBegunError
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.run.pool import MOST_UNBEGUN, LocalPool, PoolError
from mbsbench.harness.run.protocol import RunEnded
from mbsbench.harness.run.runner import Request, _make_jobs

SUITE = """[[runs]]
problem = "spherical_pendulum"
parameters = { t_end = 0.5 }
solver = "rattle"
dt = [0.01, 0.005]
"""
LIMITS = (resource.RLIMIT_FSIZE, resource.RLIMIT_DATA, resource.RLIMIT_CORE)


def limits_in_a_child(hard: int) -> list[list[int]]:
    """The limits of a process of ours whose parent was given ``hard`` [bytes] for files and data."""

    def inner(send) -> None:
        ended = ForkedProcess(
            lambda tell: tell(str([list(resource.getrlimit(k)) for k in LIMITS])), limit=10.0, memory=1e5
        ).wait()
        send(ended.unbegun or ended.sent.strip())

    def outer(send) -> None:
        for what in LIMITS[:2]:
            resource.setrlimit(what, (hard, hard))
        inner(send)

    ended = ForkedProcess(outer, limit=20.0, memory=math.inf).wait()
    assert not ended.unbegun
    return eval(ended.sent)  # of our own process


def test_a_lower_limit_from_outside_stays() -> None:
    """A user who may not raise it would be told so by the system: "not allowed to raise maximum limit"."""
    hard = 900 * 2**20
    assert hard < isolation.OUTPUT_LIMIT
    for soft, most in limits_in_a_child(hard):
        assert soft <= hard and most <= hard


def test_a_child_that_cannot_be_prepared_says_why(monkeypatch) -> None:
    """Its target never began, whatever its exit code; one that began and failed has no such words."""

    def fail(*_: object) -> None:
        raise PermissionError("not allowed")

    began = ForkedProcess(lambda send: fail(), limit=10.0, memory=1000.0).wait()
    assert began.code == 70 and not began.unbegun
    monkeypatch.setattr(isolation, "limit_process", fail)
    assert ForkedProcess(print, limit=10.0, memory=1000.0).wait_for_end().unbegun == "PermissionError: not allowed"
    with pytest.raises(NotBegunError, match="could not begin its work: PermissionError: not allowed"):
        ForkedProcess(print, limit=10.0, memory=1000.0).wait()


def test_what_a_target_sends_cannot_take_back_that_it_began() -> None:
    """A solver that fails cannot pass for one that never began."""
    ended = ForkedProcess(
        lambda send: (send("PermissionError: not allowed"), isolation.os._exit(71)), limit=10.0, memory=1e3
    ).wait()
    assert ended.code == 71 and not ended.unbegun and ended.sent == "PermissionError: not allowed\n"


@pytest.mark.sampled(0)
def test_a_run_that_cannot_begin_is_no_result(tmp_path: Path, capsys) -> None:
    """A folder stands where its standard error goes: the others have results, the command fails, --resume makes it."""
    suite, out = tmp_path / "two.toml", tmp_path / "two"
    suite.write_text(SUITE)
    first, second = (job.id for job in _make_jobs(Request(load_suite(str(suite)), out, 2), out, ""))
    blocked = out / "stderr" / f"{first}.txt"
    blocked.mkdir(parents=True)
    assert main(["run", str(suite), "--out", str(out)]) == 1
    said = capsys.readouterr().err
    assert "1 run could not begin, which says nothing of their solvers" in said and "run again with --resume" in said
    assert [p.stem for p in (out / "runs").iterdir()] == [second]
    blocked.rmdir()
    assert main(["run", str(suite), "--out", str(out), "--resume"]) == 0
    assert {p.stem for p in (out / "runs").iterdir()} == {first, second}


def test_three_in_a_row_end_the_suite() -> None:
    """Then no other would begin, either."""
    pool = LocalPool(1)
    pool._flying = dict.fromkeys("abc")  # type: ignore[assignment]
    for name in "ab":
        pool._apply_news(RunEnded(name, unbegun="no room"), 0)
    with pytest.raises(PoolError, match="3 runs could not begin"):
        pool._apply_news(RunEnded("c", unbegun="no room"), 0)
    assert MOST_UNBEGUN == 3


def test_a_file_as_large_as_a_limit_from_outside_is_a_full_disk(monkeypatch) -> None:
    """At our own limit it is the solver's doing."""
    error = OSError(errno.EFBIG, "File too large")
    for most, full in ((isolation.OUTPUT_LIMIT // 2, True), (isolation.OUTPUT_LIMIT, False)):
        monkeypatch.setattr(isolation.resource, "getrlimit", lambda what, most=most: (most, most))
        assert isolation.is_disk_full_error(error) is full


@pytest.mark.parametrize("code", [0.0, 100.0])
def test_the_time_for_code_is_what_is_asked_for(code: float) -> None:
    """The system's own limit is that of the solver, of code, and of what the meter leaves."""
    look = lambda send: send(str(resource.getrlimit(resource.RLIMIT_CPU)[1]))  # noqa: E731
    found = int(ForkedProcess(look, limit=7.0, memory=1e5, code=code).wait().sent)
    assert 7 + code <= found <= 7 + code + HARD + 3  # a child's own time begins at zero


def test_a_child_on_a_full_disk_never_returns_into_its_parents_loop(tmp_path: Path) -> None:
    """What it prints fails, and so does its traceback: it ends with the code of a full disk all the same."""

    def fill(send) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        while True:
            os.write(1, b"x" * 1000)

    own = os.getpid()
    ended = ForkedProcess(fill, limit=10.0, memory=1000.0, stderr=tmp_path / "stderr").wait()
    assert os.getpid() == own and ended.code == isolation.CANNOT_WRITE and not ended.unbegun
