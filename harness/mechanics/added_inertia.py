"""Add inertia to bodies that have none about some axis, slender rods and point masses, so that M has an inverse.

It changes nothing where the axis is not accelerated; other systems are refused (module ``zero_inertia``).
"""

import numpy as np
from jaxtyping import Bool, Float

from .fixed_order import principal_axes, product

NONE = 1e-14  # share of the largest principal inertia below which an inertia is rounding of zero
STILL = 1e-9  # share of the loads that added inertia may absorb
SHARE = 1e-2  # added share of a rod's other principal inertias, or of m arm^2 for a point mass


def find_principal_inertias(
    inertia: Float[np.ndarray, "nb 3 3"],
) -> tuple[np.ndarray, np.ndarray, Bool[np.ndarray, "nb 3"]]:
    """Return principal inertias (nb, 3) [kg m2], ascending, their axes (nb, 3, 3) as columns, and flags of zero ones.

    An inertia below ``NONE`` times the body's largest counts as zero.
    """
    values, axes = principal_axes(inertia)
    return values, axes, values <= NONE * values[:, 2:]


def compute_added_inertia(
    mass: Float[np.ndarray, " nb"], inertia: Float[np.ndarray, "nb 3 3"], arm: Float[np.ndarray, " nb"]
) -> Float[np.ndarray, "nb 3 3"]:
    """Compute the inertia [kg m2, body] to add about axes that have none; zero about all others.

    ``arm`` [m] is the longest joint arm of each body: a point mass gets ``SHARE`` of m arm^2.
    """
    values, axes, none = find_principal_inertias(inertia)
    size = SHARE * np.where(none[:, 2], mass * arm**2, values[:, 2])
    return product(axes * (none * size[:, None])[:, None, :], np.swapaxes(axes, 1, 2))


def check_added_inertia(
    added: Float[np.ndarray, "nb 3 3"],
    arm: Float[np.ndarray, " nb"],
    f: Float[np.ndarray, "nb 6"],
    Omega_dot: Float[np.ndarray, "nb 3"],
) -> None:
    """Raise ValueError where a body is accelerated about an axis of added inertia, which then changes the motion.

    ``f`` are forces [N, space] and torques [N m, body] on each body, ``Omega_dot`` [rad/s2, body] the accelerations;
    ``arm`` [m] converts forces to moments for comparison.
    """
    # [N m] moments that added inertia takes, and the largest load
    taken = np.max(np.abs(np.einsum("bij,bj->bi", added, Omega_dot)), axis=1, initial=0.0)
    size = max(np.max(np.abs(f[:, :3]) * arm[:, None], initial=0.0), np.max(np.abs(f[:, 3:]), initial=0.0))
    if np.max(taken, initial=0.0) > STILL * size:
        body = int(np.argmax(taken))
        raise ValueError(f"body {body} is accelerated about an axis without inertia: give it some there")
