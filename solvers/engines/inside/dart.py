"""DART's model and its steps (module ``export.protocol``).

The coordinates of a ball joint are the logarithm of its rotation, its velocities the angular velocity in the frame of
the child. A free joint has the logarithm of its body's rotation and the position in space as coordinates, the angular
velocity and the velocity of the body, both in space, as velocities.
"""

import importlib.metadata
from typing import Any

import dartpy as dart
import numpy as np

from .turning import evaluate_factor, rotate_back

GROUND = -1
OWN = 0.01  # default error reduction of DART


class Model:
    """A skeleton in a world, in its state after the last step."""

    def __init__(self, data: dict[str, Any]) -> None:
        """Build world, skeleton and ball constraints from the ``data`` of the protocol, at the start."""
        self._data, self.stopped = data, ""
        options = data["options"]
        default = options["settings"] == "default"
        self._world, self._skeleton = dart.simulation.World(), dart.dynamics.Skeleton("bodies")
        self._world.setGravity(data["gravity"])
        self._world.setTimeStep(data["dt"])
        self._bodies: dict[int, Any] = {}
        self._joints: list[tuple[Any, dict[str, Any]]] = []
        for limb in data["limbs"]:
            self._add_limb(limb)
        self._world.addSkeleton(self._skeleton)
        self._set_start(np.array(data["start_velocity"]))
        solver = self._world.getConstraintSolver()
        for cut in data["cuts"]:
            i, j = self._bodies[cut["i"]], self._bodies.get(cut["j"])
            where = i.getWorldTransform().multiply(np.array(cut["s_i"]))
            constraint = dart.constraint.BallJointConstraint(*([i] if j is None else [i, j]), where)
            # sets it for all constraints
            constraint.setErrorReductionParameter(OWN if default else options["error_reduction"])
            solver.addConstraint(constraint)
        loop = "a loop of its steps in Python, whose overhead counts"
        self.notes = [loop, f"dartpy {importlib.metadata.version('dartpy')}"]

    def describe_start(self) -> dict[str, Any]:
        """Return fields of ``EngineModel`` at the start, in velocities of the tree, by name.

        Forces are M u_dot of DART's forward dynamics without constraints. The skeleton is left at the start.
        """
        skeleton, u, nu = self._skeleton, np.array(self._data["start_velocity"]), len(self._data["start_velocity"])
        V = np.stack([self._convert_velocities(unit) for unit in np.eye(nu)], axis=1)
        loads = []
        for rates in (0.0 * u, u):
            self._set_start(rates)
            self._apply_loads(0.0)
            skeleton.computeForwardDynamics()
            skeleton.clearExternalForces()
            M = skeleton.getMassMatrix()
            loads.append(V.T @ M @ skeleton.getAccelerations())
        rows = [np.zeros((0, nu))]
        for cut in self._data["cuts"]:
            ends = [
                0.0 if cut[b] == GROUND else skeleton.getLinearJacobian(self._bodies[cut[b]], np.array(cut[f"s_{b}"]))
                for b in ("i", "j")
            ]
            rows.append((ends[0] - ends[1]) @ V)
        return {
            "mass_matrix": V.T @ M @ V,
            "rest_forces": loads[0],
            "forces": loads[1],
            "constraints": np.concatenate(rows),
            "kinetic": skeleton.computeKineticEnergy(),
            "potential": skeleton.computePotentialEnergy(),
        }

    def advance(self, steps: int, dt: float) -> np.ndarray:
        """Advance by ``steps`` steps of ``dt`` [s]; return a row of DART's positions and velocities after each."""
        self._world.setTimeStep(dt)
        step, skeleton = self._world.step, self._skeleton
        made = np.empty((steps, 2 * skeleton.getNumDofs()))
        for k in range(steps):
            self._apply_loads(self._world.getTime())
            step()
            made[k] = np.concatenate((skeleton.getPositions(), skeleton.getVelocities()))
        return made

    def rows(self, made: np.ndarray) -> np.ndarray:
        """Convert rows ``made`` by ``advance`` to rows (q, u), coordinates and velocities of the tree."""
        theirs, v = np.split(made, 2, axis=1)
        q = np.zeros((len(made), len(self._data["start"])))
        u = np.zeros((len(made), len(self._data["start_velocity"])))
        for joint, limb in self._joints:
            at, to, kind = limb["q_at"], limb["u_at"], limb["kind"]
            i = joint.getIndexInSkeleton(0)
            if kind == "BALL":
                q[:, at : at + 4], u[:, to : to + 3] = _make_quaternions(theirs[:, i : i + 3]), v[:, i : i + 3]
            elif kind == "FREE":
                q[:, at : at + 3], q[:, at + 3 : at + 7] = (
                    theirs[:, i + 3 : i + 6],
                    _make_quaternions(theirs[:, i : i + 3]),
                )
                u[:, to : to + 3] = v[:, i + 3 : i + 6]
                u[:, to + 3 : to + 6] = rotate_back(q[:, at + 3 : at + 7], v[:, i : i + 3])
            else:
                n = joint.getNumDofs()
                q[:, at : at + n], u[:, to : to + n] = theirs[:, i : i + n], v[:, i : i + n]
        return np.concatenate((q, u), axis=1)

    def _add_limb(self, limb: dict[str, Any]) -> None:
        """Add a limb of the tree, its body and the joint that carries it, to the skeleton."""
        skeleton, kind, b = self._skeleton, limb["kind"], limb["body"]
        parent = self._bodies.get(limb["parent"])
        parents = () if parent is None else (parent,)
        name = {
            "BALL": "Ball",
            "FREE": "Free",
            "FIXED": "Weld",
            "UNIVERSAL": "Universal",
            "HINGE": "Revolute",
            "SLIDE": "Prismatic",
        }[kind]
        joint, body = getattr(skeleton, f"create{name}JointAndBodyNodePair")(*parents)
        body.setName(f"body {b}")
        axes = [np.array(axis) for _, axis in limb["moves"]]
        if len(axes) == 1:
            joint.setAxis(axes[0])
        if len(axes) == 2:
            joint.setAxis1(axes[0])
            joint.setAxis2(axes[1])
        if kind != "FREE":
            joint.setTransformFromParentBodyNode(_make_isometry(limb["R_0"], limb["s_parent"]))
        if kind != "FIXED":
            self._joints.append((joint, limb))
        if kind != "FREE":
            joint.setTransformFromChildBodyNode(_make_isometry(np.eye(3), limb["s_child"]))
        body.setInertia(dart.dynamics.Inertia(limb["mass"], np.zeros(3), np.array(limb["inertia"])))
        self._bodies[b] = body

    def _apply_loads(self, t: float) -> None:
        """Apply the loads of time ``t`` [s] to the bodies, for the next step, which clears them."""
        for load in self._data["loads"]:
            body, factor, follows = self._bodies[load["body"]], evaluate_factor(load["factor"], t), load["follows"]
            body.addExtForce(factor * np.array(load["force"]), np.array(load["point"]), follows, True)
            body.addExtTorque(factor * np.array(load["torque"]), follows)

    def _set_start(self, u: np.ndarray) -> None:
        """Set the skeleton to the pose of the start and velocities ``u`` of the tree."""
        q = np.zeros(self._skeleton.getNumDofs())
        for joint, limb in self._joints:
            if limb["kind"] == "FREE":
                i = joint.getIndexInSkeleton(0)
                q[i : i + 6] = dart.dynamics.FreeJoint.convertToPositions(_make_isometry(limb["R"], limb["r"]))
        self._skeleton.setPositions(q)
        self._skeleton.setVelocities(self._convert_velocities(u))

    def _convert_velocities(self, u: np.ndarray) -> np.ndarray:
        """Return DART's velocities for velocities ``u`` of the tree, at the pose of the start.

        They differ for free joints: the angular velocity in space comes first.
        """
        v = np.zeros(self._skeleton.getNumDofs())
        for joint, limb in self._joints:
            i, n, to = joint.getIndexInSkeleton(0), joint.getNumDofs(), limb["u_at"]
            if limb["kind"] == "FREE":
                v[i : i + 6] = np.concatenate((np.array(limb["R"]) @ u[to + 3 : to + 6], u[to : to + 3]))
            else:
                v[i : i + n] = u[to : to + n]
        return v


def _make_isometry(R: Any, p: Any) -> Any:
    """Return DART's transform with rotation R and translation p."""
    out = dart.math.Isometry3()
    out.set_rotation(np.array(R))
    out.set_translation(np.array(p))
    return out


def _make_quaternions(a: np.ndarray) -> np.ndarray:
    """Return the quaternions (w, x, y, z), (n, 4), of rotation vectors ``a`` (n, 3) [rad]."""
    angle = np.linalg.norm(a, axis=1, keepdims=True)
    return np.concatenate((np.cos(0.5 * angle), 0.5 * np.sinc(0.5 * angle / np.pi) * a), axis=1)
