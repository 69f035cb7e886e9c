"""Accepted steps on disk during a run: what a process that is killed, crashes or raises leaves of its motion.

Rows of float64, (t, r, R, v, Omega) of all bodies, appended in whole blocks. The system keeps what was written,
whatever ends the process. A run that ends in order hands back its trajectory, and the file goes.
"""

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..mechanics.state import States
from ..places import Place, place_of
from ..types import Problem, Status, Trajectory

EVERY = 0.02  # [s] between two blocks: what a killed run may lose
SHARE = 0.01  # of the time: a block that took 1 ms to hand over is followed by 100 ms without
LARGEST = 2**28  # [bytes] of a file; later steps are not kept
NUMBERS = 18  # a body and step: r, R, v, Omega


@dataclass
class FileSpool:
    """``harness.types.Spool`` in a file, which begins empty."""

    where: Path | Place
    rows: int = 0
    _next: float = field(default=0.0, repr=False)
    _asked: float = field(default=0.0, repr=False)
    _size: int = field(default=0, repr=False)

    def __post_init__(self) -> None:
        place_of(self.where).open_new().close()

    @property
    def path(self) -> Path:
        """The file's path."""
        return place_of(self.where).path

    def due(self) -> bool:
        self._asked = time.monotonic()
        return self._asked >= self._next

    def take(self, t: Float[np.ndarray, " nt"] | list[float], states: States) -> None:
        began = min(self._asked or time.monotonic(), time.monotonic())
        block = np.concatenate(
            [np.asarray(t)[:, None], *(a.reshape(len(t), -1) for a in (states.r, states.R, states.v, states.Omega))],
            axis=1,
        )
        if self._size + block.nbytes <= LARGEST:
            with place_of(self.where).open_file(os.O_WRONLY | os.O_APPEND) as file:
                file.write(block.tobytes())
            self._size += block.nbytes
            self.rows += len(t)
            self._next = (now := time.monotonic()) + max(EVERY, (now - began) / SHARE)
        else:
            self._next = float("inf")


def read_spool(path: Path | Place, problem: Problem, status: Status, message: str) -> Trajectory | None:
    """The steps in ``path`` as a trajectory from the start; None when there are none."""
    nb = problem.system.nb
    place = place_of(path)
    content = place.read(LARGEST) if place.is_there() else b""
    whole = len(content) // (8 * (1 + NUMBERS * nb))
    rows = np.frombuffer(content[: whole * 8 * (1 + NUMBERS * nb)]).reshape(whole, 1 + NUMBERS * nb)
    if whole == 0 or rows[-1, 0] <= 0.0:
        return None
    rows = rows[1:] if rows[0, 0] == 0.0 else rows  # some solvers hand over the start, some do not
    parts = np.split(rows[:, 1:], nb * np.array([3, 12, 15]), axis=1)
    starts = (getattr(problem.initial, name)[None] for name in ("r", "R", "v", "Omega"))
    states = States(*(np.concatenate((a, b.reshape(-1, *a.shape[1:]))) for a, b in zip(starts, parts, strict=True)))
    return Trajectory(np.insert(rows[:, 0], 0, 0.0), states, status, message, {})
