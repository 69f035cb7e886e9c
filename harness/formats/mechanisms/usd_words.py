"""List the vocabulary of USD Physics: properties and schemas that are read, counted as omitted, or ignored.

Any other property that may act on a motion is refused.
"""

import math
import re
from collections import Counter
from typing import Any

import numpy as np

SETS = {  # properties that are read, or change no motion here, by the kind of a prim
    "PhysicsScene": "gravityDirection gravityMagnitude",
    "PhysicsRigidBodyAPI": "angularVelocity kinematicEnabled rigidBodyEnabled simulationOwner startsAsleep velocity "
    "centerOfMass density diagonalInertia mass principalAxes collisionEnabled approximation",
    "joint": "axis body0 body1 breakForce breakTorque collisionEnabled excludeFromArticulation jointEnabled localPos0 "
    "localPos1 localRot0 localRot1 lowerLimit upperLimit minDistance maxDistance coneAngle0Limit "
    "coneAngle1Limit",
    "other": "filteredPairs filteredGroups invertFilteredGroups mergeGroup",
}
# full names of the properties in ``SETS``
READ = frozenset(f"physics:{name}" for names in SETS.values() for name in names.split())
# properties of the axes of a joint that are read
OF_AXES = re.compile(
    r"drive:\w+:physics:(damping|maxForce|stiffness|targetPosition|targetVelocity|type)$|limit:\w+:physics:(high|low)$"
)
LOCKS = re.compile(r"physxRigidBody:locked(Pos|Rot)Axis$")
NAMED = {  # omitted and counted where they are not zero, by the end of the name
    "linearDamping": "damping of bodies",
    "angularDamping": "damping of bodies",
    "jointFriction": "dry friction",
    "armature": "armatures",
    "maxJointVelocity": "limits of speed",
}
# settings of PhysX: how it computes, sleeps, collides and limits; none is a force of the mechanism
SETTINGS = re.compile(
    r"physxRigidBody:(disableGravity|\w*(Threshold|Enable\w*|Iteration\w*|max\w+|contact\w*|CCD|enable\w+|cfmScale"
    r"|retainAccelerations|solve\w+|stabilization\w+|sleep\w+))$|physxJoint:enableProjection$"
    r"|physx(Scene|Articulation|Limit|Collision|ConvexHullCollision|ContactReport|SDFMeshCollision)\b"
)
FOREIGN = re.compile(r"physx|newton|mjc|state")  # namespaces of engines
# schemas of which properties are read or change no motion here; others are counted as omitted
SCHEMAS = re.compile(
    r"Physics(RigidBody|Mass|ArticulationRoot|Collision|MeshCollision|FilteredPairs|MaterialBinding)?API$"
    r"|Physics(Drive|Limit|JointState)API:|Physx(RigidBody|Joint|Scene|Articulation|Limit\w*|Collision"
    r"|ContactReport|\w+Collision)API"
)
# types of prims that belong to a mechanism
TYPES = re.compile(r"Physics(Scene|CollisionGroup|\w*Joint)$")


def check_properties(prim: Any, omitted: Counter[str]) -> str:
    """Count the omitted properties of a mechanism's prim in ``omitted``; return why it is refused, empty if it is not.

    It is refused for an unknown property that may act on a motion, and for locked axes of a body.
    """
    for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        if str(schema).startswith(("Phys", "Newton", "Mjc")) and not SCHEMAS.match(str(schema)):
            omitted[f"schemas {schema}"] += 1
    for found in prim.GetAuthoredProperties():
        name, space = str(found.GetName()), str(found.GetName()).split(":", maxsplit=1)[0]
        if space in ("physics", "drive", "limit"):
            if name not in READ and not OF_AXES.match(name):
                value = _read_value(prim, name)
                if _has_effect(value) and not isinstance(value, str):
                    return f"property {name} is not supported"
                omitted[f"properties {name}"] += 1  # zero, or text
            continue
        if str(prim.GetTypeName()) == "PhysicsScene":  # settings of how engines compute
            continue
        value = _read_value(prim, name) if FOREIGN.match(space) else None
        if not _has_effect(value):
            continue
        if LOCKS.match(name):
            return f"{name} locks axes of a body, which is not supported; use a joint"
        if not SETTINGS.match(name):
            omitted[NAMED.get(name.rsplit(":", maxsplit=1)[-1], f"attributes {name}")] += 1
    return ""


def _read_value(prim: Any, name: str) -> Any:
    """Return the value of the attribute ``name`` of a prim; None if it has no such attribute."""
    attribute = prim.GetAttribute(name)
    return attribute.Get() if attribute else None


def _has_effect(value: Any) -> bool:
    """Return whether a value may act on a motion: text, True, or a number other than zero and infinity."""
    if value is None or isinstance(value, bool):
        return bool(value)
    try:
        numbers = np.array(value, dtype=float)
    except (TypeError, ValueError):
        return bool(value)
    return bool(np.any((numbers != 0.0) & (np.abs(numbers) < math.inf)))
