"""The vocabulary of USD Physics: properties and schemas that are read, named or passed over; others are refused."""

import math
import re
from collections import Counter
from typing import Any

import numpy as np

SETS = {  # properties that are read, or change no motion here, by what a prim is
    "PhysicsScene": "gravityDirection gravityMagnitude",
    "PhysicsRigidBodyAPI": "angularVelocity kinematicEnabled rigidBodyEnabled simulationOwner startsAsleep velocity "
                           "centerOfMass density diagonalInertia mass principalAxes collisionEnabled approximation",
    "joint": "axis body0 body1 breakForce breakTorque collisionEnabled excludeFromArticulation jointEnabled localPos0 "
             "localPos1 localRot0 localRot1 lowerLimit upperLimit minDistance maxDistance coneAngle0Limit "
             "coneAngle1Limit",
    "other": "filteredPairs filteredGroups invertFilteredGroups mergeGroup",
}  # fmt: skip
READ = frozenset(f"physics:{name}" for names in SETS.values() for name in names.split())
OF_AXES = re.compile(
    r"drive:\w+:physics:(damping|maxForce|stiffness|targetPosition|targetVelocity|type)$|limit:\w+:physics:(high|low)$"
)
LOCKS = re.compile(r"physxRigidBody:locked(Pos|Rot)Axis$")
NAMED = {  # left out where they are not zero, by the end of the name
    "linearDamping": "damping of bodies", "angularDamping": "damping of bodies", "jointFriction": "dry friction",
    "armature": "armatures", "maxJointVelocity": "limits of speed",
}  # fmt: skip
SETTINGS = re.compile(  # of PhysX: how it computes, sleeps, collides and limits; none is a force of the mechanism
    r"physxRigidBody:(disableGravity|\w*(Threshold|Enable\w*|Iteration\w*|max\w+|contact\w*|CCD|enable\w+|cfmScale"
    r"|retainAccelerations|solve\w+|stabilization\w+|sleep\w+))$|physxJoint:enableProjection$"
    r"|physx(Scene|Articulation|Limit|Collision|ConvexHullCollision|ContactReport|SDFMeshCollision)\b"
)
FOREIGN = re.compile(r"physx|newton|mjc|state")  # namespaces of engines
SCHEMAS = re.compile(
                     r"Physics(RigidBody|Mass|ArticulationRoot|Collision|MeshCollision|FilteredPairs|MaterialBinding)?API$"
                     r"|Physics(Drive|Limit|JointState)API:|Physx(RigidBody|Joint|Scene|Articulation|Limit\w*|Collision"
                     r"|ContactReport|\w+Collision)API")  # fmt: skip
TYPES = re.compile(r"Physics(Scene|CollisionGroup|\w*Joint)$")


def check(prim: Any, omitted: Counter[str]) -> str:
    """Count what is left out of a prim of a mechanism; the words of a refusal, if something is not known."""
    for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        if str(schema).startswith(("Phys", "Newton", "Mjc")) and not SCHEMAS.match(str(schema)):
            omitted[f"schemas {schema}"] += 1
    for found in prim.GetAuthoredProperties():
        name, space = str(found.GetName()), str(found.GetName()).split(":", maxsplit=1)[0]
        if space in ("physics", "drive", "limit"):
            if name not in READ and not OF_AXES.match(name):
                value = _value(prim, name)
                if _acts(value) and not isinstance(value, str):
                    return f"property {name} is not taken over"
                omitted[f"properties {name}"] += 1  # 0, or a word
            continue
        if str(prim.GetTypeName()) == "PhysicsScene":  # how engines compute
            continue
        value = _value(prim, name) if FOREIGN.match(space) else None
        if not _acts(value):
            continue
        if LOCKS.match(name):
            return f"{name} locks axes of a body, which is not taken over; use a joint"
        if not SETTINGS.match(name):
            omitted[NAMED.get(name.rsplit(":", maxsplit=1)[-1], f"attributes {name}")] += 1
    return ""


def _value(prim: Any, name: str) -> Any:
    attribute = prim.GetAttribute(name)
    return attribute.Get() if attribute else None


def _acts(value: Any) -> bool:
    """Whether a value is a number other than zero and infinity, or words."""
    if value is None or isinstance(value, bool):
        return bool(value)
    try:
        numbers = np.array(value, dtype=float)
    except (TypeError, ValueError):
        return bool(value)
    return bool(np.any((numbers != 0.0) & (np.abs(numbers) < math.inf)))
