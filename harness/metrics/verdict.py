"""Is a claimed success one? Limits on laws and on the error, each with its reason; all scale with the problem.

They are wide on purpose: a coarse step that is merely inaccurate stays a success with its error beside it; only what
is no longer the motion asked for is wrong. The benchmark's own limit (``energy_allowed_J``) is not judged here.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..types import Problem, Trajectory
from .scales import Scales
from .summary import PREDICTABLE

ENERGY = 0.10  # of T(0) + m g L: a tenth of all there is to exchange appears or disappears
INVARIANT = 0.10  # of its scale by unit (momentum: m v L), or of its start if that is larger
PHI = 0.01  # of the mechanism's size: the joint is visibly apart
PHI_DOT = 0.05  # of sqrt(2 E / m): velocities leave the joints by a twentieth of the typical speed
POSITION = 0.10  # of the mechanism's size, beyond the reference's own error, while the motion is predictable
ORIENTATION = (
    0.5  # [rad], about 30 deg: a fast spin may lag by tenths of a rad over hundreds of turns without being lost
)
ORTHOGONALITY = 1e-3  # |R^T R - 1|: such an R distorts lengths by as much
START = 1e-9  # [m], [m/s], relative to 1 + size: what the consistency check of problems allows


def doubts(problem: Problem, trajectory: Trajectory, columns: Mapping[str, Any], size: Scales) -> list[str]:
    """Why a claimed success is wrong, in words with numbers; empty if nothing contradicts it."""
    s = trajectory.states
    if not all(np.all(np.isfinite(a)) for a in (trajectory.t, s.r, s.R, s.v, s.Omega)):
        return ["the trajectory holds values that are not finite numbers"]
    out = []
    if abs(trajectory.t[-1] - problem.t_end) > 1e-9 * max(problem.t_end, 1.0):
        out.append(f"success claimed, but the last step ends at {trajectory.t[-1]:.9g} s of {problem.t_end:g} s")
    moved = max(float(np.max(np.abs(getattr(s, k)[0] - getattr(problem.initial, k)))) for k in ("r", "R", "v", "Omega"))
    if moved > START * (1.0 + size.length + size.speed) or trajectory.t[0] != 0.0:
        out.append(f"it does not begin at the start asked for (off by {moved:.3g}, at t = {trajectory.t[0]:g} s)")

    def limit(what: str, value: float, allowed: float, unit: str) -> None:
        if not math.isnan(value) and not value <= allowed:
            out.append(f"{what} reaches {value:.3g} {unit}, more than {allowed:.3g} {unit}")

    limit("the energy error", columns["energy_drift_max_J"], ENERGY * size.energy, "J")
    limit("|phi|", columns["phi_max"], PHI * size.length, "m")
    limit("|phi_dot|", columns["phi_dot_max"], PHI_DOT * size.speed, "m/s")
    limit("|R^T R - 1|", columns["orthogonality_max"], ORTHOGONALITY, "")
    for name, drift in json.loads(columns["invariant_drifts"]).items():
        scale = size.of_unit(drift["unit"])
        start = abs(float(drift["start"]))
        allowed = INVARIANT * (start if math.isnan(scale) else max(scale, start))
        if allowed == 0.0:  # a unit without a scale, starting at zero: nothing to compare with
            continue
        limit(f"the drift of {name}", float(drift["max"]), allowed, drift["unit"])
    if "position_error_judged_m" in columns:
        own = PREDICTABLE * size.length
        limit("the position error", columns["position_error_judged_m"], POSITION * size.length + own, "m")
        limit("the orientation error", columns["orientation_error_judged_rad"], ORIENTATION + own / size.length, "rad")
    return out
