"""Motions of a linkage without a formula: integrated by one route, certified by a second one (harness/reference/orbit).

Route 1 has the angles of the rods as coordinates, route 2 the positions of the nodes, each at its rounding floor.
"""

import hashlib
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ...harness.reference.extrapolation import each
from ...harness.reference.orbit import SAFETY, Orbit, Pair, Piece, chunk, kept, orbit_of
from .linkage import Linkage, by_angles, by_nodes

WORST = 1e-3  # [m]
MOST_STEPS = 4000  # of route 2, about half a minute: a fast motion is certified for a shorter time
TOLERANCE = 1e-13  # route 1
CORRECTION = 1e-12  # route 2; its error is that of a higher order still
FORMAT = 1  # of the files; raise it when an equation of a route changes


def certified_orbit(link: Linkage, y0: Float[np.ndarray, " 2n"], t_max: float, span: float) -> Orbit:
    """Both routes side by side in chunks of ``span`` [s] to ``t_max`` or the end of the certificate; kept on disk."""
    key = hashlib.sha256(
        repr((FORMAT, SAFETY, WORST, TOLERANCE, CORRECTION, link.length, link.gravity, link.end, t_max, span)).encode()
    )
    for a in (link.rod_mass, link.node_mass, y0):
        key.update(np.ascontiguousarray(a, dtype=float).tobytes())

    def gap(y: np.ndarray, z: np.ndarray) -> float:
        apart = link.nodes(y[: link.n])[: link.free] - z.reshape(2, -1, 2)[0]
        return float(np.max(np.linalg.norm(apart, axis=1)))

    pair = Pair(by_angles(link), each(by_nodes(link)), y0, link.node_start(y0), gap)
    found = kept(key.hexdigest(), lambda: orbit_of(_pieces(pair, t_max, span), lambda: WORST))
    if found is None:
        raise ArithmeticError("the linkage cannot be integrated from its start")
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
