"""Measure a trajectory: one code for every solver, from (t, r, R, v, Omega) alone.

``measure`` gives the series; the columns of a record are read off them in ``harness.metrics.summary``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from ..mechanics import so3
from ..mechanics.motion import constraint, constraint_energy_norm, constraint_rate, energy, measure_gaps
from ..mechanics.state import States
from ..mechanics.system import MultibodySystem
from ..mechanics.torsion import follow_turns
from ..mechanics.work import work
from ..reference.computation import reference_of
from ..types import GROWN, JUDGED, PREDICTABLE, Law, Problem, Reference, Trajectory
from .mechanisms import mechanisms, part, state_of, states_of
from .reactions import exact_pull_on_bodies, instants_to_compare, pull_on_bodies
from .rows import interpolate_rows, is_motion, kinematic_defect
from .scales import KINETIC, STATES, Run, Scales, blocks, displacement, load_compiled, measure_reach, scales, speeds
from .truncation import Truncation, truncation, unexplained_velocity

JOINTS = (Law.CONSTRAINT, Law.CONSTRAINT_RATE)  # not laws of a motion whose start, as printed, opens the joints
KNOWN = 1e-6  # of the time: an exact motion that ends before is none
PATH = 0.01  # of the reach: a shorter path is none
BETWEEN = 501  # times at which the motion between rows is compared


@dataclass(frozen=True)
class Judged:
    """Some bodies, how they keep the laws, and what that is compared with."""

    bodies: Int[np.ndarray, " n"]
    size: Scales
    laws: Mapping[Law, Float[np.ndarray, " nt"]]  # what is zero at each time in the exact motion


@dataclass(frozen=True)
class Measured:
    """Series over all accepted steps, (nt,) each; the reference's are NaN beyond its horizon, None without one."""

    t: Float[np.ndarray, " nt"]
    size: Scales
    mechanisms: tuple["Judged", ...]  # each with its own sizes; one is the whole system
    energy: Float[np.ndarray, " nt"]
    energy_error: Float[np.ndarray, " nt"]  # T + V less its start and the work, as far as that is certain
    phi_norm: Float[np.ndarray, " nt"]
    phi_dot_norm: Float[np.ndarray, " nt"]
    eq81_norm: Float[np.ndarray, " nt"]
    orthogonality: Float[np.ndarray, " nt"]
    steps_of_unknown_work: int = 0  # over which energy is not judged
    out_of_plane: Float[np.ndarray, " nt"] | None = None
    position_error: Float[np.ndarray, " nt"] | None = None
    orientation_error: Float[np.ndarray, " nt"] | None = None
    motion_error: Float[np.ndarray, " nt"] | None = None  # of both, module ``scales``: ``displacement``
    velocity_error: Float[np.ndarray, " nt"] | None = None
    angular_velocity_error: Float[np.ndarray, " nt"] | None = None
    reference_own_error: Float[np.ndarray, " nt"] | None = None
    rate_error: Float[np.ndarray, " nt"] | None = None  # of velocities, rms over a body's matter [m/s]
    kinematic_defect: float = float("nan")  # of the path, worst body (module ``rows``)
    truncation: Truncation = field(default_factory=Truncation)  # where there is a reference
    motion_between: float = float("nan")  # [m] largest motion error between rows, while the motion is predictable
    motion_between_s: float = float("nan")  # when
    reaction_error: float = float("nan")  # [N], largest at the instants compared
    reaction_error_s: float = float("nan")  # when
    reaction_size: float = float("nan")  # [N] of the exact one
    reaction_size_s: float = float("nan")
    reference_route: str = ""
    reference_horizon: float = float("nan")
    observables: dict[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)
    reference_observables: dict[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)
    invariants: dict[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)


def measure(problem: Problem, trajectory: Trajectory) -> Measured:
    """All series of a trajectory."""
    t, s = np.asarray(trajectory.t, dtype=float), trajectory.states
    reference = reference_of(problem)
    if reference is not None:
        _check_horizon(problem, reference)
    with np.errstate(all="ignore"):  # a motion may have blown up: its infinities are the result
        whole, E, drift, eq81, phi, phi_dot, unknown = _judge_laws(
            problem, reference, t, s, np.arange(problem.system.nb)
        )
        found = mechanisms(problem.system)
        each = (whole,) if len(found) == 1 else tuple(_judge_laws(problem, reference, t, s, b)[0] for b in found)
        at_home = problem.home(s)
        return Measured(
            t, whole.size, each, E, drift, phi, phi_dot, eq81, whole.laws[Law.ORTHOGONALITY], unknown,
            kinematic_defect=largest(kinematic_defect(problem.system, t, s, PATH * whole.size.length)),
            out_of_plane=_out_of_plane(problem, at_home),
            observables={o.name: np.asarray(o.of(at_home), dtype=float) for o in problem.observables},
            invariants={i.name: np.asarray(i.of(at_home), dtype=float) for i in problem.invariants},
            **_against_reference(problem, reference, trajectory, _shares(whole, each), whole.size),
        )  # fmt: skip


def largest(a: Float[np.ndarray, " n"]) -> float:
    """max |a|, infinite as soon as one value is not a number: a motion that became NaN is no small error."""
    if len(a) == 0:
        return math.nan
    return math.inf if np.any(np.isnan(a)) else float(np.max(np.abs(a)))


def _judge_laws(
    problem: Problem, reference: Reference | None, t: np.ndarray, s: States, bodies: np.ndarray
) -> tuple[Judged, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
    """With T + V, its drift, the norm of Eq. (81), |phi|, |phi_dot|, and how many steps have unknown work."""
    system, start = part(problem.system, bodies), state_of(problem.initial, bodies)
    s = follow_turns(system, t, states_of(s, bodies))
    some = (s.at(k) for k in blocks(len(t), len(bodies)))
    parts = [(*_laws(system, b), measure_reach(system, start, b)) for b in some]
    E, phi, phi_dot, gap, gap_rate, eq81, defect, rows = (np.concatenate(p) for p in zip(*parts, strict=True))
    done, unsure, unknown = work(system, t, s, E)
    drift = E - E[0] - done
    drift = np.sign(drift) * np.maximum(np.abs(drift) - unsure, 0.0)  # what is certain of it
    rows[:, KINETIC] -= np.maximum(drift, 0.0)  # what was gained was not there to be exchanged
    laws = {Law.ENERGY: drift, Law.CONSTRAINT: gap, Law.CONSTRAINT_RATE: gap_rate, Law.ORTHOGONALITY: defect}
    binding = {k: a for k, a in laws.items() if not (problem.literal_start and k in JOINTS)}
    size = scales(problem, reference, Run(rows, binding, count_covered(reference, t)), bodies)
    return Judged(bodies, size, laws), E, drift, eq81, phi, phi_dot, int(np.sum(unknown))


def _shares(whole: Judged, each: tuple[Judged, ...]) -> np.ndarray:
    """By body (nb,): how much more a metre is to its mechanism than to the one that reaches farthest."""
    out = np.ones(len(whole.bodies))
    if len(each) > 1:
        for one in each:
            out[one.bodies] = whole.size.length / one.size.length
    return out


def count_covered(reference: Reference | None, t: Float[np.ndarray, " nt"]) -> int:
    """Steps up to the horizon; one of 5 s covers a last step at 5.000000000001 s."""
    return 0 if reference is None else int(np.sum(t <= reference.horizon * (1.0 + 1e-12)))


def _laws(system: MultibodySystem, s: States) -> tuple[np.ndarray, ...]:
    """T + V, |phi| and |phi_dot|, both again in metres, the norm of Eq. (81), and how far R is from a rotation.

    In metres a row of an axis counts by what it moves a body's matter: a hinge that opens by 1e-3 rad is nothing at
    1e-5 m, where |phi| is compared with 1e-7 m, and no success at 1e5 m.
    """
    metres = np.ones(system.nrows)
    metres[system.turning_rows] = np.max(system.gyration)
    if (fast := load_compiled(len(s) * system.nb)) is not None and fast.takes(system):
        return fast.laws(system, s, metres)
    phi, phi_dot = constraint(system, s), constraint_rate(system, s)
    return (
        energy(system, s),
        *(np.linalg.norm(a, axis=1) for a in (phi, phi_dot, measure_gaps(system, s) * metres, phi_dot * metres)),
        constraint_energy_norm(system, s),
        np.max(so3.orthogonality_defect(s.R), axis=1, initial=0.0),
    )


def _out_of_plane(problem: Problem, at_home: States) -> np.ndarray | None:
    if problem.planar_normal is None:
        return None
    normal = problem.planar_normal / np.linalg.norm(problem.planar_normal)
    away = at_home.r @ normal
    return np.max(np.abs(away - away[0]), axis=1)


def _against_reference(
    problem: Problem, reference: Reference | None, trajectory: Trajectory, shares: np.ndarray, size: Scales
) -> dict:
    if reference is None:
        return {}
    t = np.asarray(trajectory.t, dtype=float)
    s = follow_turns(problem.system, t, trajectory.states)
    n = count_covered(reference, t)
    names = ("position_error", "orientation_error", "motion_error", "velocity_error", "angular_velocity_error",
             "rate_error", "reference_own_error")  # fmt: skip
    series = {k: np.full(len(t), np.nan) for k in names}
    theirs = {o.name: np.full(len(t), np.nan) for o in problem.observables}
    for rows in blocks(n, problem.system.nb):
        exact = reference.states(np.minimum(t[rows], reference.horizon))
        series["position_error"][rows] = np.max(np.linalg.norm(s.r[rows] - exact.r, axis=2), axis=1)
        series["orientation_error"][rows] = np.max(so3.angle_between(s.R[rows], exact.R), axis=1)
        series["motion_error"][rows] = np.max(shares * displacement(problem.system, s.at(rows), exact), axis=1)
        series["velocity_error"][rows] = np.max(np.linalg.norm(s.v[rows] - exact.v, axis=2), axis=1)
        series["angular_velocity_error"][rows] = np.max(np.linalg.norm(s.Omega[rows] - exact.Omega, axis=2), axis=1)
        apart = States(exact.r, exact.R, s.v[rows] - exact.v, s.Omega[rows] - exact.Omega)
        series["rate_error"][rows] = np.max(shares * speeds(problem.system, apart), axis=1)
        series["reference_own_error"][rows] = stated_error(reference, t[rows])
        for name, values in problem.observe(exact).items():
            theirs[name][rows] = values
    about = {"reference_route": reference.route, "reference_horizon": float(reference.horizon)}
    off = _between_rows(problem, reference, t, s, size.length)
    pull = _reaction_error(problem, reference, t, s, trajectory.reaction)
    within = count_predictable(t[:n], series["reference_own_error"][:n] / size.length) if n else 0
    away = series["motion_error"][:within] + series["reference_own_error"][:within]
    steps = truncation(problem.system, t, s, trajectory.reaction, size.speed)
    more = unexplained_velocity(t[:within], s.at(slice(within)), away, series["rate_error"][:within], size.speed)
    pull["truncation"] = replace(steps, velocities=float(np.fmax(steps.velocities, more)))
    return {**series, **off, **pull, **about, "reference_observables": theirs}


def _check_horizon(problem: Problem, reference: Reference) -> None:
    """ValueError for one that judges nothing; a computed one may end at once, where its formulations part."""
    least = KNOWN * problem.t_end if problem.reference_from is not None else 0.0
    if not reference.horizon >= least:
        raise ValueError(f"the horizon of the reference must be at least {least:g} s (got {reference.horizon:g})")


def stated_error(reference: Reference, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
    """The error that the reference states; ValueError for one that is no bound: it would judge nothing."""
    own = np.asarray(reference.error(t), dtype=float)
    if own.shape != t.shape or not np.all((own >= 0.0) & (own < math.inf)):
        raise ValueError("the error that a reference states must be a finite number >= 0 [m] at each time")
    return own


def _between_rows(problem: Problem, reference: Reference, t: np.ndarray, s: States, length: float) -> dict[str, float]:
    """Errors of the motion at times of the reference's own, up to its horizon."""
    end = min(problem.t_end, reference.horizon, float(t[-1]))
    if len(t) < 2 or not end > 0.0 or not is_motion(s):
        return {}
    at = np.linspace(0.0, end, BETWEEN)
    at = at[: count_predictable(at, stated_error(reference, at) / length)]
    if len(at) == 0:
        raise ValueError(f"the reference states an error by which nothing can be judged, of a reach of {length:.3g} m")
    some = ((interpolate_rows(t, s, at[k]), reference.states(at[k])) for k in blocks(len(at), problem.system.nb))
    away = np.concatenate([np.max(displacement(problem.system, *both), axis=1) for both in some])
    worst = int(np.argmax(away))  # the first NaN, if there is one
    return {"motion_between": largest(away), "motion_between_s": float(at[worst])}


def count_predictable(t: Float[np.ndarray, " nt"], own: Float[np.ndarray, " nt"]) -> int:
    """Rows over which errors are judged; ``own``: stated errors of the reference, of the reach."""
    tenth = np.maximum(np.searchsorted(t, 0.1 * t, side="right") - 1, min(1, len(t) - 1))
    steady = (own <= JUDGED) & (own <= GROWN * own[tenth])
    return int(np.sum(np.cumprod((own <= PREDICTABLE) | steady)))


def _reaction_error(
    problem: Problem, reference: Reference, t: np.ndarray, s: States, reaction: np.ndarray | None
) -> dict:
    """Error of the sum of joint forces on a body at some instants; empty where the solver or the reference has none."""
    system = problem.system
    if reaction is None or system.nj == 0:
        return {}
    rows = instants_to_compare(t, reference.horizon)
    rows = rows[:: 1 + len(rows) * system.nb // STATES]
    found = pull_on_bodies(system, np.asarray(reaction, dtype=float)[rows], s.at(rows))
    known = ~np.any(np.isnan(found), axis=(1, 2))
    if not np.any(known):
        return {}
    at = t[rows[known]]

    def motion(x: np.ndarray) -> States:
        there = reference.states(x)
        if s.angles is None:
            return there
        return there.with_angles(np.array([np.interp(x, t, a) for a in s.angles.T]).T)

    exact = exact_pull_on_bodies(system, motion, at)
    out: dict[str, float] = {}
    for name, pull in (("reaction_error", found[known] - exact), ("reaction_size", exact)):
        worst = np.max(np.linalg.norm(pull, axis=2), axis=1)
        k = int(np.argmax(worst))
        out |= {name: float(worst[k]), f"{name}_s": float(at[k])}
    return out
