"""Solvers that return an honest motion, changed in one of the ways of the forgeries, or told in part."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from mbsbench import Problem, StepControl, Trajectory, option, solver
from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.tests.harness.lab.ladder.forgeries.motions import MOTIONS, swing


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


@solver("tells_little")
@dataclass(frozen=True)
class TellsLittle:
    """Our own motion of a body that turns over again and again, told only while it turns as it did at the start."""

    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "rtol"

    def refuses(self, problem: Problem, control: StepControl) -> None:
        """Nothing."""

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """The rows in which the body turns the right way up."""
        found = make_solver("rkmk_dop853").solve(problem, control)
        Omega, start = found.states.Omega[:, 0], problem.initial.Omega[0]
        alike = np.flatnonzero(Omega @ start > 0.99 * start @ start)
        return replace(found, t=found.t[alike], states=found.states.at(alike), reaction=None)
