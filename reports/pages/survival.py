"""Survival: the share of a solver's runs that have not stopped, over the part of the simulated time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.results import Run, by_solver


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
    return tuple(_of(solver, own) for solver, own in sorted(by_solver(runs).items()))


def part_reached(run: Run) -> float:
    """Of the time asked for, 0 to 1; 0 for a run without a step."""
    r = run.record
    if not (r.t_end_s > 0.0 and math.isfinite(r.t_reached_s)):
        return 0.0
    return min(max(r.t_reached_s / r.t_end_s, 0.0), 1.0)


def _of(solver: str, runs: Sequence[Run]) -> Survival:
    began = [c for c in runs if c.status != "refused"]
    stops = sorted(part_reached(c) for c in began if c.stopped)
    left = [(len(began) - k) / len(began) for k in range(len(stops) + 1)] if began else [1.0]
    x, y = (0.0, *np.repeat(stops, 2).tolist(), 1.0), tuple(np.repeat(left, 2).tolist())
    wrong = sum(c.status == "wrong" for c in began)
    return Survival(solver, len(began), len(runs) - len(began), len(stops), wrong, x, y)
