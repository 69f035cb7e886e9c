"""Cost of a step over the size of a mechanism, with the fitted power laws."""

from collections.abc import Callable, Sequence

import numpy as np

from ..model.growth import Growth
from ..model.results import Run
from ..model.words import seconds, time
from .spec import Axis, Plot, Trace


def growth(problem: str, found: Sequence[Growth], url: Callable[[Run], str]) -> Plot:
    """All settings of one problem in one panel."""
    seen: dict[str, int] = {}
    traces = []
    for g in (g for g in found if g.problem == problem):
        dash = seen[g.solver] = seen.get(g.solver, -1) + 1
        name = f"{g.method}, {g.step}, {time(g.t_end)} s simulated: slope {g.slope:.2f}"
        ends = np.array([g.bodies[0], g.bodies[-1]], dtype=float)
        traces.append(Trace(f"{name}, fitted", ends, 1e3 * g.fitted(ends), solver=g.solver, dash=dash))
        traces.append(Trace(
            name, np.array(g.bodies), 1e3 * np.array(g.cpu_per_step), solver=g.solver, mode="markers",
            urls=[url(c) for c in g.runs],
            words=[f"{c.variant}, {c.record.steps} steps, CPU {seconds(c.record.cpu_median_s)}" for c in g.runs],
        ))  # fmt: skip
    own = [g for g in found if g.problem == problem]
    steepest, flattest = (f(own, key=lambda g: g.slope) for f in (max, min))
    title = f"{problem}: a step of {flattest.solver} grows with the number of bodies to the power {flattest.slope:.2f}"
    if steepest.solver != flattest.solver:
        title += f", one of {steepest.solver} to {steepest.slope:.2f}"
    caption = "Lines are power laws fitted to all sizes; their exponents are in the table: 1 is linear."
    axes = Axis("bodies", "", log=True), Axis("CPU per step", "ms", log=True)
    return Plot(f"growth-{problem}", title, caption, *axes, traces, wide=True)
