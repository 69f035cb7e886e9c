"""Options and refusals shared by the solvers on the symbolic route, Eqs. (65) and (92)-(94)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from ...harness.catalogue.options import option
from ...harness.mechanics.types import Problem, StepControl
from .charts import CHARTS
from .dae import ImplicitForm
from .differences import DifferencedForm
from .layout import Layout
from .recording import ClockedSolver
from .start import make_consistent, make_unloaded_start, pack_start, refuse_redundant_rows
from .tracing import refuse_without_expression


@dataclass(frozen=True)
class SymbolicOptions(ClockedSolver):
    """Options of the solvers on symbolic elements: the chart of rotations and the treatment of redundant rows."""

    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "rtol"

    coordinates: str = option(
        "quaternion", "chart of each body; the paper's is euler313", choices=("quaternion", "euler313")
    )
    redundancy: str = option(
        "drop", "redundant rows: drop all but an independent set at the start, or refuse", choices=("drop", "refuse")
    )

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why this solver cannot solve the problem, or None.

        Reasons: no ``rtol``, redundant constraint rows with redundancy=refuse, a start at the chart's singularity, or a
        user force that cannot be differentiated symbolically.
        """
        if control.rtol is None:
            return f"error control needs rtol; a fixed step was given (dt={control.dt:g})"
        if self.redundancy == "refuse":
            reason = refuse_redundant_rows(problem)
            if reason is not None:
                return reason
        chart = CHARTS[self.coordinates]
        return chart.refuse_start(problem.system, problem.initial) or refuse_without_expression(problem.system, chart)


@dataclass(frozen=True)
class ImplicitOptions(SymbolicOptions):
    """Options of the solvers of F(t, y, y') = 0: how its Jacobian is computed."""

    jacobian: str = option(
        "exact",
        "exact, or column-grouped forward differences as in a code that is given no derivatives",
        choices=("exact", "finite_difference"),
    )

    def make_form(self, layout: Layout, form: str, alpha: float, beta: float) -> ImplicitForm:
        """Make the residual F(t, y, y') of ``form``, one of the five names that ``ImplicitForm`` takes.

        Its Jacobian is exact or by differences, as the option ``jacobian`` says; ``alpha`` and ``beta`` [1/s] are
        Baumgarte's.
        """
        return (ImplicitForm if self.jacobian == "exact" else DifferencedForm)(layout, form, alpha, beta)


@dataclass(frozen=True)
class BaumgarteOptions(ImplicitOptions):
    """Options of Eq. (94), of its start, and of the error test; the paper states no alpha and beta."""

    alpha: float = option(5.0, "Baumgarte: 2 alpha phi_dot", "1/s", at_least=0.0)
    beta: float = option(5.0, "Baumgarte: beta^2 phi", "1/s", at_least=0.0)
    lambda_in_error_test: bool = option(False, "include the multipliers in the local error test")
    consistent_start: bool = option(True, "start from consistent accelerations and multipliers, else from lambda = 0")

    def compute_start(
        self, layout: Layout, problem: Problem
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return (y, y') at the problem's initial state.

        With ``consistent_start`` accelerations and multipliers solve the equations of index 1; without it lam = 0 and
        the accelerations are those of free fall. A state later than t = 0, where the integrator restarts on other
        constraint rows, is always made consistent.
        """
        y, t = pack_start(layout, problem), problem.initial.t
        if self.consistent_start or t > 0.0:
            return make_consistent(layout, y, self.alpha, self.beta, t)
        return make_unloaded_start(layout, y)
