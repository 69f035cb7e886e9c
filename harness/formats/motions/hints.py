"""Find whether another reading of a file follows the exact motion where the requested one does not."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from ...mechanics import so3
from ...mechanics.types import Problem
from ...reference.computation import find_reference
from .columns import Quantities
from .conventions import CHOICES, Reading
from .reading import Motion, Origin, read_motion
from .rows import begin_at_start

OFF = 1e-2  # [rad], or relative to the largest angular velocity: closer motions count as read as intended
BETTER = 1e-2  # largest difference of a suggested reading, as a fraction of that of the requested one
MOST = 400  # most rows that are compared, within a factor of two


def suggest_reading(problem: Problem, found: Quantities, how: Reading, motion: Motion) -> list[str]:
    """Return a note if a reading that differs in one option follows the exact motion and the requested one does not.

    It is in a list, which is empty without such a reading. The check of the start cannot find these: a start without
    rotation looks the same transposed, in either frame, and about axes that turn with the body or are fixed.
    """
    reference = find_reference(problem)
    if reference is None:
        return []
    rows = np.flatnonzero((motion.t >= 0.0) & (motion.t <= reference.horizon))
    rows = rows[:: max(len(rows) // MOST, 1)]
    if not len(rows):
        return []
    exact = reference.states(motion.t[rows])
    before = _measure_rotation_error(motion, exact.R, exact.Omega, rows)
    if not before > OFF:
        return []
    tried = [
        (_measure_rotation_error(begin_at_start(problem, read_motion(found, other)), exact.R, exact.Omega, rows), words)
        for words, other in _list_other_readings(found, how)
    ]
    after, words = min(tried, default=(np.inf, ""))
    if not after < BETTER * before:
        return []
    numbers = f"rotations are off by {after:.2g} rad, as read by {before:.2g}"
    return [f"with {words} it would follow the exact motion: {numbers}"]


def _measure_rotation_error(motion: Motion, R: np.ndarray, Omega: np.ndarray, rows: np.ndarray) -> float:
    """Return how far a motion is from exact rotations ``R`` and angular velocities ``Omega``, those at ``rows``.

    It is the larger of the angle [rad] and the relative difference of angular velocities; NaN if the file has neither.
    """
    off = []
    if motion.R is not None:
        off.append(np.max(so3.angle_between(motion.R[rows], R)))
    if motion.Omega is not None and motion.origin["Omega"] is Origin.FILE:
        off.append(np.max(np.abs(motion.Omega[rows] - Omega)) / max(float(np.max(np.abs(Omega))), 1e-300))
    return float(np.max(off)) if off else np.nan


def _list_other_readings(found: Quantities, how: Reading) -> Iterator[tuple[str, Reading]]:
    """Yield readings that differ from ``how`` in one option on rotations, each as (option in words, reading)."""
    names = [
        n
        for n, key in (("rotation", ""), ("omega", "Omega"), ("euler", "E"), ("quaternion", "q"))
        if not key or key in found.quantities
    ]
    for name in names:
        for value in CHOICES[name]:
            if value not in (getattr(how, name), "none"):
                yield f"--{name} {value}", dataclasses.replace(how, **{name: value})
