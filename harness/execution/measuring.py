"""From what a solver handed over to a record and a series file: the step of a run that follows the solve."""

import dataclasses
import math
import time
import traceback
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..catalogue import registry
from ..mechanics.state import States
from ..metrics.measure import Measured, covered, measure
from ..metrics.reactions import largest_joint_force
from ..metrics.summary import columns
from ..metrics.thinning import frames_to_keep, rows_to_keep
from ..metrics.verdict import doubts, inaccuracy
from ..places import Place
from ..reference.computed import reference_of
from ..results.records import RunRecord, reasons_json
from ..results.series import Series, write_series
from ..sandbox.isolation import DISK_FULL
from ..sandbox.spool import read_spool
from ..types import EndedBy, Problem, Reason, Status, Trajectory
from .handover import BadHandover, Handover, SolverReport, read
from .job import Job, cut_short, first_line, record_of

SERIES = ("energy", "energy_error", "phi_norm", "phi_dot_norm", "eq81_norm", "orthogonality", "position_error",
          "orientation_error", "reference_own_error", "out_of_plane")  # fmt: skip
EXACT_FRAMES, FINE = 600, 6000  # poses of the exact motion that are kept, and those that they are chosen from
DRAWING = ("joint_i", "joint_j", "joint_s_i", "joint_s_j", "gravity")  # of the system: what a drawing needs
USED = 0.5  # of the limit on CPU time: who says that it ended him has used as much, and was asked to stop at 0.9


@dataclass(frozen=True)
class Outcome:
    """What came of a run: its record and, where it has a motion, that and what was measured on it."""

    record: RunRecord
    problem: Problem | None = None
    trajectory: Trajectory | None = None
    measured: Measured | None = None


def measure_run(job: Job, bare: RunRecord, problem: Problem | None = None, spent: float = math.inf) -> Outcome:
    """Measure and judge what the solver handed over, or the steps that were kept until it ended.

    ``bare`` says how the solver's process ended, ``spent`` [s] how much CPU time it took.
    """
    try:
        if problem is None:
            problem = make_problem(job)
        bare = dataclasses.replace(bare, section=problem.section, t_end_s=problem.t_end)
        handover = _read_handover(job, problem, spent)
        if handover is None:
            return _salvage(job, problem, bare)
        about: dict[str, Any] = {"peak_memory_MB": bare.peak_memory_MB, "cpu_process_s": bare.cpu_process_s}
        if handover.report.claimed is None:
            failed = cut_short(job, handover.report.by, message=handover.report.message, **handover.columns, **about)
            return _salvage(job, problem, dataclasses.replace(failed, section=problem.section, t_end_s=problem.t_end))
        if bare.ended_by == EndedBy.SUSPENDED and handover.report.claimed is Status.STALLED:
            about["ended_by"] = bare.ended_by  # its limit passed while nothing ran
        return judge_handover(job, problem, handover, spent, **about)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in DISK_FULL:
            raise
        traceback.print_exc()
        by, message = str(EndedBy.EXCEPTION), first_line(error)
        return Outcome(dataclasses.replace(bare, status=str(Status.CRASHED), ended_by=by, message=message))


def make_problem(job: Job) -> Problem:
    """The problem of a run; one of a plugin is made by the plugin, here too (docs/trust.md)."""
    if not registry.is_own_problem(job.spec.problem):
        for plugin in job.plugins:
            registry.load_plugin(plugin)
    return registry.make_problem(job.spec.problem, job.spec.parameters)


def _read_handover(job: Job, problem: Problem, spent: float) -> Handover | None:
    try:
        return read(job.handover, problem.system, spent)
    except BadHandover as error:
        return Handover(SolverReport(by=EndedBy.EXCEPTION, message=str(error)), None)


def judge_handover(job: Job, problem: Problem, handover: Handover, spent: float = math.inf, **about: Any) -> Outcome:
    """Measure and judge what a solver returned; ``spent`` [s] of CPU in all, if known."""
    known = {**handover.columns, **about}
    if handover.trajectory is None:
        said = {
            "claimed": str(handover.report.claimed),
            "ended_by": str(EndedBy.SOLVER),
            "message": handover.report.message,
        }
        record = record_of(job, Status.REFUSED, section=problem.section, t_end_s=problem.t_end, **said, **known)
        return Outcome(record, problem)
    began = time.monotonic()
    record, measured = judge_motion(job, problem, handover.trajectory, spent=spent, **known)
    record = dataclasses.replace(record, measure_s=time.monotonic() - began)
    return Outcome(record, problem, handover.trajectory, measured)


def _salvage(job: Job, problem: Problem, bare: RunRecord) -> Outcome:
    """``bare``, the record of a run cut short, with the metrics of the steps it had kept, if it had any."""
    trajectory = read_spool(job.spool, problem, Status(bare.status), bare.message)
    if trajectory is None:
        return Outcome(bare, problem)
    names = ("claimed", "ended_by", "ended_limit_s", "exit_code", "signal", "setup_s", "cpu_min_s", "cpu_median_s",
             "cpu_max_s", "cpu_call_s", "cpu_process_s", "wall_s", "peak_memory_MB", "paper_label",
             "declared_order")  # fmt: skip
    record, measured = judge_motion(job, problem, trajectory, **{name: getattr(bare, name) for name in names})
    return Outcome(record, problem, trajectory, measured)


def judge_motion(
    job: Job, problem: Problem, trajectory: Trajectory, *, spent: float = 0.0, **known: Any
) -> tuple[RunRecord, Measured]:
    """Measure and judge a motion.

    A solver that stopped before its limit on steps, having used up its CPU time (``spent`` [s]), did not finish here.
    """
    measured = measure(problem, trajectory)
    numbers = columns(problem, trajectory, measured)
    status, because = Status(trajectory.status), list[Reason]()
    if status is Status.SUCCESS:
        because = doubts(problem, trajectory, measured, numbers)
        status = Status.WRONG if because else status
    if status is Status.SUCCESS and (because := inaccuracy(measured, numbers)):
        status = Status.INACCURATE
    by = EndedBy.SOLVER
    limit, steps_left = job.spec.cpu_limit, len(trajectory.t) <= job.spec.control.max_steps
    if status is Status.STALLED and steps_left and math.isfinite(limit) and spent >= USED * limit:
        status, by = Status.UNFINISHED, EndedBy.CPU_LIMIT
    said = {"claimed": str(trajectory.status), "ended_by": str(by), "message": str(trajectory.message)}
    found = {"section": problem.section, "t_end_s": problem.t_end, "wrong_because": reasons_json(because)}
    return record_of(job, status, **{**said, **found, **numbers, **known}), measured


def write_outcome(job: Job, outcome: Outcome) -> RunRecord:
    """Write the series of a motion into the results folder; the record with its place."""
    if outcome.problem is None or outcome.trajectory is None or outcome.measured is None:
        return outcome.record
    series = series_of(outcome.problem, outcome.trajectory, outcome.measured)
    place = f"series/{job.id}.npz"
    digest = write_series(Place(job.folder) / place, series)
    return dataclasses.replace(outcome.record, series=place, series_sha256=digest, series_rows=len(series["t"]))


def series_of(problem: Problem, trajectory: Trajectory, m: Measured) -> Series:
    """What the series file of a run holds: rows and frames thinned, peaks kept."""
    keep = rows_to_keep(len(m.t), m.energy_error, m.phi_norm)
    span = float(np.linalg.norm(problem.system.joint_s_i, axis=1).max(initial=0.0)) or m.size.length
    full: dict[str, np.ndarray | None] = {
        "t": m.t,
        "dt": np.insert(np.diff(m.t), 0, math.nan),
        **{name: getattr(m, name) for name in SERIES},
        **{f"obs_{k}": a for k, a in m.observables.items()},
        **{f"ref_{k}": a for k, a in m.reference_observables.items()},
        **{f"inv_{k}": a - a[0] for k, a in m.invariants.items()},
        **{f"diag_{k}": np.asarray(a, dtype=float) for k, a in trajectory.diagnostics.items()},
    }
    if trajectory.reaction is not None:  # shown beside the observables; the references carry no reactions
        full["obs_joint_force"] = largest_joint_force(problem.system, np.asarray(trajectory.reaction, dtype=float))
        full["ref_joint_force"] = np.full(len(m.t), math.nan)
    arrays = {k: a[keep] for k, a in full.items() if a is not None}
    units = {f"{p}_{o.name}": o.unit for o in problem.observables for p in ("obs", "ref")}
    units |= {"obs_joint_force": "N", "ref_joint_force": "N"}
    units |= {f"inv_{i.name}": i.unit for i in problem.invariants}
    return Series(
        {**arrays, **_poses(m.t, trajectory, span), **_exact(problem, m.t, span),
         **{k: getattr(problem.system, k) for k in DRAWING}},
        tuple(trajectory.events), tuple(problem.system.body_names), tuple(problem.system.joint_names), units,
        {f"obs_{o.name}": o.symbol for o in problem.observables} | {"obs_joint_force": r"\max_j |F_j|"},
    )  # fmt: skip


def _poses(t: np.ndarray, trajectory: Trajectory, span: float) -> dict[str, np.ndarray]:
    frames, end = frames_to_keep(t, trajectory.states, span), trajectory.states[-1]
    out = {
        **_drawn("frame", t[frames], trajectory.states.at(frames)),
        **{f"end_{name}": getattr(end, name) for name in ("r", "R", "v", "Omega")},
    }
    if trajectory.reaction is not None:
        out["frame_reaction"] = np.asarray(trajectory.reaction, dtype=float)[frames]
    return out


def _exact(problem: Problem, t: np.ndarray, span: float) -> dict[str, np.ndarray]:
    """The exact motion as far as it is known and the run went; nothing without a reference."""
    reference = reference_of(problem)
    known = t[: covered(reference, t)]
    if reference is None or len(known) < 2:
        return {}
    at = np.linspace(known[0], min(known[-1], reference.horizon), FINE)
    states = reference.states(at)
    kept = frames_to_keep(at, states, span, EXACT_FRAMES)
    return _drawn("exact", at[kept], states.at(kept))


def _drawn(kind: str, t: np.ndarray, s: States) -> dict[str, np.ndarray]:
    return {f"{kind}_t": t, f"{kind}_r": s.r.astype(np.float32), f"{kind}_q": _quaternions(s)}


def _quaternions(s: States) -> np.ndarray:
    """(nf, nb, 4) x, y, z, w; NaN where R is no rotation any more."""
    R = s.R.reshape(-1, 3, 3)
    with np.errstate(all="ignore"):
        sound = np.isfinite(R).all(axis=(1, 2)) & (np.linalg.det(np.nan_to_num(R)) > 0.0)
    q = np.full((len(R), 4), np.nan)
    if np.any(sound):
        q[sound] = Rotation.from_matrix(R[sound]).as_quat()
    return q.reshape(*s.R.shape[:2], 4).astype(np.float32)
