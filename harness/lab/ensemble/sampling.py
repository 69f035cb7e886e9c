"""Evaluate a computed motion at given times: at its own steps, or between them by a Hermite polynomial over four."""

import numpy as np
from jaxtyping import Float
from scipy.interpolate import KroghInterpolator

from ...mechanics import so3
from ...mechanics.state import State, States

SAME = 1e-9  # relative to 1 s or t: steps nearer than this are taken to be at t
NODES = 4  # steps with values and rates: polynomial of degree 7


def interpolate_state(s: States, t: float) -> State:
    """Return the state at ``t`` [s]: that of a step at the same time, else interpolated over ``NODES`` steps.

    Rotations are interpolated as rotation vectors from the nearest step. Raise ValueError beyond the last step.
    """
    times, near = s.times, SAME * max(1.0, t)
    k = int(np.argmin(np.abs(times - t)))
    if abs(times[k] - t) <= near:
        return s[k]
    if t > times[-1]:
        raise ValueError(f"ends at t = {times[-1]:g} s, before {t:g} s")
    first = int(np.clip(np.searchsorted(times, t) - NODES // 2, 0, max(len(times) - NODES, 0)))
    part = s.at(slice(first, first + NODES))
    turns = so3.log(np.swapaxes(s.R[k], -1, -2) @ part.R)  # R = R_k exp(turn)
    values = np.stack((part.r, turns), axis=2)
    rates = np.stack((part.v, _compute_turn_rate(turns, part.Omega)), axis=2)
    nodes = np.repeat(part.times - t, 2)
    data = np.stack((values, rates), axis=1).reshape(len(nodes), *values.shape[1:])
    value, rate = KroghInterpolator(nodes, data).derivatives(0.0, 2)
    turn = value[:, 1]
    return State(value[:, 0], s.R[k] @ so3.exp(turn), rate[:, 0], so3.angular_velocity(turn, rate[:, 1]), t)


def _compute_turn_rate(a: Float[np.ndarray, "nt nb 3"], Omega: Float[np.ndarray, "nt nb 3"]) -> np.ndarray:
    """Return a_dot of R = R_k exp(a): Omega + a x Omega/2 + c a x (a x Omega), c = (1 - x/2 cot(x/2))/x^2, x = |a|."""
    x = np.linalg.norm(a, axis=-1, keepdims=True)
    half = np.where(x < 0.01, 0.005, 0.5 * x)
    c = np.where(x < 0.01, 1.0 / 12.0 + x**2 / 720.0, (1.0 - half / np.tan(half)) / (2.0 * half) ** 2)
    across = np.cross(a, Omega)
    return np.asarray(Omega + 0.5 * across + c * np.cross(a, across))
