"""``accelerations``, ``equations`` and ``project`` of the public interface on compiled kernels, one set per thread.

Where results of the kernel are not finite, the harness's own functions in NumPy compute them, and report what is wrong.
"""

import threading
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ....harness.mechanics import consistency, dynamics, so3
from ....harness.mechanics.added_inertia import check_added_inertia
from ....harness.mechanics.counting import count_calls
from ....harness.mechanics.dynamics import Equations, Rates
from ....harness.mechanics.state import State
from ....harness.mechanics.step_time import check_time
from ....harness.mechanics.system import GROUND, MultibodySystem
from .kernel import Kernel, make_kernel, set_state

SHIFT = 1e-6  # share of S's diagonal: redundant rows' loads are then right to 1e-10, weak rows settle in a few passes
PASSES = 30  # passes of refinement at most
SETTLED = 1e-13  # relative change of the reaction that ends refinement
KEPT = 32  # kernels a thread
ITERATIONS = 20  # Gauss-Newton iterations, as in ``mechanics.consistency``


class _Entry(NamedTuple):
    """A kernel with the system that it belongs to, which must stay alive, and additional data of its callers."""

    system: MultibodySystem
    kernel: Kernel
    added: np.ndarray | None  # added inertia, if any
    dense: "_Dense | None"


class _Dense(NamedTuple):
    """The mass matrices, and the indices of the kernel's ``way`` and ``X`` in a dense A."""

    M: np.ndarray  # (nb, 6, 6)
    end: np.ndarray  # (m,)
    row: np.ndarray  # (m,) of the kernel
    sign: np.ndarray  # (m, 1) of the force
    place: np.ndarray  # (m, 6) in A.ravel()


class _Kept(threading.local):
    """The entries of each thread, at most ``KEPT``, by id of the system and purpose; the oldest is discarded first."""

    def __init__(self) -> None:
        self.entries: dict[tuple[int, str], _Entry] = {}


_kept = _Kept()


@count_calls(factorises=True)
def accelerations(system: MultibodySystem, s: State, phi_ddot: Float[np.ndarray, " nrows"] | float = 0.0) -> Rates:
    """Return rates (nb, 3) of v [m/s2, space] and Omega [rad/s2, body], and reactions (nrows,) of index 1 at a state.

    M a = f + A^T reaction with A a + A_dot v = ``phi_ddot``. Redundant rows share their load: of all reactions with
    this load the one returned has the least sum of squares, with rows scaled to length one in the metric of M^-1. Off
    the constraints, where redundant rows contradict each other, the other rows hold. Raises ValueError where a body is
    accelerated about an axis without inertia.
    """
    check_time(s)
    _, k, added, _ = _get_entry(system, "accelerations")
    set_state(k, s)
    k.rows.run()
    if np.any(phi_ddot):
        k.gamma[k.order] -= phi_ddot
    k.factorise.run()
    redundant = k.state["rank"] < system.nrows
    k.react.run()
    if redundant:
        _share_redundant_load(k)
    if not (np.isfinite(k.v_dot).all() and np.isfinite(k.lam).all()):
        return dynamics.accelerations(system, s, phi_ddot)
    if added is not None:
        check_added_inertia(added, system.gyration, k.force, k.v_dot[:, 3:])
    return Rates(s.v, s.Omega, k.v_dot[:, :3].copy(), k.v_dot[:, 3:].copy(), k.lam[k.order])


@count_calls(factorises=False)
def equations(system: MultibodySystem, s: State) -> Equations:
    """Return M (nb, 6, 6), A (nrows, 6 nb), A_dot_v (nrows) and f (nb, 6) at a state.

    M a = f + A^T reaction and A a = -A_dot_v, in velocities (r_dot [space], Omega [body]) of each body; ``A_dot_v``
    is exact, with the rate of phi_t of drives; ``f`` has forces [N, space] and torques about C less Omega x J Omega.
    """
    check_time(s)
    _, k, _, dense = _get_entry(system, "equations")
    assert dense is not None
    set_state(k, s)
    k.rows.run()
    k.applied_forces.run()
    A, f = np.zeros((system.nrows, 6 * system.nb)), k.force.copy()
    A.put(dense.place[:, :3], dense.sign * k.way[dense.row])
    A.put(dense.place[:, 3:], k.X[dense.end, dense.row])
    if not (np.isfinite(A).all() and np.isfinite(k.gamma).all() and np.isfinite(f).all()):
        return dynamics.equations(system, s)
    f[:, 3:] -= so3.cross(s.Omega, np.einsum("bij,bj->bi", system.inertia, s.Omega))
    return Equations(dense.M.copy(), A, k.gamma[k.order], f)


def project(system: MultibodySystem, state: State, iterations: int = ITERATIONS) -> State:
    """Return the nearest consistent state: Gauss-Newton on phi, then velocities, both by the least change.

    The change is measured with the masses, and with the mean of each body's principal inertias. ``iterations`` is the
    most that phi may take. Raises ``InconsistentStart`` where no pose is found.
    """
    k = _get_entry(system, "project").kernel
    set_state(k, state)
    v = k.v.copy()
    k.rows.run()

    def correct(k: Kernel, phi: np.ndarray) -> Kernel:
        """Move the poses of ``k`` towards phi = 0 once, and reset its velocities; return it."""
        k.factorise.run()
        k.project.run()
        k.v[:] = v
        return k

    consistency.close_gaps(k, lambda k: k.phi, correct, consistency.CLOSED, iterations)
    k.factorise.run()
    k.project_rates.run()
    if not all(np.isfinite(a).all() for a in (k.r, k.R, k.v)):
        return consistency.project(system, state, iterations)
    out = State(k.r.copy(), k.R.copy(), k.v[:, :3].copy(), k.v[:, 3:].copy(), state.t)
    consistency.check_start(system, out, what="the projected state", any_root=True)
    return out


NEEDED = {
    "accelerations": ("rows", "factorise", "react", "solve", "push", "slips"),
    "equations": ("rows", "applied_forces"),
    "project": ("rows", "factorise", "project", "project_rates"),
}


def _get_entry(system: MultibodySystem, what: str) -> _Entry:
    """Return the kernel of a system for the purpose ``what``, a key of ``NEEDED``; make and store it if it is new.

    The thread's oldest entry is discarded where it has ``KEPT``. Kernels for "project" have mean, spherical inertias.
    """
    key, kept = (id(system), what), _kept.entries
    if key not in kept:
        k = make_kernel(system, NEEDED[what])
        if what == "project":
            size = np.trace(system.regular_inertia, axis1=1, axis2=2) / 3.0
            k.J_inv[:] = np.eye(3) / size[:, None, None]
        if len(kept) >= KEPT:
            del kept[next(iter(kept))]
        added = system.added_inertia if np.any(system.added_inertia) else None
        kept[key] = _Entry(system, k, added, _prepare_dense(system, k) if what == "equations" else None)
    return kept[key]


def _prepare_dense(system: MultibodySystem, k: Kernel) -> _Dense:
    """Return M (nb, 6, 6), and for each row of the kernel, at each end on a body, its six indices in a dense A."""
    body = np.repeat(k.body, np.diff(k.row), axis=0)  # (nrows, 2)
    end, row = np.nonzero(body.T != GROUND)
    first = np.argsort(k.order)[row] * 6 * system.nb + 6 * body[row, end]
    sign = np.where(end == 0, 1.0, -1.0)[:, None]
    M = np.zeros((system.nb, 6, 6))
    M[:, range(3), range(3)] = system.mass[:, None]
    M[:, 3:, 3:] = system.regular_inertia
    return _Dense(M, end, row, sign, first[:, None] + np.arange(6))


def _share_redundant_load(k: Kernel) -> None:
    """Subtract from ``k.lam`` its part n without effect (S n = 0), so that redundant rows share their load evenly.

    n is found by the iteration n -= (S + e D)^-1 S n from n = ``lam``, with D the diagonal of S.
    """
    k.state["shift"] = SHIFT
    k.factorise.run()
    k.state["shift"] = 0.0
    idle, length = k.lam.copy(), np.sqrt(k.diagonal)
    size = np.linalg.norm(length * k.lam)
    for _ in range(PASSES):
        k.x[:], k.w[:] = idle, 0.0
        k.push.run()
        k.slips.run()
        k.rhs[:] = -(k.x + k.slip)
        k.solve.run()
        idle -= k.rhs
        if not np.linalg.norm(length * k.rhs) > SETTLED * size:
            break
    k.lam[:] -= idle
