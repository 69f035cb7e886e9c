"""Judge whether a motion is the same however its problem is presented: all tolerances on this are here.

Two runs of one motion may differ by their errors, which are measured on the same solver: by how far a tenth of its
tolerance and half its step move the end, and by how much a changed start grows until then.
"""

from dataclasses import dataclass

from ..results.judgements.runs import SymmetryVerdict
from ..results.records import RunRecord

# "Half" and "twice" in these comments: of the 827 published symmetries that hold or are broken, those that change.
# errors at one tolerance scatter by several times, since steps differ. Half: 9 that hold are broken, 5 are undecided;
# twice: 3 broken ones hold.
SLACK = 10.0
# one run may err by 4/3 of its change at half the step, the other as much in the opposite direction. Half: 3 that hold
# are undecided; twice: 3 broken ones hold.
HALVES = 3.0
# relative uncertainty of a bound: the change at a tenth of the tolerance is the error minus about a tenth of it. Half:
# none changes; twice: 3 broken ones are undecided.
UNSURE = 0.1
ROUNDING = 2.2e-16  # relative, per step; steps add up. Half, twice: none changes
TURNED = 1e-9  # relative: rounding of a turned start and of the observables that are computed from it
OUT_OF_PLANE = 0.01  # fraction of the mechanism's size, for a motion that is planar and predictable to the end
# of a deviation between two presentations, as fractions of the bound that it exceeds
ROUTES = 0.1  # independent routes to the true motion that differ by more decide nothing
CONFIRMED = 0.4  # two answers that differ by more than the bound cannot both be this near to the true one
AMPLIFIED = 1e3  # factor by which answers of a less accurate code may differ more than those of the true motion
# of one run made again on another machine
ERROR, COST = 0.01, 0.5  # relative difference of errors, least fraction of the CPU time


@dataclass(frozen=True)
class Yardstick:
    """The allowed difference between two runs of a solver on a variant."""

    level: float  # [m] change of the end at a tenth of the tolerance
    halved: float  # [m] change of the end at half the step; 0 under error control
    growth: float  # growth of a relative change of the start until the end
    steps: int  # number of steps of the run
    size: float  # [m] size of the mechanism
    least: float = 0.0  # [m] distance that is allowed to the most accurate run
    grown: float = 1.0  # factor on all that is allowed

    @property
    def exact(self) -> float:
        """The distance allowed if a scheme keeps a symmetry exactly, but for its tolerance and rounding [m]."""
        return self.grown * (SLACK * self.level + self.rounding + self.least)

    @property
    def bound(self) -> float:
        """The distance allowed by all errors of the scheme, those of its step included [m]."""
        return self.grown * (SLACK * self.level + self.rounding + self.least + HALVES * self.halved)

    @property
    def rounding(self) -> float:
        """The distance that the rounding of every step, amplified until the end, may cause [m]."""
        return SLACK * ROUNDING * self.steps * max(self.growth, 1.0) * self.size

    @property
    def return_factor(self) -> float:
        """The factor on the allowed difference for a motion integrated back to its start."""
        return find_return_factor(self.growth)

    def is_exact(self, deviation: float) -> bool:
        """Return whether a scheme of fixed steps keeps a symmetry exactly, as far as its equations are solved.

        ``deviation`` is the distance of the ends of both runs [m]. False under error control.
        """
        return self.halved > 0.0 and deviation <= self.exact

    def is_broken(self, deviation: float) -> bool:
        """Return whether a deviation [m] exceeds the bound by more than its uncertainty."""
        return exceeds_bound(deviation, self.bound)

    def judge(self, deviation: float) -> SymmetryVerdict:
        """Return the verdict on the distance of the ends of two runs, ``deviation`` [m]: holds, broken or undecided.

        It is undecided if the deviation exceeds the bound by less than the uncertainty of that, and if more than the
        size of the mechanism is allowed, which any two ends would meet.
        """
        if self.is_broken(deviation):
            return "broken"
        allowed = self.exact if self.is_exact(deviation) else self.bound
        return "undecided" if deviation > self.bound or allowed > self.size else "holds"


def find_return_factor(growth: float) -> float:
    """Return the factor by which errors at the start, after the motion was integrated back, exceed those at the end.

    Errors grow on the way there and back. ``growth`` is the factor by which a change of the start grows until the end.
    """
    return 1.0 + max(growth, 1.0)


def bound_difference(own: float, least: float) -> float:
    """Return the allowed distance of two answers of a code [m]: ``SLACK`` times its ``own`` error plus ``least``.

    ``own`` [m] is measured on the code itself; ``least`` [m] is allowed to the most accurate code, too.
    """
    return SLACK * own + least


def exceeds_bound(deviation: float, bound: float) -> bool:
    """Return whether a deviation [m] exceeds a bound [m] by more than the uncertainty of the bound; True for NaN."""
    return not deviation <= (1.0 + UNSURE) * bound


def do_routes_agree(apart: float, bound: float) -> bool:
    """Return whether independent computations of the true motion agree well enough to decide on a deviation.

    ``apart`` [m] is their distance, ``bound`` [m] the limit that the deviation exceeds.
    """
    return not apart > ROUTES * bound


def is_fault_confirmed(off: float, bound: float) -> bool:
    """Return whether a code whose two answers differ by more than ``bound`` [m] is wrong by the true motion, too.

    ``off`` [m] is the larger distance of the two answers from the true motion, which cannot be near both of them.
    """
    return off > CONFIRMED * bound


def describe_rerun(stated: RunRecord | None, own: RunRecord) -> str:
    """Return in words how a run that was made again, ``own``, differs from its ``stated`` record; empty if they agree.

    Compared are the status, the motion error and the CPU time, in this order; ``stated`` is None if there is no record.
    """
    if stated is None or stated.status != own.status:
        return f"{own.case}: {own.status} when run again"
    if abs(stated.motion_error_max_m - own.motion_error_max_m) > ERROR * own.motion_error_max_m:
        return f"{own.case}: an error of {own.motion_error_max_m:.3g} m when run again"
    slower = stated.cpu_median_s < COST * own.cpu_median_s
    return f"{own.case}: {own.cpu_median_s:.2g} s of CPU when run again" if slower else ""
