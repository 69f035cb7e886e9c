"""Fixed steps from the start to the end of a problem: a step that fails is done in two halves."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...harness.code_meter import Stopwatch
from ...harness.mechanics.state import States
from ...harness.types import Problem, Status, StepControl, Trajectory

ROUNDED = 1e-9  # of a step: what is left of the time then is no step


class Node(NamedTuple):
    """One end of a step: time [s], poses in space, and v = (r_dot [space], Omega [body]) of each body."""

    t: float
    r: Float[np.ndarray, "nb 3"]
    R: Float[np.ndarray, "nb 3 3"]
    v: Float[np.ndarray, "nb 6"]


def begin(problem: Problem) -> Node:
    """The start of a problem."""
    s = problem.initial
    return Node(s.t, s.r, s.R, np.hstack((s.v, s.Omega)))


def march(problem: Problem, control: StepControl, step: Any, most_cuts: int = 0) -> Trajectory:
    """Call ``step(dt, node, carried)`` along a grid of ``control.dt``; it returns None where it asks for a shorter one.

    A node has ``t``, ``r``, ``R`` and ``v``; with it a step returns what it carries on, and a reaction.
    """
    watch, dt, t_end = Stopwatch(), float(control.dt or 0.0), problem.t_end
    node, carried, reaction = step.start(problem)
    nodes, reactions, cuts, ended = [node], [reaction], 0, (Status.SUCCESS, "")
    whole = int(t_end / dt + ROUNDED)
    todo = [(dt, 0)] * whole
    if t_end - whole * dt > ROUNDED * dt:
        todo = [(t_end - whole * dt, 0), *todo]
    while todo and ended[0] is Status.SUCCESS:
        h, level = todo.pop()
        try:
            with np.errstate(all="ignore"):  # overflow on the way to a step that is cut
                made = step(h, node, carried)
        except np.linalg.LinAlgError:  # of numbers that are not finite
            made = None
        if made is not None and not np.all(np.isfinite(made[0].v)):
            made = None
        if made is None and level == most_cuts:
            cut = f", cut {most_cuts} times," if most_cuts else ""
            ended = Status.STEP_UNDERFLOW, f"a step of this size{cut} does not come to an end"
        elif made is None:
            cuts, todo = cuts + 1, [*todo, (0.5 * h, level + 1), (0.5 * h, level + 1)]
        else:
            node, carried, reaction = made
            nodes.append(node)
            reactions.append(reaction)
            if control.spool is not None and control.spool.due():
                new = nodes[control.spool.rows :]
                control.spool.take([x.t for x in new], _states(new))
            if todo and len(nodes) > control.max_steps:
                ended = Status.STALLED, f"max_steps = {control.max_steps} reached"
            elif todo and control.cpu_limit is not None and watch.solver > control.cpu_limit:
                ended = Status.STALLED, f"CPU limit of {control.cpu_limit:g} s reached"
    message = f"{ended[1]} at t = {node.t:g} s" if ended[1] else ""
    counters = {"steps": len(nodes) - 1, "step_cuts": cuts, **step.counters}
    return Trajectory(
        np.array([x.t for x in nodes]), _states(nodes), ended[0], message, counters, reaction=np.stack(reactions),
        cpu_time=watch.solver, setup_time=watch.code, notes=("plain NumPy, as its source prints it",),
    )  # fmt: skip


def _states(nodes: list[Any]) -> States:
    v = np.stack([x.v for x in nodes])
    return States(np.stack([x.r for x in nodes]), np.stack([x.R for x in nodes]), v[:, :, :3], v[:, :, 3:])
