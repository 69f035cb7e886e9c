"""Columns of steps and work: numbers and sizes of steps, and counts that solvers share."""

import json
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..declaring import column
from ..measured import MeasuredMotion

OWN_WORD = "the solver's own word"


def select_whole_steps(run: MeasuredMotion) -> Float[np.ndarray, " n"]:
    """Return the sizes of the accepted steps [s] without the last one, which may be cut to end at t_end.

    A single step is returned all the same.
    """
    dt = np.diff(run.series.t)
    return dt[:-1] if len(dt) > 1 else dt


def reduce_steps(number: Callable[[np.ndarray], float]) -> Callable[[MeasuredMotion], float | None]:
    """Return the function of a column: ``number`` of the sizes of the whole steps [s]; None without a step."""

    def find(run: MeasuredMotion) -> float | None:
        """Return ``number`` of the whole steps, None without a step."""
        steps = select_whole_steps(run)
        return float(number(steps)) if len(steps) else None

    return find


def read_counter(*names: str) -> Callable[[MeasuredMotion], float | None]:
    """Return the function of a column: the solver's counter under the first of ``names`` that the solver uses."""

    def find(run: MeasuredMotion) -> float | None:
        """Return the count; None if the solver has no counter of these names."""
        counters = run.trajectory.counters
        return next((float(counters[name]) for name in names if name in counters), None)

    return find


def write_counters(run: MeasuredMotion) -> str:
    """Return all counters of the solver as JSON."""
    return json.dumps({k: int(v) for k, v in run.trajectory.counters.items()})


@dataclass(frozen=True, repr=False)
class WorkColumns:
    """The steps of a run, and the work that they took."""

    steps: int = column(
        "accepted steps",
        0,
        of=lambda run: len(run.series.t) - 1,
        head="Steps",
        show="format_count",
        order=290,
        tables=("problem",),
    )
    step_min_s: float = column(
        "smallest accepted step, without the last one, which may be cut to end at t_end",
        of=reduce_steps(np.min),
        head="Step min",
        unit="s",
        order=310,
    )
    step_median_s: float = column(
        "median accepted step", of=reduce_steps(np.median), head="median", unit="s", order=320
    )
    step_max_s: float = column("largest accepted step", of=reduce_steps(np.max), head="max", unit="s", order=330)
    step_ratio: float = column("largest over smallest step", of=reduce_steps(lambda dt: np.max(dt) / np.min(dt)))
    rejected: float = column(
        "rejected steps, where the solver counts them",
        of=read_counter("rejected", "rejections", "rejected_steps", "cut_backs", "step_cuts", "error_test_failures"),
        head="Rejected",
        show="format_count",
        order=300,
        unchecked=OWN_WORD,
    )
    newton_iterations: float = column(
        "iterations of the nonlinear solver",
        of=read_counter("newton_iterations", "newton", "nonlinear_iterations"),
        head="Newton",
        show="format_count",
        key="newton",
        order=340,
        unchecked=OWN_WORD,
    )
    evaluations: float = column(
        "evaluations of the residual or right-hand side: work that does not depend on the machine",
        of=read_counter("evaluations", "residual_evaluations", "rhs_evaluations", "residuals"),
        head="Evaluations",
        show="format_count",
        order=350,
        tables=("problem", "runs"),
        unchecked=OWN_WORD,
    )
    jacobians: float = column(
        "evaluations of the Jacobian",
        of=read_counter("jacobians", "jacobian_evaluations"),
        head="Jacobians",
        show="format_count",
        order=360,
        unchecked=OWN_WORD,
    )
    factorisations: float = column(
        "matrix factorisations",
        of=read_counter("factorisations", "factorizations", "lu", "lu_decompositions"),
        head="Factorisations",
        show="format_count",
        order=370,
        unchecked=OWN_WORD,
    )
    counters: str = column("JSON: all counters of the solver", "{}", of=write_counters, unchecked=OWN_WORD)
