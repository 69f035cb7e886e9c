"""Write accepted steps to disk during a run, to keep the motion of a process that is killed, crashes or raises.

Rows of float64, (t, r, R, v, Omega) of all bodies, are appended in whole blocks. The system keeps what was written,
however the process ends. A run that ends normally returns its trajectory, and the file is removed.
"""

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..base.confined_paths import ConfinedPath, confine_path
from ..mechanics.state import States
from ..mechanics.types import Problem, Status, Trajectory

EVERY = 0.02  # [s] between two blocks: the most that a killed run loses
SHARE = 0.01  # fraction of the time: a block that took 1 ms to write is followed by 100 ms without
# [bytes] most in a file, 1.8 million steps of a body; later steps are not kept, so that a run cannot fill the disk
LARGEST = 2**28
NUMBERS = 18  # numbers per body and step: r, R, v, Omega


@dataclass
class FileSpool:
    """A ``harness.mechanics.types.Spool`` in a file, which begins empty."""

    where: Path | ConfinedPath
    rows: int = 0
    _next: float = field(default=0.0, repr=False)  # [s] time.monotonic() from which a block is due
    _asked: float = field(default=0.0, repr=False)  # [s] time.monotonic() of the last call of ``due``
    _size: int = field(default=0, repr=False)  # [bytes] written

    def __post_init__(self) -> None:
        confine_path(self.where).open_new().close()

    @property
    def path(self) -> Path:
        """The path of the file."""
        return confine_path(self.where).path

    def due(self) -> bool:
        """Return whether it is time for the next block, so that writing takes ``SHARE`` of the time at most."""
        self._asked = time.monotonic()
        return self._asked >= self._next

    def take(self, t: Float[np.ndarray, " nt"] | list[float], states: States) -> None:
        """Append the steps at ``t`` [s] with their ``states`` to the file, and set when the next block is due.

        Once the file is full, steps are dropped and no block is due any more. Some solvers pass the start as the first
        step, some do not.
        """
        began = min(self._asked or time.monotonic(), time.monotonic())
        block = np.concatenate(
            [np.asarray(t)[:, None], *(a.reshape(len(t), -1) for a in (states.r, states.R, states.v, states.Omega))],
            axis=1,
        )
        if self._size + block.nbytes <= LARGEST:
            with confine_path(self.where).open_file(os.O_WRONLY | os.O_APPEND) as file:
                file.write(block.tobytes())
            self._size += block.nbytes
            self.rows += len(t)
            self._next = (now := time.monotonic()) + max(EVERY, (now - began) / SHARE)
        else:
            self._next = float("inf")


def read_spool(path: Path | ConfinedPath, problem: Problem, status: Status, message: str) -> Trajectory | None:
    """Return the steps of a spool file as a trajectory of ``problem`` that begins with its start; None without steps.

    ``status`` and ``message`` say how the run that wrote the file ended, and become those of the trajectory.
    """
    nb = problem.system.nb
    place = confine_path(path)
    content = place.read(LARGEST) if place.is_there() else b""
    whole = len(content) // (8 * (1 + NUMBERS * nb))
    rows = np.frombuffer(content[: whole * 8 * (1 + NUMBERS * nb)]).reshape(whole, 1 + NUMBERS * nb)
    if whole == 0 or rows[-1, 0] <= 0.0:
        return None
    rows = rows[1:] if rows[0, 0] == 0.0 else rows  # some solvers pass the start, some do not
    parts = np.split(rows[:, 1:], nb * np.array([3, 12, 15]), axis=1)
    starts = (getattr(problem.initial, name)[None] for name in ("r", "R", "v", "Omega"))
    states = States(*(np.concatenate((a, b.reshape(-1, *a.shape[1:]))) for a, b in zip(starts, parts, strict=True)))
    return Trajectory(np.insert(rows[:, 0], 0, 0.0), states, status, message, {})
