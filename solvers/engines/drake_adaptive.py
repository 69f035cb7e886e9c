"""Drake: integrators of its continuous plant with error control, accuracy rtol.

CENIC is the convex integrator for contact of Kurtz and Castro (arXiv:2511.08771). Loops are refused, as in ``drake``.
With ``settings`` "default" the integrator and the largest step are those of an unconfigured Simulator, runge_kutta3
and 0.1 s; the accuracy is still rtol.
"""

from dataclasses import dataclass
from typing import ClassVar

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.types import Problem, StepControl
from .drake import TAKEN, refuse_loops
from .export.engine import SupportedElements
from .export.protocol import Adapter

INTEGRATORS = ("runge_kutta3", "runge_kutta5", "bogacki_shampine3", "implicit_euler", "radau3", "cenic")


@solver("drake_adaptive")
@dataclass(frozen=True)
class DrakeAdaptive(Adapter):
    """Drake's continuous plant, integrated with error control."""

    integrator: str = option("runge_kutta3", "Drake's name of it", choices=INTEGRATORS)
    settings: str = option("ours", "ours: the options above; default: the engine's own", choices=("ours", "default"))

    control: ClassVar[str] = "rtol"
    inside: ClassVar[str] = "drake"
    package: ClassVar[str] = "pydrake"
    wheel: ClassVar[str] = "drake"
    takes: ClassVar[SupportedElements] = TAKEN

    def _refuse_options(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the chosen integrator cannot enforce the closed loops of the problem, or None if it can."""
        return refuse_loops(problem, self.integrator)
