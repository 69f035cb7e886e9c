"""Step the kit's cases in MuJoCo from their MJCF."""

import mujoco
import numpy as np


def mujoco_motion(case, integrator="RK4", tight=True):
    """Step by RK4, or another integrator; without ``tight`` loops have MuJoCo's default stiffness."""
    model = mujoco.MjModel.from_xml_string(case.mjcf)
    model.opt.integrator, model.opt.tolerance = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}"), 1e-14
    if tight:  # loops as stiff as MuJoCo allows
        model.eq_solref[:, 0], model.eq_solimp[:, :2] = 2 * case.dt, 0.9999
    data, twist = mujoco.MjData(model), np.zeros((case.bodies, 6))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    bodies = [model.body(f"body{b}").id for b in range(case.bodies)]
    while True:
        data.xfrc_applied[bodies, 3:] = case.torques(data.time)
        mujoco.mj_forward(model, data)
        for k, b in enumerate(bodies):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, b, twist[k], 0)
        yield data.xipos[bodies], data.xquat[bodies], twist[:, 3:], twist[:, :3]
        mujoco.mj_step(model, data)
