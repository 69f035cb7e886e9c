"""Provide a motion given by a formula, for one start only."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import State, States
from ...harness.mechanics.types import ReferenceKind

ROUNDING = float(np.finfo(float).eps)
SAME = 1e-12  # difference of equal starts: a thousand roundings of rotated frames


@dataclass(frozen=True)
class ClosedForm:
    """A motion given by ``of``; its error is the rounding of lengths up to ``size`` + ``speed`` t."""

    route: str
    of: Callable[[Float[np.ndarray, " nt"]], States]
    size: float  # [m]
    speed: float = 0.0  # [m/s] growth of lengths, including phases times lengths
    horizon: float = math.inf
    kind: ReferenceKind = ReferenceKind.FORMULA

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s]."""
        return self.of(np.asarray(t, dtype=float))

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a bound on the position error [m]."""
        return 16.0 * ROUNDING * (self.size + self.speed * np.abs(np.asarray(t, dtype=float)))

    def start(self) -> State:
        """Return the state at t = 0."""
        return self.of(np.zeros(1))[0]

    def match_start(self, start: State) -> "ClosedForm | None":
        """Return this motion if it begins at ``start`` up to rounding; else None, as no formula is known."""
        own = self.start()
        apart = max(float(np.max(np.abs(getattr(own, n) - getattr(start, n)))) for n in ("r", "R", "v", "Omega"))
        return self if apart < SAME * max(1.0, float(np.max(np.abs(own.Omega)))) else None
