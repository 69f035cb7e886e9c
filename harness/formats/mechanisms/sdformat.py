"""Read SDFormat (1.3 to 1.12) as links and joints: poses relative to named frames, axes expressed in them, loops.

A file has one model, or a world of models without joints between them. Appearance, contacts, limits and plugins are
omitted; what is in no list of ``sdformat_words`` is an error that names the element and its line. Up to version 1.4
axes are given in the model's frame, up to 1.5 gravity is a child of ``physics``.
"""

import math
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ...mechanics.joints import JointKind
from ...mechanics.system import GROUND
from .links import HOME, Connection, Frame, Link
from .sdformat_words import IN_MODEL, IN_PHYSICS, VERSIONS, VOCABULARY
from .xml_elements import ElementRefusal, is_true, parse_xml, take_first

# defaults of the format for gravity [m/s2] and step [s]; limits beyond FAR count as absent
GRAVITY, STEP, FAR = "0 0 -9.8", "0.001", 1e15
SUFFIXES = (".sdf", ".world")
KINDS = {  # types of joints
    "revolute": JointKind.REVOLUTE,
    "continuous": JointKind.REVOLUTE,
    "prismatic": JointKind.PRISMATIC,
    "ball": JointKind.SPHERICAL,
    "fixed": JointKind.FIXED,
    "universal": JointKind.UNIVERSAL,
}


class Document:
    """The links, joints, gravity [m/s2, space] and step [s] of a file, and counts of what is omitted."""

    def __init__(self, path: Path) -> None:
        """Read the file; raise ElementRefusal, a ValueError, for what is not supported."""
        root = parse_xml(path)
        if root.tag != "sdf":
            raise ElementRefusal(root, "expected an sdf element")
        self.version = root.get("version", "").strip()
        if self.version not in VERSIONS:
            raise ElementRefusal(root, f"version must be {VERSIONS[0]} to {VERSIONS[-1]} (got {self.version!r})")
        self.omitted: Counter[str] = Counter()
        self.locked = 0  # joints that equal limits fix
        VOCABULARY.check_element(root, self.omitted)
        worlds = root.findall("world") or [root]
        if len(worlds) > 1:
            raise ElementRefusal(worlds[1], "expected one world")
        world = worlds[0]
        self.reader = f"the reader of SDFormat, version {self.version}"
        engines = world.findall("physics")
        preferred = [e for e in engines if e.get("default", "").lower() in ("true", "1")]
        engine = take_first(preferred or engines, ET.Element("physics"))
        self.gravity = self._read_gravity(world, engine)
        self.dt = _read_numbers(engine, "max_step_size", STEP, 1)[0]
        if not self.dt > 0.0:
            raise ElementRefusal(engine.findall("max_step_size")[0], f"the step must be > 0 s (got {self.dt})")
        self.links: list[Link] = []
        self.joints: list[Connection] = []
        models = world.findall("model")
        for model in models:
            _Model(self, model, f"{model.get('name')}::" if len(models) > 1 else "").add_to_document()

    def _read_gravity(self, world: ET.Element, engine: ET.Element) -> np.ndarray:
        """Return gravity [m/s2, space] of ``world`` or, in versions that have it there, of its physics ``engine``.

        Raise ElementRefusal where it is in the wrong element, or differs between the two.
        """
        inner = engine.find("gravity")
        if inner is None:
            return np.array(_read_numbers(world, "gravity", GRAVITY, 3))
        if self.version not in IN_PHYSICS:
            raise ElementRefusal(inner, f"in version {self.version} gravity is a child of world; move it there")
        found = np.array(_read_numbers(engine, "gravity", GRAVITY, 3))
        if world.find("gravity") is not None and not np.array_equal(found, _read_numbers(world, "gravity", GRAVITY, 3)):
            raise ElementRefusal(inner, "the world has another gravity; give one")
        return found


class _Model:
    """A model of the document, with its links, joints and frames by name."""

    def __init__(self, document: Document, model: ET.Element, prefix: str) -> None:
        """Collect the named elements of ``model``; count enabled wind in ``document.omitted``.

        ``prefix`` begins the names of its links and joints in the document. Raise ElementRefusal for a name that is
        missing or occurs twice.
        """
        self.document, self.model, self.prefix = document, model, prefix
        self.named: dict[str, ET.Element] = {}
        for e in (e for tag in ("link", "joint", "frame") for e in model.findall(tag)):
            if not (name := e.get("name", "")) or name in self.named:
                raise ElementRefusal(e, "links, joints and frames of a model need unique names")
            self.named[name] = e
        self.static = is_true(model, "static")
        document.omitted["wind"] += any(is_true(e, "enable_wind") for e in (model, *model.findall("link")))
        self.number: dict[str, int] = {}  # number of a link by its name

    def add_to_document(self) -> None:
        """Add the model's links and joints to the document; those of a static model belong to the ground."""
        for e in self.model.findall("link"):
            name = e.get("name", "")
            self.number[name] = GROUND if self.static else len(self.document.links)
            if not self.static:
                self.document.links.append(self._make_link(e, self.prefix + name))
        if not self.static:
            self.document.joints += [self._make_joint(e) for e in self.model.findall("joint")]

    def _make_link(self, e: ET.Element, name: str) -> Link:
        """Return the body of a link element, without velocities; refuse settings that would change its motion."""
        if not is_true(e, "gravity", "true"):
            raise ElementRefusal(e, "gravity cannot be switched off for a link")
        if is_true(e, "kinematic"):
            raise ElementRefusal(e, "kinematic links are not supported")
        inertial = e.find("inertial")
        given = ET.Element("inertial") if inertial is None else inertial
        if given.get("auto", "").lower() in ("true", "1"):
            raise ElementRefusal(given, "give mass and inertia as numbers; auto takes them from shapes")
        xx, yy, zz = (_read_numbers(given, f"inertia/i{k}", "1", 1)[0] for k in ("xx", "yy", "zz"))
        xy, xz, yz = (_read_numbers(given, f"inertia/i{k}", "0", 1)[0] for k in ("xy", "xz", "yz"))
        C = self.find_frame(e) @ _read_pose(given)
        J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return Link(name, _read_numbers(given, "mass", "1", 1)[0], J, C, np.zeros(3), np.zeros(3))

    def _make_joint(self, e: ET.Element) -> Connection:
        """Return the joint of an element with its spring and damper; a joint that limits lock is fixed.

        Dry friction and springs of joints with several axes are counted as omitted.
        """
        if e.get("type") not in KINDS:
            raise ElementRefusal(e, f"type must be one of {', '.join(KINDS)} (got {e.get('type')})")
        kind, place = KINDS[e.get("type", "")], self.find_frame(e)
        child, parent = (self._find_body(e, _read_text(e, tag, "")) for tag in ("child", "parent"))
        if child == parent:
            raise ElementRefusal(e, "child and parent are parts of one body")
        axes = [self._find_axis(e, tag, place) for tag in ("axis", "axis2")]
        if kind is JointKind.UNIVERSAL and abs(axes[0] @ axes[1]) > 1e-9:
            raise ElementRefusal(e, "the axes of a universal joint must be normal to each other")
        spring = dict.fromkeys(("spring_stiffness", "spring_reference", "damping"), 0.0)
        names = *spring, "friction"
        for axis in (a for tag in ("axis", "axis2") for a in e.findall(tag)):
            dynamics = axis.find("dynamics")
            values = {} if dynamics is None else {k: _read_numbers(dynamics, k, "0", 1)[0] for k in names}
            if self._is_locked(e, axis, kind):
                kind, values = JointKind.FIXED, {}
                self.document.locked += 1
            self.document.omitted["dry friction"] += values.pop("friction", 0.0) != 0.0
            if any(values.values()) and kind not in (JointKind.REVOLUTE, JointKind.PRISMATIC):
                self.document.omitted["springs and dampers of universal joints"] += 1
            elif values:
                spring = values
        return Connection(
            self.prefix + e.get("name", ""),
            kind,
            child,
            parent,
            place,
            place,
            axes[0],
            axes[1],
            stiffness=spring["spring_stiffness"],
            rest=spring["spring_reference"],
            damping=spring["damping"],
        )

    def _is_locked(self, e: ET.Element, axis: ET.Element, kind: JointKind) -> bool:
        """Return whether equal limits lock the ``axis`` of joint ``e``; count other limits as omitted.

        Raise ElementRefusal for a lower limit above the upper one, and for axes locked elsewhere than at 0 or of a
        universal joint.
        """
        low, high = _read_numbers(axis, "limit/lower", "-inf", 1)[0], _read_numbers(axis, "limit/upper", "inf", 1)[0]
        given, counted = axis.find("limit"), self.document.omitted
        if e.get("type") == "continuous" or kind in (JointKind.SPHERICAL, JointKind.FIXED) or given is None:
            return False
        largest = (_read_numbers(given, k, "inf", 1)[0] for k in ("effort", "velocity"))
        counted["limits of effort and speed"] += any(0.0 <= x < FAR for x in largest)
        if low > high:
            raise ElementRefusal(given, f"lower must be at most upper (got {low:g}, {high:g})")
        if low < high:
            counted["limits"] += abs(low) < FAR or abs(high) < FAR
            return False
        if low != 0.0 or kind is JointKind.UNIVERSAL:
            raise ElementRefusal(
                given,
                f"limits that lock the joint are supported for one axis, at 0 only (got {low:g}); "
                "place the child there, and use a fixed joint",
            )
        return True

    def _find_axis(self, e: ET.Element, tag: str, place: Frame) -> np.ndarray:
        """Return the axis ``tag`` of joint ``e`` as a unit vector in the joint's frame ``place``; Z by default."""
        axis = e.find(tag)
        if axis is None:
            return np.array([0.0, 0.0, 1.0])
        xyz, direction = axis.find("xyz"), np.array(_read_numbers(axis, "xyz", "0 0 1", 3))
        expressed = "" if xyz is None else xyz.get("expressed_in", "")
        if is_true(axis, "use_parent_model_frame") or self.document.version in IN_MODEL:
            expressed = "__model__"
        if expressed:
            direction = place.R.T @ self._find_named_frame(axis, expressed).R @ direction
        if not np.linalg.norm(direction) > 0.0:
            raise ElementRefusal(axis, "xyz must not be zero")
        out: np.ndarray = direction / np.linalg.norm(direction)
        return out

    def find_frame(self, e: ET.Element, seen: tuple[ET.Element, ...] = ()) -> Frame:
        """Return the frame in space of a model, link, joint or frame element.

        ``seen`` are the elements whose poses depend on this one; an element whose pose depends on itself is refused.
        """
        if e in seen:
            raise ElementRefusal(e, "its pose is relative to itself")
        pose = e.find("pose")
        given = "" if pose is None else pose.get("relative_to", "")
        if e is self.model:
            if given not in ("", "world") or e.get("placement_frame"):
                raise ElementRefusal(e, "its pose must be relative to the world")
            return _read_pose(e)
        default = {"joint": _read_text(e, "child", ""), "frame": e.get("attached_to", "")}.get(e.tag, "")
        return self._find_named_frame(e, given or default or "__model__", (*seen, e)) @ _read_pose(e)

    def _find_named_frame(self, e: ET.Element, name: str, seen: tuple[ET.Element, ...] = ()) -> Frame:
        """Return the frame in space of ``world``, ``__model__``, or of the link, joint or frame ``name``.

        ``e`` is the element that refers to it, which a refusal names; ``seen`` is as in ``find_frame``.
        """
        if name == "world":
            return HOME
        if name == "__model__":
            return self.find_frame(self.model)
        if name not in self.named:
            raise ElementRefusal(e, f"no link, joint or frame {name!r} in model {self.model.get('name')!r}")
        return self.find_frame(self.named[name], seen)

    def _find_body(self, e: ET.Element, name: str) -> int:
        """Return the number of the link to which the frame ``name`` is attached, or GROUND.

        ``e`` is the element that refers to it, which a refusal names.
        """
        for _ in self.named:
            if name == "world":
                return GROUND
            if name in self.number:
                return self.number[name]
            if name not in self.named and name != "__model__":
                raise ElementRefusal(e, f"no link, joint or frame {name!r} in model {self.model.get('name')!r}")
            holder = self.model if name == "__model__" else self.named[name]
            carrier = {"joint": _read_text(holder, "child", ""), "frame": holder.get("attached_to", "")}.get(
                holder.tag, ""
            )
            name = carrier or self.model.get("canonical_link", "") or next(iter(self.number))
        raise ElementRefusal(e, f"{name!r} is attached to itself")


def _read_text(e: ET.Element, tag: str, default: str) -> str:
    """Return the text of the child ``tag`` of ``e``, or ``default`` if it is missing or empty."""
    return (e.findtext(tag) or default).strip()


def _read_numbers(e: ET.Element, tag: str, default: str, count: int) -> list[float]:
    """Return the ``count`` numbers in the child ``tag`` of ``e``, or in ``default`` if it is missing or empty.

    They must be finite, except limits, which may be infinite. Raise ElementRefusal for any other content.
    """
    text = _read_text(e, tag, default)
    try:
        found = [float(x) for x in text.split()]
    except ValueError:
        found = []
    # a joint without limits has limits of inf
    bounded = tag not in ("limit/lower", "limit/upper", "effort", "velocity")
    if len(found) != count or not all(math.isfinite(x) if bounded else not math.isnan(x) for x in found):
        words = f"{tag} must be {count} {'finite ' * bounded}number{'s' * (count > 1)} (got {text!r})"
        raise ElementRefusal(next(iter(e.findall(tag)), e), words)
    return found


def _read_pose(e: ET.Element) -> Frame:
    """Return the pose of an element relative to the frame that it refers to; the identity if it has none.

    It has x, y, z [m], then roll, pitch, yaw [rad, or degrees] or a quaternion.
    """
    pose = e.find("pose")
    if pose is None:
        return HOME
    if pose.get("frame"):
        raise ElementRefusal(pose, "attribute 'frame' is not supported; version 1.7 has relative_to")
    quaternion = pose.get("rotation_format", "euler_rpy") == "quat_xyzw"
    count = 7 if quaternion else 6
    x = _read_numbers(e, "pose", " ".join(["0"] * count), count)
    if quaternion:
        if not any(x[3:]):
            raise ElementRefusal(pose, "a quaternion must not be zero")
        return Frame(np.array(x[:3]), Rotation.from_quat(x[3:]).as_matrix())
    degrees = pose.get("degrees", "false") in ("true", "1")
    return Frame(np.array(x[:3]), Rotation.from_euler("xyz", x[3:], degrees=degrees).as_matrix())
