"""The loop over steps from the start to the end of a problem, and the control of fixed steps."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...harness.base.code_meter import Stopwatch
from ...harness.mechanics.state import States
from ...harness.mechanics.types import Problem, Status, StepControl, Trajectory

ROUNDED = 1e-9  # share of a step: a shorter remainder of the time is rounding


class Node(NamedTuple):
    """The state at an end of a step: time [s], poses in space, and v = (r_dot [space], Omega [body]) of each body."""

    t: float
    r: Float[np.ndarray, "nb 3"]
    R: Float[np.ndarray, "nb 3 3"]
    v: Float[np.ndarray, "nb 6"]


def begin(problem: Problem) -> Node:
    """Return the start of a problem as a node."""
    s = problem.initial
    return Node(s.t, s.r, s.R, np.hstack((s.v, s.Omega)))


class Grid:
    """Fixed steps of ``dt`` [s] up to ``t_end``; one that fails is halved, at most ``most_cuts`` times."""

    def __init__(self, t_end: float, dt: float, most_cuts: int = 0) -> None:
        """List the steps, last one first; a remainder of ``t_end`` is a shorter last step."""
        whole = int(t_end / dt + ROUNDED)
        self.steps_left, self.most_cuts = [(dt, 0)] * whole, most_cuts
        if t_end - whole * dt > ROUNDED * dt:
            self.steps_left = [(t_end - whole * dt, 0), *self.steps_left]
        self.counters, self.ended = {"step_cuts": 0}, (Status.SUCCESS, "")

    def choose_step(self, t: float) -> float | None:
        """Return the step [s] to try at ``t``; None at the end, or after a step that failed at the last halving."""
        return self.steps_left[-1][0] if self.steps_left and not self.ended[1] else None

    def accept(self, h: float, result: Any) -> bool:
        """Remove the present step of ``h`` [s] from the list, and return whether it succeeded: ``result`` is not None.

        A step that failed is replaced by two of half the size; after ``most_cuts`` halvings ``ended`` is set instead.
        """
        _, level = self.steps_left.pop()
        if result is not None:
            return True
        if level == self.most_cuts:
            cut = f", cut {self.most_cuts} times," if self.most_cuts else ""
            self.ended = Status.STEP_UNDERFLOW, f"a step of this size{cut} does not come to an end"
        else:
            self.counters["step_cuts"] += 1
            self.steps_left += [(0.5 * h, level + 1)] * 2
        return False


def march(problem: Problem, control: StepControl, step: Any, pace: Any = None) -> Trajectory:
    """Integrate by calls of ``step(h, node, carried)`` to the end, a limit or a failure, and return the trajectory.

    A step returns a node with ``t``, ``r``, ``R`` and ``v``, the state to carry on, a reaction and, under error
    control, its error; or None where it fails. ``pace`` chooses and accepts the steps ``h`` [s]; without it they are a
    grid of ``control.dt``.
    """
    watch, pace = Stopwatch(), pace or Grid(problem.t_end, float(control.dt or 0.0))
    node, carried, reaction = step.start(problem)
    nodes, reactions, limit = [node], [reaction], ""
    while not limit and (h := pace.choose_step(node.t)) is not None:
        try:
            with np.errstate(all="ignore"):  # a step that overflows is cut
                made = step(h, node, carried)
        except np.linalg.LinAlgError:  # raised for numbers that are not finite
            made = None
        if made is not None and not np.all(np.isfinite(made[0].v)):
            made = None
        if pace.accept(h, made):
            node, carried, reaction = made[:3]
            nodes.append(node)
            reactions.append(reaction)
            if control.spool is not None and control.spool.due():
                new = nodes[control.spool.rows :]
                control.spool.take([x.t for x in new], _join_nodes(new))
        if pace.choose_step(node.t) is not None:
            if len(nodes) > control.max_steps:
                limit = f"max_steps = {control.max_steps} reached"
            elif control.cpu_limit is not None and watch.solver > control.cpu_limit:
                limit = f"CPU limit of {control.cpu_limit:g} s reached"
    status, words = (Status.STALLED, limit) if limit else pace.ended
    message = f"{words} at t = {node.t:g} s" if words else ""
    counters = {"steps": len(nodes) - 1, **pace.counters, **step.counters}
    return Trajectory(
        np.array([x.t for x in nodes]),
        _join_nodes(nodes),
        status,
        message,
        counters,
        reaction=np.stack(reactions),
        cpu_time=watch.solver,
        setup_time=watch.code,
        notes=("plain NumPy, as its source prints it",),
    )


def _join_nodes(nodes: list[Any]) -> States:
    """Return the poses and velocities of ``nodes`` as ``States``, with time along the first axis."""
    v = np.stack([x.v for x in nodes])
    return States(np.stack([x.r for x in nodes]), np.stack([x.R for x in nodes]), v[:, :, :3], v[:, :, 3:])
