"""SUNDIALS IDA (variable-order BDF) on an ``ImplicitForm``, one accepted step at a time, with a given Jacobian.

Counted: accepted steps, residual and Jacobian evaluations; every Jacobian is factorised once. scikit-sundae reports
neither rejected steps nor Newton iterations, so these are not counted (evaluations include them, and those spent on
Jacobians by differences). Errors are measured in the weighted root mean square alone: SUNDIALS fixes that norm in its
vectors, and scikit-sundae offers no replacement.
"""

import contextlib
import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from sksundae.ida import IDA

from ...harness.types import Problem, Status, StepControl, Trajectory
from .dae import ImplicitForm
from .layout import Layout
from .recording import Clock, StepFailure, march, trajectory

OUT_OF_TEST = 1e3  # absolute tolerance that takes a variable out of error test and Newton test (IDA divides by it)
DENSE_BELOW = 40  # unknowns; below, IDA's dense LU is faster than SuperLU's bookkeeping
ONE_STEP_LIMIT = 100_000  # IDA's own limit a call; a call is one step here
FAILURES = {
    -2: (Status.STEP_UNDERFLOW, "the demanded accuracy is below rounding"),
    -3: (Status.STEP_UNDERFLOW, "the error test failed repeatedly or at the smallest step"),
    -4: (Status.DIVERGED, "Newton's iteration failed repeatedly or at the smallest step"),
    -5: (Status.CRASHED, "the linear solver could not start"),
    -6: (Status.SINGULAR, "the Jacobian could not be factorised"),
    -7: (Status.SINGULAR, "the linear system could not be solved"),
}


@dataclass(frozen=True)
class Start:
    """What the integration starts from, and what its error test leaves out."""

    y: Float[np.ndarray, " n"]
    y_dot: Float[np.ndarray, " n"]
    out_of_test: tuple[slice, ...]
    first_step: float = 0.0  # [s]; 0: IDA's own choice


def integrate(
    problem: Problem,
    control: StepControl,
    layout: Layout,
    form: ImplicitForm,
    start: Start,
    notes: tuple[str, ...],
    clock: Clock,
) -> Trajectory:
    """The trajectory by IDA; ``clock`` runs since the set-up began."""
    atol = np.full(layout.n, control.rtol)
    for part in start.out_of_test:
        atol[part] = OUT_OF_TEST
    work = {"evaluations": 0, "jacobians": 0}
    residual, jacobian = _callbacks(layout, form, clock, work)
    ones = form.pattern.column_matrix(np.ones(form.pattern.nnz))
    options = {"linsolver": "dense"} if layout.n < DENSE_BELOW else {"linsolver": "sparse", "sparsity": ones}
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()) as said:  # IDA prints SUNDIALS' messages
        warnings.filterwarnings("ignore", "Custom sparse Jacobian approximation")  # ours is exact, and meant
        ida = IDA(
            residual,
            jacfn=jacobian,
            rtol=control.rtol,
            atol=atol,
            first_step=min(start.first_step, control.max_step or np.inf),
            max_step=control.max_step or 0.0,
            max_num_steps=ONE_STEP_LIMIT,
            algebraic_idx=range(layout.n_p + layout.n_u, layout.n),
            **options,
        )
        ida.init_step(0.0, start.y, start.y_dot)
        setup_time = clock.restart()

        def advance() -> tuple[float, np.ndarray, np.ndarray]:
            step = ida.step(problem.t_end, method="onestep", tstop=problem.t_end)
            if step.status < 0:
                status, words = FAILURES.get(step.status, (Status.CRASHED, step.message))
                native = " ".join(said.getvalue().split())
                raise StepFailure(status, f"IDA: {words}" + (f" ({native})" if native else ""))
            return step.t, step.y, step.y[layout.lam]

        done = march(advance, (0.0, start.y, start.y[layout.lam]), layout, problem.t_end, control, clock)
        cpu_time = clock.cpu_time()
    counters = {
        **work,
        "evaluations": work["evaluations"] + form.difference_evaluations,
        "factorisations": work["jacobians"],
        "difference_evaluations": form.difference_evaluations,
    }
    return trajectory(layout, done, counters, notes, cpu_time=cpu_time, setup_time=setup_time)


def _callbacks(layout: Layout, form: ImplicitForm, clock: Clock, work: dict[str, int]) -> tuple[Callable, Callable]:
    """``resfn`` and ``jacfn``; the clock is checked here because some steps of IDA never return."""

    def residual(t: float, y: np.ndarray, y_dot: np.ndarray, res: np.ndarray) -> None:
        work["evaluations"] += 1
        clock.check()
        res[:] = form.residual(y, y_dot, t)

    pattern, small = form.pattern, layout.n < DENSE_BELOW
    place = pattern.rows, pattern.columns

    def jacobian(t: float, y: np.ndarray, y_dot: np.ndarray, res: np.ndarray, cj: float, JJ: np.ndarray) -> None:
        work["jacobians"] += 1
        of_y, of_y_dot = form.jacobian(y, y_dot, t)
        if small:
            JJ[place] = of_y + cj * of_y_dot
        else:
            JJ[:] = of_y + cj * of_y_dot

    return residual, jacobian
