"""From a trajectory to a record and a series file: the step of a run that follows the solve."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

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
from ..types import EndedBy, Problem, Reason, Status, Trajectory
from .job import Job, record_of

SERIES = ("energy", "energy_error", "phi_norm", "phi_dot_norm", "eq81_norm", "orthogonality", "position_error",
          "orientation_error", "reference_own_error", "out_of_plane")  # fmt: skip
EXACT_FRAMES, FINE = 600, 6000  # poses of the exact motion that are kept, and those that they are chosen from
DRAWING = ("joint_i", "joint_j", "joint_s_i", "joint_s_j", "gravity")  # of the system: what a drawing needs
Keep = Callable[[Problem, Trajectory, Measured, RunRecord], RunRecord]  # writes the series; the record with its place


def judged(job: Job, problem: Problem, trajectory: Trajectory, keep: Keep | None = None, **known: Any) -> RunRecord:
    """Measure, judge, write the series (by ``keep``, or into the results folder); returns the record, not written."""
    measured = measure(problem, trajectory)
    numbers = columns(problem, trajectory, measured)
    status, because = Status(trajectory.status), list[Reason]()
    if status is Status.SUCCESS:
        because = doubts(problem, trajectory, measured, numbers)
        status = Status.WRONG if because else status
    if status is Status.SUCCESS and (because := inaccuracy(measured, numbers)):
        status = Status.INACCURATE
    said = {"claimed": str(trajectory.status), "ended_by": str(EndedBy.SOLVER), "message": str(trajectory.message)}
    found = {"section": problem.section, "t_end_s": problem.t_end, "wrong_because": reasons_json(because)}
    record = record_of(job, status, **{**said, **found, **numbers, **known})
    if keep is not None:
        return keep(problem, trajectory, measured, record)
    series, path = series_of(problem, trajectory, measured), f"series/{job.id}.npz"
    digest = write_series(Place(job.folder) / path, series)
    return dataclasses.replace(record, series=path, series_sha256=digest, series_rows=len(series["t"]))


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
