"""Define functions of time for drives and loads: a cubic polynomial and a sine, with exact derivatives and integrals.

    f(t) = c_0 + c_1 t + c_2 t^2 + c_3 t^3 + a sin(w t + p)

A system stores seven numbers (c_0, c_1, c_2, c_3, a, w, p), which kernels and CasADi evaluate.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

NUMBERS = 7


@dataclass(frozen=True)
class TimeFunction:
    """A function of time; ``polynomial`` holds up to four coefficients, the constant first; t in s."""

    polynomial: Sequence[float] = ()
    amplitude: float = 0.0
    frequency: float = 0.0  # w [rad/s]
    phase: float = 0.0  # p [rad]

    def numbers(self, where: str = "function of time") -> Float[np.ndarray, " 7"]:
        """Return the seven numbers that a system stores; raise ValueError if they are invalid, naming ``where``."""
        c = tuple(self.polynomial)
        if len(c) > 4:
            raise ValueError(f"{where}: polynomial takes up to four coefficients (got {len(c)})")
        out = np.array([*c, *[0.0] * (4 - len(c)), self.amplitude, self.frequency, self.phase], dtype=float)
        if not np.all(np.isfinite(out)):
            raise ValueError(f"{where}: the numbers of a function of time must be finite (got {out.tolist()})")
        return out

    def integral(self, start: float = 0.0) -> "TimeFunction":
        """Return the integral over time that is ``start`` at t = 0: the position of a drive with this speed.

        Raise ValueError for a cubic, whose integral has no such form.
        """
        c = tuple(self.polynomial)
        if len(c) > 3 and c[3] != 0.0:
            raise ValueError("the integral of a cubic is no cubic: give a speed of three coefficients at most")
        rising = [x / (k + 1) for k, x in enumerate(c[:3])]
        if self.amplitude == 0.0 or self.frequency == 0.0:
            steady = self.amplitude * math.sin(self.phase)
            rising = [x + steady * (k == 0) for k, x in enumerate(rising or [0.0])]
            return TimeFunction((start, *rising))
        swing = self.amplitude / self.frequency
        return TimeFunction(
            (start + swing * math.cos(self.phase), *rising), swing, self.frequency, self.phase - 0.5 * math.pi
        )


NONE = np.zeros(NUMBERS)  # f = 0
ONE = np.eye(NUMBERS)[0]  # f = 1


def evaluate_functions(
    numbers: Float[np.ndarray, "m 7"], t: Float[np.ndarray, " nt"]
) -> tuple[Float[np.ndarray, "nt m"], Float[np.ndarray, "nt m"], Float[np.ndarray, "nt m"]]:
    """Return f, f_dot and f_ddot at the times ``t`` [s] of m functions, one for each row of ``numbers``."""
    c0, c1, c2, c3, a, w, p = numbers.T
    t = t[:, None]
    sine, cosine = a * np.sin(w * t + p), a * np.cos(w * t + p)
    f = c0 + t * (c1 + t * (c2 + t * c3)) + sine
    return f, c1 + t * (2.0 * c2 + 3.0 * t * c3) + w * cosine, 2.0 * c2 + 6.0 * t * c3 - w * w * sine


def scale_units(
    numbers: Float[np.ndarray, "m 7"], value: float | Float[np.ndarray, " m"], time: float
) -> Float[np.ndarray, "m 7"]:
    """Return the numbers of the same functions in other units: values are multiplied by ``value``, times by ``time``.

    ``value`` is one factor for all functions, or one for each.
    """
    out = np.array(numbers)
    out[:, :5] *= np.broadcast_to(value, (len(out),))[:, None]
    out[:, :4] /= time ** np.arange(4.0)
    out[:, 5] /= time
    return out


def find_varying(numbers: Float[np.ndarray, "m 7"]) -> np.ndarray:
    """Return which of the functions are not constant (m,)."""
    return np.any(numbers[:, 1:4] != 0.0, axis=1) | ((numbers[:, 4] != 0.0) & (numbers[:, 5] != 0.0))


def shift_time(numbers: Float[np.ndarray, "m 7"], t: float) -> Float[np.ndarray, "m 7"]:
    """Return the numbers of the functions s -> f(t + s): f with its time counted from ``t`` [s]."""
    c = numbers[:, :4].T
    out = np.array(numbers, dtype=float)
    out[:, 0] = c[0] + t * (c[1] + t * (c[2] + t * c[3]))
    out[:, 1] = c[1] + t * (2.0 * c[2] + 3.0 * t * c[3])
    out[:, 2] = c[2] + 3.0 * t * c[3]
    out[:, 6] = numbers[:, 6] + t * numbers[:, 5]
    return out
