"""Check the data of a system; raise ValueError that names the part."""

import math
from collections.abc import Mapping
from numbers import Real

import numpy as np

from .added_inertia import NONE


def freeze_array(values: object, shape: tuple[int, ...], dtype: type = np.float64) -> np.ndarray:
    """Return ``values`` as a read-only array of the given shape; raise ValueError unless all numbers are finite."""
    array: np.ndarray = np.array(values, dtype=dtype).reshape(shape)
    if array.dtype == np.float64 and not np.all(np.isfinite(array)):
        raise ValueError(f"system data must be finite numbers (got {array[~np.isfinite(array)][0]})")
    array.setflags(write=False)
    return array


def check_body(name: str, mass: float, inertia: np.ndarray) -> None:
    """Raise ValueError, naming the body, unless mass [kg] and inertia [kg m2] are those of some mass distribution.

    Slender rods and point masses, which have no inertia about some axis, are accepted.
    """
    if not (np.isfinite(mass) and mass > 0.0):
        raise ValueError(f"{name}: mass must be finite and > 0 kg (got {mass})")
    J = np.asarray(inertia, dtype=float)
    if J.shape != (3, 3) or not np.all(np.isfinite(J)) or np.any(np.abs(J - J.T) > 1e-12 * np.abs(J.T)):
        raise ValueError(f"{name}: inertia must be a finite symmetric 3 x 3 matrix (got {J.tolist()})")
    principal = np.linalg.eigvalsh(J)
    if principal[0] < -NONE * principal[2]:
        raise ValueError(f"{name}: principal inertias must be >= 0 kg m2 (got {principal.tolist()})")
    if principal[2] > (principal[0] + principal[1]) * (1.0 + 1e-9):  # law of mass distributions; slack for rounding
        raise ValueError(
            f"{name}: no mass distribution has the principal inertias {principal.tolist()} kg m2 "
            "(the largest exceeds the sum of the others)"
        )


VECTORS = (
    "gravity",
    "s_i",
    "s_j",
    "p_i",
    "p_j",
    "point",
    "force",
    "torque",
    "axis_i",
    "axis_j",
    "across_i",
    "across_j",
)


NUMBERS = ("rest_angle", "turns")  # others are checked with their limits


def check_vectors(where: str, parts: Mapping[str, object]) -> None:
    """Raise ValueError where a point or direction is not three finite numbers, or an angle is not finite.

    ``parts`` are the fields of a joint or force by name; ``where`` names it in messages.
    """
    for name, value in parts.items():
        if name in NUMBERS and not (isinstance(value, Real) and math.isfinite(value)):
            raise ValueError(f"{where}: {name} must be a finite number (got {value!s:.60})")
        if name not in VECTORS or value is None:
            continue
        try:
            numbers = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            numbers = np.zeros(0)
        if numbers.shape != (3,):
            raise ValueError(f"{where}: {name} must be three numbers (got {value!s:.60})")
        if not np.all(np.isfinite(numbers)):
            raise ValueError(f"{where}: {name} must be finite (got {numbers.tolist()})")


def check_ends(where: str, i: int, j: int, nb: int) -> None:
    """Raise ValueError unless the ends ``i`` and ``j`` are two of ``nb`` bodies, or one and the ground (-1)."""
    if not (0 <= i < nb and -1 <= j < nb and i != j):
        raise ValueError(f"{where}: expected body i in 0..{nb - 1} and j another body or -1, the ground (got {i}, {j})")
