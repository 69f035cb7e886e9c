"""Check that a file holds the problem's motion: its start, and its velocities against differences of its poses."""

from pathlib import Path

import numpy as np

from ...base.files import FileError
from ...mechanics.naming import name_body
from ...mechanics.types import Problem
from .columns import Quantities
from .conventions import Reading
from .reading import ROUNDING, Motion, Origin, differentiate, differentiate_rotations
from .rows import bound_travel, describe_late_rows, describe_norms, lacks_only_start

SMALL = 1e-4  # relative to the size: for a start that is off by less, the message offers --start-tolerance
DIGITS = 4.0  # allowed difference in half units of the last digit, since values are products of printed numbers
ROUNDED = 1e-9  # allowed difference relative to 1 + the size, for data in float64
MOST = 20  # most names of columns in a note
APART = 0.05  # difference of a velocity from that of the poses, relative to the largest, that causes a note
QUANTITIES = {  # name, unit, and the options for reading its columns
    "r": ("positions of the centre of mass", "m", ("length",)),
    "R": ("orientations", "", ("quaternion", "rotation", "euler", "angle")),
    "v": ("velocities of the centre of mass, in space,", "m/s", ("length",)),
    "Omega": ("angular velocities", "rad/s", ("omega", "angle")),
}


def check_motion(
    problem: Problem, found: Quantities, how: Reading, motion: Motion, path: Path, tolerance: float | None
) -> list[str]:
    """Return notes on oddities of a file; raise FileError unless it starts as the problem does.

    ``found`` are the file's columns, ``how`` the units and frames by which they were read, ``motion`` the result.
    ``tolerance`` is the allowed difference of the start in SI units; None allows what the printed digits leave open.
    Notes are on columns that are not read, a late first row, rows after the end, norms of quaternions, and velocities
    that contradict the poses.
    """
    if motion.t[0] > 0.0 and not lacks_only_start(motion.t):
        raise FileError(
            f"{path}: its first row is at t = {motion.t[0]:.9g} s and must be the start, t = 0; "
            f"mbsbench export {problem.name} prints it"
        )
    for name in QUANTITIES:
        if motion.origin[name] is Origin.FILE:
            _check_start(problem, found, how, motion, name, path, tolerance)
    more = f" and {len(found.unread) - MOST} more" if len(found.unread) > MOST else ""
    notes = [*found.notes, f"not read: {', '.join(found.unread[:MOST])}{more}"] if found.unread else [*found.notes]
    notes += describe_norms(found) + describe_late_rows(motion.t, problem.t_end)
    if motion.t[0] > 0.0:
        notes.append(f"its first row is at t = {motion.t[0]:.6g} s: the start of {problem.name} was put before it")
    if "E" in found.quantities and not how.reads_euler and not {"q", "R"} & found.quantities.keys():
        notes.append("not read: Euler angles; --euler gives the order of their axes")
    rates = {
        "v": lambda: differentiate(motion.t, motion.r),
        "Omega": lambda: None if motion.R is None else differentiate_rotations(motion.t, motion.R),
    }
    spacing = float(np.min(np.diff(motion.t), initial=np.inf))
    rounding = {"v": ROUNDING * float(np.max(np.abs(motion.r))) / spacing, "Omega": ROUNDING / spacing}
    for name, differences in rates.items():
        if motion.origin[name] is not Origin.FILE:
            continue
        if (off := _measure_rate_error(getattr(motion, name), differences(), rounding[name])) > APART:
            words = f"{QUANTITIES[name][0]} are off by {100.0 * off:.3g} % from the rates of the poses in the file"
            notes.append(f"{words} ({_describe_options(how, name)})")
    return notes


def _check_start(
    problem: Problem, found: Quantities, how: Reading, motion: Motion, name: str, path: Path, tolerance: float | None
) -> None:
    """Raise FileError, with a remedy, unless the quantity ``name`` (r, R, v, Omega) of the first row is the start's.

    The difference may be ``tolerance`` [SI] or, if that is None, what the printed digits leave open, plus what the
    motion travels until a late first row.
    """
    given, exact = getattr(motion, name)[0], getattr(problem.initial, name)
    gap = np.abs(given - exact).reshape(len(exact), -1)
    first = {k: np.max(a[0], axis=1, keepdims=True) for k, a in found.resolution.items()}
    # from the digits of each column those of r, R, v and Omega: an entry of R may change by rotations about two axes
    angles = 2.0 * found.factor("E", how) * first.get("E", 0.0)
    of_rotation = 2.0 * first["q"] if "q" in first else first.get("R", angles)
    # Omega in space is turned to the body by R
    of_frame = of_rotation * np.max(np.abs(exact)) if how.omega == "space" else 0.0
    printed = {
        "R": of_rotation,
        "r": found.factor("r", how) * first["r"],
        "v": found.factor("v", how) * first.get("v", 0.0),
        "Omega": found.factor("Omega", how) * first.get("Omega", 0.0) + of_frame,
    }[name]
    most = DIGITS * printed + ROUNDED * (1.0 + np.max(np.abs(exact))) if tolerance is None else tolerance
    allowed = np.broadcast_to(most + bound_travel(problem, float(motion.t[0]))[name], gap.shape)
    if np.all(gap <= allowed):
        return
    body = int(np.argmax(np.max(gap / allowed, axis=1)))
    words, unit, _ = QUANTITIES[name]
    raise FileError(
        f"{path}: its start is not that of the problem: {words} of {name_body(problem.system, body)} differ by "
        f"{float(np.max(gap[body])):.3g}{' ' * bool(unit)}{unit} from the start of {problem.name}, expected at most "
        f"{float(np.max(allowed[body])):.2g}; check the columns and {_describe_options(how, name)}; "
        f"mbsbench export {problem.name} prints the start"
        + (
            f"; --start-tolerance {_round_up(gap[body])} takes it as it is"
            if np.max(gap) < SMALL * _find_scale(exact)
            else ""
        )
    )


def _find_scale(exact: np.ndarray) -> float:
    """Return the largest magnitude of the values, but at least 1."""
    return max(1.0, float(np.max(np.abs(exact))))


def _round_up(gap: np.ndarray) -> str:
    """Return the largest of ``gap``, rounded up to one digit, as text."""
    largest = float(np.max(gap))
    power = 10.0 ** np.floor(np.log10(largest))
    return f"{np.ceil(largest / power) * power:.1g}"


def _describe_options(how: Reading, name: str) -> str:
    """Return the options by which the columns of quantity ``name`` were read, such as ``--omega body, --angle rad``."""
    return ", ".join(f"--{n} {getattr(how, n)}" for n in QUANTITIES[name][2])


def _measure_rate_error(given: np.ndarray, exact: np.ndarray | None, least: float) -> float:
    """Return the largest difference of ``given`` velocities from the rates of the poses, ``exact``, relative to these.

    It is 0 if the rates are unknown or no larger than ``least``, their rounding, or if a velocity is not finite. Two
    rows at either end do not count.
    """
    if exact is None or not np.all(np.isfinite(given)):
        return 0.0
    inside = slice(2, -2)
    size = float(np.max(np.abs(exact[inside])))
    return float(np.max(np.abs(given - exact)[inside])) / size if size > least else 0.0
