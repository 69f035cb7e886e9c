"""Whether another reading of a file follows the exact motion where the one asked for does not."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from ..mechanics import so3
from ..reference.computation import reference_of
from ..types import Problem
from .columns import Quantities
from .conventions import CHOICES, Reading
from .reading import Motion, Origin, read_motion
from .rows import begin_at_start

OFF = 1e-2  # [rad], or of the largest angular velocity: closer motions are read as they are meant
BETTER = 1e-2  # of what the reading asked for is off
MOST = 400  # rows that are compared


def suggest_reading(problem: Problem, found: Quantities, how: Reading, motion: Motion) -> list[str]:
    """Return a note on the reading, other in one option, that follows the exact motion; none if none does.

    A start of no rotation looks the same transposed, in either frame, and about axes that turn or stay.
    """
    reference = reference_of(problem)
    if reference is None:
        return []
    rows = np.flatnonzero((motion.t >= 0.0) & (motion.t <= reference.horizon))
    rows = rows[:: max(len(rows) // MOST, 1)]
    if not len(rows):
        return []
    exact = reference.states(motion.t[rows])
    before = _measure_off(motion, exact.R, exact.Omega, rows)
    if not before > OFF:
        return []
    tried = [(_measure_off(begin_at_start(problem, read_motion(found, other)), exact.R, exact.Omega, rows), words)
             for words, other in _list_others(found, how)]  # fmt: skip
    after, words = min(tried, default=(np.inf, ""))
    if not after < BETTER * before:
        return []
    numbers = f"rotations are off by {after:.2g} rad, as read by {before:.2g}"
    return [f"with {words} it would follow the exact motion: {numbers}"]


def _measure_off(motion: Motion, R: np.ndarray, Omega: np.ndarray, rows: np.ndarray) -> float:
    """Return the largest angle [rad] from the exact rotations, or share from their rates; NaN where none is known."""
    off = []
    if motion.R is not None:
        off.append(np.max(so3.angle_between(motion.R[rows], R)))
    if motion.Omega is not None and motion.origin["Omega"] is Origin.FILE:
        off.append(np.max(np.abs(motion.Omega[rows] - Omega)) / max(float(np.max(np.abs(Omega))), 1e-300))
    return float(np.max(off)) if off else np.nan


def _list_others(found: Quantities, how: Reading) -> Iterator[tuple[str, Reading]]:
    """Yield readings that differ in one option on rotations, with the option."""
    names = [n for n, key in (("rotation", ""), ("omega", "Omega"), ("euler", "E"), ("quaternion", "q"))
             if not key or key in found.quantities]  # fmt: skip
    for name in names:
        for value in CHOICES[name]:
            if value not in (getattr(how, name), "none"):
                yield f"--{name} {value}", dataclasses.replace(how, **{name: value})
