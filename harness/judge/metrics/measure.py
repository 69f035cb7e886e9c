"""Measure a trajectory: one code for every solver, from (t, r, R, v, Omega) alone.

``measure`` gives the series; the functions in ``harness/columns/declared/`` read the columns of a record off them.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...columns.measured import JudgedBodies, MeasuredSeries, Scales
from ...columns.numbers import count_predictable, find_largest
from ...mechanics import so3
from ...mechanics.index1 import is_dense
from ...mechanics.motion import constraint, constraint_energy_norm, constraint_rate, energy, measure_gaps
from ...mechanics.projection import find_arms
from ...mechanics.state import States
from ...mechanics.system import MultibodySystem
from ...mechanics.torsion import follow_turns
from ...mechanics.types import Law, Problem, Reference, Trajectory
from ...mechanics.work import compute_work
from ...reference.computation import explain_end, find_reference
from ...reference.held import recall_value
from .mechanisms import extract_state, extract_states, extract_subsystem, split_mechanisms
from .passages import list_passages
from .reactions import choose_instants, compute_loads_on_bodies
from .rows import interpolate_rows, is_motion, measure_kinematic_defect
from .scales import (
    KINETIC,
    STATES,
    RunSizes,
    find_scales,
    load_compiled,
    measure_displacement,
    measure_sizes,
    measure_speeds,
    split_into_blocks,
)
from .stored_loads import find_exact_loads
from .truncation import measure_truncation, measure_unexplained_velocity

JOINTS = (Law.CONSTRAINT, Law.CONSTRAINT_RATE)  # laws that are not judged for a literal start, which opens the joints
KNOWN = 1e-6  # minimum horizon of a problem's own reference, as a fraction of t_end
FEW = 150  # most instants at which reactions of a large system are compared
# kinematic defect above which the steps may be too long to show an error. Half, twice: no column of twelve runs
# changes.
RESOLVED = 0.5
# share of the length scale that is added to a path, so that a body at rest has no defect. Half, twice: the defect of a
# pendulum changes by 0.05 and -0.09 %.
PATH = 0.01
# times at which the motion between steps is compared: over 25 periods the largest error is found to 1.2 % (half: 5 %)
BETWEEN = 501


class _Laws(NamedTuple):
    """The laws evaluated for some bodies: what their judgement needs, and series (nt,) to report."""

    judged: JudgedBodies  # residuals and scales
    energy: np.ndarray  # T + V [J]
    drift: np.ndarray  # [J] energy drift, brought nearer to zero by the uncertainty of the work
    eq81: np.ndarray  # [sqrt(J)] the norm of Eq. (81)
    phi: np.ndarray  # |phi| and |phi_dot| of all rows, each in its own unit
    phi_dot: np.ndarray
    unknown: int  # number of steps whose work is unknown


def measure(problem: Problem, trajectory: Trajectory) -> MeasuredSeries:
    """Measure a trajectory of a problem: residuals of laws, errors against the reference, observables at each step.

    Laws are evaluated for the whole system and for each of its mechanisms; without a reference, the series of errors
    are missing. Raise ValueError if the problem's own reference ends too early or states too large an error.
    """
    t, s = np.asarray(trajectory.t, dtype=float), trajectory.states
    reference = find_reference(problem)
    if reference is not None:
        _check_horizon(problem, reference)
    with np.errstate(all="ignore"):  # a motion may have blown up: its infinities are the result
        laws = _evaluate_laws(problem, reference, t, s, np.arange(problem.system.nb))
        whole, found = laws.judged, split_mechanisms(problem.system)
        each = (whole,) if len(found) == 1 else tuple(_evaluate_laws(problem, reference, t, s, b).judged for b in found)
        at_home = problem.home(s)
        defect = find_largest(measure_kinematic_defect(problem.system, t, s, PATH * whole.size.length))
        return MeasuredSeries(
            t,
            whole.size,
            each,
            energy=laws.energy,
            energy_error=laws.drift,
            phi_norm=laws.phi,
            phi_dot_norm=laws.phi_dot,
            eq81_norm=laws.eq81,
            orthogonality=whole.laws[Law.ORTHOGONALITY],
            steps_of_unknown_work=laws.unknown,
            kinematic_defect=defect,
            kinematic_exact=_measure_exact_defect(problem, reference, t, whole.size.length)
            if defect > RESOLVED
            else 0.0,
            out_of_plane=_measure_out_of_plane(problem, at_home),
            observables={o.name: np.asarray(o.of(at_home), dtype=float) for o in problem.observables},
            invariants={i.name: np.asarray(i.of(at_home), dtype=float) for i in problem.invariants},
            notes=(*list_passages(problem.system, t, s), *explain_end(reference)),
            **_compare_with_reference(problem, reference, trajectory, _compute_length_ratios(whole, each), whole.size),
        )


def _measure_exact_defect(problem: Problem, reference: Reference | None, t: np.ndarray, length: float) -> float:
    """Return the kinematic defect of the exact motion sampled at the times ``t`` of a run [s]: what long steps explain.

    ``length`` [m] is the length scale. Zero if the reference is missing or covers less than half of the steps.
    """
    if reference is None or (n := count_covered(reference, t)) < max(2, 0.5 * len(t)):
        return 0.0
    exact = reference.states(np.minimum(t[:n], reference.horizon))
    return find_largest(measure_kinematic_defect(problem.system, t[:n], exact, PATH * length))


def _evaluate_laws(
    problem: Problem, reference: Reference | None, t: np.ndarray, s: States, bodies: np.ndarray
) -> _Laws:
    """Return the laws evaluated for ``bodies`` (indices) alone, with the joints and forces that act on them.

    A residual that is within the uncertainty of the work counts as zero. Scales are those of these bodies.
    """
    system, start = extract_subsystem(problem.system, bodies), extract_state(problem.initial, bodies)
    s = follow_turns(system, t, extract_states(s, bodies))
    some = (s.at(k) for k in split_into_blocks(len(t), len(bodies)))
    parts = [(*_compute_laws(system, b), measure_sizes(system, start, b)) for b in some]
    E, phi, phi_dot, gap, gap_rate, eq81, defect, rows = (np.concatenate(p) for p in zip(*parts, strict=True))
    done, unsure, unknown = compute_work(system, t, s, E)
    drift = E - E[0] - done
    drift = np.sign(drift) * np.maximum(np.abs(drift) - unsure, 0.0)  # the part that is certain
    rows[:, KINETIC] -= np.maximum(drift, 0.0)  # energy gained by error was not there to be exchanged
    laws = {Law.ENERGY: drift, Law.CONSTRAINT: gap, Law.CONSTRAINT_RATE: gap_rate, Law.ORTHOGONALITY: defect}
    binding = {k: a for k, a in laws.items() if not (problem.literal_start and k in JOINTS)}
    size = find_scales(problem, reference, RunSizes(rows, binding, count_covered(reference, t)), bodies)
    return _Laws(JudgedBodies(bodies, size, laws), E, drift, eq81, phi, phi_dot, int(np.sum(unknown)))


def _compute_length_ratios(whole: JudgedBodies, each: tuple[JudgedBodies, ...]) -> np.ndarray:
    """Return, by body (nb,), the length scale of the whole system over that of the body's own mechanism.

    Errors of a body times its ratio are comparable between mechanisms of different size.
    """
    out = np.ones(len(whole.bodies))
    if len(each) > 1:
        for one in each:
            out[one.bodies] = whole.size.length / one.size.length
    return out


def count_covered(reference: Reference | None, t: Float[np.ndarray, " nt"]) -> int:
    """Return how many of the times ``t`` lie within the reference's horizon, up to rounding; 0 without a reference."""
    return 0 if reference is None else int(np.sum(t <= reference.horizon * (1.0 + 1e-12)))


def _compute_laws(system: MultibodySystem, s: States) -> tuple[np.ndarray, ...]:
    """Return seven arrays (nt,): T + V [J], five norms of the constraint rows, and the largest |R^T R - 1| of a body.

    The norms are |phi| and |phi_dot| in the rows' own units, both again in m and m/s (phi as ``motion.measure_gaps``
    has it), and that of Eq. (81). In metres, an axis row counts by how far it displaces a body's matter: a hinge that
    opens by 1e-3 rad is negligible in a mechanism of 1e-5 m, where it displaces matter by 1e-8 m, and a failure in one
    of 1e5 m. Long motions are evaluated by compiled code if that covers the system's rows.
    """
    metres = np.ones(system.nrows)
    metres[system.turning_rows] = np.max(system.gyration)
    if (fast := load_compiled(len(s) * system.nb)) is not None and fast.covers_rows(system):
        return fast.evaluate_laws(system, s, metres)
    phi, phi_dot = constraint(system, s), constraint_rate(system, s)
    return (
        energy(system, s),
        *(np.linalg.norm(a, axis=1) for a in (phi, phi_dot, measure_gaps(system, s, phi) * metres, phi_dot * metres)),
        constraint_energy_norm(system, s, phi_dot),
        np.max(so3.orthogonality_defect(s.R), axis=1, initial=0.0),
    )


def _measure_out_of_plane(problem: Problem, at_home: States) -> np.ndarray | None:
    """Return the largest distance [m] of any C from its plane at the start, (nt,); None if the motion is not planar."""
    if problem.planar_normal is None:
        return None
    normal = problem.planar_normal / np.linalg.norm(problem.planar_normal)
    away = at_home.r @ normal
    return np.max(np.abs(away - away[0]), axis=1)


def _compare_with_reference(
    problem: Problem, reference: Reference | None, trajectory: Trajectory, length_ratios: np.ndarray, size: Scales
) -> dict:
    """Return the fields of ``MeasuredSeries`` that compare a run with its reference, by name; empty without one.

    ``length_ratios`` (nb,) are those of ``_compute_length_ratios``, ``size`` the scales of the whole system. Errors are
    the largest over all bodies, and NaN beyond the horizon.
    """
    if reference is None:
        return {}
    t = np.asarray(trajectory.t, dtype=float)
    s = follow_turns(problem.system, t, trajectory.states)
    n = count_covered(reference, t)
    names = (
        "position_error",
        "orientation_error",
        "motion_error",
        "velocity_error",
        "angular_velocity_error",
        "rate_error",
        "reference_own_error",
    )
    series = {k: np.full(len(t), np.nan) for k in names}
    exact_observables = {o.name: np.full(len(t), np.nan) for o in problem.observables}
    for rows in split_into_blocks(n, problem.system.nb):
        exact = reference.states(np.minimum(t[rows], reference.horizon))
        series["position_error"][rows] = np.max(np.linalg.norm(s.r[rows] - exact.r, axis=2), axis=1)
        series["orientation_error"][rows] = np.max(so3.angle_between(s.R[rows], exact.R), axis=1)
        series["motion_error"][rows] = np.max(
            length_ratios * measure_displacement(problem.system, s.at(rows), exact), axis=1
        )
        series["velocity_error"][rows] = np.max(np.linalg.norm(s.v[rows] - exact.v, axis=2), axis=1)
        series["angular_velocity_error"][rows] = np.max(np.linalg.norm(s.Omega[rows] - exact.Omega, axis=2), axis=1)
        difference = States(exact.r, exact.R, s.v[rows] - exact.v, s.Omega[rows] - exact.Omega)
        series["rate_error"][rows] = np.max(length_ratios * measure_speeds(problem.system, difference), axis=1)
        series["reference_own_error"][rows] = evaluate_stated_error(reference, t[rows])
        for name, values in problem.observe(exact).items():
            exact_observables[name][rows] = values
    of_reference = {"reference_route": reference.route, "reference_horizon": float(reference.horizon)}
    between = _compare_between_rows(problem, reference, t, s, size.length)
    reactions = _compare_reactions(problem, reference, t, s, trajectory.reaction)
    within = count_predictable(t[:n], series["reference_own_error"][:n] / size.length) if n else 0
    pose_error = series["motion_error"][:within] + series["reference_own_error"][:within]

    def evaluate_exact(rows: np.ndarray) -> States:
        """Return the exact motion at these rows of the run; torsional springs keep the run's angles, with all turns."""
        there = reference.states(np.minimum(t[rows], reference.horizon))
        return there if s.angles is None else there.with_angles(s.angles[rows])

    steps = measure_truncation(problem.system, t, s, trajectory.reaction, size.speed, size.length, evaluate_exact, n)
    fastest = np.fmax(steps.rate, float(np.max(np.linalg.norm(s.Omega[:within], axis=2), initial=0.0)))
    unexplained = measure_unexplained_velocity(
        t[:within], pose_error, series["rate_error"][:within], size.speed, float(fastest)
    )
    reactions["truncation"] = replace(steps, velocities=float(np.fmax(steps.velocities, unexplained)))
    return {**series, **between, **reactions, **of_reference, "reference_observables": exact_observables}


def _check_horizon(problem: Problem, reference: Reference) -> None:
    """Raise ValueError if the horizon of a problem's own reference is too short to judge a run by.

    A computed reference may end early, where its two routes diverge.
    """
    least = KNOWN * problem.t_end if problem.reference_from is not None else 0.0
    if not reference.horizon >= least:
        raise ValueError(f"the horizon of the reference must be at least {least:g} s (got {reference.horizon:g})")


def evaluate_stated_error(reference: Reference, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
    """Return the reference's bound on its own error (nt,) [m]; raise ValueError unless it is finite at each time."""
    own = np.asarray(reference.error(t), dtype=float)
    if own.shape != t.shape or not np.all((own >= 0.0) & (own < math.inf)):
        raise ValueError("the error that a reference states must be a finite number >= 0 [m] at each time")
    return own


def _compare_between_rows(
    problem: Problem, reference: Reference, t: np.ndarray, s: States, length: float
) -> dict[str, float]:
    """Return the largest motion error between recorded steps [m] and its time [s], by the names of their fields.

    The recorded motion is interpolated at evenly spaced times while the exact one is predictable; ``length`` [m] is the
    length scale. Empty for a motion that is not finite or has fewer than two steps. Raise ValueError if the exact
    motion is predictable nowhere.
    """
    end = min(problem.t_end, reference.horizon, float(t[-1]))
    if len(t) < 2 or not end > 0.0 or not is_motion(s):
        return {}
    at, exact = sample_between(problem, reference, length, end)
    if len(at) == 0:
        raise ValueError(
            f"the reference's stated error is too large to judge any run (motion amplitude {length:.3g} m)"
        )
    blocks = split_into_blocks(len(at), problem.system.nb)
    some = ((interpolate_rows(t, s, at[k]), there) for k, there in zip(blocks, exact, strict=True))
    away = np.concatenate([np.max(measure_displacement(problem.system, *both), axis=1) for both in some])
    worst = int(np.argmax(away))  # the first NaN, if there is one
    return {"motion_between": find_largest(away), "motion_between_s": float(at[worst])}


def sample_between(
    problem: Problem, reference: Reference, length: float, end: float
) -> tuple[Float[np.ndarray, " n"], list[States]]:
    """Return evenly spaced times up to ``end`` [s] while the exact motion is predictable, and its states in blocks.

    The blocks are those of ``split_into_blocks``. For a problem that the parent of runs holds, the result is stored in
    memory, as it is the same for all runs that reach ``end``. ``length`` [m] is the length scale.
    """

    def sample() -> tuple[np.ndarray, list[States]]:
        """Return the times and the blocks of the exact motion's states at them."""
        at = np.linspace(0.0, end, BETWEEN)
        at = at[: count_predictable(at, evaluate_stated_error(reference, at) / length)]
        return at, [reference.states(at[k]) for k in split_into_blocks(len(at), problem.system.nb)]

    return recall_value(problem, ("exact between", length, end), sample)


def _compare_reactions(
    problem: Problem, reference: Reference, t: np.ndarray, s: States, reaction: np.ndarray | None
) -> dict:
    """Return the largest errors of joint force [N] and moment [N m] on a body, the largest exact ones, and their times.

    They are returned by the names of their fields. Empty if the solver returned no reactions, the system has no joints,
    or those of the exact motion are unknown. Where moments about C are small, as for a mass at the end of a rod, the
    size of a moment is that of the force at the arm of the body's farthest joint.
    """
    system = problem.system
    if reaction is None or system.nj == 0:
        return {}
    rows = choose_instants(t, reference.horizon)
    rows = rows[:: 1 + len(rows) * system.nb // STATES]
    rows = rows if is_dense(system) else rows[:: 1 + len(rows) // FEW]
    found = compute_loads_on_bodies(system, np.asarray(reaction, dtype=float)[rows], s.at(rows))
    known = ~np.any(np.isnan(found), axis=(1, 2))
    if not np.any(known):
        return {}
    at = t[rows[known]]
    there = reference.states(at)
    if s.angles is not None:
        there = there.with_angles(s.angles[rows[known]])
    exact = find_exact_loads(problem, t, there)
    sure = ~np.any(np.isnan(exact), axis=(1, 2))
    if not np.any(sure):
        return {}
    out: dict[str, float] = {}
    off = (found[known] - exact)[sure]
    forces, moments = (np.linalg.norm(exact[sure][..., part], axis=2) for part in (slice(3), slice(3, 6)))
    for name, of_bodies in (
        ("reaction_error", np.linalg.norm(off[..., :3], axis=2)),
        ("reaction_size", forces),
        ("moment_error", np.linalg.norm(off[..., 3:], axis=2)),
        ("moment_size", np.maximum(moments, find_arms(system) * forces)),
    ):
        worst = np.max(of_bodies, axis=1)
        k = int(np.argmax(worst))
        out |= {name: float(worst[k]), f"{name}_s": float(at[sure][k])}
    return out
