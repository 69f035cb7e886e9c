"""Exudyn's index-2 trapezoidal integrator on a problem, with fixed step: a compiled engine to compare with.

Its own defaults (modified Newton, step recovery), no files, one thread, the fastest of its linear solvers that takes
the model: sparse LU, or dense LU with the singular Jacobian ignored when redundant rows are kept. The model is built
by the engine's public interface from any bodies, joints and springs. Joint rows keep our order of ends: marker 0 on
body i, marker 1 on body j or the ground. A revolute joint is Exudyn's generic joint about its z axis, both joint frames
equal at the start. Redundant rows are kept, or left out as chosen by a pivoted QR of the rows in the frame in which
Exudyn states them.
"""

import importlib
import time
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import scipy.linalg as sl
from jaxtyping import Bool, Float

from ..mechanics.jacobian import constraint_jacobian
from ..mechanics.state import State, States
from ..mechanics.system import GROUND, MultibodySystem
from ..types import Problem, Status, Trajectory

PIVOT = 1e-9  # of the largest pivot: rounding is 1e-15, true pivots are above 1e-3
OUTPUTS = ("Position", "RotationMatrix", "Velocity", "AngularVelocityLocal")
NAME = "exudyn"


class Model:
    """An assembled Exudyn system and the handles to read its motion."""

    def __init__(self, exu: ModuleType, system: MultibodySystem, start: State, node: str, *, keep: bool, record: bool):
        items = exu.itemInterface
        self._exu = exu
        self._container = exu.SystemContainer()
        self.mbs = mbs = self._container.AddSystem()
        self._ground = mbs.AddObject(items.ObjectGround())
        self._bodies = [self._body(system, start, b, node) for b in range(system.nb)]
        rows = np.ones(system.nrows, dtype=bool) if keep else independent_rows(system, start)
        self.rows = int(np.sum(rows))
        for k in range(system.nj):
            self._joint(system, start, k, rows[system.row_start[k] : system.row_start[k + 1]])
        for k in range(len(system.spring_k)):
            self._spring(system, k)
        self._sensors = [[self._sensor(b, name) for name in OUTPUTS] for b in self._bodies] if record else []
        mbs.Assemble()

    def motion(self) -> tuple[Float[np.ndarray, " nt"], States]:
        """Times and states of the recorded run."""
        stored = [[self.mbs.GetSensorStoredData(s) for s in of_body] for of_body in self._sensors]
        t = stored[0][0][:, 0]
        r, R, v, Omega = (np.stack([body[k][:, 1:] for body in stored], axis=1) for k in range(4))
        return t, States(r, R.reshape(*R.shape[:2], 3, 3), v, Omega)

    def _body(self, system: MultibodySystem, start: State, b: int, node: str) -> Any:
        inertia = self._exu.rigidBodyUtilities.RigidBodyInertia(system.mass[b], system.inertia[b])
        return self.mbs.CreateRigidBody(
            referencePosition=start.r[b], referenceRotationMatrix=start.R[b],
            initialVelocity=start.v[b], initialAngularVelocity=start.R[b] @ start.Omega[b],  # theirs is in space
            inertia=inertia, gravity=system.gravity, nodeType=getattr(self._exu.NodeType, node),
        )  # fmt: skip

    def _marker(self, body: int, place: np.ndarray) -> Any:
        number = self._ground if body == GROUND else self._bodies[body]
        return self.mbs.AddMarker(self._exu.itemInterface.MarkerBodyRigid(bodyNumber=number, localPosition=place))

    def _joint(self, system: MultibodySystem, start: State, k: int, rows: Bool[np.ndarray, " n"]) -> None:
        items = self._exu.itemInterface
        i, j = int(system.joint_i[k]), int(system.joint_j[k])
        markers = [self._marker(i, system.joint_s_i[k]), self._marker(j, system.joint_s_j[k])]
        if not system.joint_revolute[k]:
            self.mbs.AddObject(items.SphericalJoint(markerNumbers=markers, constrainedAxes=rows.astype(int).tolist()))
            return
        in_i, in_j = joint_frames(system, start, k)
        point, first, second = rows[:3], rows[3], rows[4]  # a row on normal x stops the turning about y, and conversely
        axes = [*point, second, first, False]
        frames = {"rotationMarker0": in_i, "rotationMarker1": in_j}
        self.mbs.AddObject(items.GenericJoint(markerNumbers=markers, constrainedAxes=[int(a) for a in axes], **frames))

    def _spring(self, system: MultibodySystem, k: int) -> None:
        i, j = int(system.spring_i[k]), int(system.spring_j[k])
        markers = [self._marker(i, system.spring_p_i[k]), self._marker(j, system.spring_p_j[k])]
        law = {"stiffness": system.spring_k[k], "damping": system.spring_c[k], "referenceLength": system.spring_d0[k]}
        self.mbs.AddObject(self._exu.itemInterface.SpringDamper(markerNumbers=markers, **law))

    def _sensor(self, body: Any, name: str) -> Any:
        kind = getattr(self._exu.OutputVariableType, name)
        sensor = self._exu.itemInterface.SensorBody(
            bodyNumber=body, outputVariableType=kind, storeInternal=True, writeToFile=False
        )
        return self.mbs.AddSensor(sensor)


def joint_frames(
    system: MultibodySystem, start: State, k: int
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """Columns x, y, z of the joint frame of revolute joint ``k``, z its axis, in the frames of i and of j."""
    R = np.concatenate((start.R, np.eye(3)[None]))
    x, y = system.joint_n[k]
    in_j = np.column_stack((x, y, np.cross(x, y)))
    return R[system.joint_i[k]].T @ R[system.joint_j[k]] @ in_j, in_j


def independent_rows(system: MultibodySystem, start: State) -> Bool[np.ndarray, " nrows"]:
    """Which rows to keep; point rows are taken in the joint frame, as Exudyn states an incomplete set of them."""
    A = constraint_jacobian(system, start).toarray()
    for k in np.flatnonzero(system.joint_revolute):
        point = slice(system.row_start[k], system.row_start[k] + 3)
        R_i = start.R[system.joint_i[k]]
        A[point] = (R_i @ joint_frames(system, start, int(k))[0]).T @ A[point]
    _, pivots, order = sl.qr(A.T, mode="economic", pivoting=True)
    size = np.abs(np.diag(pivots))
    kept = np.zeros(system.nrows, dtype=bool)
    kept[order[: int(np.sum(size > PIVOT * size[0]))]] = True
    return kept


@dataclass(frozen=True)
class Variant:
    """How the system is modelled."""

    words: str
    node: str  # of ``exudyn.NodeType``
    linear_solver: str
    keep_redundant: bool


INDEPENDENT = Variant("", "RotationEulerParameters", "EigenSparse", True)
DROPPED = Variant("redundant rows left out", "RotationEulerParameters", "EigenSparse", False)
# Euler parameters bring a row a body: with them the singular matrix is not survived, nor by the engine's own dense LU
KEPT = Variant("redundant rows kept", "RotationRxyz", "EigenDense", True)


def engine() -> ModuleType:
    """The package, or an error that says how to install it."""
    try:
        exu = importlib.import_module(NAME)
        for part in ("itemInterface", "rigidBodyUtilities"):
            importlib.import_module(f"{NAME}.{part}")
    except ImportError as error:
        raise ValueError(f"{NAME} is not installed ({error}): pip install -r requirements-engines.lock") from None
    return exu


def solve(problem: Problem, dt: float, variant: Variant, *, record: bool) -> Trajectory:
    """Integrate to ``t_end``. Only a run that records has steps to show; one that does not is the one to time."""
    steps = round(problem.t_end / dt)
    if steps < 1 or abs(steps * dt - problem.t_end) > 1e-9 * problem.t_end:
        raise ValueError(f"t_end must be a whole number of steps (got {problem.t_end:g} s and dt={dt:g} s)")
    exu = engine()
    began = time.process_time()
    keep = variant.keep_redundant
    model = Model(exu, problem.system, problem.initial, variant.node, keep=keep, record=record)  # not solved yet
    settings = _settings(exu, problem.t_end, steps, variant)
    setup = time.process_time() - began
    status, message = Status.SUCCESS, ""
    began = time.process_time()
    try:
        if not model.mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.TrapezoidalIndex2):
            status, message = Status.DIVERGED, "its solver failed"
    except Exception as error:  # its failures are results; their class is not public
        status, message = Status.DIVERGED, str(error).strip().split("\n")[0]
    cpu = time.process_time() - began
    if record and status is Status.SUCCESS:
        t, states = model.motion()
    else:
        t, states = np.zeros(1), States.one(problem.initial)
    notes = (f"{model.rows} of {problem.system.nrows} rows",)
    return Trajectory(t, states, status, message, {"steps": steps}, notes=notes, cpu_time=cpu, setup_time=setup)


def _settings(exu: ModuleType, t_end: float, steps: int, variant: Variant) -> object:
    s = exu.SimulationSettings()
    s.timeIntegration.numberOfSteps = steps
    s.timeIntegration.endTime = t_end
    s.timeIntegration.verboseMode = 0
    s.solution.file.write = False
    s.solution.sensors.writePeriod = t_end / steps
    s.parallel.numberOfThreads = 1
    s.linearSolver.solverType = getattr(exu.LinearSolverType, variant.linear_solver)
    s.linearSolver.ignoreSingularJacobian = variant.linear_solver == "EigenDense"
    return s


def variants(problem: Problem) -> tuple[Variant, ...]:
    """Two where constraint rows depend on others at the start, else one."""
    return (INDEPENDENT,) if np.all(independent_rows(problem.system, problem.initial)) else (DROPPED, KEPT)
