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
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from sksundae.ida import IDA

from ...harness.types import Problem, Status, StepControl, Trajectory
from .dae import ImplicitForm
from .layout import Layout
from .linear import BAND_WORK, DENSE_BELOW, find_band
from .recording import Clock, StepFailure, march, trajectory
from .sparse_pattern import FixedPattern

OUT_OF_TEST = 1e3  # absolute tolerance that takes a variable out of error test and Newton test (IDA divides by it)
LARGEST_BAND = 2000  # unknowns; scikit-sundae hands a banded Jacobian over as a full matrix, of 32 MB here
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
    unknowns = _choose_order(form.pattern)
    residual, jacobian = _callbacks(form, unknowns, clock, work)
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()) as said:  # IDA prints SUNDIALS' messages
        warnings.filterwarnings("ignore", "Custom sparse Jacobian approximation")  # ours is exact, and meant
        ida = IDA(
            residual,
            jacfn=jacobian,
            rtol=control.rtol,
            atol=atol[unknowns.order],
            first_step=min(start.first_step, control.max_step or np.inf),
            max_step=control.max_step or 0.0,
            max_num_steps=ONE_STEP_LIMIT,
            algebraic_idx=unknowns.place[layout.n_p + layout.n_u :],
            **unknowns.options,
        )
        ida.init_step(0.0, start.y[unknowns.order], start.y_dot[unknowns.order])
        setup_time = clock.restart()

        lam = layout.lam

        def advance() -> tuple[float, np.ndarray, np.ndarray]:
            step = ida.step(problem.t_end, method="onestep", tstop=problem.t_end)
            if step.status < 0:
                status, words = FAILURES.get(step.status, (Status.CRASHED, step.message))
                native = " ".join(said.getvalue().split())
                raise StepFailure(status, f"IDA: {words}" + (f" ({native})" if native else ""))
            y = step.y[unknowns.place]
            return step.t, y, y[lam]

        done = march(advance, (0.0, start.y, start.y[layout.lam]), layout, problem.t_end, control, clock)
        cpu_time = clock.cpu_time()
    counters = {
        **work,
        "evaluations": work["evaluations"] + form.difference_evaluations,
        "factorisations": work["jacobians"],
        "difference_evaluations": form.difference_evaluations,
    }
    return trajectory(layout, done, counters, notes, cpu_time=cpu_time, setup_time=setup_time)


class _Order(NamedTuple):
    """The order in which IDA has the unknowns and equations: those of ours by IDA's, and IDA's of ours."""

    order: Int[np.ndarray, " n"]
    place: Int[np.ndarray, " n"]
    entries: Any  # of the Jacobian that IDA hands over, one for each nonzero of ours
    options: dict[str, Any]


def _choose_order(pattern: FixedPattern) -> _Order:
    """That of the narrowest band, unless the matrix is small or its band too wide.

    IDA's sparse solver is SuperLU_MT, whose threads take milliseconds to set out whatever the size, unless they are
    limited to one; the chain's band is faster in both cases.
    """
    n, own = pattern.shape[0], np.arange(pattern.shape[0])
    if n < DENSE_BELOW:
        return _Order(own, own, pattern.rows * n + pattern.columns, {"linsolver": "dense"})
    band = find_band(pattern)
    if n > LARGEST_BAND or band.work > BAND_WORK:
        ones = pattern.column_matrix(np.ones(pattern.nnz))
        return _Order(own, own, slice(None), {"linsolver": "sparse", "sparsity": ones})
    options = {"linsolver": "band", "lband": band.below, "uband": band.above}
    return _Order(band.order, band.place, band.row * n + band.column, options)


def _callbacks(form: ImplicitForm, unknowns: _Order, clock: Clock, work: dict[str, int]) -> tuple[Callable, Callable]:
    """``resfn`` and ``jacfn``; the clock is checked here because some steps of IDA never return."""
    order, place, entries, _ = unknowns

    def residual(t: float, y: np.ndarray, y_dot: np.ndarray, res: np.ndarray) -> None:
        work["evaluations"] += 1
        clock.check()
        form.residual(y.take(place), y_dot.take(place), t).take(order, out=res)

    def jacobian(t: float, y: np.ndarray, y_dot: np.ndarray, res: np.ndarray, cj: float, JJ: np.ndarray) -> None:
        work["jacobians"] += 1
        of_y, of_y_dot = form.jacobian(y.take(place), y_dot.take(place), t)
        JJ.reshape(-1)[entries] = of_y + cj * of_y_dot

    return residual, jacobian
