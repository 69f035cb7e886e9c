"""NDF of orders 1 to 5 on the semi-explicit index-1 DAE: Eqs. (92), (94), the class of MATLAB's ode15s (DAE-SE).

    p' = G u,   u' = w,   M w + h - f - A^T lam = 0,   A w + gamma + 2 alpha phi_dot + beta^2 phi = 0

by numerical differentiation formulas in quasi-constant steps (Shampine and Reichelt 1997; scipy_dae with
``NDF_strategy="efficiency"``, whose coefficients are ode15s's). The formula gives u', so that w need not be stored:
the discrete equations are those of form fi of ``solvers.formulations.dae``.

``accelerations="eliminated"`` substitutes w = M^-1 (f - h + A^T lam) in the constraint row (form se). The solution is
the same, but a Jacobian one step old then errs by dA M^-1 / dt: on the four-bar grid, where A M^-1 A^T has condition
number 1.7e8, Newton's contraction rate grows from 5e-3 to 40 at a step of 1e-3 s, and a run from 127 to 10,281 steps.

``accelerations="mass_matrix"`` is the form that ode15s takes, E(y) y' = f(y), E = [I 0 0; 0 M 0; 0 A 0] singular. The
residual is that of form fi, written so; ode15s's default for such an E ("weak" dependence on the state) leaves
d(E y')/dy out of Newton's matrix E / (gamma dt) - df/dy, and so does this form.

ode15s measures errors in the maximum norm, scipy_dae in the root mean square: equal tolerances are not equal errors.
``norm="max"`` is ode15s's, in the error test, Newton's test and the choice of order; the first step is scipy_dae's.
Counted are accepted steps, evaluations, Jacobians, factorisations, linear solves (one per Newton iteration), and the
evaluations spent on Jacobians by differences, which the evaluations include. Rejected steps are not counted.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..harness.catalogue.options import option
from ..harness.catalogue.registry import solver
from ..harness.mechanics.types import Problem, Status, StepControl, Trajectory
from .formulations.classical import BaumgarteOptions
from .formulations.dae import ImplicitForm
from .formulations.error_test import tolerances
from .formulations.layout import Layout
from .formulations.newton import NDF_SCHEME, DaeSolver, Scheme, maximum, root_mean_square
from .formulations.recording import Clock, StepFailure, march
from .formulations.rows_in_use import RowsInUse
from .formulations.start import choose_layout


@solver("ndf_index1")
@dataclass(frozen=True)
class NdfIndex1(BaumgarteOptions):
    """NDF (ode15s's class) on semi-explicit index 1 + Baumgarte."""

    accelerations: str = option(
        "unknown",
        "accelerations as algebraic unknowns, eliminated by M^-1, or left in E(y) y' = f(y) as in ode15s",
        choices=("unknown", "eliminated", "mass_matrix"),
    )

    norm: str = option(
        "rms",
        "norm of the local error and of Newton's corrections: root mean square or maximum",
        choices=("rms", "max"),
    )

    paper_label: ClassVar[str] = "DAE-SE"
    rows_every: ClassVar[int] = 12  # steps between two checks of the rows in use
    scheme: ClassVar[Scheme] = NDF_SCHEME

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate index 1 with Baumgarte's terms by the ``scheme`` of scipy_dae, and return the trajectory."""
        layout, notes = choose_layout(problem, self.coordinates)
        assert control.rtol is not None  # checked by the catalogue
        norm = root_mean_square if self.norm == "rms" else maximum
        keep = self.accelerations != "mass_matrix"  # F = E(y) y' - f(y): without y', dF/dy reduces to -df/dy
        pieces = list[tuple[DaeSolver, ImplicitForm]]()

        def begin(layout: Layout, at: Problem) -> None:
            """Begin a new integration from the initial state of ``at``, on the constraint rows of ``layout``."""
            form = self.make_form(layout, "se" if self.accelerations == "eliminated" else "fi", self.alpha, self.beta)
            atol = tolerances(control.rtol or 0.0, layout.n, () if self.lambda_in_error_test else (layout.lam,))
            start = (at.initial.t, *self.compute_start(layout, at))
            ndf = self.scheme.set_up_method(form, start, problem.t_end, control, atol, norm, clock, keep_y_dot=keep)
            pieces.append((ndf, form))

        rows = RowsInUse(layout, begin, problem, every=self.rows_every)
        y = pieces[0][0].y

        def advance() -> tuple[float, np.ndarray, np.ndarray]:
            """Take a step; return time [s], unknowns y and the reactions, after a check of the rows in use."""
            t, y, reaction = _take_step(pieces[-1][0], rows.layout)
            rows.update_rows(t, y)
            return t, y, reaction

        def count(steps: int) -> dict[str, int]:
            """Return the counters, summed over all integrations; ``steps``, those accepted, are counted elsewhere."""
            spent = sum(form.difference_evaluations for _, form in pieces)
            names = ("nfev", "njev", "nlu", "solutions")
            total = {name: sum(getattr(ndf, name) for ndf, _ in pieces) for name in names}
            return {
                "evaluations": total["nfev"] + spent,
                "jacobians": total["njev"],
                "factorisations": total["nlu"],
                "linear_solves": total["solutions"],  # scipy_dae's only count of Newton iterations
                "difference_evaluations": spent,
            }

        in_use = lambda: (rows.layout, rows.notes)  # noqa: E731  read anew at each call
        reaction = layout.all_rows(y[layout.lam])
        return march(problem, control, layout, clock, advance, y, reaction, count, notes, in_use)


def _take_step(ndf: DaeSolver, layout: Layout) -> tuple[float, np.ndarray, np.ndarray]:
    """Take one step of scipy_dae's method ``ndf``; return time [s], unknowns y and the reaction of all constraint rows.

    Raises ``StepFailure`` where the step fails, singular and non-finite matrices included.
    """
    try:
        message = ndf.step()
    except (RuntimeError, np.linalg.LinAlgError) as error:  # SuperLU's "Factor is exactly singular"
        raise StepFailure(Status.SINGULAR, f"the Jacobian could not be factorised ({error})") from None
    except ValueError as error:  # LAPACK's wrappers on NaN or infinity
        raise StepFailure(Status.DIVERGED, f"the linear system is not finite ({error})") from None
    if ndf.status == "failed":
        raise StepFailure(Status.STEP_UNDERFLOW, str(message).rstrip(".").lower())
    return ndf.t, ndf.y, layout.all_rows(ndf.y[layout.lam])
