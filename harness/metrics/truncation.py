"""A run's own rates against those of its poses and of the equations of motion: r' = v, v' = a, A^T lam.

At a recorded step the difference quotients to both sides straddle the rate there, and differ by a step's change of it:
that much may a method of first order be off, and no method that converges stays farther off over a run. What changes
is the rate of a body's matter in space, also where a steady spin has constant components in the body. Accelerations
and loads of the joints are those of index 1 at the recorded poses and velocities. So a false gravity, scaled velocities
and false reactions show however small they are, as soon as steps are fine enough to tell; where they are not, nothing
is judged.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..mechanics import so3
from ..mechanics.index1 import index_1
from ..mechanics.state import States
from ..mechanics.system import MultibodySystem
from ..types import ACCURATE
from .reactions import load_on_bodies

SAMPLES = 200  # recorded steps at most that are looked at
LEAST, PRODUCTS = 4, 2e8  # and at least; nrows^2 6 nb at all of them: large systems are looked at less often
RESOLVED = 0.5  # [rad] that a body turns over a step: beyond it difference quotients say nothing
TOLD = ACCURATE["accurate_until_1pct_s"]  # of a speed, an acceleration, a load: an error that counts
ROUNDINGS = 64.0  # in a difference of poses


@dataclass(frozen=True)
class Truncation:
    """How far rates are off, of what steps leave open (sums over the run, worst body); NaN where nothing is known."""

    velocities: float = float("nan")  # against poses, or of what errors of poses explain if that is more
    accelerations: float = float("nan")
    reactions: float = float("nan")


def truncation(
    system: MultibodySystem,
    t: Float[np.ndarray, " nt"],
    s: States,
    reaction: Float[np.ndarray, "nt nrows"] | None,
    speed: float,
) -> Truncation:
    """Truncation of velocities, accelerations and reactions of a run; ``speed`` [m/s] is the largest of the motion."""
    k = _steps(system, t, s)
    if len(k) < 3 or not speed > 0.0:
        return Truncation()
    before, here, after = (s.at(k + d) for d in (-1, 0, 1))
    h1, h2 = ((t[k + d] - t[k + d - 1])[:, None, None] for d in (0, 1))
    found = index_1(system, here)
    rounding = np.finfo(float).eps * ROUNDINGS / np.minimum(h1, h2)
    size = np.max(np.abs(s.r), initial=0.0) + np.max(system.gyration)
    backward, forward = _rates(before, here, h1), _rates(here, after, h2)
    v = np.concatenate((here.v, here.Omega), axis=-1)
    slower, faster = ((_velocities(b) - _velocities(a)) / h for a, b, h in ((before, here, h1), (here, after, h2)))
    fastest = float(np.max(_size(system, v), initial=0.0))
    spins = [np.zeros_like(v[..., 3:])] * 2, [backward[..., 3:], forward[..., 3:]]
    turns = so3.exp(-0.5 * h1 * backward[..., 3:]), so3.exp(0.5 * h2 * forward[..., 3:])
    out = []
    still = np.broadcast_to(np.eye(3), (*v.shape[:2], 3, 3))
    there = _matter(system, _of_matter(found.a, here.Omega, still))
    slow = speed / float(t[-1] - t[0])  # [m/s2] what changes the speed by as much as itself over the run
    there = np.maximum(np.max(there, axis=1, keepdims=True), slow)  # a body at rest has no size of its own
    for both, told, spin, counts, rounded in (
        ((backward, forward), v, spins[0], speed, size), ((slower, faster), found.a, spins[1], there, fastest)
    ):  # fmt: skip
        middle = (h2 * both[0] + h1 * both[1]) / (h1 + h2)
        first, last = (_of_matter(*x) for x in zip(both, spin, turns, strict=True))
        left = _matter(system, last - first) + TOLD * counts + rounded * rounding[..., 0]
        out.append(_ratio(_size(system, middle - told), left))
    out.append(float("nan"))
    if reaction is not None and system.nj:
        loads = [load_on_bodies(system, reaction[k + d], s.at(k + d)) for d in (-1, 0, 1)]
        apart = _weight(system, loads[1] - found.load)
        steps = _weight(system, loads[1] - loads[0]) + _weight(system, loads[2] - loads[1])
        pull = np.max(_weight(system, found.load), axis=1, keepdims=True)
        floor = TOLD * np.maximum(pull, system.mass * slow)
        out[2] = _ratio(apart, steps + floor)
    return Truncation(*out)


def unexplained_velocity(
    t: Float[np.ndarray, " nt"], s: States, away: Float[np.ndarray, " nt"], rate: Float[np.ndarray, " nt"], speed: float
) -> float:
    """The error of velocities [m/s] over that which the error ``away`` [m] of poses explains, both against a reference.

    What poses are off may change its sign within a step, or within a radian of the fastest turn: velocities that are
    off by more than both together are not those of the poses. NaN where velocities are right to ``TOLD`` of the speed.
    """
    most = float(np.max(rate, initial=0.0))
    if len(t) < 2 or not most > TOLD * speed:
        return float("nan")
    turn = float(np.max(np.linalg.norm(s.Omega, axis=2), initial=0.0))
    return most / (2.0 * float(np.max(away)) * (1.0 / float(np.median(np.diff(t))) + turn) or np.finfo(float).tiny)


def _steps(system: MultibodySystem, t: np.ndarray, s: States) -> Int[np.ndarray, " n"]:
    """Evenly picked inner rows at which the steps to both sides resolve the turning."""
    turn = np.max(np.linalg.norm(s.Omega, axis=2), axis=1, initial=0.0)
    h = np.diff(t)
    inner = 1 + np.flatnonzero(turn[1:-1] * np.maximum(h[:-1], h[1:]) < RESOLVED)
    most = int(np.clip(PRODUCTS / (6 * system.nb * max(system.nrows, 1) ** 2), LEAST, SAMPLES))
    return inner[np.unique(np.linspace(0, len(inner) - 1, min(most, len(inner))).round().astype(np.int64))]


def _rates(a: States, b: States, h: np.ndarray) -> np.ndarray:
    """(v, Omega) that takes ``a`` to ``b``."""
    return np.concatenate(((b.r - a.r) / h, so3.log(np.swapaxes(a.R, -1, -2) @ b.R) / h), axis=-1)


def _velocities(s: States) -> np.ndarray:
    return np.concatenate((s.v, s.Omega), axis=-1)


def _of_matter(rate: np.ndarray, spin: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(nt, nb, 3, 4): that of C, and what the place in a body [body] is multiplied by, seen ``turn`` later.

    Of velocities with ``spin`` zero, of accelerations with the angular velocity.
    """
    W = so3.hat(spin)
    return np.concatenate((rate[..., :3, None], turn @ (so3.hat(rate[..., 3:]) + W @ W)), axis=-1)


def _matter(system: MultibodySystem, rate: np.ndarray) -> np.ndarray:
    """Root mean square over a body's matter."""
    trace = np.trace(system.inertia, axis1=1, axis2=2)[:, None, None]
    second = (0.5 * trace * np.eye(3) - system.inertia) / system.mass[:, None, None]
    G = rate[..., 1:]
    return np.sqrt(np.maximum(np.sum(rate[..., 0] ** 2, axis=-1) + np.einsum("tbij,bjk,tbik->tb", G, second, G), 0.0))


def _ratio(off: np.ndarray, open_: np.ndarray) -> float:
    known = np.all(np.isfinite(off) & np.isfinite(open_), axis=1)
    if not np.any(known):
        return float("nan")
    total, least = np.sum(off[known], axis=0), np.sum(open_[known], axis=0)
    return float(np.max(np.divide(total, least, out=np.zeros_like(total), where=total > 0.0)))


def _size(system: MultibodySystem, a: np.ndarray) -> np.ndarray:
    """Root mean square over a body's matter of rates (v, Omega)."""
    turning = np.einsum("tbi,bij,tbj->tb", a[..., 3:], system.inertia, a[..., 3:]) / system.mass
    return np.sqrt(np.sum(a[..., :3] ** 2, axis=-1) + turning)


def _weight(system: MultibodySystem, load: np.ndarray) -> np.ndarray:
    """Norm of forces [N] and of moments [N m] over the longest arm of a body's joints, or its radius of gyration."""
    arm = np.append(system.gyration, 0.0)  # the last one is the ground
    for body, s in ((system.joint_i, system.joint_s_i), (system.joint_j, system.joint_s_j)):
        np.maximum.at(arm, body, np.linalg.norm(s, axis=1))
    moment = np.sum(load[..., 3:] ** 2, axis=-1) / arm[:-1] ** 2
    return np.sqrt(np.sum(load[..., :3] ** 2, axis=-1) + moment)
