"""Inertia lent to bodies that have none about some axis, slender rods and point masses, so that M has an inverse.

Where joints let such an axis turn (module ``zero_inertia``), a solver takes back what was lent: with M' = M + P it
solves ``M' a - A^T lam = f + P a``, the a on the right from the pass before, until a no longer changes. What is lent is
small beside the inertia that joints give, so a few passes do, and M itself is that of the result.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

NONE = 1e-14  # of the largest principal inertia: what rounding leaves of none
SHARE = 1e-2  # lent, of a rod's other principal inertias, of m arm^2 of a point mass
PASSES = 100  # enough where what is lent is two thirds of the inertia
ROUNDING = 1e-15  # of a, in its change
STILL = 1e-9  # of a: below, a change that no longer falls is rounding, too


def principal(inertia: Float[np.ndarray, "nb 3 3"]) -> tuple[np.ndarray, np.ndarray, Bool[np.ndarray, "nb 3"]]:
    """Principal inertias (nb, 3), their axes (columns, nb 3 3), and which are none."""
    values, axes = np.linalg.eigh(inertia)
    return values, axes, values <= NONE * values[:, 2:]


def lent_inertia(
    mass: Float[np.ndarray, " nb"], inertia: Float[np.ndarray, "nb 3 3"], arm: Float[np.ndarray, " nb"]
) -> Float[np.ndarray, "nb 3 3"]:
    """About the axes without inertia; ``arm`` [m] is what the inertia of a point mass is measured by."""
    values, axes, none = principal(inertia)
    size = SHARE * np.where(none[:, 2], mass * arm**2, values[:, 2])
    return (axes * (none * size[:, None])[:, None, :]) @ np.swapaxes(axes, 1, 2)


def pushed(P: Float[np.ndarray, "nb 3 3"], a: Float[np.ndarray, "*nt nb 6"]) -> Float[np.ndarray, "*nt nb 6"]:
    """P a, of accelerations (r_ddot, Omega_dot) of all bodies."""
    out = np.zeros_like(a)
    out[..., 3:] = np.einsum("bij,...bj->...bi", P, a[..., 3:])
    return out


def taken_back(
    solve: Callable[[Any], tuple[np.ndarray, Any]], push: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, Any]:
    """(a, whatever comes with it) of ``solve(load)``, whose mass is M', at the load ``push(a)`` = P a."""
    found, last = solve(0.0), np.inf
    for _ in range(PASSES):
        load = push(found[0])
        if not np.any(load):
            return found
        new = solve(load)
        change, size = (float(np.max(np.abs(a), initial=0.0)) for a in (new[0] - found[0], new[0]))
        if not change > ROUNDING * size or last <= change < STILL * size:
            return new
        found, last = new, change
    raise ArithmeticError("M is close to singular on the velocities that the joints allow")
