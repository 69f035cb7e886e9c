"""A motion by two routes side by side: one gives it as polynomials, their disagreement bounds its error; kept on disk.

Route 1 is DOP853 with its dense output in one set of coordinates, route 2 extrapolation in another set. What they
disagree in is their error; the bound is ``SAFETY`` times the largest disagreement so far. In chaos it grows
exponentially, and the orbit ends where the bound passes the limit it is given, or where a route fails.
"""

import io
import os
import tempfile
import zipfile
from bisect import bisect_left
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp

from ..cache import cache_folder, read_kept
from ..machine import name_arithmetic
from .collocation import Collocation
from .extrapolation import Rate, gbs_adaptive

SAFETY = 10.0  # one route may be as wrong as both differ, and errors may cancel at the compared nodes
FLOOR = 1e-13  # [m] rounding of evaluation
LARGEST = 2**31  # [bytes] of a file: ours are below a tenth of it
FOLDER = cache_folder("references", Path(__file__).resolve().parents[2] / "results" / "local")


@dataclass(frozen=True)
class Orbit:
    """States of route 1 as polynomials over its steps, and the bound after each step of route 2."""

    t: Float[np.ndarray, " nt"]
    y: Float[np.ndarray, "steps ny"]
    F: Float[np.ndarray, "steps 7 ny"]  # DOP853's interpolant
    bound_t: Float[np.ndarray, " nb"]
    bound: Float[np.ndarray, " nb"]  # [m], not decreasing
    stiff: bool = False  # by collocation

    @property
    def horizon(self) -> float:
        """[s]"""
        return float(self.bound_t[-1])

    def __call__(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, "nt ny"]:
        """States of route 1 at ``t``."""
        t = self._within(t)
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.y) - 1)
        x = ((t - self.t[k]) / (self.t[k + 1] - self.t[k]))[:, None]
        out = np.zeros((len(t), self.y.shape[1]))
        for i in range(7):  # Hairer's nested form
            out = (out + self.F[k, 6 - i]) * (x if i % 2 == 0 else 1.0 - x)
        return self.y[k] + out

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Bound [m] at ``t``: that of the next step of route 2."""
        k = np.searchsorted(self.bound_t, self._within(t), side="left")
        return self.bound[k]

    def until(self, worst: float) -> "Orbit":
        """The part whose bound is below ``worst`` [m]; of no length if there is none."""
        inside = max(int(np.searchsorted(self.bound, worst)), 1)
        return replace(self, bound_t=self.bound_t[:inside], bound=self.bound[:inside])

    def _within(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        t = np.asarray(t, dtype=float)
        if np.any(t < 0.0) or np.any(t > self.horizon * (1.0 + 1e-9)):
            raise ValueError(f"the reference covers 0..{self.horizon:g} s (got {np.min(t):g}..{np.max(t):g} s)")
        return np.minimum(t, self.horizon)


@dataclass(frozen=True)
class Pair:
    """Two routes to one motion from ``y0`` and ``z0``."""

    first: Rate  # of one state y
    second: Rate  # of several states z at once
    y0: Float[np.ndarray, " ny"]
    z0: Float[np.ndarray, " nz"]
    disagreement: Callable[[np.ndarray, np.ndarray], float]  # [m] of y and z
    begin: Callable[[], None] = lambda: None  # before each step of ``second``


@dataclass(frozen=True)
class Piece:
    """A chunk of both routes: its end, where each got, and the steps of both."""

    t: float  # [s] at its end
    y: Float[np.ndarray, " ny"]
    z: Float[np.ndarray, " nz"]
    steps: list[tuple[float, np.ndarray, np.ndarray]]  # start, y and F of route 1
    nodes: list[tuple[float, float]]  # time and disagreement [m] after each step of route 2


def chunk(
    pair: Pair, at: tuple[float, np.ndarray, np.ndarray], span: float, tolerance: float, correction: float,
    units: tuple[np.ndarray | float, np.ndarray | float] = (1.0, 1.0), steps: float = 64.0,
) -> Piece:  # fmt: skip
    """Both routes over ``span`` [s] from (t, y, z) in ``units`` of y and z; ArithmeticError if one cannot.

    Route 2 tries as many ``steps`` first.
    """
    t, y, end = at
    piece: Any = solve_ivp(
        lambda _, y: pair.first(y), (0.0, span), y, "DOP853",
        rtol=tolerance, atol=tolerance * units[0], dense_output=True,
    )  # fmt: skip
    if not piece.success:
        raise ArithmeticError(piece.message)
    nodes = []
    for s, end in gbs_adaptive(pair.second, at[2], span, correction * units[1], span / steps, pair.begin):
        nodes.append((t + s, pair.disagreement(piece.sol(s), end)))
    taken = [(t + p.t_old, p.y_old, p.F) for p in piece.sol.interpolants]
    return Piece(t + span, piece.y[:, -1], end, taken, nodes)


def stiff_chunk(
    pair: Pair, routes: tuple[Collocation, Collocation], at: tuple[float, np.ndarray, np.ndarray], span: float,
    tolerance: float, correction: float, units: tuple[np.ndarray, np.ndarray],
) -> Piece:  # fmt: skip
    """As ``chunk``, both routes by collocation, which goes on from its last steps."""
    t, y, z = at
    taken = list(routes[0].steps(y, span, tolerance, units[0]))
    starts = [step.t for step in taken]
    nodes = []
    for step in routes[1].steps(z, span, correction, units[1]):
        end, z = min(step.t + step.h, span), step.end
        other = taken[bisect_left(starts, end) - 1]
        nodes.append((t + end, pair.disagreement(other.states(np.array([(end - other.t) / other.h]))[0], z)))
    return Piece(t + span, taken[-1].end, z, [(t + step.t, step.y, step.F) for step in taken], nodes)


def orbit_of(pieces: Iterator[Piece], worst: Callable[[], float]) -> Orbit | None:
    """The orbit of consecutive chunks, taken until the bound passes ``worst()`` [m]; None without any."""
    steps: list[tuple[float, np.ndarray, np.ndarray]] = []
    bound_t, bound, end = [0.0], [FLOOR], 0.0
    for piece in pieces:
        steps += piece.steps
        end = piece.t
        for t, gap in piece.nodes:
            bound_t.append(t)
            bound.append(max(bound[-1], FLOOR + SAFETY * gap))
        if not bound[-1] < max(worst(), FLOOR):
            break
    if not steps:
        return None
    starts, y, F = (np.array(a) for a in zip(*steps, strict=True))
    return Orbit(np.append(starts, end), y, F, np.array(bound_t), np.array(bound))


def load_or_compute(key: str | None, compute: Callable[[], Orbit | None]) -> Orbit | None:
    """The orbit of the digest ``key``, from disk if it is there; that there is none is kept too. Without a key: new.

    What was computed natively, or by other kernels, is no other run's reference: its bits would be.
    """
    if key is None:
        return compute()
    file = FOLDER / name_arithmetic() / f"{key[:24]}.npz"
    known = _read(file)
    if known is not None:
        return known if len(known.y) else None
    found = compute()
    nothing = np.zeros(0)
    _write(file, found or Orbit(nothing, np.zeros((0, 0)), np.zeros((0, 7, 0)), nothing, nothing))
    return found


def _read(file: Path) -> Orbit | None:
    try:
        with np.load(io.BytesIO(read_kept(file, LARGEST))) as stored:
            stiff = bool(stored.get("stiff", False))  # older files of certified motions have none
            return Orbit(**{name: stored[name] for name in ("t", "y", "F", "bound_t", "bound")}, stiff=stiff)
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile):  # absent, or damaged: computed anew
        return None


def _write(file: Path, orbit: Orbit) -> None:
    """Whole or not at all, as several processes may ask for the same motion; without a place to write, not at all."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".part", delete=False) as part:
            np.savez(part, **vars(orbit))
        os.replace(part.name, file)
    except OSError:
        return
