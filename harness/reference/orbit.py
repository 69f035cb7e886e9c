"""Compute a motion by two routes side by side: one gives it as polynomials, their disagreement bounds its error.

Route 1 is DOP853 with its dense output in one set of coordinates, route 2 extrapolation in another set. Their
disagreement estimates their error; the bound is ``SAFETY`` times the largest disagreement so far. In chaos it grows
exponentially, and the orbit ends where the bound exceeds its limit, or where a route fails. Orbits are stored on disk.
"""

import io
import zipfile
from bisect import bisect_left
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ..base.cache import make_cache_folder, read_sealed_file, write_sealed_file
from ..base.machine import name_arithmetic
from .collocation import Collocation
from .extrapolation import Rate, gbs_adaptive

# bound over disagreement: one route may have all the error, and errors may cancel at the compared nodes. Half and twice
# state half and twice the errors, of 1e-13 to 9e-12 m on four problems; the horizons are the same.
SAFETY = 10.0
FLOOR = 1e-13  # [m] rounding of evaluation
LARGEST = 2**31  # [bytes] largest file that is read; those written are below a tenth of it
FOLDER = make_cache_folder("references", Path(__file__).resolve().parents[2] / "results" / "local")


@dataclass(frozen=True)
class Orbit:
    """The states of route 1 as polynomials over its steps, and the error bound after each step of route 2."""

    t: Float[np.ndarray, " nt"]  # [s] ends of the steps of route 1, the start first
    y: Float[np.ndarray, "steps ny"]  # state at the start of each
    F: Float[np.ndarray, "steps 7 ny"]  # DOP853's interpolant
    bound_t: Float[np.ndarray, " nb"]  # [s] ends of the steps of route 2, the start first
    bound: Float[np.ndarray, " nb"]  # [m], not decreasing
    stiff: bool = False  # whether it was computed by collocation
    ends: str = ""  # why it ends before the requested time; empty if it does not
    beyond: "Orbit | None" = None  # a less exact orbit, used after the end of this one

    @property
    def end(self) -> float:
        """The time [s] at which this orbit itself ends, without ``beyond``."""
        return float(self.bound_t[-1])

    @property
    def horizon(self) -> float:
        """The time [s] up to which states are known, including those of ``beyond``."""
        return self.end if self.beyond is None else self.beyond.horizon

    def __call__(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, "nt ny"]:
        """Return the state vectors of route 1 at ``t`` [s]; raise ValueError beyond the horizon."""
        t = self._clip_times(t)
        if self.beyond is not None and np.any(later := t > self.end):
            out = np.zeros((len(t), self.y.shape[1]))
            out[later], out[~later] = self.beyond(t[later]), replace(self, beyond=None)(t[~later])
            return out
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.y) - 1)
        x = ((t - self.t[k]) / (self.t[k + 1] - self.t[k]))[:, None]
        out = np.zeros((len(t), self.y.shape[1]))
        for i in range(7):  # Hairer's nested form
            out = (out + self.F[k, 6 - i]) * (x if i % 2 == 0 else 1.0 - x)
        return self.y[k] + out

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return the bound [m] on the error at ``t`` [s]: that after the next step of route 2."""
        t = self._clip_times(t)
        k = np.searchsorted(self.bound_t, np.minimum(t, self.end), side="left")
        if self.beyond is None:
            return self.bound[k]
        return np.where(t > self.end, np.maximum(self.bound[-1], self.beyond.error(t)), self.bound[k])

    def cut_at_bound(self, worst: float) -> "Orbit":
        """Return the orbit up to where its bound reaches ``worst`` [m]; of zero length if the first bound does."""
        inside = max(int(np.searchsorted(self.bound, worst)), 1)
        return replace(self, bound_t=self.bound_t[:inside], bound=self.bound[:inside])

    def _clip_times(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return ``t`` [s] with times beyond the horizon by rounding set to it; raise ValueError for others."""
        t = np.asarray(t, dtype=float)
        if np.any(t < 0.0) or np.any(t > self.horizon * (1.0 + 1e-9)):
            raise ValueError(f"the reference covers 0..{self.horizon:g} s (got {np.min(t):g}..{np.max(t):g} s)")
        return np.minimum(t, self.horizon)


@dataclass(frozen=True)
class Pair:
    """The rates and starts of two routes to one motion."""

    first: Rate  # rate of one state y
    second: Rate  # rate of several states z at once
    y0: Float[np.ndarray, " ny"]
    z0: Float[np.ndarray, " nz"]
    disagreement: Callable[[np.ndarray, np.ndarray], float]  # [m] between y and z
    begin: Callable[[], None] = lambda: None  # called before each step of ``second``


@dataclass(frozen=True)
class Piece:
    """A chunk of a motion by both routes: its end, the states there, and the steps of both."""

    t: float  # [s] at its end
    y: Float[np.ndarray, " ny"]
    z: Float[np.ndarray, " nz"]
    steps: list[tuple[float, np.ndarray, np.ndarray]]  # start, y and F of route 1
    nodes: list[tuple[float, float]]  # time and disagreement [m] after each step of route 2


def advance_routes(
    pair: Pair,
    at: tuple[float, np.ndarray, np.ndarray],
    span: float,
    tolerance: float,
    correction: float,
    units: tuple[np.ndarray | float, np.ndarray | float] = (1.0, 1.0),
    steps: float = 64.0,
) -> Piece:
    """Advance both routes by ``span`` [s] from ``at``, time and both states (t, y, z), and return the chunk.

    ``tolerance`` is that of route 1 (DOP853), ``correction`` that of route 2 (extrapolation), relative to ``units``,
    the scales of y and z. The first step of route 2 is ``span / steps``. Raises ArithmeticError if a route fails.
    """
    from scipy.integrate import solve_ivp  # here: it takes a third of a second to load

    t, y, end = at
    piece: Any = solve_ivp(
        lambda _, y: pair.first(y),
        (0.0, span),
        y,
        "DOP853",
        rtol=tolerance,
        atol=tolerance * units[0],
        dense_output=True,
    )
    if not piece.success:
        raise ArithmeticError(piece.message)
    nodes = []
    for s, end in gbs_adaptive(pair.second, at[2], span, correction * units[1], span / steps, pair.begin):
        nodes.append((t + s, pair.disagreement(piece.sol(s), end)))
    taken = [(t + p.t_old, p.y_old, p.F) for p in piece.sol.interpolants]
    return Piece(t + span, piece.y[:, -1], end, taken, nodes)


def advance_stiff(
    pair: Pair,
    routes: tuple[Collocation, Collocation],
    at: tuple[float, np.ndarray, np.ndarray],
    span: float,
    tolerance: float,
    correction: float,
    units: tuple[np.ndarray, np.ndarray],
) -> Piece:
    """Advance both routes by the collocations ``routes``, which continue from their last steps; return the chunk.

    Arguments and failures are those of ``advance_routes``.
    """
    t, y, z = at
    taken = list(routes[0].steps(y, span, tolerance, units[0]))
    starts = [step.t for step in taken]
    nodes = []
    for step in routes[1].steps(z, span, correction, units[1]):
        end, z = min(step.t + step.h, span), step.end
        other = taken[bisect_left(starts, end) - 1]
        nodes.append((t + end, pair.disagreement(other.states(np.array([(end - other.t) / other.h]))[0], z)))
    return Piece(t + span, taken[-1].end, z, [(t + step.t, step.y, step.F) for step in taken], nodes)


def join_chunks(pieces: Iterator[Piece], worst: Callable[[], float]) -> Orbit | None:
    """Join consecutive chunks into an orbit, up to the first after which its bound exceeds ``worst()`` [m].

    The bound is ``SAFETY`` times the largest disagreement so far. Return None if there is no chunk.
    """
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


class NotStoredError(Exception):
    """Signal that an orbit is not on disk, within ``read_only_stored``."""


_only_stored = ContextVar("_only_stored", default=False)


@contextmanager
def read_only_stored() -> Iterator[None]:
    """Let ``load_or_compute`` raise ``NotStoredError`` within this context instead of computing an orbit."""
    token = _only_stored.set(True)
    try:
        yield
    finally:
        _only_stored.reset(token)


def load_or_compute(key: str | None, compute: Callable[[], Orbit | None]) -> Orbit | None:
    """Load the orbit stored under the digest ``key``, or compute and store it; return it.

    None if ``compute`` finds no orbit, which is stored too. Without a key the orbit is computed and not stored. Files
    are separate for each arithmetic: orbits computed natively or by other kernels differ in their last bits.
    """
    if key is None:
        if _only_stored.get():
            raise NotStoredError
        return compute()
    file = FOLDER / name_arithmetic() / f"{key[:24]}.npz"
    known = _read_orbit(file)
    if known is not None:
        return known if len(known.y) else None
    if _only_stored.get():
        raise NotStoredError
    found = compute()
    nothing = np.zeros(0)
    _write_orbit(file, found or Orbit(nothing, np.zeros((0, 0)), np.zeros((0, 7, 0)), nothing, nothing))
    return found


def _read_orbit(file: Path) -> Orbit | None:
    """Return the orbit of ``file``, without steps if its computation found none; None if absent or damaged."""
    try:
        with np.load(io.BytesIO(read_sealed_file(file, LARGEST))) as stored:
            stiff = bool(stored.get("stiff", False))  # older files of certified motions have none
            ends, parts = str(stored.get("ends", "")), ("t", "y", "F", "bound_t", "bound")
            beyond = Orbit(**{n: stored[f"beyond_{n}"] for n in parts}) if "beyond_t" in stored else None
            return Orbit(**{n: stored[n] for n in parts}, stiff=stiff, ends=ends, beyond=beyond)
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile):  # absent, or damaged: computed anew
        return None


def _write_orbit(file: Path, orbit: Orbit) -> None:
    """Write an orbit to ``file`` atomically, as several processes may compute the same motion; ignore OSError."""
    own = {name: value for name, value in vars(orbit).items() if name != "beyond"}
    further = ("t", "y", "F", "bound_t", "bound") if orbit.beyond is not None else ()
    content = io.BytesIO()
    np.savez(content, **own, **{f"beyond_{name}": getattr(orbit.beyond, name) for name in further})
    write_sealed_file(file, content.getvalue())
