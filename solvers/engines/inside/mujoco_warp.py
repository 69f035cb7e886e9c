"""MuJoCo Warp's model and its steps (module ``export.protocol``)."""

import importlib.metadata
from typing import Any

import mujoco as mj
import numpy as np
import warp as wp

wp.config.quiet = True

import mujoco_warp as warped  # noqa: E402  below the line that keeps its import quiet

from .mjcf import build_model  # noqa: E402
from .warp_model import read_dynamics  # noqa: E402


class Model:
    """A compiled model on the device "cpu", in its state after the last step."""

    def __init__(self, data: dict[str, Any]) -> None:
        """Compile the model from the ``data`` of the protocol, and take one step, which compiles the kernels."""
        self._model = build_model(data).compile()
        self._start, self._velocity = np.array(data["start"]), np.array(data["start_velocity"])
        self._dt, self.stopped = 0.0, ""
        self._reset(data["dt"])
        warped.step(self._device_model, self._data)  # compilation by the first step is set-up
        self._reset(data["dt"])
        made_by = f"mujoco_warp {importlib.metadata.version('mujoco-warp')} on mujoco {mj.__version__}"
        self.notes = ["single precision, CPU", made_by]

    def describe_start(self) -> dict[str, Any]:
        """Return mass matrix, constraints, and accelerations without constraints at the start, and there at rest."""
        found = []
        for u in (0.0 * self._velocity, self._velocity):
            data = self._make_data(u)
            warped.forward(self._device_model, data)
            found.append(read_dynamics(self._device_model, data, self._model.neq))
        return {"rest_rates": found[0]["rates"], **found[1]}

    def advance(self, steps: int, dt: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """Advance by ``steps`` steps of ``dt`` [s]; return (q, u) after each."""
        if dt != self._dt:
            self._dt = dt
            self._device_model.opt.timestep.fill_(dt)
        out = []
        for _ in range(steps):
            warped.step(self._device_model, self._data)
            out.append((self._data.qpos.numpy()[0].copy(), self._data.qvel.numpy()[0].copy()))
        return out

    def rows(self, found: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Convert the list ``found`` of ``advance`` to an array of rows (q, u)."""
        return np.array([np.concatenate(row) for row in found], dtype=float)

    def _reset(self, dt: float) -> None:
        """Copy the model, with the step ``dt`` [s], to the device anew, and set its state to the start."""
        self._dt = self._model.opt.timestep = dt
        self._device_model = warped.put_model(self._model)
        self._data = self._make_data(self._velocity)

    def _make_data(self, u: np.ndarray) -> Any:
        """Return new data on the device, at the pose of the start with velocities ``u``."""
        data = mj.MjData(self._model)
        data.qpos[:], data.qvel[:] = self._start, u
        mj.mj_forward(self._model, data)
        return warped.put_data(self._model, data)
