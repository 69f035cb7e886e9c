"""Exudyn: redundant coordinates, implicit integrators, its own compiled loop without range checks.

A body is a node with Euler parameters and their norm as a constraint; a joint is a set of algebraic equations. Most
joints are Exudyn's generic joint about its z axis, both joint frames equal at the start, with marker 0 on body j: a
subset of its rows is then a subset of this project's rows. The generic joint does not know the rate of a drive
(1.13.6).

Redundant rows are left out, chosen by a pivoted QR of the rows in the frame in which Exudyn states them, or they are
kept: then with Tait-Bryan angles, whose nodes have no norm constraint, dense LU that ignores the singular Jacobian, and
rows of index 3 alone. Where the rows in use lose rank before all rows do, the rest of a stretch is discarded and a
model on better rows continues from there (``export.exudyn_rows``).

Exudyn's defaults remain: modified Newton, and smaller steps where the iteration fails; a run with smaller steps no
longer has a fixed step and ends there. Sensors record poses inside the timed loop. Between stretches Exudyn restarts
from its state and computes initial accelerations anew. Its explicit integrators take no joints.
"""

import contextlib
import io
import sys
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float

from ...harness.catalogue.options import option
from ...harness.catalogue.registry import solver
from ...harness.mechanics import so3
from ...harness.mechanics.consistency import project
from ...harness.mechanics.cut_trees.tree import DRIVES, KINDS, PARALLEL
from ...harness.mechanics.joints import JointKind, MovingKind
from ...harness.mechanics.joints.frames import choose_normals
from ...harness.mechanics.naming import name_body, name_joint
from ...harness.mechanics.state import State, States
from ...harness.mechanics.system import GROUND, MultibodySystem
from ...harness.mechanics.time_functions import evaluate_functions, find_varying
from ...harness.mechanics.types import Problem, Status, StepControl, Trajectory
from ..formulations.packages import find_remedy
from ..formulations.recording import Clock, ClockedSolver
from .export.engine import SupportedElements, describe_engine, import_package, refuse_unsupported
from .export.exudyn_rows import KeptRows, make_joint_frames
from .export.march import PartialStretch, march
from .export.model_check import EngineModel, refuse_model

INTEGRATORS = ("TrapezoidalIndex2", "GeneralizedAlpha")
# outputs of a body and their sizes
OUTPUTS = {"Position": 3, "RotationMatrix": 9, "Velocity": 3, "AngularVelocityLocal": 3}
SMALLER = "its iteration failed and it took a smaller step than dt"
SHORT = 32  # least steps of a stretch after rows were chosen anew
WITHIN = "the rows in use become dependent within a step, and no others hold on both sides of it: reduce dt"
STEEP = 0.99  # sine of the second angle
# with all rows, a four-bar linkage rotated against the axes stops moving within a step of TrapezoidalIndex2
KEPT = (
    "TrapezoidalIndex2 holds rows as velocities, and off the constraints the redundant ones are independent and take "
    "freedoms away: set integrator=GeneralizedAlpha or redundant_rows=drop"
)
ON_GRID = 1e-6  # share of a step: recorded times are sums of steps
AXIAL = (JointKind.REVOLUTE, JointKind.CYLINDRICAL)


@solver("exudyn")
@dataclass(frozen=True)
class Exudyn(ClockedSolver):
    """Exudyn's implicit integrators in redundant coordinates."""

    integrator: str = option("TrapezoidalIndex2", "Exudyn's name of it", choices=INTEGRATORS)
    spectral_radius: float = option(0.9, "spectral radius of generalised alpha at infinity", at_least=0.0, at_most=1.0)
    redundant_rows: str = option("drop", "rows that depend on others at the start", choices=("drop", "keep"))
    newton_relative: float = option(1e-8, "tolerance of its Newton method, relative; 1e-8 is its own", above=0.0)
    newton_absolute: float = option(1e-10, "tolerance of its Newton method, absolute; 1e-10 is its own", above=0.0)

    own_angles: ClassVar[bool] = True
    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"
    takes: ClassVar[SupportedElements] = SupportedElements(
        (*KINDS, JointKind.ON_LINE, JointKind.ON_PLANE, JointKind.NORMAL, JointKind.DISTANCE, MovingKind.ROLLING),
        loads="varying",
        lacks={
            **dict.fromkeys(DRIVES, "its generic joint knows no rate of a prescribed motion"),
            MovingKind.DRIVEN_DISTANCE: "its distance is a number",
        },
    )
    order: ClassVar[float] = 2.0

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why Exudyn cannot integrate the problem, or None.

        Causes: Exudyn is missing, elements that it does not have, a singular start of Tait-Bryan angles, redundant rows
        that the integrator cannot keep, or a model that differs from this project's equations.
        """
        reason = find_remedy("exudyn") or refuse_unsupported(problem.system, self.takes)
        if reason is not None:
            return reason
        try:
            model = Model(self, problem, control)
        except ValueError as error:
            return f"Exudyn does not take the model: {error}"
        if model.keeps_all_rows and self.integrator == "TrapezoidalIndex2":
            return KEPT
        steep = np.abs(problem.initial.R[:, 0, 2]) > STEEP
        if model.keeps_all_rows and np.any(steep):
            which = name_body(problem.system, int(np.argmax(steep)))
            return f"Tait-Bryan angles are singular at the start of {which}: turn it, e.g. rotation=0.3,-0.5,0.7"
        return refuse_model(self.name, problem, model.describe_start())

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Integrate by Exudyn's own loop with the fixed step ``control.dt``, and return the trajectory."""
        model = Model(self, problem, control)
        return replace(march(problem, control, model.advance, model.states, clock=clock, notes=()), notes=model.notes())


class Model:
    """An assembled Exudyn system in its state at the end of the last stretch, with sensors that record its motion."""

    def __init__(self, options: Exudyn, problem: Problem, control: StepControl) -> None:
        """Choose the constraint rows in use, and assemble the system at the start of the problem."""
        self._exu, self._options, self._problem = _import_exudyn(), options, problem
        self._time, self._longest_stretch = 0.0, sys.maxsize  # [s], and in steps
        self._changes = list[float]()  # times [s] at which rows were chosen anew
        keep = options.redundant_rows == "keep"
        self._rows, self._last = KeptRows(problem.system, problem.initial), problem.initial
        self._left_out = np.flatnonzero(~self._rows.kept)
        self.keeps_all_rows = keep and len(self._left_out) > 0
        if self.keeps_all_rows:
            self._rows = KeptRows(problem.system, problem.initial, np.ones(problem.system.nrows, dtype=bool))
        self._node = "RotationRxyz" if self.keeps_all_rows else "RotationEulerParameters"
        self._assemble(problem.initial)

    def _assemble(self, start: State) -> None:
        """Build and assemble a new Exudyn system, with the constraint rows in use, in the state ``start``."""
        system, kept = self._problem.system, self._rows.kept
        self._container = self._exu.SystemContainer()
        self.mbs = mbs = self._container.AddSystem()
        self._ground = mbs.AddObject(self._exu.itemInterface.ObjectGround())
        self.bodies: list[Any] = []
        for b in range(system.nb):
            self.bodies.append(self._add_body(system, start, b))
        for k in range(system.nj):
            self._add_joint(system, start, k, kept[system.row_start[k] : system.row_start[k + 1]])
        for k in range(len(system.spring_k)):
            self._add_spring(system, k)
        for k in range(len(system.torsion_k)):
            self._add_torsional_spring(system, start, k)
        for k in range(len(system.load_i)):
            self._add_load(system, k)
        self._sensors = [[self._add_sensor(b, name) for name in OUTPUTS] for b in self.bodies]
        mbs.Assemble()

    def advance(self, steps: int, dt: float) -> Float[np.ndarray, "k n"]:
        """Advance by up to ``steps`` steps of ``dt`` [s]; return one array row of all bodies' states after each step.

        A row has 18 numbers per body: r, R by rows, v [space] and Omega [body]. Fewer steps than asked for are taken
        soon after another choice of constraint rows, and where the rows in use lose rank; the system is then assembled
        with others. Raises ``PartialStretch`` with the rows so far where Exudyn fails or takes a smaller step, or no
        better choice exists.
        """
        steps = min(steps, self._longest_stretch)
        start, end = self._time, self._time + steps * dt
        kind, words = getattr(self._exu.DynamicSolverType, self._options.integrator), "its solver failed"
        try:
            ended = self.mbs.SolveDynamic(
                self._make_settings(start, end, steps), solverType=kind, updateInitialValues=True
            )
        except Exception as error:  # a failure of the engine is a result; its class is not public
            ended, words = False, " ".join(str(error).split())
        stored = [[self.mbs.GetSensorStoredData(s) for s in of_body] for of_body in self._sensors]
        t = stored[0][0][:, 0]
        rows = np.concatenate([series[:, 1:] for of_body in stored for series in of_body], axis=1)
        on_grid = np.abs(t[: steps + 1] - start - dt * np.arange(min(len(t), steps + 1))) < ON_GRID * dt
        rows = rows[1 : len(on_grid) if np.all(on_grid) else int(np.argmin(on_grid))]
        states = self.states(rows)
        if worn := self._rows.examine_states(states, dt):
            rows = rows[: worn.last + 1]
            self._choose_rows(worn.better, rows, dt)
            return rows
        self._time, self._longest_stretch = end, 2 * self._longest_stretch
        if not ended or len(rows) < steps:
            raise PartialStretch(Status.DIVERGED, words if not ended else SMALLER, rows)
        self._last = states[-1]
        return rows

    def _choose_rows(self, kept: Bool[np.ndarray, " nrows"] | None, rows: Float[np.ndarray, "k n"], dt: float) -> None:
        """Assemble the system anew with the constraint rows that ``kept`` flags, in the state of the last of ``rows``.

        ``rows`` are those of ``advance``, ``dt`` [s] apart; the state is projected onto the constraints. The next
        stretch is short, since it may be discarded. Raises ``PartialStretch`` where ``kept`` is None, where rows were
        already changed at this time, or where the projection fails.
        """
        system, start = self._problem.system, self.states(rows[-1:])[0] if len(rows) else self._last
        self._time, self._longest_stretch = self._time + len(rows) * dt, max(SHORT, 2 * len(rows))
        if kept is None or self._time in self._changes:
            raise PartialStretch(Status.DIVERGED, WITHIN, rows)
        self._changes.append(self._time)
        try:  # norms of Euler parameters drift where their constraint acts on velocities
            self._last = project(system, replace(start, R=so3.exp(so3.log(start.R)), t=self._time))
            self._rows = KeptRows(system, self._last, kept)
            self._assemble(self._last)
        except ValueError as error:
            raise PartialStretch(Status.DIVERGED, f"rows could not be chosen anew: {error}", rows) from None

    def states(self, rows: Float[np.ndarray, "k n"]) -> States:
        """Convert rows of ``advance`` to poses and velocities of the bodies."""
        by_body = rows.reshape(len(rows), len(self.bodies), -1)
        r, R, v, Omega = np.split(by_body, np.cumsum(list(OUTPUTS.values()))[:-1], axis=2)
        return States(r, R.reshape(*R.shape[:2], 3, 3), v, Omega)

    def describe_start(self) -> EngineModel:
        """Return Exudyn's mass matrix, forces and constraints at the start, for the model check.

        Side effect: the velocities of its system are zero afterwards. The rows ``idle`` are p . p_ddot = -p_dot . p_dot
        of Euler parameters p, which move no body.
        """
        mbs, start, n = self.mbs, self._problem.initial, 6 if self.keeps_all_rows else 7
        solver, settings = self._exu.MainSolverImplicitSecondOrder(), self._make_settings(0.0, self._problem.t_end, 1)
        solver.InitializeSolver(mbs, settings)
        size = solver.GetODE2size()
        solver.ComputeMassMatrix(mbs)
        mass_matrix = np.array(solver.GetSystemMassMatrix())
        solver.ComputeJacobianAE(mbs, 0.0, 1.0, velocityLevel=True)
        G = np.array(solver.GetSystemJacobian())[size:, :size]
        reference = mbs.systemData.GetODE2Coordinates(configuration=self._exu.ConfigurationType.Reference)
        q = np.array(reference) + np.array(mbs.systemData.GetODE2Coordinates())
        u = np.array(mbs.systemData.GetODE2Coordinates_t())
        T, bias, norms = np.zeros((6 * start.nb, size)), np.zeros((start.nb, 6)), np.zeros((start.nb, size))
        of_rates = _map_tait_bryan_rates if self.keeps_all_rows else _map_euler_rates
        for b in range(start.nb):
            place, turning = slice(n * b, n * b + 3), slice(n * b + 3, n * (b + 1))
            T[6 * b : 6 * b + 3, place] = np.eye(3)
            T[6 * b + 3 : 6 * b + 6, turning], bias[b, 3:] = of_rates(q[turning], u[turning])
            norms[b, turning] = q[turning]
        energy = self._exu.OutputVariableType.KineticEnergy
        solver.ComputeODE2RHS(mbs)
        forces = np.array(solver.GetSystemResidual())[:size]
        kinetic = float(sum(mbs.GetObjectOutputBody(body, energy, np.zeros(3)) for body in self.bodies))
        mbs.systemData.SetODE2Coordinates_t(0.0 * u)
        solver.ComputeODE2RHS(mbs)
        rest_forces = np.array(solver.GetSystemResidual())[:size]
        idle = None if self.keeps_all_rows else (norms, -np.sum(u.reshape(-1, 7)[:, 3:] ** 2, axis=1))
        # gravity is a load without a potential
        return EngineModel(T, mass_matrix, rest_forces, kinetic, None, bias, forces, G, idle)

    def notes(self) -> tuple[str, ...]:
        """Return notes for the run: constraint rows in use and left out, times of changes, and Exudyn's version."""
        dropped, times = ", ".join(map(str, self._left_out)), ", ".join(f"{t:.4g}" for t in self._changes)
        return (
            f"{int(np.sum(self._rows.kept))} of {self._problem.system.nrows} constraint rows",
            *((f"left out, redundant at the start: {dropped}",) if dropped and not self.keeps_all_rows else ()),
            *((f"rows chosen anew at t = {times} s",) if times else ()),
            describe_engine("exudyn"),
        )

    def _make_settings(self, start: float, end: float, steps: int) -> Any:
        """Return Exudyn's ``SimulationSettings`` for ``steps`` equal steps from time ``start`` to ``end`` [s].

        Tolerances and damping are the solver's options; sensors record every step, one thread runs, no file is written.
        """
        s, options = self._exu.SimulationSettings(), self._options
        t = s.timeIntegration
        t.numberOfSteps, t.startTime, t.endTime, t.verboseMode = steps, start, end, 0
        t.generalizedAlpha.spectralRadius = options.spectral_radius
        t.newton.relativeTolerance, t.newton.absoluteTolerance = options.newton_relative, options.newton_absolute
        s.solution.file.write = False
        s.solution.sensors.writePeriod = (end - start) / steps
        s.parallel.numberOfThreads = 1
        s.linearSolver.solverType = getattr(
            self._exu.LinearSolverType, "EigenDense" if self.keeps_all_rows else "EigenSparse"
        )
        s.linearSolver.ignoreSingularJacobian = self.keeps_all_rows
        return s

    def _add_body(self, system: MultibodySystem, start: State, b: int) -> Any:
        """Add body ``b`` in the state ``start``, with gravity, to Exudyn's system; return its item number there."""
        inertia = self._exu.rigidBodyUtilities.RigidBodyInertia(system.mass[b], system.regular_inertia[b])
        return self.mbs.CreateRigidBody(
            referencePosition=start.r[b],
            referenceRotationMatrix=start.R[b],
            initialVelocity=start.v[b],
            initialAngularVelocity=start.R[b] @ start.Omega[b],  # Exudyn's is in space
            inertia=inertia,
            gravity=system.gravity,
            nodeType=getattr(self._exu.NodeType, self._node),
        )

    def _add_marker(self, body: int, place: np.ndarray, rotation: np.ndarray | None = None) -> Any:
        """Add a marker on ``body``, or on the ground (-1), to Exudyn's system; return its item number there.

        ``place`` [m] and the columns of ``rotation`` (None: the identity) are in the frame of the body.
        """
        number = self._ground if body == GROUND else self.bodies[body]
        frame = self._exu.HT(rotation=np.eye(3) if rotation is None else rotation, translation=place)
        return self.mbs.AddMarker(self._exu.itemInterface.MarkerBodyRigid(bodyNumber=number, localHT=frame))

    def _add_joint(self, system: MultibodySystem, start: State, k: int, rows: Bool[np.ndarray, " n"]) -> None:
        """Add joint ``k`` in the state ``start``, with those of its constraint rows that ``rows`` flags."""
        items, i, j = self._exu.itemInterface, int(system.joint_i[k]), int(system.joint_j[k])
        s_i, s_j = system.joint_s_i[k], system.joint_s_j[k]
        if system.joint_kind(k) == JointKind.SPHERICAL:
            markers = [self._add_marker(i, s_i), self._add_marker(j, s_j)]
            self.mbs.AddObject(items.SphericalJoint(markerNumbers=markers, constrainedAxes=rows.astype(int).tolist()))
            return
        if system.joint_kind(k) == JointKind.DISTANCE:
            markers = [self._add_marker(i, s_i), self._add_marker(j, s_j)]
            if rows[0]:
                length = float(system.joint_length[k])
                self.mbs.AddObject(items.DistanceConstraint(markerNumbers=markers, distance=length))
            return
        if system.joint_kind(k) == MovingKind.ROLLING:
            self._add_disc(system, k, rows)
            return
        in_i, in_j = make_joint_frames(system, start, k)
        places = int(system.joint_points[k] + system.joint_lines[k])
        held = dict(zip((*range(places), 4, 3, 5), rows, strict=False))  # a row on x stops turning about y
        markers = [self._add_marker(j, s_j, in_j), self._add_marker(i, s_i, in_i)]
        axes = [int(held.get(n, False)) for n in range(6)]
        self.mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=axes))

    def _add_spring(self, system: MultibodySystem, k: int) -> None:
        """Add spring-damper ``k`` of the system to Exudyn's."""
        i, j = int(system.spring_i[k]), int(system.spring_j[k])
        markers = [self._add_marker(i, system.spring_p_i[k]), self._add_marker(j, system.spring_p_j[k])]
        law = {"stiffness": system.spring_k[k], "damping": system.spring_c[k], "referenceLength": system.spring_d0[k]}
        self.mbs.AddObject(self._exu.itemInterface.SpringDamper(markerNumbers=markers, **law))

    def _add_torsional_spring(self, system: MultibodySystem, start: State, k: int) -> None:
        """Add torsional spring ``k``; Exudyn measures its angle from marker 0, which is at the rest angle, to marker 1.

        Raises ValueError for a spring not about the axis of a hinge or cylinder, or wound by whole turns at the start.
        """
        i, j, (e, b) = int(system.torsion_i[k]), int(system.torsion_j[k]), system.torsion_n[k]
        R, axis, u = np.concatenate((start.R, np.eye(3)[None])), np.cross(e, b), system.torsion_u[k]
        in_i = R[i].T @ R[j] @ axis
        ends = list(zip(system.joint_i.tolist(), system.joint_j.tolist(), strict=True))
        hinges = [
            system.joint_u[n] if ends[n][0] == j else np.cross(*system.joint_n[n, :2])
            for n in range(system.nj)
            if set(ends[n]) == {i, j} and system.joint_kind(n) in AXIAL
        ]
        if not any(abs(abs(axis @ hinge) - 1.0) < PARALLEL for hinge in hinges):
            raise ValueError("a torsional spring is not about the axis of a hinge or a cylinder")
        angle = float(system.torsion_rest[k])
        if system.torsion_wound[k]:
            raise ValueError("a torsional spring is wound by whole turns at the start")
        at_rest = np.cos(angle) * e + np.sin(angle) * b
        markers = [
            self._add_marker(j, np.zeros(3), np.column_stack((at_rest, np.cross(axis, at_rest), axis))),
            self._add_marker(i, np.zeros(3), np.column_stack((u, np.cross(in_i, u), in_i))),
        ]
        law = {"stiffness": float(system.torsion_k[k]), "damping": float(system.torsion_c[k])}
        self.mbs.AddObject(self._exu.itemInterface.TorsionalSpringDamper(markerNumbers=markers, **law))

    def _add_disc(self, system: MultibodySystem, k: int, rows: Bool[np.ndarray, " n"]) -> None:
        """Add joint ``k``, a disc that turns about x of its marker and rolls on the x-y plane of the ground's marker.

        Raises ValueError unless it rolls on the ground, about its centre of mass, with all its rows in use.
        """
        i, j, n, u = int(system.joint_i[k]), int(system.joint_j[k]), system.joint_n[k], system.joint_u[k]
        if j != GROUND or np.any(system.joint_s_i[k]) or not np.all(rows):
            raise ValueError(
                f"{name_joint(system, k)}: a disc has to roll on the ground about its centre of mass, "
                "and none of its rows may depend on others"
            )
        markers = [
            self._add_marker(j, system.joint_s_j[k], np.column_stack((*n[1:], n[0]))),
            self._add_marker(i, np.zeros(3), np.column_stack((u, *choose_normals(u)))),
        ]
        radius = float(system.joint_length[k])
        self.mbs.AddObject(
            self._exu.itemInterface.RollingDiscJoint(
                markerNumbers=markers, discRadius=radius, discAxis=[1, 0, 0], planeNormal=[0, 0, 1]
            )
        )

    def _add_load(self, system: MultibodySystem, k: int) -> None:
        """Add load ``k``, force and torque; a factor that varies with time is computed in Python in each evaluation."""
        marker, factor = self._add_marker(int(system.load_i[k]), system.load_p[k]), system.load_factor[k : k + 1]
        items, follows, now = (
            self._exu.itemInterface,
            bool(system.load_follows[k]),
            evaluate_functions(factor, np.zeros(1))[0],
        )
        for kind, vector in (
            (items.LoadForceVector, system.load_force[k]),
            (items.LoadTorqueVector, system.load_torque[k]),
        ):
            if not np.any(vector):
                continue
            law = {}
            if find_varying(factor)[0]:
                law["loadVectorUserFunction"] = lambda mbs, t, _, vector=vector: (
                    float(evaluate_functions(factor, np.array([t]))[0][0, 0]) * vector
                )
            self.mbs.AddLoad(kind(markerNumber=marker, loadVector=float(now[0, 0]) * vector, bodyFixed=follows, **law))

    def _add_sensor(self, body: Any, name: str) -> Any:
        """Add a sensor that records an output of ``body``, a key of ``OUTPUTS``, in memory; return its number."""
        kind = getattr(self._exu.OutputVariableType, name)
        sensor = self._exu.itemInterface.SensorBody(
            bodyNumber=body, outputVariableType=kind, storeInternal=True, writeToFile=False
        )
        return self.mbs.AddSensor(sensor)


def _import_exudyn() -> ModuleType:
    """Import Exudyn and return the module, after setting ``sys.exudynFast``, which omits its range checks."""
    sys.exudynFast = True  # type: ignore[attr-defined]  # its own switch, read at import
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a message about that
        return import_package("exudyn", "itemInterface", "rigidBodyUtilities")


def _map_euler_rates(p: Float[np.ndarray, " 4"], rate: Float[np.ndarray, " 4"]) -> tuple[np.ndarray, np.ndarray]:
    """Return G of Omega = G p_dot [body] for Euler parameters ``p``, and G_dot p_dot, which is zero.

    The second is the part of Omega_dot without p_ddot; ``rate`` is p_dot.
    """
    a, b, c, d = p
    return 2.0 * np.array([[-b, a, d, -c], [-c, -d, a, b], [-d, c, -b, a]]), np.zeros(3)


def _map_tait_bryan_rates(
    angles: Float[np.ndarray, " 3"], rate: Float[np.ndarray, " 3"]
) -> tuple[np.ndarray, np.ndarray]:
    """Return G of Omega = G rate [body] for R = R_x R_y R_z of ``angles`` [rad], and G_dot rate.

    The second is the part of Omega_dot without second derivatives; ``rate`` [rad/s] are those of the angles.
    """
    (sb, cb), (sc, cc) = ((np.sin(x), np.cos(x)) for x in angles[1:])
    _, b, c = rate
    G = np.array([[cb * cc, sc, 0.0], [-cb * sc, cc, 0.0], [sb, 0.0, 1.0]])
    G_dot = [[-sb * cc * b - cb * sc * c, cc * c, 0.0], [sb * sc * b - cb * cc * c, -sc * c, 0.0], [cb * b, 0.0, 0.0]]
    return G, np.array(G_dot) @ rate
