"""The series file of a run: what is kept of its motion, of the exact motion beside it, and of its problem's numbers."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from ..mechanics.state import States
from ..metrics.measure import Measured, count_covered, stated_error
from ..metrics.peaks import find_peaks, steps_to_keep, times_between, times_of_scales, times_to_keep
from ..metrics.reactions import largest_joint_force
from ..metrics.thinning import frames_to_keep, rows_to_keep
from ..reference.computation import ComputedReference, Source, reference_of, source_of
from ..results.series import LARGEST, Series
from ..types import Problem, Reference, Trajectory

SERIES = ("energy", "energy_error", "phi_norm", "phi_dot_norm", "eq81_norm", "orthogonality", "position_error",
          "orientation_error", "reference_own_error", "out_of_plane")  # fmt: skip
EXACT_FRAMES, FINE = 600, 6000  # poses of the exact motion that are kept, and those that they are chosen from
DRAWING = ("joint_i", "joint_j", "joint_s_i", "joint_s_j", "gravity")  # of the system: what a drawing needs
STATE = ("r", "R", "v", "Omega")
STATE_BYTES, LARGEST_STATES = 288, LARGEST // 2  # of a body, with that of the exact motion; of a file


def series_of(problem: Problem, trajectory: Trajectory, m: Measured, *, lossless: bool = False) -> Series:
    """What the series file of a run holds: rows, poses and states thinned, peaks kept; ``lossless``: every step.

    Of a run that is too long for a file the states are thinned all the same.
    """
    reference, nb = reference_of(problem), problem.system.nb
    lossless = lossless and len(m.t) * (nb * STATE_BYTES + problem.system.nrows * 8) <= LARGEST_STATES
    peaks = find_peaks(m, literal_start=problem.literal_start)
    steps = steps_to_keep(m, peaks, nb, every=lossless)
    keep = np.union1d(rows_to_keep(len(m.t), m.energy_error, m.phi_norm), steps)
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
        {**arrays, **_poses(m.t, trajectory, span), **_exact(reference, m.t, span),
         **_states(trajectory, steps, m.t), **_samples(reference, times_to_keep(m, steps)), **_numbers(problem)},
        tuple(trajectory.events), tuple(problem.system.body_names), tuple(problem.system.joint_names), units,
        {f"obs_{o.name}": o.symbol for o in problem.observables} | {"obs_joint_force": r"\max_j |F_j|"},
        {name: float(m.t[k]) for name, k in peaks.items()} | times_between(m) | times_of_scales(m),
        _source(problem, reference),
    )  # fmt: skip


def _poses(t: np.ndarray, trajectory: Trajectory, span: float) -> dict[str, np.ndarray]:
    frames, end = frames_to_keep(t, trajectory.states.at, span), trajectory.states[-1]
    out = {
        **_compress_poses("frame", t[frames], trajectory.states.at(frames)),
        **{f"end_{name}": getattr(end, name) for name in STATE},
    }
    if trajectory.reaction is not None:
        out["frame_reaction"] = np.asarray(trajectory.reaction, dtype=float)[frames]
    return out


def _exact(reference: Reference | None, t: np.ndarray, span: float) -> dict[str, np.ndarray]:
    """The exact motion as far as it is known and the run went; nothing without a reference."""
    known = t[: count_covered(reference, t)]
    if reference is None or len(known) < 2:
        return {}
    at = np.linspace(known[0], min(known[-1], reference.horizon), FINE)
    kept = frames_to_keep(at, lambda k: reference.states(at[k]), span, EXACT_FRAMES)
    return _compress_poses("exact", at[kept], reference.states(at[kept]))


def _states(trajectory: Trajectory, steps: np.ndarray, t: np.ndarray) -> dict[str, np.ndarray]:
    out = _full("state", t[steps], trajectory.states.at(steps))
    if trajectory.reaction is not None:
        out["state_reaction"] = np.asarray(trajectory.reaction, dtype=float)[steps]
    return out


def _samples(reference: Reference | None, t: np.ndarray) -> dict[str, np.ndarray]:
    if reference is None or len(t) == 0:
        return {}
    return {
        **_full("sample", t, reference.states(np.minimum(t, reference.horizon))),
        "sample_error": stated_error(reference, t),
    }


def _full(kind: str, t: np.ndarray, s: States) -> dict[str, np.ndarray]:
    return {f"{kind}_t": t, **{f"{kind}_{name}": getattr(s, name) for name in STATE}}


def _numbers(problem: Problem) -> dict[str, np.ndarray]:
    """Every number of the problem: those that a drawing needs by their own names."""
    system = problem.system
    arrays = {k: a for k, a in vars(system).items() if isinstance(a, np.ndarray) and a.dtype != object}
    out = {k if k in DRAWING else f"system_{k}": a for k, a in arrays.items()}
    out |= {f"start_{name}": getattr(problem.initial, name) for name in STATE}
    if problem.planar_normal is not None:
        out["system_planar_normal"] = problem.frame @ problem.planar_normal / np.linalg.norm(problem.planar_normal)
    return out | {"system_gyration": system.gyration, "system_frame": problem.frame}


def _source(problem: Problem, reference: Reference | None) -> str:
    if reference is None:
        return str(Source.NONE)
    return str(Source.COMPUTED if isinstance(reference, ComputedReference) else source_of(problem))


def _compress_poses(kind: str, t: np.ndarray, s: States) -> dict[str, np.ndarray]:
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
