"""Judge how far a motion is from the true one, or from another, by one distance of two poses of a mechanism.

A run that keeps all laws and is far from the reference is inaccurate: on a chaotic motion that happens at every fixed
accuracy. How far is far stands in ``mechanics.types.verdicts``, which pages read, too.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ..columns.measured import MeasuredSeries
from ..mechanics import so3
from ..mechanics.state import State, States
from ..mechanics.types import ACCURATE, Law, Reason

RESOLVED = 3.0  # multiple of the stated error of a reference below which it tells no errors apart
# share of the length scale, between steps: 20 steps of the fastest motions here are off by 0.01. Of the 813 claimed
# successes of the suites ``first`` and ``paper`` 38 are above it; half: 73; twice: 7.
BETWEEN = 0.5
RATE = 1.0  # share of the speed scale: off by more than the fastest there is. Above it: 17; half: 66; twice: 5
GAP = 1e-8  # [m] in the metric of a shadow: a motion with larger gaps is not a true one
LEVEL = 0.05  # probability of finding a difference in a perfect solver's cloud by any of its tests
Poses = tuple[np.ndarray, np.ndarray]  # r [m] and R of all bodies


def measure_distance(
    a: State | States | Poses, b: State | States | Poses, arm: float | Float[np.ndarray, " nb"]
) -> Float[np.ndarray, " *batch"]:
    """Return the largest distance of any body between two poses [m]: that of C, or ``arm`` [m] times the angle.

    ``arm`` is the radius of gyration of each body or, where bodies are not known, the size of the mechanism. Poses at
    several times give one distance per time. The distance is NaN if a number of the poses is.
    """
    (r_a, R_a), (r_b, R_b) = (x if isinstance(x, tuple) else (x.r, x.R) for x in (a, b))
    return np.max(np.maximum(np.linalg.norm(r_a - r_b, axis=-1), arm * so3.angle_between(R_a, R_b)), axis=-1)


def find_inaccuracy(m: MeasuredSeries, columns: Mapping[str, Any]) -> list[Reason]:
    """Return reasons why a motion that keeps all laws is inaccurate: errors against the reference while predictable.

    They are errors of poses or velocities at the recorded steps or, if both are small, of poses between these steps.
    Empty if the motion is accurate, or if there is no reference. ``m`` are the measured series, ``columns`` the columns
    of the run's record by name.
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
            out.append(Reason(law, most, allowed, unit, find_first_time(m.t, series > allowed)))
    if not out and m.motion_between > BETWEEN * length + own:
        out.append(Reason(Law.ROWS, m.motion_between, BETWEEN * length + own, "m", m.motion_between_s))
    return out


def find_first_time(t: Float[np.ndarray, " nt"], broken: np.ndarray) -> float:
    """Return the first time [s] at which ``broken`` is true; NaN if it never is."""
    return float(t[np.argmax(broken)]) if np.any(broken) else math.nan


def find_significant_tests(tests: Sequence[tuple[float, str]]) -> list[str]:
    """Return the names of the tests that find a significant difference between two ensembles, each name once.

    ``tests`` are pairs of a p-value and a name. By Bonferroni's correction, each test has the level ``LEVEL`` over the
    number of tests.
    """
    return list(dict.fromkeys(name for p, name in tests if p * len(tests) < LEVEL))
