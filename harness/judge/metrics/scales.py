"""Compute the scales that errors and drifts are compared with: sizes that the motion reaches, energy that it exchanges.

They are those of the exact motion up to its horizon; beyond it, or without one, those of the run. A run counts up to
where it breaks a law by these very scales, and energy that it gained does not count: a run that blows up cannot inflate
what it is compared with. Bodies that do not move, however heavy or large, contribute nothing; nor does the motion of
the centre of mass where nothing is joined to the ground. Separate mechanisms have their own scales.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np
from jaxtyping import Float, Int

from ...columns.measured import Scales
from ...mechanics.motion import kinetic_energy, potential_energy
from ...mechanics.state import State, States
from ...mechanics.system import GROUND, MultibodySystem
from ...mechanics.types import Law, Problem, Reference
from ...reference.held import recall_value
from .mechanisms import extract_state, extract_states, extract_subsystem, is_free, subtract_common_motion

STATES = 2**18  # most poses measured at a time, to bound the memory
MANY = 5000  # fewest poses for compiled loops: NumPy measures fewer in less than the half second of importing numba
# instants of the exact motion: over 100 periods the largest value is found to 1.2 % (half: 4.9 %, twice: 0.3 %)
SAMPLES = 2001
REST = 1e-6  # motions smaller than this share of ``estimate_rest_scales`` count as rest
KINETIC = 3  # column of T in ``Rows``
Rows = Float[np.ndarray, "nt 6"]  # at each time: displacement, speed, momentum, T, V - V(0), V(0) - V


@dataclass(frozen=True)
class RunSizes:
    """Sizes that a run reaches, residuals of its laws (nt,), and how many of its steps the exact motion covers."""

    rows: Rows
    laws: Mapping[Law, np.ndarray]  # residuals by which a run is cut off where it breaks a law
    covered: int


def split_into_blocks(nt: int, nb: int) -> Iterator[slice]:
    """Yield slices of ``nt`` times of ``nb`` bodies with at most ``STATES`` poses each, to bound the memory.

    A slice has at least one time.
    """
    size = max(1, STATES // max(nb, 1))
    return (slice(k, min(k + size, nt)) for k in range(0, nt, size))


def load_compiled(poses: int) -> ModuleType | None:
    """Return the module of compiled functions, loaded, for a motion with this number of ``poses``: times x bodies.

    None if NumPy measures them in less time than loading the module takes.
    """
    if poses < MANY:
        return None
    from . import passes

    passes.load()
    return passes


def measure_displacement(system: MultibodySystem, a: States, b: States) -> Float[np.ndarray, "nt nb"]:
    """Return the distance [m] between two poses of each body: root mean square over its matter of |x_a - x_b|.

    It is the root of ``|r_a - r_b|^2 + tr(D S D^T) / m`` with ``D = R_a - R_b`` and ``S = tr(J)/2 1 - J``. This is one
    number in metres for position and orientation: a rotation counts by how far it moves the body's matter, so that a
    roll of a thin bar about its axis counts almost nothing. ``b`` may be one instant.
    """
    if (fast := load_compiled(len(a) * system.nb)) is not None and len(b) in (1, len(a)):
        return fast.measure_displacement(system.mass, _second_moments(system), a, b)
    D = a.R - b.R
    turn = np.sum((D @ _second_moments(system)) * D, axis=(2, 3)) / system.mass
    return np.sqrt(np.sum((a.r - b.r) ** 2, axis=2) + np.maximum(turn, 0.0))


def measure_speeds(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt nb"]:
    """Return sqrt(2 T / m) of each body [m/s]: root mean square of the speed of its matter."""
    if (fast := load_compiled(len(s) * system.nb)) is not None:
        return fast.measure_speeds(system.mass, system.inertia, s)
    turning = np.einsum("tbi,bij,tbj->tb", s.Omega, system.inertia, s.Omega) / system.mass
    return np.sqrt(np.sum(s.v**2, axis=2) + turning)


def measure_sizes(system: MultibodySystem, start: State, s: States) -> Rows:
    """Return the sizes of a motion from ``start`` at each time: the six numbers of ``Rows``.

    Where nothing is joined to the ground, they are relative to the common centre of mass; speed, momentum and energies
    are then at least ``REST`` times those relative to space, since rounding of the latter hides smaller ones.
    """
    one = States.one(start)
    rows = _measure_sizes(system, one, s)
    if not is_free(system):
        return rows
    own = _measure_sizes(system, subtract_common_motion(system, one), subtract_common_motion(system, s))
    own[:, 1:] = np.maximum(own[:, 1:], REST * rows[:, 1:])
    return own


def _measure_sizes(system: MultibodySystem, start: States, s: States) -> Rows:
    """Return the six numbers of ``Rows`` at each time, relative to space."""
    speed = measure_speeds(system, s)
    risen = potential_energy(system, s) - potential_energy(system, start)
    moved = np.max(measure_displacement(system, s, start), axis=1)
    return np.stack(
        (moved, np.max(speed, axis=1), speed @ system.mass, kinetic_energy(system, s), risen, -risen), axis=1
    )


def find_scales(
    problem: Problem, exact: Reference | None, run: RunSizes | None = None, bodies: Int[np.ndarray, " n"] | None = None
) -> Scales:
    """Return the scales of a problem: the largest sizes of the exact motion and, beyond its horizon, of a run.

    They are those of ``bodies`` (indices) alone if given. The run counts up to its first step that breaks a law by
    these scales, which are therefore computed again until no step does. With neither motion, or one that hardly moves,
    they are those of ``estimate_rest_scales``.
    """
    bodies = np.arange(problem.system.nb) if bodies is None else bodies
    system, start = extract_subsystem(problem.system, bodies), extract_state(problem.initial, bodies)
    at_rest = estimate_rest_scales(system, start)
    exact_rows, t = measure_sizes(system, start, States.one(start)), np.zeros(1)
    if exact is not None:
        t = np.append(0.0, np.linspace(0.0, min(problem.t_end, exact.horizon), SAMPLES))
        key = "exact reach", bodies.tobytes()
        sampled = recall_value(problem, key, lambda: _sample_sizes(problem, exact, t[1:], (system, start), bodies))
        exact_rows = np.concatenate((exact_rows, sampled))
    run = run or RunSizes(exact_rows[:0], {}, 0)
    finite = np.isfinite(run.rows).all(axis=1)
    end = len(finite) if np.all(finite) else int(np.argmin(finite))
    if not np.max(np.concatenate((exact_rows[:, 0], run.rows[run.covered : end, 0]))) > REST * at_rest.length:
        return at_rest
    while True:  # the rows that count, up to ``end``, become fewer each time
        rows = np.concatenate((exact_rows, run.rows[run.covered : end]))
        peaks = np.argmax(rows, axis=0)
        reach, speed, momentum, kinetic, risen, fallen = np.take_along_axis(rows, peaks[None], axis=0)[0]
        energy = max(kinetic, risen + fallen)  # what is exchanged: the most of T, or the range of V
        length = reach if exact is None else np.max(exact_rows[:, 0])  # the same for the errors of all runs
        least = REST**2 * np.array([at_rest.length, at_rest.speed, at_rest.momentum, at_rest.energy, at_rest.length])
        found = np.maximum((length, speed, momentum, energy, reach), least)  # never zero, as it divides
        peaks = np.unique(np.append(peaks, np.argmax(exact_rows[:, 0])))
        size = replace(
            Scales(*(float(v) for v in (*found, min(found[-1], bound_reach(system))))),
            exact_at=tuple(t[peaks[peaks < len(t)]].tolist()),
            run_at=tuple((peaks[peaks >= len(t)] - len(t) + run.covered).tolist()),
        )
        broken = np.zeros(end, dtype=bool)
        for law, series in run.laws.items():
            broken |= ~(np.abs(series[:end]) <= size.limits[law])
        if not np.any(broken):
            return size
        end = int(np.argmax(broken))


def _sample_sizes(
    problem: Problem,
    exact: Reference,
    t: Float[np.ndarray, " nt"],
    part: tuple[MultibodySystem, State],
    bodies: Int[np.ndarray, " n"],
) -> Rows:
    """Return the sizes of the exact motion of ``bodies`` (indices) at the times ``t`` [s].

    ``part`` is the system of these bodies alone, with its state at the start.
    """
    some = (exact.states(t[k]) for k in split_into_blocks(len(t), problem.system.nb))
    return np.concatenate([measure_sizes(*part, extract_states(s, bodies)) for s in some])


def estimate_rest_scales(system: MultibodySystem, start: State) -> Scales:
    """Return scales for a system at rest, from the dimensions of its bodies and their masses and forces.

    The length L is the largest of the radii of gyration, the distances of bodies and the arms of joints. The energy is
    T(0) + m g L plus that of the springs at the start, and the speed is the one of this energy.
    """
    gyration = float(np.max(system.gyration))
    spread = float(np.linalg.norm(np.ptp(start.r, axis=0)))
    # on the ground: a place, no arm
    arms = np.concatenate((system.joint_s_i, system.joint_s_j[system.joint_j != GROUND]))
    arm = float(np.max(np.linalg.norm(arms, axis=1), initial=0.0))
    length = max(gyration, spread, arm)
    mass = float(np.sum(system.mass))
    one = States.one(start)
    gravity = float(np.linalg.norm(system.gravity))
    springs = float(potential_energy(system, one)[0] + np.einsum("b,i,bi->", system.mass, system.gravity, start.r))
    energy = float(measure_sizes(system, start, one)[0, KINETIC]) + mass * gravity * length + springs
    energy = max(energy, mass * (1e-6 * length) ** 2)  # [J] without forces: a micrometre a second, relative to the size
    speed = math.sqrt(2.0 * energy / mass)
    return Scales(length, speed, mass * speed, energy, length, length)


def bound_reach(system: MultibodySystem) -> float:
    """Return a bound [m] on how far bodies on point joints can move: twice the sum of all arms and one gyration radius.

    The radius of gyration is the largest of all bodies. Infinite if some joint does not hold a point.
    """
    if not np.all(system.joint_points):
        return math.inf  # a slide or a link bounds no reach by its arms
    arms = np.concatenate((system.joint_s_i[system.joint_i != GROUND], system.joint_s_j[system.joint_j != GROUND]))
    gyration = float(np.max(system.gyration))
    return 2.0 * (float(np.sum(np.linalg.norm(arms, axis=1))) + gyration)


def _second_moments(system: MultibodySystem) -> Float[np.ndarray, "nb 3 3"]:
    """Return the second moments of each body's mass about C [kg m2], body frame: the integral of x x^T dm."""
    half = 0.5 * np.einsum("bii->b", system.inertia)
    return half[:, None, None] * np.eye(3) - system.inertia
