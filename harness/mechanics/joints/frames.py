"""Unit vectors of a joint's rows, from the directions that the user gives."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

Vector = Sequence[float] | Float[np.ndarray, " 3"]


class Directions:
    """Those of one joint, of length 1 where a frame asks for them; errors name the joint."""

    def __init__(self, where: str, joint: object) -> None:
        self.where, self.joint = where, joint

    def unit(self, name: str) -> np.ndarray:
        """The direction ``name`` of length 1, or zero where the user gave none."""
        a = getattr(self.joint, name)
        return np.zeros(3) if a is None else unit(a, self.where)

    def across(self, axis: np.ndarray, end: str) -> np.ndarray | None:
        """across of body ``end``, less its part along the axis, and axis x that; None where the user gave none."""
        a = getattr(self.joint, f"across_{end}")
        return None if a is None else normals_beside(axis, a, self.where)


def blade(d: Directions) -> dict[str, np.ndarray]:
    """u = axis_i."""
    return {"u": d.unit("axis_i")}


def axis_alone(d: Directions) -> dict[str, np.ndarray]:
    """u = axis_i, n_1 = axis_j."""
    return {"u": d.unit("axis_i"), "n": d.unit("axis_j")[None]}


def normals(d: Directions) -> dict[str, np.ndarray]:
    """u = axis_i, w = across_i; n_1, n_2 normal to axis_j: across_j and axis_j x across_j, where given."""
    u, axis = d.unit("axis_i"), d.unit("axis_j")
    w, n = d.across(u, "i"), d.across(axis, "j")
    return {"u": u, "w": np.zeros(3) if w is None else w[0], "n": normals_of(axis) if n is None else n}


def tangents(d: Directions) -> dict[str, np.ndarray]:
    """u = axis_i; n_1 = axis_j, the normal of a plane, then its two tangents."""
    axis = d.unit("axis_j")
    return {"u": d.unit("axis_i"), "n": np.concatenate((axis[None], normals_of(axis)))}


def frame_ahead(d: Directions) -> dict[str, np.ndarray]:
    """u = across_i; n_1 = axis x across_j, n_2 = axis x n_1."""
    n, u = d.across(d.unit("axis_j"), "j"), d.across(d.unit("axis_i"), "i")
    assert n is not None and u is not None  # checked
    return {"u": u[0], "n": np.stack((n[1], -n[0]))}


def unit(a: Vector, where: str) -> Float[np.ndarray, " 3"]:
    """``a`` of length 1, or ValueError."""
    length = float(np.linalg.norm(a))
    if not (np.isfinite(length) and length > 0.0):
        raise ValueError(f"{where}: the axis must have a finite length > 0 (got {list(a)})")
    return np.asarray(a, dtype=float) / length


def normals_of(a: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "2 3"]:
    """Two orthonormal normals to the unit vector ``a``: the coordinate direction furthest from it starts the frame."""
    n1 = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    n1 /= np.linalg.norm(n1)
    return np.stack((n1, np.cross(a, n1)))


def normals_beside(a: Float[np.ndarray, " 3"], across: Vector, where: str) -> Float[np.ndarray, "2 3"]:
    """The part of ``across`` normal to the unit vector ``a``, of length 1, and a x that."""
    n1 = np.asarray(across, dtype=float) - (np.asarray(across, dtype=float) @ a) * a
    n1 = unit(n1, f"{where}: across, less its part along the axis")
    return np.stack((n1, np.cross(a, n1)))
