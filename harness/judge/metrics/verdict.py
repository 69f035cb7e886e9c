"""Judge a claimed success: limits on laws and on the distance from the reference, each breach with its reason.

A run that breaks a law is wrong. One that keeps them and is far from the reference is inaccurate: on a chaotic motion
that happens at every fixed accuracy. All limits scale with what the motion reaches (module ``scales``), and are wide on
purpose. The benchmark's own limit (``energy_allowed_J``) is not judged here.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ...mechanics.types import ACCURATE, Law, Problem, Reason, Trajectory
from .measure import JOINTS, MeasuredSeries, find_largest

INVARIANT = 0.10  # share of its scale by unit (momentum: m v L), or of its initial value if that is larger
UNITS = {Law.ENERGY: "J", Law.CONSTRAINT: "m", Law.CONSTRAINT_RATE: "m/s", Law.ORTHOGONALITY: ""}
KINEMATIC = 0.5  # share of the path beyond the exact motion's: three steps a turn give 0.3, reversed velocities 2
BETWEEN = 0.5  # share of the length scale, between steps: 20 steps of the fastest motions here are off by 0.01
RATE = 1.0  # share of the speed scale: velocities are off by more than the fastest there is
REACTION = 10.0  # multiple of the largest exact joint force or moment: another order of magnitude
START = 1e-9  # [m], [m/s], relative to 1 + size: what the consistency check of problems allows


def list_broken_laws(
    problem: Problem, trajectory: Trajectory, m: MeasuredSeries, columns: Mapping[str, Any]
) -> list[Reason]:
    """Return a reason for each law that a claimed success breaks, so that it is wrong; empty if it keeps all.

    ``m`` are the series measured, ``columns`` those of the record.
    """
    size = m.size
    s, t = trajectory.states, m.t
    values = [a.reshape(len(t), -1) for a in (t, s.r, s.R, s.v, s.Omega)]
    finite = np.isfinite(np.concatenate(values, axis=1)).all(axis=1)
    if not np.all(finite):
        return [Reason(Law.FINITE, time_s=_find_first_time(t, ~finite))]
    out = []
    if not abs(t[-1] - problem.t_end) <= 1e-9 * max(problem.t_end, 1.0):
        out.append(Reason(Law.END, float(t[-1]), problem.t_end, "s", float(t[-1])))
    moved = max(float(np.max(np.abs(getattr(s, k)[0] - getattr(problem.initial, k)))) for k in ("r", "R", "v", "Omega"))
    allowed = START * (1.0 + size.length + size.speed)
    if not moved <= allowed or t[0] != 0.0:
        out.append(Reason(Law.START, moved, allowed, time_s=float(t[0])))

    def limit(law: Law, most: float, allowed: float, unit: str, series: np.ndarray | None, name: str = "") -> None:
        """Append a reason to ``out`` if ``most`` exceeds ``allowed``, with the time when ``series`` first does."""
        if not math.isnan(most) and not most <= allowed:
            when = math.nan if series is None else _find_first_time(t, ~(np.abs(series) <= allowed))
            out.append(Reason(law, most, allowed, unit, when, name))

    for one in m.mechanisms:
        for law, series in one.laws.items():
            if not (problem.literal_start and law in JOINTS):
                limit(law, find_largest(series), one.size.limits[law], UNITS[law], series)
    limit(Law.KINEMATIC, m.kinematic_defect - m.kinematic_exact, KINEMATIC, "", None)
    limit(Law.REACTION, m.reaction_error, REACTION * (m.reaction_size + size.energy / size.length), "N", None)
    limit(Law.MOMENT, m.moment_error, REACTION * (m.moment_size + size.energy), "N m", None)
    accurate = not find_inaccuracy(m, columns)  # an inaccurate run's errors are known and reported as such
    for name, share in m.truncation.shares.items() if accurate else ():
        words = f"the error of {name}, beside what steps of this length leave open,"
        limit(Law.TRUNCATION, share, 1.0, "", None, words)
    for name, drift in json.loads(columns["invariant_drifts"]).items():
        scale = size.of_unit(drift["unit"])
        start = abs(float(drift["start"]))
        allowed = INVARIANT * (start if math.isnan(scale) else max(scale, start))
        if allowed == 0.0:  # a unit without a scale, starting at zero: nothing to compare with
            continue
        away = m.invariants[name] - m.invariants[name][0]
        limit(Law.INVARIANT, float(drift["max"]), allowed, drift["unit"], away, name)
    return out


def find_inaccuracy(m: MeasuredSeries, columns: Mapping[str, Any]) -> list[Reason]:
    """Return reasons why a motion that keeps all laws is inaccurate: its distance from the reference while predictable.

    Empty if it is accurate, or if there is no reference. ``m`` are the series measured, ``columns`` those of the
    record.
    """
    if m.motion_error is None or m.rate_error is None:
        return []
    length, own = m.size.length, columns.get("reference_own_error_judged_m", 0.0)
    out = []
    for law, most, allowed, unit, series in (
        (
            Law.MOTION,
            columns.get("motion_error_judged_m", math.nan),
            ACCURATE["accurate_until_s"] * length + own,
            "m",
            m.motion_error,
        ),
        (Law.VELOCITY, columns.get("rate_error_judged_m_per_s", math.nan), RATE * m.size.speed, "m/s", m.rate_error),
    ):
        if most > allowed:
            out.append(Reason(law, most, allowed, unit, _find_first_time(m.t, series > allowed)))
    if not out and m.motion_between > BETWEEN * length + own:
        out.append(Reason(Law.ROWS, m.motion_between, BETWEEN * length + own, "m", m.motion_between_s))
    return out


def _find_first_time(t: Float[np.ndarray, " nt"], broken: np.ndarray) -> float:
    """Return the first time [s] at which ``broken`` is true; NaN if it never is."""
    return float(t[np.argmax(broken)]) if np.any(broken) else math.nan
