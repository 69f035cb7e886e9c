"""Operations on motions and loads of six numbers, on vectors and on rotations (compiled)."""

from typing import Any

from ..compiled.entries import compile_inline


@compile_inline
def cross(a: float, b: float, c: float, x: float, y: float, z: float) -> Any:
    """Return (a, b, c) x (x, y, z)."""
    return b * z - c * y, c * x - a * z, a * y - b * x


@compile_inline
def dot(a: Any, b: Any) -> float:
    """Return the scalar product of the arrays ``a`` and ``b`` of six numbers: the power of a load along a motion."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


@compile_inline
def put(out: Any, a: float, b: float, c: float, x: float, y: float, z: float) -> None:
    """Set the six entries of the array ``out`` to these numbers."""
    out[0], out[1], out[2], out[3], out[4], out[5] = a, b, c, x, y, z


@compile_inline
def copy_rotation(source: Any, target: Any) -> None:
    """Copy the rotation matrix ``source`` to ``target``."""
    for i in range(3):
        for k in range(3):
            target[i, k] = source[i, k]


@compile_inline
def turn_by_quaternion(s: float, x: float, y: float, z: float, R: Any) -> None:
    """Set ``R`` to the rotation matrix of the quaternion (s, x, y, z), scalar first, of any length but 0."""
    f = 2.0 / (s * s + x * x + y * y + z * z)
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - f * (y * y + z * z), f * (x * y - s * z), f * (x * z + s * y)
    R[1, 0], R[1, 1], R[1, 2] = f * (x * y + s * z), 1.0 - f * (x * x + z * z), f * (y * z - s * x)
    R[2, 0], R[2, 1], R[2, 2] = f * (x * z - s * y), f * (y * z + s * x), 1.0 - f * (x * x + y * y)
