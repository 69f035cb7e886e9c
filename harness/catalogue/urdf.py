"""The part of reading URDF that is not MuJoCo's: one vocabulary, locked joints, messages in the format's own terms."""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .xml_elements import Refusal, Vocabulary, parse, words

LIMITED = ("revolute", "prismatic")
VOCABULARY = Vocabulary(
    children={
        "robot": words("link joint"), "link": words("inertial"), "inertial": words("origin mass inertia"),
        "joint": words("origin parent child axis dynamics limit mimic"),
    },
    attributes={
        "robot": words("name version"), "link": words("name type"), "joint": words("name type"),
        "origin": words("xyz rpy"), "mass": words("value"), "inertia": words("ixx ixy ixz iyy iyz izz"),
        "parent": words("link"), "child": words("link"), "axis": words("xyz rpy"),
        "dynamics": words("damping friction"),
        "limit": words("lower upper effort velocity acceleration deceleration jerk"),
        "mimic": words("joint multiplier offset"),
    },
    named={
        "gazebo": "extensions for Gazebo", "transmission": "transmissions", "sensor": "sensors",
        "safety_controller": "safety controllers", "contact": "settings of contacts", "ros2_control": "controllers",
        "joint_properties": "joint_properties of old versions",
    },
    ignored=words("material mujoco visual collision calibration self_collision_checking frame collision_filter_group"),
)  # fmt: skip


class Document:
    """A URDF whose words are known; ``text`` is what MuJoCo reads of it, none where it reads the file itself."""

    def __init__(self, path: Path) -> None:
        self._root = parse(path)
        if self._root.tag != "robot":
            raise Refusal(self._root, "expected a robot element")
        self.omitted: Counter[str] = Counter()
        for e in self._root.iter():
            if e.tag.startswith("xacro:"):
                raise Refusal(e, "a macro of xacro; expand the file first: xacro FILE > robot.urdf")
        VOCABULARY.check(self._root, self.omitted)
        for e in self._root.findall("joint/axis"):
            if e.get("rpy", "").split() and set(e.get("rpy", "")) - set("0. +-\t\n"):
                raise Refusal(e, f"attribute 'rpy' is not taken over (got {e.get('rpy')!r}); turn the joint's origin")
        self._links = {e.get("name", ""): e for e in self._root.findall("link")}
        self._joints = self._root.findall("joint")
        self.text = ""
        for joint in self._joints:
            if (mimic := joint.find("mimic")) is not None:
                raise Refusal(mimic, f"joint {joint.get('name')!r} is coupled to {mimic.get('joint')!r}, which is not "
                              "taken over; remove the mimic to leave both free, or make one of them fixed")  # fmt: skip
            if self._is_locked(joint):
                joint.set("type", "fixed")
                self.text = "locked"
        if self.text:
            self.text = ET.tostring(self._root, encoding="unicode")
        self._check_masses()

    def explain(self, message: str) -> str:
        """MuJoCo's message in terms of the file where it is about an inertia."""
        for name, link, J in self._inertias():
            a, b, c = np.linalg.eigvalsh(J)
            if a < 0.0 or a + b < c:
                said = f"its principal moments are {a:.6g}, {b:.6g} and {c:.6g} kg m2"
                law = "negative" if a < 0.0 else f"the largest by {c - a - b:.3g} more than the other two together"
                raise Refusal(
                    link, f"no rigid body has the inertia of {name!r}: {said}, {law}; correct its six numbers"
                )
        return message

    def _is_locked(self, joint: ET.Element) -> bool:
        """Whether the limits of a joint are equal; without either it is free, and said to be."""
        limit = joint.find("limit")
        if joint.get("type") not in LIMITED:
            return False
        if limit is None or not {"lower", "upper"} & {*limit.keys()}:
            self.omitted["joints without lower and upper limit, which are free here"] += 1
            return False
        low, high = (_number(limit, k) for k in ("lower", "upper"))
        if low > high:
            raise Refusal(limit, f"lower must be at most upper (got {low:g}, {high:g})")
        if low == high != 0.0:
            raise Refusal(limit, f"limits that lock joint {joint.get('name')!r} are taken over at 0 (got {low:g}); "
                          "place the child there, and use a fixed joint")  # fmt: skip
        return low == high

    def _check_masses(self) -> None:
        """Refusal of links that a joint moves and that have no mass, not even of links fixed to them."""
        parent = {e.get("link", ""): joint for joint in self._joints for e in joint.findall("child")}

        def carrier(name: str) -> str:
            for _ in self._links:
                if name not in parent or parent[name].get("type") != "fixed":
                    break
                name = next((e.get("link", "") for e in parent[name].findall("parent")), "")
            return name

        mass = Counter[str]()
        for name, link in self._links.items():
            given = link.find("inertial/mass")
            mass[carrier(name)] += 0.0 if given is None else _number(given, "value")  # type: ignore[assignment]
        for name, joint in parent.items():
            if joint.get("type") != "fixed" and name in self._links and not mass[name] > 0.0:
                raise Refusal(self._links[name], f"joint {joint.get('name')!r} moves it and it has no mass; give it an "
                              "inertial with mass and inertia")  # fmt: skip

    def _inertias(self) -> Iterator[tuple[str, ET.Element, np.ndarray]]:
        for name, link in self._links.items():
            if (e := link.find("inertial/inertia")) is not None:
                x = {k: _number(e, k) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
                yield name, e, np.array([[x["ixx"], x["ixy"], x["ixz"]], [x["ixy"], x["iyy"], x["iyz"]],
                                         [x["ixz"], x["iyz"], x["izz"]]])  # fmt: skip


def _number(e: ET.Element, name: str) -> float:
    text = e.get(name, "0")
    try:
        return float(text)
    except ValueError:
        raise Refusal(e, f"{name} must be a number (got {text!r})") from None
