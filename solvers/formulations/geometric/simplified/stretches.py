"""Stretches of the simplified method, and of the full one where it does not converge."""

from collections.abc import Callable

import numpy as np

from ..arrays import Step
from ..index1.kernel import evaluate
from ..march import Clock, Record, empty_record
from ..newton import Run
from ..residual import complete
from .march import BUFFER_FULL, HARD, march, start
from .state import DEPTH, empty_lean
from .step import log_determinant

PATIENCE, MOST_PATIENCE = 8, 1024  # steps of the full method after one that the simplified method does not solve
Full = Callable[[Run, Step, Clock, int], tuple[Step, int, Record]]


class Simplified:
    """The simplified method's march, with the full one for stretches in which it does not converge."""

    def __init__(self, run: Run, step: Step, clock: Clock, full: Full) -> None:
        self._full = full
        self._run, self._clock, self._patience, self._hard = run, clock, PATIENCE, False
        self._lean = empty_lean(run.model)
        self._take(step)
        start(self._lean)
        # Dropped pivots are the proximal saddle's motion; the plain weak form has none to offer. Where nothing
        # accelerates and no row bears a load (a body in uniform rotation), the full method takes no correction and adds
        # no rounding.
        dropped = not run.settings.penalty.active and self._lean.rank[0] < int(run.model.row[-1])
        self._never = dropped or not (np.any(self._lean.k.lam) or np.any(self._lean.k.v_dot))
        self._offset, self._unlevelled = 0.0, list[np.ndarray]()
        evaluate(self._lean.model, self._lean.blocks, self._lean.k)  # compiled here, as the march, not within the run
        log_determinant(self._lean)
        self._march(empty_record(0, len(run.model.mass), int(run.model.row[-1])))  # compiles

    def advance(self, step: Step, room: int) -> tuple[Step, int, Record]:
        """Up to ``room`` steps; stretches of the full method begin and end anywhere, those of this one on the grid."""
        run, lean, grid = self._run, self._lean, self._clock.grid
        if self._never or self._hard or grid[1] or grid[2] or np.isfinite(run.work.max_turn[0]):
            room = room if self._never else min(room, self._patience)
            step, outcome, record = self._full(run, step, self._clock, room)
            self._patience = min(2 * self._patience, MOST_PATIENCE)
            self._hard = False
            self._take(step)
            if run.settings.penalty.active and self._offset == 0.0:
                self._level()
            return step, outcome, record
        record = empty_record(room, len(run.model.mass), int(run.model.row[-1]))
        outcome, done = self._march(record)
        record.log_det[:done] += self._offset
        if self._offset == 0.0:
            self._unlevelled.append(record.log_det[:done])
        if outcome == HARD:
            self._hard, outcome = True, BUFFER_FULL
            step.start.r[:], step.start.R[:], step.start.v[:] = lean.k.r, lean.k.R, lean.k.v
            step.rows.nu_start[:] = lean.nu_start
            complete(run.model, step.start, run.settings)
            self._give()
            run.work.factored_dt[0] = 0.0
        if done > PATIENCE:
            self._patience = PATIENCE
        return step, outcome, Record(*(a[:done] for a in record))

    def _level(self) -> None:
        """Bring both methods' determinants to one constant, that of the full method, at the pose where it stands."""
        lean, full = self._lean, self._run.work.log_det[0]
        if evaluate(lean.model, lean.blocks, lean.k) == lean.rank[0]:
            self._offset = full - log_determinant(lean)
            for series in self._unlevelled:
                series += self._offset
            self._unlevelled.clear()

    def _march(self, record: Record) -> tuple[int, int]:
        clock, run = self._clock, self._run
        return march(self._lean, run.settings, clock.grid, clock.dt, clock.t_end, run.work.counts, record)

    def _take(self, step: Step) -> None:
        """Where the full method stands, and its last step as the past."""
        lean, history, gauge = self._lean, self._run.history, self._run.settings.gauge
        lean.k.r[:], lean.k.R[:], lean.k.v[:] = step.start.r, step.start.R, step.start.v
        lean.nu_start[:] = step.rows.nu_start
        lean.past[:] = 1, 0
        if (h := history.dt[0]) > 0.0:
            lean.acceleration[0] = (step.start.v - history.v) / h
            step_of_grid, pos, level = self._clock.grid
            lean.middle[0] = (step_of_grid + pos / 2.0**level) * self._clock.dt - 0.5 * h
            lean.impulse[0] = history.increment / h if self._run.settings.keep_nu else (1.0 - gauge) * history.nu / h

    def _give(self) -> None:
        """The last step here as the full method's past: what ``_take`` does, the other way."""
        lean, history, h = self._lean, self._run.history, self._clock.dt
        history.dt[0] = h
        last, before = (lean.past[0] - 1) % DEPTH, (lean.past[0] - 2) % DEPTH
        history.v[:] = lean.k.v - h * lean.acceleration[last]
        if self._run.settings.keep_nu:
            history.increment[:] = h * lean.impulse[last]
            return
        scale = h / (1.0 - self._run.settings.gauge)
        history.nu[:] = scale * lean.impulse[last]
        history.increment[:] = history.nu - scale * lean.impulse[before] if lean.past[0] > 1 else 0.0
