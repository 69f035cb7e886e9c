"""Survival: the share of a solver's runs that have not stopped, over the part of the simulated time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..model.results import Run


@dataclass(frozen=True)
class Survival:
    """Of one solver. Refusals are no part of it; wrong runs survive, and are counted apart."""

    solver: str
    total: int  # runs that began
    refused: int
    stopped: int
    wrong: int
    x: tuple[float, ...]  # part of the simulated time, 0 to 1: corners of the step line
    y: tuple[float, ...]  # share not stopped

    @property
    def reached(self) -> int:
        return self.total - self.stopped

    @property
    def good(self) -> int:
        return self.reached - self.wrong

    @property
    def least(self) -> float:
        """The part of the time at which the first of them stopped; 1 if none did."""
        return next((a for a, b in zip(self.x, self.y, strict=True) if b < 1.0), 1.0)


def survival(runs: Sequence[Run]) -> tuple[Survival, ...]:
    """One a solver, by name."""
    return tuple(_of(s, [c for c in runs if c.record.solver == s]) for s in sorted({c.record.solver for c in runs}))


def part_reached(run: Run) -> float:
    """Of the time asked for, 0 to 1; 0 for a run without a step."""
    r = run.record
    if not (r.t_end_s > 0.0 and math.isfinite(r.t_reached_s)):
        return 0.0
    return min(max(r.t_reached_s / r.t_end_s, 0.0), 1.0)


def _of(solver: str, runs: Sequence[Run]) -> Survival:
    began = [c for c in runs if c.status != "refused"]
    stops = sorted(part_reached(c) for c in began if c.stopped)
    x, y, left = [0.0], [1.0], len(began)
    for stop in stops:
        before, left = y[-1], left - 1
        x += [stop, stop]
        y += [before, left / len(began)]
    x.append(1.0)
    y.append(y[-1])
    wrong = sum(c.status == "wrong" for c in began)
    return Survival(solver, len(began), len(runs) - len(began), len(stops), wrong, tuple(x), tuple(y))
