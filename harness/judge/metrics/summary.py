"""Compute the numbers of a record from series: largest and last values, trends, step sizes, common counters."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ...base.files import encode_nonfinite
from ...base.text import escape_text
from ...mechanics import so3
from ...mechanics.types import ACCURATE, Law, Problem, Trajectory
from .identity import compute_fingerprint
from .measure import MeasuredSeries, count_predictable, find_largest
from .scales import Scales
from .truncation import DECIDED

COUNTER_NAMES: Mapping[str, tuple[str, ...]] = {  # column: names solvers use for it, the first one preferred
    "rejected": ("rejected", "rejections", "rejected_steps", "cut_backs", "step_cuts", "error_test_failures"),
    "newton_iterations": ("newton_iterations", "newton", "nonlinear_iterations"),
    "evaluations": ("evaluations", "residual_evaluations", "rhs_evaluations", "residuals"),
    "jacobians": ("jacobians", "jacobian_evaluations"),
    "factorisations": ("factorisations", "factorizations", "lu", "lu_decompositions"),
}


def make_columns(problem: Problem, trajectory: Trajectory, m: MeasuredSeries) -> dict[str, Any]:
    """Return the measured columns of a ``RunRecord`` by name, from a trajectory and its series ``m``."""
    size = m.size
    with np.errstate(all="ignore"):
        return {
            "t_reached_s": float(m.t[-1]),
            "problem_fingerprint": compute_fingerprint(problem),
            **_energy(problem, m, size),
            "length_scale_m": size.length,
            "speed_scale_m_per_s": size.speed,
            **_limits(problem, m, size),
            **_shares(problem, m),
            "phi_max": find_largest(m.phi_norm),
            "phi_end": float(m.phi_norm[-1]),
            "phi_dot_max": find_largest(m.phi_dot_norm),
            "phi_dot_end": float(m.phi_dot_norm[-1]),
            "eq81_max_sqrtJ": find_largest(m.eq81_norm),
            "eq81_end_sqrtJ": float(m.eq81_norm[-1]),
            "orthogonality_max": find_largest(m.orthogonality),
            "out_of_plane_max_m": math.nan if m.out_of_plane is None else find_largest(m.out_of_plane),
            **_errors(problem, m, size),
            "kinematic_defect": m.kinematic_defect,
            **_measure_return(problem, trajectory),
            "invariant_drifts": json.dumps({i.name: _drift(m.invariants[i.name], i.unit) for i in problem.invariants}),
            **_steps(m.t),
            **_summarize_counters(trajectory.counters),
            "notes": json.dumps([escape_text(n) for n in (*trajectory.notes, *m.notes, *_list_unjudged(m))]),
            "events": len(trajectory.events),
        }


def fit_trend(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"]) -> float:
    """Return the slope of the least-squares line through a(t), in units of a per s.

    Each value is weighted with the time that it stands for. NaN if ``a`` is not finite or has fewer than three values.
    """
    if len(t) < 3 or not np.all(np.isfinite(a)):
        return math.nan
    w = _weights(t)
    t0, a0 = np.sum(w * t) / np.sum(w), np.sum(w * a) / np.sum(w)
    return float(np.sum(w * (t - t0) * (a - a0)) / np.sum(w * (t - t0) ** 2))


def compute_time_mean(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], begin: float, end: float) -> float:
    """Return the mean of a over [begin, end] [s] by the trapezoidal rule on the steps inside; NaN if fewer than two."""
    inside = (t >= begin) & (t <= end)
    if np.sum(inside) < 2:
        return math.nan
    return float(np.trapezoid(a[inside], t[inside]) / np.ptp(t[inside]))


def _weights(t: np.ndarray) -> np.ndarray:
    """Return the time [s] that each step stands for: half the intervals on both sides."""
    dt = np.diff(t)
    return 0.5 * (np.append(dt, 0.0) + np.insert(dt, 0, 0.0))


def _energy(problem: Problem, m: MeasuredSeries, size: Scales) -> dict[str, float]:
    """Return the columns on energy: its scale, its largest and last drift, trend and means over quarters."""
    begin, end = m.t[0], m.t[-1]
    quarter = 0.25 * (end - begin)
    return {
        "energy_start_J": float(m.energy[0]),
        "energy_scale_J": size.energy,
        "energy_drift_max_J": find_largest(m.energy_error),
        "energy_drift_end_J": float(m.energy_error[-1]),
        "energy_trend_W": fit_trend(m.t, m.energy_error),
        "energy_mean_first_quarter_J": compute_time_mean(m.t, m.energy_error, begin, begin + quarter),
        "energy_mean_last_quarter_J": compute_time_mean(m.t, m.energy_error, end - quarter, end),
        "energy_allowed_J": math.nan if problem.energy_allowed is None else problem.energy_allowed,
    }


def _list_unjudged(m: MeasuredSeries) -> list[str]:
    """Return notes on what could not be judged: energy over steps of unknown work, rates at uncertain poses."""
    n, steps, rates = m.steps_of_unknown_work, len(m.t) - 1, m.truncation
    out = [f"energy not judged over {n} of {steps} steps: the work done in them is not known"] if n else []
    for what, unsure in (("accelerations", rates.unsure), ("reactions", rates.unsure_loads)):
        if unsure:
            known = rates.rows - unsure
            how = "judged" if known >= DECIDED * rates.rows else "not determined, known"
            rows = f"at {known} of {rates.rows} rows looked at"
            out.append(f"{what} {how} {rows}: elsewhere a pose is not known well enough for them")
    return out


def _limits(problem: Problem, m: MeasuredSeries, size: Scales) -> dict[str, float]:
    """Return the columns with limits of |phi| and |phi_dot|.

    Empty where these norms are not judged themselves: with axis rows, several mechanisms or a literal start.
    """
    if problem.literal_start or len(m.mechanisms) > 1 or np.any(problem.system.joint_axes):
        return {}
    allowed = size.limits
    return {"phi_limit_m": allowed[Law.CONSTRAINT], "phi_dot_limit_m_per_s": allowed[Law.CONSTRAINT_RATE]}


def _shares(problem: Problem, m: MeasuredSeries) -> dict[str, float]:
    """Return the columns with the largest constraint residuals over their limits, of the worst mechanism.

    Empty without constraint rows, and for a literal start, which opens the joints.
    """
    if problem.literal_start or problem.system.nrows == 0:
        return {}
    names = {"gap_share_max": Law.CONSTRAINT, "gap_rate_share_max": Law.CONSTRAINT_RATE}
    return {k: max(find_largest(one.laws[a]) / one.size.limits[a] for one in m.mechanisms) for k, a in names.items()}


def _errors(problem: Problem, m: MeasuredSeries, size: Scales) -> dict[str, Any]:
    """Return the columns on errors against the reference; empty where nothing was compared."""
    if m.position_error is None or m.orientation_error is None or m.motion_error is None:
        return {}
    compared = int(np.sum(~np.isnan(own))) if (own := m.reference_own_error) is not None else 0
    if own is None or compared == 0:
        return {}
    last = compared - 1
    position, orientation, motion = (a[:compared] for a in (m.position_error, m.orientation_error, m.motion_error))
    judged = count_predictable(m.t[:compared], own[:compared] / size.length)
    by_name = {}
    for o in problem.observables:
        away = np.abs(m.observables[o.name] - m.reference_observables[o.name])[:compared]
        by_name[o.name] = {
            "max": encode_nonfinite(find_largest(away)),
            "end": encode_nonfinite(away[last]),
            "unit": o.unit,
        }
    return {
        "reference": m.reference_route,
        "reference_horizon_s": m.reference_horizon,
        "reference_own_error_m": float(np.max(own[:compared])),
        "compared_to_s": float(m.t[last]),
        **{k: _find_exceeding_time(m.t, motion, level * size.length + own[:compared]) for k, level in ACCURATE.items()},
        "motion_error_max_m": find_largest(motion),
        "position_error_max_m": find_largest(position),
        "position_error_end_m": float(position[last]),
        "orientation_error_max_rad": find_largest(orientation),
        "orientation_error_end_rad": float(orientation[last]),
        **_rates(m, compared),
        "judged_to_s": float(m.t[max(judged - 1, 0)]),
        "motion_error_judged_m": find_largest(motion[:judged]),
        "reference_own_error_judged_m": float(np.max(own[: max(judged, 1)])),
        "position_error_judged_m": find_largest(position[:judged]),
        "orientation_error_judged_rad": find_largest(orientation[:judged]),
        "rate_error_judged_m_per_s": math.nan if m.rate_error is None else find_largest(m.rate_error[:judged]),
        "motion_between_max_m": m.motion_between,
        "observable_errors": json.dumps(by_name),
    }


def _find_exceeding_time(t: np.ndarray, error: np.ndarray, allowed: np.ndarray) -> float:
    """Return the first time [s] at which ``error`` exceeds ``allowed``; the last one compared if it never does."""
    above = ~(error <= allowed)
    return float(t[np.argmax(above) if np.any(above) else len(error) - 1])


def _rates(m: MeasuredSeries, compared: int) -> dict[str, float]:
    """Return the columns on errors of reactions, and of velocities over the first ``compared`` steps."""
    out = {
        "reaction_error_max_N": m.reaction_error,
        "reaction_size_N": m.reaction_size,
        "moment_error_max_Nm": m.moment_error,
        "moment_size_Nm": m.moment_size,
    }
    if m.velocity_error is not None and m.angular_velocity_error is not None:
        out["velocity_error_max_m_per_s"] = find_largest(m.velocity_error[:compared])
        out["angular_velocity_error_max_rad_per_s"] = find_largest(m.angular_velocity_error[:compared])
    return out


def _measure_return(problem: Problem, trajectory: Trajectory) -> dict[str, float]:
    """Return the columns on the distance from the start after an integration back to it; empty if there was none."""
    back, start = trajectory.returned, problem.initial
    if back is None:
        return {}
    return {
        "return_error_m": float(np.max(np.linalg.norm(back.r - start.r, axis=1))),
        "return_error_rad": float(np.max(so3.angle_between(back.R, start.R))),
        "return_error_m_per_s": float(np.max(np.linalg.norm(back.v - start.v, axis=1))),
        "return_error_rad_per_s": float(np.max(np.linalg.norm(back.Omega - start.Omega, axis=1))),
    }


def _drift(values: np.ndarray, unit: str) -> dict[str, Any]:
    """Return the largest (``max``) and last (``end``) deviation of an invariant from its first value, with that value.

    The dict also holds the ``unit``.
    """
    away = values - values[0]
    return {
        "max": encode_nonfinite(find_largest(away)),
        "end": encode_nonfinite(away[-1]),
        "start": encode_nonfinite(values[0]),
        "unit": unit,
    }


def _steps(t: np.ndarray) -> dict[str, float]:
    """Return the columns on the number and sizes of steps [s].

    Sizes leave out the last of several steps, which may be cut.
    """
    dt = np.diff(t)
    if len(dt) == 0:
        return {"steps": 0}
    whole = dt[:-1] if len(dt) > 1 else dt  # the last step may be cut to end at t_end
    least, most = float(np.min(whole)), float(np.max(whole))
    sizes = {"step_min_s": least, "step_median_s": float(np.median(whole)), "step_max_s": most}
    return {"steps": len(dt), **sizes, "step_ratio": most / least}


def _summarize_counters(counters: Mapping[str, int]) -> dict[str, Any]:
    """Return a solver's counters as JSON, and as columns those that all solvers share; NaN for one not counted."""
    out: dict[str, Any] = {"counters": json.dumps({k: int(v) for k, v in counters.items()})}
    for name, known in COUNTER_NAMES.items():
        found = [counters[k] for k in known if k in counters]
        out[name] = float(found[0]) if found else math.nan
    return out
