"""Units, orders and frames that the columns of a file may have."""

import math
from dataclasses import dataclass

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
TIMES = {"s": 1.0, "ms": 1e-3}
ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
SEQUENCES = ("XYZ", "XZY", "YXZ", "ZXZ", "ZYX", "ZYZ")  # of axes that turn with the body; small: fixed in space


@dataclass(frozen=True)
class Reading:
    """Units, orders and frames of columns; each field is an option of the command line."""

    length: str = "m"  # of positions, and of velocities per second
    time: str = "s"  # of t alone
    angle: str = "rad"  # of angles and angular velocities
    quaternion: str = "wxyz"
    rotation: str = "body-to-space"
    omega: str = "body"
    euler: str = "none"  # axes of Euler angles, in the order of their columns


CHOICES: dict[str, tuple[str, ...]] = {
    "length": tuple(LENGTHS), "time": tuple(TIMES), "angle": tuple(ANGLES), "quaternion": ("wxyz", "xyzw"),
    "rotation": ("body-to-space", "space-to-body"), "omega": ("body", "space"),
    "euler": ("none", *SEQUENCES, *(x.lower() for x in SEQUENCES)),
}  # fmt: skip
