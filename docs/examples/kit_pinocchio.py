"""Step the kit's cases in Pinocchio by semi-implicit Euler, the loop of most scripts: trees and loops, no springs."""

import numpy as np
import pinocchio as pin

JOINTS = {"HINGE": pin.JointModelRevoluteUnaligned, "BALL": pin.JointModelSpherical, "FREE": pin.JointModelFreeFlyer}
WORLD, EYE, PROXIMAL = pin.LOCAL_WORLD_ALIGNED, np.eye(3), pin.ProximalSettings(1e-12, 1e-10, 20)


def pinocchio_motion(case, change=lambda inertia: inertia):
    """Step by accelerations of Pinocchio; ``change`` makes its inertias wrong."""
    model, joint, centres, loops = pin.Model(), {-1: 0}, {}, pin.StdVec_RigidConstraintModel()
    model.gravity.linear = np.array(case.numbers["gravity"])
    for x in case.links:
        kind, b = JOINTS[x["kind"]](*x["axes"]), x["body"]
        joint[b] = model.addJoint(joint[x["parent"]], kind, pin.SE3(x["R_0"], x["at"]), f"body{b}")
        inertia = pin.Inertia(x["mass"], x["centre"], change(x["inertia"]))
        model.appendBodyToJoint(joint[b], inertia, pin.SE3.Identity())
        centres[b] = model.addFrame(pin.Frame(f"C{b}", joint[b], pin.SE3(EYE, x["centre"]), pin.OP_FRAME))
    for i, s_i, j, s_j in case.loops:
        ends = (joint[i], pin.SE3(EYE, s_i), joint[j], pin.SE3(EYE, s_j))
        loops.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends, pin.LOCAL))
    data, held = model.createData(), pin.StdVec_RigidConstraintData([c.createData() for c in loops])
    pin.initConstraintDynamics(model, data, loops, held)
    q, v = pin.neutral(model), np.concatenate([x["speed"] for x in case.links])
    while True:
        pin.forwardKinematics(model, data, q, v)
        at = [pin.updateFramePlacement(model, data, centres[b]) for b in range(case.bodies)]
        rate = [pin.getFrameVelocity(model, data, centres[b], WORLD) for b in range(case.bodies)]
        yield [x.translation for x in at], [x.rotation for x in at], [x.linear for x in rate], [x.angular for x in rate]
        v = v + case.dt * pin.constraintDynamics(model, data, q, v, 0 * v, loops, held, PROXIMAL)
        q = pin.integrate(model, q, case.dt * v)
