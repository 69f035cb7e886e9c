"""A plugin: solvers whose motion is right, and whose work is done where nobody might look for it."""

import contextlib
import dataclasses
import math
import os
import resource
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numba.core.event

from mbsbench import Problem, StepControl, Trajectory, option, solver
from mbsbench.harness.base import code_meter
from mbsbench.harness.run import worker
from mbsbench.tests.harness.misbehaving import Exact

WORK = 0.3  # [s] of CPU that the motion is said to need
ABSURD = 1e5  # [s]: more than any run takes
MUCH = 1.8  # [s] where the system itself does not account for it, and it is looked at from outside, now and then


def work(seconds: float = WORK) -> None:
    """Use that much CPU time."""
    began = time.thread_time()
    while time.thread_time() - began < seconds:
        pass


def apart(detached: bool, seconds: float = WORK, twice: bool = False) -> int:
    """The reading end of a pipe that closes when the work is done in another process."""
    read, write = os.pipe()
    if os.fork():
        os.close(write)
        if detached and not twice:
            os.wait()
        return read
    os.close(read)
    if detached:
        os.setsid()
        if os.fork():
            os._exit(0)
    work(seconds)
    os._exit(0)


def _compile() -> Callable[[float], float]:
    """A function that numba compiles when it is called, at its honest price."""

    @numba.njit
    def fourth(x: float) -> float:
        total = 0.0
        for k in range(4):
            total += x**k + math.sin(k * x)
        return total

    return fourth  # type: ignore[no-any-return]


def report_code(seconds: float) -> None:
    """Hand over ``code_s`` of that many seconds, whatever the meter has counted."""
    exact = worker._format_costs
    worker._format_costs = lambda cost: exact({**cost, "code_s": seconds})


DONE: set[int] = set()  # processes in which the work was done already


@solver("cheats")
@dataclass(frozen=True)
class Cheats(Exact):
    """One solver for all."""

    where: str = option(
        "call",
        "where it works",
        choices=(
            "call",
            "refuses",
            "daemon",
            "daemon_in_refuses",
            "child",
            "disowned",
            "clocks",
            "half",
            "set_up",
            "first",
            "file",
            "block",
            "numba_event",
            "compiler",
            "report",
            "absurd_report",
        ),
    )

    def refuses(self, p: Problem, control: StepControl) -> str | None:
        if self.where == "refuses":
            work()
        if self.where == "file":
            work()
            control.spool.path.with_suffix(".kept").write_text("all")  # type: ignore[union-attr]
        if self.where == "daemon_in_refuses":
            object.__setattr__(self, "_ready", apart(detached=True))
        if self.where == "clocks":
            known = {who: resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)}
            resource.getrusage = known.__getitem__  # type: ignore[assignment]
        return None

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        cost = {"cpu_time": float("nan")}
        if self.where in ("call", "half", "set_up"):
            work()
            cost = {"half": {"cpu_time": 0.5 * WORK}, "set_up": {"setup_time": WORK}}.get(self.where, cost)
        if self.where == "block":
            code_meter._open_block()
            work()
            code_meter._close_block()
        if self.where == "numba_event":
            with numba.core.event.trigger_event("numba:compile"):
                work()
        if self.where == "compiler":
            _compile()(1.0)
            work()
        if self.where == "report":
            work()
            report_code(WORK)
        if self.where == "absurd_report":
            report_code(ABSURD)
        if self.where == "clocks":
            work(MUCH)
        if self.where == "daemon":
            os.read(apart(detached=True), 1)
        if self.where == "daemon_in_refuses":
            os.read(self._ready, 1)  # type: ignore[attr-defined]
        if self.where == "child":
            os.read(apart(detached=False), 1)
        if self.where == "disowned":
            signal.signal(signal.SIGCHLD, signal.SIG_IGN)
            os.read(apart(detached=False, seconds=MUCH), 1)
            with contextlib.suppress(ChildProcessError):  # until it has ended: one that is seen is accounted for
                os.wait()
        if self.where == "first" and os.getpid() not in DONE:
            DONE.add(os.getpid())
            work()
        return dataclasses.replace(super().solve(p, control), **cost)
