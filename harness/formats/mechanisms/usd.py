"""Read USD Physics as links and joints by Pixar's library; units of the stage become SI, axes are those of space.

Joints that an articulation excludes become constraint rows like all others. Shapes, limits and materials are omitted.
Prims that would change which motions are possible, and properties in no list of ``usd_words``, are an error that names
them.
"""

import importlib
import math
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...mechanics.joints import JointKind
from ...mechanics.system import GROUND
from .links import Connection, Frame, Link
from .usd_words import TYPES, check_properties

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
SHEAR = 1e-5  # shear of a transform: more than the rounding of float32
COUPLES = re.compile(r"Joint|Mimic|Tendon|Gear|Equality")  # in names of schemas that restrict motions
KINDS = {
    "PhysicsRevoluteJoint": JointKind.REVOLUTE,
    "PhysicsPrismaticJoint": JointKind.PRISMATIC,
    "PhysicsSphericalJoint": JointKind.SPHERICAL,
    "PhysicsFixedJoint": JointKind.FIXED,
    "PhysicsDistanceJoint": JointKind.DISTANCE,
}
KNOWN = (*KINDS, "PhysicsJoint")
DRIVES = {JointKind.REVOLUTE: "angular", JointKind.PRISMATIC: "linear"}
# by the axes that limits of a PhysicsJoint leave free, with the axis
FREE: dict[tuple[str, ...], tuple[JointKind, str]] = {
    **{(f"rot{a}",): (JointKind.REVOLUTE, a) for a in "XYZ"},
    **{(f"trans{a}",): (JointKind.PRISMATIC, a) for a in "XYZ"},
    **{(f"trans{a}", f"rot{a}"): (JointKind.CYLINDRICAL, a) for a in "XYZ"},
    (): (JointKind.FIXED, "X"),
    ("rotX", "rotY", "rotZ"): (JointKind.SPHERICAL, "X"),
}
# freedoms of a PhysicsJoint
FREEDOMS = ("transX", "transY", "transZ", "rotX", "rotY", "rotZ")
LIMITED = ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint")
GRAVITY, STEP = 9.81, 1e-3  # defaults where the stage has none


class PrimRefusal(ValueError):
    """Signal a prim that is not supported."""

    def __init__(self, prim: Any, words: str) -> None:
        super().__init__(f"{prim.GetPath()}: {words}")


def list_layers(path: Path) -> tuple[Path, ...]:
    """Return the file and the other files (layers, in USD's words) of which its stage is composed."""
    stage = _open_stage(path)
    found = (Path(layer.realPath) for layer in stage.GetUsedLayers() if layer.realPath)
    return tuple(dict.fromkeys((path, *(p for p in found if p.is_file() and not p.samefile(path)))))


class Document:
    """The links, joints, gravity [m/s2, space] and step [s] of a stage, and counts of what is omitted."""

    def __init__(self, path: Path) -> None:
        """Read the stage of a file; raise PrimRefusal, a ValueError, for what is not supported."""
        self.usd, self.geom, self.physics = _import_usd()
        stage = _open_stage(path)
        self.metre = float(self.geom.GetStageMetersPerUnit(stage))
        self.kilogram = float(self.physics.GetStageKilogramsPerUnit(stage))
        for name, unit in (("metersPerUnit", self.metre), ("kilogramsPerUnit", self.kilogram)):
            if not 0.0 < unit < math.inf:
                raise ValueError(f"{name} must be finite and > 0 (got {unit:g})")
        self.reader, self.dt = f"usd-core {'.'.join(map(str, self.usd.GetVersion()[1:]))}", STEP
        self.omitted: Counter[str] = Counter()
        self.locked = 0  # joints that equal limits fix
        self._places = self.geom.XformCache()
        prims = list(stage.Traverse(self.usd.TraverseInstanceProxies()))
        up = np.eye(3)["XYZ".index(self.geom.GetStageUpAxis(stage))]
        for prim in prims:
            self._check_prim(prim)
        scenes = [p for p in prims if p.IsA(self.physics.Scene)]
        found = [self._read_gravity(self.physics.Scene(p), up) for p in scenes] or [-GRAVITY * up]
        for prim, other in zip(scenes[1:], found[1:], strict=True):
            if not np.array_equal(other, found[0]):
                raise PrimRefusal(prim, f"{scenes[0].GetPath()} has another gravity; give one scene")
        self.gravity = found[0]
        self.number = {p.GetPath(): k for k, p in enumerate(filter(self._is_body, prims))}
        self.links = [self._make_link(p) for p in prims if p.GetPath() in self.number]
        self.joints = [c for p in prims for c in self._make_joints(p)]
        self.omitted["collision shapes"] = sum(p.HasAPI(self.physics.CollisionAPI) for p in prims)

    def _check_prim(self, prim: Any) -> None:
        """Raise PrimRefusal if a prim of the mechanism has properties that are not supported; count what is omitted."""
        kind = str(prim.GetTypeName())
        if kind.startswith(("Phys", "Newton", "Mjc")) and not TYPES.match(kind):
            self.omitted[f"prims {kind}"] += not COUPLES.search(kind)  # those are refused together with their joints
        elif not (TYPES.match(kind) or prim.HasAPI(self.physics.RigidBodyAPI) or prim.HasAPI(self.physics.MassAPI)):
            return
        if words := check_properties(prim, self.omitted):
            raise PrimRefusal(prim, words)

    def _read_gravity(self, scene: Any, up: np.ndarray) -> np.ndarray:
        """Return gravity [m/s2, space] of a scene.

        A direction that it lacks is opposite to ``up``, a magnitude that it lacks is ``GRAVITY``.
        """
        direction = np.array(scene.GetGravityDirectionAttr().Get(), dtype=float)
        size = scene.GetGravityMagnitudeAttr().Get()
        direction = direction / np.linalg.norm(direction) if np.any(direction) else -up
        out: np.ndarray = direction * (GRAVITY if size < 0.0 else self.metre * size)
        return out

    def _is_body(self, prim: Any) -> bool:
        """Return whether a prim is a rigid body that can move; raise PrimRefusal for a kinematic one."""
        if not prim.HasAPI(self.physics.RigidBodyAPI):
            return False
        body = self.physics.RigidBodyAPI(prim)
        if body.GetKinematicEnabledAttr().Get():
            raise PrimRefusal(prim, "kinematic bodies are not supported")
        return bool(body.GetRigidBodyEnabledAttr().Get())

    def _make_link(self, prim: Any) -> Link:
        """Return the body of a prim in SI units; raise PrimRefusal if mass properties or velocities are not usable."""
        mass = self.physics.MassAPI(prim)
        m, moments = mass.GetMassAttr().Get() or 0.0, np.array(mass.GetDiagonalInertiaAttr().Get() or (0.0,) * 3)
        if not m > 0.0 or not np.any(moments):
            raise PrimRefusal(prim, "give physics:mass and physics:diagonalInertia; they are not computed from shapes")
        centre = np.array(mass.GetCenterOfMassAttr().Get(), dtype=float)
        if not np.all(np.isfinite(centre)):
            if any(p.HasAPI(self.physics.CollisionAPI) for p in self.usd.PrimRange(prim)):
                raise PrimRefusal(prim, "give physics:centerOfMass; it is not computed from shapes")
            centre = np.zeros(3)
        if prim.GetAttribute("physxRigidBody:disableGravity").Get():
            raise PrimRefusal(prim, "gravity cannot be switched off for a body")
        body, outside = self.physics.RigidBodyAPI(prim), self._find_frame(prim.GetParent(), np.zeros(3)).R
        C = self._find_frame(prim, centre, mass.GetPrincipalAxesAttr().Get())
        rates = (body.GetVelocityAttr(), body.GetAngularVelocityAttr())
        if not np.all(np.isfinite([a.Get() for a in rates])):
            raise PrimRefusal(prim, f"velocities must be finite (got {rates[0].Get()}, {rates[1].Get()})")
        v, omega = (outside @ np.array(a.Get(), dtype=float) for a in rates)
        unit = self.kilogram * self.metre**2
        return Link(
            str(prim.GetPath()),
            self.kilogram * m,
            unit * np.diag(moments.astype(float)),
            C,
            self.metre * v,
            np.radians(omega),
        )

    def _make_joints(self, prim: Any) -> Iterator[Connection]:
        """Yield the joint of a prim, fixed if limits lock it; nothing for no joint, a disabled one, or six freedoms."""
        kind = str(prim.GetTypeName())
        schemas = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
        for odd in filter(COUPLES.search, (kind, *schemas)):
            if odd not in KNOWN and not odd.startswith(("PhysxJointAPI", "PhysicsJointState")):
                raise PrimRefusal(prim, f"{odd} is not supported; joints are {', '.join(KNOWN)}")
        if kind not in KNOWN:
            return
        joint = self.physics.Joint(prim)
        if not joint.GetJointEnabledAttr().Get():
            self.omitted["disabled joints"] += 1
            return
        ends = [
            self._find_end(prim, *side)
            for side in (
                (joint.GetBody1Rel(), joint.GetLocalPos1Attr(), joint.GetLocalRot1Attr()),
                (joint.GetBody0Rel(), joint.GetLocalPos0Attr(), joint.GetLocalRot0Attr()),
            )
        ]
        (child, in_child), (parent, in_parent) = ends
        if child == parent:
            raise PrimRefusal(prim, "body0 and body1 are parts of one body")
        self.omitted["breakable joints"] += any(
            math.isfinite(a.Get()) for a in (joint.GetBreakForceAttr(), joint.GetBreakTorqueAttr())
        )
        sort, length, letter, drive = KINDS.get(kind), 0.0, prim.GetAttribute("physics:axis").Get() or "X", ""
        if sort is None:
            free = tuple(w for w in FREEDOMS if not self._is_axis_locked(prim, w))
            if free == FREEDOMS:
                return
            if free not in FREE:
                raise PrimRefusal(prim, f"a joint that leaves {', '.join(free)} free is not supported")
            (sort, letter), drive = FREE[free], free[0] if len(free) == 1 else ""
        elif sort in DRIVES:
            drive = DRIVES[sort]
        if letter not in ("X", "Y", "Z"):
            raise PrimRefusal(prim, f"physics:axis must be X, Y or Z (got {letter})")
        axis = np.eye(3)["XYZ".index(letter)]
        if sort is JointKind.DISTANCE:
            limits = [float(prim.GetAttribute(f"physics:{k}Distance").Get()) for k in ("min", "max")]
            if limits[0] != limits[1] or not limits[0] > 0.0:
                raise PrimRefusal(prim, f"min and maxDistance must be equal and > 0 (got {limits[0]:g}, {limits[1]:g})")
            length = self.metre * limits[0]
        elif kind in LIMITED:
            limits = [float(prim.GetAttribute(f"physics:{k}Limit").Get()) for k in ("lower", "upper")]
            if self._do_limits_lock(prim, *limits):
                sort, drive = JointKind.FIXED, ""
                self.locked += 1
            else:
                self.omitted["limits"] += any(map(math.isfinite, limits))
        elif sort is JointKind.SPHERICAL and kind in KINDS:
            cone = [prim.GetAttribute(f"physics:coneAngle{k}Limit").Get() for k in (0, 1)]
            self.omitted["limits"] += any(a is not None and math.isfinite(a) and a >= 0.0 for a in cone)
        others = [s for s in schemas if s.startswith("PhysicsDriveAPI:") and s != f"PhysicsDriveAPI:{drive}"]
        self.omitted["drives of joints with several axes"] += len(others)
        stiffness, rest, damping = self._read_drive(prim, drive) if drive else (0.0, 0.0, 0.0)
        yield Connection(
            str(prim.GetPath()), sort, child, parent, in_child, in_parent, axis, None, length, stiffness, rest, damping
        )

    def _is_axis_locked(self, prim: Any, freedom: str) -> bool:
        """Return whether limits of a PhysicsJoint lock ``freedom``, one of ``FREEDOMS``; count other limits."""
        if not prim.HasAPI(self.physics.LimitAPI, freedom):
            return False
        limit = self.physics.LimitAPI(prim, freedom)
        low, high = limit.GetLowAttr().Get(), limit.GetHighAttr().Get()
        if self._do_limits_lock(prim, low, high):
            return True
        self.omitted["limits"] += math.isfinite(low) or math.isfinite(high)
        return False

    def _do_limits_lock(self, prim: Any, low: float, high: float) -> bool:
        """Return whether limits leave no motion: both 0, or in reverse order, by which USD locks an axis.

        Raise PrimRefusal if they are equal and not 0.
        """
        if low == high != 0.0:
            raise PrimRefusal(prim, f"limits that lock a joint must be 0 (got {low:g}); place the body there")
        return low >= high

    def _read_drive(self, prim: Any, name: str) -> tuple[float, float, float]:
        """Return stiffness [N m/rad, N/m], rest [rad, m] and damping [N m s/rad, N s/m] of the drive ``name``.

        All are 0 without it. Raise PrimRefusal for drives that are not of type force or have a target velocity.
        """
        if not prim.HasAPI(self.physics.DriveAPI, name):
            return 0.0, 0.0, 0.0
        drive = self.physics.DriveAPI(prim, name)
        k, c = (float(a.Get()) for a in (drive.GetStiffnessAttr(), drive.GetDampingAttr()))
        if (k or c) and drive.GetTypeAttr().Get() != "force":
            raise PrimRefusal(prim, "drives must be of type force")
        if c and drive.GetTargetVelocityAttr().Get():
            raise PrimRefusal(prim, "drives must have no targetVelocity")
        self.omitted["limits of drives"] += math.isfinite(drive.GetMaxForceAttr().Get())
        angular = name.startswith(("angular", "rot"))
        unit = self.kilogram * (math.degrees(self.metre**2) if angular else 1.0)
        target = float(drive.GetTargetPositionAttr().Get())
        return unit * k, math.radians(target) if angular else self.metre * target, unit * c

    def _find_end(self, joint: Any, body: Any, position: Any, rotation: Any) -> tuple[int, Frame]:
        """Return the number of the body at an end of a joint, or GROUND, and the joint's frame in space as fixed to it.

        ``body``, ``position`` and ``rotation`` are the joint's relationship and attributes for this end.
        """
        targets = body.GetForwardedTargets()
        prim = joint.GetStage().GetPrimAtPath(targets[0] if targets else "/")
        if not prim:
            raise PrimRefusal(joint, f"there is no {targets[0]}")
        holder = prim
        while holder and holder.GetPath() not in self.number:
            holder = holder.GetParent()
        place = self._find_frame(prim, np.array(position.Get(), dtype=float), rotation.Get())
        return self.number[holder.GetPath()] if holder else GROUND, place

    def _find_frame(self, prim: Any, p: np.ndarray, rotation: Any = None) -> Frame:
        """Return the frame in space [m] of the point ``p`` and axes ``rotation`` (a quaternion) of a prim.

        The prim's scale applies to the point. Raise PrimRefusal if its transform is not finite, shears or mirrors.
        """
        T = np.array(self._places.GetLocalToWorldTransform(prim)).T
        x = np.array([0.0, 0.0, 0.0, 0.0] if rotation is None else [*rotation.GetImaginary(), rotation.GetReal()])
        if not (all(np.all(np.isfinite(a)) for a in (T, p, x)) and np.all(np.any(T[:3, :3], axis=0))):
            raise PrimRefusal(prim, "its transform and points must be finite, its scale not 0")
        axes = T[:3, :3] / np.linalg.norm(T[:3, :3], axis=0)
        R = Rotation.from_matrix(axes).as_matrix()
        if np.max(np.abs(axes - R)) > SHEAR:
            raise PrimRefusal(prim, "its transform shears or mirrors")
        return Frame(self.metre * (T[:3, :3] @ p + T[:3, 3]), R @ Rotation.from_quat(x).as_matrix() if np.any(x) else R)


def _import_usd() -> tuple[Any, Any, Any]:
    """Return the modules Usd, UsdGeom and UsdPhysics; raise ValueError if they are not installed."""
    try:
        usd, geom, physics = (importlib.import_module(f"pxr.{name}") for name in ("Usd", "UsdGeom", "UsdPhysics"))
    except ImportError:
        raise ValueError("usd-core reads such files and is not installed: pip install 'mbsbench[formats]'") from None
    return usd, geom, physics


def _open_stage(path: Path) -> Any:
    """Return the stage of a file; raise ValueError with a message of one line if it cannot be composed."""
    usd, tf = _import_usd()[0], importlib.import_module("pxr.Tf")
    try:
        stage = usd.Stage.Open(str(path))
    except tf.ErrorException as error:
        raise ValueError(" ".join(str(error.args[0].commentary).split())) from None
    if errors := stage.GetCompositionErrors():
        raise ValueError(str(errors[0]))
    return stage
