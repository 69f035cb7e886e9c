"""From series to the numbers of a record: largest, last, trend; step sizes; counters under common names."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ..files import exact
from ..mechanics import so3
from ..text import printable
from ..types import ACCURATE, Law, Problem, Trajectory
from .identity import fingerprint
from .measure import Measured, count_predictable, largest
from .scales import Scales

COUNTER_NAMES: Mapping[str, tuple[str, ...]] = {  # column: names solvers use for it, the first one preferred
    "rejected": ("rejected", "rejections", "rejected_steps", "cut_backs", "step_cuts", "error_test_failures"),
    "newton_iterations": ("newton_iterations", "newton", "nonlinear_iterations"),
    "evaluations": ("evaluations", "residual_evaluations", "rhs_evaluations", "residuals"),
    "jacobians": ("jacobians", "jacobian_evaluations"),
    "factorisations": ("factorisations", "factorizations", "lu", "lu_decompositions"),
}


def columns(problem: Problem, trajectory: Trajectory, m: Measured) -> dict[str, Any]:
    """The metric columns of ``RunRecord``."""
    size = m.size
    with np.errstate(all="ignore"):
        return {
            "t_reached_s": float(m.t[-1]),
            "problem_fingerprint": fingerprint(problem),
            **_energy(problem, m, size),
            "length_scale_m": size.length,
            "speed_scale_m_per_s": size.speed,
            **_limits(problem, m, size),
            **_shares(problem, m),
            "phi_max": largest(m.phi_norm),
            "phi_end": float(m.phi_norm[-1]),
            "phi_dot_max": largest(m.phi_dot_norm),
            "phi_dot_end": float(m.phi_dot_norm[-1]),
            "eq81_max_sqrtJ": largest(m.eq81_norm),
            "eq81_end_sqrtJ": float(m.eq81_norm[-1]),
            "orthogonality_max": largest(m.orthogonality),
            "out_of_plane_max_m": math.nan if m.out_of_plane is None else largest(m.out_of_plane),
            **_errors(problem, m, size),
            "kinematic_defect": m.kinematic_defect,
            **_way_back(problem, trajectory),
            "invariant_drifts": json.dumps({i.name: _drift(m.invariants[i.name], i.unit) for i in problem.invariants}),
            **_steps(m.t),
            **_summarize_counters(trajectory.counters),
            "notes": json.dumps([printable(n) for n in (*trajectory.notes, *_list_unjudged(m))]),
            "events": len(trajectory.events),
        }


def trend(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"]) -> float:
    """Slope of the least-squares line through a(t), each value weighted with the time it stands for."""
    if len(t) < 3 or not np.all(np.isfinite(a)):
        return math.nan
    w = _weights(t)
    t0, a0 = np.sum(w * t) / np.sum(w), np.sum(w * a) / np.sum(w)
    return float(np.sum(w * (t - t0) * (a - a0)) / np.sum(w * (t - t0) ** 2))


def time_mean(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, " nt"], begin: float, end: float) -> float:
    """Mean of a over [begin, end] by the trapezoidal rule on the steps inside."""
    inside = (t >= begin) & (t <= end)
    if np.sum(inside) < 2:
        return math.nan
    return float(np.trapezoid(a[inside], t[inside]) / np.ptp(t[inside]))


def _weights(t: np.ndarray) -> np.ndarray:
    dt = np.diff(t)
    return 0.5 * (np.append(dt, 0.0) + np.insert(dt, 0, 0.0))


def _energy(problem: Problem, m: Measured, size: Scales) -> dict[str, float]:
    begin, end = m.t[0], m.t[-1]
    quarter = 0.25 * (end - begin)
    return {
        "energy_start_J": float(m.energy[0]),
        "energy_scale_J": size.energy,
        "energy_drift_max_J": largest(m.energy_error),
        "energy_drift_end_J": float(m.energy_error[-1]),
        "energy_trend_W": trend(m.t, m.energy_error),
        "energy_mean_first_quarter_J": time_mean(m.t, m.energy_error, begin, begin + quarter),
        "energy_mean_last_quarter_J": time_mean(m.t, m.energy_error, end - quarter, end),
        "energy_allowed_J": math.nan if problem.energy_allowed is None else problem.energy_allowed,
    }


def _list_unjudged(m: Measured) -> list[str]:
    """List the steps over which the work of forces or drives, and so the energy, is not known."""
    n, steps = m.steps_of_unknown_work, len(m.t) - 1
    return [f"energy not judged over {n} of {steps} steps: the work done in them is not known"] if n else []


def _limits(problem: Problem, m: Measured, size: Scales) -> dict[str, float]:
    """Limits of |phi| and |phi_dot|, where these series are judged (``measure``: axis rows count in metres)."""
    if problem.literal_start or len(m.mechanisms) > 1 or np.any(problem.system.joint_axes):
        return {}
    allowed = size.limits
    return {"phi_limit_m": allowed[Law.CONSTRAINT], "phi_dot_limit_m_per_s": allowed[Law.CONSTRAINT_RATE]}


def _shares(problem: Problem, m: Measured) -> dict[str, float]:
    """Judged sizes of constraints over their limits: of the mechanism that comes nearest to it."""
    if problem.literal_start or problem.system.nrows == 0:
        return {}
    names = {"gap_share_max": Law.CONSTRAINT, "gap_rate_share_max": Law.CONSTRAINT_RATE}
    return {k: max(largest(one.laws[a]) / one.size.limits[a] for one in m.mechanisms) for k, a in names.items()}


def _errors(problem: Problem, m: Measured, size: Scales) -> dict[str, Any]:
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
        by_name[o.name] = {"max": exact(largest(away)), "end": exact(away[last]), "unit": o.unit}
    return {
        "reference": m.reference_route,
        "reference_horizon_s": m.reference_horizon,
        "reference_own_error_m": float(np.max(own[:compared])),
        "compared_to_s": float(m.t[last]),
        **{k: _until(m.t, motion, level * size.length + own[:compared]) for k, level in ACCURATE.items()},
        "motion_error_max_m": largest(motion),
        "position_error_max_m": largest(position),
        "position_error_end_m": float(position[last]),
        "orientation_error_max_rad": largest(orientation),
        "orientation_error_end_rad": float(orientation[last]),
        **_rates(m, compared),
        "judged_to_s": float(m.t[max(judged - 1, 0)]),
        "motion_error_judged_m": largest(motion[:judged]),
        "reference_own_error_judged_m": float(np.max(own[: max(judged, 1)])),
        "position_error_judged_m": largest(position[:judged]),
        "orientation_error_judged_rad": largest(orientation[:judged]),
        "rate_error_judged_m_per_s": math.nan if m.rate_error is None else largest(m.rate_error[:judged]),
        "motion_between_max_m": m.motion_between,
        "observable_errors": json.dumps(by_name),
    }


def _until(t: np.ndarray, error: np.ndarray, allowed: np.ndarray) -> float:
    """First time [s] that ``error`` is above ``allowed``; the last one compared if it never is."""
    above = ~(error <= allowed)
    return float(t[np.argmax(above) if np.any(above) else len(error) - 1])


def _rates(m: Measured, compared: int) -> dict[str, float]:
    out = {"reaction_error_max_N": m.reaction_error, "reaction_size_N": m.reaction_size}
    if m.velocity_error is not None and m.angular_velocity_error is not None:
        out["velocity_error_max_m_per_s"] = largest(m.velocity_error[:compared])
        out["angular_velocity_error_max_rad_per_s"] = largest(m.angular_velocity_error[:compared])
    return out


def _way_back(problem: Problem, trajectory: Trajectory) -> dict[str, float]:
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
    away = values - values[0]
    return {"max": exact(largest(away)), "end": exact(away[-1]), "start": exact(values[0]), "unit": unit}


def _steps(t: np.ndarray) -> dict[str, float]:
    dt = np.diff(t)
    if len(dt) == 0:
        return {"steps": 0}
    whole = dt[:-1] if len(dt) > 1 else dt  # the last step may be cut to end at t_end
    least, most = float(np.min(whole)), float(np.max(whole))
    sizes = {"step_min_s": least, "step_median_s": float(np.median(whole)), "step_max_s": most}
    return {"steps": len(dt), **sizes, "step_ratio": most / least}


def _summarize_counters(counters: Mapping[str, int]) -> dict[str, Any]:
    out: dict[str, Any] = {"counters": json.dumps({k: int(v) for k, v in counters.items()})}
    for name, known in COUNTER_NAMES.items():
        found = [counters[k] for k in known if k in counters]
        out[name] = float(found[0]) if found else math.nan
    return out
