"""Choice of independent constraint rows for Exudyn, in the frames in which it states them, and a monitor of their rank.

Rows that are independent at the start may become dependent later although all rows together do not lose rank: a code
that passes such a configuration continues with an open joint. The least singular value of the rows kept, each scaled to
length one for velocities in m/s, is monitored. Below half of its value at the choice, and where a joint has opened, the
most independent rows are searched for; they are used if their least singular value is twice as large or a joint has
opened. The motion continues from the check before.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ....harness.mechanics.ends import append_ground
from ....harness.mechanics.jacobian import factor_with_pivots
from ....harness.mechanics.joints import JointKind
from ....harness.mechanics.joints.frames import choose_normals
from ....harness.mechanics.motion import constraint, list_jacobian_parts
from ....harness.mechanics.state import State, States
from ....harness.mechanics.system import MultibodySystem
from ...formulations.rank import BETTER

PIVOT = 1e-9  # share of the largest pivot: rounding is 1e-15, true pivots are above 1e-3
WORN = 0.5  # share of the least singular value at the choice, at which other rows are searched for
# limit of a left-out row's gap: a share of the longest arm, and a multiple of the largest kept gap
OPEN, TIMES = 1e-2, 10.0
TURN = 0.1  # [rad] turn of the fastest body between two checks; a check costs 70 us, as a step of small systems does
LARGEST = 100  # rows of the largest system monitored: singular values of more cost as much as many steps


@dataclass(frozen=True)
class WornRows:
    """Result of a check that found the rows kept too dependent: where to continue from, with which rows."""

    last: int  # index of the last state at which the rows kept are independent enough; -1: that before all of these
    better: Bool[np.ndarray, " nrows"] | None  # None: no rows are independent at both checks


class KeptRows:
    """Constraint rows in use from ``start`` on, those of ``kept`` or a maximal independent set, and their monitor."""

    def __init__(self, system: MultibodySystem, start: State, kept: Bool[np.ndarray, " nrows"] | None = None) -> None:
        """Choose the rows at ``start``, and set the limits of the monitor."""
        self._system = system
        partial = np.flatnonzero((system.joint_points == 3) & (system.joint_axes > 0))
        self._frames = {int(k): make_joint_frames(system, start, int(k))[1] for k in partial}
        self._latest = self._scale_rows(States.one(start))[0][0]
        self.kept = _choose_independent(self._latest) if kept is None else kept
        self._watched = not np.all(self.kept) and system.nrows <= LARGEST
        self._first_singular_value = _find_least_singular_value(self._latest[self.kept]) if self._watched else 0.0
        self._limit, self._turned = WORN * self._first_singular_value, 0.0
        self._arm = float(max(np.max(np.abs(system.joint_s_i), initial=0.0), np.max(system.gyration)))

    def examine_states(self, s: States, dt: float) -> WornRows | None:
        """Return where the rows in use become too dependent among these states, and better rows; None if nowhere.

        The states ``s`` are ``dt`` [s] apart and follow those of the call before, of which the monitor remembers rows
        and turns. Only states some ``TURN`` [rad] of rotation apart are examined, and the last one. Always None where
        no row was left out, or for more than ``LARGEST`` rows.
        """
        if not self._watched or not len(s.r):
            return None
        rate = np.linalg.norm(s.Omega, axis=2) + np.linalg.norm(s.v, axis=2) / self._arm
        turned = np.cumsum(np.append(self._turned, np.max(rate, axis=1) * dt))
        self._turned = float(turned[-1])
        examined = np.union1d(np.flatnonzero(np.diff(np.floor(turned / TURN)) > 0.0), len(s.r) - 1)
        last, number = -1, int(np.sum(self.kept))
        for at, A, gap in zip(
            examined,
            *self._scale_rows(States(s.r[examined], s.R[examined], s.v[examined], s.Omega[examined])),
            strict=True,
        ):
            least = _find_least_singular_value(A[self.kept])
            opened = np.max(gap[~self.kept]) > TIMES * np.max(gap[self.kept]) + OPEN * self._arm
            if opened or least < self._limit:
                best = _choose_independent(A, number)
                if opened or _find_least_singular_value(A[best]) > BETTER * least:
                    now, then = (_find_least_singular_value(self._latest[rows]) for rows in (self.kept, best))
                    both = then > WORN * now
                    return WornRows(last, best if both and np.any(best != self.kept) else None)
                self._limit = WORN * least
            else:
                self._limit = min(WORN * self._first_singular_value, max(WORN * least, self._limit))
            last, self._latest = int(at), A
        return None

    def _scale_rows(self, s: States) -> tuple[Float[np.ndarray, "nt nrows n"], Float[np.ndarray, "nt nrows"]]:
        """Return the Jacobian A of all constraint rows, each scaled to length one, and |phi| [m], divided likewise.

        Both are at each state of ``s``. A multiplies (r_dot, radius of gyration times Omega). Point rows of a joint
        that also has axis rows are along the axes of its joint frame in body j.
        """
        system = self._system
        six = np.zeros((len(s.r), system.nrows, system.nb, 6))
        for body, row, translation, rotation in list_jacobian_parts(system, s):
            six[:, row, body, :3] += translation
            six[:, row, body, 3:] += rotation / system.gyration[body, None]
        A = np.append(six.reshape(len(s.r), system.nrows, 6 * system.nb), constraint(system, s)[..., None], axis=2)
        R = append_ground(s.R, np.eye(3))
        for k, in_j in self._frames.items():
            point = slice(system.row_start[k], system.row_start[k] + 3)
            A[:, point] = np.swapaxes(R[:, system.joint_j[k]] @ in_j, 1, 2) @ A[:, point]
        length = np.linalg.norm(A[..., :-1], axis=2, keepdims=True)
        A /= np.where(length > 0.0, length, 1.0)
        return A[..., :-1], np.abs(A[..., -1])


def make_joint_frames(
    system: MultibodySystem, start: State, k: int
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
    """Return the frame of joint ``k`` at ``start``, its axes x, y, z as columns in body i, and in body j.

    z is the joint's axis. With Exudyn's marker 0 on j its rows are then this project's: points along x and y of j, the
    axis of i normal to x or y of j.
    """
    R = np.concatenate((start.R, np.eye(3)[None]))
    x, y = system.joint_n[k, :2]
    if system.joint_kind(k) in (JointKind.UNIVERSAL, JointKind.NORMAL):
        y = np.cross(R[system.joint_j[k]].T @ R[system.joint_i[k]] @ system.joint_u[k], x)
    if system.joint_kind(k) == JointKind.ON_PLANE:
        y = choose_normals(x)[0]
    in_j = np.column_stack((x, y, np.cross(x, y)))
    return R[system.joint_i[k]].T @ R[system.joint_j[k]] @ in_j, in_j


def _choose_independent(rows: Float[np.ndarray, "nrows n"], number: int = -1) -> Bool[np.ndarray, " nrows"]:
    """Return flags of the ``number`` most independent rows by a pivoted QR; of all independent ones if negative."""
    out = np.zeros(len(rows), dtype=bool)
    if len(rows):
        _, size, order = factor_with_pivots(rows.T)
        out[order[: int(np.sum(size > PIVOT * size[0])) if number < 0 else number]] = True
    return out


def _find_least_singular_value(rows: Float[np.ndarray, "k n"]) -> float:
    """Return the least singular value of the matrix ``rows``, which measures how independent they are."""
    return float(np.linalg.svd(rows, compute_uv=False)[-1])
