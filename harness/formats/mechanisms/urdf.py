"""Prepare URDF for MuJoCo, which reads the rest: check its vocabulary and numbers, fix locked joints, explain errors.

MuJoCo gets only what is known here. Shapes are omitted: from them it would compute the mass of a link without inertial,
which a URDF does not mean.
"""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...mechanics.added_inertia import NONE
from .mujoco_bodies import ROUNDED
from .xml_elements import ElementRefusal, Vocabulary, parse_xml, split_words

LIMITED = ("revolute", "prismatic")  # types of joints that have limits
KINDS = (*LIMITED, "continuous", "fixed", "floating", "planar")
SIX = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")  # attributes of an inertia
CHANGES_MASSES = ("balanceinertia", "boundmass", "boundinertia", "settotalmass")  # attributes of MuJoCo's compiler
# redundant attributes of an inertia, and those that they must equal
TRANSPOSED = {"iyx": "ixy", "izx": "ixz", "izy": "iyz"}
VOCABULARY = Vocabulary(
    children={
        "robot": split_words("link joint"),
        "link": split_words("inertial"),
        "inertial": split_words("origin mass inertia"),
        "joint": split_words("origin parent child axis dynamics limit mimic"),
    },
    attributes={
        "robot": split_words("name version"),
        "link": split_words("name type"),
        "joint": split_words("name type"),
        "origin": split_words("xyz rpy"),
        "mass": split_words("value"),
        "inertia": split_words("ixx ixy ixz iyy iyz izz iyx izx izy"),
        "parent": split_words("link"),
        "child": split_words("link"),
        "axis": split_words("xyz rpy"),
        "dynamics": split_words("damping friction"),
        "limit": split_words(
            "lower upper effort velocity acceleration deceleration jerk command_effort current gear_velocity"
        ),
        "mimic": split_words("joint multiplier offset"),
    },
    named={
        "gazebo": "extensions for Gazebo",
        "transmission": "transmissions",
        "sensor": "sensors",
        "safety_controller": "safety controllers",
        "contact": "settings of contacts",
        "ros2_control": "controllers",
        "joint_properties": "joint_properties of old versions",
        "controller_gains": "controllers",
        "traits": "traits of joints",
        "link gravity": "flags of gravity",
        "link kinematic": "flags of kinematic links",
        "collision": "colliding geoms",
        "dynamics D": "attributes D of dynamics",
        "dynamics K": "attributes K of dynamics",
        "dynamics mu_coulomb": "attributes mu_coulomb of dynamics",
        "dynamics mu_viscous": "attributes mu_viscous of dynamics",
    },
    ignored=split_words(
        "material mujoco visual calibration self_collision_checking frame collision_filter_group "
        "collision_checking self_filter audio_source"
    )
    | {"joint dont_collapse", "link concave"},
)


class UrdfDocument:
    """A URDF that has been checked; ``text`` is the part of it that MuJoCo reads."""

    def __init__(self, path: Path) -> None:
        """Read and check the file; raise ElementRefusal, a ValueError, for what is not supported."""
        self._root = parse_xml(path)
        if self._root.tag != "robot":
            raise ElementRefusal(self._root, "expected a robot element")
        self.omitted: Counter[str] = Counter()
        for e in self._root.iter():
            if e.tag.startswith("xacro:"):
                raise ElementRefusal(e, "a macro of xacro; expand the file first: xacro FILE > robot.urdf")
        VOCABULARY.check_element(self._root, self.omitted)
        for e in self._root.findall("joint/axis"):
            if e.get("rpy", "").split() and set(e.get("rpy", "")) - set("0. +-\t\n"):
                raise ElementRefusal(
                    e, f"attribute 'rpy' is not supported (got {e.get('rpy')!r}); turn the joint's origin"
                )
        for e in self._root.findall("mujoco/compiler"):
            for name in CHANGES_MASSES:
                if e.get(name, "false").strip() not in ("false", "0", "-1"):
                    raise ElementRefusal(
                        e, f"attribute {name!r} changes masses or inertias that the links state; remove it"
                    )
        self._links = {e.get("name", ""): e for e in self._root.findall("link")}
        self._joints = self._root.findall("joint")
        self._check_elements()
        self.locked = 0  # joints that equal limits fix
        for joint in self._joints:
            if (mimic := joint.find("mimic")) is not None:
                raise ElementRefusal(
                    mimic,
                    f"joint {joint.get('name')!r} is coupled to {mimic.get('joint')!r}, which is not "
                    "supported; remove the mimic to leave both free, or make one of them fixed",
                )
            if self._is_locked(joint):
                joint.set("type", "fixed")
                self.locked += 1
        self._parent = {_read_end(joint, "child"): joint for joint in self._joints}
        self._check_masses()
        nested = self._find_nested_floating_joint()
        self.fuses = nested is not None  # MuJoCo frees only links of the ground: fixed links must then be merged
        if nested is not None:
            self._check_massless_links(nested)
        self.text = self._format_reduced()

    @property
    def at_rest(self) -> str:
        """The reason why nothing moves, in terms of the file."""
        if self.locked:
            return f"limits that are equal and 0 lock its joints ({self.locked})"
        return "its first link is fixed to the ground; a joint of type floating between two links frees the second"

    def _check_elements(self) -> None:
        """Raise ElementRefusal for links, joints and inertials that no URDF may have.

        These are names and parts that are missing or repeated, invalid numbers, joints of an unknown type or with links
        that are not in the file, and a link with a second parent.
        """
        for kind in ("link", "joint"):
            named = Counter(e.get("name") for e in self._root.findall(kind))
            for e in self._root.findall(kind):
                if not e.get("name") or named[e.get("name")] > 1:
                    raise ElementRefusal(e, f"expected a unique name (got {e.get('name')!r})")
        for e in self._root.iter():
            for tag in ("inertial", "origin", "mass", "inertia", "parent", "child", "axis", "limit", "dynamics"):
                if len(same := e.findall(tag)) > 1 and e.tag in ("link", "joint", "inertial"):
                    raise ElementRefusal(same[1], f"expected one in its {e.tag} (got {len(same)})")
        for e in self._root.findall("link/inertial"):
            for tag in {"mass", "inertia"} - {part.tag for part in e}:
                raise ElementRefusal(e, f"expected mass and inertia (got no {tag})")
            _read_number(e.findall("mass")[0], "value", required=True)
            inertia = e.findall("inertia")[0]
            six = {k: _read_number(inertia, k, required=True) for k in SIX}
            for name, twin in TRANSPOSED.items():
                if name in inertia.attrib and _read_number(inertia, name) != six[twin]:
                    raise ElementRefusal(
                        inertia, f"{name} must be {twin} (got {inertia.get(name)}, {inertia.get(twin)})"
                    )
        for e in (
            *self._root.findall("link/inertial/origin"),
            *self._root.findall("joint/origin"),
            *self._root.findall("joint/axis"),
        ):
            for name in {"xyz", "rpy"} & {*e.keys()}:
                _require_vector(e, name)
        for joint in self._joints:
            if joint.get("type") not in KINDS:
                raise ElementRefusal(joint, f"type must be one of {', '.join(KINDS)} (got {joint.get('type')!r})")
            for what in ("parent", "child"):
                if not (link := _read_end(joint, what)):
                    raise ElementRefusal(joint, f"expected <{what} link=.../>")
                if link not in self._links:
                    raise ElementRefusal(joint, f"its {what}, {link!r}, is no link of the file")
            same = [j for j in self._joints if _read_end(j, "child") == _read_end(joint, "child")]
            if len(same) > 1:
                raise ElementRefusal(
                    same[1],
                    f"link {_read_end(joint, 'child')!r} has a parent already, by joint "
                    f"{same[0].get('name')!r}; a URDF is a tree",
                )

    def _find_root_link(self) -> str:
        """Return the name of the only link without a parent; raise ElementRefusal if there is none or more than one."""
        roots = [name for name in self._links if name not in self._parent]
        if len(roots) != 1:
            raise ElementRefusal(self._root, f"expected one link without a parent (got {', '.join(roots) or 'none'})")
        return roots[0]

    def _find_nested_floating_joint(self) -> ET.Element | None:
        """Return the first floating joint whose parent is a link other than the root; None if there is none."""
        floating = (j for j in self._joints if j.get("type") == "floating")
        return next((j for j in floating if _read_end(j, "parent") != self._find_root_link()), None)

    def _check_massless_links(self, nested: ET.Element) -> None:
        """Raise ElementRefusal for a link with inertia but no mass, since merging fixed links would lose its inertia.

        ``nested`` is the floating joint for which they are merged, which the message names.
        """
        for name, link in self._links.items():
            mass, inertia = (link.find(f"inertial/{tag}") for tag in ("mass", "inertia"))
            if mass is None or inertia is None or _read_number(mass, "value") != 0.0:
                continue
            if any(_read_number(inertia, k) for k in SIX):
                raise ElementRefusal(
                    link,
                    f"{name!r} has inertia and no mass, which is not supported beside joint "
                    f"{nested.get('name')!r}; give it some",
                )

    def _format_reduced(self) -> str:
        """Return the file as text without shapes and other omitted parts, and without inertials of links at rest.

        The root link gets the name ``world``, unless a link has it.
        """
        out = ET.Element(self._root.tag, dict(self._root.attrib))
        for e in self._root:
            if e.tag == "mujoco":
                out.append(e)
            elif e.tag in ("link", "joint"):
                own = ET.SubElement(out, e.tag, dict(e.attrib))
                moves = e.tag == "joint" or self._find_carrier(e.get("name", "")) in self._parent
                own.extend(part for part in e if moves and part.tag in VOCABULARY.children[e.tag])
        root = self._find_root_link()
        if "world" not in self._links:  # MuJoCo's name of the ground
            for e in out.iter():
                if e.get("name") == root and e.tag == "link":
                    e.set("name", "world")
                elif e.get("link") == root:
                    e.set("link", "world")
        for e in out.iter():
            for name, value in e.attrib.items():
                e.set(name, " ".join(value.split()))
        return ET.tostring(out, encoding="unicode")

    def explain_error(self, message: str) -> str:
        """Return MuJoCo's ``message``, unless the inertia of a link explains it: raise ElementRefusal for that link."""
        for name, link, J in self._list_inertias():
            a, b, c = np.linalg.eigvalsh(J)
            if a < -NONE * c or a + b < c * (1.0 - ROUNDED):
                moments = f"its principal moments are {a:.6g}, {b:.6g} and {c:.6g} kg m2"
                excess = f"the largest by {c - a - b:.3g} more than the other two together"
                violation = "negative" if a < -NONE * c else excess
                raise ElementRefusal(
                    link, f"no rigid body has the inertia of {name!r}: {moments}, {violation}; correct its six numbers"
                )
        return message

    def _is_locked(self, joint: ET.Element) -> bool:
        """Return whether both limits of a joint are 0, so that they lock it.

        A joint with limits in its type but none in the file is free here, and counted as omitted. Raise ElementRefusal
        for a lower limit above the upper one, and for equal limits other than 0.
        """
        limit = joint.find("limit")
        if joint.get("type") not in LIMITED:
            return False
        if limit is None or not {"lower", "upper"} & {*limit.keys()}:
            self.omitted["joints without lower and upper limit, which are free here"] += 1
            return False
        low, high = (_read_number(limit, k) for k in ("lower", "upper"))
        if low > high:
            raise ElementRefusal(limit, f"lower must be at most upper (got {low:g}, {high:g})")
        if low == high != 0.0:
            raise ElementRefusal(
                limit,
                f"limits that lock joint {joint.get('name')!r} are supported at 0 only (got {low:g}); "
                "place the child there, and use a fixed joint",
            )
        return low == high

    def _check_masses(self) -> None:
        """Raise ElementRefusal for a link that a joint moves and that, with all links fixed to it, has no mass."""
        mass = Counter[str]()
        for name, link in self._links.items():
            given = link.find("inertial/mass")
            mass[self._find_carrier(name)] += 0.0 if given is None else _read_number(given, "value")  # type: ignore[assignment]
        for name, joint in self._parent.items():
            if joint.get("type") != "fixed" and not mass[name] > 0.0:
                raise ElementRefusal(
                    self._links[name],
                    f"joint {joint.get('name')!r} moves it and it has no mass; give it an "
                    "inertial with mass and inertia",
                )

    def _find_carrier(self, name: str) -> str:
        """Return the link to which ``name`` is fixed, directly or by others, and which is not fixed itself.

        It is moved by a joint, or is the root of the tree.
        """
        for _ in self._links:
            if name not in self._parent or self._parent[name].get("type") != "fixed":
                break
            name = _read_end(self._parent[name], "parent")
        return name

    def _list_inertias(self) -> Iterator[tuple[str, ET.Element, np.ndarray]]:
        """Yield name, inertia element and inertia about C [kg m2] of each link that has one."""
        for name, link in self._links.items():
            if (e := link.find("inertial/inertia")) is not None:
                xx, yy, zz, xy, xz, yz = (_read_number(e, k) for k in SIX)
                yield name, e, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _read_end(joint: ET.Element, what: str) -> str:
    """Return the name of the ``what`` (parent or child) link of a joint; empty if none is named."""
    return next((e.get("link", "") for e in joint.findall(what)), "")


def _require_vector(e: ET.Element, name: str) -> None:
    """Raise ElementRefusal unless the attribute ``name`` has three finite numbers."""
    given = e.get(name, "").split()
    if len(given) != 3:
        raise ElementRefusal(e, f"{name} must be three numbers (got {e.get(name)!r})")
    for text in given:
        _parse_finite(e, name, text)


def _read_number(e: ET.Element, name: str, required: bool = False) -> float:
    """Return the attribute ``name`` as a finite number; a missing one is 0, or refused if it is ``required``."""
    if required and name not in e.attrib:
        raise ElementRefusal(e, f"expected attribute {name!r}")
    return _parse_finite(e, name, e.get(name, "0"))


def _parse_finite(e: ET.Element, name: str, text: str) -> float:
    """Return ``text``, the value of attribute ``name``, as a finite number, or raise ElementRefusal."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ElementRefusal(e, f"{name} must be a finite number (got {text!r})")
    return value
