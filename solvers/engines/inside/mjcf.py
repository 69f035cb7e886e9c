"""MuJoCo's description of a tree, for engines that read it."""

from typing import Any

import mujoco as mj
import numpy as np

from .turning import quaternion

GROUND = -1


def model_of(data: dict[str, Any]) -> Any:
    """An ``MjSpec`` with the options' settings, contacts off."""
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
            name=f"body {limb['body']}", mass=limb["mass"], explicitinertial=True, ipos=np.zeros(3), inertia=moments,
            iquat=quaternion(axes * np.linalg.det(axes)), quat=quaternion(R_0),
            pos=limb["r"] if free else np.array(limb["s_parent"]) - R_0 @ limb["s_child"],
        )  # fmt: skip
        axis = limb["axis"] if limb["kind"] == "HINGE" else (0.0, 0.0, 1.0)
        part.add_joint(type=getattr(mj.mjtJoint, f"mjJNT_{limb['kind']}"), pos=limb["s_child"], axis=axis)
    for cut in data["cuts"]:
        row = spec.add_equality(type=mj.mjtEq.mjEQ_CONNECT, objtype=mj.mjtObj.mjOBJ_BODY)
        row.name1, row.name2 = (parts[cut[k]].name for k in ("i", "j"))
        row.data[:3] = cut["s_i"]
        if ours:
            d = options["impedance"]
            row.solref, row.solimp = (options["time_constant"] * data["dt"], 1.0), (d, d, 1e-3, 0.5, 2.0)
    return spec
