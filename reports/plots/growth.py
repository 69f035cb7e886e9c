"""The cost of a step over the size of a mechanism, with fitted power laws, wherever a run comes in several sizes."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..model.motion import bodies_in
from ..model.results import Results, Run, group_by
from ..model.words import seconds, time
from .spec import Axis, Plot, Trace

SIZES = 3  # a slope from two sizes would be no evidence


@dataclass(frozen=True)
class Growth:
    """One solver's settings on one problem at several sizes, smallest first."""

    problem: str
    method: str
    solver: str
    step: str
    t_end: float  # [s] simulated: a longer motion has other steps
    bodies: tuple[int, ...]
    cpu_per_step: tuple[float, ...]
    runs: tuple[Run, ...]  # one a size

    @cached_property
    def fit(self) -> tuple[float, float]:
        """Exponent and logarithm of the factor of the power law through all sizes, by least squares."""
        slope, factor = np.polyfit(np.log(self.bodies), np.log(self.cpu_per_step), 1)
        return float(slope), float(factor)

    @property
    def words(self) -> str:
        """Method, step and time."""
        return f"{self.method}, {self.step}, {time(self.t_end)} s simulated"


def growths(runs: Sequence[Run], bodies: Mapping[str, int]) -> list[Growth]:
    """All there are; ``bodies`` by run. Only runs that reached the end with a CPU time count."""
    timed = [c for c in runs if c.succeeded and c.record.steps > 0 and c.record.cpu_median_s > 0.0]
    sized = [c for c in timed if bodies.get(c.record.run_id, 0) > 0]
    found = group_by(sized, lambda c: (c.record.problem, c.method, c.record.solver, c.step_words, c.record.t_end_s))
    out = []
    for key, own in sorted(found.items()):
        sizes = dict(sorted(group_by(own, lambda c: bodies[c.record.run_id]).items()))
        if len(sizes) >= SIZES:
            cost = [float(np.median([c.record.cpu_median_s / c.record.steps for c in same])) for same in sizes.values()]
            out.append(Growth(*key, tuple(sizes), tuple(cost), tuple(same[0] for same in sizes.values())))
    return out


def growths_of(results: Results) -> list[Growth]:
    """All that the results hold; empty where no problem comes in three sizes."""
    variants = Counter(p.problem for p in results.variants)
    bodies: dict[str, int] = {}
    for variant in results.variants:
        if variants[variant.problem] > 1:  # its runs have the same bodies: one series file is enough
            some = next((s for c in variant.runs if c.succeeded and (s := results.series(c)) is not None), None)
            bodies |= {c.record.run_id: bodies_in(some) for c in variant.runs} if some is not None else {}
    return growths(results.runs, bodies)


def growth(problem: str, found: Sequence[Growth], url: Callable[[Run], str]) -> Plot:
    """All settings of one problem in one panel."""
    seen: Counter[str] = Counter()
    traces, own = [], [g for g in found if g.problem == problem]
    for g in own:
        slope, factor = g.fit
        name = f"{g.words}: slope {slope:.2f}"
        ends = np.array([g.bodies[0], g.bodies[-1]], dtype=float)
        fitted = 1e3 * (np.exp(factor) * ends**slope)
        traces.append(Trace(f"{name}, fitted", ends, fitted, solver=g.solver, dash=seen[g.solver]))
        traces.append(Trace(
            name, np.array(g.bodies), 1e3 * np.array(g.cpu_per_step), solver=g.solver, mode="markers",
            urls=[url(c) for c in g.runs],
            words=[f"{c.variant}, {c.record.steps} steps, CPU {seconds(c.record.cpu_median_s)}" for c in g.runs],
        ))  # fmt: skip
        seen[g.solver] += 1
    steepest, flattest = (f(own, key=lambda g: g.fit[0]) for f in (max, min))
    title = f"{problem}: a step of {flattest.solver} grows with the number of bodies to the power {flattest.fit[0]:.2f}"
    if steepest.solver != flattest.solver:
        title += f", one of {steepest.solver} to {steepest.fit[0]:.2f}"
    caption = "Lines are power laws fitted to all sizes; their exponents are in the table: 1 is linear."
    axes = Axis("bodies", "", log=True), Axis("CPU per step", "ms", log=True)
    return Plot(f"growth-{problem}", title, caption, *axes, traces, wide=True)
