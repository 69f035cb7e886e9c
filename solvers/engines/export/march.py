"""Integrate by an engine with its own loop: stretches of many steps, with limits checked between them."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from ....harness.base.code_meter import solver_seconds
from ....harness.mechanics import marching
from ....harness.mechanics.types import Problem, States, Status, StepControl, Trajectory
from ...formulations.recording import Clock, StepFailure

STRETCH = 20_000  # steps times bodies between two readings of the clock: 0.1 to 2 s of a compiled engine

Advance = Callable[[int, float], Float[np.ndarray, "k n"]]  # steps, dt [s] -> the engine's state after each


class PartialStretch(StepFailure):
    """Raised where an engine stops inside a stretch; ``rows`` are those before the failure."""

    def __init__(self, status: Status, message: str, rows: Float[np.ndarray, "k n"]) -> None:
        super().__init__(status, message)
        self.rows = rows


def march(
    problem: Problem,
    control: StepControl,
    advance: Advance,
    states: Callable[[np.ndarray], States],
    *,
    clock: Clock,
    notes: tuple[str, ...],
    stretch: int = STRETCH,
    seconds: Callable[[], float] = solver_seconds,
) -> Trajectory:
    """Integrate by calls of ``advance`` until ``t_end``, a limit or a failure, and return the trajectory.

    With ``control.dt`` the last step is shortened to end at ``t_end``; without it the engine chooses its steps, and
    each row begins with its time [s]. ``states`` converts rows, without times, to poses and velocities. A call of
    ``advance`` takes ``stretch`` / (number of bodies) steps; ``seconds`` reads the CPU clock [s] of the process that
    steps. CPU time of the run is that of ``advance`` alone; the time since ``clock`` was made, until the first call, is
    set-up.
    """
    dt, t_end = control.dt, problem.t_end
    full, last = (int(t_end / dt + 1e-9), int(np.ceil(t_end / dt - 1e-9))) if dt else (0, 0)
    most = max(1, stretch // problem.system.nb)
    parts, t, cpu = [States.one(problem.initial)], [0.0], 0.0
    setup, spool = clock.restart(), control.spool

    def take_stretch() -> None:
        """Take the next stretch of steps, and append those before a failure; raise ``StepFailure`` if there is one."""
        nonlocal cpu
        n = len(t) - 1
        k, h = min(most, control.max_steps - n), 0.0
        if dt:
            k, h = (min(k, full - n), dt) if n < full else (1, t_end - n * dt)
        before, stopped = seconds(), None
        try:
            rows = advance(k, h)
        except PartialStretch as failure:
            rows, stopped = failure.rows, failure
        cpu += seconds() - before
        finite = np.isfinite(rows).all(axis=1)
        sound = len(rows) if finite.all() else int(np.argmin(finite))
        if sound:
            steps = np.arange(n + 1, n + sound + 1)
            t.extend((np.where(steps < last, dt * steps, t_end) if dt else rows[:sound, 0]).tolist())
            parts.append(states(rows[:sound] if dt else rows[:sound, 1:]))
        if sound < len(rows):
            raise StepFailure(Status.DIVERGED, "the solution is no longer finite")
        if stopped is not None:
            raise stopped
        if spool is not None and spool.due():
            parts[:] = [_join_states(parts)]
            spool.take(t[spool.rows :], parts[0].at(slice(spool.rows, n + sound + 1)))

    status, message = marching.march(t, problem, control, clock.check, take_stretch)
    counters, setup = {"steps": len(t) - 1}, setup + clock.code_time()
    return Trajectory(
        np.array(t), _join_states(parts), status, message, counters, notes=notes, cpu_time=cpu, setup_time=setup
    )


def _join_states(parts: list[States]) -> States:
    """Return the states of all ``parts``, concatenated along time."""
    return States(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("r", "R", "v", "Omega")))
