"""Describe a tree, springs and loads as an ``MjSpec`` of MuJoCo."""

from typing import Any

import mujoco as mj
import numpy as np

from .turning import make_quaternion

GROUND = -1


def build_model(data: dict[str, Any]) -> Any:
    """Build and return the uncompiled ``MjSpec`` of a problem from the ``data`` of the protocol; contacts are off.

    With settings "default" the integrator and the softness of constraints are MuJoCo's own.
    """
    options, spec = data["options"], mj.MjSpec()
    ours = options["settings"] == "ours"
    spec.option.gravity, spec.option.timestep = data["gravity"], data["dt"]
    spec.option.disableflags = mj.mjtDisableBit.mjDSBL_CONTACT
    spec.compiler.degree = False
    if ours:
        spec.option.integrator = getattr(mj.mjtIntegrator, f"mjINT_{options['integrator'].upper()}")
    parts = {GROUND: spec.worldbody}
    for limb in data["limbs"]:
        free = limb["kind"] == "FREE"
        moments, axes = np.linalg.eigh(np.array(limb["inertia"]))
        R_0 = np.array(limb["R_0"])
        parts[limb["body"]] = part = parts[limb["parent"]].add_body(
            name=f"body {limb['body']}",
            mass=limb["mass"],
            explicitinertial=True,
            ipos=np.zeros(3),
            inertia=moments,
            iquat=make_quaternion(axes * np.linalg.det(axes)),
            quat=make_quaternion(R_0),
            pos=limb["r"] if free else np.array(limb["s_parent"]) - R_0 @ limb["s_child"],
        )
        if limb["kind"] in ("BALL", "FREE"):
            part.add_joint(type=getattr(mj.mjtJoint, f"mjJNT_{limb['kind']}"), pos=limb["s_child"])
        for slides, axis in limb["moves"]:
            kind = mj.mjtJoint.mjJNT_SLIDE if slides else mj.mjtJoint.mjJNT_HINGE
            part.add_joint(type=kind, pos=limb["s_child"], axis=axis, **make_spring(limb["torsion"]))
    for cut in data["cuts"]:
        row = spec.add_equality(type=mj.mjtEq.mjEQ_CONNECT, objtype=mj.mjtObj.mjOBJ_BODY)
        row.name1, row.name2 = (parts[cut[k]].name for k in ("i", "j"))
        row.data[:3] = cut["s_i"]
        if ours:
            d = options["impedance"]
            row.solref, row.solimp = (options["time_constant"] * data["dt"], 1.0), (d, d, 1e-3, 0.5, 2.0)
    add_springs(spec, parts, data["springs"])
    add_loads(spec, parts, data["loads"])
    return spec


def make_spring(torsion: dict[str, float] | None) -> dict[str, Any]:
    """Return a torsional spring as keyword arguments of ``add_joint``; none if ``torsion`` is None."""
    if torsion is None:
        return {}
    return {
        "stiffness": [torsion["stiffness"], 0.0, 0.0],
        "damping": [torsion["damping"], 0.0, 0.0],
        "springref": torsion["rest_angle"],
    }


def add_springs(spec: Any, parts: dict[int, Any], springs: list[dict[str, Any]]) -> None:
    """Add springs to ``spec``, as tendons between two sites; ``parts`` are its bodies, by index of the body."""
    for k, one in enumerate(springs):
        cord = spec.add_tendon(
            stiffness=[one["stiffness"], 0.0, 0.0],
            damping=[one["damping"], 0.0, 0.0],
            springlength=[one["rest_length"]] * 2,
        )
        for end, b in enumerate("ij"):
            parts[int(one[b])].add_site(name=f"spring {k} {end}", pos=one[f"p_{b}"])
            cord.wrap_site(f"spring {k} {end}")


def add_loads(spec: Any, parts: dict[int, Any], loads: list[dict[str, Any]]) -> None:
    """Add constant loads to ``spec``, as actuators at sites, without control: bias 1, and the wrench as gear.

    The wrench is in the body's frame for loads that follow it, else in space.
    """
    for k, load in enumerate(loads):
        parts[int(load["body"])].add_site(name=f"load {k}", pos=load["point"])
        actuator = spec.add_actuator(name=f"load {k}", trntype=mj.mjtTrn.mjTRN_SITE, target=f"load {k}")
        if not load["follows"]:
            spec.worldbody.add_site(name=f"load {k} in space")
            actuator.refsite = f"load {k} in space"
        actuator.gear = load["factor"][0] * np.concatenate((load["force"], load["torque"]))
        actuator.gaintype, actuator.gainprm = mj.mjtGain.mjGAIN_FIXED, np.zeros_like(actuator.gainprm)
        actuator.biastype, actuator.biasprm = mj.mjtBias.mjBIAS_AFFINE, np.eye(len(actuator.biasprm))[0]
