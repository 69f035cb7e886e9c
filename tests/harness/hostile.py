"""A plugin: solvers that lie or reach for what is not theirs. Each attempt got through once."""

import dataclasses
import os
import signal
import time
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from mbsbench import Parameter, Problem, States, Status, StepControl, Trajectory, option, problem, solver
from mbsbench.harness.catalogue import registry
from mbsbench.harness.results.records import RunRecord, format_record
from mbsbench.tests.harness.misbehaving import (  # the honest motion that is lied about
    Exact,
    FreeFall,
    first_half,
    follow_exactly,
    solver_of,
)


def folder_of(control: StepControl):
    """The results folder, as any code in a run's process can find it."""
    return control.spool.path.parent.parent  # type: ignore[union-attr]


@dataclass(frozen=True)
class BadReference(FreeFall):
    """Does something else than say the motion."""

    how: str = "exits"

    def states(self, t: np.ndarray) -> States:
        if self.how == "exits":
            os._exit(0)
        while self.how == "hangs":
            time.sleep(1.0)
        raise RuntimeError("no motion of mine")


@dataclass(frozen=True)
class NoBound(FreeFall):
    """The motion, with a bound on its error that is none."""

    def error(self, t: np.ndarray) -> np.ndarray:
        return np.full(len(t), np.nan)


@problem("badly_known")
def badly_known(
    *,
    how: Annotated[
        str, Parameter("what is wrong", choices=("exits", "hangs", "raises", "no_bound", "no_horizon"))
    ] = "exits",
    end: Annotated[float, Parameter("t_end", "s")] = 2.0,
) -> Problem:
    """The free fall with a reference that judges nothing."""
    known = registry.make_problem("free_fall")
    made = {"no_bound": NoBound, "no_horizon": lambda s: FreeFall(s, horizon=float("nan"))}
    reference = made.get(how, lambda s: BadReference(s, how=how))
    return dataclasses.replace(known, name="badly_known", reference_from=reference, parameters={})


@solver_of()
def kills_itself(self, p, control):
    """By SIGKILL, as the system out of memory does."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


@solver_of()
def deletes_results(self, p, control):
    """All records that are there, then the exact motion."""
    for path in (folder_of(control) / "runs").glob("*.json"):
        path.unlink()
    return follow_exactly(self, p, control)


@solver_of(how=option("record", "what it does", choices=("record", "verdict", "less_time", "more_time")))
def forges(self, p, control):
    """Patches the verdict or the clock, or writes a perfect record of its own and leaves before it is measured."""
    from mbsbench.harness.results import store
    from mbsbench.harness.results.records import RunRecord
    from mbsbench.harness.run import measuring, worker
    from mbsbench.harness.run.contract import Cost

    own = control.spool.path.stem
    if self.how == "record":
        perfect = RunRecord(run_id=own, case="perfect", problem=p.name, solver="forges", status="success")
        store.write_record(folder_of(control), perfect)
        os._exit(0)
    if self.how.endswith("time"):
        worker.split_cost = lambda *_: Cost({"less_time": -5.0, "more_time": 1e6}[self.how], 0.0, 0.0)
        return follow_exactly(self, p, control)
    measuring.list_broken_laws = lambda *_: []
    measuring.find_inaccuracy = lambda *_: []
    done = follow_exactly(self, p, control)
    return dataclasses.replace(done, states=dataclasses.replace(done.states, r=1e3 + done.states.r))


@solver_of(what=option("stderr", "whose place", choices=("stderr", "handed", "spool", "record", "errors")))
def obstructs(self, p, control):
    """Puts a folder where a file of its run goes, or a file where the folder of a part goes."""
    folder, own = folder_of(control), control.spool.path.stem
    if self.what == "errors":
        (folder / "stderr").rename(folder / "stderr_before")
        (folder / "stderr").write_text("")
        return follow_exactly(self, p, control)
    place = (
        folder
        / {
            "stderr": f"stderr/{own}.txt",
            "handed": f".spool/{own}.npz",
            "spool": f".spool/{own}.rows",
            "record": f"runs/{own}.json",
        }[self.what]
    )
    place.unlink(missing_ok=True)
    (place / "in_the_way").mkdir(parents=True)
    return follow_exactly(self, p, control)


@solver("breaks_the_contract")
@dataclass(frozen=True)
class BreaksTheContract(Exact):
    """Returns what its declaration excludes."""

    what: str = option("refuses", "which part of it", choices=("refuses", "counters", "status", "reaction", "notes"))

    def refuses(self, p: Problem, control: StepControl) -> Any:
        return True if self.what == "refuses" else None

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """The exact motion with one wrong field."""
        wrong: dict[str, Any] = {
            "counters": {"counters": {"steps": 10**400}},
            "status": {"status": "fine"},
            "reaction": {"reaction": np.zeros((1, 99))},
            "notes": {"notes": (1, 2)},
            "refuses": {},
        }
        return dataclasses.replace(super().solve(p, control), **wrong[self.what])


@solver_of(cpu=option(0.0, "CPU time claimed", "s"))
def claims_time(self, p, control):
    """Works for a while and says something else."""
    for _ in range(40):
        np.linalg.svd(np.ones((200, 200)))
    return dataclasses.replace(follow_exactly(self, p, control), cpu_time=self.cpu, setup_time=0.0)


@solver_of(how=option("stays", "what is wrong", choices=("stays", "stays_still", "reversed", "two_rows", "turned")))
def lazy(self, p, control):
    """Motions that keep every law at each instant by itself, and claim success."""
    done = follow_exactly(self, p, control)
    s, n = done.states, len(done.t)
    if self.how == "reversed":  # after the start
        sign = np.where(np.arange(n) > 0, -1.0, 1.0)[:, None, None]
        return dataclasses.replace(done, states=States(s.r, s.R, sign * s.v, sign * s.Omega))
    if self.how == "turned":  # R says nothing of Omega
        return dataclasses.replace(done, states=States(s.r, np.repeat(s.R[:1], n, axis=0), s.v, s.Omega))
    if self.how == "two_rows":
        ends: np.ndarray = np.array([0, n - 1])
        return dataclasses.replace(done, t=done.t[ends], states=s.at(ends))
    first = [np.repeat(a[:1], 2, axis=0) for a in (s.r, s.R, s.v, s.Omega)]
    return dataclasses.replace(done, t=np.array([0.0, p.t_end]), states=States(*first), status=Status.SUCCESS)


@solver_of(force=option(1e9, "of every row", "N"))
def pulls(self, p, control):
    """An honest motion, by our own solver, with reactions of a billion newtons."""
    done = registry.make_solver("rkmk_dop853").solve(p, StepControl(rtol=1e-8))
    reaction = np.full((len(done.t), p.system.nrows), self.force)
    return dataclasses.replace(done, reaction=reaction, cpu_time=float("nan"))


def pipes_of(pid: int) -> list[int]:
    """The pipes of another process, opened anew to be written to."""
    folder = f"/proc/{pid}/fd"
    pipes = [fd for fd in os.listdir(folder) if os.readlink(f"{folder}/{fd}").startswith("pipe:")]
    return [os.open(f"{folder}/{fd}", os.O_WRONLY) for fd in pipes]


def send_above(line: bytes) -> None:
    """A line in the name of the process above this one."""
    for pipe in pipes_of(os.getppid()):
        os.write(pipe, line)


def perfect_record(control: StepControl) -> bytes:
    """A success of this run."""
    own = control.spool.path.stem  # type: ignore[union-attr]
    record = RunRecord(run_id=own, case="perfect", problem="free_fall", solver="attacks", status="success")
    return format_record(record).replace("\n", " ").encode()


def leave_child(control: StepControl) -> None:
    """A process of a session of its own that outlives the one above this."""
    above = os.getppid()
    if os.fork() == 0:
        os.setsid()
        (folder_of(control) / "left").write_text(str(os.getpid()))
        time.sleep(600.0)
    while not (folder_of(control) / "left").exists():
        time.sleep(0.01)
    os.kill(above, signal.SIGKILL)


def flood(control: StepControl) -> None:
    """Garbage without end."""
    pipes = pipes_of(os.getppid())
    while True:
        for pipe in pipes:
            os.write(pipe, b"garbage " * 8000 + b"\n")


def forge_ending(control: StepControl) -> None:
    """A success as the record of how the solver ended, before the one above can send its own."""
    send_above(b"measuring " + perfect_record(control) + b"\n")
    os.kill(os.getppid(), signal.SIGKILL)


ATTACKS = {
    "kills": lambda control: os.kill(os.getppid(), signal.SIGKILL),
    "stops": lambda control: os.kill(os.getppid(), signal.SIGSTOP),
    "forges": lambda control: send_above(b"stored " + perfect_record(control) + b"\n"),
    "forges_ending": forge_ending,
    "floods": flood,
    "writes_memory": lambda control: open(f"/proc/{os.getppid()}/mem", "r+b").close(),
    "leaves_child": leave_child,
}


@solver_of(what=option("kills", "what it does to the process above it", choices=tuple(ATTACKS)))
def attacks(self, p, control):
    """Keeps half of its steps, then reaches above: false where that goes well, else honest."""
    done = follow_exactly(self, p, control)
    half = first_half(done)
    assert control.spool is not None and control.spool.due()
    control.spool.take(half.t, half.states)
    try:
        ATTACKS[self.what](control)
    except PermissionError:
        return done
    if self.what in ("stops", "leaves_child"):
        time.sleep(600.0)
    return dataclasses.replace(done, states=dataclasses.replace(done.states, r=1e3 + done.states.r))
