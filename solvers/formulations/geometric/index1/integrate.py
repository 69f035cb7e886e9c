"""From a problem to a trajectory on the index-1 kernel: arrays, a compiled march in stretches, its record."""

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from .....harness.clock import cpu_seconds
from .....harness.types import Problem, States, Status, StepControl, Trajectory
from ...methods.tableaux import Tableau
from ..arrays import Model, model_of
from . import rkmk
from .blocks import Blocks
from .fixed_step import STUCK, TURNED
from .kernel import Kernel, empty_kernel, evaluate

FIRST_STEP = 1e-4  # [s] grown from, five-fold a step at most
ROUNDINGS = 16.0  # of the largest coordinate in a component of phi
STRETCH_BYTES = 8e6  # of recorded steps between two looks at the clock
Stretch = Callable[[rkmk.Record], tuple[int, int]]  # fills a record: outcome, steps done


def start_of(problem: Problem) -> tuple[Model, Blocks, Kernel]:
    """Arrays and analysis, the kernel at the problem's start."""
    model = model_of(problem.system)
    kernel, blocks = empty_kernel(model)
    first = problem.initial
    kernel.r[:], kernel.R[:], kernel.v[:, :3], kernel.v[:, 3:] = first.r, first.R, first.v, first.Omega
    kernel.t[0] = first.t
    return model, blocks, kernel


def above_rounding(tolerance: float, problem: Problem) -> float:
    """``tolerance`` [m] of phi, or the roundings of phi where a system so large or so far away has more."""
    system = problem.system
    largest = max(np.max(np.abs(a), initial=0.0) for a in (problem.initial.r, system.joint_s_i, system.joint_s_j))
    return max(tolerance, ROUNDINGS * float(np.finfo(float).eps) * float(largest))


def error_control(problem: Problem, control: StepControl, order: float) -> rkmk.Control:
    """Clock and counters of steps with error control; ``order`` in h of the error estimate."""
    assert control.rtol is not None  # the catalogue has seen to it
    return rkmk.Control(
        np.array([0.0, min(FIRST_STEP, problem.t_end), 1e-4]), np.zeros(3, dtype=np.int64), control.rtol,
        control.max_step or np.inf, problem.t_end, order,
    )  # fmt: skip


def runge_kutta(problem: Problem, control: StepControl, tableau: Tableau) -> Trajectory:
    """An explicit pair with error control."""
    began = cpu_seconds()
    model, blocks, kernel = start_of(problem)
    stages = rkmk.empty_stages(problem.system.nb, len(tableau.b))
    steps = error_control(problem, control, float(tableau.order))

    def stretch(record: rkmk.Record) -> tuple[int, int]:
        return rkmk.march(model, blocks, kernel, stages, tableau, steps, record)

    def counters() -> dict[str, int]:
        evaluations, rejected = map(int, steps.tally[:2])
        return {"evaluations": evaluations, "rejected": rejected, "factorisations": evaluations}

    stretch(rkmk.empty_record(0, problem.system.nb, problem.system.nrows))  # compiles
    rkmk.start(model, blocks, kernel, stages, steps)
    return _march(problem, control, stretch, kernel.lam.copy(), counters, cpu_seconds() - began)


def extrapolated_steps(
    problem: Problem, control: StepControl, method: ModuleType, scheme: tuple, columns: int
) -> Trajectory:
    """Extrapolation of ``columns`` columns in even powers with error control: ``empty_step``, ``start``, ``march``."""
    began = cpu_seconds()
    model, blocks, kernel = start_of(problem)
    step, steps = method.empty_step(model, columns), error_control(problem, control, 2.0 * columns - 1.0)

    def stretch(record: rkmk.Record) -> tuple[int, int]:
        return method.march(model, blocks, kernel, step, scheme, steps, record)

    def counters() -> dict[str, int]:
        return {"rejected": int(steps.tally[1]), "newton_iterations": int(steps.tally[0])}

    stretch(rkmk.empty_record(0, problem.system.nb, problem.system.nrows))  # compiles
    evaluate(model, blocks, kernel)
    method.start(kernel, step)
    return _march(problem, control, stretch, kernel.lam.copy(), counters, cpu_seconds() - began)


def fixed_steps(
    problem: Problem, control: StepControl, method: ModuleType, scheme: Any, asked: float | None = None
) -> Trajectory:
    """Steps of ``control.dt`` by a module of this folder: ``empty_step``, ``start`` (from index 1) and ``march``.

    A tolerance above the one ``asked`` for is noted.
    """
    began = cpu_seconds()
    model, blocks, kernel = start_of(problem)
    step = method.empty_step(model)

    def stretch(record: rkmk.Record) -> tuple[int, int]:
        return method.march(model, blocks, kernel, step, scheme, control.dt, problem.t_end, record)

    def counters() -> dict[str, int]:
        return {"newton_iterations": int(step.clock[1]), "factorisations": 1 + int(step.clock[2])}

    stretch(rkmk.empty_record(0, problem.system.nb, problem.system.nrows))  # compiles
    evaluate(model, blocks, kernel)
    method.start(kernel, step)
    out = _march(problem, control, stretch, kernel.lam.copy(), counters, cpu_seconds() - began)
    if asked is None or scheme.tolerance <= asked:
        return out
    words = f"tolerance {scheme.tolerance:.2g} instead of {asked:g}: {ROUNDINGS:g} roundings of the largest coordinate"
    return replace(out, notes=(*out.notes, words))


def _march(
    problem: Problem,
    control: StepControl,
    stretch: Stretch,
    reaction: np.ndarray,
    counters: Callable[[], dict[str, int]],
    set_up: float,
) -> Trajectory:
    system, first = problem.system, problem.initial
    room = int(max(16, min(5000, STRETCH_BYTES / (8 * (1 + 18 * system.nb + system.nrows)))))
    cpu = cpu_seconds()
    done: list[rkmk.Record] = []
    taken, t, status, message = 0, 0.0, Status.SUCCESS, ""
    while True:
        record = rkmk.empty_record(min(room, control.max_steps - taken), system.nb, system.nrows)
        outcome, n = stretch(record)
        done.append(rkmk.Record(*(a[:n] for a in record)))
        taken += n
        t = float(done[-1].t[-1]) if n else t
        if control.spool is not None and n:
            control.spool.take(done[-1].t, _states(done[-1]))
        if outcome == rkmk.FINISHED:
            break
        if outcome != rkmk.FULL:
            status, words = ENDS[outcome]
            message = f"{words} at t = {t:g} s"
            break
        if taken >= control.max_steps:
            status, message = Status.STALLED, f"max_steps = {control.max_steps} reached at t = {t:g} s"
            break
        if control.cpu_limit is not None and set_up + cpu_seconds() - cpu > control.cpu_limit:
            status, message = Status.STALLED, f"CPU limit of {control.cpu_limit:g} s reached at t = {t:g} s"
            break
    cpu = cpu_seconds() - cpu
    whole = rkmk.Record(*(np.concatenate(a) for a in zip(*done, strict=True)))
    moved = _states(whole)
    return Trajectory(
        t=np.concatenate(([0.0], whole.t)),
        states=States(*(np.concatenate((getattr(first, n)[None], getattr(moved, n))) for n in NAMES)),
        status=status, message=message, counters={"steps": taken, **counters()},
        reaction=np.concatenate((reaction[None], whole.lam)), cpu_time=cpu, setup_time=set_up,
    )  # fmt: skip


NAMES = ("r", "R", "v", "Omega")
ENDS = {
    rkmk.UNDERFLOW: (Status.STEP_UNDERFLOW, "the error test asks for a step below the spacing of times"),
    rkmk.NOT_FINITE: (Status.DIVERGED, "the motion is no longer finite"),
    STUCK: (Status.STEP_UNDERFLOW, "the iteration of a step does not converge with this step"),
    TURNED: (Status.STEP_UNDERFLOW, "a body turns by more than half a turn in this step, or would: take a shorter one"),
}


def _states(record: rkmk.Record) -> States:
    return States(record.r, record.R, record.v[:, :, :3], record.v[:, :, 3:])
