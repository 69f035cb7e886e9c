"""Cost of a step over the number of bodies, wherever a run has the same settings at several sizes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from reports.drawing import Drawn, log_axis, new_figure, plain
from reports.palette import DASHES, Look
from reports.reading import Cell

SIZES = 3  # a slope from two sizes would be no evidence


@dataclass(frozen=True)
class Scaling:
    """One solver's settings on one problem at several sizes, smallest first."""

    problem: str
    method: str
    solver: str
    step: str
    bodies: tuple[int, ...]
    cpu_per_step: tuple[float, ...]
    cells: frozenset[str]

    @property
    def slope(self) -> float:
        """Exponent of the power law fitted to all sizes."""
        return float(np.polyfit(np.log(self.bodies), np.log(self.cpu_per_step), 1)[0])


def scalings(cells: Sequence[Cell], bodies: Mapping[str, int]) -> list[Scaling]:
    """All there are; ``bodies`` by cell. Only runs that reached the end with a CPU time count."""
    found: dict[tuple[str, str, str, str], dict[int, list[Cell]]] = {}
    for c in cells:
        n, r = bodies.get(c.record.cell, 0), c.record
        if c.succeeded and n > 0 and r.steps > 0 and r.cpu_median_s > 0.0:
            found.setdefault((r.problem, c.method, r.solver, c.step_words), {}).setdefault(n, []).append(c)
    out = []
    for key, sizes in sorted(found.items()):
        if len(sizes) >= SIZES:
            cost = [float(np.median([c.record.cpu_median_s / c.record.steps for c in sizes[n]])) for n in sorted(sizes)]
            own = frozenset(c.record.cell for same in sizes.values() for c in same)
            out.append(Scaling(*key, tuple(sorted(sizes)), tuple(cost), own))
    return out


def scaling(name: str, problem: str, found: Sequence[Scaling], looks: Mapping[str, Look]) -> Drawn:
    """All settings of one problem in one panel."""
    own = [s for s in found if s.problem == problem]
    caption = (
        "CPU time per accepted step over the number of bodies; the slope is that of a power law fitted to all sizes."
    )
    return Drawn(name, f"{problem}: cost of a step over its size", caption, lambda: _draw(own, looks))


def _draw(own: Sequence[Scaling], looks: Mapping[str, Look]) -> Figure:
    figure = new_figure(3.2 + 0.14 * len(own))
    ax = figure.subplots()
    seen: dict[str, int] = {}
    for s in own:
        look, k = looks[s.solver], seen.get(s.solver, 0)
        seen[s.solver] = k + 1
        words = plain(f"{s.method}  {s.step}: slope {s.slope:.2f}")
        ax.plot(s.bodies, 1e3 * np.array(s.cpu_per_step), color=look.colour, marker=look.marker, label=words,
                linestyle=DASHES[k % len(DASHES)])  # fmt: skip
    log_axis(ax)
    log_axis(ax, "x")
    sizes = sorted({n for s in own for n in s.bodies})
    if len(sizes) < 12 and math.log10(sizes[-1] / sizes[0]) < 2.5:
        ax.set_xticks(sizes, [str(n) for n in sizes])
        ax.set_xticks([], minor=True)
    ax.set_xlabel("bodies")
    ax.set_ylabel("CPU per step [ms]")
    figure.legend(loc="outside lower left", ncols=2 if len(own) < 7 else 1)
    return figure
