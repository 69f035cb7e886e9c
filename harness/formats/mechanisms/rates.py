"""Find velocities of a start that closed loops allow: given rates are kept, and those given as 0 follow from them."""

import numpy as np
from jaxtyping import Bool, Float

from ...mechanics.consistency import START_TOLERANCE, project
from ...mechanics.jacobian import constraint_jacobian
from ...mechanics.motion import constraint
from ...mechanics.naming import name_joint
from ...mechanics.projection import find_arms
from ...mechanics.state import State, States
from ...mechanics.system import MultibodySystem

RANK = 1e-9  # tolerance for directions and points that must agree, in files printed with all digits
DIGITS = 1e-3  # relative error of velocities due to printed digits
# gap relative to the size: joints open by more at the start are an error, those open by less (float32) are closed
OPEN = 1e-4


def describe_open_joint(system: MultibodySystem, start: State) -> str:
    """Return a text that names the joint open widest at the start, with its gap [m or rad].

    It is empty unless the gap exceeds ``OPEN`` (relative), which is more than printed digits explain.
    """
    gaps = np.abs(constraint(system, States.one(start))[0])
    size = np.full(len(gaps), float(np.max(find_arms(system))))
    size[system.turning_rows] = 1.0
    if not np.any(gaps > OPEN * size):
        return ""
    row = int(np.argmax(gaps / size))
    name = name_joint(system, int(np.searchsorted(system.row_start, row, side="right")) - 1)
    return f"{name} is open at the start by {gaps[row]:.3g} {'rad' if row in system.turning_rows else 'm'}"


def complete_velocities(
    system: MultibodySystem,
    start: State,
    rows: Float[np.ndarray, "n dof"],
    rates: Float[np.ndarray, " n"],
    name: str = "rates",
    slack: float = 1e-6,
    held: Bool[np.ndarray, " n"] | None = None,
) -> State:
    """Return the start with velocities that all joints allow and that have the given rates; other rates are nearly 0.

    ``rows @ velocities`` are the rates of coordinates, with the velocities (v [m/s, space], Omega [rad/s, body]) of all
    bodies. Given are the ``rates`` that ``held`` marks or, without it, those that are not 0; the others are as near to
    0 as joints allow. Raise ValueError, with a message that begins with ``name``, if the joints do not allow the given
    ones to within ``slack`` times the largest.
    """
    from scipy.linalg import null_space

    free = null_space(constraint_jacobian(system, start).toarray(), rcond=RANK)  # columns: velocities that joints allow
    B, given = rows @ free, rates != 0.0 if held is None else held
    y = np.linalg.lstsq(B[given], rates[given], rcond=None)[0]
    if np.max(np.abs(B[given] @ y - rates[given])) > slack * np.max(np.abs(rates)):
        raise ValueError(f"{name}: the loops allow no such rates; give fewer, and 0 for the others")
    rest = null_space(B[given], rcond=RANK)
    y -= rest @ np.linalg.lstsq(B[~given] @ rest, B[~given] @ y, rcond=None)[0]
    x = (free @ y).reshape(-1, 6)
    return State(start.r, start.R, x[:, :3], x[:, 3:])


def keep_velocities(system: MultibodySystem, start: State, name: str) -> State:
    """Return the start with closed joints and its own velocities; a v or Omega of 0 is replaced by what joints require.

    Raise ValueError, with a message that begins with ``name``, if the joints do not allow these velocities to within
    printed digits.
    """
    out = project(system, start)
    given, found = (np.stack((s.v, s.Omega), axis=1) for s in (start, out))  # (nb, 2, 3): m/s and rad/s
    held = np.any(given != 0.0, axis=2)
    off = np.max(np.where(held[..., None], np.abs(found - given), 0.0), axis=(0, 2), initial=0.0)
    if np.all(off <= np.maximum(DIGITS * np.max(np.abs(given), axis=(0, 2), initial=0.0), START_TOLERANCE)):
        return out
    every, held = np.eye(6 * system.nb), np.repeat(held.ravel(), 3)
    return project(system, complete_velocities(system, out, every, given.ravel(), name, DIGITS, held))
