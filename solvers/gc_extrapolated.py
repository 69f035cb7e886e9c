"""ODE-GC extrapolated to orders 4, 6 and 8 with error control: its step in the symmetric gauge has an expansion in h^2.

Runs of 1, 2, ..., K steps over H are combined as in the method of Gragg, Bulirsch and Stoer (Hairer, Norsett, Wanner,
Solving ODEs I, II.9), on changes of the poses in space and on the rotation group. The projection that ends each step
makes phi = 0 but is not reversible: energy drifts with the tolerance, as it does with Runge-Kutta methods.
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.compiled.host import code_option, integrate
from .formulations.methods.choices import CHOICES
from .formulations.methods.gc_extrapolated import make_extrapolated_method
from .gc_composed import refuse_system
from .gc_weak_form import GcWeakForm


@solver("gc_extrapolated")
@dataclass(frozen=True)
class GcExtrapolated:
    """ODE-GC's reversible step, extrapolated in even powers with error control."""

    columns: int = option(3, "K: runs of 1 to K steps are combined to order 2 K", "", at_least=2, at_most=5)
    direction: str = option("a", "c_R of Eq. (31), as in gc_weak_form", choices=CHOICES)
    tolerance: float = option(1e-12, "tolerance of test (80) in each sub-step", "sqrt(J)", above=0.0)
    code: str = code_option("kernel", "mechanism")

    name: ClassVar[str]
    control: ClassVar[str] = "rtol"

    @property
    def paper_label(self) -> str:
        """Label in tables; the paper has no extrapolated method."""
        return f"ODE-GC (extrapolated, order {2 * self.columns})"

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Causes: forces other than gravity, joints other than spherical and revolute ones, a direction that the joints do
        not have, or code=mechanism where none can be made.
        """
        return (
            refuse_system(problem.system)
            or self._weak_form.refuses_direction(problem)
            or self._weak_form.refuses_code(problem)
        )

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate with error control at ``control.rtol`` and return the trajectory."""
        return integrate(
            problem,
            control,
            make_extrapolated_method(problem.system, self._weak_form.make_settings(problem), self.columns),
        )

    @property
    def _weak_form(self) -> GcWeakForm:
        """Solver of the weak form with the same options, whose steps are extrapolated."""
        return GcWeakForm(direction=self.direction, tolerance=self.tolerance, code=self.code)
