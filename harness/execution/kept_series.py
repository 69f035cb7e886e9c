"""The series file of a run: what is kept of its motion, of the exact motion beside it, and of its problem's numbers."""

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase

import numpy as np
from scipy.spatial.transform import Rotation

from ..mechanics.state import States
from ..mechanics.torsion import count_turns, torsion
from ..metrics.measure import Measured, count_covered, stated_error
from ..metrics.peaks import find_peaks, steps_to_keep, times_between, times_of_scales, times_to_keep
from ..metrics.periods import find_periods
from ..metrics.reactions import largest_joint_force
from ..metrics.thinning import frames_to_keep, rows_to_keep
from ..reference.computation import ComputedReference, Source, reference_of, source_of
from ..results.envelopes import FEW, envelope_of
from ..results.packing import FINE
from ..results.selection import leave_out_states
from ..results.series import LARGEST, LAST, MARKS, Series
from ..types import Problem, Reference, Status, Trajectory

SERIES = ("energy", "energy_error", "phi_norm", "phi_dot_norm", "eq81_norm", "orthogonality", "position_error",
          "orientation_error", "reference_own_error", "out_of_plane")  # fmt: skip
TIMES = ("t", "dt")
NEAR, TURNED = 0.005, 3.0  # of a body, a pixel: how far off drawn poses of a brief file are; so many times of a radian
TAIL = 121  # last rows of what becomes an envelope, of a run that stopped: the atlas of failures looks at them
EXACT_FRAMES = 600  # poses of the exact motion that are kept
DRAWING = ("joint_i", "joint_j", "joint_s_i", "joint_s_j", "gravity")  # of the system: what a drawing needs
STATE = ("r", "R", "v", "Omega")
STATE_BYTES, LARGEST_STATES = 288, LARGEST // 2  # of a body, with that of the exact motion; of a file


def series_of(
    problem: Problem, trajectory: Trajectory, m: Measured, *, lossless: bool = False, keep: Sequence[str] | None = None
) -> Series:
    """What the series file of a run holds: rows, poses and states thinned, peaks kept; ``lossless``: every step.

    Of a run that is too long for a file the states are thinned all the same. With ``keep``, names or patterns of
    series, the file is brief: of more than ``FEW`` rows these series and the times alone keep their rows, the others
    become envelopes; poses are as many as a picture shows, and states those of peaks.
    """
    reference, nb = reference_of(problem), problem.system.nb
    lossless = lossless and len(m.t) * (nb * STATE_BYTES + problem.system.nrows * 8) <= LARGEST_STATES
    brief = keep is not None and not lossless
    peaks = find_peaks(m, literal_start=problem.literal_start)
    steps = steps_to_keep(m, peaks, nb, every=lossless)
    rows = np.union1d(rows_to_keep(len(m.t), m.energy_error, m.phi_norm), steps)
    span = float(np.linalg.norm(problem.system.joint_s_i, axis=1).max(initial=0.0)) or m.size.length
    span, near = (span / TURNED, TURNED * NEAR) if brief else (span, 0.0)
    full = _series(problem, trajectory, m)
    kept = _select(full, keep or ()) if brief and len(m.t) > FEW else set(full)
    arrays = {k: full[k][rows] for k in full if k in kept}
    left = {} if kept >= set(full) else {k: a for k, a in (full | _distances(full)).items() if k not in kept}
    if brief and MARKS in (keep or ()):
        arrays[MARKS] = find_periods(m.t[rows], {k: full[k][rows] for k in full if k.startswith("obs_")})
    if left and trajectory.status != Status.SUCCESS:
        arrays |= {f"{LAST}{k}": a[-TAIL:] for k, a in left.items()}
    units = {f"{p}_{o.name}": o.unit for o in problem.observables for p in ("obs", "ref")}
    units |= {"obs_joint_force": "N", "ref_joint_force": "N"}
    units |= {f"inv_{i.name}": i.unit for i in problem.invariants}
    at = {name: float(m.t[k]) for name, k in peaks.items()} | times_between(m) | times_of_scales(m)
    arrays |= _poses(m.t, trajectory, span, near) | _exact(reference, m.t, span, near)
    arrays |= _turns(problem, trajectory)
    arrays |= _states(trajectory, steps, m.t) | _samples(reference, times_to_keep(m, steps))
    if brief:
        arrays = leave_out_states({**arrays, "state_energy_error": m.energy_error[steps]}, at)
    return Series(
        {**arrays, **_numbers(problem)},
        tuple(trajectory.events), tuple(problem.system.body_names), tuple(problem.system.joint_names), units,
        {f"obs_{o.name}": o.symbol for o in problem.observables} | {"obs_joint_force": r"\max_j |F_j|"},
        at,
        _source(problem, reference),
        {k: envelope_of(m.t, a) for k, a in left.items()},
        digest_steps(trajectory),
        m.size.length if brief else math.nan,
    )  # fmt: skip


def digest_steps(trajectory: Trajectory) -> str:
    """The sha256 of all that a solver returned at its accepted steps."""
    s = trajectory.states
    returned = [trajectory.t, s.r, s.R, s.v, s.Omega, *(a for _, a in sorted(trajectory.diagnostics.items()))]
    if trajectory.reaction is not None:
        returned.append(trajectory.reaction)
    digest = hashlib.sha256()
    for a in returned:
        digest.update(np.ascontiguousarray(a, dtype="<f8").data)
    return digest.hexdigest()


def _series(problem: Problem, trajectory: Trajectory, m: Measured) -> dict[str, np.ndarray]:
    """All series at every step."""
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
    return {k: a for k, a in full.items() if a is not None}


def _select(full: Iterable[str], keep: Sequence[str]) -> set[str]:
    """The times, and the series that ``keep`` names."""
    return {k for k in full if k in TIMES or any(fnmatchcase(k, pattern) for pattern in keep)}


def _distances(full: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Observables less those of the reference: envelopes of both do not tell it."""
    names = (k.removeprefix("obs_") for k in full if k.startswith("obs_"))
    return {f"away_{n}": full[f"obs_{n}"] - full[f"ref_{n}"] for n in names if f"ref_{n}" in full}


def _poses(t: np.ndarray, trajectory: Trajectory, span: float, near: float) -> dict[str, np.ndarray]:
    frames, end = frames_to_keep(t, trajectory.states.at, span, near=near), trajectory.states[-1]
    out = {
        **_compress_poses("frame", t[frames], trajectory.states.at(frames)),
        **{f"end_{name}": getattr(end, name) for name in STATE},
    }
    if trajectory.reaction is not None and not near:
        out["frame_reaction"] = np.asarray(trajectory.reaction, dtype=float)[frames]
    return out


def _turns(problem: Problem, trajectory: Trajectory) -> dict[str, np.ndarray]:
    """The most whole turns that each torsional spring winds beyond half a turn about rest; nothing where none does."""
    system, t = problem.system, np.asarray(trajectory.t, dtype=float)
    angles = count_turns(system, t, trajectory.states)
    if angles is None and not np.any(system.torsion_wound):
        return {}
    whole = torsion(system, trajectory.states)[0] - system.torsion_wound
    far = np.abs((whole if angles is None else angles) - whole)
    return {"end_turns": np.round(np.max(far + np.abs(system.torsion_wound), axis=0) / (2.0 * np.pi))}


def _exact(reference: Reference | None, t: np.ndarray, span: float, near: float) -> dict[str, np.ndarray]:
    """The exact motion as far as it is known and the run went; nothing without a reference."""
    known = t[: count_covered(reference, t)]
    if reference is None or len(known) < 2:
        return {}
    at = np.linspace(known[0], min(known[-1], reference.horizon), FINE)
    kept = frames_to_keep(at, lambda k: reference.states(at[k]), span, EXACT_FRAMES, near)
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
