"""Does a file hold the problem's motion? Its start against the exact one, velocities against differences of poses.

A quantity that does not fit is tried in other units, orders and frames; where one fits, the message names its options.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..files import FileError
from ..mechanics.state import State
from ..mechanics.system import MultibodySystem
from ..types import Problem
from .columns import Found
from .reading import (
    ANGLES,
    CHOICES,
    LENGTHS,
    TIMES,
    Motion,
    Origin,
    Reading,
    alternatives,
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
    "R": ("orientations", "", ("quaternion", "rotation", "euler", "angle")),
    "v": ("velocities", "m/s", ()),  # in the unit of positions, which fit before
    "Omega": ("angular velocities", "rad/s", ("omega", "angle")),
}  # fmt: skip


def check(
    problem: Problem, found: Found, how: Reading, motion: Motion, path: Path, tolerance: float | None
) -> list[str]:
    """FileError where the file is not of this problem, read in this way; notes on what is odd but may be the run's."""
    reading = how
    for name in ("r", "R", "v", "Omega"):
        if motion.origin[name] is Origin.FILE:
            reading = _fitting(problem, found, reading, name, path, tolerance)
    if reading != how:
        motion = read_motion(found, reading)
    notes = _unread(problem, found, reading, tolerance)
    if motion.origin["v"] is Origin.FILE:
        off = _apart(motion.v, derivative(motion.t, motion.r))
        notes += [_off("v", off)] if off > APART else []
    if motion.origin["Omega"] is Origin.FILE and (off := _turns(motion)) > APART:
        others = alternatives(reading, "omega", "angle", "rotation", "quaternion")
        fits = (other for other in others if _turns(read_motion(found, other)) < FITS
                and all(_fits(problem, found, other, name, tolerance) for name in ("R", "Omega")))  # fmt: skip
        if (other := next(fits, None)) is not None:
            reading = other
        else:
            notes.append(_off("Omega", off))
    if reading != how:
        options = " ".join(f"--{n} {c}" for n, c in vars(reading).items() if c != getattr(how, n))
        raise FileError(f"{path}: it is a motion of {problem.name} with {options}, not as it is read")
    return notes


def _unread(problem: Problem, found: Found, how: Reading, tolerance: float | None) -> list[str]:
    """Columns that nothing is taken from; Euler angles with the sequences in which they begin as the problem does."""
    notes = [f"not read: {', '.join(found.unread)}"] if found.unread else []
    if "E" not in found.quantities or how.euler != "none" or {"q", "R"} & found.quantities.keys():
        return notes
    others = (replace(how, euler=e, angle=a) for e in CHOICES["euler"][1:] for a in CHOICES["angle"])
    fit = [x for x in others if _fits(problem, found, x, "R", tolerance)]
    options = [f"--euler {x.euler}" + f" --angle {x.angle}" * (x.angle != how.angle) for x in fit]
    words = f"as {' or '.join(options)} they fit the start" if options else "no sequence known here fits the start"
    return [*notes, f"not read: Euler angles; {words}"]


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


def _fits(problem: Problem, found: Found, how: Reading, name: str, tolerance: float | None) -> bool:
    gap, allowed = _gap(problem.initial, found, how, name, tolerance)
    return bool(np.all(gap <= allowed))


def _fitting(problem: Problem, found: Found, how: Reading, name: str, path: Path, tolerance: float | None) -> Reading:
    """``how``, or the nearest reading in which the quantity begins as the problem does; FileError where none does."""
    words, unit, options = MEANINGS[name]
    for reading in (how, *alternatives(how, *options)):
        if _fits(problem, found, reading, name, tolerance):
            return reading
    gap, allowed = _gap(problem.initial, found, how, name, tolerance)
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
    first = {k: a[0] for k, a in found.resolution.items()}
    coarse = {k: np.max(a, axis=1, keepdims=True) for k, a in first.items()}
    angles = 2.0 * ANGLES[how.angle] * coarse.get("E", 0.0)  # about two axes each entry of R may turn
    turn = 2.0 * coarse["q"] if "q" in coarse else coarse.get("R", angles)
    printed = {
        "R": turn, "r": LENGTHS[how.length] * first["r"], "v": LENGTHS[how.length] * first.get("v", 0.0),
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


def _turns(motion: Motion) -> float:
    """How far angular velocities are from the rates of the orientations."""
    return _apart(motion.Omega, None if motion.R is None else turning(motion.t, motion.R))


def _apart(given: np.ndarray | None, exact: np.ndarray | None) -> float:
    """The largest difference of velocities, of the largest; zero where it is not known."""
    if exact is None or given is None or not np.all(np.isfinite(given)):
        return 0.0
    inside = slice(2, -2)
    size = float(np.max(np.abs(exact[inside])))
    return float(np.max(np.abs(given - exact)[inside])) / size if size > 0.0 else 0.0


def _off(name: str, share: float) -> str:
    return f"{MEANINGS[name][0]} are off by {100.0 * share:.3g} % from the rates of the poses in the file"
