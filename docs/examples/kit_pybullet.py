"""Step the kit's cases in PyBullet from their URDF, whose numbers it reads in 32 bits: trees."""

from pathlib import Path

import numpy as np
import pybullet as p

REST = {"HINGE": [0], "BALL": [0, 0, 0, 1]}
FREE = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0, "maxJointVelocity": 1e9}
if not p.isConnected():
    p.connect(p.DIRECT)


def pybullet_motion(case):
    """Step by Featherstone's algorithm of Bullet."""
    p.resetSimulation()
    p.setTimeStep(case.dt)
    p.setGravity(*case.numbers["gravity"])
    Path(f"{case.name}.urdf").write_text(case.urdf)  # a separate name, because PyBullet caches files
    robot = p.loadURDF(f"{case.name}.urdf", useFixedBase=not case.floats, flags=p.URDF_USE_INERTIA_FROM_FILE)
    link = {p.getJointInfo(robot, j)[12].decode(): j for j in range(p.getNumJoints(robot))}
    for x in case.links:
        j, rest, speed = link.get(f"body{x['body']}", -1), REST.get(x["kind"]), x["speed"]
        p.changeDynamics(robot, j, **FREE)
        if x["kind"] == "FREE":
            p.resetBasePositionAndOrientation(robot, x["at"], np.roll(case.numbers["start"][0]["quaternion_wxyz"], -1))
            p.resetBaseVelocity(robot, x["R_0"] @ speed[:3], x["R_0"] @ speed[3:])
        else:
            p.resetJointStateMultiDof(robot, j, rest, speed)
            p.setJointMotorControlMultiDof(robot, j, p.POSITION_CONTROL, rest, force=[0] * len(speed))
    while True:
        links = [p.getLinkState(robot, j, 1, 1) for j in link.values()]
        base = (*p.getBasePositionAndOrientation(robot), *p.getBaseVelocity(robot))
        r, q, v, omega = zip(*[(s[0], s[5], s[6], s[7]) for s in links] or [base], strict=True)
        yield r, np.roll(q, 1, axis=1), v, omega
        p.stepSimulation()
