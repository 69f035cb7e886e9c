"""SUNDIALS IDA on index 2: the stabilised form of Gear, Gupta and Leimkuhler (1985), or phi_dot + alpha phi = 0.

    ggl        p' - G (u + A^T eta) = 0,   M u' + h - f - A^T lam = 0,   phi = 0,   A u = 0
    velocity   p' - G u = 0,               M u' + h - f - A^T lam = 0,   A u + alpha phi = 0

by variable-order BDF. These are the counterparts of Baumgarte's stabilisation at index 2
(docs/decisions/baumgarte-index3.md): in form ggl both levels hold at every step, in form velocity phi decays as
exp(-alpha t). lambda and eta are by default left out of the local error test, whose estimates for them do not vanish
with the step at index 2; positions and velocities are controlled.
"""

from dataclasses import dataclass

import numpy as np

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.classical import ImplicitOptions
from .formulations.ida import InitialValueProblem, integrate
from .formulations.layout import Layout, StabilisedLayout
from .formulations.recording import Clock
from .formulations.refusals import refuse_without_phi
from .formulations.start import choose_layout, make_consistent, pack_start
from .formulations.sundials import refuse_if_missing


@solver("ida_index2")
@dataclass(frozen=True)
class IdaIndex2(ImplicitOptions):
    """IDA (BDF) on index 2, stabilised or with velocity-level Baumgarte."""

    form: str = option(
        "ggl", "phi = 0 and A u = 0 with a second multiplier, or A u + alpha phi = 0", choices=("ggl", "velocity")
    )
    alpha: float = option(5.0, "alpha of form velocity: A u + alpha phi", "1/s", at_least=0.0)
    lambda_in_error_test: bool = option(False, "include the multipliers in the local error test")

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Causes: an alpha without effect, scikit-sundae missing, rows without phi in form ggl, and the causes common to
        symbolic solvers.
        """
        if self.form == "ggl" and self.alpha != type(self).alpha:
            return f"alpha = {self.alpha:g} acts in form velocity only: form ggl holds phi = 0 itself"
        reason = refuse_without_phi(problem.system) if self.form == "ggl" else None
        return refuse_if_missing() or reason or super().refuses(problem, control)

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate index 2, in the ``form`` of the option, by IDA, and return the trajectory."""
        layout, notes = choose_layout(problem, self.coordinates)
        rate = self.alpha if self.form == "velocity" else 0.0  # the row's derivative: phi_ddot + rate phi_dot
        if self.form == "ggl":
            layout = StabilisedLayout(layout.system, layout.chart, layout.kept)

        def begin(layout: Layout, at: Problem) -> InitialValueProblem:
            """Return the equations on the rows of ``layout``, and consistent initial values at the start of ``at``."""
            plain = Layout(layout.system, layout.chart, layout.kept)
            y, y_dot = make_consistent(plain, pack_start(plain, at), rate / 2.0, 0.0, at.initial.t)
            multipliers = [layout.lam]
            if isinstance(layout, StabilisedLayout):
                y, y_dot = (np.concatenate((part, np.zeros(layout.k))) for part in (y, y_dot))
                multipliers.append(layout.eta)
            form = self.make_form(layout, "both" if self.form == "ggl" else "velocity", self.alpha, 0.0)
            return InitialValueProblem(form, y, y_dot, () if self.lambda_in_error_test else tuple(multipliers))

        return integrate(problem, control, layout, begin, notes, clock)
