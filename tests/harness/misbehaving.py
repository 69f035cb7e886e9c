"""A plugin: solvers that fail in every way a solver can, one honest one, and a body in free fall to solve."""

import ctypes
import dataclasses
import os
import sys
import time
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from mbsbench.harness.catalogue.options import Parameter, option
from mbsbench.harness.catalogue.registry import problem, solver
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import RigidBody, assemble
from mbsbench.harness.types import Invariant, Observable, Problem, Status, StepControl, Trajectory

GRAVITY = 10.0  # [m/s2]


@dataclass(frozen=True)
class FreeFall:
    """r = v0 t - g t^2 / 2, turning about a principal axis."""

    start: State
    route: str = "closed form"
    horizon: float = 1.0

    def states(self, t: np.ndarray) -> States:
        """The motion."""
        g = np.array([0.0, 0.0, -GRAVITY])
        r = self.start.r + t[:, None, None] * self.start.v + 0.5 * t[:, None, None] ** 2 * g
        R = self.start.R @ so3.exp(t[:, None, None] * self.start.Omega)
        return States(r, R, self.start.v + t[:, None, None] * g, np.broadcast_to(self.start.Omega, r.shape))

    def error(self, t: np.ndarray) -> np.ndarray:
        """Rounding."""
        return np.full(len(t), 1e-15)


@problem("free_fall")
def free_fall(*, mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 2.0) -> Problem:
    """A turning body without joints."""
    system = assemble([RigidBody(mass, np.diag([1.0, 2.0, 3.0]))], (), (0.0, 0.0, -GRAVITY))
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 2.0]]))
    return Problem(
        "free_fall", system, start, t_end=2.0, dt=0.5, section="", source="a test",
        observables=(Observable("height", "r_Z", "m", lambda s: s.r[:, 0, 2]),),
        invariants=(Invariant("P_X", "kg m/s", lambda s: mass * s.v[:, 0, 0]),),
        reference_from=FreeFall,
    )  # fmt: skip


@dataclass(frozen=True)
class _Base:
    paper_label: ClassVar[str] = "test"
    control: ClassVar[str] = "dt"

    def refuses(self, p: Problem, control: StepControl) -> str | None:
        """Takes all."""
        return None

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """The exact motion on a grid."""
        assert control.dt is not None
        t = np.linspace(0.0, p.t_end, max(2, round(p.t_end / control.dt) + 1))
        return Trajectory(
            t, FreeFall(p.initial).states(t), Status.SUCCESS, "reached the end", {"evaluations": 7}, cpu_time=0.0
        )


@solver("exact")
@dataclass(frozen=True)
class Exact(_Base):
    """The exact motion, with an error to order."""

    lift: float = option(0.0, "added to the height at the end, growing as t^2", "m")

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """With the wanted error."""
        done = super().solve(p, control)
        r = done.states.r.copy()
        r[:, 0, 2] += self.lift * (done.t / done.t[-1]) ** 2
        return dataclasses.replace(done, states=dataclasses.replace(done.states, r=r))


@solver("refuses")
@dataclass(frozen=True)
class Refuses(_Base):
    """Refuses with a reason."""

    def refuses(self, p: Problem, control: StepControl) -> str | None:
        """Always."""
        return "on principle"


@solver("raises")
@dataclass(frozen=True)
class Raises(_Base):
    """An exception."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """Not."""
        raise RuntimeError("a bug of mine\nin two lines")


@solver("exits")
@dataclass(frozen=True)
class Exits(_Base):
    """os._exit(0): looks like an orderly end to its parent."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """Not."""
        os._exit(0)


@solver("segfaults")
@dataclass(frozen=True)
class Segfaults(_Base):
    """Reads address 0 in native code."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """Not."""
        os.write(2, b"native words\n")
        ctypes.string_at(0)
        raise AssertionError


@solver("spins")
@dataclass(frozen=True)
class Spins(_Base):
    """Never returns, deaf to every signal it can be deaf to, with a child of its own."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """Not."""
        import signal

        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM):
            signal.signal(number, signal.SIG_IGN)
        if os.fork() == 0:
            time.sleep(600.0)
        while True:
            pass


@solver("eats_memory")
@dataclass(frozen=True)
class EatsMemory(_Base):
    """Allocates until it cannot."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """Not."""
        held = []
        while True:
            held.append(np.ones(2**22))


@solver("not_numbers")
@dataclass(frozen=True)
class NotNumbers(_Base):
    """Success claimed, NaN in the motion."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """NaN from the middle on."""
        done = super().solve(p, control)
        r = done.states.r.copy()
        r[len(r) // 2 :] = np.nan
        return dataclasses.replace(done, states=dataclasses.replace(done.states, r=r))


@solver("stops_early")
@dataclass(frozen=True)
class StopsEarly(_Base):
    """Success claimed half-way."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """The first half."""
        done = super().solve(p, control)
        half = slice(0, len(done.t) // 2 + 1)
        return dataclasses.replace(done, t=done.t[half], states=done.states.at(half))


@solver("gives_up")
@dataclass(frozen=True)
class GivesUp(_Base):
    """An honest failure with the steps so far."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """The first half, said to be so."""
        done = super().solve(p, control)
        half = slice(0, len(done.t) // 2 + 1)
        states = done.states.at(half)
        return dataclasses.replace(
            done, t=done.t[half], states=states, status=Status.STEP_UNDERFLOW, message="too small"
        )


@solver("returns_nonsense")
@dataclass(frozen=True)
class ReturnsNonsense(_Base):
    """Not a trajectory."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """None."""
        return None  # type: ignore[return-value]


@solver("chatters")
@dataclass(frozen=True)
class Chatters(_Base):
    """Prints a megabyte to both outputs, then leaves with sys.exit."""

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """Not."""
        sys.stdout.write("x" * 500_000)
        sys.stderr.write("y" * 500_000)
        sys.exit(3)


@solver("sleeps")
@dataclass(frozen=True)
class Sleeps(_Base):
    """Takes its time, then is right."""

    seconds: float = option(0.2, "to sleep", "s", at_least=0.0)

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """After a while, of which time in which it is stopped is no part."""
        for _ in range(round(self.seconds / 0.02)):
            time.sleep(0.02)
        return super().solve(p, control)


@solver("hangs_later")
@dataclass(frozen=True)
class HangsLater(_Base):
    """Hands over the first half of its steps, then ends in a way that lets no Python run."""

    end: str = option("loop", "how", choices=("loop", "segfault", "raise"))

    def solve(self, p: Problem, control: StepControl) -> Trajectory:
        """Half of it."""
        done = super().solve(p, control)
        half = slice(0, len(done.t) // 2 + 1)
        assert control.spool is not None and control.spool.due()
        control.spool.take(done.t[half], done.states.at(half))
        if self.end == "raise":
            raise RuntimeError("after half of it")
        if self.end == "segfault":
            ctypes.string_at(0)
        native = ctypes.PyDLL(None)  # keeps the interpreter's lock: no signal handler, no thread gets through
        many = ctypes.byref(ctypes.c_size_t(2**62))
        native.lfind(b"a", b"b", many, ctypes.c_size_t(0), native.strcmp)  # b"b" is compared so often
