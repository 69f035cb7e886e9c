"""Inertia added to bodies that have none about some axis, slender rods and point masses, so that M has an inverse.

It changes nothing where the axis is not accelerated; other systems are refused (module ``zero_inertia``).
"""

import numpy as np
from jaxtyping import Bool, Float

from .fixed_order import principal_axes, product

NONE = 1e-14  # of the largest principal inertia: what rounding leaves of none
STILL = 1e-9  # of the loads: what added inertia may take of them
SHARE = 1e-2  # added, of a rod's other principal inertias, of m arm^2 of a point mass


def principal(inertia: Float[np.ndarray, "nb 3 3"]) -> tuple[np.ndarray, np.ndarray, Bool[np.ndarray, "nb 3"]]:
    """Return principal inertias (nb, 3), their axes (columns, nb 3 3), and which are none."""
    values, axes = principal_axes(inertia)
    return values, axes, values <= NONE * values[:, 2:]


def compute_added_inertia(
    mass: Float[np.ndarray, " nb"], inertia: Float[np.ndarray, "nb 3 3"], arm: Float[np.ndarray, " nb"]
) -> Float[np.ndarray, "nb 3 3"]:
    """About the axes without inertia; ``arm`` [m] is what the inertia of a point mass is measured by."""
    values, axes, none = principal(inertia)
    size = SHARE * np.where(none[:, 2], mass * arm**2, values[:, 2])
    return product(axes * (none * size[:, None])[:, None, :], np.swapaxes(axes, 1, 2))


def check_idle(
    added: Float[np.ndarray, "nb 3 3"], arm: Float[np.ndarray, " nb"], f: Float[np.ndarray, "nb 6"],
    Omega_dot: Float[np.ndarray, "nb 3"],
) -> None:  # fmt: skip
    """ValueError where the loads ``f`` accelerate added inertia: bodies do not have it. ``arm`` [m]: of forces."""
    taken = np.max(np.abs(np.einsum("bij,bj->bi", added, Omega_dot)), initial=0.0)
    size = max(np.max(np.abs(f[:, :3]) * arm[:, None], initial=0.0), np.max(np.abs(f[:, 3:]), initial=0.0))
    if taken > STILL * size:
        raise ValueError("a body is accelerated about an axis without inertia: give it some there")
