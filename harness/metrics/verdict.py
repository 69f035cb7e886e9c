"""Is a claimed success one? Limits on laws and on the error, each with its reason; all scale with the problem.

They are wide on purpose: a coarse step that is merely inaccurate stays a success with its error beside it; only what
is no longer the motion asked for is wrong. The benchmark's own limit (``energy_allowed_J``) is not judged here.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ..types import PREDICTABLE, Law, Problem, Reason, Trajectory
from .measure import Measured
from .scales import Scales

ENERGY = 0.10  # of T(0) + m g L: a tenth of all there is to exchange appears or disappears
INVARIANT = 0.10  # of its scale by unit (momentum: m v L), or of its start if that is larger
PHI = 0.01  # of the mechanism's size: the joint is visibly apart
PHI_DOT = 0.05  # of sqrt(2 E / m): velocities leave the joints by a twentieth of the typical speed
POSITION = 0.10  # of the mechanism's size, beyond the reference's own error, while the motion is predictable
ORIENTATION = 0.5  # [rad], about 30 deg: a fast spin may lag by tenths over hundreds of turns without being lost
ORTHOGONALITY = 1e-3  # |R^T R - 1|: such an R distorts lengths by as much
START = 1e-9  # [m], [m/s], relative to 1 + size: what the consistency check of problems allows


def doubts(
    problem: Problem, trajectory: Trajectory, m: Measured, columns: Mapping[str, Any], size: Scales
) -> list[Reason]:
    """Why a claimed success is wrong; empty if nothing contradicts it."""
    s, t = trajectory.states, m.t
    values = [a.reshape(len(t), -1) for a in (t, s.r, s.R, s.v, s.Omega)]
    finite = np.isfinite(np.concatenate(values, axis=1)).all(axis=1)
    if not np.all(finite):
        return [Reason(Law.FINITE, time_s=_first(t, ~finite))]
    out = []
    if abs(t[-1] - problem.t_end) > 1e-9 * max(problem.t_end, 1.0):
        out.append(Reason(Law.END, float(t[-1]), problem.t_end, "s", float(t[-1])))
    moved = max(float(np.max(np.abs(getattr(s, k)[0] - getattr(problem.initial, k)))) for k in ("r", "R", "v", "Omega"))
    allowed = START * (1.0 + size.length + size.speed)
    if moved > allowed or t[0] != 0.0:
        out.append(Reason(Law.START, moved, allowed, time_s=float(t[0])))

    def limit(law: Law, most: float, allowed: float, unit: str, series: np.ndarray | None, name: str = "") -> None:
        if not math.isnan(most) and not most <= allowed:
            when = math.nan if series is None else _first(t, ~(np.abs(series) <= allowed))
            out.append(Reason(law, most, allowed, unit, when, name))

    limit(Law.ENERGY, columns["energy_drift_max_J"], ENERGY * size.energy, "J", m.energy_error)
    limit(Law.CONSTRAINT, columns["phi_max"], PHI * size.length, "m", m.phi_norm)
    limit(Law.CONSTRAINT_RATE, columns["phi_dot_max"], PHI_DOT * size.speed, "m/s", m.phi_dot_norm)
    limit(Law.ORTHOGONALITY, columns["orthogonality_max"], ORTHOGONALITY, "", m.orthogonality)
    for name, drift in json.loads(columns["invariant_drifts"]).items():
        scale = size.of_unit(drift["unit"])
        start = abs(float(drift["start"]))
        allowed = INVARIANT * (start if math.isnan(scale) else max(scale, start))
        if allowed == 0.0:  # a unit without a scale, starting at zero: nothing to compare with
            continue
        away = m.invariants[name] - m.invariants[name][0]
        limit(Law.INVARIANT, float(drift["max"]), allowed, drift["unit"], away, name)
    if "position_error_judged_m" in columns:
        own = PREDICTABLE * size.length
        position, orientation = columns["position_error_judged_m"], columns["orientation_error_judged_rad"]
        limit(Law.POSITION, position, POSITION * size.length + own, "m", m.position_error)
        limit(Law.ORIENTATION, orientation, ORIENTATION + own / size.length, "rad", m.orientation_error)
    return out


def _first(t: Float[np.ndarray, " nt"], broken: np.ndarray) -> float:
    return float(t[np.argmax(broken)]) if np.any(broken) else math.nan
