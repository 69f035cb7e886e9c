"""PyBullet's model and its steps (module ``export.protocol``).

A tree is one multibody, whose base is a body that floats, or a fixed one without mass. A link's frame is at its joint;
the rotation of a ball joint is that of the principal axes of its child. Velocities of a base are v and omega in space.
"""

import importlib.metadata
from typing import Any

import numpy as np
import pybullet as bullet

from .turning import make_matrices, make_quaternion

GROUND, FIRST = -1, 0  # body number of the ground; number of the first server
UNLIMITED = 1e12
PROBE = 1e-3  # [s] of the step that measures forces: velocities after it are u + PROBE M^-1 f


class Model:
    """Multibodies on a PyBullet server, in their state after the last step."""

    def __init__(self, data: dict[str, Any]) -> None:
        """Measure the quantities of the model check, then build the bodies from the ``data`` of the protocol."""
        self._data, self._default, self.stopped = data, data["options"]["settings"] == "default", ""
        self._ground = (-1, -1)
        self._start, self._velocity = np.array(data["start"]), np.array(data["start_velocity"])
        self._start_quantities = self._measure_start()
        self._build(cuts=True, default=self._default)
        self._set_state(self._start, self._velocity)
        self.notes = [
            "semi-implicit Euler" + (", with its damping" if self._default else ""),
            f"pybullet {importlib.metadata.version('pybullet')}",
        ]

    def describe_start(self) -> dict[str, Any]:
        """Return the mass matrix, and accelerations without constraints at the start and there at rest.

        They were measured when the model was built.
        """
        return self._start_quantities

    def advance(self, steps: int, dt: float) -> np.ndarray:
        """Advance by ``steps`` steps of ``dt`` [s]; return a row (q, u) of the tree after each."""
        bullet.setTimeStep(dt, self._server)
        rows = np.empty((steps, len(self._start) + len(self._velocity)))
        for k in range(steps):
            bullet.stepSimulation(self._server)
            rows[k] = self._read_row()
        return rows

    def _measure_start(self) -> dict[str, Any]:
        """Measure mass matrix and accelerations at the start, by steps of ``PROBE`` without cut joints; return them.

        ``rest_rates`` are accelerations with all velocities zero. The server used for this is replaced later.
        """
        self._build(cuts=False, default=False)
        bullet.setTimeStep(PROBE, self._server)
        found = []
        for u in (0.0 * self._velocity, self._velocity):
            self._set_state(self._start, u)
            bullet.stepSimulation(self._server)
            after = self._read_row()[len(self._start) :]
            found.append((after - u) / PROBE)
        return {"mass_matrix": self._measure_mass_matrix(found[0]), "rest_rates": found[0], "rates": found[1]}

    def _measure_mass_matrix(self, rest_rates: np.ndarray) -> np.ndarray:
        """Measure the mass matrix by a unit force along one velocity per step, and return it.

        ``rest_rates`` are accelerations without these forces. PyBullet's own ``calculateMassMatrix`` (3.2.7) is wrong
        where one ball joint follows another.
        """
        columns = []
        for limb in self._data["limbs"]:
            (body, link), server = self._at[limb["body"]], self._server
            for k in range({"FREE": 6, "BALL": 3, "FIXED": 0}.get(limb["kind"], 1)):
                self._set_state(self._start, 0.0 * self._velocity)
                unit = np.eye(3)[k % 3]
                if limb["moves"]:
                    bullet.setJointMotorControl2(body, link, bullet.TORQUE_CONTROL, force=1.0, physicsClientId=server)
                elif limb["kind"] == "BALL":
                    bullet.setJointMotorControlMultiDof(
                        body,
                        link,
                        bullet.TORQUE_CONTROL,
                        physicsClientId=server,
                        force=self._principal_axes[limb["body"]].T @ unit,
                    )
                elif k < 3:
                    bullet.applyExternalForce(body, link, unit, limb["r"], bullet.WORLD_FRAME, physicsClientId=server)
                else:
                    bullet.applyExternalTorque(
                        body, link, np.array(limb["R"]) @ unit, bullet.WORLD_FRAME, physicsClientId=server
                    )
                bullet.stepSimulation(server)
                columns.append(self._read_row()[len(self._start) :] / PROBE - rest_rates)
        return np.linalg.inv(np.array(columns).T)

    def _build(self, *, cuts: bool, default: bool) -> None:
        """Build all bodies on a new PyBullet server, which replaces the one before.

        With ``cuts``, constraints close the cut joints; with ``default``, settings are PyBullet's own.
        """
        if bullet.isConnected(FIRST):  # including that of the model before: one takes 118 MB
            bullet.disconnect(FIRST)
        self._server = server = bullet.connect(bullet.DIRECT)
        bullet.setGravity(*self._data["gravity"], physicsClientId=server)
        self._at: dict[int, tuple[int, int]] = {}  # (multibody, link) by body
        self._principal_axes: dict[int, np.ndarray] = {}  # by body, as columns
        trees: list[list[dict[str, Any]]] = []
        for limb in self._data["limbs"]:
            if limb["parent"] == GROUND:
                trees.append([])
            trees[-1].append(limb)
        for tree in trees:
            self._add_tree(tree, default)
        if cuts:
            for cut in self._data["cuts"]:
                ends = [(self._find_anchor(cut[k]), self._express_point(cut[k], cut[f"s_{k}"])) for k in ("i", "j")]
                (one, p), (two, s) = ends
                held = bullet.createConstraint(
                    *one, *two, bullet.JOINT_POINT2POINT, [0, 0, 0], p, s, physicsClientId=server
                )
                if not default:
                    bullet.changeConstraint(
                        held, maxForce=UNLIMITED, erp=self._data["options"]["erp"], physicsClientId=server
                    )
        if not default:
            iterations = self._data["options"]["num_solver_iterations"]
            bullet.setPhysicsEngineParameter(
                numSolverIterations=iterations, solverResidualThreshold=0.0, physicsClientId=server
            )

    def _add_tree(self, limbs: list[dict[str, Any]], default: bool) -> None:
        """Add the ``limbs`` of one tree to the server as a multibody, on a base that floats or is fixed.

        Motors are switched off, and dampings are zero, except with ``default``, which keeps the dampings.
        """
        server, floats = self._server, limbs[0]["kind"] == "FREE"
        links = limbs[1:] if floats else limbs
        link_number, arm, principal_moments = {GROUND: 0}, {GROUND: np.zeros(3)}, {}
        for limb in limbs:
            moments, axes = np.linalg.eigh(np.array(limb["inertia"]))
            axes = axes * np.linalg.det(axes)  # right-handed
            self._principal_axes[limb["body"]], principal_moments[limb["body"]] = axes, moments
        if floats:
            link_number[limbs[0]["body"]], arm[limbs[0]["body"]] = 0, np.zeros(3)
        columns: dict[str, list[Any]] = {key: [] for key in COLUMNS}
        for k, limb in enumerate(links):
            b = limb["body"]
            kind, axis = KINDS[limb["kind"]], limb["moves"][0][1] if limb["moves"] else limb["axis"]
            values = (
                limb["mass"],
                -1,
                -1,
                np.array(limb["s_parent"]) - arm[limb["parent"]],
                _make_quaternion(limb["R_0"]),
                -np.array(limb["s_child"]),
                _make_quaternion(self._principal_axes[b]),
                link_number[limb["parent"]],
                kind,
                axis,
            )
            for key, value in zip(COLUMNS, values, strict=True):
                columns[key].append(value)
            link_number[b], arm[b] = k + 1, np.array(limb["s_child"])
        root = limbs[0]
        base = {
            "baseMass": root["mass"],
            "basePosition": root["r"],
            "baseOrientation": _make_quaternion(root["R"]),
            "baseInertialFrameOrientation": _make_quaternion(self._principal_axes[root["body"]]),
        }
        body = bullet.createMultiBody(**(base if floats else {"baseMass": 0.0}), **columns, physicsClientId=server)
        for limb in limbs:
            b = limb["body"]
            link = link_number[b] - 1  # -1: the base
            self._at[b] = body, link
            bullet.changeDynamics(body, link, localInertiaDiagonal=principal_moments[b], physicsClientId=server)
            if not default:
                bullet.changeDynamics(
                    body,
                    link,
                    linearDamping=0.0,
                    angularDamping=0.0,
                    jointDamping=0.0,
                    maxJointVelocity=UNLIMITED,
                    physicsClientId=server,
                )
            if limb["moves"]:
                bullet.setJointMotorControl2(body, link, bullet.VELOCITY_CONTROL, force=0, physicsClientId=server)
            elif limb["kind"] == "BALL":
                bullet.setJointMotorControlMultiDof(
                    body, link, bullet.POSITION_CONTROL, targetPosition=[0, 0, 0, 1], positionGain=0, velocityGain=0,
                    force=[0, 0, 0], physicsClientId=server,
                )  # fmt: skip

    def _set_state(self, q: np.ndarray, u: np.ndarray) -> None:
        """Set the state of all joints and bases to coordinates ``q`` and velocities ``u`` of the tree."""
        for limb in self._data["limbs"]:
            body, link = self._at[limb["body"]]
            x, v = q[limb["q_at"] :], u[limb["u_at"] :]
            if limb["kind"] == "FREE":
                R = make_matrices(x[None, 3:7])[0]
                axes = _make_quaternion(R @ self._principal_axes[limb["body"]])
                bullet.resetBasePositionAndOrientation(body, x[:3], axes, physicsClientId=self._server)
                bullet.resetBaseVelocity(body, v[:3], R @ v[3:6], physicsClientId=self._server)
            elif limb["moves"]:
                bullet.resetJointState(body, link, x[0], v[0], physicsClientId=self._server)
            elif limb["kind"] == "BALL":
                turn, w = (
                    self._express_in_principal_axes(limb["body"], np.roll(x[:4], -1)),
                    self._principal_axes[limb["body"]].T @ v[:3],
                )
                bullet.resetJointStateMultiDof(body, link, turn, w, physicsClientId=self._server)

    def _read_row(self) -> np.ndarray:
        """Return the present state as a row (q, u), coordinates and velocities of the tree."""
        nq = len(self._start)
        row = np.empty(nq + len(self._velocity))
        for limb in self._data["limbs"]:
            body, link = self._at[limb["body"]]
            a, b = limb["q_at"], nq + limb["u_at"]
            if limb["kind"] == "FREE":
                r, p = bullet.getBasePositionAndOrientation(body, physicsClientId=self._server)
                v, w = bullet.getBaseVelocity(body, physicsClientId=self._server)
                R = make_matrices(np.roll(p, 1)[None])[0] @ self._principal_axes[limb["body"]].T
                row[a : a + 3], row[a + 3 : a + 7] = r, make_quaternion(R)
                row[b : b + 3], row[b + 3 : b + 6] = v, R.T @ w
            elif limb["moves"]:
                row[a], row[b] = bullet.getJointState(body, link, physicsClientId=self._server)[:2]
            elif limb["kind"] == "BALL":
                q, u = bullet.getJointStateMultiDof(body, link, physicsClientId=self._server)[:2]
                F = self._principal_axes[limb["body"]]
                row[a], row[a + 1 : a + 4], row[b : b + 3] = q[3], F @ q[:3], F @ u
        return row

    def _express_in_principal_axes(self, body: int, quaternion: np.ndarray) -> np.ndarray:
        """Return a ball joint's quaternion (x, y, z, w), given in the frame of ``body``, in its principal axes.

        Bullet states rotations of a ball joint in the principal axes of the child.
        """
        vector, scalar = quaternion[:3], quaternion[3]
        return np.append(self._principal_axes[body].T @ vector, scalar)

    def _find_anchor(self, b: int) -> tuple[int, int]:
        """Return (multibody, link) of body ``b``; for the ground a fixed multibody, made once per server."""
        if b != GROUND:
            return self._at[b]
        if self._ground[0] != self._server:
            self._ground = self._server, bullet.createMultiBody(baseMass=0.0, physicsClientId=self._server)
        return self._ground[1], -1

    def _express_point(self, b: int, s: Any) -> np.ndarray:
        """Return the point ``s`` [m] of body ``b`` in its principal axes, as Bullet expects; ``s`` for the ground."""
        return np.array(s) if b == GROUND else self._principal_axes[b].T @ np.array(s)


KINDS = {
    "HINGE": bullet.JOINT_REVOLUTE,
    "SLIDE": bullet.JOINT_PRISMATIC,
    "BALL": bullet.JOINT_SPHERICAL,
    "FIXED": bullet.JOINT_FIXED,
}
COLUMNS = (
    "linkMasses",
    "linkCollisionShapeIndices",
    "linkVisualShapeIndices",
    "linkPositions",
    "linkOrientations",
    "linkInertialFramePositions",
    "linkInertialFrameOrientations",
    "linkParentIndices",
    "linkJointTypes",
    "linkJointAxis",
)


def _make_quaternion(R: Any) -> np.ndarray:
    """Return the quaternion (x, y, z, w) of the rotation matrix ``R``, in Bullet's order."""
    return np.roll(make_quaternion(R), -1)
