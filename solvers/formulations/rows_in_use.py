"""The rows that an implicit integrator keeps: where they wear out, it starts again on others."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...harness.mechanics.consistency import InconsistentStart, project
from ...harness.types import Problem, Status
from .layout import Layout
from .recording import StepFailure
from .wear import Wear


class RowsInUse:
    """The layout of now, and ``begin(layout, problem)``, which starts an integrator at the problem's initial state.

    ``every``: steps between two looks; those of a small mechanism cost 2 to 4 % of a run.
    """

    def __init__(
        self, layout: Layout, begin: Callable[[Layout, Problem], None], problem: Problem, *, every: int
    ) -> None:
        self.layout, self._wear, self.changes = layout, Wear(layout), list[float]()
        self._begin, self._problem, self._every = begin, problem, every
        begin(layout, problem)

    def look(self, t: float, y: np.ndarray) -> None:
        """Begin on better rows from an accepted step if those in use are worn, at one step of ``every``."""
        self._renew(t, y, self._every)

    def can_rescue(self, t: float, y: np.ndarray) -> bool:
        """Begin on better rows from the last accepted step, behind which a step has failed; return whether any are."""
        return self._renew(t, y, 1)

    def _renew(self, t: float, y: np.ndarray, every: int) -> bool:
        kept = self._wear.better_rows(y, t, every)
        if kept is None:
            return False
        at = self.layout
        p, u = y[at.p].reshape(1, at.system.nb, -1), y[at.u].reshape(1, at.system.nb, 6)
        try:
            start = project(at.system, replace(at.chart.states(p, u)[0], t=t))
        except InconsistentStart as error:
            if every == 1:
                return False  # the step that failed says why
            raise StepFailure(Status.DIVERGED, f"rows could not be chosen anew: {error}") from None
        self.layout = replace(at, kept=kept)
        self._wear = Wear(self.layout)
        self.changes.append(t)
        self._begin(self.layout, replace(self._problem, initial=start))
        return True

    @property
    def notes(self) -> tuple[str, ...]:
        """When rows were chosen anew."""
        times = ", ".join(f"{t:.4g}" for t in self.changes)
        return (f"rows chosen anew at t = {times} s",) if times else ()
