"""Does a file hold the problem's motion? Its start against the exact one, velocities against differences of poses."""

from pathlib import Path

import numpy as np

from ..files import FileError
from ..types import Problem
from .columns import Quantities
from .conventions import ANGLES, LENGTHS, Reading
from .reading import Motion, Origin, differentiate, differentiate_rotations

DIGITS = 4.0  # times half a unit of the last digit: products of printed numbers
ROUNDED = 1e-9  # of 1 + the size: of data in float64
APART = 0.05  # of the largest: velocities against differences of poses
QUANTITIES = {  # name, unit, and the options that say how its columns are read
    "r": ("positions of the centre of mass", "m", ("length",)),
    "R": ("orientations", "", ("quaternion", "rotation", "euler", "angle")),
    "v": ("velocities of the centre of mass, in space,", "m/s", ("length",)),
    "Omega": ("angular velocities", "rad/s", ("omega", "angle")),
}  # fmt: skip


def check_motion(
    problem: Problem, found: Quantities, how: Reading, motion: Motion, path: Path, tolerance: float | None
) -> list[str]:
    """FileError where the file does not start as the problem does; notes on what is odd but may be the run's."""
    for name in QUANTITIES:
        if motion.origin[name] is Origin.FILE:
            _check_start(problem, found, how, motion, name, path, tolerance)
    notes = [f"not read: {', '.join(found.unread)}"] if found.unread else []
    if "E" in found.quantities and how.euler == "none" and not {"q", "R"} & found.quantities.keys():
        notes.append("not read: Euler angles; --euler gives the order of their axes")
    rates = {
        "v": lambda: differentiate(motion.t, motion.r),
        "Omega": lambda: None if motion.R is None else differentiate_rotations(motion.t, motion.R),
    }
    for name, differences in rates.items():
        if motion.origin[name] is Origin.FILE and (off := _share_apart(getattr(motion, name), differences())) > APART:
            words = f"{QUANTITIES[name][0]} are off by {100.0 * off:.3g} % from the rates of the poses in the file"
            notes.append(f"{words} ({_describe_options(how, name)})")
    return notes


def check_times(found: Quantities, seconds: float, path: Path) -> None:
    """FileError unless times increase; ``seconds``: of a unit of time in the file."""
    t = seconds * found.t
    if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0.0):
        bad = int(np.argmax(~(np.diff(t) > 0.0)))
        raise FileError(
            f"{path}: times must increase (rows {bad + 1} and {bad + 2} have t = {t[bad]:.9g} and {t[bad + 1]:.9g} s); "
            "write them with more digits"
        )


def _check_start(
    problem: Problem, found: Quantities, how: Reading, motion: Motion, name: str, path: Path, tolerance: float | None
) -> None:
    given, exact = getattr(motion, name)[0], getattr(problem.initial, name)
    gap = np.abs(given - exact).reshape(len(exact), -1)
    first = {k: np.max(a[0], axis=1, keepdims=True) for k, a in found.resolution.items()}
    angles = 2.0 * ANGLES[how.angle] * first.get("E", 0.0)  # about two axes each entry of R may turn
    turn = 2.0 * first["q"] if "q" in first else first.get("R", angles)
    printed = {
        "R": turn, "r": LENGTHS[how.length] * first["r"], "v": LENGTHS[how.length] * first.get("v", 0.0),
        "Omega": first.get("Omega", 0.0) + turn * (np.max(np.abs(exact)) if how.omega == "space" else 0.0),
    }[name]  # fmt: skip
    most = DIGITS * printed + ROUNDED * (1.0 + np.max(np.abs(exact))) if tolerance is None else tolerance
    allowed = np.broadcast_to(most, gap.shape)
    if np.all(gap <= allowed):
        return
    body = int(np.argmax(np.max(gap / allowed, axis=1)))
    words, unit, _ = QUANTITIES[name]
    raise FileError(
        f"{path}: it starts elsewhere: {words} of {problem.system.body_names[body]} differ by "
        f"{float(np.max(gap[body])):.3g}{' ' * bool(unit)}{unit} from the start of {problem.name}, expected at most "
        f"{float(np.max(allowed[body])):.2g}; check the columns and {_describe_options(how, name)}; "
        f"mbsbench export {problem.name} has the start"
    )


def _describe_options(how: Reading, name: str) -> str:
    """``--omega body, --angle rad``: how the columns were read."""
    return ", ".join(f"--{n} {getattr(how, n)}" for n in QUANTITIES[name][2])


def _share_apart(given: np.ndarray, exact: np.ndarray | None) -> float:
    """The largest difference of velocities over the largest of them; zero where it is not known."""
    if exact is None or not np.all(np.isfinite(given)):
        return 0.0
    inside = slice(2, -2)
    size = float(np.max(np.abs(exact[inside])))
    return float(np.max(np.abs(given - exact)[inside])) / size if size > 0.0 else 0.0
