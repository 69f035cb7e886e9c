"""Does a file hold the problem's motion? Its start against the exact one, velocities against differences of poses.

A quantity that does not fit is tried in other units, orders and frames; where one fits, the message names its option.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..files import FileError
from ..mechanics.state import State
from ..mechanics.system import MultibodySystem
from ..types import Problem
from .columns import Found
from .reading import (
    LENGTHS,
    TIMES,
    Motion,
    Origin,
    Reading,
    alternatives,
    angular_velocities,
    derivative,
    first_row,
    read_motion,
    turning,
)  # fmt: skip

DIGITS = 4.0  # times half a unit of the last digit: products of printed numbers
ROUNDED = 1e-9  # of 1 + the size: of data in float64
APART, FITS = 0.05, 0.01  # of the largest: velocities against differences of poses
MEANINGS = {
    "r": ("positions", "m", ("length",)),
    "R": ("orientations", "", ("quaternion", "rotation")),
    "v": ("velocities", "m/s", ()),  # in the unit of positions, which fit before
    "Omega": ("angular velocities", "rad/s", ("omega", "angle")),
}  # fmt: skip


def check(
    problem: Problem, found: Found, how: Reading, motion: Motion, path: Path, tolerance: float | None
) -> list[str]:
    """FileError where the file is not of this problem, read in this way; notes on what is odd but may be the run's."""
    for name in ("r", "R", "v", "Omega"):
        if motion.origin[name] is Origin.FILE:
            _check_start(problem, found, how, name, path, tolerance)
    notes = []
    for name, differenced in (("v", lambda m: derivative(m.t, m.r)), ("Omega", _turning)):
        if motion.origin[name] is Origin.FILE and (note := _check_rate(found, how, motion, name, differenced, path)):
            notes.append(note)
    return notes


def check_times(problem: Problem, found: Found, how: Reading, path: Path) -> None:
    """FileError unless times increase, in seconds."""
    t = TIMES[how.time] * found.t
    if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0.0):
        bad = int(np.argmax(~(np.diff(t) > 0.0)))
        raise FileError(
            f"{path}: times must increase (rows {bad + 1} and {bad + 2} have t = {t[bad]:.9g} and {t[bad + 1]:.9g} s); "
            "write them with more digits"
        )
    for unit, seconds in TIMES.items():
        if unit != how.time and abs(t[-1] / TIMES[how.time] * seconds - problem.t_end) < 1e-6 * problem.t_end:
            raise FileError(
                f"{path}: it ends at t = {t[-1]:g} s, the problem at {problem.t_end:g} s: give --time {unit}"
            )


def _check_start(problem: Problem, found: Found, how: Reading, name: str, path: Path, tolerance: float | None) -> None:
    words, unit, options = MEANINGS[name]
    gap, allowed = _gap(problem.initial, found, how, name, tolerance)
    if np.all(gap <= allowed):
        return
    for said, other in alternatives(how, *options):
        off, fine = _gap(problem.initial, found, other, name, tolerance)
        if np.all(off <= fine):
            raise FileError(f"{path}: its {words} fit the start of {problem.name} with {said}, not as they are read")
    body = int(np.argmax(np.max((gap / allowed).reshape(problem.system.nb, -1), axis=1)))
    hint = ""
    if name == "r":
        hint = _other_point(problem.system, problem.initial, found, how, body)
    elif name == "v" and _in_body(problem.initial, found, how):
        hint = " (they are in the body frame; those of C are expected in space)"
    raise FileError(
        f"{path}: it starts elsewhere: {words} of {problem.system.body_names[body]} differ by "
        f"{float(np.max(gap[body])):.3g}{' ' * bool(unit)}{unit} from the start of {problem.name}, expected at most "
        f"{float(np.max(allowed[body])):.2g} by the digits printed{hint}; mbsbench export {problem.name} has the start"
    )


def _gap(start: State, found: Found, how: Reading, name: str, tolerance: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Difference to the start and what is allowed, both (nb, .)."""
    one = read_motion(first_row(found), how)
    given, exact = getattr(one, name)[0], getattr(start, name)
    gap = np.abs(given - exact).reshape(len(exact), -1)
    coarse = {k: np.max(a, axis=1, keepdims=True) for k, a in found.resolution.items()}
    turn = 2.0 * coarse["q"] if "q" in coarse else coarse.get("R", 0.0)
    printed = {
        "R": turn, "r": LENGTHS[how.length] * found.resolution["r"],
        "v": LENGTHS[how.length] * found.resolution.get("v", 0.0),
        "Omega": coarse.get("Omega", 0.0) + turn * (np.max(np.abs(exact)) if how.omega == "space" else 0.0),
    }[name]  # fmt: skip
    allowed = DIGITS * printed + ROUNDED * (1.0 + np.max(np.abs(exact))) if tolerance is None else tolerance
    return gap, np.broadcast_to(allowed, gap.shape)


def _other_point(system: MultibodySystem, start: State, found: Found, how: Reading, body: int) -> str:
    """Whether positions are those of a joint, not of C."""
    at = LENGTHS[how.length] * found.quantities["r"][0, body]
    for k, (i, j) in enumerate(zip(system.joint_i, system.joint_j, strict=True)):
        for end, arm in ((i, system.joint_s_i[k]), (j, system.joint_s_j[k])):
            if end == body and np.max(np.abs(start.r[body] + start.R[body] @ arm - at)) < 1e-6:
                return f" (they are those of {system.joint_names[k]}; positions are of the centre of mass)"
    return ""


def _in_body(start: State, found: Found, how: Reading) -> bool:
    given = LENGTHS[how.length] * found.quantities["v"][0]
    turned = np.einsum("bij,bj->bi", start.R, given)
    return float(np.max(np.abs(turned - start.v))) < 1e-6 * (1.0 + float(np.max(np.abs(start.v))))


def _turning(motion: Motion) -> np.ndarray | None:
    return None if motion.R is None else turning(motion.t, motion.R)


def _check_rate(
    found: Found,
    how: Reading,
    motion: Motion,
    name: str,
    differenced: Callable[[Motion], np.ndarray | None],
    path: Path,
) -> str:
    """FileError where another reading makes the velocities the derivatives of the poses; a note where none does."""
    given, exact = getattr(motion, name), differenced(motion)
    if exact is None or given is None or not np.all(np.isfinite(given)):
        return ""
    inside = slice(2, -2)
    size = float(np.max(np.abs(exact[inside])))

    def apart(values: np.ndarray) -> float:
        return float(np.max(np.abs(values - exact)[inside])) / size if size > 0.0 else 0.0

    share = apart(given)
    if share <= APART:
        return ""
    words, _, options = MEANINGS[name]
    if name == "Omega":
        for said, other in alternatives(how, *options):
            tried = angular_velocities(found, other, motion.R)
            if tried is not None and apart(tried) < FITS:
                raise FileError(
                    f"{path}: its {words} are the rates of its orientations with {said}, not as they are read"
                )
    return f"{words} are off by {100.0 * share:.3g} % from the rates of the poses in the file"
