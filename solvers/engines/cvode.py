"""SUNDIALS CVODE on the strong form, Eq. (65), without its quadratures lam: Adams (orders 1 to 12) or BDF (1 to 5).

    y = (p, u),   y' = (G u, u_dot) with u_dot from Eq. (65)

Newton's linear systems are solved by matrix-free GMRES: scikit-sundae accepts no exact Jacobian that would be cheaper,
and the equations are not stiff. Every evaluation calls Python, an overhead that is part of the CPU time. Constraints
hold through phi_ddot = 0 alone unless ``alpha`` and ``beta`` are given. Counted are accepted steps and evaluations; one
evaluation at the start and one per step yield the reaction.
"""

import contextlib
import io
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.types import Problem, Status, StepControl, Trajectory
from ..formulations.classical import SymbolicOptions
from ..formulations.ida import FAILURES
from ..formulations.layout import Layout
from ..formulations.recording import Clock, StepFailure, march
from ..formulations.rows_in_use import RowsInUse
from ..formulations.start import choose_layout, pack_start
from ..formulations.strong_form import StrongForm
from ..formulations.sundials import ONE_STEP_LIMIT, refuse_if_missing
from .export.engine import describe_engine

# steps between two checks of the rows in use: fewer cost more rank searches, more may miss dependent rows. On two of
# Bennett's linkages half takes 1 and 5 % fewer evaluations, twice 8 % fewer and 4 % more.
ROWS_EVERY = 2


@solver("cvode")
@dataclass(frozen=True)
class Cvode(SymbolicOptions):
    """SUNDIALS CVODE on Eq. (65)."""

    method: str = option("Adams", "linear multistep method", choices=("Adams", "BDF"))
    alpha: float = option(0.0, "Baumgarte: 2 alpha phi_dot", "1/s", at_least=0.0)
    beta: float = option(0.0, "Baumgarte: beta^2 phi", "1/s", at_least=0.0)

    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "rtol"

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None: no scikit-sundae, or a cause common to symbolic solvers."""
        return refuse_if_missing() or super().refuses(problem, control)

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate Eq. (65) by CVODE without lam and lam_dot, one accepted step at a time; return the trajectory.

        One additional evaluation per accepted step yields the reaction. Raises ``StepFailure`` at a limit of CPU time
        before the first step.
        """
        from sksundae.cvode import CVODE  # imported here, since on systems without it the class above refuses

        layout, notes = choose_layout(problem, self.coordinates)
        n, still = layout.n_p + layout.n_u, np.zeros(layout.k)
        form, y, work = StrongForm(layout, self.alpha, self.beta), np.zeros(n), {"evaluations": 0}

        def rates(t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Return y' and the reactions at (t, y); count the evaluation and check the CPU limit."""
            work["evaluations"] += 1
            clock.check()
            found = form.rates(y, still, still, t)
            return np.concatenate((found.p_dot, found.u_dot)), form.all_rows(found.reaction)

        def rhs(t: float, y: np.ndarray, y_dot: np.ndarray) -> None:
            y_dot[:] = rates(t, y)[0]

        def begin(layout: Layout, problem: Problem) -> None:
            """Restart CVODE from the start of ``problem``, on the constraint rows of ``layout``."""
            nonlocal form, y
            form, y = StrongForm(layout, self.alpha, self.beta), pack_start(layout, problem)[:n]
            cvode.init_step(problem.initial.t, y)

        with contextlib.redirect_stdout(io.StringIO()) as said:  # SUNDIALS prints its messages
            cvode = CVODE(
                rhs,
                method=self.method,
                rtol=control.rtol,
                atol=control.rtol,
                linsolver="gmres",
                max_step=control.max_step or 0.0,
                max_num_steps=ONE_STEP_LIMIT,
            )
            rows = RowsInUse(layout, begin, problem, every=ROWS_EVERY)
            reaction = rates(problem.initial.t, y)[1]

            def advance() -> tuple[float, np.ndarray, np.ndarray]:
                """Take a step, and return time, unknowns and reactions; raise StepFailure in CVODE's words."""
                step = cvode.step(problem.t_end, method="onestep", tstop=problem.t_end)
                if step.status < 0:
                    status, words = FAILURES.get(step.status, (Status.CRASHED, step.message))
                    native = " ".join(said.getvalue().split())
                    raise StepFailure(status, f"CVODE: {words}" + (f" ({native})" if native else ""))
                reaction = rates(step.t, step.y)[1]
                rows.update_rows(step.t, step.y)
                return step.t, step.y, reaction

            in_use = lambda: (rows.layout, rows.notes)  # noqa: E731  read anew at each call
            notes = (*notes, describe_engine("scikit-sundae"))
            return march(problem, control, layout, clock, advance, y, reaction, lambda steps: work, notes, in_use)
