"""Compute the work of dampers, loads, user forces and drives over recorded steps, and its error.

The motion between two recorded steps is not recorded. It is reconstructed in two ways, and in each step the more
certain one counts::

    cubic   through poses and velocities at both ends; its error is by how much two steps taken as one differ from them
    flow    from the recorded state on, by index 1 and the symmetric midpoint rule in n parts (Gragg), extrapolated in
            1/n^2; its error is what the last doubling of n changed

The second is as exact as the recorded states, whatever the order of the method and the length of its steps. Where
neither has a finite error, the work of the step is unknown: it is set to the change of the energy, so that the energy
is judged anew from the step's end.
"""

import math

import numpy as np
from jaxtyping import Bool, Float

from . import so3
from .index1 import solve_index_1
from .motion import evaluate_load, evaluate_spring_line, list_user_loads, point_velocity
from .moving_rows import evaluate_moving_rows
from .projection import project_poses
from .state import States
from .system import MultibodySystem
from .torsion import evaluate_torsion

# Gauss nodes on (0, 1): exact for the power of a damper along a cubic
NODES = 0.5 + 0.5 * np.array([-1.0, 0.0, 1.0]) * math.sqrt(0.6)
WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
RESOLVED = 1.0  # [rad] turn of a drive, a load or a body over a step, beyond which three nodes cannot bound their error
SURE = 0.1  # share of the drift: work known better than that does not blur it
DOUBLINGS = 10  # doublings of the parts of a step
BLOCK = 10_000  # steps at a time
STATES = 60_000  # evaluations of index 1 at most, the uncertain steps first


def compute_work(
    system: MultibodySystem, t: Float[np.ndarray, " nt"], s: States, energy: Float[np.ndarray, " nt"]
) -> tuple[Float[np.ndarray, " nt"], Float[np.ndarray, " nt"], Bool[np.ndarray, " steps"]]:
    """Return the work since the start [J] at each time, its error [J], and flags of the steps of unknown work.

    Steps are refined until the error is small beside the drift of ``energy`` (T + V [J]), or the limits ``DOUBLINGS``
    and ``STATES`` are reached. Over a step of unknown work, the work is set to the change of the energy.
    """
    if system.is_conservative or len(t) < 2:
        return np.zeros(len(t)), np.zeros(len(t)), np.zeros(max(len(t) - 1, 0), dtype=bool)
    h = np.diff(t)
    fraction = h / np.sum(h)  # of the time, by which the allowed error is divided among steps
    angle = _find_fastest_rates(system, s) * h
    gained, error = _integrate_cubics(system, s, h, angle)
    within = angle <= RESOLVED * 2 ** (DOUBLINGS - 2)
    columns, doubled, spent = np.full((len(h), DOUBLINGS), np.nan), np.zeros(len(h), dtype=np.int64), 0
    while True:
        allowed = _find_allowed_error(energy, gained)
        if np.sum(error) <= allowed:
            break
        uncertain = np.flatnonzero(~(error <= allowed * fraction) & (doubled < DOUBLINGS) & within)
        uncertain = uncertain[np.argsort(-error[uncertain], kind="stable")]
        parts = 2 ** (doubled[uncertain] + 1)
        uncertain = uncertain[: np.searchsorted(np.cumsum(parts + 1), STATES - spent, side="right")]
        if not len(uncertain):
            break
        for k in np.unique(doubled[uncertain]):
            steps = uncertain[doubled[uncertain] == k]
            spent += len(steps) * (2 ** (k + 1) + 1)
            gain = _integrate_flow(system, s.at(steps), h[steps], 2 ** int(k + 1))
            found, change = _extrapolate(columns, steps, int(k), gain)
            change[angle[steps] > RESOLVED * 2**k] = np.inf  # a whole period in a part is aliased to a constant
            surer = change < error[steps]
            gained[steps[surer]], error[steps[surer]] = found[surer], change[surer]
            doubled[steps] += 1
    unknown = ~np.isfinite(error)
    gained, error = np.where(unknown, np.diff(energy), gained), np.where(unknown, 0.0, error)
    total, unsure = (np.concatenate(([0.0], np.cumsum(a))) for a in (gained, error))
    return total, unsure, unknown


def _find_allowed_error(energy: np.ndarray, gained: np.ndarray) -> float:
    """Return the error [J] that the work may have: ``SURE`` times the drift, or the energy's rounding if larger.

    ``energy`` [J] is T + V at each time, ``gained`` [J] the work in each step.
    """
    drift = energy - energy[0] - np.concatenate(([0.0], np.cumsum(gained)))
    known = np.isfinite(drift)
    rounding = np.finfo(float).eps * math.sqrt(len(energy)) * np.max(np.abs(energy[known]), initial=0.0)
    return float(max(SURE * np.max(np.abs(drift[known]), initial=0.0), rounding))


def _find_fastest_rates(system: MultibodySystem, s: States) -> np.ndarray:
    """Return the fastest angular rate [rad/s] in each step: of the bodies at its ends, of drives' and loads' sines."""
    sines = [a[a[:, 4] != 0.0, 5] for a in (system.joint_motion, system.load_factor)]
    spin = np.max(np.linalg.norm(s.Omega, axis=2), axis=1, initial=0.0)
    return np.fmax(np.fmax(spin[:-1], spin[1:]), np.max(np.abs(np.concatenate(sines)), initial=0.0))


def _integrate_cubics(
    system: MultibodySystem, s: States, h: np.ndarray, angle: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the work of each step along its cubic [J], and its error [J]: infinite where it cannot be estimated.

    Half the change from two steps to one of both lengths is taken as the error of each. ``h`` [s] are the steps,
    ``angle`` [rad] the largest turn of bodies, drives and loads over each, beyond ``RESOLVED`` without an estimate.
    """
    gained, error = integrate_power_along_cubics(system, s, h), np.full(len(h), np.inf)
    n = len(h) - len(h) % 2
    # pairs from the first step on; for an odd number also pairs that end with the last
    for first in {0, len(h) % 2} if n else ():
        pairs = s.at(slice(first, first + n + 1, 2))
        twice = h[first : first + n : 2] + h[first + 1 : first + n : 2]
        apart = np.abs(
            integrate_power_along_cubics(system, pairs, twice)
            - gained[first : first + n : 2]
            - gained[first + 1 : first + n : 2]
        )
        error[first : first + n] = np.fmin(error[first : first + n], np.repeat(0.5 * apart, 2))
    unresolved = (angle > RESOLVED) | ~np.isfinite(error)
    return gained, np.where(unresolved, np.inf, error)


def integrate_power_along_cubics(system: MultibodySystem, s: States, h: np.ndarray) -> np.ndarray:
    """Return the work (steps,) [J] along the cubic of each step of ``h`` [s], by three Gauss nodes."""
    out = np.zeros(len(h))
    for k in range(0, len(h), BLOCK):
        steps, ends = slice(k, k + BLOCK), s.at(slice(k, k + BLOCK + 1))
        out[steps] = sum(
            w * compute_power(system, interpolate_steps(ends, h[steps], x)) for x, w in zip(NODES, WEIGHTS, strict=True)
        )
    return out * h


def _integrate_flow(system: MultibodySystem, s: States, h: np.ndarray, parts: int) -> np.ndarray:
    """Return the work [J] over ``h`` [s] from each state, by Gragg's smoothed midpoint rule in ``parts`` (even)."""
    dt = h / parts
    before, (rates, W_rate) = s, _evaluate_rates(system, s)
    W_before, here, W = np.zeros(len(h)), _advance(s, s, rates, dt), dt * W_rate
    for k in range(1, parts + 1):
        rates, W_rate = _evaluate_rates(system, here)
        if k == parts:
            return np.asarray(0.5 * (W + W_before + dt * W_rate))
        before, here = here, _advance(before, here, rates, 2.0 * dt)
        W_before, W = W, W_before + 2.0 * dt * W_rate
    raise AssertionError("parts must be positive")


def _evaluate_rates(system: MultibodySystem, s: States) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations (nt, nb, 6) and ``compute_power`` [W] by the equations of index 1, at projected poses."""
    found = solve_index_1(system, project_poses(system, s))
    return found.a, compute_power(system, s, found.reaction)


def _advance(a: States, middle: States, rates: np.ndarray, dt: np.ndarray) -> States:
    """Return the states ``a`` advanced by ``dt`` [s] at velocities of ``middle`` and at accelerations ``rates``."""
    x = dt[:, None, None]
    with np.errstate(all="ignore"):  # a motion that explodes is not finite, and its error says so
        R = a.R @ so3.exp(np.nan_to_num(x * middle.Omega, posinf=0.0, neginf=0.0))
    return States(a.r + x * middle.v, R, a.v + x * rates[..., :3], a.Omega + x * rates[..., 3:], a.times + dt, a.angles)


def _extrapolate(columns: np.ndarray, steps: np.ndarray, k: int, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Extend Romberg's table of each of the ``steps`` by row ``k``, which begins with ``found``; return its last entry.

    The second result is the magnitude of the change from the last entry of the row before, infinite for the first row.
    ``columns`` hold the latest row of each step and are updated.
    """
    old, change = columns[steps], np.full(len(steps), np.inf)
    new = np.full_like(old, np.nan)
    new[:, 0] = found
    for m in range(1, k + 1):
        new[:, m] = new[:, m - 1] + (new[:, m - 1] - old[:, m - 1]) / (4.0**m - 1.0)
    if k:
        change = np.abs(new[:, k] - old[:, k - 1])
    columns[steps] = new
    return new[:, k], np.where(np.isfinite(change), change, np.inf)


def compute_power(
    system: MultibodySystem, s: States, reaction: Float[np.ndarray, "nt nrows"] | None = None
) -> Float[np.ndarray, " nt"]:
    """Return the power of dampers, loads, user forces and drives [W], which changes T + V, at each time.

    ``reaction``, of index 1, is computed for drives if it is not given.
    """
    out = np.zeros(len(s.r))
    if np.any(system.joint_motion):
        out += compute_drive_power(system, s, reaction)
    for k in np.flatnonzero(system.spring_c):
        d, d_dot = evaluate_spring_line(system, s, int(k))
        out -= system.spring_c[k] * np.sum(d * d_dot, axis=-1) ** 2 / np.sum(d * d, axis=-1)
    if np.any(system.torsion_c):
        out -= evaluate_torsion(system, s)[1] ** 2 @ system.torsion_c
    for load, body in enumerate(system.load_i):
        force, torque = evaluate_load(system, s, load)
        omega = np.einsum("tij,tj->ti", s.R[:, body], s.Omega[:, body])
        v = point_velocity(s, body, system.load_p[load])
        out += np.sum(force * v, axis=-1) + np.sum(torque * omega, axis=-1)
    for body, force, torque in list_user_loads(system, s):
        omega = np.einsum("tij,tj->ti", s.R[:, body], s.Omega[:, body])
        out += np.sum(force * s.v[:, body], axis=-1) + np.sum(torque * omega, axis=-1)
    return out


def compute_drive_power(
    system: MultibodySystem, s: States, reaction: Float[np.ndarray, "nt nrows"] | None = None
) -> Float[np.ndarray, " nt"]:
    """Return the power of drives [W], -reaction . phi_t; NaN where the motion is not finite.

    ``reaction``, of index 1, is computed at projected poses if it is not given.
    """
    moving = evaluate_moving_rows(system, s)
    found = solve_index_1(system, project_poses(system, s)).reaction if reaction is None else reaction
    return -np.sum(found[:, moving.row] * moving.phi_t, axis=-1)


def interpolate_steps(s: States, h: Float[np.ndarray, " steps"], x: float) -> States:
    """Return the states at a fraction ``x`` of each step of ``h`` [s], by cubics in r and theta; R = R_0 exp(theta)."""
    dt = h[:, None, None]
    r, v = _evaluate_cubic(s.r[:-1], s.r[1:], s.v[:-1], s.v[1:], dt, x)
    turn = so3.log(np.swapaxes(s.R[:-1], -1, -2) @ s.R[1:])
    theta, rate = _evaluate_cubic(np.zeros_like(turn), turn, s.Omega[:-1], so3.dexpinv(turn, s.Omega[1:]), dt, x)
    angles = None if s.angles is None else (1.0 - x) * s.angles[:-1] + x * s.angles[1:]
    return States(r, s.R[:-1] @ so3.exp(theta), v, so3.angular_velocity(theta, rate), s.times[:-1] + x * h, angles)


def _evaluate_cubic(
    a: np.ndarray, b: np.ndarray, a_dot: np.ndarray, b_dot: np.ndarray, h: np.ndarray, x: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return value and rate, at a fraction ``x`` of ``h`` [s], of the cubic from a to b with rates a_dot and b_dot."""
    bend = (b - a) / h - 0.5 * (a_dot + b_dot)  # the rate is a_dot (1 - x) + b_dot x + 6 bend x (1 - x)
    way = a_dot * (x - 0.5 * x * x) + b_dot * 0.5 * x * x + bend * x * x * (3.0 - 2.0 * x)
    return a + h * way, a_dot * (1.0 - x) + b_dot * x + 6.0 * bend * x * (1.0 - x)
