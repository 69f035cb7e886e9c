"""The loop around an error-controlled integrator: it stores accepted steps and turns failures into a status."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from ...harness.base.code_meter import Stopwatch, collect_garbage
from ...harness.mechanics import marching
from ...harness.mechanics.jacobian import constraint_jacobian
from ...harness.mechanics.marching import StepFailure
from ...harness.mechanics.motion import constraint
from ...harness.mechanics.state import States
from ...harness.mechanics.types import Problem, Status, StepControl, Trajectory
from .layout import Layout

# steps between two checks of phi; a check costs about ten steps of one body. Half and twice end none of ten runs with
# redundant rows at another step, nor does half of the next one.
LOOK_EVERY = 100
LOST_AXIS = 0.5  # axis rows are cosines: 30 degrees out
NEAR_CHART_SINGULARITY = 0.05  # |sin(theta)| below which a failure mentions the chart's singularity
DEPENDENT_ROWS = 1e-4  # smallest to largest singular value of A below which a failure is called singular
LARGEST_SVD = 1000  # rows, 0.3 s; 2000 take 2 s, which a run at its limit does not have


@dataclass
class Clock:
    """CPU time of a run (``whole``) and of its integration (``part``), without that of making code, and its limit."""

    limit: float | None
    whole: Stopwatch = field(default_factory=Stopwatch)
    part: Stopwatch = field(default_factory=Stopwatch)

    def check(self) -> None:
        """Raise ``StepFailure`` if the CPU time of the run, without that of making code, exceeds the limit."""
        if self.limit is not None and self.whole.solver > self.limit:
            raise self.failure()

    def failure(self) -> StepFailure:
        """Return, without raising it, the ``StepFailure`` of a run at its limit of CPU time."""
        return StepFailure(Status.STALLED, f"the CPU limit of {self.limit:g} s was reached")

    def cpu_left(self) -> float | None:
        """Return the CPU time left until the limit [s], or None if there is no limit."""
        return None if self.limit is None else self.limit - self.whole.solver

    def restart(self) -> float:
        """Start counting the integration; return the CPU time [s] of set-up so far, that of making code included.

        The limit still applies to both together.
        """
        collect_garbage()
        before, self.part = self.part, Stopwatch()
        return before.solver + before.code

    def cpu_time(self) -> float:
        """Return the CPU time [s] since the restart."""
        return self.part.solver

    def code_time(self) -> float:
        """Return the CPU time [s] of making code since the restart, which counts as set-up."""
        return self.part.code


class ClockedSolver(ABC):
    """A solver whose ``solve`` runs under a ``Clock``, and returns the start alone after a refusal or early failure."""

    @abstractmethod
    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why this solver cannot solve the problem, or None."""

    @abstractmethod
    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate from the start to ``t_end``; raise ``StepFailure`` if it fails before the first step."""

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate from the start to ``t_end`` and return the trajectory.

        A refusal, or a failure before the first step, returns the start alone with its status.
        """
        clock, reason = Clock(control.cpu_limit), self.refuses(problem, control)
        if reason is not None:
            return no_trajectory(problem, Status.REFUSED, reason)
        try:
            return self._integrate(problem, control, clock)
        except StepFailure as failure:
            return no_trajectory(problem, failure.status, f"before the first step: {failure.message}")


Advance = Callable[[], tuple[float, Float[np.ndarray, " n"], Float[np.ndarray, " nrows"]]]  # one step: t, y, reaction


def march(
    problem: Problem,
    control: StepControl,
    layout: Layout,
    clock: Clock,
    advance: Advance,
    y: Float[np.ndarray, " n"],
    reaction: Float[np.ndarray, " nrows"],
    counters: Callable[[int], Mapping[str, int]],
    notes: tuple[str, ...],
    in_use: Callable[[], tuple[Layout, tuple[str, ...]]] | None = None,
) -> Trajectory:
    """Integrate by calls of ``advance`` until the end or a failure, and return the trajectory of accepted steps.

    ``y`` (p, u and more) and ``reaction`` are those of the start; the results of ``advance`` are copied. ``counters``
    returns the counts of the run, given the number of steps. A failure near a singularity of the chart or of the
    constraints is reported as such. ``in_use`` returns the layout at the end and notes on its changes, where the layout
    can change. CPU time before this call counts as set-up. New steps go to the control's spool when one is due.
    """
    setup_time, times, ys, reactions = clock.restart(), [0.0], [y.copy()], [reaction.copy()]

    def take_step() -> None:
        """Append the next step to times, ys and reactions; raise ``StepFailure`` where it fails."""
        with np.errstate(all="ignore"):  # an overflow leads to a failure that is reported
            t, y, reaction = advance()
        if not np.isfinite(y).all():
            raise StepFailure(Status.DIVERGED, "the solution is no longer finite")
        if not t > times[-1]:
            raise StepFailure(Status.STEP_UNDERFLOW, "the step fell below the spacing of floating-point times")
        times.append(t)
        ys.append(y.copy())
        reactions.append(reaction.copy())
        if control.spool is not None and control.spool.due():
            new = slice(control.spool.rows, None)
            control.spool.take(times[new], _compute_states(layout, np.array(ys[new])))
        if len(times) % LOOK_EVERY == 0:
            _check_constraints(layout, y)

    try:
        status, message = marching.march(times, problem, control, clock.check, take_step)
    except MemoryError:
        status, message = Status.MEMORY, f"stopped at t = {times[-1]:.6g} s: out of memory"
    cpu_time, t_all, y_all, nt = clock.cpu_time(), np.array(times), np.array(ys), len(times)
    setup_time += clock.code_time()
    states = _compute_states(layout, y_all).with_times(t_all)
    margin = layout.chart.margin(y_all[:, layout.p].reshape(nt, layout.system.nb, layout.chart.size))
    if in_use is not None:
        layout, changes = in_use()
        notes = (*notes, *changes)
    if status is not Status.SUCCESS:
        blamed, reasons = _explain_failure(layout, states, margin, status)
        status = status if status in (Status.STALLED, Status.MEMORY) else blamed
        message += reasons
    return Trajectory(
        t=t_all,
        states=states,
        status=status,
        message=message,
        counters={"steps": nt - 1, **counters(nt - 1)},
        reaction=np.array(reactions),
        diagnostics={"chart_margin": margin},
        notes=notes,
        cpu_time=cpu_time,
        setup_time=setup_time,
    )


def no_trajectory(problem: Problem, status: Status, message: str) -> Trajectory:
    """Return a trajectory of the start alone, for a run that was refused or failed before its first step."""
    start = States.one(problem.initial)
    return Trajectory(np.zeros(1), start, status, message, {"steps": 0}, cpu_time=0.0, setup_time=0.0)


def _check_constraints(layout: Layout, y: np.ndarray) -> None:
    """Raise ``StepFailure`` if the joints have come apart at ``y``, as the run then integrates another mechanism.

    They have if phi of a point or line row exceeds the longest joint arm [m], or phi of an axis row ``LOST_AXIS``.
    """
    s = layout.system
    phi = np.abs(constraint(s, _compute_states(layout, y[None]))[0])
    apart = float(max(np.max(phi[rows], initial=0.0) for rows in (s.point_rows()[1], s.line_rows().row)))
    tilt = float(np.max(phi[s.axis_rows().row], initial=0.0))
    arm = max(float(np.max(np.abs(a), initial=0.0)) for a in (s.joint_s_i, s.joint_s_j))
    if (arm > 0.0 and apart > arm) or tilt > LOST_AXIS:
        raise StepFailure(Status.DIVERGED, f"the joints came apart: {apart:.3g} m, axes by a cosine of {tilt:.3g}")


def _compute_states(layout: Layout, y: Float[np.ndarray, "nt n"]) -> States:
    """Return poses and velocities in space of all bodies for the unknowns ``y``, one row per time."""
    nt, nb = len(y), layout.system.nb
    p = y[:, layout.p].reshape(nt, nb, layout.chart.size)
    return layout.chart.states(p, y[:, layout.u].reshape(nt, nb, 6))


def _explain_failure(layout: Layout, states: States, margin: np.ndarray, status: Status) -> tuple[Status, str]:
    """Return the status of a failed run and text to add to its message, from singularities near its end.

    The status is ``SINGULAR`` near a singularity of the 3-1-3 chart, or where the kept constraint rows are nearly
    dependent; else it is ``status``, and the text is empty. More than ``LARGEST_SVD`` rows are not examined.
    """
    reasons = ""
    if layout.chart.name == "euler313" and margin[-1] < NEAR_CHART_SINGULARITY:
        status, reasons = Status.SINGULAR, f"; the 3-1-3 chart is near its singularity, |sin(theta)| = {margin[-1]:.3g}"
    if 0 < layout.k <= LARGEST_SVD:
        A = constraint_jacobian(layout.system, states[len(states) - 1])[layout.kept]
        size = np.linalg.svd(A.toarray(), compute_uv=False)
        if size[-1] < DEPENDENT_ROWS * size[0]:
            status = Status.SINGULAR
            reasons += f"; the kept rows are nearly dependent, singular values of A {size[-1]:.3g} to {size[0]:.3g}"
    return status, reasons


def move_reactions_to_nodes(out: Trajectory) -> Trajectory:
    """Return a copy of the trajectory with reactions at its times instead of means over the steps that end there.

    They are interpolated linearly between the middles of the steps, and extrapolated to both ends. A single step gives
    its mean at both ends, a start alone one row of NaN. A trajectory without reactions is returned as it is.
    """
    if out.reaction is None:  # the run was refused
        return out
    dt, mean = np.diff(out.t), out.reaction[1:]
    if len(dt) < 2:
        nodes = np.repeat(mean, 2, axis=0) if len(dt) else np.full((1, mean.shape[1]), np.nan)
        return replace(out, reaction=nodes)
    w = (dt[1:] / (dt[:-1] + dt[1:]))[:, None]
    first = mean[0] - dt[0] * ((mean[1] - mean[0]) / (dt[0] + dt[1]))
    last = mean[-1] + dt[-1] * ((mean[-1] - mean[-2]) / (dt[-1] + dt[-2]))
    return replace(out, reaction=np.concatenate((first[None], w * mean[:-1] + (1.0 - w) * mean[1:], last[None])))
