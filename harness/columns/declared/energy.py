"""Columns of energy: the error is E(t) - E(0) minus the work of dampers, loads, user forces and drives."""

from dataclasses import dataclass

from ...mechanics.types import ALLOWED, Law
from ..declaring import column
from ..measured import MeasuredMotion
from ..numbers import compute_time_mean, fit_trend

QUARTER = 0.25  # of the time: drift is the difference of the means over the first and the last


def average_first_quarter(run: MeasuredMotion) -> float:
    """Return the time mean of the energy error [J] over the first quarter of the recorded time."""
    m, begin = run.series, run.series.t[0]
    return compute_time_mean(m.t, m.energy_error, begin, begin + QUARTER * (m.t[-1] - begin))


def average_last_quarter(run: MeasuredMotion) -> float:
    """Return the time mean of the energy error [J] over the last quarter of the recorded time."""
    m, end = run.series, run.series.t[-1]
    return compute_time_mean(m.t, m.energy_error, end - QUARTER * (end - m.t[0]), end)


@dataclass(frozen=True, repr=False)
class EnergyColumns:
    """The energy of a run: what it exchanges, and its error."""

    energy_start_J: float = column("T + V at the start", of=lambda run: float(run.series.energy[0]))
    energy_scale_J: float = column(
        "what the motion exchanges: its largest T, or span of V; drifts are compared with it",
        of=lambda run: run.series.size.energy,
    )
    energy_drift_max_J: float = column(
        "largest energy error over all accepted steps; the work of dampers, loads, user forces and drives is "
        "subtracted, and what it leaves open is no error",
        along=lambda run: run.series.energy_error,
        series="energy_error",
        head="max |E−E₀|",
        unit="J",
        latex=r"$\max|E-E_0|$ [J]",
        order=50,
        tables={"problem": "", "runs": "", "show": "|dE| [J]"},
        rank=0,
        better="less",
        limit=lambda r: ALLOWED[Law.ENERGY] * r.energy_scale_J,
    )
    energy_drift_end_J: float = column(
        "energy error at the last step, with its sign",
        of=lambda run: float(run.series.energy_error[-1]),
        head="E−E₀ at end",
        unit="J",
        show="format_signed",
        order=60,
        better="less",
    )
    energy_trend_W: float = column(
        "least-squares slope of the energy error over time",
        of=lambda run: fit_trend(run.series.t, run.series.energy_error),
        head="Energy trend",
        unit="J/s",
        show="format_signed",
        order=70,
        better="less",
    )
    energy_mean_first_quarter_J: float = column(
        "time mean of the energy error over the first quarter of the time", of=average_first_quarter
    )
    energy_mean_last_quarter_J: float = column(
        "time mean over the last quarter: the difference of the two is secular drift", of=average_last_quarter
    )
    energy_allowed_J: float = column(
        "the benchmark's own limit on the drift, where it has one",
        of=lambda run: run.problem.energy_allowed,
        unchecked="a limit of the problem that judges nothing",
    )
