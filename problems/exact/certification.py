"""Certify motions without a formula: integrated by one route, checked by a second one (harness/reference/orbit).

Route 1 has angles as coordinates, route 2 positions, each computed to its rounding floor.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import States
from ...harness.mechanics.types import ReferenceKind
from ...harness.reference.orbit import SAFETY, Orbit, Pair, Piece, advance_routes, join_chunks, load_or_compute
from .linkage import Linkage, make_rates_by_angles, make_rates_by_nodes

WORST = 1e-3  # [m] largest certified error
MOST_STEPS = 4000  # steps of route 2, half a minute: fast motions are certified for a shorter time
TOLERANCE = 1e-13  # tolerance of route 1
CORRECTION = 1e-12  # correction allowed in route 2; the error is of higher order still
FORMAT = 1  # version of the files; raise it when an equation of a route changes


@dataclass(frozen=True)
class CertifiedMotion:
    """A certified motion: an orbit of route 1, and the function from its states to those of the bodies."""

    orbit: Orbit
    bodies: Callable[[Float[np.ndarray, "nt ny"]], States]  # from states of route 1
    route: str = "minimal coordinates (DOP853), certified by positions of points (extrapolation)"

    kind: ReferenceKind = ReferenceKind.CERTIFIED

    @property
    def horizon(self) -> float:
        """The end of the certificate [s]."""
        return self.orbit.horizon

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s], up to the horizon."""
        return self.bodies(self.orbit(t))

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a bound on the position error of any point, hence of any body [m]."""
        return self.orbit.error(t)


def certify_linkage(link: Linkage, y0: Float[np.ndarray, " coordinates"], t_max: float, span: float) -> Orbit:
    """Return the certified orbit of a linkage from ``y0``, its angles [rad] and rates [rad/s], up to ``t_max`` [s].

    It is integrated by angles and by nodes, which are compared after each chunk of ``span`` [s].
    """

    def gap(y: np.ndarray, z: np.ndarray) -> float:
        """Return the largest distance [m] between the positions of a node by the states y and z of the two routes."""
        apart = link.nodes(y[: link.n])[: link.free] - z.reshape(2, -1, 2)[0]
        return float(np.max(np.linalg.norm(apart, axis=1)))

    data = (link.length, link.gravity, link.end, link.rod_mass.tolist(), link.node_mass.tolist())
    pair = Pair(make_rates_by_angles(link), make_rates_by_nodes(link), y0, link.convert_to_nodes(y0), gap)
    return certify_orbit(pair, repr(("linkage", data)), t_max, span)


def certify_orbit(pair: Pair, data: str, t_max: float, span: float) -> Orbit:
    """Return the orbit of route 1 up to ``t_max`` [s], or to the time when the bound on its error exceeds ``WORST``.

    Both routes are integrated in chunks of ``span`` [s]. The orbit is cached on disk, by its start and by ``data``, the
    text of all other inputs of the equations. Raise ArithmeticError if no chunk can be integrated.
    """
    settings = (FORMAT, SAFETY, WORST, TOLERANCE, CORRECTION, t_max, span, pair.y0.tolist(), data)
    key = hashlib.sha256(repr(settings).encode()).hexdigest()
    found = load_or_compute(key, lambda: join_chunks(_integrate_pieces(pair, t_max, span), lambda: WORST))
    if found is None:
        raise ArithmeticError("the motion cannot be integrated from its start")
    return found.cut_at_bound(WORST)


def _integrate_pieces(pair: Pair, t_max: float, span: float) -> Iterator[Piece]:
    """Yield chunks of ``span`` [s], integrated by both routes, up to ``t_max`` [s] or ``MOST_STEPS`` steps.

    They end early if a route fails.
    """
    t, y, z, steps = 0.0, pair.y0, pair.z0, 0
    while t < t_max and steps < MOST_STEPS:
        try:
            piece = advance_routes(pair, (t, y, z), min(span, t_max - t), TOLERANCE, CORRECTION)
        except ArithmeticError:
            return
        yield piece
        t, y, z, steps = piece.t, piece.y, piece.z, steps + len(piece.nodes)
