"""Does a file hold the problem's motion? Its start against the exact one, velocities against differences of poses."""

from pathlib import Path

import numpy as np

from ..files import FileError
from ..types import Problem
from .columns import Quantities
from .conventions import Reading
from .reading import ROUNDING, Motion, Origin, differentiate, differentiate_rotations
from .rows import describe_rest, is_late, reach_until, say_norms

SMALL = 1e-4  # of the size: a start that is off by less may be meant
DIGITS = 4.0  # times half a unit of the last digit: products of printed numbers
ROUNDED = 1e-9  # of 1 + the size: of data in float64
MOST = 20  # names of columns in a note
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
    if motion.t[0] > 0.0 and not is_late(motion.t):
        raise FileError(f"{path}: its first row is at t = {motion.t[0]:.9g} s and must be the start, t = 0; "
                        f"mbsbench export {problem.name} has it")  # fmt: skip
    for name in QUANTITIES:
        if motion.origin[name] is Origin.FILE:
            _check_start(problem, found, how, motion, name, path, tolerance)
    more = f" and {len(found.unread) - MOST} more" if len(found.unread) > MOST else ""
    notes = [*found.notes, f"not read: {', '.join(found.unread[:MOST])}{more}"] if found.unread else [*found.notes]
    notes += say_norms(found) + describe_rest(motion.t, problem.t_end)
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
        if (off := _share_apart(getattr(motion, name), differences(), rounding[name])) > APART:
            words = f"{QUANTITIES[name][0]} are off by {100.0 * off:.3g} % from the rates of the poses in the file"
            notes.append(f"{words} ({_describe_options(how, name)})")
    return notes


def _check_start(
    problem: Problem, found: Quantities, how: Reading, motion: Motion, name: str, path: Path, tolerance: float | None
) -> None:
    given, exact = getattr(motion, name)[0], getattr(problem.initial, name)
    gap = np.abs(given - exact).reshape(len(exact), -1)
    first = {k: np.max(a[0], axis=1, keepdims=True) for k, a in found.resolution.items()}
    angles = 2.0 * found.factor("E", how) * first.get("E", 0.0)  # about two axes each entry of R may turn
    turn = 2.0 * first["q"] if "q" in first else first.get("R", angles)
    turned = turn * np.max(np.abs(exact)) if how.omega == "space" else 0.0
    printed = {
        "R": turn, "r": found.factor("r", how) * first["r"], "v": found.factor("v", how) * first.get("v", 0.0),
        "Omega": found.factor("Omega", how) * first.get("Omega", 0.0) + turned,
    }[name]  # fmt: skip
    most = DIGITS * printed + ROUNDED * (1.0 + np.max(np.abs(exact))) if tolerance is None else tolerance
    allowed = np.broadcast_to(most + reach_until(problem, float(motion.t[0]))[name], gap.shape)
    if np.all(gap <= allowed):
        return
    body = int(np.argmax(np.max(gap / allowed, axis=1)))
    words, unit, _ = QUANTITIES[name]
    raise FileError(
        f"{path}: it starts elsewhere: {words} of {problem.system.body_names[body]} differ by "
        f"{float(np.max(gap[body])):.3g}{' ' * bool(unit)}{unit} from the start of {problem.name}, expected at most "
        f"{float(np.max(allowed[body])):.2g}; check the columns and {_describe_options(how, name)}; "
        f"mbsbench export {problem.name} has the start"
        + (
            f"; --start-tolerance {_round_up(gap[body])} takes it as it is"
            if np.max(gap) < SMALL * _size(exact)
            else ""
        )
    )


def _size(exact: np.ndarray) -> float:
    return max(1.0, float(np.max(np.abs(exact))))


def _round_up(gap: np.ndarray) -> str:
    """The largest of ``gap``, rounded up to one digit."""
    largest = float(np.max(gap))
    power = 10.0 ** np.floor(np.log10(largest))
    return f"{np.ceil(largest / power) * power:.1g}"


def _describe_options(how: Reading, name: str) -> str:
    """``--omega body, --angle rad``: how the columns were read."""
    return ", ".join(f"--{n} {getattr(how, n)}" for n in QUANTITIES[name][2])


def _share_apart(given: np.ndarray, exact: np.ndarray | None, least: float) -> float:
    """The largest difference of velocities over the largest of them; zero where it is not known, or all rounding."""
    if exact is None or not np.all(np.isfinite(given)):
        return 0.0
    inside = slice(2, -2)
    size = float(np.max(np.abs(exact[inside])))
    return float(np.max(np.abs(given - exact)[inside])) / size if size > least else 0.0
