"""Motions without a formula: integrated by one route, certified by a second one (harness/reference/orbit).

Route 1 has angles as coordinates, route 2 positions, each at its rounding floor.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import States
from ...harness.reference.extrapolation import each
from ...harness.reference.orbit import SAFETY, Orbit, Pair, Piece, chunk, load_or_compute, orbit_of
from ...harness.types import ReferenceKind
from .linkage import Linkage, by_angles, by_nodes

WORST = 1e-3  # [m]
MOST_STEPS = 4000  # of route 2, about half a minute: a fast motion is certified for a shorter time
TOLERANCE = 1e-13  # route 1
CORRECTION = 1e-12  # route 2; its error is that of a higher order still
FORMAT = 1  # of the files; raise it when an equation of a route changes


@dataclass(frozen=True)
class CertifiedMotion:
    """The orbit, and the bodies on it."""

    orbit: Orbit
    bodies: Callable[[Float[np.ndarray, "nt ny"]], States]  # of states of route 1
    route: str = "minimal coordinates (DOP853), certified by positions of points (extrapolation)"

    kind: ReferenceKind = ReferenceKind.CERTIFIED

    @property
    def horizon(self) -> float:
        """End of the certificate [s]."""
        return self.orbit.horizon

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """The motion at ``t`` [s], up to the horizon."""
        return self.bodies(self.orbit(t))

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Bound [m] on the position error of any of the points, hence of any body."""
        return self.orbit.error(t)


def linkage_orbit(link: Linkage, y0: Float[np.ndarray, " coordinates"], t_max: float, span: float) -> Orbit:
    """The motion of a linkage by its angles and by its nodes."""

    def gap(y: np.ndarray, z: np.ndarray) -> float:
        apart = link.nodes(y[: link.n])[: link.free] - z.reshape(2, -1, 2)[0]
        return float(np.max(np.linalg.norm(apart, axis=1)))

    data = (link.length, link.gravity, link.end, link.rod_mass.tolist(), link.node_mass.tolist())
    pair = Pair(by_angles(link), each(by_nodes(link)), y0, link.node_start(y0), gap)
    return certified_orbit(pair, repr(("linkage", data)), t_max, span)


def certified_orbit(pair: Pair, data: str, t_max: float, span: float) -> Orbit:
    """Both routes side by side in chunks of ``span`` [s] to ``t_max`` or the end of the certificate.

    Kept on disk by their start and by ``data``, which says all else that their equations depend on.
    """
    settings = (FORMAT, SAFETY, WORST, TOLERANCE, CORRECTION, t_max, span, pair.y0.tolist(), data)
    key = hashlib.sha256(repr(settings).encode()).hexdigest()
    found = load_or_compute(key, lambda: orbit_of(_pieces(pair, t_max, span), lambda: WORST))
    if found is None:
        raise ArithmeticError("the motion cannot be integrated from its start")
    return found.until(WORST)


def _pieces(pair: Pair, t_max: float, span: float) -> Iterator[Piece]:
    t, y, z, steps = 0.0, pair.y0, pair.z0, 0
    while t < t_max and steps < MOST_STEPS:
        try:
            piece = chunk(pair, (t, y, z), min(span, t_max - t), TOLERANCE, CORRECTION)
        except ArithmeticError:
            return
        yield piece
        t, y, z, steps = piece.t, piece.y, piece.z, steps + len(piece.nodes)
