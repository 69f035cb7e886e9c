"""Motions without a formula: integrated by one route, certified by a second one, kept on disk.

Route 1 is DOP853 with its dense output in one set of coordinates, route 2 extrapolation in another set, each at its
rounding floor. They share no equation and no integrator, so what they disagree in is their error; the bound is
``SAFETY`` times the largest disagreement so far. In chaos it grows exponentially, and the certificate ends where the
bound reaches ``WORST``.
"""

import hashlib
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp

from ...harness.cache import cache_folder
from .extrapolation import gbs_adaptive
from .linkage import Linkage, by_angles, by_nodes

SAFETY = 10.0  # one route may be as wrong as both differ, and errors may cancel at the compared nodes
WORST = 1e-3  # [m]
MOST_STEPS = 4000  # of route 2, about half a minute: a fast motion is certified for a shorter time
FLOOR = 1e-13  # [m] rounding of evaluation
TOLERANCE = 1e-13  # route 1
CORRECTION = 1e-12  # route 2; its error is that of a higher order still
FORMAT = 1  # of the files; raise it when an equation of a route changes
FOLDER = cache_folder("references", Path(__file__).resolve().parents[2] / "results" / "local")


@dataclass(frozen=True)
class CertifiedOrbit:
    """Angles and rates by route 1 as polynomials over its steps, and the bound after each step of route 2."""

    t: Float[np.ndarray, " steps+1"]
    y: Float[np.ndarray, "steps 2n"]
    F: Float[np.ndarray, "steps 7 2n"]  # DOP853's interpolant
    bound_t: Float[np.ndarray, " nb"]
    bound: Float[np.ndarray, " nb"]  # [m], not decreasing

    @property
    def horizon(self) -> float:
        """[s]"""
        return float(self.bound_t[-1])

    def __call__(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, "nt 2n"]:
        """Angles and rates at ``t``."""
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

    def _within(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        t = np.asarray(t, dtype=float)
        if np.any(t < 0.0) or np.any(t > self.horizon * (1.0 + 1e-9)):
            raise ValueError(f"the reference covers 0..{self.horizon:g} s (got {np.min(t):g}..{np.max(t):g} s)")
        return np.minimum(t, self.horizon)


def certified_orbit(link: Linkage, y0: Float[np.ndarray, " 2n"], t_max: float, chunk: float) -> CertifiedOrbit:
    """Both routes side by side in chunks [s] until ``t_max`` or the end of the certificate; read from disk if known."""
    key = hashlib.sha256(
        repr((FORMAT, SAFETY, WORST, TOLERANCE, CORRECTION, link.length, link.gravity, link.end, t_max, chunk)).encode()
    )
    for a in (link.rod_mass, link.node_mass, y0):
        key.update(np.ascontiguousarray(a, dtype=float).tobytes())
    file = FOLDER / f"{key.hexdigest()[:24]}.npz"
    known = _read(file)
    if known is None:
        known = _integrate(link, y0, t_max, chunk)
        _write(file, known)
    return known


def _integrate(link: Linkage, y0: np.ndarray, t_max: float, chunk: float) -> CertifiedOrbit:
    f, g = by_angles(link), by_nodes(link)
    mine, theirs = y0, link.node_start(y0)
    t, pieces, bound_t, bound = 0.0, [], [0.0], [FLOOR]
    while t < t_max and bound[-1] < WORST and len(bound) < MOST_STEPS:
        span = min(chunk, t_max - t)
        piece: Any = solve_ivp(
            lambda _, y: f(y), (0.0, span), mine, "DOP853", rtol=TOLERANCE, atol=TOLERANCE, dense_output=True
        )
        if not piece.success:
            break
        for s, there in gbs_adaptive(g, theirs, span, CORRECTION, span / 64.0):
            gap = link.nodes(piece.sol(s)[: link.n])[: link.free] - there.reshape(2, -1, 2)[0]
            worst = FLOOR + SAFETY * float(np.max(np.linalg.norm(gap, axis=1)))
            bound_t.append(t + s)
            bound.append(max(bound[-1], worst))
        pieces += [(t + p.t_old, p.y_old, p.F) for p in piece.sol.interpolants]
        t, mine, theirs = t + span, piece.y[:, -1], there
    inside = int(np.searchsorted(bound, WORST))
    starts, y, F = (np.array(a) for a in zip(*pieces, strict=True))
    return CertifiedOrbit(np.append(starts, t), y, F, np.array(bound_t[:inside]), np.array(bound[:inside]))


def _read(file: Path) -> CertifiedOrbit | None:
    try:
        with np.load(file) as stored:
            return CertifiedOrbit(*(stored[name] for name in ("t", "y", "F", "bound_t", "bound")))
    except (OSError, KeyError, ValueError):  # absent, or cut short by a crash: computed anew
        return None


def _write(file: Path, orbit: CertifiedOrbit) -> None:
    """Whole or not at all, as several processes may ask for the same motion; without a place to write, not at all."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".part", delete=False) as part:
            np.savez(part, t=orbit.t, y=orbit.y, F=orbit.F, bound_t=orbit.bound_t, bound=orbit.bound)
        os.replace(part.name, file)
    except OSError:
        return
