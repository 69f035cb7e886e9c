"""Exudyn's index-2 trapezoidal integrator on a problem, with fixed step: a compiled engine to compare with.

Its own defaults (modified Newton, step recovery), no files, one thread, the fastest of its linear solvers that takes
the model: sparse LU, or dense LU with the singular Jacobian ignored when redundant rows are kept.
"""

import importlib
import time
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from ..types import Problem, States, Status, Trajectory
from .exudyn_model import Model, independent_rows

NAME = "exudyn"


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
