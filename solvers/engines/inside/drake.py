"""Drake's model and its steps (module ``export.protocol``).

A cylindrical joint is two joints with a massless body between them. Drake's ball joint has roll, pitch and yaw as
coordinates, singular at a pitch of 90 degrees: x of its frames is along the arm of the child, z normal to the plane in
which gravity pulls the arm. Points of cut joints are ball constraints, which only the discrete steps enforce.
"""

import importlib.metadata
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    DiscreteContactApproximation,
    ExternallyAppliedSpatialForce,
)
from pydrake.multibody.tree import (
    BallRpyJoint,
    FixedOffsetFrame,
    JacobianWrtVariable,
    LinearSpringDamper,
    MultibodyForces,
    PrismaticJoint,
    QuaternionFloatingJoint,
    RevoluteJoint,
    RevoluteSpring,
    RotationalInertia,
    SpatialInertia,
    UniversalJoint,
)
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder, EventStatus, LeafSystem
from pydrake.systems.primitives import LogVectorOutput

from .turning import evaluate_factor, find_arm_and_normal, make_matrices

GROUND = -1
APPROXIMATIONS = {"tamsi": "kTamsi", "sap": "kSap", "similar": "kSimilar", "lagged": "kLagged"}
NO_STEP = 1e-6  # share of a step: a shorter one is rounding


class Model:
    """A plant in a diagram, in its state after the last step."""

    def __init__(self, data: dict[str, Any]) -> None:
        """Build plant and simulator from the ``data`` of the protocol, at the start; ValueError if Drake refuses."""
        options = data["options"]
        self._data, self._scheme, default = data, options["integrator"], options["settings"] == "default"
        if default:
            self._scheme = "runge_kutta3" if data["dt"] is None else "lagged"
        self._since = self._time = 0.0
        self._default, self._discrete, self.stopped = default, self._scheme in APPROXIMATIONS, ""
        try:
            self._assemble(data["dt"] or 0.0)
            self._restart(0.0, *self._convert_from_tree(np.array(data["start"]), np.array(data["start_velocity"])))
        except RuntimeError as error:  # raised by its checks, e.g. for an inertia that no body can have
            raise ValueError(" ".join(str(error).split())) from None
        what = "discrete steps, approximation" if self._discrete else "integrator"
        held = "; its ball constraints are regularised" if data["cuts"] else ""
        self.notes = [f"{what} {self._scheme}{held}", f"drake {importlib.metadata.version('drake')}"]

    def describe_start(self) -> dict[str, Any]:
        """Return fields of ``EngineModel`` at the start by name, in velocities u of the tree.

        Drake's own are v = V u, with V_dot u = 0 at the start. Constraints are empty for a continuous plant.
        """
        plant, root = self._plant, self._simulator.get_system().CreateDefaultContext()
        context = plant.GetMyMutableContextFromRoot(root)
        q, u = np.array(self._data["start"]), np.array(self._data["start_velocity"])
        V = np.zeros((len(u), len(u)))
        for k, unit in enumerate(np.eye(len(u))):
            V[:, k] = self._convert_from_tree(q, unit)[1]
        place, v = self._convert_from_tree(q, u)
        plant.SetPositions(context, place)
        plant.SetVelocities(context, 0.0 * v)
        rest_forces = V.T @ self._sum_forces(context)
        plant.SetVelocities(context, v)
        M, forces = V.T @ plant.CalcMassMatrix(context) @ V, V.T @ self._sum_forces(context)
        world, rows = plant.world_frame(), [np.zeros((0, len(u)))]
        for cut in self._data["cuts"] if plant.num_constraints() and self._discrete else []:
            ends = [
                plant.CalcJacobianTranslationalVelocity(
                    context,
                    JacobianWrtVariable.kV,
                    self._bodies[cut[b]].body_frame(),
                    np.array(cut[f"s_{b}"])[:, None],
                    world,
                    world,
                )
                for b in ("i", "j")
            ]
            rows.append((ends[0] - ends[1]) @ V)
        return {
            "mass_matrix": M,
            "rest_forces": rest_forces,
            "forces": forces,
            "constraints": np.concatenate(rows),
            "kinetic": plant.CalcKineticEnergy(context),
            "potential": plant.CalcPotentialEnergy(context),
        }

    def advance(self, steps: int, dt: float) -> np.ndarray:
        """Advance by ``steps`` steps of ``dt`` [s] (0: of Drake's choice); return Drake's (t, q, v) after each.

        Where ``dt`` differs from before, the plant is built anew. ``stopped`` is set to the reason of a failure.
        """
        if dt and dt != self._dt:
            state, time = self._read_state(), self._time
            self._assemble(dt)
            self._restart(time, *np.split(state, [self._plant.num_positions()]))
        self._left, began = steps, self._time
        end = began + steps * dt if dt else self._data["t_end"]
        try:
            self._simulator.AdvanceTo(end - self._since)
        except RuntimeError as error:
            self.stopped = " ".join(str(error).split())
        log = self._log.FindLog(self._simulator.get_context())
        t, x = np.array(log.sample_times()) + self._since, np.array(log.data()).T
        log.Clear()
        least = NO_STEP * dt
        new = (t > began + least) & (np.diff(t, append=np.inf) > least)  # the last step may be cut in two by rounding
        if not dt and len(t) and np.isclose(t[-1], self._data["t_end"], rtol=1e-12):
            t[-1] = self._data["t_end"]
        if new.any():
            self._time = end if dt and not self.stopped else t[-1]
        return np.concatenate((t[new, None], x[new]), axis=1)

    def rows(self, made: np.ndarray) -> np.ndarray:
        """Convert rows ``made`` by ``advance`` to rows (q, u) of the tree, or (t, q, u) if Drake chooses the steps."""
        q, u = self._convert_to_tree(*np.split(made[:, 1:], [self._plant.num_positions()], axis=1))
        return np.concatenate(([] if self._data["dt"] else [made[:, :1]]) + [q, u], axis=1)

    def _assemble(self, dt: float) -> None:
        """Build Drake's plant, diagram and simulator for steps of ``dt`` [s], 0: of Drake's choice; set no state."""
        data, self._dt = self._data, dt
        builder = DiagramBuilder()
        plant = self._plant = AddMultibodyPlantSceneGraph(builder, dt if self._discrete else 0.0)[0]
        if self._discrete:
            approximation = getattr(DiscreteContactApproximation, APPROXIMATIONS[self._scheme])
            plant.set_discrete_contact_approximation(approximation)
        plant.mutable_gravity_field().set_gravity_vector(np.array(data["gravity"]))
        self._bodies: dict[int, Any] = {GROUND: plant.world_body()}
        self._joints: list[tuple[Any, dict[str, Any], Any]] = []
        for limb in data["limbs"]:
            self._add_limb(plant, limb)
        for spring in data["springs"]:
            ends = [x for b in ("i", "j") for x in (self._bodies[spring[b]], np.array(spring[f"p_{b}"]))]
            law = spring["rest_length"], spring["stiffness"], spring["damping"]
            plant.AddForceElement(LinearSpringDamper(*ends, *law))
        for cut in data["cuts"]:
            ends = [x for b in ("i", "j") for x in (self._bodies[cut[b]], np.array(cut[f"s_{b}"]))]
            plant.AddBallConstraint(*ends)
        plant.Finalize()
        self._log = LogVectorOutput(plant.get_state_output_port(), builder)
        if data["loads"]:
            loads = builder.AddSystem(Loads(data["loads"], self._bodies))
            builder.Connect(plant.get_body_poses_output_port(), loads.get_input_port())
            builder.Connect(loads.get_output_port(), plant.get_applied_spatial_force_input_port())
        self._simulator = Simulator(builder.Build())
        if not self._discrete:
            longest = dt or (0.1 if self._default else data["t_end"])
            integrator = ResetIntegratorFromFlags(self._simulator, self._scheme, longest)
            if dt:
                integrator.set_fixed_step_mode(True)
            else:
                integrator.set_target_accuracy(data["rtol"])
                self._simulator.set_monitor(self._count_step)

    def _add_limb(self, plant: Any, limb: dict[str, Any]) -> None:
        """Add a limb of the tree to the plant: its body, the joints that carry it, and their torsional spring.

        Between two joints there is a massless body.
        """
        b, name = limb["body"], f"body {limb['body']}"
        inertia = np.array(limb["inertia"])
        about = RotationalInertia(*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2])
        body = plant.AddRigidBody(name, SpatialInertia.MakeFromCentralInertia(limb["mass"], np.zeros(3), about))
        self._bodies[b], kind = body, limb["kind"]
        if kind == "FREE":
            joint = QuaternionFloatingJoint(name, plant.world_frame(), body.body_frame())
            self._joints.append((plant.AddJoint(joint), limb, np.eye(3)))
            return
        moves, A = limb["moves"], np.eye(3)
        if kind == "BALL":
            x, z = find_arm_and_normal(limb, self._data["gravity"])
            A = np.stack((x, np.cross(z, x), z), axis=1)
        if kind == "UNIVERSAL":
            x, y = (np.array(axis) for _, axis in moves)
            A = np.stack((x, y, np.cross(x, y)), axis=1)
        turned = RotationMatrix(np.array(limb["R_0"]) @ A)
        inner = plant.AddFrame(
            FixedOffsetFrame(
                f"{name} on",
                self._bodies[limb["parent"]].body_frame(),
                RigidTransform(turned, np.array(limb["s_parent"])),
            )
        )
        outer = plant.AddFrame(
            FixedOffsetFrame(
                f"{name} from", body.body_frame(), RigidTransform(RotationMatrix(A), np.array(limb["s_child"]))
            )
        )
        if kind == "FIXED":
            plant.WeldFrames(inner, outer)
        if kind == "BALL":
            self._joints.append((plant.AddJoint(BallRpyJoint(name, inner, outer)), limb, A))
        if kind == "UNIVERSAL":
            self._joints.append((plant.AddJoint(UniversalJoint(name, inner, outer)), limb, slice(0, 2)))
            moves = []
        for k, (slides, axis) in enumerate(moves):
            end = outer
            if k + 1 < len(moves):
                end = plant.AddRigidBody(f"{name}, massless", SpatialInertia.Zero()).body_frame()
            torsion, rates = limb["torsion"], {}
            if torsion is not None:
                rates["damping"] = torsion["damping"]
            kind = PrismaticJoint if slides else RevoluteJoint
            joint = plant.AddJoint(kind(f"{name}, joint {k}", inner, end, np.array(axis), **rates))
            if torsion is not None:
                plant.AddForceElement(RevoluteSpring(joint, torsion["rest_angle"], torsion["stiffness"]))
            inner = end
            self._joints.append((joint, limb, slice(k, k + 1)))

    def _restart(self, since: float, q: np.ndarray, v: np.ndarray) -> None:
        """Set Drake's positions ``q`` and velocities ``v`` at the run's time ``since`` [s], and Drake's clock to 0.

        Its discrete steps are at multiples of dt of that clock. The log of states is cleared.
        """
        self._since = self._time = since
        context = self._plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        self._plant.SetPositions(context, q)
        self._plant.SetVelocities(context, v)
        self._left = 1
        self._simulator.Initialize()
        self._log.FindLog(self._simulator.get_context()).Clear()

    def _read_state(self) -> np.ndarray:
        """Return Drake's present positions and velocities, one after the other."""
        context = self._plant.GetMyContextFromRoot(self._simulator.get_context())
        return np.array(self._plant.GetPositionsAndVelocities(context))

    def _count_step(self, context: Any) -> Any:
        """Count a step, as Drake's monitor; return the status that stops the simulator after the last step."""
        self._left -= 1
        done = self._left <= 0 < context.get_time()
        return EventStatus.ReachedTermination(self._plant, "") if done else EventStatus.Succeeded()

    def _sum_forces(self, context: Any) -> np.ndarray:
        """Return the generalised forces along Drake's velocities, except those of constraints.

        They are those of gravity, springs and loads less C v, the inertial terms.
        """
        plant, applied = self._plant, MultibodyForces(self._plant)
        plant.CalcForceElementsContribution(context, applied)
        for load in plant.get_applied_spatial_force_input_port().Eval(context) if self._data["loads"] else []:
            body = plant.get_body(load.body_index)
            to_body = body.EvalPoseInWorld(context).rotation()
            body.AddInForce(context, load.p_BoBq_B, load.F_Bq_W.Rotate(to_body.inverse()), body.body_frame(), applied)
        return -plant.CalcInverseDynamics(context, np.zeros(plant.num_velocities()), applied)

    def _convert_from_tree(self, q: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Drake's coordinates and velocities from those of the tree at the start (angles of balls are 0)."""
        theirs, v = np.zeros(self._plant.num_positions()), np.zeros(self._plant.num_velocities())
        for joint, limb, about in self._joints:
            at, to, i, j = limb["q_at"], limb["u_at"], joint.position_start(), joint.velocity_start()
            if limb["kind"] == "FREE":
                theirs[i : i + 7] = np.concatenate((q[at + 3 : at + 7], q[at : at + 3]))
                v[j : j + 6] = np.concatenate((np.array(limb["R"]) @ u[to + 3 : to + 6], u[to : to + 3]))
            elif limb["kind"] == "BALL":
                v[j : j + 3] = about.T @ u[to : to + 3]
            else:
                n = joint.num_positions()
                theirs[i : i + n], v[j : j + n] = q[at:][about], u[to:][about]
        return theirs, v

    def _convert_to_tree(self, theirs: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates q (nt, nq) and velocities u (nt, nu) of the tree from Drake's, ``theirs`` and ``v``."""
        q = np.zeros((len(theirs), len(self._data["start"])))
        u = np.zeros((len(v), len(self._data["start_velocity"])))
        for joint, limb, about in self._joints:
            at, to, i, j = limb["q_at"], limb["u_at"], joint.position_start(), joint.velocity_start()
            if limb["kind"] == "FREE":
                q[:, at : at + 3], q[:, at + 3 : at + 7] = theirs[:, i + 4 : i + 7], theirs[:, i : i + 4]
                u[:, to : to + 3], turned = v[:, j + 3 : j + 6], make_matrices(theirs[:, i : i + 4])
                u[:, to + 3 : to + 6] = np.einsum("tji,tj->ti", turned, v[:, j : j + 3])
            elif limb["kind"] == "BALL":
                turned = _make_quaternions(theirs[:, i : i + 3])
                q[:, at], q[:, at + 1 : at + 4] = turned[:, 0], turned[:, 1:] @ about.T
                u[:, to : to + 3] = np.einsum("tji,tj->ti", make_matrices(turned), v[:, j : j + 3]) @ about.T
            else:
                n = joint.num_positions()
                q[:, at:][:, about], u[:, to:][:, about] = theirs[:, i : i + n], v[:, j : j + n]
        return q, u


class Loads(LeafSystem):
    """A Drake system whose input is the poses of bodies, and whose output is the loads on their points."""

    def __init__(self, loads: list[dict[str, Any]], bodies: dict[int, Any]) -> None:
        """Set the ``loads`` of the protocol with Drake's ``bodies`` by index, and declare the ports."""
        super().__init__()
        self._loads = [(load, bodies[load["body"]].index()) for load in loads]
        self.DeclareAbstractInputPort("poses", AbstractValue.Make([RigidTransform()]))
        blank = AbstractValue.Make([ExternallyAppliedSpatialForce()])
        self.DeclareAbstractOutputPort("forces", lambda: blank, self._set_forces)

    def _set_forces(self, context: Any, output: Any) -> None:
        """Set ``output`` to all loads in space, at the time and the poses of ``context``; Drake calls this."""
        poses, forces = self.get_input_port().Eval(context), []
        for load, index in self._loads:
            force = ExternallyAppliedSpatialForce()
            force.body_index, force.p_BoBq_B = index, np.array(load["point"])
            R = poses[int(index)].rotation().matrix() if load["follows"] else np.eye(3)
            factor = evaluate_factor(load["factor"], context.get_time())
            force.F_Bq_W = SpatialForce(factor * (R @ load["torque"]), factor * (R @ load["force"]))
            forces.append(force)
        output.set_value(forces)


def _make_quaternions(rpy: np.ndarray) -> np.ndarray:
    """Return the quaternions (w, x, y, z) of R_z(yaw) R_y(pitch) R_x(roll), from angles (nt, 3) [rad]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(0.5 * rpy).T, np.sin(0.5 * rpy).T
    return np.stack(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ),
        axis=1,
    )
