"""Inertia lent to bodies that have none about some axis, slender rods and point masses, so that M has an inverse.

Where joints let such an axis turn (module ``zero_inertia``), a solver takes back what was lent: with M' = M + P it
solves ``M' a - A^T lam = f + P a`` by conjugate gradients with the factor of M', and M itself is that of the result.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

NONE = 1e-14  # of the largest principal inertia: what rounding leaves of none
SHARE = 1e-2  # lent, of a rod's other principal inertias, of m arm^2 of a point mass
ROUNDS = 3  # of conjugate gradients, the second from what rounding left of the first
PASSES = 100  # in a round: more than any system here has axes without inertia that turn
ROUNDING = 1e-15  # of a, in what is left
STILL = 1e-9  # of a: less than that is rounding where M' is all that is lent
SINGULAR = 1e-12  # of M', in M


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
    """(a, whatever comes with it) of ``solve(load)``, whose mass is M', at the load ``push(a)`` = P a, as (*nt, nb, m).

    a - K a = solve(0), with K symmetric in the product x . P y: conjugate gradients, as many passes as P has rank, to
    rounding. P need be positive only on changes that the joints allow, as in natural coordinates.
    """
    found = solve(0.0)
    first = a = found[0]
    if not np.any(push(a)):
        return found
    mixed = np.cos(1.0 + np.arange(a.shape[-1])) + 0.0 * a
    idle = np.abs(_product(mixed, push(mixed))) * np.max(a**2, axis=(-2, -1), keepdims=True)
    for n in range(ROUNDS):
        found = solve(push(a))
        left = p = found[0] - a
        size = _product(left, push(left))
        if not np.any(active := size > ROUNDING**2 * (idle + np.abs(_product(a, push(a))))):
            return found
        much = size > STILL**2 * (idle + np.abs(_product(a, push(a))))
        if n and not np.any(much):
            return found
        for _ in range(PASSES):
            q = p - (solve(push(p))[0] - first)
            along = _product(p, push(q))
            turns = along > SINGULAR * _product(p, push(p))
            if np.any(active & much & ~turns):
                raise ArithmeticError("M is singular on the velocities that the joints allow")
            active &= turns
            share = np.divide(size, along, out=np.zeros_like(size), where=active)
            a, left = a + share * p, left - share * q
            new = _product(left, push(left))
            active &= new > ROUNDING**2 * (idle + np.abs(_product(a, push(a))))
            active &= much | (new < size)
            much &= new > STILL**2 * (idle + np.abs(_product(a, push(a))))
            if not np.any(active):
                break
            p = left + np.divide(new, size, out=np.zeros_like(size), where=active) * p
            size = new
    return solve(push(a))


def _product(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.sum(x * y, axis=(-2, -1), keepdims=True)
