"""Compute the unit vectors of a joint's rows from the directions that the user gives."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..so3 import cross

Vector = Sequence[float] | Float[np.ndarray, " 3"]


class Directions:
    """The directions that the user gives one joint, as unit vectors; errors name the joint."""

    def __init__(self, where: str, joint: object) -> None:
        self.where, self.joint = where, joint

    def unit(self, name: str) -> np.ndarray:
        """Return the user's direction ``name`` (``axis_i``, ...) of length 1, or zero where none is given."""
        a = getattr(self.joint, name)
        return np.zeros(3) if a is None else normalise(a, self.where)

    def across(self, axis: np.ndarray, end: str) -> np.ndarray | None:
        """Return two unit vectors (rows): across_i or across_j, by ``end``, made normal to ``axis``, and axis x that.

        None if the user gave no such direction.
        """
        a = getattr(self.joint, f"across_{end}")
        return None if a is None else project_normals(axis, a, self.where)


def make_blade_frame(d: Directions) -> dict[str, np.ndarray]:
    """Return the frame of a knife edge: u = axis_i, the normal of the blade."""
    return {"u": d.unit("axis_i")}


def make_axis_frame(d: Directions) -> dict[str, np.ndarray]:
    """Return the frame of a joint with an axis in one or both bodies: u = axis_i, n_1 = axis_j."""
    return {"u": d.unit("axis_i"), "n": d.unit("axis_j")[None]}


def make_common_axis_frame(d: Directions) -> dict[str, np.ndarray]:
    """Return the frame of a common axis: u = axis_i, w = across_i, and n_1, n_2 normal to axis_j.

    n_1, n_2 are across_j and axis_j x across_j if across_j is given, else any two; w is zero without across_i.
    """
    u, axis = d.unit("axis_i"), d.unit("axis_j")
    w, n = d.across(u, "i"), d.across(axis, "j")
    return {"u": u, "w": np.zeros(3) if w is None else w[0], "n": choose_normals(axis) if n is None else n}


def make_disc_frame(d: Directions) -> dict[str, np.ndarray]:
    """Return the frame of a rolling disc: u = axis_i; n_1 = axis_j, the normal of the plane, then its two tangents."""
    axis = d.unit("axis_j")
    return {"u": d.unit("axis_i"), "n": np.concatenate((axis[None], choose_normals(axis)))}


def make_angle_frame(d: Directions) -> dict[str, np.ndarray]:
    """Return the frame of a driven angle or a rack: u = across_i; n_1 = axis x across_j, n_2 = axis x n_1."""
    n, u = d.across(d.unit("axis_j"), "j"), d.across(d.unit("axis_i"), "i")
    assert n is not None and u is not None  # checked with the joint
    return {"u": u[0], "n": np.stack((n[1], -n[0]))}


def normalise(a: Vector, where: str) -> Float[np.ndarray, " 3"]:
    """Return the direction ``a`` with length 1; raise ValueError naming ``where`` if it is zero or not finite."""
    length = float(np.linalg.norm(a))
    if not (np.isfinite(length) and length > 0.0):
        raise ValueError(f"{where}: the axis must have a finite length > 0 (got {list(a)})")
    return np.asarray(a, dtype=float) / length


def choose_normals(a: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "2 3"]:
    """Return two orthonormal normals (rows) to the unit vector ``a``, from the coordinate axis furthest from it."""
    n1 = cross(a, np.eye(3)[np.argmin(np.abs(a))])
    n1 /= np.linalg.norm(n1)
    return np.stack((n1, cross(a, n1)))


def project_normals(a: Float[np.ndarray, " 3"], across: Vector, where: str) -> Float[np.ndarray, "2 3"]:
    """Return two unit vectors (rows): the part of ``across`` normal to the unit vector ``a``, and a x that.

    Raise ValueError, which names ``where``, if ``across`` is along ``a``.
    """
    n1 = np.asarray(across, dtype=float) - (np.asarray(across, dtype=float) @ a) * a
    n1 = normalise(n1, f"{where}: across, less its part along the axis")
    return np.stack((n1, cross(a, n1)))
