"""Select the content of a run's series file: its motion, the exact motion beside it, and its problem's numbers."""

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase

import numpy as np
from scipy.spatial.transform import Rotation

from ..columns.measured import MeasuredMotion, MeasuredSeries
from ..judge.metrics.measure import count_covered, evaluate_stated_error, sample_between
from ..judge.metrics.peaks import choose_steps, choose_times, find_peaks, find_scale_times, interpolate_peak_times
from ..judge.metrics.periods import find_periods
from ..judge.metrics.reactions import find_largest_joint_force
from ..judge.metrics.scales import find_scales
from ..judge.metrics.stored_loads import hold_code
from ..judge.metrics.summary import list_values_along
from ..judge.metrics.thinning import choose_frames, choose_rows
from ..mechanics.state import States
from ..mechanics.torsion import count_turns, evaluate_torsion
from ..mechanics.types import Problem, Reference, Status, Trajectory
from ..reference.computation import REFERENCE, ComputedReference, Source, describe_source, find_reference
from ..reference.held import forget_value, hold_values, recall_value
from ..reference.orbit import read_only_stored
from ..results.envelopes import FEW, compute_envelopes
from ..results.packing import FINE
from ..results.selection import leave_out_states
from ..results.series import LARGEST, LAST, MARKS, Series

SERIES = (  # fields of ``MeasuredSeries`` with a value for each step; columns may declare more
    "energy",
    "energy_error",
    "phi_norm",
    "phi_dot_norm",
    "eq81_norm",
    "orthogonality",
    "position_error",
    "orientation_error",
    "reference_own_error",
    "out_of_plane",
)
TIMES = ("t", "dt")
# tolerance of drawn poses in a brief file: fraction of a body's size (a pixel), and as many times that in radians
NEAR, TURNED = 0.005, 3.0
TAIL = 121  # last rows kept beside an envelope for a run that stopped: the atlas of failures draws them
EXACT_FRAMES = 600  # poses of the exact motion that are kept
DRAWING = ("joint_i", "joint_j", "joint_s_i", "joint_s_j", "gravity")  # arrays of the system that a drawing needs
STATE = ("r", "R", "v", "Omega")
# [bytes] of a body's state and exact state at one step, and of states in a file: runs with more are thinned anyway
STATE_BYTES, LARGEST_STATES = 288, LARGEST // 2


def build_series(
    problem: Problem,
    trajectory: Trajectory,
    m: MeasuredSeries,
    *,
    lossless: bool = False,
    keep: Sequence[str] | None = None,
) -> Series:
    """Return the content of a run's series file: rows, poses and states of its steps, thinned such that peaks stay.

    With ``lossless`` every step is kept, unless the run is too long for a file. With ``keep``, names or patterns of
    series, the file is brief: it has as many poses as a picture shows, and states at peaks only. If it has more than
    ``FEW`` rows, the times and the series named keep their rows, and the others become envelopes. ``m`` are the
    measured series of ``trajectory``.
    """
    reference, nb = find_reference(problem), problem.system.nb
    lossless = lossless and len(m.t) * (nb * STATE_BYTES + problem.system.nrows * 8) <= LARGEST_STATES
    brief = keep is not None and not lossless
    peaks = find_peaks(MeasuredMotion(problem, trajectory, m))
    steps = choose_steps(m, peaks, nb, every=lossless)
    rows = np.union1d(choose_rows(len(m.t), m.energy_error, m.phi_norm), steps)
    span, near = _choose_detail(problem, m.size.length, brief=brief)
    full = _collect_series(problem, trajectory, m)
    kept = _select_names(full, keep or ()) if brief and len(m.t) > FEW else set(full)
    arrays = {k: full[k][rows] for k in full if k in kept}
    left = {} if kept >= set(full) else {k: a for k, a in (full | _subtract_reference(full)).items() if k not in kept}
    if brief and MARKS in (keep or ()):
        arrays[MARKS] = find_periods(m.t[rows], {k: full[k][rows] for k in full if k.startswith("obs_")})
    if left and trajectory.status != Status.SUCCESS:
        arrays |= {f"{LAST}{k}": a[-TAIL:] for k, a in left.items()}
    units = {f"{p}_{o.name}": o.unit for o in problem.observables for p in ("obs", "ref")}
    units |= {"obs_joint_force": "N", "ref_joint_force": "N"}
    units |= {f"inv_{i.name}": i.unit for i in problem.invariants}
    at = {name: float(m.t[k]) for name, k in peaks.items()} | interpolate_peak_times(m) | find_scale_times(m)
    arrays |= _collect_frames(m.t, trajectory, span, near) | _compress_exact_poses(problem, reference, m.t, span, near)
    arrays |= _count_turns_from_rest(problem, trajectory)
    arrays |= _collect_states(trajectory, steps, m.t) | _sample_reference(reference, choose_times(m, steps))
    if brief:
        arrays = leave_out_states({**arrays, "state_energy_error": m.energy_error[steps]}, at)
    return Series(
        {**arrays, **_collect_system_arrays(problem)},
        tuple(trajectory.events),
        tuple(problem.system.body_names),
        tuple(problem.system.joint_names),
        units,
        {f"obs_{o.name}": o.symbol for o in problem.observables} | {"obs_joint_force": r"\max_j |F_j|"},
        at,
        _name_source(problem, reference),
        compute_envelopes(m.t, left),
        digest_steps(trajectory),
        m.size.length if brief else math.nan,
    )


def _choose_detail(problem: Problem, length: float, *, brief: bool) -> tuple[float, float]:
    """Return ``span`` [m] and ``near``, a fraction of it, by which poses are thinned (``_collect_frames``).

    ``span`` is the longest arm of a joint or, if no joint has an arm, the length scale ``length`` [m]; in a brief file
    it is divided by ``TURNED``. ``near`` is 0 unless the file is brief.
    """
    span = float(np.linalg.norm(problem.system.joint_s_i, axis=1).max(initial=0.0)) or length
    return (span / TURNED, TURNED * NEAR) if brief else (span, 0.0)


def hold_exact_motion(problem: Problem, code: str, *, brief: bool) -> None:
    """Evaluate a problem's exact motion for measuring and series, and hold the samples for forks of this process.

    ``code`` is the digest of all measuring code, under which joint loads are stored on disk (module ``stored_loads``).
    A reference is not integrated here: raise NotStoredError if it is neither in closed form nor on disk. It is not held
    itself, as an orbit has megabytes, which would count as memory of each solver's process.
    """
    hold_values(problem)
    hold_code(problem, code)
    with read_only_stored():
        reference = find_reference(problem)
    if reference is not None:
        size = find_scales(problem, reference)
        end = np.array([0.0, min(problem.t_end, reference.horizon)])
        _compress_exact_poses(problem, reference, end, *_choose_detail(problem, size.length, brief=brief))
        sample_between(problem, reference, size.length, float(end[-1]))
    forget_value(problem, REFERENCE)


def digest_steps(trajectory: Trajectory) -> str:
    """Return the sha256 of all numbers that a solver returned for its steps: times, states, diagnostics, reactions."""
    s = trajectory.states
    returned = [trajectory.t, s.r, s.R, s.v, s.Omega, *(a for _, a in sorted(trajectory.diagnostics.items()))]
    if trajectory.reaction is not None:
        returned.append(trajectory.reaction)
    digest = hashlib.sha256()
    for a in returned:
        digest.update(np.ascontiguousarray(a, dtype="<f8").data)
    return digest.hexdigest()


def _collect_series(problem: Problem, trajectory: Trajectory, m: MeasuredSeries) -> dict[str, np.ndarray]:
    """Return all series of a run by name, measured ones and those that its solver returned, each of shape (nt,)."""
    full: dict[str, np.ndarray | None] = {
        "t": m.t,
        "dt": np.insert(np.diff(m.t), 0, math.nan),
        **{name: getattr(m, name) for name in SERIES},
        **{name: a for _, name, a in list_values_along(MeasuredMotion(problem, trajectory, m)) if name not in SERIES},
        **{f"obs_{k}": a for k, a in m.observables.items()},
        **{f"ref_{k}": a for k, a in m.reference_observables.items()},
        **{f"inv_{k}": a - a[0] for k, a in m.invariants.items()},
        **{f"diag_{k}": np.asarray(a, dtype=float) for k, a in trajectory.diagnostics.items()},
    }
    if trajectory.reaction is not None:  # shown beside the observables; references have no reactions
        full["obs_joint_force"] = find_largest_joint_force(problem.system, np.asarray(trajectory.reaction, dtype=float))
        full["ref_joint_force"] = np.full(len(m.t), math.nan)
    return {k: a for k, a in full.items() if a is not None}


def _select_names(full: Iterable[str], keep: Sequence[str]) -> set[str]:
    """Return those names of ``full`` that are times or match a name or pattern in ``keep``."""
    return {k for k in full if k in TIMES or any(fnmatchcase(k, pattern) for pattern in keep)}


def _subtract_reference(full: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the differences of observables from those of the reference, as series ``away_<name>``.

    They are kept because the envelopes of both do not determine them.
    """
    names = (k.removeprefix("obs_") for k in full if k.startswith("obs_"))
    return {f"away_{n}": full[f"obs_{n}"] - full[f"ref_{n}"] for n in names if f"ref_{n}" in full}


def _collect_frames(t: np.ndarray, trajectory: Trajectory, span: float, near: float) -> dict[str, np.ndarray]:
    """Return the poses that a picture needs and the state at the end, as arrays ``frame_...`` and ``end_...``.

    ``span`` [m] times an angle is the path of a rotating body. With ``near`` > 0, as in a brief file, the chords
    between frames stay within that fraction of ``span`` from the path; with 0 the reactions at the frames are kept too.
    """
    frames, end = choose_frames(t, trajectory.states.at, span, near=near), trajectory.states[-1]
    out = {
        **_compress_poses("frame", t[frames], trajectory.states.at(frames)),
        **{f"end_{name}": getattr(end, name) for name in STATE},
    }
    if trajectory.reaction is not None and not near:
        out["frame_reaction"] = np.asarray(trajectory.reaction, dtype=float)[frames]
    return out


def _count_turns_from_rest(problem: Problem, trajectory: Trajectory) -> dict[str, np.ndarray]:
    """Return the largest number of whole turns of each torsional spring from its rest during the motion.

    It is the array ``end_turns``, rounded; empty if every spring stays within half a turn of its rest.
    """
    system, t = problem.system, np.asarray(trajectory.t, dtype=float)
    angles = count_turns(system, t, trajectory.states)
    if angles is None and not np.any(system.torsion_wound):
        return {}
    principal = evaluate_torsion(system, trajectory.states)[0] - system.torsion_wound  # [rad] within half a turn
    far = np.abs((principal if angles is None else angles) - principal)
    return {"end_turns": np.round(np.max(far + np.abs(system.torsion_wound), axis=0) / (2.0 * np.pi))}


def _compress_exact_poses(
    problem: Problem, reference: Reference | None, t: np.ndarray, span: float, near: float
) -> dict[str, np.ndarray]:
    """Return poses of the exact motion, as arrays ``exact_...``, up to its horizon or the last of the times ``t`` [s].

    ``span`` and ``near`` thin them as in ``_collect_frames``. Empty without a reference. They are held for other runs
    of the problem where ``hold_exact_motion`` has asked for that.
    """
    known = t[: count_covered(reference, t)]
    if reference is None or len(known) < 2:
        return {}
    ends = float(known[0]), float(min(known[-1], reference.horizon))
    key = "exact poses", *ends, span, near
    return recall_value(problem, key, lambda: _thin_exact_poses(reference, ends, span, near))


def _thin_exact_poses(
    reference: Reference, ends: tuple[float, float], span: float, near: float
) -> dict[str, np.ndarray]:
    """Return poses of the exact motion between the two times ``ends`` [s], about ``EXACT_FRAMES`` at most.

    The arrays and arguments are those of ``_compress_exact_poses``.
    """
    at = np.linspace(*ends, FINE)
    kept = choose_frames(at, lambda k: reference.states(at[k]), span, EXACT_FRAMES, near)
    return _compress_poses("exact", at[kept], reference.states(at[kept]))


def _collect_states(trajectory: Trajectory, steps: np.ndarray, t: np.ndarray) -> dict[str, np.ndarray]:
    """Return times, states and, if any, reactions at the steps with the indices ``steps``, as arrays ``state_...``.

    ``t`` [s] are the times of all steps.
    """
    out = _name_full_states("state", t[steps], trajectory.states.at(steps))
    if trajectory.reaction is not None:
        out["state_reaction"] = np.asarray(trajectory.reaction, dtype=float)[steps]
    return out


def _sample_reference(reference: Reference | None, t: np.ndarray) -> dict[str, np.ndarray]:
    """Return states of the reference at times ``t`` [s] with its stated error, as ``sample_...``; empty without one."""
    if reference is None or len(t) == 0:
        return {}
    return {
        **_name_full_states("sample", t, reference.states(np.minimum(t, reference.horizon))),
        "sample_error": evaluate_stated_error(reference, t),
    }


def _name_full_states(kind: str, t: np.ndarray, s: States) -> dict[str, np.ndarray]:
    """Return times and states as arrays whose names begin with ``kind``."""
    return {f"{kind}_t": t, **{f"{kind}_{name}": getattr(s, name) for name in STATE}}


def _collect_system_arrays(problem: Problem) -> dict[str, np.ndarray]:
    """Return every array of the problem's system and start by its name in the file.

    Arrays that a drawing needs keep their names, others begin with ``system_`` or ``start_``.
    """
    system = problem.system
    arrays = {k: a for k, a in vars(system).items() if isinstance(a, np.ndarray) and a.dtype != object}
    out = {k if k in DRAWING else f"system_{k}": a for k, a in arrays.items()}
    out |= {f"start_{name}": getattr(problem.initial, name) for name in STATE}
    if problem.planar_normal is not None:
        out["system_planar_normal"] = problem.frame @ problem.planar_normal / np.linalg.norm(problem.planar_normal)
    return out | {"system_gyration": system.gyration, "system_frame": problem.frame}


def _name_source(problem: Problem, reference: Reference | None) -> str:
    """Return the kind of the reference that the motion was compared with, a value of ``Source``."""
    if reference is None:
        return str(Source.NONE)
    return str(Source.COMPUTED if isinstance(reference, ComputedReference) else describe_source(problem))


def _compress_poses(kind: str, t: np.ndarray, s: States) -> dict[str, np.ndarray]:
    """Return times, and poses in float32 as positions and quaternions, as arrays whose names begin with ``kind``."""
    return {f"{kind}_t": t, f"{kind}_r": s.r.astype(np.float32), f"{kind}_q": _convert_to_quaternions(s)}


def _convert_to_quaternions(s: States) -> np.ndarray:
    """Return the attitudes as quaternions (nt, nb, 4) x, y, z, w in float32; NaN if R is not finite or det R <= 0."""
    R = s.R.reshape(-1, 3, 3)
    with np.errstate(all="ignore"):
        sound = np.isfinite(R).all(axis=(1, 2)) & (np.linalg.det(np.nan_to_num(R)) > 0.0)
    q = np.full((len(R), 4), np.nan)
    if np.any(sound):
        q[sound] = Rotation.from_matrix(R[sound]).as_quat()
    return q.reshape(*s.R.shape[:2], 4).astype(np.float32)
