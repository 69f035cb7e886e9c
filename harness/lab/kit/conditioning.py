"""Measure how a relative change of a problem's numbers grows along its exact motion, which bounds errors of rounding.

Masses, inertias, points, axes, springs, gravity, start and time change at random, each number by its own draw. Both
motions are integrated by the same rule, so that the errors of the integration cancel in their difference. Points and
axes of redundant joints are kept, because no consistent start exists once they change. Rounded poses open joints by the
size of the poses, which is added.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ...catalogue.offers import find_offer
from ...judge.metrics.scales import measure_displacement, measure_speeds
from ...mechanics.consistency import perturb
from ...mechanics.dynamics import advance
from ...mechanics.jacobian import independent_rows
from ...mechanics.motion import constraint_rate, energy, measure_gaps
from ...mechanics.state import State, States
from ...mechanics.system import MultibodySystem
from ...mechanics.types import Law, Problem

DRAWS = 6  # a standard deviation from six draws is known to 29 % (three: 41 %, twelve: 20 %), and each costs a run
SIZE = 1e-6  # relative change, for which differences have four correct digits
STEPS = 500  # of the explicit midpoint rule
LENGTHS = ("joint_s_i", "joint_s_j", "spring_p_i", "spring_p_j")
DIRECTIONS = ("joint_u", "joint_w", "joint_n", "torsion_u", "torsion_n")
NUMBERS = (
    "mass",
    "gravity",
    "joint_length",
    "spring_k",
    "spring_d0",
    "spring_c",
    "torsion_k",
    "torsion_c",
    "load_force",
    "load_torque",
    "load_factor",
)
Key = tuple[Law, str]  # of an invariant with its name


def measure_growth(problem: Problem) -> tuple[Float[np.ndarray, " nt"], dict[Key, Float[np.ndarray, " nt"]]]:
    """Return times [s], and for each law how its quantity changes per unit of relative change of all numbers.

    The change is the root mean square over ``DRAWS`` draws, and the largest up to each time. To distances and speeds
    the rounding of the poses is added.
    """
    t, base = _integrate(problem.system, problem.initial, problem.t_end)
    redundant = len(independent_rows(problem.system, problem.initial)) < problem.system.nrows
    zero = evaluate_laws(problem, base, base)
    squares = {key: np.zeros(len(t)) for key in zero}
    for seed in range(DRAWS):
        random = np.random.default_rng(seed)
        system = _perturb_numbers(problem.system, random, redundant=redundant)
        _, other = _integrate(system, perturb(system, problem.initial, SIZE, seed), problem.t_end)
        late = SIZE * random.standard_normal() * t  # an error of the time
        shifted = States(other.r + late[:, None, None] * base.v, other.R, other.v, other.Omega, t)
        for key, series in evaluate_laws(problem, shifted, base).items():
            squares[key] += (series - zero[key]) ** 2
    growth = {key: np.maximum.accumulate(np.sqrt(a / DRAWS)) / SIZE for key, a in squares.items()}
    arm = np.max(np.abs(problem.system.joint_s_i), initial=0.0)
    place, speed = np.max(np.abs(base.r)) + arm, np.max(np.abs(base.v)) + arm * np.max(np.abs(base.Omega))
    for (law, name), size in {
        (Law.MOTION, ""): place,
        (Law.CONSTRAINT, ""): place,
        (Law.VELOCITY, ""): speed,
        (Law.CONSTRAINT_RATE, ""): speed,
    }.items():
        if (law, name) in growth:
            growth[law, name] = growth[law, name] + size
    return t, growth


def evaluate_laws(problem: Problem, s: States, exact: States) -> dict[Key, Float[np.ndarray, " nt"]]:
    """Return quantities along ``s`` that vanish in the exact motion: distances from it, gaps of joints, drifts.

    Drifts are those of the energy, in a conservative system, and of invariants. Keys are laws, with the names of
    invariants; gaps that are angles count as lengths at the largest radius of gyration [m].
    """
    system = problem.system
    metres = np.ones(system.nrows)
    metres[system.turning_rows] = np.max(system.gyration)
    away = States(exact.r, exact.R, s.v - exact.v, s.Omega - exact.Omega, s.t)
    out: dict[Key, np.ndarray] = {
        (Law.MOTION, ""): np.max(measure_displacement(system, s, exact), axis=1),
        (Law.VELOCITY, ""): np.max(measure_speeds(system, away), axis=1),
    }
    if system.nrows:
        out[Law.CONSTRAINT, ""] = np.linalg.norm(measure_gaps(system, s) * metres, axis=1)
        out[Law.CONSTRAINT_RATE, ""] = np.linalg.norm(constraint_rate(system, s) * metres, axis=1)
    at_home, exact_home = problem.home(s), problem.home(exact.at(slice(1)))
    if system.is_conservative:
        out[Law.ENERGY, ""] = energy(system, s) - energy(system, exact.at(slice(1)))
    for kept in problem.invariants:
        if kept.unit != "J":
            out[Law.INVARIANT, kept.name] = np.asarray(kept.of(at_home)) - np.asarray(kept.of(exact_home))
    return out


def _perturb_numbers(system: MultibodySystem, random: np.random.Generator, *, redundant: bool) -> MultibodySystem:
    """Return the system with each number changed by its own ``random`` draw of relative size ``SIZE``.

    Points and axes stay if rows are ``redundant``: changed ones have no consistent start.
    """

    def scale(a: np.ndarray) -> np.ndarray:
        """Return numbers, each changed relative to itself."""
        return a * (1.0 + SIZE * random.standard_normal(a.shape))

    def tilt(a: np.ndarray) -> np.ndarray:
        """Return points or directions, with each component changed relative to the largest one."""
        size = np.max(np.abs(a), axis=-1, keepdims=True)
        return a + SIZE * size * random.standard_normal(a.shape)

    noise = random.standard_normal(system.inertia.shape)
    size = np.max(np.abs(system.inertia), axis=(1, 2), keepdims=True)
    changes = {"inertia": system.inertia + 0.5 * SIZE * size * (noise + np.swapaxes(noise, 1, 2))}
    if not redundant:
        changes |= {n: tilt(getattr(system, n)) for n in (*LENGTHS, *DIRECTIONS)}
    changes |= {n: scale(getattr(system, n)) for n in NUMBERS}
    return dataclasses.replace(system, **changes)


def _integrate(system: MultibodySystem, start: State, t_end: float) -> tuple[np.ndarray, States]:
    """Return times [s] and states by ``STEPS`` equal steps of the explicit midpoint rule."""
    accelerations = find_offer("accelerations")
    h, s, out = t_end / STEPS, start, [start]
    for _ in range(STEPS):
        half = advance(s, accelerations(system, s), 0.5 * h)
        s = advance(s, accelerations(system, half), h)
        out.append(s)
    t = h * np.arange(STEPS + 1)
    r, R, v, Omega = (np.array([getattr(x, k) for x in out]) for k in ("r", "R", "v", "Omega"))
    return t, States(r, R, v, Omega, t)
