"""SUNDIALS IDA on the classical index-1 DAE, fully implicit: Eqs. (92), (94), the class of MATLAB's ode15i (DAE-FI).

    p' - G u = 0,   M u' + h - f - A^T lam = 0,   phi_ddot + 2 alpha phi_dot + beta^2 phi = 0

by variable-order BDF with exact Jacobian; ``form`` as in ``solvers.formulations.dae``. Defaults are the recommended
choices: lambda left out of the error test (with it, form fi stalls, since its lambda carries the noise of u'),
consistent start, quaternions.
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.classical import BaumgarteOptions
from .formulations.ida import InitialValueProblem, integrate
from .formulations.layout import Layout
from .formulations.recording import Clock
from .formulations.start import choose_layout
from .formulations.sundials import refuse_if_missing


@solver("ida_index1")
@dataclass(frozen=True)
class IdaIndex1(BaumgarteOptions):
    """IDA (BDF) on index 1 + Baumgarte, fully implicit or semi-explicit."""

    form: str = option("fi", "fully implicit (u' in the constraint row) or semi-explicit (M^-1)", choices=("fi", "se"))

    paper_label: ClassVar[str] = "DAE-FI"

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None: no scikit-sundae, or a cause common to symbolic solvers."""
        return refuse_if_missing() or super().refuses(problem, control)

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate index 1 with Baumgarte's terms by IDA, and return the trajectory."""
        layout, notes = choose_layout(problem, self.coordinates)

        def begin(layout: Layout, at: Problem) -> InitialValueProblem:
            """Return the equations on the rows of ``layout``, and consistent initial values at the start of ``at``."""
            y, y_dot = self.compute_start(layout, at)
            form = self.make_form(layout, self.form, self.alpha, self.beta)
            return InitialValueProblem(form, y, y_dot, () if self.lambda_in_error_test else (layout.lam,))

        return integrate(problem, control, layout, begin, notes, clock)
