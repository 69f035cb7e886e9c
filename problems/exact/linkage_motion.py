"""Certify the planar motion of bodies that form a linkage of rods (module ``linkage``)."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.state import State, States
from .certification import CertifiedMotion, certify_linkage
from .linkage import Linkage

MOST_RODS = 30  # about ten seconds; each evaluation costs n^3
CHUNK = 0.25  # [s] span between comparisons of the two routes
PLANE_XY = np.eye(3)  # a plane of ``find_planar_angles``: that of x and y in space
PLANAR = 1e-12  # [1], [rad/s] rounding of a start rotated to its own frame; a perturbed start exceeds it

Bodies = Callable[[Float[np.ndarray, "nt n"], Float[np.ndarray, "nt n"]], States]  # angles [rad], rates [rad/s]


def certify_linkage_motion(
    link: Linkage, angle: Float[np.ndarray, " n"], rate: Float[np.ndarray, " n"], t_max: float, bodies: Bodies
) -> CertifiedMotion | None:
    """Return the certified motion from these angles [rad] and rates [rad/s] up to ``t_max`` [s].

    Return None for more than ``MOST_RODS`` rods, which would take minutes. ``bodies`` converts angles and rates of the
    rods to states of the problem's bodies.
    """
    if link.n > MOST_RODS:
        return None
    orbit = certify_linkage(link, np.concatenate((angle, rate)), t_max, CHUNK)
    return CertifiedMotion(orbit, lambda y: bodies(y[:, : link.n], y[:, link.n :]))


def find_planar_angles(
    start: State, plane: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, " nb"], Float[np.ndarray, " nb"]] | None:
    """Return angle [rad] and rate [rad/s] of each body's x axis in a plane; None if ``start`` is not planar.

    ``plane`` has the plane's x, y and normal [space] as columns. The start is planar if x axes and velocities lie in
    the plane, and the bodies turn about its normal, up to ``PLANAR``.
    """
    along = start.R[:, :, 0] @ plane
    omega = np.einsum("bij,bj->bi", start.R, start.Omega) @ plane
    if max(np.max(np.abs(along[:, 2])), np.max(np.abs(omega[:, :2])), np.max(np.abs(start.v @ plane[:, 2]))) > PLANAR:
        return None
    return np.arctan2(along[:, 1], along[:, 0]), omega[:, 2]
