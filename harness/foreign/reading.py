"""Poses and velocities in SI units from columns: units, order of quaternions, frames; missing rates are differenced."""

import dataclasses
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from jaxtyping import Float

from .columns import Quantities
from .conventions import Reading

SOUND = 0.01  # of the largest speed: differences of third and fifth degree must agree so far
ROUNDING = 64.0 * np.finfo(float).eps  # of positions, over a step
FEWEST = 8  # rows for a difference


class Origin(StrEnum):
    """The origin of a quantity."""

    FILE = "file"
    DIFFERENCED = "differenced"
    NONE = "none"


@dataclass(frozen=True)
class Motion:
    """Poses and velocities (nt, nb, .); None where neither the file nor differences give them."""

    t: Float[np.ndarray, " nt"]
    r: Float[np.ndarray, "nt nb 3"]
    R: Float[np.ndarray, "nt nb 3 3"] | None
    v: Float[np.ndarray, "nt nb 3"] | None
    Omega: Float[np.ndarray, "nt nb 3"] | None
    origin: dict[str, Origin]


def read_motion(found: Quantities, how: Reading, degree: int = 5) -> Motion:
    """Read the motion as ``how`` says; missing rates are those of splines of ``degree``."""
    t, has = found.factor("t", how) * found.t, found.quantities
    r = found.factor("r", how) * has["r"]
    R = read_rotations(found, how)
    v = None if "v" not in has else found.factor("v", how) * has["v"]
    Omega = read_angular_velocities(found, how, R)
    origin = {k: Origin.FILE for k, a in (("r", r), ("R", R), ("v", v), ("Omega", Omega)) if a is not None}
    if v is None and (v := differentiate(t, r, degree)) is not None:
        origin["v"] = Origin.DIFFERENCED
    if Omega is None and R is not None and (Omega := differentiate_rotations(t, R, degree)) is not None:
        origin["Omega"] = Origin.DIFFERENCED
    return Motion(t, r, R, v, Omega, {k: origin.get(k, Origin.NONE) for k in ("r", "R", "v", "Omega")})


def read_rotations(found: Quantities, how: Reading) -> Float[np.ndarray, "nt nb 3 3"] | None:
    """R, body to space; quaternions are normalised."""
    from scipy.spatial.transform import Rotation  # here: --help shows the choices above

    if "q" in found.quantities:
        q = found.quantities["q"]
        first = how.quaternion == "wxyz" or not found.numbered
        size = np.linalg.norm(q, axis=-1, keepdims=True)
        good = np.where(np.isfinite(size) & (size > 0.0), q / np.where(size > 0.0, size, 1.0), np.nan)
        R = np.full((*q.shape[:2], 3, 3), np.nan)
        known = np.all(np.isfinite(good), axis=-1)
        R[known] = Rotation.from_quat(good[known], scalar_first=first).as_matrix()
    elif "R" in found.quantities:
        R = found.quantities["R"].reshape(*found.quantities["R"].shape[:2], 3, 3)
    elif "E" in found.quantities and how.reads_euler:
        angles = found.factor("E", how) * found.quantities["E"]
        known = np.all(np.isfinite(angles), axis=-1)
        R = np.full((*angles.shape[:2], 3, 3), np.nan)
        R[known] = Rotation.from_euler(how.euler, angles[known]).as_matrix()
    else:
        return None
    return R if how.rotation == "body-to-space" else np.swapaxes(R, -1, -2)


def read_angular_velocities(
    found: Quantities, how: Reading, R: np.ndarray | None
) -> Float[np.ndarray, "nt nb 3"] | None:
    """Omega [rad/s], body frame."""
    if "Omega" not in found.quantities:
        return None
    given = found.factor("Omega", how) * found.quantities["Omega"]
    if how.omega == "body":
        return given
    return None if R is None else np.einsum("tbji,tbj->tbi", R, given)


def differentiate(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, "nt *more"], degree: int = 5) -> np.ndarray | None:
    """da/dt by splines of ``degree``; None where those of 5 and 3 disagree: the rows are too far apart."""
    from scipy.interpolate import make_interp_spline

    if len(t) < FEWEST or not np.all(np.isfinite(a)):
        return None
    fine, coarse = (make_interp_spline(t, a, k=k).derivative()(t) for k in (5, 3))
    inside = slice(2, -2)  # the ends of a spline are poorer, and the start is known
    rounding = ROUNDING * np.max(np.abs(a)) / np.min(np.diff(t))  # of what stays where it is
    sound = np.max(np.abs(fine - coarse)[inside]) <= max(SOUND * np.max(np.abs(fine)), rounding)
    return {5: fine, 3: coarse}[degree] if sound else None


def differentiate_rotations(
    t: Float[np.ndarray, " nt"], R: Float[np.ndarray, "nt nb 3 3"], degree: int = 5
) -> np.ndarray | None:
    """Omega of hat(Omega) = R^T dR/dt, or None as in ``differentiate``."""
    R_dot = differentiate(t, R, degree)
    if R_dot is None:
        return None
    W = np.swapaxes(R, -1, -2) @ R_dot
    return 0.5 * np.stack((W[..., 2, 1] - W[..., 1, 2], W[..., 0, 2] - W[..., 2, 0], W[..., 1, 0] - W[..., 0, 1]), -1)


def perturb_roundings(found: Quantities) -> Quantities:
    """The table as it might as well have been printed: each number half a unit of its last digit off, at random."""
    rng = np.random.default_rng(0)
    off = {k: a + found.resolution[k] * rng.choice((-1.0, 1.0), a.shape) for k, a in found.quantities.items()}
    return dataclasses.replace(found, quantities=off)
