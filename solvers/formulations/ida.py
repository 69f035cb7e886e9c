"""SUNDIALS IDA (variable-order BDF) on an ``ImplicitForm``, one accepted step at a time, with a given Jacobian.

Counted: accepted steps, and residual and Jacobian evaluations; residuals that a Jacobian by differences needs are part
of the evaluations. Every Jacobian is factorised once. Errors are measured in the weighted root mean square, which is
the only norm of SUNDIALS' vectors.
"""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...harness.base.generated import Program
from ...harness.base.generated.steps import take
from ...harness.base.private_interfaces import is_known
from ...harness.mechanics.types import Problem, Status, StepControl, Trajectory
from .dae import ImplicitForm
from .error_test import tolerances
from .layout import Layout
from .linear import BAND_WORK, find_band
from .public_ida import PublicIda
from .recording import Clock, StepFailure, march
from .rows_in_use import RowsInUse
from .sundials import OUT_OF_TIME, Ida, IdaEquations


class InitialValueProblem(NamedTuple):
    """The equations F = 0, their initial values (y, y'), and the slices of y that the error test leaves out."""

    form: ImplicitForm
    y: Float[np.ndarray, " n"]
    y_dot: Float[np.ndarray, " n"]
    out_of_test: tuple[slice, ...] = ()


Begin = Callable[[Layout, Problem], InitialValueProblem]  # called at the problem's initial state and its time
# unknowns below which a dense solver is used: a sparse one pays its calls with the zeros it skips. Twice has Bennett's
# linkage solved so, whose evaluations are 13 % more through roundings; half changes none of four runs.
DENSE_BELOW = 40
# steps between two checks of the rows in use: fewer pay more rank searches, more may pass dependent rows. On two of
# Bennett's linkages half changes the evaluations by -5 and 10 %, twice by 9 and 10 %; three mechanisms keep their bits.
ROWS_EVERY = 40
WORN_OUT = (Status.STEP_UNDERFLOW, Status.DIVERGED, Status.SINGULAR)  # failures that rows near dependence cause
FAILURES = {
    -2: (Status.STEP_UNDERFLOW, "the demanded accuracy is below rounding"),
    -3: (Status.STEP_UNDERFLOW, "the error test failed repeatedly or at the smallest step"),
    -4: (Status.DIVERGED, "Newton's iteration failed repeatedly or at the smallest step"),
    -5: (Status.CRASHED, "the linear solver could not start"),
    -6: (Status.SINGULAR, "the Jacobian could not be factorised"),
    -7: (Status.SINGULAR, "the linear system could not be solved"),
}


def integrate(
    problem: Problem,
    control: StepControl,
    layout: Layout,
    begin: Begin,
    notes: tuple[str, ...],
    clock: Clock,
    *,
    first_step: float = 0.0,
) -> Trajectory:
    """Integrate by IDA, restarting it on other constraint rows when those in use become dependent.

    ``begin`` returns the equations and initial values, at the problem's start and at each later state where the rows
    change. ``clock`` has run since the set-up began; ``first_step`` is in s, and 0 leaves it to IDA. ``notes`` are
    those of the trajectory, to which changes of rows are added. Raises ``StepFailure`` if no first step is possible.
    """
    assert control.rtol is not None  # the catalogue requires it
    pieces, latest = list[_IdaSegment](), np.zeros(0)

    def restart(layout: Layout, problem: Problem) -> None:
        """Begin a new integration at the initial state of ``problem``, on the rows of ``layout``."""
        nonlocal latest
        start = begin(layout, problem)
        pieces.append(_IdaSegment(start, problem, control, layout, first_step, clock, stack))
        latest = start.y

    with ExitStack() as stack:
        rows = RowsInUse(layout, restart, problem, every=ROWS_EVERY)
        y = latest
        last = problem.initial.t, y

        def advance() -> tuple[float, np.ndarray, np.ndarray]:
            """Take a step, and repeat it on other rows if it fails; return time [s], unknowns and all reactions."""
            nonlocal last
            try:
                t, y = pieces[-1].step(problem.t_end)
            except StepFailure as failure:
                if failure.status not in WORN_OUT or not rows.restart_after_failure(*last):
                    raise
                t, y = pieces[-1].step(problem.t_end)
            at = rows.layout
            reaction = at.all_rows(y[at.lam])
            last = t, y
            rows.update_rows(t, y)
            return t, y, reaction

        def count(steps: int) -> dict[str, int]:
            """Return the counters, summed over all integrations; the number of ``steps`` is not needed."""
            jacobians, spent = sum(p.jacobians for p in pieces), sum(p.difference_evaluations for p in pieces)
            counted = {"jacobians": jacobians, "factorisations": jacobians, "difference_evaluations": spent}
            return {"evaluations": sum(piece.evaluations for piece in pieces) + spent, **counted}

        in_use = lambda: (rows.layout, rows.notes)  # noqa: E731  read anew at each call
        reaction = layout.all_rows(y[layout.lam])
        return march(problem, control, layout, clock, advance, y, reaction, count, notes, in_use)


class _IdaSegment:
    """An integration by IDA on one choice of constraint rows."""

    def __init__(
        self,
        start: InitialValueProblem,
        problem: Problem,
        control: StepControl,
        layout: Layout,
        first_step: float,
        clock: Clock,
        stack: ExitStack,
    ) -> None:
        """Set up IDA at ``start``, the initial state of ``problem``, in the order of unknowns that suits its solver.

        ``first_step`` [s] is limited by the control's largest step; ``stack`` closes IDA in the end.
        """
        assert control.rtol is not None
        self._form, self._clock = start.form, clock
        order, self._place, linear_solver = _choose_order(start.form)
        equations = _permute_equations(start.form, order, self._place)
        equations.y[:], equations.y_dot[:] = start.y[order], start.y_dot[order]
        interface: Any = Ida if is_known("scikit-sundae") else PublicIda
        self._ida: Ida | PublicIda = stack.enter_context(
            interface(
                equations,
                linear_solver,
                rtol=control.rtol,
                start=problem.initial.t,
                atol=tolerances(control.rtol, layout.n, start.out_of_test)[order],
                first_step=min(first_step, control.max_step or np.inf),
                max_step=control.max_step or 0.0,
                seconds=clock.cpu_left(),
            )
        )
        self._ida.stop_at(problem.t_end)

    @property
    def evaluations(self) -> int:
        """Number of residuals that IDA itself asked for, without those for Jacobians by differences."""
        return self._ida.evaluations

    @property
    def jacobians(self) -> int:
        """Number of Jacobians that IDA evaluated; each is factorised once."""
        return self._ida.jacobians

    @property
    def difference_evaluations(self) -> int:
        """Number of residuals evaluated for Jacobians by differences."""
        return self._form.difference_evaluations

    def step(self, t_end: float) -> tuple[float, np.ndarray]:
        """Take one step of IDA towards ``t_end`` [s]; return its time and y in the layout's order.

        Raises ``StepFailure`` where IDA fails or the CPU limit is reached.
        """
        flag, t, y = self._ida.step(t_end)
        if flag in OUT_OF_TIME:
            raise self._clock.failure()
        if flag < 0:
            status, words = FAILURES.get(flag, (Status.CRASHED, f"flag {flag}"))
            said = self._ida.messages
            raise StepFailure(status, f"IDA: {words}" + (f" ({said})" if said else ""))
        return t, y.take(self._place)


def _choose_order(form: ImplicitForm) -> tuple[np.ndarray, np.ndarray, str]:
    """Return the order of unknowns for IDA, its inverse, and the linear solver's name.

    The first array has the layout's index of each of IDA's unknowns, the second IDA's index of each of the layout's.
    The solver is "dense" below ``DENSE_BELOW`` unknowns and "sparse" where the band is too wide, both without
    reordering; else it is "band", in the order of the narrowest band found.
    """
    pattern, own = form.pattern, np.arange(len(form.y))
    if len(own) < DENSE_BELOW:
        return own, own, "dense"
    band = find_band(pattern)
    return (own, own, "sparse") if band.work > BAND_WORK else (band.order, band.place, "band")


def _permute_equations(form: ImplicitForm, order: np.ndarray, place: np.ndarray) -> IdaEquations:
    """Return ``form`` as IDA's equations, with unknowns and residuals permuted.

    ``order`` is the layout's index of each of IDA's unknowns, ``place`` its inverse.
    """
    y, y_dot, F = (np.zeros(len(order)) for _ in range(3))
    steps = [take(y, place, form.y), take(y_dot, place, form.y_dot), form.evaluate.step, take(form.F, order, F)]

    def jacobian(cj: float) -> np.ndarray:
        """Return the nonzeros of dF/dy + ``cj`` dF/dy' at the present time, y and y'."""
        of_y, of_y_dot = form.jacobian(y.take(place), y_dot.take(place), float(form.t[0]))
        return of_y + cj * of_y_dot

    rows, columns = place[form.pattern.rows], place[form.pattern.columns]
    return IdaEquations(Program(steps, form), form.t, y, y_dot, F, jacobian, rows, columns)
