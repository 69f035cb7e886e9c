"""What a trajectory is worth: one code for every solver, from (t, r, R, v, Omega) alone.

``measure`` gives the series; the columns of a record are read off them in ``harness.summary``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from ..mechanics import so3
from ..mechanics.motion import constraint, constraint_energy_norm, constraint_rate, damper_lines, damping_work, energy
from ..mechanics.state import States
from ..mechanics.system import MultibodySystem
from ..reference.computed import reference_of
from ..types import Law, Problem, Reference, Trajectory
from .mechanisms import mechanisms, part, state_of, states_of
from .reactions import exact_pull_on_bodies, instants_to_compare, pull_on_bodies
from .scales import KINETIC, Run, Scales, displacement, reached, scales

JOINTS = (Law.CONSTRAINT, Law.CONSTRAINT_RATE)  # not laws of a motion whose start, as printed, opens the joints
BLOCK = 4096  # steps measured at a time: bounds the memory of 55 bodies over 1e5 steps


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
    energy_error: Float[np.ndarray, " nt"]
    phi_norm: Float[np.ndarray, " nt"]
    phi_dot_norm: Float[np.ndarray, " nt"]
    eq81_norm: Float[np.ndarray, " nt"]
    orthogonality: Float[np.ndarray, " nt"]
    out_of_plane: Float[np.ndarray, " nt"] | None = None
    position_error: Float[np.ndarray, " nt"] | None = None
    orientation_error: Float[np.ndarray, " nt"] | None = None
    motion_error: Float[np.ndarray, " nt"] | None = None  # of both, module ``scales``: ``displacement``
    velocity_error: Float[np.ndarray, " nt"] | None = None
    angular_velocity_error: Float[np.ndarray, " nt"] | None = None
    reference_own_error: Float[np.ndarray, " nt"] | None = None
    reaction_error: float = float("nan")  # [N], largest at the instants compared
    reaction_size: float = float("nan")  # [N] of the exact one
    reference_route: str = ""
    reference_horizon: float = float("nan")
    observables: dict[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)
    reference_observables: dict[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)
    invariants: dict[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)


def measure(problem: Problem, trajectory: Trajectory) -> Measured:
    """All series of a trajectory."""
    t, s = np.asarray(trajectory.t, dtype=float), trajectory.states
    reference = reference_of(problem)
    with np.errstate(all="ignore"):  # a motion may have blown up: its infinities are the result
        whole, E, eq81 = _judged(problem, reference, t, s, np.arange(problem.system.nb))
        laws, found = whole.laws, mechanisms(problem.system)
        each = (whole,) if len(found) == 1 else tuple(_judged(problem, reference, t, s, b)[0] for b in found)
        at_home = problem.home(s)
        return Measured(
            t, whole.size, each, E, laws[Law.ENERGY], laws[Law.CONSTRAINT], laws[Law.CONSTRAINT_RATE], eq81,
            laws[Law.ORTHOGONALITY],
            out_of_plane=_out_of_plane(problem, at_home),
            observables={o.name: np.asarray(o.of(at_home), dtype=float) for o in problem.observables},
            invariants={i.name: np.asarray(i.of(at_home), dtype=float) for i in problem.invariants},
            **_against_reference(problem, reference, t, s, trajectory.reaction, _shares(whole, each)),
        )  # fmt: skip


def _judged(
    problem: Problem, reference: Reference | None, t: np.ndarray, s: States, bodies: np.ndarray
) -> tuple[Judged, np.ndarray, np.ndarray]:
    """With T + V and the norm of Eq. (81)."""
    system, start = part(problem.system, bodies), state_of(problem.initial, bodies)
    blocks = [states_of(s.at(slice(k, k + BLOCK)), bodies) for k in range(0, len(t), BLOCK)]
    parts = [(*_laws(system, b), reached(system, start, b)) for b in blocks]
    E, phi, phi_dot, eq81, defect, d, rate, rows = (np.concatenate(p) for p in zip(*parts, strict=True))
    drift = E - E[0] - damping_work(system, t, d, rate)
    rows[:, KINETIC] -= np.maximum(drift, 0.0)  # what was gained was not there to be exchanged
    laws = {Law.ENERGY: drift, Law.CONSTRAINT: phi, Law.CONSTRAINT_RATE: phi_dot, Law.ORTHOGONALITY: defect}
    binding = {k: a for k, a in laws.items() if not (problem.literal_start and k in JOINTS)}
    return Judged(bodies, scales(problem, reference, Run(rows, binding, covered(reference, t)), bodies), laws), E, eq81


def _shares(whole: Judged, each: tuple[Judged, ...]) -> np.ndarray:
    """By body (nb,): how much more a metre is to its mechanism than to the one that reaches farthest."""
    out = np.ones(len(whole.bodies))
    if len(each) > 1:
        for one in each:
            out[one.bodies] = whole.size.length / one.size.length
    return out


def covered(reference: Reference | None, t: Float[np.ndarray, " nt"]) -> int:
    """Steps up to the horizon; one of 5 s covers a last step at 5.000000000001 s."""
    return 0 if reference is None else int(np.sum(t <= reference.horizon * (1.0 + 1e-12)))


def _laws(system: MultibodySystem, s: States) -> tuple[np.ndarray, ...]:
    return (
        energy(system, s),
        np.linalg.norm(constraint(system, s), axis=1),
        np.linalg.norm(constraint_rate(system, s), axis=1),
        constraint_energy_norm(system, s),
        np.max(so3.orthogonality_defect(s.R), axis=1, initial=0.0),
        *damper_lines(system, s),
    )


def _out_of_plane(problem: Problem, at_home: States) -> np.ndarray | None:
    if problem.planar_normal is None:
        return None
    normal = problem.planar_normal / np.linalg.norm(problem.planar_normal)
    away = at_home.r @ normal
    return np.max(np.abs(away - away[0]), axis=1)


def _against_reference(
    problem: Problem, reference: Reference | None, t: np.ndarray, s: States, reaction: np.ndarray | None,
    shares: np.ndarray,
) -> dict:  # fmt: skip
    if reference is None:
        return {}
    n = covered(reference, t)
    names = ("position_error", "orientation_error", "motion_error", "velocity_error", "angular_velocity_error",
             "reference_own_error")  # fmt: skip
    series = {k: np.full(len(t), np.nan) for k in names}
    theirs = {o.name: np.full(len(t), np.nan) for o in problem.observables}
    for k in range(0, n, BLOCK):
        rows = slice(k, min(k + BLOCK, n))
        exact = reference.states(np.minimum(t[rows], reference.horizon))
        series["position_error"][rows] = np.max(np.linalg.norm(s.r[rows] - exact.r, axis=2), axis=1)
        series["orientation_error"][rows] = np.max(so3.angle_between(s.R[rows], exact.R), axis=1)
        series["motion_error"][rows] = np.max(shares * displacement(problem.system, s.at(rows), exact), axis=1)
        series["velocity_error"][rows] = np.max(np.linalg.norm(s.v[rows] - exact.v, axis=2), axis=1)
        series["angular_velocity_error"][rows] = np.max(np.linalg.norm(s.Omega[rows] - exact.Omega, axis=2), axis=1)
        series["reference_own_error"][rows] = reference.error(t[rows])
        for name, values in problem.observe(exact).items():
            theirs[name][rows] = values
    about = {"reference_route": reference.route, "reference_horizon": float(reference.horizon)}
    return {**series, **_reaction_error(problem, reference, t, reaction), **about, "reference_observables": theirs}


def _reaction_error(problem: Problem, reference: Reference, t: np.ndarray, reaction: np.ndarray | None) -> dict:
    """Of the sum of joint forces on a body, at some instants; nothing where the solver or the reference has none."""
    system = problem.system
    if reaction is None or len(system.spring_k) or system.nj == 0:
        return {}
    rows = instants_to_compare(t, reference.horizon)
    found = pull_on_bodies(system, np.asarray(reaction, dtype=float)[rows])
    known = np.all(np.isfinite(found), axis=(1, 2))
    if not np.any(known):
        return {}
    exact = exact_pull_on_bodies(system, reference.states, t[rows[known]])
    return {
        "reaction_error": float(np.max(np.linalg.norm(found[known] - exact, axis=2))),
        "reaction_size": float(np.max(np.linalg.norm(exact, axis=2))),
    }
