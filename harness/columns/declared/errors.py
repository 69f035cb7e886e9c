"""Columns of errors against the reference, within its horizon; judged up to where the motion becomes chaotic."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.files import encode_nonfinite
from ...mechanics.types import ACCURATE, PREDICTABLE
from ..declaring import column
from ..measured import MeasuredMotion
from ..numbers import find_exceeding_time, find_largest

WHOLE = "up to where the reference or the run ends"


def where_compared(number: Callable[[MeasuredMotion], Any]) -> Callable[[MeasuredMotion], Any]:
    """Return the function of a column: ``number`` of a motion that was compared with the reference, else None."""
    return lambda run: number(run) if run.compared else None


def find_error(name: str) -> Callable[[MeasuredMotion], Any]:
    """Return the function of a column: the largest error of the series ``name`` over the compared steps."""
    return where_compared(lambda run: find_largest(run.take_compared(name)))


def find_last_error(name: str) -> Callable[[MeasuredMotion], Any]:
    """Return the function of a column: the error of the series ``name`` at the last compared step."""
    return where_compared(lambda run: float(run.take_compared(name)[-1]))


def find_judged_error(name: str) -> Callable[[MeasuredMotion], Any]:
    """Return the function of a column: the largest error of the series ``name`` over the steps that are judged."""
    return where_compared(lambda run: find_largest(run.take_judged(name)))


def find_velocity_error(name: str) -> Callable[[MeasuredMotion], Any]:
    """Return the function of a column: the largest error of the velocities ``name`` over the compared steps."""

    def find(run: MeasuredMotion) -> float | None:
        """Return the error [m/s, rad/s]; None for a motion whose velocities were not compared."""
        m = run.series
        known = run.compared and m.velocity_error is not None and m.angular_velocity_error is not None
        return find_largest(run.take_compared(name)) if known else None

    return find


def find_rate_error(run: MeasuredMotion) -> float | None:
    """Return the largest error of velocities [m/s], rms over a body, over the judged steps; None if not compared."""
    return find_largest(run.take_judged("rate_error")) if run.compared and run.series.rate_error is not None else None


def find_accurate_time(level: float) -> Callable[[MeasuredMotion], Any]:
    """Return the function of a column: the time [s] at which the motion error passes ``level`` times the length scale.

    The reference's stated error is allowed in addition.
    """

    def find(run: MeasuredMotion) -> float:
        """Return the time [s]; if the error stays below, that of the last compared step."""
        allowed = level * run.series.size.length + run.take_compared("reference_own_error")
        return find_exceeding_time(run.series.t, run.take_compared("motion_error"), allowed)

    return where_compared(find)


def write_observable_errors(run: MeasuredMotion) -> str:
    """Return the largest and last difference of each observable from the reference, with its unit, as JSON."""
    m, by_name = run.series, {}
    for o in run.problem.observables:
        away = np.abs(m.observables[o.name] - m.reference_observables[o.name])[: run.compared]
        by_name[o.name] = {
            "max": encode_nonfinite(find_largest(away)),
            "end": encode_nonfinite(away[-1]),
            "unit": o.unit,
        }
    return json.dumps(by_name)


def write_invariant_drifts(run: MeasuredMotion) -> str:
    """Return the largest and last change of each invariant since the start, with its first value and unit, as JSON."""
    by_name = {}
    for i in run.problem.invariants:
        values = run.series.invariants[i.name]
        away = values - values[0]
        by_name[i.name] = {
            "max": encode_nonfinite(find_largest(away)),
            "end": encode_nonfinite(away[-1]),
            "start": encode_nonfinite(values[0]),
            "unit": i.unit,
        }
    return json.dumps(by_name)


def find_judged_reference_error(record: Any) -> float:
    """Return the largest stated error [m] of the reference while errors of the run of ``record`` are judged.

    For older records, which have only the error over all time, return an upper bound.
    """
    known, length = float(record.reference_own_error_judged_m), record.length_scale_m
    if not math.isnan(known):
        return known
    return float(min(record.reference_own_error_m, PREDICTABLE * (length if length > 0.0 else 1.0)))


def find_motion_limit(record: Any) -> float:
    """Return the motion error [m] above which the run of ``record`` is inaccurate.

    It is a tenth of the reach plus the reference's stated error, if that is known.
    """
    own = find_judged_reference_error(record)
    return float(ACCURATE["accurate_until_s"] * record.length_scale_m + (0.0 if math.isnan(own) else own))


@dataclass(frozen=True, repr=False)
class ErrorColumns:
    """The errors of a run against the reference, within its horizon."""

    reference: str = column(
        "how the reference is computed; empty without one",
        "",
        of=where_compared(lambda run: run.series.reference_route),
    )
    reference_horizon_s: float = column(
        "errors are taken up to here, or to t_end", of=where_compared(lambda run: run.series.reference_horizon)
    )
    reference_own_error_m: float = column(
        "error that the reference states for itself: smaller errors cannot be distinguished",
        of=where_compared(lambda run: float(np.max(run.take_compared("reference_own_error")))),
        head="Stated error",
        unit="m",
        order=230,
    )
    compared_to_s: float = column(
        "last step before the reference or the run ends",
        of=where_compared(lambda run: float(run.series.t[run.compared - 1])),
        head="Compared to",
        unit="s",
        show="time",
        order=220,
    )
    accurate_until_s: float = column(
        "time at which the motion error first passes a tenth of the reach, length_scale_m; the end of the comparison "
        "if it never does",
        of=find_accurate_time(ACCURATE["accurate_until_s"]),
        head="Accurate until",
        unit="s",
        show="time",
        order=160,
        better="more",
    )
    accurate_until_1pct_s: float = column(
        "the same for a hundredth",
        of=find_accurate_time(ACCURATE["accurate_until_1pct_s"]),
        head="to 1 %",
        unit="s",
        show="time",
        order=170,
        better="more",
    )
    accurate_until_0p1pct_s: float = column(
        "the same for a thousandth",
        of=find_accurate_time(ACCURATE["accurate_until_0p1pct_s"]),
        head="to 0.1 %",
        unit="s",
        show="time",
        order=180,
        better="more",
    )
    motion_error_max_m: float = column(
        f"largest distance of a body from its exact pose, root mean square over its matter, {WHOLE}",
        of=find_error("motion_error"),
        head="Motion error to the end of the reference",
        unit="m",
        key="motion_error_whole",
        order=150,
        better="less",
    )
    position_error_max_m: float = column(
        f"largest distance of a centre of mass from its exact position, {WHOLE}",
        of=find_error("position_error"),
        head="Position error to the end of the reference",
        unit="m",
        key="position_error_whole",
        order=130,
        better="less",
    )
    position_error_end_m: float = column("that error at the last step compared", of=find_last_error("position_error"))
    orientation_error_max_rad: float = column(
        f"largest angle between a body and its exact orientation, {WHOLE}",
        of=find_error("orientation_error"),
        head="Orientation error to the end of the reference",
        unit="rad",
        key="orientation_error_whole",
        order=140,
        better="less",
    )
    orientation_error_end_rad: float = column(
        "that angle at the last step compared", of=find_last_error("orientation_error")
    )
    velocity_error_max_m_per_s: float = column(
        "max over time and bodies of |v - v_exact| of the C's", of=find_velocity_error("velocity_error")
    )
    angular_velocity_error_max_rad_per_s: float = column(
        "max over time and bodies of |Omega - Omega_exact|", of=find_velocity_error("angular_velocity_error")
    )
    reaction_error_max_N: float = column(
        "max over instants and bodies of the error of the joint forces' sum on a body",
        of=where_compared(lambda run: run.series.reaction_error),
        better="less",
    )
    reaction_size_N: float = column(
        "largest sum of joint forces on a body in the exact motion, beside which the error stands",
        of=where_compared(lambda run: run.series.reaction_size),
    )
    moment_error_max_Nm: float = column(
        "max over instants and bodies of the error of the joints' moment about its C",
        of=where_compared(lambda run: run.series.moment_error),
        better="less",
    )
    moment_size_Nm: float = column(
        "largest such moment of the exact motion, or force at the farthest joint",
        of=where_compared(lambda run: run.series.moment_size),
    )
    judged_to_s: float = column(
        "errors are judged up to this time: beyond it the motion is chaotic and no solver can track it, so only "
        "energy and constraints count",
        of=where_compared(lambda run: float(run.series.t[max(run.judged - 1, 0)])),
        head="judged to",
        unit="s",
        show="time",
        order=120,
    )
    reference_own_error_judged_m: float = column(
        "stated error of the reference up to there",
        of=where_compared(lambda run: float(np.max(run.take_compared("reference_own_error")[: max(run.judged, 1)]))),
    )
    motion_error_judged_m: float = column(
        "max of the motion error up to there",
        of=find_judged_error("motion_error"),
        better="less",
        limit=find_motion_limit,
    )
    rate_error_judged_m_per_s: float = column(
        "max error of velocities up to there, rms over a body's matter", of=find_rate_error, better="less"
    )
    motion_between_max_m: float = column(
        "max motion error between the steps, at times of the reference's own",
        of=where_compared(lambda run: run.series.motion_between),
        better="less",
    )
    position_error_judged_m: float = column(
        "max of the position error up to there", of=find_judged_error("position_error"), better="less"
    )
    orientation_error_judged_rad: float = column(
        "max of the orientation error up to there", of=find_judged_error("orientation_error"), better="less"
    )
    observable_errors: str = column(
        "JSON: {name: {max, end, unit}} of |observable - exact|", "{}", of=where_compared(write_observable_errors)
    )
    invariant_drifts: str = column(
        "JSON: {name: {max, end, start, unit}} of |invariant - its start|", "{}", of=write_invariant_drifts
    )
