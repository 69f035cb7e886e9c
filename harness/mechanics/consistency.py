"""Check that a start satisfies the constraints, and project one onto them."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from . import so3
from .added_inertia import find_principal_inertias
from .motion import constraint, constraint_rate, measure_gaps
from .naming import name_joint
from .state import State, States
from .system import MultibodySystem

START_TOLERANCE = 1e-9  # [m], [m/s]: rounding of data given in float64 at the scale of a metre, times 1e6
CLOSED = 1e-14  # largest component of phi of a projected state

X = TypeVar("X")


class InconsistentStart(ValueError):
    """A start that violates the constraints; the message says where and by how much."""


def check_start(
    system: MultibodySystem, state: State, *, literal: bool = False, what: str = "the start", any_root: bool = False
) -> None:
    """Raise InconsistentStart unless R are rotations and phi = phi_dot = 0, to ``START_TOLERANCE``.

    With ``literal`` phi_dot may be anything. With ``any_root`` a joint may also be half a turn from the angle that it
    prescribes, where its row vanishes, too. ``what`` names the state in the message.
    """
    for name in ("r", "R", "v", "Omega"):
        if not np.all(np.isfinite(getattr(state, name))):
            raise InconsistentStart(f"{what} must be finite numbers (got {name} = {getattr(state, name).tolist()})")
    if state.nb != system.nb:
        raise InconsistentStart(f"{what} must have {system.nb} bodies (got {state.nb})")
    defect = float(np.max(so3.orthogonality_defect(state.R), initial=0.0))
    if defect > START_TOLERANCE or np.any(np.linalg.det(state.R) < 0.0):
        raise InconsistentStart(f"{what}'s R must be rotations (got |R^T R - 1| = {defect:.3g})")
    one = States.one(state)
    gaps = (constraint if any_root else measure_gaps)(system, one)[0]
    rows = np.abs([gaps, constraint_rate(system, one)[0]])
    phi, phi_dot = (float(a) for a in np.max(rows, axis=1, initial=0.0))
    if phi > START_TOLERANCE or (phi_dot > START_TOLERANCE and not literal):
        row = int(np.argmax(rows[0] if phi > START_TOLERANCE else rows[1]))
        joint = int(np.searchsorted(system.row_start, row, side="right")) - 1
        if abs(constraint(system, one)[0, row]) <= START_TOLERANCE < phi:
            raise InconsistentStart(
                f"{what} must satisfy the constraints: {name_joint(system, joint)} is half a turn from the "
                "angle that it prescribes, where its row vanishes, too; turn body i by pi about the axis"
            )
        raise InconsistentStart(
            f"{what} must satisfy the constraints: expected |phi| and |phi_dot| < {START_TOLERANCE:g} "
            f"(got |phi| = {phi:.6g}, |phi_dot| = {phi_dot:.6g}, most at {name_joint(system, joint)}"
            f"{_describe_gap(system, one, joint, row) if phi > START_TOLERANCE else ''})"
        )


def _describe_gap(system: MultibodySystem, s: States, joint: int, row: int) -> str:
    """Return in words how far the points or axes of ``joint`` are apart; empty if ``row`` of phi belongs to neither."""
    phi, first = constraint(system, s)[0], int(system.row_start[joint])
    points, axis = system.joint_points[joint], system.axis_rows()
    if row < first + points:
        return f": its points are {np.linalg.norm(phi[first : first + points]):.4g} m apart"
    own = axis.row[axis.joint == joint][:2]
    if len(own) < 2 or row not in own:  # a third row is the turn about the axis, a single one an angle of 90 deg
        return ""
    return f": its axes, as lines, differ by {np.degrees(np.arcsin(min(float(np.linalg.norm(phi[own])), 1.0))):.4g} deg"


def close_gaps(
    x: X, measure: Callable[[X], np.ndarray], correct: Callable[[X, np.ndarray], X], small: float, most: int
) -> X:
    """Return ``x`` after Newton's method: corrected until its largest gap is below ``small``, or ``most`` times.

    ``measure(x)`` returns the gaps of x; ``correct(x, gaps)`` returns x moved by the least change that closes them to
    first order.
    """
    for _ in range(most):
        gaps = measure(x)
        if np.max(np.abs(gaps), initial=0.0) < small:
            break
        x = correct(x, gaps)
    return x


def project(system: MultibodySystem, state: State, iterations: int = 20) -> State:
    """Return the state near ``state`` that satisfies the constraints, by least change in the mass metric.

    Poses are projected first, in at most ``iterations`` of Gauss-Newton on phi, then velocities. Raise
    InconsistentStart if phi or phi_dot is not closed then.
    """
    here = close_gaps(
        State(state.r.copy(), state.R.copy(), state.v, state.Omega, state.t),
        lambda s: constraint(system, States.one(s))[0],
        lambda s, phi: _move_poses(s, _find_least_change(system, s, -phi)),
        CLOSED,
        iterations,
    )
    change = _find_least_change(system, here, -constraint_rate(system, States.one(here))[0])
    out = State(here.r, here.R, state.v + change[:, :3], state.Omega + change[:, 3:], state.t)
    check_start(system, out, what="the projected state", any_root=True)
    return out


def _move_poses(s: State, change: np.ndarray) -> State:
    """Return the state with its poses moved by ``change`` (nb, 6): shifts [m, space], rotation vectors [rad, body]."""
    return State(s.r + change[:, :3], s.R @ so3.exp(change[:, 3:]), s.v, s.Omega, s.t)


def perturb(system: MultibodySystem, state: State, size: float, seed: int) -> State:
    """Return ``state`` with a random change, projected back onto the constraints.

    The change is standard normal in each component, from ``seed``, times ``size``: relative to 1 rad in orientation, to
    the largest joint arm (1 m without joints) in position, and to the largest speed or sqrt(g arm) in velocities. A
    body without inertia about an axis gets no angular velocity about it: where no joint acts there, its spin must stay
    0.
    """
    random = np.random.default_rng(seed)
    arm = float(np.max(np.abs(system.joint_s_i), initial=0.0)) or 1.0
    speed = max(float(np.max(np.abs(state.v), initial=0.0)), float(np.sqrt(np.linalg.norm(system.gravity) * arm)))
    rate = max(float(np.max(np.abs(state.Omega), initial=0.0)), speed / arm)
    shape = (system.nb, 3)
    moved = State(
        state.r + size * arm * random.standard_normal(shape),
        state.R @ so3.exp(size * random.standard_normal(shape)),
        state.v + size * speed * random.standard_normal(shape),
        state.Omega + size * rate * _remove_free_spin(system, random.standard_normal(shape)),
        state.t,
    )
    return project(system, moved)


def _remove_free_spin(system: MultibodySystem, Omega: np.ndarray) -> np.ndarray:
    """Return Omega without its components about axes that have no inertia."""
    _, axes, none = find_principal_inertias(system.inertia)
    n = axes * none[:, None, :]  # columns; zero for axes that have inertia
    out: np.ndarray = Omega - np.einsum("bik,bjk,bj->bi", n, n, Omega)
    return out


def _find_least_change(system: MultibodySystem, state: State, wanted: np.ndarray) -> np.ndarray:
    """Return the x (nb, 6) of least mass norm with A x = ``wanted`` (nrows,), by LSQR, also for redundant rows.

    In the norm, each body counts with its mass and its mean principal inertia.
    """
    import scipy.sparse as sp
    import scipy.sparse.linalg as spl

    from .jacobian import constraint_jacobian

    if system.nrows == 0:
        return np.zeros((system.nb, 6))
    scale = np.stack(
        [np.sqrt(system.mass)] * 3 + [np.sqrt(np.einsum("bii->b", system.regular_inertia) / 3.0)] * 3, axis=1
    ).ravel()
    A = constraint_jacobian(system, state) @ sp.diags_array(1.0 / scale)
    y = spl.lsqr(A, wanted, atol=1e-15, btol=1e-15, iter_lim=20 * max(A.shape))[0]
    return (y / scale).reshape(system.nb, 6)
