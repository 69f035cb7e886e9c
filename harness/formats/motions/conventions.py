"""List the units, orders and frames that the columns of a file may have."""

import math
import re
from dataclasses import dataclass

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
TIMES = {"s": 1.0, "ms": 1e-3}
ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
SEQUENCES = ("XYZ", "XZY", "YXZ", "ZXZ", "ZYX", "ZYZ")  # of axes that turn with the body; in lower case: fixed in space
OF_LENGTH = LENGTHS | {"km": 1e3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9}  # in headers
OF_TIME = TIMES | {"sec": 1.0, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0}
OF_ANGLE = ANGLES | {
    "°": math.pi / 180.0,
    "degree": math.pi / 180.0,
    "degrees": math.pi / 180.0,
    "radian": 1.0,
    "radians": 1.0,
    "mrad": 1e-3,
}
UNSAID = "unsaid"  # default of ``euler``: files whose only orientations are Euler angles are refused
NONE = ("", "-", "1", "--")  # spellings of no unit


@dataclass(frozen=True)
class Reading:
    """The units, orders and frames in which columns are read; each field is an option of the command line."""

    length: str = "m"  # of positions, and per second of velocities
    time: str = "s"  # of t alone
    angle: str = "rad"  # of angles and angular velocities
    quaternion: str = "wxyz"
    rotation: str = "body-to-space"
    omega: str = "body"
    euler: str = UNSAID  # axes of Euler angles, in the order of their columns; none: they are left out

    @property
    def reads_euler(self) -> bool:
        """True if Euler angles are read as orientations."""
        return self.euler not in (UNSAID, "none")


CHOICES: dict[str, tuple[str, ...]] = {
    "length": tuple(LENGTHS),
    "time": tuple(TIMES),
    "angle": tuple(ANGLES),
    "quaternion": ("wxyz", "xyzw"),
    "rotation": ("body-to-space", "space-to-body"),
    "omega": ("body", "space"),
    "euler": ("none", *SEQUENCES, *(x.lower() for x in SEQUENCES)),
}
USUAL = {name: str(getattr(Reading, name)) for name in CHOICES}  # choices by default
OF_QUANTITY = {  # units of a quantity, and whether they are per time
    "t": (OF_TIME, False),
    "r": (OF_LENGTH, False),
    "E": (OF_ANGLE, False),
    "v": (OF_LENGTH, True),
    "Omega": (OF_ANGLE, True),
    "q": ({}, False),
    "R": ({}, False),
}


def find_factor(unit: str, quantity: str) -> float | None:
    """Return the SI value of a unit in a header; None if it is no unit of ``quantity`` (t, r, q, R, E, v, Omega).

    A quantity without a unit has the factor 1, if ``unit`` is one of the spellings of no unit.
    """
    known, per_time = OF_QUANTITY[quantity]
    spelt = unit.strip().replace(" ", "")
    if not known:
        return 1.0 if spelt in NONE else None
    if not per_time:
        return known.get(spelt)
    if quantity == "Omega" and spelt.lower() in ("rpm", "1/min"):
        return 2.0 * math.pi / 60.0
    match = re.fullmatch(r"(\S+?)\s*(?:/\s*\(?(\w+)\)?|[\s.*·]\s*(\w+?)(?:\^?\(?-1\)?|⁻¹))", unit.strip())
    per = (match[2] or match[3]) if match else ""
    if match is None or match[1] not in known or per not in OF_TIME:
        return None
    return known[match[1]] / OF_TIME[per]


def is_unit(text: str) -> bool:
    """Return whether a field of a row is a unit, with or without brackets, or a spelling of no unit."""
    bare = text.strip().strip("[]()").strip()
    return bare in NONE or any(find_factor(bare, quantity) is not None for quantity in OF_QUANTITY)
