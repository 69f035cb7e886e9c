"""How a run is judged: its measures, its columns, the laws that it breaks and where it is inaccurate."""

from typing import Any, NamedTuple

import numpy as np

from mbsbench import Problem, States, Status, Trajectory
from mbsbench.harness.columns.measured import MeasuredSeries
from mbsbench.harness.judge.distance import find_inaccuracy
from mbsbench.harness.judge.law import list_broken_laws
from mbsbench.harness.judge.metrics.measure import measure
from mbsbench.harness.judge.metrics.summary import make_columns
from mbsbench.harness.mechanics.types import Law, Reason


class Judgement(NamedTuple):
    m: MeasuredSeries
    c: dict[str, Any]
    inaccuracy: list[Reason]
    doubts: list[Reason]
    laws: list[Law]  # of the doubts


def judge(problem: Problem, run: Trajectory) -> Judgement:
    m = measure(problem, run)
    c = make_columns(problem, run, m)
    broken = list_broken_laws(problem, run, m, c)
    return Judgement(m, c, find_inaccuracy(m, c), broken, [r.law for r in broken])


def claimed(t: np.ndarray, states: States) -> Trajectory:
    """A motion whose solver claims success."""
    return Trajectory(t, states, Status.SUCCESS, "", {})
