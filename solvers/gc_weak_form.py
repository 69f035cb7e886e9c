"""ODE-GC: the three-field weak form with geometrically consistent steps (Sect. 4.2, Eqs. 66 to 81).

Unknowns of a step are v and nu = M_bar mu at its end. Momentum balance (74) in space with the trapezoidal rule,
velocity constraints (75), poses by the autoparallel through the mean velocity (66), lam by (67). Newton's method (78),
(79) is simplified, with a kept Jacobian, or exact (option ``newton``); a step that does not converge is halved, and the
step size grows back. Second order, time-reversible in the symmetric gauge. phi itself is not corrected: it stays
O(dt^2).
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, StepControl, Trajectory
from .formulations.methods.choices import GaugeChoices
from .formulations.methods.gc_weak_form import integrate_weak_form
from .formulations.rank import rows_to_keep


@solver("gc_weak_form")
@dataclass(frozen=True)
class GcWeakForm(GaugeChoices):
    """Weak form with geometrically consistent steps of fixed size, independent constraints."""

    rank_check: bool = option(True, "refuse redundant rows; without it the step is tried and fails or not on its own")

    name: ClassVar[str]
    control: ClassVar[str] = "dt"
    order: ClassVar[float] = 2.0
    has_plain: ClassVar[bool] = True

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Causes: redundant rows, which make the Newton matrix singular, and options that do not fit the problem or the
        step control.
        """
        reason = self.refuses_choice(problem, control)
        if reason is not None:
            return reason
        rows = problem.system.nrows
        missing = rows - len(rows_to_keep(problem.system, problem.initial)) if self.rank_check else 0
        if missing:
            return (
                f"needs independent constraints: {rows} rows have rank {rows - missing} at the start "
                f"({missing} redundant); use gc_augmented_lagrangian"
            )
        return None

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate with the fixed step ``control.dt`` and return the trajectory."""
        out = integrate_weak_form(problem, control, self, self.make_settings(problem))
        return replace(out, notes=(*out.notes, *self.notes(problem)))
