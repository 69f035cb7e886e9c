"""Compute with rotations as matrices: hat, exponential, logarithm, batched over leading axes.

``R`` takes body to space, so ``R_dot = R hat(Omega)`` with ``Omega`` in the body frame (Sect. 4.2; Eq. 66 uses
the exponential because autoparallels of the SO(3) connection are rotations about a fixed axis).
SciPy is imported in functions, since it takes a third of a second, which commands that integrate nothing are spared.
"""

import numpy as np
from jaxtyping import Float

NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # the two axes that follow each, cyclically


def hat(a: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the skew matrix with ``hat(a) b = a x b``."""
    a = np.asarray(a, dtype=float)
    out = np.zeros((*a.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = a[..., 2], -a[..., 1], a[..., 0]
    return out


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a x b for vectors in the last axis; NumPy's own, equal to the bit, takes nine times as long for one."""
    return a[..., NEXT] * b[..., LAST] - a[..., LAST] * b[..., NEXT]


def exp(rotation_vector: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the rotation by ``|a|`` [rad] about ``a`` (Rodrigues; SciPy's series is exact at zero)."""
    from scipy.spatial.transform import Rotation

    a = np.asarray(rotation_vector, dtype=float)
    return Rotation.from_rotvec(a.reshape(-1, 3)).as_matrix().reshape(*a.shape, 3)


def log(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Return the rotation vector [rad] of ``R``, or of the rotation nearest to it, length in [0, pi].

    SciPy takes the nearest rotation by singular values, U V^T; the checker of bundles does the same on its own.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(*R.shape[:-2], 3)


def angular_velocity(
    a: Float[np.ndarray, "*batch 3"], rate: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Return Omega [rad/s, body] of R = exp(hat(a)) where the vector ``a`` [rad] changes at ``rate`` [rad/s].

    Omega = dexp(-a) rate, dexp(-a) = 1 - (1 - cos x)/x^2 hat(a) + (x - sin x)/x^3 hat(a)^2 with x = |a|; by series
    where x < 0.1, with an error below 1e-14.
    """
    x2 = np.sum(a * a, axis=-1, keepdims=True)
    x = np.sqrt(np.where(x2 < 1e-2, 1.0, x2))
    g = np.where(x2 < 1e-2, 0.5 - x2 / 24.0 + x2**2 / 720.0 - x2**3 / 40320.0, (1.0 - np.cos(x)) / x**2)
    h = np.where(x2 < 1e-2, 1.0 / 6.0 - x2 / 120.0 + x2**2 / 5040.0 - x2**3 / 362880.0, (x - np.sin(x)) / x**3)
    across = cross(a, rate)
    return rate - g * across + h * cross(a, across)


def dexpinv(a: Float[np.ndarray, "*batch 3"], Omega: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Return the rate [rad/s] at which the rotation vector ``a`` [rad] changes while R = R_0 exp(hat(a)) turns.

    ``Omega`` [rad/s] is the angular velocity in the body frame, R_0 any constant rotation. The rate is Omega times
    1 + hat(a)/2 + (1 - (x/2) cot(x/2))/x^2 hat(a)^2 with x = |a|, regular for x < 2 pi; by series where x < 0.1, with
    an error below 1e-14. This inverts ``angular_velocity``. Source: Munthe-Kaas (1999), Appl. Numer. Math. 29.
    """
    x2 = np.sum(a * a, axis=-1, keepdims=True)
    x = np.sqrt(np.where(x2 < 1e-2, 1.0, x2))
    h = np.where(
        x2 < 1e-2,
        1.0 / 12.0 + x2 / 720.0 + x2**2 / 30240.0 + x2**3 / 1209600.0,
        (1.0 - 0.5 * x / np.tan(0.5 * x)) / x**2,
    )
    across = cross(a, Omega)
    return Omega + 0.5 * across + h * cross(a, across)


def euler313(phi: float, theta: float, psi: float) -> Float[np.ndarray, "3 3"]:
    """Return ``R = R_Z(phi) R_X(theta) R_Z(psi)``: precession, nutation, spin [rad] (Sect. 5.1)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("ZXZ", [phi, theta, psi]).as_matrix()


def angle_between(
    R: Float[np.ndarray, "*batch 3 3"], S: Float[np.ndarray, "*batch 3 3"]
) -> Float[np.ndarray, " *batch"]:
    """Return the angle [rad] of the rotation that takes ``S`` to ``R``.

    From the chord ``|R - S|_F = 2 sqrt(2) sin(angle/2)``: exact to rounding for small angles, where the trace is not.
    """
    chord = np.linalg.norm(R - S, axis=(-2, -1)) / (2.0 * np.sqrt(2.0))
    return 2.0 * np.arcsin(np.minimum(chord, 1.0))


def orthogonality_defect(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, " *batch"]:
    """Return how far R is from orthogonal, |R^T R - I|_F: zero on SO(3)."""
    return np.linalg.norm(np.swapaxes(R, -1, -2) @ R - np.eye(3), axis=(-2, -1))
