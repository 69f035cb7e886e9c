"""Drake's integrators of its continuous plant with error control: accuracy is rtol.

CENIC is the convex integrator for contact of Kurtz and Castro (arXiv:2511.08771). Loops are refused, as in ``drake``.
With ``settings`` "default" a Simulator is as nobody configured it: third order, steps of at most 0.1 s.
"""

from dataclasses import dataclass
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.types import Problem, StepControl
from .drake import TAKEN, loops_refusal
from .export.engine import SupportedElements
from .export.protocol import Adapter

INTEGRATORS = ("runge_kutta3", "runge_kutta5", "bogacki_shampine3", "implicit_euler", "radau3", "cenic")


@solver("drake_adaptive")
@dataclass(frozen=True)
class DrakeAdaptive(Adapter):
    """Drake's integrators with error control."""

    integrator: str = option("runge_kutta3", "Drake's name of it", choices=INTEGRATORS)
    settings: str = option("ours", "ours: the options above; default: the engine's own", choices=("ours", "default"))

    control: ClassVar[str] = "rtol"
    inside: ClassVar[str] = "drake"
    package: ClassVar[str] = "pydrake"
    wheel: ClassVar[str] = "drake"
    takes: ClassVar[SupportedElements] = TAKEN

    def _cannot(self, problem: Problem, control: StepControl) -> str | None:
        """Return why this integrator cannot close the loops of the problem, or None."""
        return loops_refusal(problem, self.integrator)
