"""Numbers made small for a page: poses as whole steps within a box, strips with few bits."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

LEVELS = 32767
DIGITS = 9  # bits of mantissa that a strip keeps: 1/1024 of the value at most, below a pixel


@dataclass(frozen=True)
class Box:
    """Where positions are exact to half a step; what leaves it stays at its wall."""

    low: Float[np.ndarray, " 3"]
    high: Float[np.ndarray, " 3"]

    @property
    def quantum(self) -> Float[np.ndarray, " 3"]:
        """A step of the int16 grid [m]; positions are off by half of it at most."""
        return np.maximum(self.high - self.low, 1e-12) / (2 * LEVELS)

    def grown(self, by: float) -> "Box":
        """With walls ``by`` times its largest side further out."""
        out = by * float(np.max(self.high - self.low))
        return Box(self.low - out, self.high + out)


def box_of(points: Float[np.ndarray, "*n 3"]) -> Box:
    """The smallest box of all finite points; of side 1 around the origin if there is none."""
    flat = points.reshape(-1, 3)
    flat = flat[np.all(np.isfinite(flat), axis=1)]
    if len(flat) == 0:
        return Box(np.full(3, -0.5), np.full(3, 0.5))
    return Box(flat.min(axis=0).astype(float), flat.max(axis=0).astype(float))


def positions(r: Float[np.ndarray, "nf nb 3"], box: Box) -> Int[np.ndarray, "nf nb 3"]:
    """To the grid of the box, its middle at 0."""
    middle = 0.5 * (box.low + box.high)
    steps = np.rint((r.astype(float) - middle) / box.quantum)
    return np.clip(steps, -LEVELS, LEVELS).astype(np.int16)


def quaternions(q: Float[np.ndarray, "nf nb 4"]) -> Int[np.ndarray, "nf nb 4"]:
    """Unit quaternions to the grid, each of the sign that lies nearer to the one before."""
    q = q.astype(float)
    turns = np.sign(np.sum(q[1:] * q[:-1], axis=-1))
    turns[turns == 0.0] = 1.0
    q[1:] *= np.cumprod(turns, axis=0)[..., None]
    return np.rint(np.clip(q, -1.0, 1.0) * LEVELS).astype(np.int16)


def columns(a: Int[np.ndarray, "nf n"]) -> Int[np.ndarray, " m"]:
    """One column after the other from 0 up: its differences over time, which is what a bundle stores, compress well."""
    return a.T.astype(np.int64).ravel() + LEVELS


def rounded(a: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """With ``DIGITS`` bits of mantissa, which compress well."""
    fraction, power = np.frexp(a)
    return np.ldexp(np.rint(np.ldexp(fraction, DIGITS)), power - DIGITS)
