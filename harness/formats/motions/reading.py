"""Convert columns with units, orders and frames to poses and velocities in SI units; missing rates are differenced."""

import dataclasses
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from jaxtyping import Float

from .columns import Quantities
from .conventions import Reading

# relative to the largest speed: rates by splines of degree 3 and 5 must agree to this. A sine needs 8 rows a period
# then, and its rates are right to 0.2 %; half: 10 rows, 0.06 %, twice: 7 rows, 0.35 %.
SOUND = 0.01
ROUNDING = 64.0 * np.finfo(float).eps  # relative rounding of a difference of positions; half, twice: the same rows
FEWEST = 8  # rows required for differences


class Origin(StrEnum):
    """The origin of a quantity: the file, differences of its poses, or none."""

    FILE = "file"
    DIFFERENCED = "differenced"
    NONE = "none"


@dataclass(frozen=True)
class Motion:
    """Poses and velocities (nt, nb, n) in SI units; None where neither the file nor differences give them."""

    t: Float[np.ndarray, " nt"]
    r: Float[np.ndarray, "nt nb 3"]
    R: Float[np.ndarray, "nt nb 3 3"] | None
    v: Float[np.ndarray, "nt nb 3"] | None
    Omega: Float[np.ndarray, "nt nb 3"] | None
    origin: dict[str, Origin]


def read_motion(found: Quantities, how: Reading, degree: int = 5) -> Motion:
    """Return the motion in SI units, from columns read as ``how`` says.

    Missing rates are those of splines of ``degree`` (5 or 3) through the poses; they are None where the rows are too
    far apart, as are rotations that the file does not have.
    """
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
    """Return R, body to space, from quaternions, matrices or Euler angles; None if the file has none to read.

    Quaternions are normalised; rotations of numbers that are not finite are NaN.
    """
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
    """Return Omega [rad/s] in the body frame; None if the file has none, or has it in space without rotations."""
    if "Omega" not in found.quantities:
        return None
    given = found.factor("Omega", how) * found.quantities["Omega"]
    if how.omega == "body":
        return given
    return None if R is None else np.einsum("tbji,tbj->tbi", R, given)


def differentiate(t: Float[np.ndarray, " nt"], a: Float[np.ndarray, "nt *more"], degree: int = 5) -> np.ndarray | None:  # noqa: F821
    """Return da/dt by splines of ``degree`` (5 or 3); None where the two degrees disagree: the rows are too far apart.

    None also if there are fewer than ``FEWEST`` rows, or values that are not finite.
    """
    from scipy.interpolate import make_interp_spline

    if len(t) < FEWEST or not np.all(np.isfinite(a)):
        return None
    fine, coarse = (make_interp_spline(t, a, k=k).derivative()(t) for k in (5, 3))
    inside = slice(2, -2)  # a spline is less accurate at its ends, and the start is known
    rounding = ROUNDING * np.max(np.abs(a)) / np.min(np.diff(t))  # of values that stay constant
    sound = np.max(np.abs(fine - coarse)[inside]) <= max(SOUND * np.max(np.abs(fine)), rounding)
    return {5: fine, 3: coarse}[degree] if sound else None


def differentiate_rotations(
    t: Float[np.ndarray, " nt"], R: Float[np.ndarray, "nt nb 3 3"], degree: int = 5
) -> np.ndarray | None:
    """Return Omega, body frame, from hat(Omega) = R^T dR/dt; None as in ``differentiate``."""
    R_dot = differentiate(t, R, degree)
    if R_dot is None:
        return None
    W = np.swapaxes(R, -1, -2) @ R_dot
    return 0.5 * np.stack((W[..., 2, 1] - W[..., 1, 2], W[..., 0, 2] - W[..., 2, 0], W[..., 1, 0] - W[..., 0, 1]), -1)


def perturb_roundings(found: Quantities) -> Quantities:
    """Return the quantities with each number moved by its resolution, up or down at random with a fixed seed."""
    rng = np.random.default_rng(0)
    off = {k: a + found.resolution[k] * rng.choice((-1.0, 1.0), a.shape) for k, a in found.quantities.items()}
    return dataclasses.replace(found, quantities=off)
