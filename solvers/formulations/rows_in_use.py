"""The constraint rows on which an integrator runs: it restarts on others where they become dependent."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...harness.mechanics.consistency import InconsistentStart, project
from ...harness.mechanics.types import Problem, Status
from .layout import Layout
from .recording import StepFailure
from .row_wear import RowWear


class RowsInUse:
    """The present layout of an integration, which is restarted by ``begin(layout, problem)`` on better rows.

    ``begin`` starts an integrator at the problem's initial state. ``every`` is the number of steps between two checks;
    those of a small mechanism cost 2 to 4 % of a run.
    """

    def __init__(
        self, layout: Layout, begin: Callable[[Layout, Problem], None], problem: Problem, *, every: int
    ) -> None:
        """Begin the integration of ``problem`` on the rows of ``layout``."""
        self.layout, self._wear, self.changes = layout, RowWear(layout), list[float]()
        self._begin, self._problem, self._every = begin, problem, every
        begin(layout, problem)

    def update_rows(self, t: float, y: np.ndarray) -> None:
        """Restart the integrator on better rows if those in use are nearly dependent.

        Call it after each accepted step (t [s], y); one of ``every`` calls checks. Raises ``StepFailure`` where the
        state cannot be projected onto the constraints.
        """
        self._restart_on_better_rows(t, y, self._every)

    def restart_after_failure(self, t: float, y: np.ndarray) -> bool:
        """Restart the integrator on better rows after a failed step; return whether there were any.

        ``t`` [s] and ``y`` are those of the last accepted step.
        """
        return self._restart_on_better_rows(t, y, 1)

    def _restart_on_better_rows(self, t: float, y: np.ndarray, every: int) -> bool:
        """Restart the integrator on other rows if those in use are nearly dependent; return whether it did.

        It restarts at the state of ``t`` [s] and ``y``, projected onto the constraints. A state that cannot be
        projected raises ``StepFailure``, but after a failed step, where ``every`` is 1, it returns False.
        """
        kept = self._wear.find_better_rows(y, t, every)
        if kept is None:
            return False
        at = self.layout
        p, u = y[at.p].reshape(1, at.system.nb, -1), y[at.u].reshape(1, at.system.nb, 6)
        try:
            start = project(at.system, replace(at.chart.states(p, u)[0], t=t))
        except InconsistentStart as error:
            if every == 1:
                return False  # the failed step gives the reason
            raise StepFailure(Status.DIVERGED, f"rows could not be chosen anew: {error}") from None
        self.layout = replace(at, kept=kept)
        self._wear = RowWear(self.layout)
        self.changes.append(t)
        self._begin(self.layout, replace(self._problem, initial=start))
        return True

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the times at which rows were chosen anew, at most one."""
        times = ", ".join(f"{t:.4g}" for t in self.changes)
        return (f"rows chosen anew at t = {times} s",) if times else ()
