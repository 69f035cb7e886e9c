"""Check the kinematics of a trajectory, r' = v and R' = R hat(Omega), from step to step, and interpolate between steps.

Laws that hold at each instant do not notice a body that stays where it is, or velocities with the wrong sign.
"""

import numpy as np
from jaxtyping import Float

from ...mechanics import so3
from ...mechanics.state import States
from ...mechanics.system import MultibodySystem
from .scales import load_compiled, measure_displacement, measure_speeds, split_into_blocks

TURN = 2.0 * np.pi


def measure_kinematic_defect(
    system: MultibodySystem, t: Float[np.ndarray, " nt"], s: States, least: float
) -> Float[np.ndarray, " nb"]:
    """Return by how much the poses and velocities of each body disagree, as a fraction of the length of its path.

    Each step advances a body by its mean velocity; the defect is the sum of the distances from there to the next pose,
    over the length of the path, by poses or by velocities, whichever is longer, plus ``least`` [m]. For a circle it is
    |sin x / x - cos x| with x half the angle of a step: 0.3 at three steps a turn. Reversed velocities give 2.
    """
    error, path, path_by_velocity = np.zeros((3, system.nb))
    for k in split_into_blocks(len(t) - 1, system.nb):
        a, b = s.at(k), s.at(slice(k.start + 1, k.stop + 1))
        h = np.diff(t[k.start : k.stop + 1])
        moved = _advance(h, a, b)
        error += np.sum(measure_displacement(system, moved, b), axis=0)
        path += np.sum(measure_displacement(system, a, b), axis=0)
        path_by_velocity += np.sum(h[:, None] * measure_speeds(system, moved), axis=0)
    return error / (np.maximum(path, path_by_velocity) + least)


def _advance(h: Float[np.ndarray, " n"], a: States, b: States) -> States:
    """Advance the poses of ``a`` over steps ``h`` [s], by the mean velocities of ``a`` and ``b`` at the ends of each.

    The states returned have the advanced poses and these mean velocities.
    """
    if (fast := load_compiled(len(a) * a.nb)) is not None:
        return fast.advance_steps(h, a, b)
    dt, v, Omega = h[:, None, None], 0.5 * (a.v + b.v), 0.5 * (a.Omega + b.Omega)
    return States(a.r + dt * v, a.R @ so3.exp(dt * Omega), v, Omega)


def is_motion(s: States) -> bool:
    """Return whether all numbers are finite and all det R positive, so that poses can be interpolated."""
    finite = all(np.all(np.isfinite(a)) for a in (s.r, s.R, s.v, s.Omega))
    if finite and (fast := load_compiled(len(s) * s.nb)) is not None:
        return fast.are_rotations(s.R)
    return finite and bool(np.all(np.linalg.det(s.R) > 0.0))


def interpolate_rows(t: Float[np.ndarray, " nt"], s: States, at: Float[np.ndarray, " n"]) -> States:
    """Interpolate poses at the times ``at`` [s] by Hermite cubics, of r and of the rotation vector from the row before.

    Velocities are not interpolated: they are those of the row before.
    """
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    a, b = s.at(k), s.at(k + 1)
    h = (t[k + 1] - t[k])[:, None, None]
    x = ((at - t[k])[:, None, None]) / h
    theta = _unwind_rotation(so3.log(np.swapaxes(a.R, -1, -2) @ b.R), 0.5 * h * (a.Omega + b.Omega))
    turn = _evaluate_cubic(x, h, theta, a.Omega, _compute_vector_rate(theta, b.Omega))
    return States(a.r + _evaluate_cubic(x, h, b.r - a.r, a.v, b.v), a.R @ so3.exp(turn), a.v, a.Omega)


def _evaluate_cubic(
    x: np.ndarray, h: np.ndarray, end: np.ndarray, begin_rate: np.ndarray, end_rate: np.ndarray
) -> np.ndarray:
    """Return the Hermite cubic at 0 <= x <= 1 that runs from 0 to ``end`` with these time derivatives at both ends.

    ``x`` is the time as a fraction of the step ``h`` [s].
    """
    return x**2 * (3.0 - 2.0 * x) * end + h * (x * (1.0 - x) ** 2 * begin_rate - x**2 * (1.0 - x) * end_rate)


def _unwind_rotation(theta: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return the rotation vector ``theta`` plus the whole turns about its axis that bring it nearest to ``expected``.

    Both are in rad, (..., 3); the axis of a zero rotation is that of ``expected``.
    """
    angle = np.linalg.norm(theta, axis=-1, keepdims=True)
    axis = np.where(angle > 0.0, theta / np.where(angle > 0.0, angle, 1.0), _normalise_vectors(expected))
    more = np.round((np.sum(expected * axis, axis=-1, keepdims=True) - angle) / TURN)
    return theta + TURN * more * axis


def _normalise_vectors(a: np.ndarray) -> np.ndarray:
    """Return vectors of length 1, zero where ``a`` is zero."""
    size = np.linalg.norm(a, axis=-1, keepdims=True)
    return a / np.where(size > 0.0, size, 1.0)


def _compute_vector_rate(theta: np.ndarray, Omega: np.ndarray) -> np.ndarray:
    """Return d theta/dt [rad/s] of the rotation vector theta of R exp(theta), R fixed, from Omega [rad/s], body frame.

    The last coefficient of the formula is undefined at zero and singular at whole turns: for tiny angles and beyond
    half a turn its limit at zero, 1/12, is used.
    """
    angle = np.linalg.norm(theta, axis=-1, keepdims=True)
    far = (angle > 1e-3) & (angle < np.pi)
    x = np.where(far, angle, 1.0)
    factor = np.where(far, 1.0 / x**2 - (1.0 + np.cos(x)) / (2.0 * x * np.sin(x)), 1.0 / 12.0)
    across = np.cross(theta, Omega)
    return Omega + 0.5 * across + factor * np.cross(theta, across)
