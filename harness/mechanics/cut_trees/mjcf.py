"""Write the tree of a system as MJCF, the XML of MuJoCo: cut joints as ``connect``, the start as a key frame."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..system import GROUND
from .tree import Kind

TORSION = {"stiffness": "stiffness", "damping": "damping", "springref": "rest_angle"}  # attributes of a hinge


def write_mjcf(tree: dict[str, Any], dt: float, name: Callable[[int], str], **option: str) -> str:
    """Return a tree of ``plain.flatten_tree`` as MJCF with all digits; its key frame is called ``start``.

    ``name`` returns the name of a body by its number. ``option`` has attributes of MuJoCo's ``option`` in addition to
    gravity and the step ``dt`` [s].
    """
    top = ET.Element("mujoco")
    ET.SubElement(top, "compiler", angle="radian")
    given = {"timestep": format_numbers([dt]), "gravity": format_numbers(tree["gravity"]), **option}
    ET.SubElement(ET.SubElement(top, "option", given), "flag", contact="disable")
    parts = {GROUND: ET.SubElement(top, "worldbody")}
    for limb in tree["limbs"]:
        parts[limb["body"]] = _add_body(parts[limb["parent"]], limb, name(limb["body"]))
    tendons = ET.SubElement(top, "tendon") if tree["springs"] else top
    for k, s in enumerate(tree["springs"]):
        law = {"stiffness": s["stiffness"], "damping": s["damping"], "springlength": s["rest_length"]}
        cord = ET.SubElement(tendons, "spatial", {key: format_numbers([x]) for key, x in law.items()})
        for end in "ij":
            ET.SubElement(parts[int(s[end])], "site", name=f"spring {k} {end}", pos=format_numbers(s[f"p_{end}"]))
            ET.SubElement(cord, "site", site=f"spring {k} {end}")
    rows = ET.SubElement(top, "equality") if tree["cuts"] else top
    for cut in tree["cuts"]:
        one, two = ("world" if cut[end] == GROUND else name(cut[end]) for end in "ij")
        ET.SubElement(rows, "connect", body1=one, body2=two, anchor=format_numbers(cut["s_i"]))
    start = {"name": "start", "qpos": format_numbers(tree["start"]), "qvel": format_numbers(tree["start_velocity"])}
    ET.SubElement(ET.SubElement(top, "keyframe"), "key", start)
    ET.indent(top)
    return ET.tostring(top, encoding="unicode") + "\n"


def _add_body(parent: ET.Element, limb: dict[str, Any], name: str) -> ET.Element:
    """Add the body of ``limb`` to the element of its parent, with its joints and their spring; return its element."""
    free, R_0 = limb["kind"] == Kind.FREE.name, limb["R_0"]
    pos = limb["r"] if free else limb["s_parent"] - R_0 @ limb["s_child"]
    body = ET.SubElement(parent, "body", name=name, pos=format_numbers(pos), quat=format_quaternion(R_0))
    moments = format_numbers(limb["inertia"][[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])  # xx, yy, zz, xy, xz, yz
    ET.SubElement(body, "inertial", pos="0 0 0", mass=format_numbers([limb["mass"]]), fullinertia=moments)
    if free:
        ET.SubElement(body, "freejoint")
    if limb["kind"] == Kind.BALL.name:
        ET.SubElement(body, "joint", type="ball", pos=format_numbers(limb["s_child"]))
    for slides, axis in limb["moves"]:
        spring = limb["torsion"] or {}
        given = {"pos": limb["s_child"], "axis": axis, **{key: [spring[k]] for key, k in TORSION.items() if spring}}
        about = {key: format_numbers(numbers) for key, numbers in given.items()}
        about["type"] = "slide" if slides else "hinge"
        ET.SubElement(body, "joint", about)
    return body


def format_numbers(numbers: Iterable[float]) -> str:
    """Return numbers as the text of an XML attribute, separated by spaces, with all digits."""
    return " ".join(repr(float(x)) for x in numbers)


def format_quaternion(R: np.ndarray) -> str:
    """Return a rotation matrix as the text of its quaternion w, x, y, z."""
    return format_numbers(Rotation.from_matrix(R).as_quat(scalar_first=True))
