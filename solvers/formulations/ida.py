"""SUNDIALS IDA (variable-order BDF) on an ``ImplicitForm``, one accepted step at a time, with a given Jacobian.

Counted: accepted steps, residual and Jacobian evaluations (those spent on Jacobians by differences among the former);
every Jacobian is factorised once. Errors are measured in the weighted root mean square alone, the norm that SUNDIALS
fixes in its vectors.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...harness.types import Problem, Status, StepControl, Trajectory
from .dae import ImplicitForm
from .generated import Program
from .generated.steps import take
from .layout import Layout
from .linear import BAND_WORK, find_band
from .recording import Clock, StepFailure, march
from .sundials import OUT_OF_TIME, Equations, Ida

DENSE_BELOW = 40  # unknowns
OUT_OF_TEST = 1e3  # absolute tolerance that takes a variable out of error test and Newton test (IDA divides by it)
FAILURES = {
    -2: (Status.STEP_UNDERFLOW, "the demanded accuracy is below rounding"),
    -3: (Status.STEP_UNDERFLOW, "the error test failed repeatedly or at the smallest step"),
    -4: (Status.DIVERGED, "Newton's iteration failed repeatedly or at the smallest step"),
    -5: (Status.CRASHED, "the linear solver could not start"),
    -6: (Status.SINGULAR, "the Jacobian could not be factorised"),
    -7: (Status.SINGULAR, "the linear system could not be solved"),
}


def integrate(
    problem: Problem, control: StepControl, layout: Layout, form: ImplicitForm, y: Float[np.ndarray, " n"],
    y_dot: Float[np.ndarray, " n"], out_of_test: tuple[slice, ...], notes: tuple[str, ...], clock: Clock, *,
    first_step: float = 0.0,
) -> Trajectory:  # fmt: skip
    """The trajectory by IDA from (``y``, ``y_dot``); parts of y ``out_of_test`` are in no error test.

    ``clock`` runs since the set-up began; ``first_step`` [s], 0 lets IDA choose it.
    """
    assert control.rtol is not None  # the catalogue has seen to it
    order, place, linear_solver = _choose_order(form)
    equations = _in_order(form, order, place)
    equations.y[:], equations.y_dot[:] = y[order], y_dot[order]
    with Ida(
        equations, linear_solver, rtol=control.rtol, atol=tolerances(control.rtol, layout.n, out_of_test)[order],
        first_step=min(first_step, control.max_step or np.inf), max_step=control.max_step or 0.0, seconds=clock.left(),
    ) as ida:  # fmt: skip
        ida.stop_at(problem.t_end)
        lam = layout.lam

        def advance() -> tuple[float, np.ndarray, np.ndarray]:
            flag, t, y = ida.step(problem.t_end)
            if flag in OUT_OF_TIME:
                raise clock.failure()
            if flag < 0:
                status, words = FAILURES.get(flag, (Status.CRASHED, f"flag {flag}"))
                raise StepFailure(status, f"IDA: {words}" + (f" ({ida.messages})" if ida.messages else ""))
            y = y.take(place)
            return t, y, layout.all_rows(y[lam])

        def count(steps: int) -> dict[str, int]:
            spent, jacobians = form.difference_evaluations, ida.jacobians
            counted = {"jacobians": jacobians, "factorisations": jacobians, "difference_evaluations": spent}
            return {"evaluations": ida.evaluations + spent, **counted}

        return march(problem, control, layout, clock, advance, y, layout.all_rows(y[lam]), count, notes)


def tolerances(rtol: float, n: int, out_of_test: Sequence[slice]) -> Float[np.ndarray, " n"]:
    """Absolute tolerances of ``n`` unknowns: ``rtol``, but for what is in no error test."""
    atol = np.full(n, rtol)
    for part in out_of_test:
        atol[part] = OUT_OF_TEST
    return atol


def _choose_order(form: ImplicitForm) -> tuple[np.ndarray, np.ndarray, str]:
    """Ours by IDA's, IDA's by ours, and the linear solver: a band, unless the matrix is small or its band too wide."""
    pattern, own = form.pattern, np.arange(len(form.y))
    if len(own) < DENSE_BELOW:
        return own, own, "dense"
    band = find_band(pattern)
    return (own, own, "sparse") if band.work > BAND_WORK else (band.order, band.place, "band")


def _in_order(form: ImplicitForm, order: np.ndarray, place: np.ndarray) -> Equations:
    """``form`` with unknowns and equations in IDA's order."""
    y, y_dot, F = (np.zeros(len(order)) for _ in range(3))
    steps = [take(y, place, form.y), take(y_dot, place, form.y_dot), form.evaluate.step, take(form.F, order, F)]

    def jacobian(cj: float) -> np.ndarray:
        of_y, of_y_dot = form.jacobian(y.take(place), y_dot.take(place), float(form.t[0]))
        return of_y + cj * of_y_dot

    rows, columns = place[form.pattern.rows], place[form.pattern.columns]
    return Equations(Program(steps, form), form.t, y, y_dot, F, jacobian, rows, columns)
