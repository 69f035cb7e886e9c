"""The rows that an implicit integrator keeps, looked at as it goes: where they wear out, it starts again on others.

Rows kept once may become dependent where all rows together do not; the constraints then seem to lose rank, and a code
that passes the place integrates with a joint open. Few rows alone are watched, as in ``strong_form``.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...harness.mechanics.consistency import InconsistentStart, project
from ...harness.types import Problem, Status
from .layout import Layout
from .rank import better_rows, least_singular_value
from .recording import StepFailure
from .strong_form import LARGEST, WORN

EVERY = 5  # steps between two looks; a look costs as much as some ten of them


class RowsInUse:
    """The layout of now, and ``begin(layout, problem)``, which starts an integrator at the problem's initial state."""

    def __init__(self, layout: Layout, begin: Callable[[Layout, Problem], None], problem: Problem) -> None:
        self.layout, self.changes = layout, list[float]()
        self._begin, self._problem, self._steps = begin, problem, 0
        self._watched = 0 < layout.k < layout.system.nrows <= LARGEST
        self._limit = WORN * least_singular_value(layout.system, problem.initial, layout.kept) if self._watched else 0.0
        begin(layout, problem)

    def look(self, t: float, y: np.ndarray) -> None:
        """Begin on better rows from an accepted step if those in use have come near to dependence since the choice."""
        self._steps += 1
        if not self._watched or self._steps % EVERY:
            return
        at, system = self.layout, self.layout.system
        p, u = y[at.p].reshape(1, system.nb, -1), y[at.u].reshape(1, system.nb, 6)
        state = replace(at.chart.states(p, u)[0], t=t)
        least = least_singular_value(system, state, at.kept)
        if least > self._limit:
            self._limit = max(self._limit, WORN * least)  # after a singular passage the rows have recovered
            return
        kept = better_rows(system, state, at.kept)
        self._limit = WORN * least_singular_value(system, state, kept)
        if kept is at.kept:
            return
        try:
            start = project(system, state)
        except InconsistentStart as error:
            raise StepFailure(Status.DIVERGED, f"rows could not be chosen anew: {error}") from None
        self.layout = replace(at, kept=kept)
        self.changes.append(t)
        self._begin(self.layout, replace(self._problem, initial=start))

    @property
    def notes(self) -> tuple[str, ...]:
        """When rows were chosen anew."""
        times = ", ".join(f"{t:.4g}" for t in self.changes)
        return (f"rows chosen anew at t = {times} s",) if times else ()
