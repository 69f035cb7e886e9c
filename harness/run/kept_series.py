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
    """Return the content of a run's series file: rows, poses and states, thinned so that peaks stay.

    With ``lossless`` every step is kept. The states of a run that is too long for a file are thinned all the same. With
    ``keep``, names or patterns of series, the file is brief: if it has more than ``FEW`` rows, only these series and
    the times keep their rows and others become envelopes; it has as many poses as a picture shows, and states at peaks
    only.
    """
    reference, nb = find_reference(problem), problem.system.nb
    lossless = lossless and len(m.t) * (nb * STATE_BYTES + problem.system.nrows * 8) <= LARGEST_STATES
    brief = keep is not None and not lossless
    peaks = find_peaks(MeasuredMotion(problem, trajectory, m))
    steps = choose_steps(m, peaks, nb, every=lossless)
    rows = np.union1d(choose_rows(len(m.t), m.energy_error, m.phi_norm), steps)
    span, near = _choose_detail(problem, m.size.length, brief=brief)
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
    at = {name: float(m.t[k]) for name, k in peaks.items()} | interpolate_peak_times(m) | find_scale_times(m)
    arrays |= _poses(m.t, trajectory, span, near) | _compress_exact_poses(problem, reference, m.t, span, near)
    arrays |= _turns(problem, trajectory)
    arrays |= _states(trajectory, steps, m.t) | _samples(reference, choose_times(m, steps))
    if brief:
        arrays = leave_out_states({**arrays, "state_energy_error": m.energy_error[steps]}, at)
    return Series(
        {**arrays, **_numbers(problem)},
        tuple(trajectory.events),
        tuple(problem.system.body_names),
        tuple(problem.system.joint_names),
        units,
        {f"obs_{o.name}": o.symbol for o in problem.observables} | {"obs_joint_force": r"\max_j |F_j|"},
        at,
        _source(problem, reference),
        compute_envelopes(m.t, left),
        digest_steps(trajectory),
        m.size.length if brief else math.nan,
    )


def _choose_detail(problem: Problem, length: float, *, brief: bool) -> tuple[float, float]:
    """Return the ``span`` [m] and the fraction ``near`` of it by which poses are thinned (``_poses``).

    ``length`` [m] is the length scale, used where no joint has an arm.
    """
    span = float(np.linalg.norm(problem.system.joint_s_i, axis=1).max(initial=0.0)) or length
    return (span / TURNED, TURNED * NEAR) if brief else (span, 0.0)


def hold_exact_motion(problem: Problem, code: str, *, brief: bool) -> None:
    """Compute samples of a problem's exact motion for measuring and series, and hold them for forks of this process.

    ``code`` is the digest of all code that measures, by which joint loads are stored (module ``stored_loads``).
    Nothing is computed that is not on disk or in closed form: ``NotStoredError`` is raised then. The reference itself
    is not held, as an orbit has megabytes, which would count as the memory of each solver's process.
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
    """Return the sha256 of all that a solver returned for its steps: times, states, diagnostics and reactions."""
    s = trajectory.states
    returned = [trajectory.t, s.r, s.R, s.v, s.Omega, *(a for _, a in sorted(trajectory.diagnostics.items()))]
    if trajectory.reaction is not None:
        returned.append(trajectory.reaction)
    digest = hashlib.sha256()
    for a in returned:
        digest.update(np.ascontiguousarray(a, dtype="<f8").data)
    return digest.hexdigest()


def _series(problem: Problem, trajectory: Trajectory, m: MeasuredSeries) -> dict[str, np.ndarray]:
    """Return all measured and returned series by name, each with a value for every step."""
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


def _select(full: Iterable[str], keep: Sequence[str]) -> set[str]:
    """Return the names of the times, and of the series that match a name or pattern in ``keep``."""
    return {k for k in full if k in TIMES or any(fnmatchcase(k, pattern) for pattern in keep)}


def _distances(full: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return observables less those of the reference, as ``away_<name>``; envelopes of both do not determine them."""
    names = (k.removeprefix("obs_") for k in full if k.startswith("obs_"))
    return {f"away_{n}": full[f"obs_{n}"] - full[f"ref_{n}"] for n in names if f"ref_{n}" in full}


def _poses(t: np.ndarray, trajectory: Trajectory, span: float, near: float) -> dict[str, np.ndarray]:
    """Return the poses that a picture needs and the state at the end, as arrays ``frame_...`` and ``end_...``.

    ``span`` [m] of a body turns a rotation into a path. With ``near`` > 0, a fraction of ``span``, the file is brief:
    chords between frames stay so close to the path. Otherwise (0) the reactions at the frames are kept as well.
    """
    frames, end = choose_frames(t, trajectory.states.at, span, near=near), trajectory.states[-1]
    out = {
        **_compress_poses("frame", t[frames], trajectory.states.at(frames)),
        **{f"end_{name}": getattr(end, name) for name in STATE},
    }
    if trajectory.reaction is not None and not near:
        out["frame_reaction"] = np.asarray(trajectory.reaction, dtype=float)[frames]
    return out


def _turns(problem: Problem, trajectory: Trajectory) -> dict[str, np.ndarray]:
    """Return by how many whole turns each torsional spring leaves half a turn about rest at most, as ``end_turns``.

    Empty if no spring does.
    """
    system, t = problem.system, np.asarray(trajectory.t, dtype=float)
    angles = count_turns(system, t, trajectory.states)
    if angles is None and not np.any(system.torsion_wound):
        return {}
    whole = evaluate_torsion(system, trajectory.states)[0] - system.torsion_wound
    far = np.abs((whole if angles is None else angles) - whole)
    return {"end_turns": np.round(np.max(far + np.abs(system.torsion_wound), axis=0) / (2.0 * np.pi))}


def _compress_exact_poses(
    problem: Problem, reference: Reference | None, t: np.ndarray, span: float, near: float
) -> dict[str, np.ndarray]:
    """Return poses of the exact motion as far as it is known and the run went; empty without a reference.

    ``span`` and ``near`` thin them as in ``_poses``.
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
    """Return poses of the exact motion between two times as ``_compress_exact_poses`` does."""
    at = np.linspace(*ends, FINE)
    kept = choose_frames(at, lambda k: reference.states(at[k]), span, EXACT_FRAMES, near)
    return _compress_poses("exact", at[kept], reference.states(at[kept]))


def _states(trajectory: Trajectory, steps: np.ndarray, t: np.ndarray) -> dict[str, np.ndarray]:
    """Return times, states and, if any, reactions at ``steps`` as arrays ``state_...``; ``t`` [s] has all times."""
    out = _name_full_states("state", t[steps], trajectory.states.at(steps))
    if trajectory.reaction is not None:
        out["state_reaction"] = np.asarray(trajectory.reaction, dtype=float)[steps]
    return out


def _samples(reference: Reference | None, t: np.ndarray) -> dict[str, np.ndarray]:
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


def _numbers(problem: Problem) -> dict[str, np.ndarray]:
    """Return every array of the problem's system and start; those that a drawing needs keep their names."""
    system = problem.system
    arrays = {k: a for k, a in vars(system).items() if isinstance(a, np.ndarray) and a.dtype != object}
    out = {k if k in DRAWING else f"system_{k}": a for k, a in arrays.items()}
    out |= {f"start_{name}": getattr(problem.initial, name) for name in STATE}
    if problem.planar_normal is not None:
        out["system_planar_normal"] = problem.frame @ problem.planar_normal / np.linalg.norm(problem.planar_normal)
    return out | {"system_gyration": system.gyration, "system_frame": problem.frame}


def _source(problem: Problem, reference: Reference | None) -> str:
    """Return the kind of the reference that the motion was compared with, a value of ``Source``."""
    if reference is None:
        return str(Source.NONE)
    return str(Source.COMPUTED if isinstance(reference, ComputedReference) else describe_source(problem))


def _compress_poses(kind: str, t: np.ndarray, s: States) -> dict[str, np.ndarray]:
    """Return times, and poses in float32 as positions and quaternions, as arrays whose names begin with ``kind``."""
    return {f"{kind}_t": t, f"{kind}_r": s.r.astype(np.float32), f"{kind}_q": _quaternions(s)}


def _quaternions(s: States) -> np.ndarray:
    """Return the orientations as quaternions (nf, nb, 4) x, y, z, w in float32; NaN where R is no longer a rotation."""
    R = s.R.reshape(-1, 3, 3)
    with np.errstate(all="ignore"):
        sound = np.isfinite(R).all(axis=(1, 2)) & (np.linalg.det(np.nan_to_num(R)) > 0.0)
    q = np.full((len(R), 4), np.nan)
    if np.any(sound):
        q[sound] = Rotation.from_matrix(R[sound]).as_quat()
    return q.reshape(*s.R.shape[:2], 4).astype(np.float32)
