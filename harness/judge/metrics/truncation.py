"""Compare a run's velocities, accelerations and joint loads with its own poses and with the equations of motion.

At sampled rows, velocities are compared with difference quotients of the poses, accelerations of index 1 with
difference quotients of the velocities, and recorded joint loads with those of index 1. The bound on an error is the
change of the rate from the quotient before the row to the one after it: about the error of a method of first order. A
ratio above 1, of the sum of errors to the sum of bounds, is more than the step size explains. Rates are those of a
body's matter in space, since a steady spin has constant components in the body frame.

Index 1 is evaluated at the recorded velocities, and at the recorded poses projected onto their constraints. One part of
a bound is from the rows beside each row, which are evaluated only where the other part is not ample. False gravity,
scaled velocities and false reactions show, however small, once steps are fine enough. Where steps are too long, the
exact motion at the same rows has as large a ratio, which excuses the run. Rows are not judged where moving the pose by
its own error changes the largest acceleration or load by a tenth.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from ...columns.measured import DECIDED, Truncation
from ...mechanics import so3
from ...mechanics.index1 import Index1, solve_index_1, solve_index_1_of_each
from ...mechanics.projection import disturb_poses, find_arms, project_poses, project_poses_of_each
from ...mechanics.state import States
from ...mechanics.system import MultibodySystem
from ...mechanics.types import ACCURATE
from .reactions import compute_loads_on_bodies
from .scales import measure_displacement

# "Half" and "twice" in these comments: tried on twelve runs of a pendulum, a top and a free body by five solvers, whose
# ratios are 1e-4 to 0.7; no ratio comes to 1 by any of them.
SAMPLES = 100  # most rows examined; half, twice: ratios of a pendulum change by 0.2 and 0.1 %
# fewest rows examined (half, twice: none changes); bound on nrows^2 6 nb times the rows, for large systems
LEAST, PRODUCTS = 4, 2e8
CLEAR = 0.5  # ratio to a part of the bound up to which the rest of it is not evaluated
# [rad] largest rotation over a step: difference quotients of longer steps mean nothing. Half and twice leave out and
# add rows of 5 and 2 runs at long steps: the ratio of accelerations at 20 steps a second is then 0.037 in place of
# 0.030.
RESOLVED = 0.5
TOLD = ACCURATE["accurate_until_1pct_s"]  # share of a speed, acceleration or load below which an error does not count
# rounding error of a difference of poses, in units of the last place. Half, twice: the tenth digit of a ratio changes.
ROUNDINGS = 64.0
# The next four act only where a ratio exceeds 1 at first: half and twice change no ratio of the twelve runs.
SURE = 0.1  # a bound is at least the change of an acceleration or load by its pose's own error, divided by this
FINEST, COARSEST = 1e-9, 1e-3  # range of a pose's own error, as shares of the length scale; a larger one is a fault
KNOWN = 0.1  # share of the largest acceleration or load: one that the pose's error changes by more is not judged
# largest error of a row that counts, in units of the largest acceleration or load. Half: a ratio of reactions at ten
# steps a second is 0.097 in place of 0.087; twice: none changes.
MOST = 2.0
SEEDS = (0, 1)  # random seeds of the two changes of a pose
TWICE = 2.0  # multiple of the exact motion's ratio that a run may have
COVERED = 0.5  # share of the rows where the exact motion must be known to excuse a run


@dataclass(frozen=True)
class _Rows:
    """The n rows examined, with difference quotients of poses and velocities to both sides, (n, nb, 6) each."""

    system: MultibodySystem
    here: States  # states at the rows, as recorded
    v: np.ndarray  # (v, Omega) as recorded
    sides: tuple[np.ndarray, np.ndarray]  # constant (v, Omega) over the steps before and after
    quotients: tuple[np.ndarray, np.ndarray]  # difference quotients of (v, Omega)
    h: tuple[np.ndarray, np.ndarray]  # [s] the steps before and after
    before_and_after: tuple[States, States]  # states before and after, as recorded


def measure_truncation(
    system: MultibodySystem,
    t: Float[np.ndarray, " nt"],
    s: States,
    reaction: Float[np.ndarray, "nt nrows"] | None,
    speed: float,
    length: float,
    exact: Callable[[np.ndarray], States] | None = None,
    covered: int = 0,
) -> Truncation:
    """Return the worst body's ratios of summed errors to bounds, for velocities, accelerations and reactions.

    Errors and bounds are those of the module's docstring; above 1 an error is more than the step size explains.
    Accelerations are those of index 1, not the run's own. Ratios of accelerations and reactions up to ``CLEAR`` are
    upper bounds, as a part of the bounds that they are divided by is not evaluated. If one of the two exceeds its
    bound, both bounds are widened by the effect of the poses' own errors. If the ratio of velocities or accelerations
    is still above 1, it is divided by that of the exact motion where this is known. A ratio is NaN with fewer than
    three rows, for a system at rest, and for reactions where none are recorded.

    ``speed`` [m/s] is the largest of the motion, ``length`` [m] its length scale; ``exact`` returns the exact motion at
    given rows of the run and is known at the first ``covered`` ones.
    """
    k = _choose_rows(system, t, s)
    if len(k) < 3 or not speed > 0.0:
        return Truncation()
    slow = speed / float(t[-1] - t[0])  # [m/s2] acceleration that reaches the speed over the whole run
    size = np.max(np.abs(s.r), initial=0.0) + np.max(system.gyration)
    rows = _collect_rows(system, t, s, k)
    near = project_poses(system, rows.here)
    found = [solve_index_1(system, near)]
    recorded = None if reaction is None or not system.nj else [reaction[k + d] for d in (-1, 0, 1)]
    no_widening, every = np.zeros((len(k), system.nb)), np.ones(len(k), dtype=bool)
    velocities = _compute_ratio(*_compare_velocities(rows, speed, size))

    def compare(found: list[Index1]) -> tuple[Truncation, np.ndarray, float]:
        """Return all ratios, the largest acceleration at each row [m/s2], and the larger ratio that depends on index 1.

        ``found`` is index 1 at the rows, or before, at and after them. The last result is infinite if an acceleration
        is.
        """
        accelerations, largest = _compare_accelerations(rows, found, slow, no_widening, every)
        reactions = _compare_reactions(rows, found, recorded, slow, no_widening, every)
        rate = float(np.max(largest, initial=0.0, where=np.isfinite(largest))) / speed
        worst = max(np.nan_to_num([accelerations, reactions])) if np.all(np.isfinite(largest)) else np.inf
        return Truncation(velocities, accelerations, reactions, rate, len(k)), largest, worst

    out, largest, worst = compare(found)
    if worst > CLEAR or _may_be_infinite(rows):
        out, largest, worst = compare(found := _solve_neighbours(rows, found[0]))
    if worst > 1.0:
        out = _widen_by_pose_errors(out, rows, near, found, recorded, slow, largest, length)
    known = k[k + 1 < covered]
    enough = len(known) >= max(3, COVERED * len(k))
    if exact is not None and enough and max(np.nan_to_num([out.velocities, out.accelerations])) > 1.0:
        out = _excuse_by_exact_motion(out, system, t, known, exact, (speed, size, slow))
    return out


def _may_be_infinite(rows: _Rows) -> bool:
    """Return whether accelerations or loads in the neighbouring rows might not be finite, so that a row does not count.

    They might with springs, user forces and drives, and where a recorded state is not finite.
    """
    system = rows.system
    forced = len(system.spring_k) or len(system.torsion_k) or len(system.user_i) or np.any(system.joint_moving)
    return bool(forced) or not all(
        np.all(np.isfinite(a)) for s in rows.before_and_after for a in (s.r, s.R, s.v, s.Omega)
    )


def _solve_neighbours(rows: _Rows, here: Index1) -> list[Index1]:
    """Return index 1 before, at and after the rows, at poses projected onto the constraints; ``here`` is given."""
    before, after = solve_index_1_of_each(rows.system, project_poses_of_each(rows.system, rows.before_and_after))
    return [before, here, after]


def _widen_by_pose_errors(
    out: Truncation,
    rows: _Rows,
    near: States,
    found: list[Index1],
    recorded: list[np.ndarray] | None,
    slow: float,
    largest: np.ndarray,
    length: float,
) -> Truncation:
    """Return ``out`` with bounds on accelerations and reactions that allow for the errors of the poses themselves.

    Each pose of ``near``, the rows projected onto the constraints, is moved twice at random by the distance that the
    projection moved it. The largest change of an acceleration or load by this, over ``SURE``, is added to its bound;
    rows where it exceeds ``KNOWN`` of the ``largest`` acceleration [m/s2] or load are left out and counted. ``found``,
    ``recorded`` and ``slow`` are as in ``_compare_accelerations`` and ``_compare_reactions``; ``length`` [m] is the
    length scale.
    """
    system = rows.system
    own = np.max(measure_displacement(system, rows.here, near), axis=1, initial=FINEST * length)
    own = np.minimum(own, COARSEST * length)
    moved = solve_index_1_of_each(system, [disturb_poses(system, near, own, seed) for seed in SEEDS])
    a, load, Omega = found[1].a, found[1].load, rows.here.Omega
    field = _make_matter_rates(a, Omega, _repeat_identity(a))
    change = np.max(
        [_compute_rms_field(system, _make_matter_rates(x.a, Omega, _repeat_identity(a)) - field) for x in moved], axis=0
    )
    known = np.all(change <= KNOWN * largest, axis=1)  # false where it is no number, too
    accelerations, _ = _compare_accelerations(rows, found, slow, change / SURE, known)
    out = replace(out, accelerations=accelerations, unsure=int(np.sum(~known)))
    if recorded is None:
        return out
    change = np.max([_measure_loads(system, x.load - load) for x in moved], axis=0)
    known &= np.all(change <= KNOWN * _find_largest_load(system, load, slow), axis=1)
    reactions = _compare_reactions(rows, found, recorded, slow, change / SURE, known)
    return replace(out, reactions=reactions, unsure_loads=int(np.sum(~known)))


def _excuse_by_exact_motion(
    out: Truncation,
    system: MultibodySystem,
    t: np.ndarray,
    k: np.ndarray,
    exact: Callable[[np.ndarray], States],
    sizes: tuple[float, float, float],
) -> Truncation:
    """Return ``out`` with the ratios of velocities and accelerations divided by twice those of the exact motion.

    ``k`` are the rows at which the ratios of the exact motion are computed. A ratio is divided only if twice that of
    the exact motion is above 1: then the steps are too long to judge rates. ``sizes`` are the largest speed [m/s], the
    size of the system [m], and the least acceleration that errors are compared with [m/s2].
    """
    speed, size, slow = sizes
    around = np.unique(np.concatenate((k - 1, k, k + 1)))
    same = _collect_rows(system, t[around], exact(around), np.searchsorted(around, k))
    found = _solve_neighbours(same, solve_index_1(system, project_poses(system, same.here)))
    every, no_widening = np.ones(len(k), dtype=bool), np.zeros((len(k), system.nb))
    velocities = _compute_ratio(*_compare_velocities(same, speed, size))
    accelerations, _ = _compare_accelerations(same, found, slow, no_widening, every)
    return replace(
        out,
        velocities=out.velocities / np.fmax(1.0, TWICE * velocities),
        accelerations=out.accelerations / np.fmax(1.0, TWICE * accelerations),
    )


def _collect_rows(system: MultibodySystem, t: np.ndarray, s: States, k: np.ndarray) -> _Rows:
    """Return the rows ``k`` (indices) of a motion with the difference quotients of its poses and velocities.

    There is one over the step before each row, and one over the step after it.
    """
    before, here, after = (s.at(k + d) for d in (-1, 0, 1))
    h1, h2 = ((t[k + d] - t[k + d - 1])[:, None, None] for d in (0, 1))
    quotients = tuple(
        (_stack_velocities(y) - _stack_velocities(x)) / h for x, y, h in ((before, here, h1), (here, after, h2))
    )
    return _Rows(
        system,
        here,
        _stack_velocities(here),
        (_compute_mean_velocities(before, here, h1), _compute_mean_velocities(here, after, h2)),
        (quotients[0], quotients[1]),
        (h1, h2),
        (before, after),
    )


def _halve_rotations(rows: _Rows) -> list[np.ndarray]:
    """Return each body's rotations (n, nb, 3, 3) from the row to the middles of the steps before and after."""
    return [so3.exp(sign * 0.5 * h * x[..., 3:]) for sign, h, x in zip((-1.0, 1.0), rows.h, rows.sides, strict=True)]


def _interpolate_slope(rows: _Rows, pair: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the slope at each row of the parabola through it and its neighbours, from its two difference quotients.

    ``pair`` are these quotients, over the steps before and after the row.
    """
    h1, h2 = rows.h
    return np.asarray((h2 * pair[0] + h1 * pair[1]) / (h1 + h2))


def _estimate_rounding(rows: _Rows) -> np.ndarray:
    """Return the rounding error of difference quotients (n, 1) [1/s]; times the size of the poses [m] it is in m/s."""
    return np.asarray((np.finfo(float).eps * ROUNDINGS / np.minimum(*rows.h))[..., 0])


def _compare_velocities(rows: _Rows, speed: float, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of velocities against difference quotients of poses, and their bounds, both (n, nb) in m/s.

    ``speed`` [m/s] is the largest of the motion; ``size`` [m] is that of the poses, for rounding.
    """
    first, last = (
        _make_matter_rates(x, np.zeros_like(x[..., 3:]), turn)
        for x, turn in zip(rows.sides, _halve_rotations(rows), strict=True)
    )
    error = _compute_rms_velocity(rows.system, _interpolate_slope(rows, rows.sides) - rows.v)
    return error, _compute_rms_field(rows.system, last - first) + TOLD * speed + size * _estimate_rounding(rows)


def _compare_accelerations(
    rows: _Rows, found: list[Index1], slow: float, wider: np.ndarray, known: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the ratio of the errors of accelerations to their bounds, and the largest acceleration (n, 1) [m/s2].

    ``found`` is index 1 before, at and after the rows, or at the rows alone: then the part of the bounds that follows
    from the neighbours is left out. ``wider`` (n, nb) [m/s2] is added to the bounds, only rows that are ``known`` (n,)
    count, and ``slow`` [m/s2] is the least acceleration that errors are compared with.
    """
    system, a, halves = rows.system, found[len(found) // 2].a, _halve_rotations(rows)
    field = _make_matter_rates(a, rows.here.Omega, _repeat_identity(a))
    # a body at rest has no acceleration to compare with
    largest = np.maximum(np.max(_compute_rms_field(system, field), axis=1, keepdims=True), slow)
    first, last = (
        _make_matter_rates(q, x[..., 3:], turn) for q, x, turn in zip(rows.quotients, rows.sides, halves, strict=True)
    )
    bound = _compute_rms_field(system, last - first)
    if len(found) > 1:
        ends = (
            _make_matter_rates(x.a, at.Omega, half @ half) - field
            for x, at, half in zip((found[0], found[2]), rows.before_and_after, halves, strict=True)
        )
        bound = np.maximum(bound, sum(_compute_rms_field(system, x) for x in ends))
    error = _compute_rms_velocity(system, _interpolate_slope(rows, rows.quotients) - a)
    error, bound = _cap_errors(error, bound, MOST * largest)
    fastest = float(np.max(_compute_rms_velocity(system, rows.v), initial=0.0))
    bound = bound + TOLD * largest + fastest * _estimate_rounding(rows) + wider
    return _compute_ratio(error, bound, known), largest


def _compare_reactions(
    rows: _Rows,
    found: list[Index1],
    recorded: list[np.ndarray] | None,
    slow: float,
    wider: np.ndarray,
    known: np.ndarray,
) -> float:
    """Return the ratio of the errors of joint loads to their bounds over ``known`` rows; NaN without reactions.

    ``recorded`` are the recorded reactions before, at and after the rows; ``found`` and ``known`` are those of
    ``_compare_accelerations``. ``wider`` (n, nb) [N] is added to the bounds; the errors of a body are compared with at
    least its mass times ``slow`` [m/s2].
    """
    if recorded is None:
        return float("nan")
    system = rows.system
    at = (rows.before_and_after[0], rows.here, rows.before_and_after[1])
    loads = np.split(compute_loads_on_bodies(system, np.concatenate(recorded), States.join(at)), len(recorded))
    exact = [x.load for x in found]
    here = exact[len(exact) // 2]
    largest = _find_largest_load(system, here, slow)
    of_both = [x for x in (loads, exact) if len(x) > 1]
    steps = np.max([_measure_loads(system, x[1] - x[0]) + _measure_loads(system, x[2] - x[1]) for x in of_both], axis=0)
    error, bound = _cap_errors(_measure_loads(system, loads[1] - here), steps, MOST * largest)
    return _compute_ratio(error, bound + TOLD * largest + wider, known)


def _cap_errors(error: np.ndarray, bound: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and bounds, scaled down where an error exceeds ``most``, so that no single row decides a sum.

    An error and its bound are scaled by the same factor, which makes the error ``most``. An infinite error becomes
    ``most`` with a bound of zero.
    """
    factor = np.minimum(1.0, np.divide(most, error, out=np.ones_like(error), where=error > 0.0))
    with np.errstate(invalid="ignore"):
        scaled, scaled_bound = np.minimum(error * factor, most), np.minimum(bound * factor, most)
    infinite = np.isinf(error)
    return np.where(infinite, np.broadcast_to(most, error.shape), scaled), np.where(infinite, 0.0, scaled_bound)


def _find_largest_load(system: MultibodySystem, load: np.ndarray, slow: float) -> np.ndarray:
    """Return the joint load that errors of each body are compared with (n, nb) [N].

    It is the largest load on any body at that row, or the body's mass times ``slow`` [m/s2] if that is larger.
    """
    return np.maximum(np.max(_measure_loads(system, load), axis=1, keepdims=True), system.mass * slow)


def _repeat_identity(a: np.ndarray) -> np.ndarray:
    """Return identity rotations (n, nb, 3, 3) for accelerations ``a`` (n, nb, 6)."""
    return np.broadcast_to(np.eye(3), (*a.shape[:2], 3, 3))


def measure_unexplained_velocity(
    t: Float[np.ndarray, " nt"],
    pose_error: Float[np.ndarray, " nt"],
    velocity_error: Float[np.ndarray, " nt"],
    speed: float,
    turn: float,
) -> float:
    """Return the largest velocity error relative to the largest that the pose errors could cause.

    ``pose_error`` [m] and ``velocity_error`` [m/s] are against a reference, at the times ``t`` [s]. A pose error may
    change sign within a step, or within a radian of the fastest rotation or vibration, ``turn`` [rad/s]: it explains at
    most twice its size times the sum of both frequencies. NaN if velocities are accurate to ``TOLD`` of ``speed``
    [m/s], or with fewer than two steps.
    """
    largest = float(np.max(velocity_error, initial=0.0))
    if len(t) < 2 or not largest > TOLD * speed:
        return float("nan")
    explained = 2.0 * float(np.max(pose_error)) * (1.0 / float(np.median(np.diff(t))) + turn)
    return largest / (explained or np.finfo(float).tiny)


def _choose_rows(system: MultibodySystem, t: np.ndarray, s: States) -> Int[np.ndarray, " n"]:
    """Return the rows to examine (indices): evenly picked inner rows whose steps on both sides resolve the rotation.

    There are at most ``SAMPLES``, and fewer for large systems.
    """
    turn = np.max(np.linalg.norm(s.Omega, axis=2), axis=1, initial=0.0)
    h = np.diff(t)
    fastest = np.maximum(np.maximum(turn[:-2], turn[1:-1]), turn[2:])
    inner = 1 + np.flatnonzero(fastest * np.maximum(h[:-1], h[1:]) < RESOLVED)
    most = int(np.clip(PRODUCTS / (6 * system.nb * max(system.nrows, 1) ** 2), LEAST, SAMPLES))
    return inner[np.unique(np.linspace(0, len(inner) - 1, min(most, len(inner))).round().astype(np.int64))]


def _compute_mean_velocities(a: States, b: States, h: np.ndarray) -> np.ndarray:
    """Return the constant (v, Omega) that takes poses ``a`` to ``b`` over ``h`` [s], (n, nb, 6): space, body frame."""
    return np.concatenate(((b.r - a.r) / h, so3.log(np.swapaxes(a.R, -1, -2) @ b.R) / h), axis=-1)


def _stack_velocities(s: States) -> np.ndarray:
    """Return the recorded (v, Omega) of each body in one array (nt, nb, 6)."""
    return np.concatenate((s.v, s.Omega), axis=-1)


def _make_matter_rates(rate: np.ndarray, spin: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return velocities or accelerations of each body's matter as a linear field: those of C and a matrix for points.

    Column 0 of the result (n, nb, 3, 4) is that of C, the first half of ``rate``, in space. The other columns map a
    point of the body, in its frame, to its velocity or acceleration relative to C; the matrix is hat(Omega), or
    hat(Omega_dot) + hat(Omega)^2, rotated by ``turn``. For velocities, ``rate`` is (v, Omega) and ``spin`` is zero; for
    accelerations, they are their derivatives and Omega.
    """
    W = so3.hat(spin)
    return np.concatenate((rate[..., :3, None], turn @ (so3.hat(rate[..., 3:]) + W @ W)), axis=-1)


def _compute_rms_field(system: MultibodySystem, rate: np.ndarray) -> np.ndarray:
    """Return the root mean square over each body's matter (n, nb) of the field that ``_make_matter_rates`` returns."""
    trace = np.trace(system.inertia, axis1=1, axis2=2)[:, None, None]
    second = (0.5 * trace * np.eye(3) - system.inertia) / system.mass[:, None, None]
    G = rate[..., 1:]
    return np.sqrt(np.maximum(np.sum(rate[..., 0] ** 2, axis=-1) + np.einsum("tbij,bjk,tbik->tb", G, second, G), 0.0))


def _compute_ratio(error: np.ndarray, bound: np.ndarray, known: np.ndarray | None = None) -> float:
    """Return the ratio of the sum of errors ``error`` over the rows to that of bounds ``bound``, of the worst body.

    Both are (n, nb). Rows that are not finite, or not ``known``, do not count. NaN if fewer than three count, or if
    less than ``DECIDED`` of the rows are known.
    """
    counted = np.all(np.isfinite(error) & np.isfinite(bound), axis=1)
    if known is not None:
        counted &= known
    if np.sum(counted) < 3 or (known is not None and np.sum(known) < DECIDED * len(error)):
        return float("nan")
    total, least = np.sum(error[counted], axis=0), np.sum(bound[counted], axis=0)
    return float(np.max(np.divide(total, least, out=np.zeros_like(total), where=total > 0.0)))


def _compute_rms_velocity(system: MultibodySystem, a: np.ndarray) -> np.ndarray:
    """Return the root mean square over each body's matter (n, nb) of a velocity field ``a`` = (v, Omega) at one pose.

    For a difference of accelerations at one pose and velocity, it is that of the difference.
    """
    turning = np.einsum("tbi,bij,tbj->tb", a[..., 3:], system.inertia, a[..., 3:]) / system.mass
    return np.sqrt(np.sum(a[..., :3] ** 2, axis=-1) + turning)


def _measure_loads(system: MultibodySystem, load: np.ndarray) -> np.ndarray:
    """Return the norm of the joint load on each body [N]; its moment is divided by the body's arm (``find_arms``)."""
    moment = np.sum(load[..., 3:] ** 2, axis=-1) / find_arms(system) ** 2
    return np.sqrt(np.sum(load[..., :3] ** 2, axis=-1) + moment)
