"""SUNDIALS IDA on the index-3 DAE, Eq. (92) with phi = 0: the formulation of ADAMS and MotionSolve.

    p' - G u = 0,   M u' + h - f - A^T lam = 0,   phi = 0

by variable-order BDF with exact Jacobian. Velocities and multipliers are by default left out of the local error test,
whose estimates for them do not vanish with the step at index 3; only positions are controlled. phi_dot = 0 holds to the
integration error only; the start is made consistent, lambda included.
"""

from dataclasses import dataclass
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.classical import ImplicitOptions
from .formulations.ida import InitialValueProblem, integrate
from .formulations.layout import Layout
from .formulations.recording import Clock
from .formulations.refusals import refuse_without_phi
from .formulations.start import choose_layout, make_consistent, pack_start
from .formulations.sundials import refuse_if_missing


@solver("ida_index3")
@dataclass(frozen=True)
class IdaIndex3(ImplicitOptions):
    """IDA (BDF) on index 3, positions alone in the error test."""

    velocities_in_error_test: bool = option(False, "include the velocities in the local error test")
    lambda_in_error_test: bool = option(False, "include the multipliers in the local error test")
    first_step: float = option(
        1e-5, "first step; 0 lets IDA choose, so small that rounding in phi/h^2 swamps Newton", "s", at_least=0.0
    )

    paper_label: ClassVar[str] = "IDA index 3 (ADAMS/MotionSolve class)"

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Causes: scikit-sundae missing, rows without phi, and the causes common to symbolic solvers.
        """
        return refuse_if_missing() or refuse_without_phi(problem.system) or super().refuses(problem, control)

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate index 3, phi = 0, by IDA, and return the trajectory."""
        layout, notes = choose_layout(problem, self.coordinates)

        def begin(layout: Layout, at: Problem) -> InitialValueProblem:
            """Return the equations on the rows of ``layout``, and consistent initial values at the start of ``at``."""
            y, y_dot = make_consistent(layout, pack_start(layout, at), 0.0, 0.0, at.initial.t)
            velocities = () if self.velocities_in_error_test else (layout.u,)
            multipliers = () if self.lambda_in_error_test else (layout.lam,)
            return InitialValueProblem(
                self.make_form(layout, "position", 0.0, 0.0), y, y_dot, (*velocities, *multipliers)
            )

        return integrate(problem, control, layout, begin, notes, clock, first_step=self.first_step)
