"""Check how joints act about an axis n of a slender rod or point mass, J n = 0, at the start and near it.

    decoupled  no row of A and no load acts about n, e.g. a point mass on links, a rod between ball joints on its axis:
               its spin has no equation and stays 0
    locked     n . Omega = 0 for all velocities that A allows, e.g. across a planar mechanism
    coupled    neither

In the first two n . Omega = n . Omega_dot = 0: inertia added about n (``added_inertia``) changes no motion, energy or
reaction. In the third it would, and the system is refused.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from .added_inertia import find_principal_inertias
from .consistency import START_TOLERANCE, InconsistentStart, perturb
from .motion import applied_loads
from .naming import name_body
from .state import State, States
from .system import MultibodySystem
from .time_functions import ONE

TURNS = 1e-6  # share of a velocity in n . Omega, by added inertia: below it less than 1e-12 of the energy is added
ACTS = 1e-9  # share of a row of A, or of the loads: below it none acts about n
NOISE = 1e-9  # components of a direction that messages show as zero
MOST_BODIES = 300  # a null space of their 1,800 velocities takes seconds, five of them are computed
NEARBY = (0.1, 0.01)  # sizes for ``perturb``: the second where a mechanism cannot go as far as the first
PLACES = (0.0, 0.21, 0.55, 1.0)  # shares of the simulated time, on which loads and drives may depend


def check_axes(system: MultibodySystem, start: State, t_end: float) -> None:
    """Raise ValueError if an axis without inertia is coupled, or is decoupled and its body spins about it at the start.

    The start and random states near it are examined, loads and drives up to ``t_end`` [s].
    """
    _, axes, none = find_principal_inertias(system.inertia)
    if not np.any(none) or not _is_examinable(system, start):
        return
    found = [_AllowedVelocities(system, s, axes, none, t_end) for s in (start, *_perturb_start(system, start, t_end))]
    for b in map(int, np.flatnonzero(np.any(none, axis=1))):
        # directions about which an allowed velocity turns the body (the others are locked), in terms of its axes n
        turns = np.concatenate([s.find_spins(b) for s in found], axis=1)
        sides, size, _ = np.linalg.svd(np.transpose(np.linalg.qr(turns.T, mode="r")))
        free = sides[:, : int(np.sum(size > TURNS))] if len(found) > 1 else sides  # one pose cannot show a locked axis
        # of these, those about which joints or loads act (coupled) and all others (decoupled)
        acts = np.concatenate([s.acts[:, b, none[b]] for s in found]) @ free
        _, size, rows = np.linalg.svd(np.linalg.qr(acts, mode="r"))
        n = int(np.sum(size > ACTS))
        coupled, decoupled = free @ rows[:n].T, axes[b][:, none[b]] @ free @ rows[n:].T
        spin = decoupled @ decoupled.T @ start.Omega[b]
        if np.linalg.norm(spin) > START_TOLERANCE:
            raise ValueError(
                f"{_describe_axis(system, b, spin)}, and no joint acts there: its spin about it must start at 0 rad/s "
                f"(got {np.linalg.norm(spin):.3g})"
            )
        if n:
            raise ValueError(
                f"{_describe_axis(system, b, axes[b][:, none[b]] @ coupled[:, 0])}, where joints or loads turn it: "
                "give it some, e.g. 1e-4 of its others, or put the joints on the axis"
            )


def _is_examinable(system: MultibodySystem, start: State) -> bool:
    """Return whether the start can be examined: False for invalid numbers, which ``check_start`` refuses.

    Raise ValueError for a system that is too large.
    """
    if system.nb > MOST_BODIES:
        raise ValueError(
            f"{system.nb} bodies, some of them without inertia about an axis: at most {MOST_BODIES}, since null spaces "
            "of A are dense; give them inertia"
        )
    return start.nb == system.nb and all(np.all(np.isfinite(a)) for a in (start.r, start.R, start.v, start.Omega))


def _perturb_start(system: MultibodySystem, start: State, t_end: float) -> list[State]:
    """Return random states near the start that satisfy the constraints, at several times if joints are driven."""
    out, driven = [], bool(np.any(system.joint_motion))
    for seed, place in enumerate(PLACES, 1):
        for size in NEARBY:
            then = dataclasses.replace(start, t=start.t + driven * size / NEARBY[0] * place * t_end)
            if not (np.any(start.v) or np.any(start.Omega) or np.any(system.gravity)):  # dampers act only on what moves
                then = dataclasses.replace(then, Omega=np.full((system.nb, 3), 1.0 / t_end))
            try:
                out.append(perturb(system, then, size, seed))
                break
            except (InconsistentStart, np.linalg.LinAlgError):
                continue
    return out


class _AllowedVelocities:
    """Velocities that A allows at a state, for any rates of drives, in coordinates x in which M is the identity."""

    def __init__(self, system: MultibodySystem, s: State, axes: np.ndarray, none: np.ndarray, t_end: float) -> None:
        """Compute the velocities at ``s``, and ``acts`` (m, nb, 3): what acts about the principal ``axes`` of bodies.

        These are the rows of A, of length one, then torques of the loads relative to all loads on the body, at times up
        to ``t_end`` [s], and also with spin about the axes without inertia, which ``none`` flags.
        """
        from .jacobian import constraint_jacobian

        nb = system.nb
        self._none = none
        inertia = np.einsum("bji,bjk,bki->bi", axes, system.regular_inertia, axes)
        T = np.zeros((nb, 6, 6))  # (r_dot, Omega) = T x
        T[:, range(3), range(3)] = 1.0 / np.sqrt(system.mass)[:, None]
        T[:, 3:, 3:] = axes / np.sqrt(inertia)[:, None, :]
        A = constraint_jacobian(system, s).toarray().reshape(system.nrows, nb, 6)
        B = np.einsum("kbi,bij->kbj", A, T).reshape(len(A), 6 * nb)
        length = np.linalg.norm(B, axis=1)
        B /= np.where(length > 0.0, length, 1.0)[:, None]
        driven = np.repeat(np.any(system.joint_motion != 0.0, axis=1), system.joint_rows)
        self._x = _null_space(B[~driven]).reshape(nb, 6, -1)
        spun = dataclasses.replace(s, Omega=s.Omega + np.einsum("bij,bj->bi", axes, none * (1.0 / t_end)))
        steady = dataclasses.replace(system, load_factor=np.tile(ONE, (len(system.load_i), 1)))
        loads = np.concatenate(
            [
                applied_loads(system, States.one(x).with_times(np.array([s.t + c * t_end])))
                for x in (s, spun)
                for c in PLACES
            ]
            + [applied_loads(steady, States.one(s))]
        )
        if not np.all(np.isfinite(loads)):
            b = int(np.argmax(~np.all(np.isfinite(loads), axis=(0, 2))))
            raise ValueError(f"the loads on {name_body(system, b)} must be finite numbers about the start")
        own = np.max(np.linalg.norm(loads[:, :, :3], axis=2) * system.gyration, axis=0)
        own += np.max(np.abs(loads[:, :, 3:]), axis=(0, 2))
        torques = np.einsum("tbi,bij->tbj", loads[:, :, 3:], axes) / np.where(own > 0.0, own, 1.0)[:, None]
        self.acts = np.concatenate((B.reshape(len(B), nb, 6)[:, :, 3:], torques))

    def find_spins(self, b: int) -> Float[np.ndarray, "k d"]:
        """Return n . Omega for the axes n without inertia of body ``b`` (k), for each allowed velocity (d)."""
        out: np.ndarray = self._x[b, 3:][self._none[b]]
        return out


def _null_space(B: Float[np.ndarray, "nrows n"]) -> Float[np.ndarray, "n d"]:
    """Return an orthonormal basis (columns) of the x with B x = 0."""
    from .dynamics import RANK
    from .jacobian import factor_with_pivots

    if not len(B):
        return np.eye(B.shape[1])
    Q, size, _ = factor_with_pivots(B.T, "full")
    out: np.ndarray = Q[:, int(np.sum(size > RANK * size[0])) :]
    return out


def _describe_axis(system: MultibodySystem, b: int, n: np.ndarray) -> str:
    """Return the beginning of a message that body ``b`` has no inertia about the direction ``n`` of its frame."""
    n = n / n[np.argmax(np.abs(n))]
    n = np.where(np.abs(n) < NOISE, 0.0, n)
    return f"{name_body(system, b)} has no inertia about ({', '.join(f'{x:.3g}' for x in n + 0.0)}) of its frame"
