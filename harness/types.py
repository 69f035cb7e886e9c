"""What crosses the layers: problems and solvers on one side, runner, results and reports on the other.

Arrows point one way: ``harness.mechanics <- harness.types <- problems, solvers <- harness.execution <- reports``.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from .mechanics.presentation import Presentation
from .mechanics.state import State, States, rotated
from .mechanics.system import MultibodySystem

__all__ = [
    "ACCURATE",
    "ALLOWED",
    "GROWN",
    "JUDGED",
    "PREDICTABLE",
    "Array",
    "EndedBy",
    "Invariant",
    "Law",
    "Observable",
    "Presentation",
    "Problem",
    "Reason",
    "Reference",
    "Solver",
    "Spool",
    "State",
    "States",
    "Status",
    "StepControl",
    "Trait",
    "Trajectory",
]  # fmt: skip

Array = np.ndarray

# Of the reach: stated errors of references. Errors are judged where that of the reference is below the first, or below
# the second and not growing as in chaos: more than ``GROWN`` times over a tenfold time, as no square of time does. No
# fixed accuracy follows a chaotic motion: the distance from the reference says nothing about a solver. The chain gets
# there at 1.9 s, the other problems never.
PREDICTABLE, JUDGED, GROWN = 1e-9, 1e-3, 1e2

# Of the reach, by the column that says when the error first passes it. A motion that passes the first is inaccurate.
ACCURATE = {"accurate_until_s": 0.1, "accurate_until_1pct_s": 0.01, "accurate_until_0p1pct_s": 0.001}


class Status(StrEnum):
    """How a run ended. Each is a result."""

    SUCCESS = "success"
    INACCURATE = "inaccurate"  # laws hold, the motion is off the reference by more than a tenth of its reach
    WRONG = "wrong"  # success claimed, but a law is broken
    REFUSED = "refused"  # the solver said beforehand why it cannot
    DIVERGED = "diverged"
    STEP_UNDERFLOW = "step_underflow"
    SINGULAR = "singular"
    STALLED = "stalled"  # a limit on steps or time was reached
    MEMORY = "memory"
    CRASHED = "crashed"  # signal, exit or exception

    @property
    def lawful(self) -> bool:
        """The motion reached its end and keeps all laws."""
        return self in (Status.SUCCESS, Status.INACCURATE)


class EndedBy(StrEnum):
    """What ended a run. With any but ``SOLVER`` the solver returned nothing."""

    SOLVER = "solver"  # it returned or refused; the status says how it went
    EXCEPTION = "exception"
    EXIT = "exit"  # its process exited
    SIGNAL = "signal"
    WALL_LIMIT = "wall_limit"
    CPU_LIMIT = "cpu_limit"
    MEMORY_LIMIT = "memory_limit"
    MEASURE_LIMIT = "measure_limit"  # the solver returned, but measuring its motion took too long
    TOTAL_LIMIT = "total_limit"  # of the suite
    KILLED = "killed"  # by a signal from outside: kill, or the system out of memory
    SUSPENDED = "suspended"  # a limit on time passed while the harness itself was stopped
    SUPERVISOR_LOST = "supervisor_lost"
    WORKERS_LOST = "workers_lost"  # of a cluster


class Law(StrEnum):
    """What a claimed success has to satisfy; ``MOTION``: to be near the reference."""

    FINITE = "finite"
    START = "start"
    END = "end"
    ENERGY = "energy"
    CONSTRAINT = "constraint"
    CONSTRAINT_RATE = "constraint_rate"
    ORTHOGONALITY = "orthogonality"
    INVARIANT = "invariant"
    KINEMATIC = "kinematic"  # r' = v and R' = R hat(Omega), from row to row
    REACTION = "reaction"
    MOTION = "motion"
    VELOCITY = "velocity"  # this and the next: near the reference, like ``MOTION``
    ROWS = "rows"  # between rows
    POSITION = "position"  # this and the next only in judgements of before schema 3
    ORIENTATION = "orientation"
    PLANE = "plane"
    SYMMETRY = "symmetry"


# What a law allows: a part of the scale it has (energy, reach, speed; rotations need none). Wide on purpose.
ALLOWED = {
    Law.ENERGY: 0.10,  # a tenth of what is exchanged appears or disappears
    Law.CONSTRAINT: 0.01,  # of the reach, as far as joints allow it: the joint is visibly apart
    Law.CONSTRAINT_RATE: 0.05,  # velocities leave the joints by a twentieth of the fastest
    Law.ORTHOGONALITY: 1e-3,  # |R^T R - 1|: such an R distorts lengths by as much
}


class Trait(StrEnum):
    """What a problem is there to test; ``list`` groups problems by it."""

    SINGULAR = "singular"  # the rank of A falls at instants
    REDUNDANT = "redundant"  # more rows than their rank, all along
    STIFF = "stiff"  # time constants far below those of the motion
    CHAOTIC = "chaotic"
    LONG = "long"  # hundreds of turns or swings
    DAMPED = "damped"  # dampers: energy leaves by work that enters the balance
    DRIVEN = "driven"  # applied forces, torques or prescribed motions, whose work enters the balance
    NONHOLONOMIC = "nonholonomic"  # rows that restrict velocities alone


@dataclass(frozen=True)
class Reason:
    """A law that a motion breaks, or its error: ``value`` passes ``limit``, first at ``time_s``; NaN if unknown."""

    law: Law
    value: float = math.nan
    limit: float = math.nan
    unit: str = ""
    time_s: float = math.nan
    name: str = ""  # which one, where there are several: the invariant, the symmetry


@dataclass(frozen=True)
class Observable:
    """A scalar to look at, of the motion in the problem's home frame."""

    name: str
    symbol: str  # mathtext, without $
    unit: str
    of: Callable[[States], Float[np.ndarray, " nt"]]


@dataclass(frozen=True)
class Invariant:
    """A scalar that the exact motion keeps, in the problem's home frame."""

    name: str
    unit: str
    of: Callable[[States], Float[np.ndarray, " nt"]]


@runtime_checkable
class Reference(Protocol):
    """The exact motion, from outside the contestants."""

    @property
    def route(self) -> str:
        """How it is computed, in a line."""
        ...

    @property
    def horizon(self) -> float:
        """[s] up to here ``error`` is certified."""
        ...

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """The motion at ``t`` [s]."""
        ...

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Certified bound [m] on the position error of any body at ``t``."""
        ...


@dataclass(frozen=True)
class Problem:
    """A system, its start, and all that is known about its motion.

    ``frame`` takes the home frame (the paper's) to space: 1 unless the problem is presented in another frame.
    """

    name: str
    system: MultibodySystem
    initial: State
    t_end: float  # [s]
    dt: float  # [s] the paper's step for ODE-GC
    section: str  # e.g. "Sect. 5.4"
    source: str  # where every number comes from
    observables: tuple[Observable, ...] = ()
    invariants: tuple[Invariant, ...] = ()
    reference_from: Callable[[State], Reference | None] | None = None  # exact motion from a start in the home frame
    parameters: Mapping[str, Any] = field(default_factory=dict)
    frame: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    planar_normal: Float[np.ndarray, " 3"] | None = None  # home frame; given when the exact motion is planar
    energy_allowed: float | None = None  # [J] the benchmark's own limit on max |E - E0|, if it has one
    presentation: Presentation = field(
        default_factory=Presentation
    )  # how a solver gets it (execution.presented); nothing here changes
    literal_start: bool = False  # as printed, though phi_dot is not zero: that check is waived and a note says so
    retrace: bool = False  # whether the solver is sent back from the end with velocities reversed

    def home(self, s: States) -> States:
        """``s`` seen from the home frame."""
        return rotated(s, self.frame.T)

    def observe(self, s: States) -> dict[str, Float[np.ndarray, " nt"]]:
        """All observables of a motion, by name."""
        at_home = self.home(s)
        return {o.name: o.of(at_home) for o in self.observables}

    def reference(self) -> Reference | None:
        """The exact motion in space, or None where none is known; a start that opens the joints has none."""
        if self.reference_from is None or self.literal_start:
            return None
        exact = self.reference_from(self.home(States.one(self.initial))[0])
        return None if exact is None else _TurnedReference(exact, self.frame)


@dataclass(frozen=True)
class _TurnedReference:
    home: Reference
    frame: Float[np.ndarray, "3 3"]

    @property
    def route(self) -> str:
        return self.home.route

    @property
    def horizon(self) -> float:
        return self.home.horizon

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        return rotated(self.home.states(t), self.frame).timed(t)

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        return self.home.error(t)


class Spool(Protocol):
    """Takes accepted steps during a run, so that a killed process leaves them (harness/sandbox/spool)."""

    rows: int  # taken so far

    def due(self) -> bool:
        """Whether it is time to hand over what came since; costs next to nothing, ask after every step."""
        ...

    def take(self, t: Float[np.ndarray, " nt"] | list[float], states: States) -> None:
        """The steps that followed those taken before, the start first or left out."""
        ...


LEAST_RTOL = 100.0 * float(np.finfo(float).eps)  # below it SciPy silently takes this, others take steps of no length


@dataclass(frozen=True)
class StepControl:
    """Exactly one of ``dt`` (fixed step [s]) and ``rtol`` (error control, absolute tolerance alike)."""

    dt: float | None = None
    rtol: float | None = None
    max_step: float | None = None  # [s] for error control only
    max_steps: int = 10_000_000  # accepted steps before the run counts as stalled
    wall_limit: float | None = None  # [s] the solver stops itself and hands back what it has
    spool: Spool | None = field(default=None, compare=False, repr=False)  # to hand steps over to as they come

    def __post_init__(self) -> None:
        if (self.dt is None) == (self.rtol is None):
            raise ValueError(f"give exactly one of dt and rtol (got dt={self.dt}, rtol={self.rtol})")
        for name in ("dt", "rtol", "max_step", "wall_limit"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be a finite number > 0 (got {value})")
        if self.rtol is not None and self.rtol < LEAST_RTOL:
            raise ValueError(f"rtol must be at least {LEAST_RTOL:.3g}: rounding allows no less (got {self.rtol:g})")
        if self.max_step is not None and self.dt is not None:
            raise ValueError(
                f"max_step goes with rtol, not with a fixed dt (got dt={self.dt}, max_step={self.max_step})"
            )
        if self.max_steps < 1:
            raise ValueError(f"max_steps must be >= 1 (got {self.max_steps})")


@dataclass(frozen=True)
class Trajectory:
    """The solver's own accepted steps, never resampled; on failure those up to it.

    ``reaction`` is the force conjugate to phi at the times ``t``: ``A^T reaction`` is the reaction on the bodies
    ([N] for point rows, [N m] for axis rows), NaN where the solver has none; never a raw lambda, by which
    Eqs. (36) and (92) mean different things. ``diagnostics`` are further series of the solver's own, (nt,) each.
    """

    t: Float[np.ndarray, " nt"]
    states: States
    status: Status
    message: str
    counters: Mapping[str, int]
    reaction: Float[np.ndarray, "nt nrows"] | None = None
    diagnostics: Mapping[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)
    events: tuple[Mapping[str, Any], ...] = ()  # e.g. singular passages: plain numbers and strings
    notes: tuple[str, ...] = ()  # choices the solver made, e.g. which redundant rows it dropped
    cpu_time: float = float("nan")  # [s] the integration alone, without compilation and set-up
    setup_time: float = float("nan")  # [s] compilation, symbolic analysis, consistent start
    returned: State | None = None  # where the way back ended, velocities turned again (execution.presented)

    def __post_init__(self) -> None:
        t = np.asarray(self.t, dtype=float)
        if t.ndim != 1 or len(t) != len(self.states) or len(t) == 0:
            raise ValueError(
                f"expected one state a time, at least the start (got {t.shape} times, {len(self.states)} states)"
            )
        if np.any(np.diff(t) <= 0.0):
            raise ValueError("the times of a trajectory must increase")
        object.__setattr__(self, "states", self.states.timed(t))


@runtime_checkable
class Solver(Protocol):
    """A frozen dataclass of options (module ``harness.options``) with two methods; one file in ``solvers/`` each.

    A solver of fixed steps may also say ``order``, the order in dt that certificates hold it to. ``paper_label`` and
    ``order`` are class variables, or properties where they depend on the options.
    """

    name: ClassVar[str]
    control: ClassVar[str]  # "dt" or "rtol": which of the two ``StepControl`` it takes

    @property
    def paper_label(self) -> str:
        """The paper's name of such a solver; empty for none."""
        ...

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Why this solver cannot take the problem, or None."""
        ...

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate from ``problem.initial`` to ``problem.t_end``; a failure is a status, not an exception."""
        ...
