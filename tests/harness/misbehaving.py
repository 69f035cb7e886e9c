"""A plugin: solvers that fail in every way a solver can, one honest one, and a body in free fall to solve."""

import ctypes
import dataclasses
import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from mbsbench.harness.catalogue.options import Parameter, option
from mbsbench.harness.catalogue.registry import problem, solver
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import RigidBody, assemble
from mbsbench.harness.mechanics.types import Invariant, Observable, Problem, Status, StepControl, Trajectory

GRAVITY = 10.0  # [m/s2]


@dataclass(frozen=True)
class FreeFall:
    """r = v0 t - g t^2 / 2, turning about a principal axis."""

    start: State
    route: str = "closed form"
    horizon: float = 1.0

    def states(self, t: np.ndarray) -> States:
        g = np.array([0.0, 0.0, -GRAVITY])
        r = self.start.r + t[:, None, None] * self.start.v + 0.5 * t[:, None, None] ** 2 * g
        R = self.start.R @ so3.exp(t[:, None, None] * self.start.Omega)
        return States(r, R, self.start.v + t[:, None, None] * g, np.broadcast_to(self.start.Omega, r.shape))

    def error(self, t: np.ndarray) -> np.ndarray:
        return np.full(len(t), 1e-15)


@problem("free_fall")
def free_fall(*, mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 2.0) -> Problem:
    """A turning body without joints."""
    system = assemble([RigidBody(mass, np.diag([1.0, 2.0, 3.0]))], (), (0.0, 0.0, -GRAVITY))
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 2.0]]))
    return Problem(
        "free_fall",
        system,
        start,
        t_end=2.0,
        dt=0.5,
        section="",
        source="a test",
        observables=(Observable("height", "r_Z", "m", lambda s: s.r[:, 0, 2]),),
        invariants=(Invariant("P_X", "kg m/s", lambda s: mass * s.v[:, 0, 0]),),
        reference_from=FreeFall,
    )


def follow_exactly(solver: Any, p: Problem, control: StepControl) -> Trajectory:
    """The exact motion on a grid."""
    assert control.dt is not None
    t = np.linspace(0.0, p.t_end, max(2, round(p.t_end / control.dt) + 1))
    return Trajectory(
        t, FreeFall(p.initial).states(t), Status.SUCCESS, "reached the end", {"evaluations": 7}, cpu_time=0.0
    )


@dataclass(frozen=True)
class Exact:
    paper_label: ClassVar[str] = "test"
    control: ClassVar[str] = "dt"

    def refuses(self, p: Problem, control: StepControl) -> str | None:
        return None

    solve = follow_exactly


def solver_of(**options: Any) -> Callable[[Callable], type]:
    """Makes a function ``(self, p, control)`` with these options the solver of its name, which takes all problems."""

    def register(solve: Callable) -> type:
        declared = {name: type(field.default) for name, field in options.items()}
        own = {"__module__": solve.__module__, "__doc__": solve.__doc__, "__annotations__": declared, "solve": solve}
        return solver(solve.__name__)(dataclass(frozen=True)(type(solve.__name__, (Exact,), own | options)))

    return register


def first_half(done: Trajectory) -> Trajectory:
    half = slice(0, len(done.t) // 2 + 1)
    return dataclasses.replace(done, t=done.t[half], states=done.states.at(half))


@solver_of(lift=option(0.0, "added to the height at the end, growing as t^2", "m"))
def exact(self, p, control):
    """The exact motion, with an error to order."""
    done = follow_exactly(self, p, control)
    r = done.states.r.copy()
    r[:, 0, 2] += self.lift * (done.t / done.t[-1]) ** 2
    return dataclasses.replace(done, states=dataclasses.replace(done.states, r=r))


@solver("refuses")
@dataclass(frozen=True)
class Refuses(Exact):
    """Refuses with a reason."""

    def refuses(self, p: Problem, control: StepControl) -> str | None:
        return "on principle"


@solver_of()
def raises(self, p, control):
    """An exception."""
    raise RuntimeError("a bug of mine\nin two lines")


@solver_of()
def exits(self, p, control):
    """os._exit(0): looks like an orderly end to its parent."""
    os._exit(0)


@solver_of()
def segfaults(self, p, control):
    """Reads address 0 in native code."""
    os.write(2, b"native words\n")
    ctypes.string_at(0)
    raise AssertionError


@solver_of()
def spins(self, p, control):
    """Never returns, deaf to every signal it can be deaf to, with a child of its own."""
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM):
        signal.signal(number, signal.SIG_IGN)
    if os.fork() == 0:
        time.sleep(600.0)
    while True:
        pass


@solver_of()
def eats_memory(self, p, control):
    """Allocates until it cannot."""
    held = []
    while True:
        held.append(np.ones(2**22))


@solver_of()
def not_numbers(self, p, control):
    """Success claimed, NaN in the motion from the middle on."""
    done = follow_exactly(self, p, control)
    r = done.states.r.copy()
    r[len(r) // 2 :] = np.nan
    return dataclasses.replace(done, states=dataclasses.replace(done.states, r=r))


@solver_of()
def stops_early(self, p, control):
    """Success claimed half-way."""
    return first_half(follow_exactly(self, p, control))


@solver_of()
def gives_up(self, p, control):
    """An honest failure with the steps so far."""
    half = first_half(follow_exactly(self, p, control))
    return dataclasses.replace(half, status=Status.STEP_UNDERFLOW, message="too small")


@solver_of()
def returns_nonsense(self, p, control):
    """Not a trajectory."""


@solver_of()
def chatters(self, p, control):
    """Prints a megabyte to both outputs, then leaves with sys.exit."""
    sys.stdout.write("x" * 500_000)
    sys.stderr.write("y" * 500_000)
    sys.exit(3)


@solver_of(seconds=option(0.2, "to sleep", "s", at_least=0.0))
def sleeps(self, p, control):
    """Takes its time, of which time in which it is stopped is no part, then is right."""
    for _ in range(round(self.seconds / 0.02)):
        time.sleep(0.02)
    return follow_exactly(self, p, control)


@solver_of(end=option("loop", "how", choices=("loop", "segfault", "raise")))
def hangs_later(self, p, control):
    """Hands over the first half of its steps, then ends in a way that lets no Python run."""
    half = first_half(follow_exactly(self, p, control))
    assert control.spool is not None and control.spool.due()
    control.spool.take(half.t, half.states)
    if self.end == "raise":
        raise RuntimeError("after half of it")
    if self.end == "segfault":
        ctypes.string_at(0)
    native = ctypes.PyDLL(None)  # keeps the interpreter's lock: no signal handler, no thread gets through
    many = ctypes.byref(ctypes.c_size_t(2**62))
    native.lfind(b"a", b"b", many, ctypes.c_size_t(0), native.strcmp)  # b"b" is compared so often
