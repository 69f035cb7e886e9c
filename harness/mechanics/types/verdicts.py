"""Define the ends of runs and the laws by which motions are judged: statuses, laws with their limits, reasons."""

import math
from dataclasses import dataclass
from enum import StrEnum

# Stated errors of references, as fractions of the reach. Errors are judged while that of the reference is below the
# first, or below the second and not growing as in chaos: more than ``GROWN`` times over a tenfold time, faster than any
# square of time. No fixed accuracy follows a chaotic motion: there the distance from the reference says nothing about a
# solver. The chain becomes chaotic in this sense at 1.9 s, the other problems never.
PREDICTABLE, JUDGED, GROWN = 1e-9, 1e-3, 1e2

# Fractions of the reach, by the column with the time when the error first passes each; the first makes it inaccurate.
ACCURATE = {"accurate_until_s": 0.1, "accurate_until_1pct_s": 0.01, "accurate_until_0p1pct_s": 0.001}


class Status(StrEnum):
    """The ending of a run; each is a result."""

    SUCCESS = "success"
    INACCURATE = "inaccurate"  # laws hold, but the motion error exceeds a tenth of the reach
    WRONG = "wrong"  # success claimed, but a law is broken
    REFUSED = "refused"  # the solver declined beforehand and said why
    DIVERGED = "diverged"
    STEP_UNDERFLOW = "step_underflow"
    SINGULAR = "singular"
    STALLED = "stalled"  # the limit on steps was reached
    UNFINISHED = "unfinished"  # not finished here: the harness ended it, which says nothing about its solver
    MEMORY = "memory"
    CRASHED = "crashed"  # signal, exit or exception

    @property
    def lawful(self) -> bool:
        """True if the motion reached its end and keeps all laws."""
        return self in (Status.SUCCESS, Status.INACCURATE)


class NotInstalled(str):
    """A refusal, in one line, because ``package`` is not installed; it says nothing about the solver."""

    package: str

    def __new__(cls, package: str, remedy: str) -> "NotInstalled":
        """Make the text ``<package> is not installed: <remedy>``, with the package's name as an attribute."""
        made = super().__new__(cls, f"{package} is not installed: {remedy}")
        made.package = package
        return made


class EndCause(StrEnum):
    """The cause of a run's end; with any but ``SOLVER`` the solver returned nothing."""

    SOLVER = "solver"  # it returned or refused; see the status
    EXCEPTION = "exception"
    EXIT = "exit"  # its process exited
    SIGNAL = "signal"
    WALL_LIMIT = "wall_limit"  # the safety net, at ten times the limit on CPU time
    CPU_LIMIT = "cpu_limit"
    CODE_LIMIT = "code_limit"  # compilation took too long, which is not the solver's time
    MEMORY_LIMIT = "memory_limit"
    MEASURE_LIMIT = "measure_limit"  # the solver returned, but measuring its motion took too long
    TOTAL_LIMIT = "total_limit"  # time limit of the suite
    KILLED = "killed"  # by a signal from outside: kill, or the system out of memory
    SUSPENDED = "suspended"  # a limit on time passed while the harness itself was stopped
    SUPERVISOR_LOST = "supervisor_lost"
    WORKERS_LOST = "workers_lost"  # lost workers of a cluster


class Law(StrEnum):
    """The laws that a claimed success has to satisfy; ``MOTION`` is nearness to the reference."""

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
    MOMENT = "moment"  # of the joints on a body
    TRUNCATION = "truncation"  # velocities, their changes, reactions: off by more than steps of this length explain
    MOTION = "motion"
    VELOCITY = "velocity"  # this and the next: nearness to the reference, like ``MOTION``
    ROWS = "rows"  # between rows
    POSITION = "position"  # this and the next only occur in judgements before schema 3
    ORIENTATION = "orientation"
    PLANE = "plane"
    SYMMETRY = "symmetry"


# Limits of laws, as fractions of their scale (energy, reach, speed; rotations need none); wide on purpose. The numbers
# behind each are how many of the 813 claimed successes of the suites ``first`` and ``paper`` are above half of the
# limit, above the limit, and above twice the limit.
ALLOWED = {
    Law.ENERGY: 0.10,  # a tenth of the exchanged energy appears or disappears: 47, 25, 14
    Law.CONSTRAINT: 0.01,  # fraction of the reach, as far as joints allow it: the joint is visibly open: 14, 14, 10
    Law.CONSTRAINT_RATE: 0.05,  # velocities leave the joints by a twentieth of the fastest: 10, 6, 2
    Law.ORTHOGONALITY: 1e-3,  # |R^T R - 1|: such an R distorts lengths by as much: none
}


# relative to the largest exact force or moment: reactions with larger errors are wrong. Of 686 claimed successes with
# reactions, 232 are above half of it, 188 above it, 161 above twice as much.
RIGHT_REACTION = 0.05
PASSAGE = "passes ", ", where branches meet"  # start of a run's note on singular poses, and of its reason


@dataclass(frozen=True)
class Reason:
    """A law that a motion breaks, or its error: ``value`` exceeds ``limit``, first at ``time_s``; NaN if unknown."""

    law: Law
    value: float = math.nan  # residual or error
    limit: float = math.nan
    unit: str = ""
    time_s: float = math.nan
    name: str = ""  # name of the invariant or symmetry
