"""Radau IIA of order 5 on the semi-explicit index-1 DAE of ``ndf_index1``: its equations and options but ``norm``.

Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.8, as scipy_dae implements it for implicit
DAEs, with its error estimate, and with Baumgarte stabilisation. The method is implicit in springs and dampers, so that
stiff ones do not limit the step. Linear solves are counted as scipy_dae does: a real and a complex one per iteration,
and those of the error estimate.
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl
from .formulations.newton import RADAU_SCHEME, Scheme
from .ndf_index1 import NdfIndex1


@solver("radau_index1")
@dataclass(frozen=True)
class RadauIndex1(NdfIndex1):
    """Radau IIA of order 5 on semi-explicit index 1 + Baumgarte, error control."""

    paper_label: ClassVar[str] = ""
    rows_every: ClassVar[int] = 4
    scheme: ClassVar[Scheme] = RADAU_SCHEME

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None: a norm other than the root mean square, or as ``ndf_index1``."""
        if self.norm != "rms":
            return "errors are measured in the root mean square only: norm = max is an option of ndf_index1"
        return super().refuses(problem, control)
