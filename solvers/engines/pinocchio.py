"""Pinocchio: joint coordinates of a tree, cut joints as rigid constraints, stepped by a loop in this file.

Pinocchio computes accelerations and has no integrator: ``aba`` for trees, ``constraintDynamics`` (proximal, redundant
rows allowed) with a ``CONTACT_3D`` per point of a cut joint. The loop is in Python, and its overhead is part of the CPU
time. ``RKMK4`` is the classical Runge-Kutta scheme in local coordinates theta of the step, q = q_0 + theta::

    theta' = v + theta x v/2 + theta x (theta x v)/12  (of ball joints, order 4),   v' = acceleration(q, v)

``Euler`` is v_1 = v_0 + h a, q_1 = q_0 + h v_1, as in most scripts. Constraints hold through accelerations alone unless
``gain`` turns Pinocchio's corrector on, K_d = 2 gain, K_p = gain^2. Pinocchio has no springs.
"""

from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics.cut_trees.tree import DRIVES, EngineTree, Kind, build_spanning_tree
from ...harness.mechanics.joints import JointKind
from ...harness.mechanics.system import GROUND
from ...harness.mechanics.types import Problem, States, StepControl, Trajectory
from ..formulations.packages import find_remedy
from ..formulations.recording import Clock, ClockedSolver
from .export.engine import (
    LOADS,
    SPRINGS,
    TORSIONS,
    VARYING,
    SupportedElements,
    describe_engine,
    import_package,
    refuse_unsupported,
)
from .export.march import march
from .export.model_check import EngineModel, refuse_model

INTEGRATORS = {"RKMK4": 4.0, "Euler": 1.0}
STRETCH = 1_000  # steps times bodies between two readings of the clock


@solver("pinocchio")
@dataclass(frozen=True)
class Pinocchio(ClockedSolver):
    """Pinocchio's accelerations, integrated by a Runge-Kutta or semi-implicit Euler loop in Python."""

    integrator: str = option("RKMK4", "the loop's; Euler is semi-implicit", choices=tuple(INTEGRATORS))
    gain: float = option(0.0, "gain of the constraint corrector, as Baumgarte's alpha = beta", "1/s", at_least=0.0)
    accuracy: float = option(1e-12, "accuracy of the proximal iteration", above=0.0)
    mu: float = option(1e-10, "regularisation of the proximal iteration, which removes it", above=0.0)
    iterations: int = option(20, "most iterations of the proximal solver", at_least=1)

    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"
    takes: ClassVar[SupportedElements] = SupportedElements(
        springs=False,
        torsions=False,
        lacks={
            **dict.fromkeys((SPRINGS, TORSIONS, LOADS, VARYING), "forces are what its caller computes"),
            **dict.fromkeys(DRIVES, "it has no prescribed motion"),
            JointKind.DISTANCE: "its constraints are of points and frames",
        },
    )

    @property
    def order(self) -> float:
        """Order of the integrator."""
        return INTEGRATORS[self.integrator]

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why Pinocchio cannot integrate the problem, or None.

        Causes: Pinocchio is missing, elements that it does not have, or a model that differs from this project's
        equations.
        """
        if (reason := find_remedy("pinocchio", "pin") or refuse_unsupported(problem.system, self.takes)) is not None:
            return reason
        try:
            return refuse_model(self.name, problem, Model(self, problem, control).describe_start())
        except ValueError as error:
            return str(error)

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate by the loop in Python with the fixed step ``control.dt`` and return the trajectory."""
        model = Model(self, problem, control)
        return march(problem, control, model.advance, model.states, clock=clock, notes=model.notes(), stretch=STRETCH)


class Model:
    """A Pinocchio model with its cut joints, and its state (q, u) after the last step."""

    def __init__(self, options: Pinocchio, problem: Problem, control: StepControl) -> None:
        """Build the model and a rigid constraint per point of a cut joint, at the start of the problem."""
        self.pin, self.problem, self._options = (pin := import_package("pinocchio")), problem, options
        self.tree = tree = build_spanning_tree(problem.system, problem.initial)
        self.model, self._joint, self._placements = _build_model(pin, problem, tree)
        self.data = self.model.createData()
        self.cuts, self._constraint_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for cut in tree.cuts:
            ends = (
                (self._joint[b], self._placements[b] * pin.SE3(np.eye(3), s))
                for b, s in ((cut.i, cut.s_i), (cut.j, cut.s_j))
            )
            (i, at_i), (j, at_j) = ends
            held = pin.RigidConstraintModel(
                pin.ContactType.CONTACT_3D, self.model, i, at_i, j, at_j, pin.ReferenceFrame.LOCAL
            )
            held.setBaumgarteCorrectorParameters(pin.BaumgarteCorrectorParameters(options.gain**2, 2.0 * options.gain))
            self.cuts.append(held)
            self._constraint_data.append(held.createData())
        pin.initConstraintDynamics(self.model, self.data, self.cuts, self._constraint_data)
        self._proximal = pin.ProximalSettings(options.accuracy, options.mu, options.iterations)
        self._no_torque = np.zeros(self.model.nv)
        balls = [limb for limb in tree.limbs if limb.kind.has_quaternion]
        first = [limb.u_at + (3 if limb.kind is Kind.FREE else 0) for limb in balls]
        self._turning = np.array(first, dtype=int)[:, None] + np.arange(3)
        self._quaternions = np.array([limb.q_at + (3 if limb.kind is Kind.FREE else 0) for limb in balls], dtype=int)
        self.q, self.u = self._convert_from_tree(tree.start), tree.start_velocity.copy()

    def advance(self, steps: int, dt: float) -> Float[np.ndarray, "k n"]:
        """Advance by ``steps`` steps of ``dt`` [s]; return a row (q, u) in Pinocchio's coordinates after each."""
        step = self._step_rkmk4 if self._options.integrator == "RKMK4" else self._step_euler
        rows = np.empty((steps, self.model.nq + self.model.nv))
        for k in range(steps):
            self.q, self.u = step(self.q, self.u, dt)
            rows[k, : self.model.nq], rows[k, self.model.nq :] = self.q, self.u
        return rows

    def states(self, rows: Float[np.ndarray, "k n"]) -> States:
        """Convert rows of ``advance`` to poses and velocities of the bodies."""
        nq = self.model.nq
        return self.tree.states(self._convert_to_tree(rows[:, :nq]), rows[:, nq:])

    def describe_start(self) -> EngineModel:
        """Return Pinocchio's mass matrix, forces, energies and constraints, for the model check.

        They are evaluated at the present state, which has to be the start.
        """
        pin, m, d, q, u = self.pin, self.model, self.model.createData(), self.q, self.u
        upper = np.triu(pin.crba(m, d, q))
        mass_matrix = upper + np.triu(upper, 1).T
        forces = -pin.nonLinearEffects(m, d, q, u)
        rest_forces = -pin.computeGeneralizedGravity(m, d, q)
        kinetic, potential = pin.computeKineticEnergy(m, d, q, u), pin.computePotentialEnergy(m, d, q)
        self._accelerate(q, u)  # places the frames of the constraints
        pin.computeJointJacobians(m, self.data, q)
        G = np.zeros((0, m.nv))
        if len(self.cuts):
            G = np.array(pin.getConstraintsJacobian(m, self.data, self.cuts, self._constraint_data))
        T, bias = self.tree.jacobian(), self.tree.bias(self.problem.initial)
        return EngineModel(T, mass_matrix, rest_forces, kinetic, potential, bias, forces, G)

    def notes(self) -> tuple[str, ...]:
        """Return notes for the run: tree and cut joints, the loop in Python, Pinocchio's version."""
        cuts = f"; {len(self.cuts)} points of cut joints held rigidly" if len(self.cuts) else ""
        limbs = f"{len(self.tree.limbs)} bodies as a tree of {self.model.nv} velocities{cuts}"
        return limbs, f"own loop {self._options.integrator} in Python, its overhead counted", describe_engine("pin")

    def _accelerate(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return Pinocchio's accelerations u_dot at q and u: by ``aba``, or ``constraintDynamics`` with cut joints."""
        if not len(self.cuts):
            return self.pin.aba(self.model, self.data, q, u, self._no_torque)
        return self.pin.constraintDynamics(
            self.model, self.data, q, u, self._no_torque, self.cuts, self._constraint_data, self._proximal
        )

    def _step_rkmk4(self, q: np.ndarray, u: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Return (q, u) after a Runge-Kutta-Munthe-Kaas step of ``h`` [s] of order 4, in local coordinates theta.

        Slopes at 0, 1/2, 1/2, 1 have the weights 1, 2, 2, 1.
        """
        slope, rate = u, np.array(self._accelerate(q, u))
        theta, change = slope.copy(), rate.copy()
        for fraction, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            local, u_here = fraction * h * slope, u + fraction * h * rate
            slope = self._find_local_rate(local, u_here)
            rate = np.array(self._accelerate(self.pin.integrate(self.model, q, local), u_here))
            theta, change = theta + weight * slope, change + weight * rate
        return self.pin.integrate(self.model, q, h / 6.0 * theta), u + h / 6.0 * change

    def _step_euler(self, q: np.ndarray, u: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Return (q, u) after a semi-implicit Euler step of ``h`` [s]."""
        u = u + h * self._accelerate(q, u)
        return self.pin.integrate(self.model, q, h * u), u

    def _find_local_rate(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return theta', the rates of the local coordinates ``theta`` of a step, at velocities ``u``, to order 4.

        They differ from ``u`` for ball and free joints only.
        """
        out = u.copy()
        if len(self._turning):
            a, w = theta[self._turning], u[self._turning]
            once = _cross(a, w)
            out[self._turning] += 0.5 * once + _cross(a, once) / 12.0
        return out

    def _convert_from_tree(self, q: np.ndarray) -> np.ndarray:
        """Return the tree's coordinates ``q`` (nq,) with quaternions in Pinocchio's order, (x, y, z, w)."""
        out = q.copy()
        for at in self._quaternions:
            out[at : at + 4] = np.roll(q[at : at + 4], -1)
        return out

    def _convert_to_tree(self, q: Float[np.ndarray, "k nq"]) -> Float[np.ndarray, "k nq"]:
        """Return Pinocchio's coordinates ``q`` (k, nq) with quaternions in the tree's order, (w, x, y, z)."""
        out = q.copy()
        for at in self._quaternions:
            out[:, at : at + 4] = np.roll(q[:, at : at + 4], 1, axis=1)
        return out


def _build_model(pin: ModuleType, problem: Problem, tree: EngineTree) -> tuple[Any, dict[int, int], dict[int, Any]]:
    """Return Pinocchio's model, whose joints are in the tree's order, and two dictionaries by body.

    They have the index of the joint that carries the body, and the body's placement (SE3) in that joint's frame.
    """
    system, model = problem.system, pin.Model()
    model.gravity.linear = np.array(system.gravity)
    joint, at, zero = {GROUND: 0}, {GROUND: pin.SE3.Identity()}, pin.SE3.Identity()
    for limb in tree.limbs:
        b, moves = limb.body, []
        if limb.kind is Kind.FREE:
            moves = [pin.JointModelTranslation()]
        if limb.kind.has_quaternion:
            moves += [pin.JointModelSpherical()]
        for slides, axis in limb.list_moves():
            moves += [(pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned)(axis)]
        here = zero if limb.kind is Kind.FREE else at[limb.parent] * pin.SE3(limb.R_0, limb.s_parent)
        joint[b], at[b] = joint[limb.parent], pin.SE3(np.eye(3), -np.array(limb.s_child))
        if not moves:
            at[b] = here * at[b]
        for k, move in enumerate(moves):
            joint[b] = model.addJoint(joint[b], move, zero if k else here, f"body {b}, joint {k}")
        inertia = pin.Inertia(float(system.mass[b]), np.zeros(3), np.array(system.regular_inertia[b]))
        model.appendBodyToJoint(joint[b], inertia, at[b])
    return model, joint, at


def _cross(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return a x b of each row; ``np.cross`` takes four times as long on a few rows."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
