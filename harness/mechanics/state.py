"""Define poses and velocities of all bodies: the result of every solver, whatever its coordinates."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class State:
    """A state at one instant: ``r``, ``v`` of C in space, ``R`` body to space, ``Omega`` in the body frame."""

    r: Float[np.ndarray, "nb 3"]  # [m]
    R: Float[np.ndarray, "nb 3 3"]
    v: Float[np.ndarray, "nb 3"]  # [m/s]
    Omega: Float[np.ndarray, "nb 3"]  # [rad/s]
    t: float = 0.0  # [s]; drives and loads may depend on it

    def __post_init__(self) -> None:
        """Make the arrays read-only; raise ValueError unless they have the shapes above."""
        nb = len(self.r)
        _check_and_freeze(self, {"r": (nb, 3), "R": (nb, 3, 3), "v": (nb, 3), "Omega": (nb, 3)})

    @property
    def nb(self) -> int:
        """Number of bodies."""
        return len(self.r)


@dataclass(frozen=True)
class States:
    """``State`` stacked along time (axis 0)."""

    r: Float[np.ndarray, "nt nb 3"]
    R: Float[np.ndarray, "nt nb 3 3"]
    v: Float[np.ndarray, "nt nb 3"]
    Omega: Float[np.ndarray, "nt nb 3"]
    t: Float[np.ndarray, " nt"] | None = None  # [s]; without them all are at t = 0
    # [rad] of torsional springs, where poses do not determine their whole turns
    angles: Float[np.ndarray, "nt m"] | None = None

    def __post_init__(self) -> None:
        """Set missing times to 0 and make the arrays read-only; raise ValueError unless they have the shapes above."""
        nt, nb = self.r.shape[:2]
        if self.t is None:
            object.__setattr__(self, "t", np.zeros(nt))
        shapes = {"r": (nt, nb, 3), "R": (nt, nb, 3, 3), "v": (nt, nb, 3), "Omega": (nt, nb, 3), "t": (nt,)}
        _check_and_freeze(self, shapes)

    @property
    def times(self) -> Float[np.ndarray, " nt"]:
        """The times ``t``, zeros where none are given."""
        assert self.t is not None
        return self.t

    def with_times(self, t: Float[np.ndarray, " nt"]) -> "States":
        """Return the same poses and velocities at the times ``t``."""
        return States(self.r, self.R, self.v, self.Omega, t, self.angles)

    def with_angles(self, angles: Float[np.ndarray, "nt m"]) -> "States":
        """Return the same motion with ``angles`` [rad] of its torsional springs, given to within half a turn.

        They say how many whole turns each spring is wound, which poses do not.
        """
        return States(self.r, self.R, self.v, self.Omega, self.t, angles)

    def __len__(self) -> int:
        return len(self.r)

    def __getitem__(self, k: int) -> State:
        return State(self.r[k], self.R[k], self.v[k], self.Omega[k], float(self.times[k]))

    @property
    def nb(self) -> int:
        """Number of bodies."""
        return self.r.shape[1]

    def at(self, index: np.ndarray | slice) -> "States":
        """Return the motion at the times that ``index`` selects, as in NumPy."""
        angles = None if self.angles is None else self.angles[index]
        return States(self.r[index], self.R[index], self.v[index], self.Omega[index], self.times[index], angles)

    @staticmethod
    def join(motions: "Sequence[States]") -> "States":
        """Return the instants of several motions of the same bodies as one motion, the first one's first.

        Angles of springs are kept if all motions have them.
        """
        if len(motions) == 1:
            return motions[0]
        names = ("r", "R", "v", "Omega", "times")
        r, R, v, Omega, t = (np.concatenate([getattr(s, name) for s in motions]) for name in names)
        angles = [s.angles for s in motions if s.angles is not None]
        return States(r, R, v, Omega, t, np.concatenate(angles) if len(angles) == len(motions) else None)

    def split(self, counts: Sequence[int]) -> "list[States]":
        """Return the motions that ``join`` has joined; ``counts`` are their numbers of instants."""
        ends = np.cumsum([0, *counts])
        return [self.at(slice(i, j)) for i, j in itertools.pairwise(ends)]

    @staticmethod
    def one(state: State) -> "States":
        """Return the motion that consists of one instant, ``state``."""
        return States(state.r[None], state.R[None], state.v[None], state.Omega[None], np.array([state.t]))


def rotate_states(s: States, Q: Float[np.ndarray, "3 3"]) -> States:
    """Return the motion rotated by ``Q`` in space; Omega, in the body frame, stays."""
    R = (s.R.reshape(-1, 9) @ np.kron(Q, np.eye(3)).T).reshape(s.R.shape)  # Q R, for all at once
    return States(s.r @ Q.T, R, s.v @ Q.T, s.Omega, s.t, s.angles)


def _check_and_freeze(self: object, shapes: dict[str, tuple[int, ...]]) -> None:
    """Make the fields named in ``shapes`` read-only float arrays; raise ValueError unless they have these shapes.

    The dataclass may be frozen: its fields are replaced by views.
    """
    for name, shape in shapes.items():
        array = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
        if array.shape != shape:
            raise ValueError(f"{type(self).__name__}.{name} must have shape {shape} (got {array.shape})")
        array = array.view()
        array.setflags(write=False)
        object.__setattr__(self, name, array)
