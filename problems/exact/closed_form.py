"""A motion with a formula, from one start only."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import State, States
from ...harness.types import ReferenceKind

ROUNDING = float(np.finfo(float).eps)
SAME = 1e-12  # of two starts: rounding of turned frames, times a thousand


@dataclass(frozen=True)
class ClosedForm:
    """``of`` gives the motion; its error is the rounding of lengths up to ``size`` + ``speed`` t."""

    route: str
    of: Callable[[Float[np.ndarray, " nt"]], States]
    size: float  # [m]
    speed: float = 0.0  # [m/s] of what grows without bound, phases times lengths included
    horizon: float = math.inf
    kind: ReferenceKind = ReferenceKind.FORMULA

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """The motion at ``t`` [s]."""
        return self.of(np.asarray(t, dtype=float))

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Bound [m]."""
        return 16.0 * ROUNDING * (self.size + self.speed * np.abs(np.asarray(t, dtype=float)))

    def start(self) -> State:
        """Where it starts."""
        return self.of(np.zeros(1))[0]

    def from_start(self, start: State) -> "ClosedForm | None":
        """The motion if it starts there; of another start no formula is known."""
        own = self.start()
        apart = max(float(np.max(np.abs(getattr(own, n) - getattr(start, n)))) for n in ("r", "R", "v", "Omega"))
        return self if apart < SAME * max(1.0, float(np.max(np.abs(own.Omega)))) else None
