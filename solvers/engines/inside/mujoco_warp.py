"""MuJoCo Warp's model and its steps (module ``export.protocol``)."""

import importlib.metadata
from typing import Any

import mujoco as mj
import numpy as np
import warp as wp

wp.config.quiet = True

import mujoco_warp as warped  # noqa: E402

GROUND = -1


class Model:
    """A compiled model on the device "cpu", and its state at the last step made."""

    def __init__(self, data: dict[str, Any]) -> None:
        self._model = _spec(data).compile()
        self._start, self._velocity = np.array(data["start"]), np.array(data["start_velocity"])
        self._dt, self.stopped = 0.0, ""
        self._set(data["dt"])
        warped.step(self._there, self._data)  # what the first step compiles is set-up
        self._set(data["dt"])
        self.notes = ["single precision, CPU", f"mujoco_warp {importlib.metadata.version('mujoco-warp')}"]

    def at_start(self) -> dict[str, Any]:
        """For the model check."""
        found = []
        for u in (0.0 * self._velocity, self._velocity):
            data = self._put(u)
            warped.forward(self._there, data)
            found.append(data.qacc_smooth.numpy()[0].astype(float))
        return {"rest_rates": found[0], "rates": found[1]}

    def advance(self, steps: int, dt: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """(q, u) after each of the next steps."""
        if dt != self._dt:
            self._dt = dt
            self._there.opt.timestep.fill_(dt)
        out = []
        for _ in range(steps):
            warped.step(self._there, self._data)
            out.append((self._data.qpos.numpy()[0].copy(), self._data.qvel.numpy()[0].copy()))
        return out

    def rows(self, found: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Rows (q, u)."""
        return np.array([np.concatenate(row) for row in found], dtype=float)

    def _set(self, dt: float) -> None:
        self._dt = self._model.opt.timestep = dt
        self._there = warped.put_model(self._model)
        self._data = self._put(self._velocity)

    def _put(self, u: np.ndarray) -> Any:
        data = mj.MjData(self._model)
        data.qpos[:], data.qvel[:] = self._start, u
        mj.mj_forward(self._model, data)
        return warped.put_data(self._model, data)


def _spec(data: dict[str, Any]) -> Any:
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
            iquat=_quaternion(axes * np.linalg.det(axes)), quat=_quaternion(R_0),
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


def _quaternion(R: np.ndarray) -> np.ndarray:
    p = np.zeros(4)
    mj.mju_mat2Quat(p, R.ravel())
    return p
