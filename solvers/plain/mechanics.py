"""The equations of a mechanism that a step needs: rows with their wrenches, loads and inertia, from declarations alone.

Velocities are v = (r_dot [space], Omega [body]) per body, wrenches (force, torque about C), both in space. With u the
velocities in space, u = (r_dot, omega), a row of a joint is phi_dot = D^T u + phi_t: D is script-A A^T of Eq. (70), its
rate along the motion, D_dot, is script-A B^T of Eq. (71). In the velocities of the bodies it is phi_dot = A v + phi_t.
"""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...harness.mechanics import forces, so3, time_functions
from ...harness.mechanics.declaring import Numbers, PointLoad, Pose, cross
from ...harness.mechanics.joints import DECLARED
from ...harness.mechanics.system import GROUND, MultibodySystem
from .jets import Jet, jet

AXES = so3.hat(np.eye(3))  # hat(e_q)
DIRECTIONS = 13  # directions of a row's slopes: velocities in space of body i, of body j, and the motion itself
REST = Pose(np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))  # the ground


class Rows(NamedTuple):
    """All constraint rows of a mechanism at one state."""

    phi: Float[np.ndarray, " nr"]  # zero for rows that restrict velocities alone
    phi_dot: Float[np.ndarray, " nr"]
    D: Float[np.ndarray, "n nr"]
    D_dot: Float[np.ndarray, "n nr"]
    A: Float[np.ndarray, "nr n"]
    gamma: Float[np.ndarray, " nr"]  # phi_ddot = A v_dot + gamma


class Mechanism:
    """The equations of motion of a system in plain NumPy, with ``n`` = 6 nb velocities and ``nr`` constraint rows."""

    def __init__(self, system: MultibodySystem) -> None:
        self.system, self.nb, self.nr = system, system.nb, system.nrows
        self.mass, self.J = system.mass, system.regular_inertia
        self.J_inv = np.linalg.inv(self.J)

    def momentum(self, R: Float[np.ndarray, "nb 3 3"], v: Float[np.ndarray, "nb 6"]) -> Float[np.ndarray, " n"]:
        """Return the momenta in space, script-A p of Eq. (70): (m r_dot, R J Omega) of each body, Eq. (61)."""
        spin = np.einsum("bij,bjk,bk->bi", R, self.J, v[:, 3:])
        return np.concatenate((self.mass[:, None] * v[:, :3], spin), axis=1).ravel()

    def rows(
        self, t: float, r: Float[np.ndarray, "nb 3"], R: Float[np.ndarray, "nb 3 3"], v: Float[np.ndarray, "nb 6"]
    ) -> Rows:
        """Return all constraint rows at time ``t`` [s], poses and velocities, from the declarations of joints.

        A nonholonomic row has phi = 0, and its phi_dot is the declared velocity.
        """
        n, nr = 6 * self.nb, self.nr
        D, D_dot = np.zeros((2, n, nr))
        out = Rows(np.zeros(nr), np.zeros(nr), D, D_dot, np.zeros((nr, n)), np.zeros(nr))
        f, f_dot, f_ddot = time_functions.evaluate_functions(self.system.joint_motion, np.array([t]))
        for k, start in enumerate(self.system.row_start[:-1]):
            ends = int(self.system.joint_i[k]), int(self.system.joint_j[k])
            declared = DECLARED[self.system.joint_kind(k)]
            along = np.eye(DIRECTIONS)[-1]
            driven = Jet(f[0, k], f_dot[0, k], f_dot[0, k] * along, f_ddot[0, k] * along)
            numbers = self._collect_parameters(k, driven if declared.motion else 0.0)
            i, j = (
                REST if b == GROUND else _make_pose_by_displacement(r[b], R[b], v[b], end) for end, b in enumerate(ends)
            )
            found = [(jet(a), True) for a in declared.phi(i, j, numbers)]
            if not declared.is_holonomic:
                i, j = (
                    REST if b == GROUND else _make_pose_by_velocity(r[b], R[b], v[b], end) for end, b in enumerate(ends)
                )
                found += [(jet(a), False) for a in declared.rates(i, j, numbers)]
            for row, (a, holonomic) in enumerate(found, start):
                slopes, slope_rates = (np.broadcast_to(x, DIRECTIONS) for x in (a.slopes, a.slope_rates))
                out.phi[row], out.phi_dot[row] = (a.x, a.rate) if holonomic else (0.0, a.x)
                out.gamma[row] = slope_rates[-1] if holonomic else a.rate
                for end, b in enumerate(ends):
                    if b != GROUND:
                        six = slice(6 * end, 6 * end + 6)
                        out.D[6 * b : 6 * b + 6, row] += slopes[six]
                        out.D_dot[6 * b : 6 * b + 6, row] += slope_rates[six]
        for row in range(nr):
            out.A[row] = self.turn_to_bodies(R, out.D[:, row])
        return out

    def loads(
        self, t: float, r: Float[np.ndarray, "nb 3"], R: Float[np.ndarray, "nb 3 3"], v: Float[np.ndarray, "nb 6"]
    ) -> Float[np.ndarray, "nb 6"]:
        """Return the applied wrench (force [N], torque about C [N m]) on each body, in space.

        It is the sum of gravity, all declared kinds of forces, and user forces.
        """
        s = self.system
        out = np.zeros((self.nb, 6))
        out[:, :3] = self.mass[:, None] * s.gravity
        poses = [Pose(r[b], R[b], v[b, :3], R[b] @ v[b, 3:]) for b in range(self.nb)] + [REST]  # -1: the ground
        for kind in forces.DECLARED:
            for b, force, moment in self._list_forces(kind, t, poses):
                out[b] += np.concatenate((force, moment))
        for law, i, j in zip(s.user_law, s.user_i, s.user_j, strict=True):
            ends = [b for b in (i, j) if b != GROUND]
            state = [
                np.stack((a[i], a[j] if j != GROUND else rest))
                for a, rest in ((r, np.zeros(3)), (R, np.eye(3)), (v[:, :3], np.zeros(3)), (v[:, 3:], np.zeros(3)))
            ]
            force, torque = np.zeros((2, 3)), np.zeros((2, 3))
            law.build_function()(t, *state, force, torque)
            for end, b in enumerate(ends):
                out[b] += np.concatenate((force[end], torque[end]))
        return out

    def spring_slopes(
        self,
        r: Float[np.ndarray, "nb 3"],
        R: Float[np.ndarray, "nb 3 3"],
        v: Float[np.ndarray, "nb 6"],
        c: Float[np.ndarray, "nr n"],
    ) -> Float[np.ndarray, "2 nr"]:
        """Return c . df/dv c and c . df/dq c of Eq. (32) for each row of ``c``, with f the wrenches of springs.

        Torques in f are in the frames of the bodies. Derivatives are those of jets along c.
        """
        out = np.zeros((2, len(c)))
        for row, one in enumerate(c):
            by_rate, by_pose = [REST], [REST]  # bodies that are faster, and displaced, along c
            for b, d in reversed(list(enumerate(one.reshape(-1, 6)))):
                omega, turned = R[b] @ v[b, 3:], R[b] @ so3.hat(d[3:])
                faster = _make_jets(v[b, :3], d[:3]), _make_jets(omega, R[b] @ d[3:])
                by_rate.insert(0, Pose(_make_jets(r[b], np.zeros(3)), _make_jets(R[b], np.zeros((3, 3))), *faster))
                moved = _make_jets(r[b], d[:3]), _make_jets(R[b], turned), _make_jets(v[b, :3], np.zeros(3))
                by_pose.insert(0, Pose(*moved, _make_jets(omega, turned @ v[b, 3:])))
            for k, poses in enumerate((by_rate, by_pose)):
                for b, force, moment in self._list_forces("spring", 0.0, poses):
                    load = np.concatenate((force, poses[b].R.T @ moment))
                    out[k, row] += sum(a * jet(x).rate for a, x in zip(one[6 * b : 6 * b + 6], load, strict=True))
        return out

    def load(self, k: int, t: float, r: Float[np.ndarray, " 3"], R: Float[np.ndarray, "3 3"]) -> PointLoad:
        """Return force, torque and point of load ``k`` in space, at ``t`` [s] and its body's position and rotation."""
        s = self.system
        numbers = {name: getattr(s, f"load_{name}")[k] for name in forces.DECLARED["load"].numbers}
        numbers["factor"] = time_functions.evaluate_functions(numbers["factor"][None], np.array([t]))[0][0, 0]
        pose = Pose(r, R, np.zeros(3), np.zeros(3))
        return forces.DECLARED["load"].push(pose, REST, SimpleNamespace(**numbers))

    def _list_forces(self, kind: str, t: float, poses: list[Pose]) -> Iterator[tuple[int, Any, Any]]:
        """Yield (body, force, moment about C), in space, for each body on which a declared force of this ``kind`` acts.

        ``poses`` are those of all bodies, then of the ground, which is left out.
        """
        s, declared = self.system, forces.DECLARED[kind]
        bodies_i = getattr(s, f"{kind}_i")
        bodies_j = getattr(s, f"{kind}_j") if declared.pair else np.full(len(bodies_i), GROUND)
        for k, ends in enumerate(zip(bodies_i, bodies_j, strict=True)):
            numbers = {name: getattr(s, f"{kind}_{name}")[k] for name in declared.numbers}
            if "factor" in numbers:
                numbers["factor"] = time_functions.evaluate_functions(numbers["factor"][None], np.array([t]))[0][0, 0]
            push = declared.push(poses[ends[0]], poses[ends[1]], SimpleNamespace(**numbers))
            for b, sign in zip(ends, (1.0, -1.0), strict=True):
                if b != GROUND:
                    yield b, sign * push.force, sign * (push.torque + cross(push.point - poses[b].r, push.force))

    def forces(self, t: float, r: np.ndarray, R: np.ndarray, v: np.ndarray) -> Float[np.ndarray, " n"]:
        """Return f of M v_dot = f + A^T lam: applied wrenches less Omega x J Omega, torques in the body frames."""
        f = self.turn_to_bodies(R, self.loads(t, r, R, v).ravel()).reshape(-1, 6)
        f[:, 3:] -= np.cross(v[:, 3:], np.einsum("bij,bj->bi", self.J, v[:, 3:]))
        return f.ravel()

    def schur(self, A1: Float[np.ndarray, "nr n"], A0: Float[np.ndarray, "nr n"]) -> Float[np.ndarray, "nr nr"]:
        """Return S = A1 M^-1 A0^T, the Schur complement of the mass matrix."""
        return A1 @ np.array([self.divide_by_inertia(a) for a in A0]).reshape(A0.shape).T

    def accelerate(
        self, t: float, r: np.ndarray, R: np.ndarray, v: np.ndarray
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " nr"]]:
        """Return v_dot and lam of index 1: M v_dot = f + A^T lam, A v_dot = -gamma."""
        rows, f = self.rows(t, r, R, v), self.forces(t, r, R, v)
        lam = solve(self.schur(rows.A, rows.A), -rows.gamma - rows.A @ self.divide_by_inertia(f))
        return self.divide_by_inertia(f + rows.A.T @ lam), lam

    def multiply_by_inertia(self, c: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return M c for velocities ``c`` (r_dot [space], Omega [body])."""
        six = c.reshape(-1, 6)
        return np.hstack((self.mass[:, None] * six[:, :3], np.einsum("bij,bj->bi", self.J, six[:, 3:]))).ravel()

    def divide_by_inertia(self, f: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return M^-1 f for wrenches ``f`` (force [space], torque [body])."""
        six = f.reshape(-1, 6)
        return np.hstack((six[:, :3] / self.mass[:, None], np.einsum("bij,bj->bi", self.J_inv, six[:, 3:]))).ravel()

    def turn_to_bodies(self, R: Float[np.ndarray, "nb 3 3"], w: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return wrenches ``w`` in space with their torques transformed to the frames of the bodies."""
        six = w.reshape(-1, 6)
        return np.hstack((six[:, :3], np.einsum("bji,bj->bi", R, six[:, 3:]))).ravel()

    def _collect_parameters(self, k: int, f: Any) -> Numbers:
        """Return the parameters of joint ``k`` by name, with the value ``f`` of its function of time."""
        s = self.system
        return Numbers(
            s.joint_s_i[k], s.joint_s_j[k], s.joint_u[k], s.joint_w[k], s.joint_n[k], float(s.joint_length[k]), f
        )


def solve(S: Float[np.ndarray, "nr nr"], x: Float[np.ndarray, " nr"]) -> Float[np.ndarray, " nr"]:
    """Return S^-1 x; where rows are redundant, the least-squares solution of least norm."""
    return np.linalg.lstsq(S, x)[0] if len(x) else x


def move(
    r: Float[np.ndarray, "nb 3"], R: Float[np.ndarray, "nb 3 3"], d: Float[np.ndarray, "nb 6"]
) -> tuple[Float[np.ndarray, "nb 3"], Float[np.ndarray, "nb 3 3"]]:
    """Return the poses r + dr and R exp(dtheta) for the displacements d = (dr [m, space], dtheta [rad, body])."""
    return r + d[:, :3], R @ so3.exp(d[:, 3:])


def _make_jets(x: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the array ``x`` as jets with the rates ``rate``, without slopes."""
    found = [Jet(a, b) for a, b in zip(x.ravel(), rate.ravel(), strict=True)]
    return np.array(found, dtype=object).reshape(x.shape)


def _make_pose_by_displacement(r: np.ndarray, R: np.ndarray, v: np.ndarray, end: int) -> Pose:
    """Return a body's pose as jets for rows with phi: rates along ``v``, slopes by displacements of the body.

    ``end``, 0 for body i of a joint and 1 for body j, decides the place of its slopes.
    """
    spin = so3.hat(R @ v[3:])
    unit, turn, turn_rate = np.zeros((3, DIRECTIONS)), *np.zeros((2, 3, 3, DIRECTIONS))
    unit[:, 6 * end : 6 * end + 3] = np.eye(3)
    turn[:, :, 6 * end + 3 : 6 * end + 6] = np.einsum("qkm,ml->klq", AXES, R)
    turn_rate[:, :, 6 * end + 3 : 6 * end + 6] = np.einsum("qkm,ml->klq", AXES, spin @ R)
    R_dot = spin @ R
    unit[:, -1], turn[:, :, -1], turn_rate[:, :, -1] = v[:3], R_dot, spin @ R_dot  # the motion itself, at constant v
    place = [Jet(r[k], v[k], unit[k]) for k in range(3)]
    frame = [[Jet(R[k, l], R_dot[k, l], turn[k, l], turn_rate[k, l]) for l in range(3)] for k in range(3)]
    return Pose(np.array(place), np.array(frame), v[:3], R @ v[3:])


def _make_pose_by_velocity(r: np.ndarray, R: np.ndarray, v: np.ndarray, end: int) -> Pose:
    """Return a body's pose as jets for nonholonomic rows: rates along ``v``, slopes by velocities of the body.

    ``end``, 0 for body i of a joint and 1 for body j, decides the place of its slopes.
    """
    omega, unit = R @ v[3:], np.zeros((6, DIRECTIONS))
    unit[:, 6 * end : 6 * end + 6] = np.eye(6)
    R_dot = so3.hat(omega) @ R
    place = [Jet(r[k], v[k]) for k in range(3)]
    frame = [[Jet(R[k, l], R_dot[k, l]) for l in range(3)] for k in range(3)]
    speed, spin = ([Jet(a[k], 0.0, unit[at + k]) for k in range(3)] for a, at in ((v[:3], 0), (omega, 3)))
    return Pose(np.array(place), np.array(frame), np.array(speed), np.array(spin))
