"""Handle unusual rows of a file: a time that occurs twice at an event, gaps, a first row just after the start."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np

from ...base.files import FileError
from ...mechanics.dynamics import accelerations
from ...mechanics.types import Problem
from .columns import Quantities
from .conventions import UNSAID, Reading
from .reading import FEWEST, Motion

GAPS = 0.05  # largest fraction of rows without numbers that are left out; with more, none is
EVENTS = 0.1  # largest fraction of rows that may repeat a time; more indicate times with too few digits
LATE = 1.5  # relative to the spacing: a first row up to this time means that the start was not written


def clean_rows(found: Quantities, conventions: Reading, path: Path) -> Quantities:
    """Return the quantities without rows that are no numbers, and of two rows at one time only the later; add notes.

    ``conventions`` has the unit of time. Raise FileError if times decrease, or if rows at one time differ or are too
    many to be events.
    """
    found = _remove_gaps(found)
    t = found.factor("t", conventions) * found.t
    twice = np.flatnonzero(np.diff(t) == 0.0)
    apart = _rows_differ(found, twice)
    if np.any(np.diff(t) < 0.0) or not np.all(np.isfinite(t)) or np.any(apart) or len(twice) > EVENTS * len(t):
        bad = int(twice[apart][0]) if np.any(apart) else int(np.argmax(~(np.diff(t) > 0.0)))
        same = "; the rows differ, so that it is no event" if np.any(apart) else ""
        raise FileError(
            f"{path}: times must increase (rows {bad + 1} and {bad + 2} have t = {t[bad]:.9g} and {t[bad + 1]:.9g} s)"
            f"{same}; write times with more digits"
        )
    if not len(twice):
        return found
    words = f"times of {len(twice)} rows are those of the row before, as at events (first t = {t[twice[0]]:.6g} s)"
    return _select_rows(found, np.delete(np.arange(len(t)), twice), f"{words}: the later rows were read")


def _rows_differ(found: Quantities, twice: np.ndarray) -> np.ndarray:
    """Return, for each row number in ``twice``, whether its pose differs from that of the next row.

    Differences within the printed digits do not count.
    """
    out = np.zeros(len(twice), dtype=bool)
    for name in found.quantities.keys() & {"r", "q", "R", "E"}:
        a, coarse = found.quantities[name], found.resolution[name]
        gap = np.abs(a[twice + 1] - a[twice]) > 2.0 * np.maximum(coarse[twice], coarse[twice + 1]) + 1e-9
        out |= gap.reshape(len(twice), int(np.prod(a.shape[1:]))).any(axis=1)
    return out


def _remove_gaps(found: Quantities) -> Quantities:
    """Return the quantities without rows of non-numbers that numbers follow; rows at the end stay: the run diverged.

    All stay if they are more than the fraction ``GAPS`` of the rows, or if the first is among them: the start is
    needed.
    """
    finite = np.isfinite(found.t)
    for a in found.quantities.values():
        finite &= np.isfinite(a).reshape(len(a), -1).all(axis=1)
    known = np.flatnonzero(finite)
    gaps = np.flatnonzero(~finite[: known[-1] + 1]) if len(known) else known
    if not len(gaps) or len(gaps) > GAPS * len(finite) or gaps[0] == 0:
        return found
    words = (
        f"{len(gaps)} rows that are no numbers were left out (the first: row {gaps[0] + 1}); nothing is judged there"
    )
    return _select_rows(found, np.delete(np.arange(len(finite)), gaps), words)


def _select_rows(found: Quantities, rows: np.ndarray, note: str) -> Quantities:
    """Return the quantities at these rows alone, with one more note."""
    parts: dict[str, Any] = {
        name: {k: a[rows] for k, a in getattr(found, name).items()} for name in ("quantities", "resolution")
    }
    return dataclasses.replace(found, t=found.t[rows], **parts, notes=(*found.notes, note))


def lacks_only_start(t: np.ndarray) -> bool:
    """Return whether a file lacks only the start: its first row is about one spacing after t = 0."""
    return len(t) >= FEWEST and bool(0.0 < t[0] <= LATE * float(np.median(np.diff(t))))


def begin_at_start(problem: Problem, motion: Motion) -> Motion:
    """Return the motion with the problem's start put before a late first row; other motions are returned unchanged."""
    if not lacks_only_start(motion.t):
        return motion
    start = problem.initial
    parts: dict[str, Any] = {
        k: a if (a := getattr(motion, k)) is None else np.concatenate((getattr(start, k)[None], a))
        for k in ("r", "R", "v", "Omega")
    }
    return dataclasses.replace(motion, t=np.concatenate(([0.0], motion.t)), **parts)


def bound_travel(problem: Problem, t: float) -> dict[str, float]:
    """Return a bound on how far each quantity may be from the start at ``t`` [s], in SI units.

    It is twice what the velocities and accelerations at the start give, and 0 at the start.
    """
    if t <= 0.0:
        return dict.fromkeys(("r", "R", "v", "Omega"), 0.0)
    start = problem.initial
    rates = accelerations(problem.system, start)
    a, alpha = (float(np.max(np.abs(x))) for x in (rates.v_dot, rates.Omega_dot))
    v, omega = float(np.max(np.abs(start.v))), float(np.max(np.abs(start.Omega)))
    return {"r": 2.0 * t * (v + a * t), "R": 2.0 * t * (omega + alpha * t), "v": 2.0 * t * a, "Omega": 2.0 * t * alpha}


def check_euler_order(found: Quantities, conventions: Reading, path: Path) -> None:
    """Raise FileError if the order of axes of Euler angles is unknown, or contradicts the names of their columns.

    ``conventions`` has the order that the user gave, which is needed only if the file gives orientations in no other
    way. Columns named roll, pitch and yaw turn about x, y and z: their order in the file must be that order of axes.
    """
    if conventions.euler == UNSAID and "E" in found.quantities and not {"q", "R"} & found.quantities.keys():
        remedy = (
            "--euler gives their axes in the order of the columns (ZXZ, ZYX and others; small letters: fixed in "
            "space), --euler none leaves them out"
        )
        raise FileError(f"{path}: its orientations are Euler angles: {remedy}")
    if not conventions.reads_euler or not {*found.angles} <= {"roll", "pitch", "yaw"} or not found.angles:
        return
    letters = {"roll": "x", "pitch": "y", "yaw": "z"}
    named_order = "".join(letters[k] for k in found.angles)
    if conventions.euler.lower() != named_order:
        both = f"{named_order} or {named_order.upper()}"
        raise FileError(
            f"{path}: its columns are {', '.join(found.angles)}, in this order, about {', '.join(named_order)}: "
            f"give --euler {both} (got {conventions.euler})"
        )


def check_units(found: Quantities, conventions: Reading, path: Path) -> None:
    """Raise FileError if an option in ``conventions`` contradicts a unit that the file gives."""
    for name, option in (("t", "time"), ("r", "length"), ("v", "length"), ("E", "angle"), ("Omega", "angle")):
        asked, unit = getattr(conventions, option), found.units.get(name, "")
        spelt = re.split(r"[\W\d]", unit.replace("°", "deg"))[0]
        if unit and asked != getattr(Reading(), option) and spelt != asked and not (asked == "deg" and "deg" in spelt):
            raise FileError(f"{path}: its header has the unit {unit!r}; leave --{option} {asked} out")


def describe_norms(found: Quantities) -> list[str]:
    """Return a note, in a list, if norms of quaternions differ from 1 by more than their digits; else an empty list."""
    if "q" not in found.quantities:
        return []
    size = np.linalg.norm(found.quantities["q"], axis=-1)
    size, coarse = size[np.isfinite(size)], 8.0 * float(np.max(found.resolution["q"], initial=0.0))
    if not len(size) or np.max(np.abs(size - 1.0)) <= 1e-6 + coarse:
        return []
    return [
        f"quaternions have norms of {np.min(size):.6g} to {np.max(size):.6g}: their directions were judged, their "
        "norms are no rotations'"
    ]


def describe_late_rows(t: np.ndarray, t_end: float) -> list[str]:
    """Return a note, in a list, on rows after ``t_end`` [s], which are not judged; else an empty list."""
    more = t[t > t_end * (1.0 + 1e-6)]
    return [f"not judged: rows behind t = {t_end:g} s ({len(more)}, to {more[-1]:.6g} s)"] if len(more) else []
