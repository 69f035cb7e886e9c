"""How a run ended and what its motion is judged by: statuses, laws and what they allow, reasons."""

import math
from dataclasses import dataclass
from enum import StrEnum

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
    STALLED = "stalled"  # the limit on steps was reached
    UNFINISHED = "unfinished"  # not finished here: the harness ended it, which says nothing about its solver
    MEMORY = "memory"
    CRASHED = "crashed"  # signal, exit or exception

    @property
    def lawful(self) -> bool:
        """The motion reached its end and keeps all laws."""
        return self in (Status.SUCCESS, Status.INACCURATE)


class NotInstalled(str):
    """A refusal, in one line, because ``package`` is not installed; any other solver is as good as before."""

    package: str

    def __new__(cls, package: str, remedy: str) -> "NotInstalled":
        made = super().__new__(cls, f"{package} is not installed: {remedy}")
        made.package = package
        return made


class EndedBy(StrEnum):
    """Cause of a run's end. With any but ``SOLVER`` the solver returned nothing."""

    SOLVER = "solver"  # it returned or refused; the status says how it went
    EXCEPTION = "exception"
    EXIT = "exit"  # its process exited
    SIGNAL = "signal"
    WALL_LIMIT = "wall_limit"  # the safety net, at ten times the limit on CPU time
    CPU_LIMIT = "cpu_limit"
    CODE_LIMIT = "code_limit"  # compilation took too long: no time of the solver's
    MEMORY_LIMIT = "memory_limit"
    MEASURE_LIMIT = "measure_limit"  # the solver returned, but measuring its motion took too long
    TOTAL_LIMIT = "total_limit"  # of the suite
    KILLED = "killed"  # by a signal from outside: kill, or the system out of memory
    SUSPENDED = "suspended"  # a limit on time passed while the harness itself was stopped
    SUPERVISOR_LOST = "supervisor_lost"
    WORKERS_LOST = "workers_lost"  # of a cluster


class Law(StrEnum):
    """Laws that a claimed success has to satisfy; ``MOTION``: to be near the reference."""

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
    TRUNCATION = "truncation"  # velocities, their changes, reactions: farther off than steps of this length leave open
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


@dataclass(frozen=True)
class Reason:
    """A law that a motion breaks, or its error: ``value`` passes ``limit``, first at ``time_s``; NaN if unknown."""

    law: Law
    value: float = math.nan
    limit: float = math.nan
    unit: str = ""
    time_s: float = math.nan
    name: str = ""  # which one, where there are several: the invariant, the symmetry
