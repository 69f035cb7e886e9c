"""SDFormat (1.5 to 1.12) as links and joints: poses relative to named frames, axes expressed in them, loops.

A file holds one model, or a world of models without joints between them. Looks, contacts, limits and plugins are
left out; elements that would change which motions are possible are an error that names the element and its line.
"""

import math
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from ..mechanics.joints import JointKind
from ..mechanics.system import GROUND
from .links import HOME, Connection, Frame, Link

GRAVITY, STEP, FAR = "0 0 -9.8", "0.001", 1e15  # the format's own defaults; limits beyond FAR are none
KINDS = {
    "revolute": JointKind.REVOLUTE, "continuous": JointKind.REVOLUTE, "prismatic": JointKind.PRISMATIC,
    "ball": JointKind.SPHERICAL, "fixed": JointKind.FIXED, "universal": JointKind.UNIVERSAL,
}  # fmt: skip
COUNTED = {"plugin": "plugins", "collision": "collision shapes", "state": "states", "velocity_decay": "velocity decays",
           "gripper": "grippers", "sensor": "sensors"}  # fmt: skip
READ = {  # what an element may hold beside what is counted; others are refused
    "world": "model gravity physics light scene gui magnetic_field atmosphere spherical_coordinates wind audio road",
    "model": "link joint frame pose static self_collide allow_auto_disable enable_wind",
    "link": "pose inertial visual self_collide kinematic gravity enable_wind must_be_base_link light projector battery "
            "audio_sink audio_source particle_emitter",
    "inertial": "pose mass inertia",
    "joint": "parent child pose axis axis2 physics",
    "axis": "xyz dynamics limit use_parent_model_frame",
    "dynamics": "damping friction spring_reference spring_stiffness",
}  # fmt: skip


class _Element(ET.Element):
    """An element that knows its line."""

    line = 0


class Refusal(ValueError):
    """An element that is not taken over."""

    def __init__(self, e: ET.Element, words: str) -> None:
        name = f" name={e.get('name')!r}" if e.get("name") else ""
        super().__init__(f"line {getattr(e, 'line', 0)}: <{e.tag}{name}>: {words}")


class Document:
    """Links, joints, gravity and step of a file."""

    def __init__(self, path: Path) -> None:
        root = _parse(path)
        if root.tag != "sdf":
            raise Refusal(root, "expected an sdf element")
        worlds = root.findall("world") or [root]
        if len(worlds) > 1:
            raise Refusal(worlds[1], "expected one world")
        world = worlds[0]
        self.reader = f"the reader of SDFormat, version {root.get('version', '?')}"
        self.omitted: Counter[str] = Counter()
        if world is not root:
            self.check(world, "world")
        self.gravity = np.array(_numbers(world, "gravity", GRAVITY, 3))
        self.dt = _numbers(world, "physics/max_step_size", STEP, 1)[0]
        if not self.dt > 0.0:
            raise Refusal(world.findall("physics/max_step_size")[0], f"the step must be > 0 s (got {self.dt})")
        self.links: list[Link] = []
        self.joints: list[Connection] = []
        models = world.findall("model")
        for model in models:
            self.check(model, "model")
            _Model(self, model, f"{model.get('name')}::" if len(models) > 1 else "").read()

    def check(self, e: ET.Element, kind: str) -> None:
        """Count what is left out of an element; Refusal of what is unknown."""
        for part in e:
            if part.tag in COUNTED:
                self.omitted[COUNTED[part.tag]] += 1
            elif part.tag not in READ[kind].split():
                raise Refusal(part, f"not taken over within {kind}")


class _Model:
    """A model's frames by name."""

    def __init__(self, document: Document, model: ET.Element, prefix: str) -> None:
        self.document, self.model, self.prefix = document, model, prefix
        self.named: dict[str, ET.Element] = {}
        for e in (e for tag in ("link", "joint", "frame") for e in model.findall(tag)):
            if not (name := e.get("name", "")) or name in self.named:
                raise Refusal(e, "links, joints and frames of a model need names, each its own")
            self.named[name] = e
        self.static = _text(model, "static", "false") in ("true", "1")
        self.number: dict[str, int] = {}

    def read(self) -> None:
        """Add the model's links and joints."""
        for e in self.model.findall("link"):
            self.document.check(e, "link")
            name = e.get("name", "")
            self.number[name] = GROUND if self.static else len(self.document.links)
            if not self.static:
                self.document.links.append(self._link(e, self.prefix + name))
        if not self.static:
            self.document.joints += [self._joint(e) for e in self.model.findall("joint")]

    def _link(self, e: ET.Element, name: str) -> Link:
        if _text(e, "gravity", "true") in ("false", "0"):
            raise Refusal(e, "gravity cannot be switched off for a link")
        if _text(e, "kinematic", "false") in ("true", "1"):
            raise Refusal(e, "kinematic links are not taken over")
        inertial = e.find("inertial")
        given = ET.Element("inertial") if inertial is None else inertial
        self.document.check(given, "inertial")
        if given.get("auto") in ("true", "1"):
            raise Refusal(given, "give mass and inertia as numbers; auto takes them from shapes")
        xx, yy, zz = (_numbers(given, f"inertia/i{k}", "1", 1)[0] for k in ("xx", "yy", "zz"))
        xy, xz, yz = (_numbers(given, f"inertia/i{k}", "0", 1)[0] for k in ("xy", "xz", "yz"))
        C = self.frame(e) @ _pose(given)
        J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return Link(name, _numbers(given, "mass", "1", 1)[0], J, C, np.zeros(3), np.zeros(3))

    def _joint(self, e: ET.Element) -> Connection:
        self.document.check(e, "joint")
        if e.get("type") not in KINDS:
            raise Refusal(e, f"type must be one of {', '.join(KINDS)} (got {e.get('type')})")
        kind, place = KINDS[e.get("type", "")], self.frame(e)
        child, parent = (self._body(e, _text(e, tag, "")) for tag in ("child", "parent"))
        if child == parent:
            raise Refusal(e, "child and parent are parts of one body")
        axes = [self._axis(e, tag, place) for tag in ("axis", "axis2")]
        if kind is JointKind.UNIVERSAL and abs(axes[0] @ axes[1]) > 1e-9:
            raise Refusal(e, "the axes of a universal joint must be normal to each other")
        spring = dict.fromkeys(("spring_stiffness", "spring_reference", "damping"), 0.0)
        for axis in (a for tag in ("axis", "axis2") for a in e.findall(tag)):
            dynamics = axis.find("dynamics")
            values = {} if dynamics is None else {k: _numbers(dynamics, k, "0", 1)[0] for k in (*spring, "friction")}
            if dynamics is not None:
                self.document.check(dynamics, "dynamics")
            limits = [_numbers(axis, f"limit/{k}", "inf", 1)[0] for k in ("lower", "upper")]
            self.document.omitted["limits"] += any(abs(x) < FAR for x in limits)
            self.document.omitted["dry friction"] += values.pop("friction", 0.0) != 0.0
            if any(values.values()) and kind not in (JointKind.REVOLUTE, JointKind.PRISMATIC):
                self.document.omitted["springs and dampers of universal joints"] += 1
            elif values:
                spring = values
        return Connection(
            self.prefix + e.get("name", ""), kind, child, parent, place, place, axes[0], axes[1],
            stiffness=spring["spring_stiffness"], rest=spring["spring_reference"], damping=spring["damping"],
        )  # fmt: skip

    def _axis(self, e: ET.Element, tag: str, place: Frame) -> np.ndarray:
        """A unit vector in the frame of the joint."""
        axis = e.find(tag)
        if axis is None:
            return np.array([0.0, 0.0, 1.0])
        self.document.check(axis, "axis")
        xyz, way = axis.find("xyz"), np.array(_numbers(axis, "xyz", "0 0 1", 3))
        expressed = "" if xyz is None else xyz.get("expressed_in", "")
        if _text(axis, "use_parent_model_frame", "false") in ("true", "1"):
            expressed = "__model__"
        if expressed:
            way = place.R.T @ self._frame_of(axis, expressed).R @ way
        if not np.linalg.norm(way) > 0.0:
            raise Refusal(axis, "xyz must not be zero")
        out: np.ndarray = way / np.linalg.norm(way)
        return out

    def frame(self, e: ET.Element, seen: tuple[ET.Element, ...] = ()) -> Frame:
        """The frame of a model, link, joint or frame in space."""
        if e in seen:
            raise Refusal(e, "its pose is relative to itself")
        pose = e.find("pose")
        given = "" if pose is None else pose.get("relative_to", "")
        if e is self.model:
            if given not in ("", "world") or e.get("placement_frame"):
                raise Refusal(e, "its pose must be relative to the world")
            return _pose(e)
        default = {"joint": _text(e, "child", ""), "frame": e.get("attached_to", "")}.get(e.tag, "")
        return self._frame_of(e, given or default or "__model__", (*seen, e)) @ _pose(e)

    def _frame_of(self, e: ET.Element, name: str, seen: tuple[ET.Element, ...] = ()) -> Frame:
        if name == "world":
            return HOME
        if name == "__model__":
            return self.frame(self.model)
        if name not in self.named:
            raise Refusal(e, f"no link, joint or frame {name!r} in model {self.model.get('name')!r}")
        return self.frame(self.named[name], seen)

    def _body(self, e: ET.Element, name: str) -> int:
        """The link that carries a frame."""
        for _ in self.named:
            if name == "world":
                return GROUND
            if name in self.number:
                return self.number[name]
            if name not in self.named and name != "__model__":
                raise Refusal(e, f"no link, joint or frame {name!r} in model {self.model.get('name')!r}")
            holder = self.model if name == "__model__" else self.named[name]
            carrier = {"joint": _text(holder, "child", ""), "frame": holder.get("attached_to", "")}.get(holder.tag, "")
            name = carrier or self.model.get("canonical_link", "") or next(iter(self.number))
        raise Refusal(e, f"{name!r} is attached to itself")


def _parse(path: Path) -> ET.Element:
    builder, parser = ET.TreeBuilder(element_factory=_Element), expat.ParserCreate()

    def begin(tag: str, attributes: dict[str, str]) -> None:
        builder.start(tag, attributes).line = parser.CurrentLineNumber  # type: ignore[attr-defined]

    parser.StartElementHandler, parser.EndElementHandler = begin, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(path.read_bytes(), True)
    except expat.ExpatError as error:
        raise ValueError(f"not XML: {error}") from None
    return builder.close()


def _text(e: ET.Element, tag: str, default: str) -> str:
    return (e.findtext(tag) or default).strip()


def _numbers(e: ET.Element, tag: str, default: str, count: int) -> list[float]:
    text = _text(e, tag, default)
    try:
        found = [float(x) for x in text.split()]
    except ValueError:
        found = []
    bounded = not tag.startswith("limit/")  # an endless joint has limits of inf
    if len(found) != count or not all(math.isfinite(x) if bounded else not math.isnan(x) for x in found):
        words = f"{tag} must be {count} {'finite ' * bounded}number{'s' * (count > 1)} (got {text!r})"
        raise Refusal(next(iter(e.findall(tag)), e), words)
    return found


def _pose(e: ET.Element) -> Frame:
    pose = e.find("pose")
    if pose is None:
        return HOME
    quaternion = pose.get("rotation_format", "euler_rpy") == "quat_xyzw"
    count = 7 if quaternion else 6
    x = _numbers(e, "pose", " ".join(["0"] * count), count)
    if quaternion:
        if not any(x[3:]):
            raise Refusal(pose, "a quaternion must not be zero")
        return Frame(np.array(x[:3]), Rotation.from_quat(x[3:]).as_matrix())
    degrees = pose.get("degrees", "false") in ("true", "1")
    return Frame(np.array(x[:3]), Rotation.from_euler("xyz", x[3:], degrees=degrees).as_matrix())
