"""From a problem to a trajectory: arrays and analysis, the compiled march in stretches, and what is handed back."""

from dataclasses import dataclass, field

import numpy as np

from ....harness.clock import cpu_seconds
from ....harness.types import Problem, State, States, Status, StepControl, Trajectory
from . import compiled_once
from . import march as marching
from .arrays import Motion, Step, empty_step, model_of
from .choices import Settings
from .newton import COUNTERS, History, Run, Work
from .pattern import analyse
from .residual import complete
from .simplified.state import applies
from .simplified.stretches import Simplified
from .step import start_mu

STRETCH_BYTES = 8e6  # of recorded steps between two looks at the clock


@dataclass
class Log:
    """What the march has recorded so far."""

    stretches: list[marching.Record] = field(default_factory=list)

    def joined(self, name: str) -> np.ndarray:
        """One series over all stretches."""
        return np.concatenate([getattr(r, name) for r in self.stretches]) if self.stretches else np.zeros(0)


def prepare(problem: Problem, settings: Settings, mu0: str = "zero") -> tuple[Run, Step]:
    """Arrays, symbolic analysis and the complete start."""
    model = model_of(problem.system)
    saddle, lu = analyse(model, bool(settings.couple))
    nb, nrows = problem.system.nb, problem.system.nrows
    step = empty_step(model)
    load(step.start, problem.initial)
    with compiled_once(complete):
        complete(model, step.start, settings)
    if mu0 == "velocity":
        start_mu(model, step.start, step.rows, settings.direction)
    history = History(v=np.zeros((nb, 6)), nu=np.zeros(nrows), increment=np.zeros(nrows), dt=np.zeros(1))
    work = Work(
        R_v=np.zeros((nb, 6)), R_mu=np.zeros(nrows), x=np.zeros(int(lu.start[-1])), xi=np.full(1, settings.penalty.xi),
        nested=np.zeros(1, dtype=np.int64), nu_kept=np.zeros(nrows), y=np.zeros(int(lu.start[-1])),
        left=np.zeros(nrows), counts=np.zeros(len(COUNTERS), dtype=np.int64),
        max_turn=np.full(1, np.inf), factored_dt=np.zeros(1), norm=np.zeros(2), log_det=np.array([0.0, 0.0, -np.inf]),
    )  # fmt: skip
    return Run(model, settings, history, saddle, lu, work), step


def load(motion: Motion, state: State) -> None:
    """Poses and velocities of ``state`` into ``motion``."""
    motion.r[:], motion.R[:] = state.r, state.R
    motion.v[:, :3], motion.v[:, 3:], motion.t[0] = state.v, state.Omega, state.t


def advance(run: Run, step: Step, clock: marching.Clock, room: int) -> tuple[Step, int, marching.Record]:
    """March until ``room`` steps are recorded or it ends: where the run then stands, the outcome, the steps."""
    record = marching.empty_record(room, len(run.model.mass), int(run.model.row[-1]))
    outcome, done = marching.march(run, step, clock, record)
    if done % 2:
        step = step._replace(start=step.end, end=step.start)
    return step, outcome, marching.Record(*(a[:done] for a in record))


def integrate(
    problem: Problem, control: StepControl, run: Run, step: Step, max_cuts: int, max_turn: float
) -> Trajectory:
    """March to the end or to the failure."""
    began = cpu = cpu_seconds()
    assert control.dt is not None  # refuses() has seen to it
    room = int(max(16, min(5000, STRETCH_BYTES / (8 * (1 + 18 * problem.system.nb + problem.system.nrows)))))
    clock = marching.Clock(np.zeros(3, dtype=np.int64), control.dt, problem.t_end, max_cuts)
    run.work.max_turn[0] = max_turn or np.inf
    with compiled_once(marching.march):
        advance(run, step, clock._replace(t_end=0.0), 1)  # compiles the march, or loads it, and takes no step
        march = (
            Simplified(run, step, clock, advance).advance
            if not max_turn and applies(run.settings, run.model)
            else (lambda step, room: advance(run, step, clock, room))
        )
    set_up = cpu_seconds() - cpu
    log, steps, cpu = Log(), 0, cpu_seconds()
    status, message = Status.SUCCESS, ""
    while True:
        step, outcome, stretch = march(step, min(room, control.max_steps - steps))
        log.stretches.append(stretch)
        steps += len(stretch.t)
        if control.spool is not None and len(stretch.t):
            control.spool.take(stretch.t, States(stretch.r, stretch.R, stretch.v[:, :, :3], stretch.v[:, :, 3:]))
        if outcome == marching.FINISHED:
            break
        if outcome == marching.UNDERFLOW:
            status, message = _underflow(run, clock)
            break
        limit = None
        if steps >= control.max_steps:
            limit = f"max_steps = {control.max_steps}"
        elif control.cpu_limit is not None and cpu_seconds() - began > control.cpu_limit:
            limit = f"CPU limit of {control.cpu_limit:g} s"
        if limit:
            status, message = Status.STALLED, f"{limit} reached at t = {marching.time_of(clock):g} s"
            break
    return hand_back(problem, run, log, status, message, cpu_seconds() - cpu, set_up)


def hand_back(
    problem: Problem, run: Run, log: Log, status: Status, message: str, cpu: float, set_up: float
) -> Trajectory:
    """The steps with the start before them. Reactions are step means; at a time between two steps their mean."""
    first = problem.initial
    v = log.joined("v").reshape(-1, problem.system.nb, 6)
    t = np.concatenate(([0.0], log.joined("t")))
    reaction = log.joined("reaction").reshape(len(t) - 1, problem.system.nrows)
    states = States(
        np.concatenate((first.r[None], log.joined("r").reshape(-1, problem.system.nb, 3))),
        np.concatenate((first.R[None], log.joined("R").reshape(-1, problem.system.nb, 3, 3))),
        np.concatenate((first.v[None], v[:, :, :3])),
        np.concatenate((first.Omega[None], v[:, :, 3:])),
    )
    counters = {"steps": len(t) - 1, **{name: int(n) for name, n in zip(COUNTERS, run.work.counts, strict=True)}}
    norm = log.joined("norm").reshape(-1, 2)
    per_step = {
        "newton_iterations": log.joined("newton"), "cut_level": log.joined("level"),
        "residual_norm": norm[:, 0], "constraint_norm": norm[:, 1],
    }  # fmt: skip
    if run.settings.penalty.active:
        per_step |= {"penalty": log.joined("xi"), "log_determinant": log.joined("log_det")}
    return Trajectory(
        t=t, states=states, status=status, message=message, counters=counters,
        reaction=at_nodes(np.diff(t), reaction),
        diagnostics={name: np.concatenate(([np.nan], series)) for name, series in per_step.items()},
        cpu_time=cpu, setup_time=set_up,
    )  # fmt: skip


def at_nodes(dt: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Values at the nodes from means over the steps between (second order), linear at the ends."""
    n = len(dt)
    if n == 0:
        return np.full((1, mean.shape[1]), np.nan)
    if n == 1:
        return np.repeat(mean, 2, axis=0)
    w = (dt[1:] / (dt[:-1] + dt[1:]))[:, None]
    inner = w * mean[:-1] + (1.0 - w) * mean[1:]
    slope_first = (mean[1] - mean[0]) / (dt[0] + dt[1])
    slope_last = (mean[-1] - mean[-2]) / (dt[-1] + dt[-2])
    return np.concatenate(((mean[0] - dt[0] * slope_first)[None], inner, (mean[-1] + dt[-1] * slope_last)[None]))


def _underflow(run: Run, clock: marching.Clock) -> tuple[Status, str]:
    t = marching.time_of(clock)
    residual, phi_dot = run.work.norm
    if not np.isfinite(residual):
        return Status.DIVERGED, f"not a finite number at t = {t:g} s, with the step cut {clock.max_level} times"
    return Status.STEP_UNDERFLOW, (
        f"Newton's method does not reach {run.settings.tolerance:g} sqrt(J) at t = {t:g} s with the step cut "
        f"{clock.max_level} times (residual {residual:.3g}, constraint norm {phi_dot:.3g})"
    )
