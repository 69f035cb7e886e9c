"""A solver that returns an honest motion, changed in one of the ways of the forgeries."""

from dataclasses import dataclass
from typing import ClassVar

from mbsbench import Problem, StepControl, Trajectory, option, solver
from mbsbench.tests.harness.ladder.forgeries.motions import MOTIONS, swing


@solver("forged")
@dataclass(frozen=True)
class Forged:
    """One body on a joint."""

    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"
    how: str = option("nothing", "the name of a change", choices=("nothing", *MOTIONS))

    def refuses(self, problem: Problem, control: StepControl) -> None:
        """Nothing."""

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """The motion."""
        found = swing(problem, control)
        return MOTIONS[self.how](found, problem) if self.how in MOTIONS else found  # type: ignore[return-value]
