"""Evaluate route 1: Newton-Euler equations in (r, quaternion, r_dot, Omega), index 1, eliminated by S = A M^-1 A^T.

    M a + A^T lam = f,  A a = gamma;  q_dot = q * (0, Omega) / 2

Independent rows are chosen by QR with column pivoting when the route (re)starts; there the state is also projected onto
the constraints, with the least change in the mass metric. Routes 1 and 2 share the data of the system, and no equation.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg as sl
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from ..mechanics.state import State, States
from ..mechanics.system import GROUND, MultibodySystem
from ..mechanics.time_functions import evaluate_functions
from .blocks import find_touched, list_blocks, multiply_blocks
from .moving_rows import PUSHES, Body, Joint, MovingRowRates, cross
from .principal import SAME, is_light, rotate_to_principal_axes
from .tape import Tape

# share of the largest pivot below which a row is redundant; half and twice change no reference of four problems, one of
# them with redundant rows
RANK = 1e-9
_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])
SWEEPS = 5  # most Gauss-Newton steps; drift between two starts is near rounding, where two suffice


@dataclass
class NewtonEuler:
    """The equations of route 1 for one system.

    A vector (13 nb + 1) holds r, quaternions (x, y, z, w), r_dot and Omega, each for all bodies in turn, then t.
    """

    given: MultibodySystem
    rows: Int[np.ndarray, " rank"] = field(init=False)  # rows in use; chosen by ``project_state``

    def __post_init__(self) -> None:
        """Turn light bodies to principal axes, and tabulate the constant parts of masses and rows."""
        self.system, self.axes = rotate_to_principal_axes(self.given)
        s = self.system
        self.nrows = s.nrows
        sizes, self.principal = np.linalg.eigh(s.regular_inertia)
        self.principal[:, :, 2] *= np.linalg.det(self.principal)[:, None]  # right-handed
        apart = np.roll(sizes, -1, axis=1) - np.roll(sizes, -2, axis=1)
        self.apart = np.where(np.abs(apart) > SAME * sizes[:, 2:], apart, 0.0)  # J_2 - J_3, J_3 - J_1, J_1 - J_2
        self.light = bool(np.any(is_light(s)))
        self.mass = np.zeros((s.nb, 6, 6))  # M by bodies
        self.mass[:, range(3), range(3)] = s.mass[:, None]
        self.mass[:, 3:, 3:] = s.regular_inertia
        self.weight = np.linalg.inv(self.mass)
        self.pinned, self.point = s.point_rows()
        self.line, self.axis = s.line_rows(), s.axis_rows()
        # body, arm, sign; those not on the ground of the pinned joints, of the line rows and of the axis rows
        self.ends: list[tuple[Any, ...]] = []
        for end, arm, sign in ((s.joint_i, s.joint_s_i, 1.0), (s.joint_j, s.joint_s_j, -1.0)):
            moving = [np.flatnonzero(end[j] != GROUND) for j in (self.pinned, self.line.joint, self.axis.joint)]
            self.ends.append((end, arm, sign, *moving))
        self.moving, self.touched = s.moving_rows(), find_touched(s)
        self._use_rows(np.arange(s.nrows))
        self._tape: Tape | None = None

    def _use_rows(self, rows: Int[np.ndarray, " rank"]) -> None:
        """Keep these rows as those in use, with the blocks that they touch and the inverse masses of these."""
        self.rows = rows
        self.blocks, bodies = list_blocks(self.touched[rows])
        self.weights = self.weight[bodies]

    def start(self, state: State) -> Float[np.ndarray, " coordinates"]:
        """Return a state as a vector of this route."""
        q = Rotation.from_matrix(state.R @ self.axes).as_quat()
        Omega = np.einsum("bi,bij->bj", state.Omega, self.axes)
        return np.concatenate([*(a.ravel() for a in (state.r, q, state.v, Omega)), [state.t]])

    def states(self, y: Float[np.ndarray, "nt coordinates"]) -> States:
        """Convert vectors of this route to states; quaternions are normalised."""
        r, q, v, Omega = self._parts(y)
        R = Rotation.from_quat(q.reshape(-1, 4)).as_matrix().reshape(*q.shape[:2], 3, 3)
        return States(r, R @ np.swapaxes(self.axes, 1, 2), v, np.einsum("bij,tbj->tbi", self.axes, Omega), y[:, -1])

    def units(self, size: float, speed: float, rate: float) -> Float[np.ndarray, " coordinates"]:
        """Return the scale of each entry of a vector, for tolerances, from a size [m], a speed [m/s] and a rate [1/s].

        The scale of time is infinite.
        """
        return np.repeat([size, 1.0, speed, rate, np.inf], np.array([*np.array([3, 4, 3, 3]) * self.system.nb, 1]))

    def rate(self, y: Float[np.ndarray, " coordinates"]) -> Float[np.ndarray, " coordinates"]:
        """Return the time derivative of a vector y: rates, accelerations, and 1 for time."""
        s = self.system
        A, gamma, f, q_dot, v = self._terms(y) if self._tape is None else (a[0] for a in self._tape(y[None]))
        if len(s.user_i):
            f = f + self._sum_user_forces(y)
        a = self._solve(A, f, gamma)
        return np.concatenate((v, q_dot, a[:, :3].ravel(), a[:, 3:].ravel(), [1.0]))

    def compile(self) -> None:
        """Replace the algebra of ``rate`` by a compiled tape, which takes a tenth of the time."""
        self._tape = Tape(self._terms, 13 * self.system.nb + 1)

    def _terms(self, y: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return A, gamma, f without users' laws, q_dot and r_dot at the vector y: the inputs of ``rate``."""
        r, q, v, Omega = (a[0] for a in self._parts(y[None]))
        R = _matrices(q)
        pushes = self._list_moving_rows(r, R, v, Omega, y[-1])
        A, gamma = self._jacobian(r, R, pushes), self._gamma(r, R, v, Omega, pushes)
        vector, w = q[:, :3], q[:, 3:]
        q_dot = 0.5 * np.concatenate((w * Omega + _cross(vector, Omega), -np.sum(vector * Omega, 1)[:, None]), axis=1)
        return A, gamma, self._forces(r, R, v, Omega, y[-1]), q_dot.ravel(), v.ravel()

    def project_state(self, y: Float[np.ndarray, " coordinates"]) -> Float[np.ndarray, " coordinates"]:
        """Return the vector projected onto the constraints, with the least change in the mass metric.

        The independent rows, ``rows``, are chosen anew there.
        """
        s = self.system
        r, q, v, Omega = (a[0].copy() for a in self._parts(y[None]))
        q /= np.linalg.norm(q, axis=1)[:, None]
        if self.nrows:
            A = self._rows_at(r, _matrices(q), v, Omega, y[-1])[1]
            even = A * np.repeat(np.stack((np.ones(s.nb), 1.0 / s.gyration), axis=1), 3, axis=1).ravel()  # in metres
            even /= np.maximum(np.linalg.norm(even, axis=1), np.finfo(float).tiny)[:, None]
            _, pivots, order = sl.qr(even.T, mode="economic", pivoting=True)
            size = np.abs(np.diag(pivots))
            self._use_rows(np.sort(order[: int(np.sum(size > RANK * size[0]))]))
            for _ in range(SWEEPS):
                phi, A, _ = self._rows_at(r, _matrices(q), v, Omega, y[-1])
                if np.max(np.abs(phi)) < 1e-15:
                    break
                change = self._solve(A, np.zeros((s.nb, 6)), phi)
                r -= change[:, :3]
                q = (Rotation.from_quat(q) * Rotation.from_rotvec(-change[:, 3:])).as_quat()
            both = np.concatenate((v, Omega), axis=1)
            _, A, phi_t = self._rows_at(r, _matrices(q), v, Omega, y[-1])
            both -= self._solve(A, np.zeros((s.nb, 6)), A @ both.ravel() + phi_t)
            v, Omega = both[:, :3], both[:, 3:]
        return np.concatenate([*(a.ravel() for a in (r, q, v, Omega)), y[-1:]])

    def measure_violation(self, y: Float[np.ndarray, " coordinates"]) -> float:
        """Return the largest |phi| [m] of all rows, redundant ones included.

        Angles count times the largest gyration radius.
        """
        r, q, v, Omega = (a[0] for a in self._parts(y[None]))
        phi = np.abs(self._rows_at(r, _matrices(q), v, Omega, y[-1])[0])
        phi[self.system.turning_rows] *= np.max(self.system.gyration)
        return float(np.max(phi, initial=0.0))

    def _solve(self, A: np.ndarray, f: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return accelerations a (nb, 6) with M a + A^T lam = ``f``, and A a = ``wanted`` for the rows in use."""
        A, wanted, n = A[self.rows], wanted[self.rows], 6 * self.system.nb
        if self.light:
            even = 1.0 / np.linalg.norm(A, axis=1)
            A = even[:, None] * A
            K = np.block([[sl.block_diag(*self.mass), A.T], [A, np.zeros((len(A), len(A)))]])
            return np.linalg.solve(K, np.concatenate((f.ravel(), even * wanted)))[:n].reshape(-1, 6)
        a = np.matmul(self.weight, f[..., None])[..., 0]
        if len(A):
            WA = multiply_blocks(A, self.weights, self.blocks)
            a -= (np.linalg.solve(A @ WA.T, A @ a.ravel() - wanted) @ WA).reshape(-1, 6)
        return a

    def _parts(self, y: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return r, quaternions, r_dot and Omega (nt, nb, 3 or 4) from vectors ``y`` (nt, 13 nb + 1)."""
        nb = self.system.nb
        r, q, v, Omega = y[:, : 3 * nb], y[:, 3 * nb : 7 * nb], y[:, 7 * nb : 10 * nb], y[:, 10 * nb : 13 * nb]
        return tuple(p.reshape(len(y), nb, -1) for p in (r, q, v, Omega))

    def _rows_at(
        self, r: np.ndarray, R: np.ndarray, v: np.ndarray, Omega: np.ndarray, t: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return phi, A and phi_t of all rows at the poses, velocities and time ``t`` [s]."""
        pushes = self._list_moving_rows(r, R, v, Omega, t)
        phi_t = np.zeros(self.nrows)
        for row, _, push in pushes:
            phi_t[row] = push.phi_t
        return self._phi(r, R, pushes), self._jacobian(r, R, pushes), phi_t

    def _bodies(self, r: np.ndarray, R: np.ndarray, v: np.ndarray, Omega: np.ndarray, k: int) -> tuple[Body, Body]:
        """Return the motions of bodies i and j of joint ``k``; the ground is at rest."""
        ends = (self.system.joint_i[k], self.system.joint_j[k])
        ground = Body(np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))
        i, j = (ground if b == GROUND else Body(r[b], R[b], v[b], R[b] @ Omega[b]) for b in ends)
        return i, j

    def _list_moving_rows(
        self, r: np.ndarray, R: np.ndarray, v: np.ndarray, Omega: np.ndarray, t: float
    ) -> list[tuple[int, int, MovingRowRates]]:
        """Return the moving rows at ``t`` [s], each as its number among all rows, its joint and its rates."""
        s, out = self.system, []
        for k, row, kind in zip(*self.moving, strict=True):
            f, f_dot, f_ddot = (a[0, 0] for a in evaluate_functions(s.joint_motion[k : k + 1], np.array([t])))
            p = Joint(s.joint_s_i[k], s.joint_s_j[k], s.joint_u[k], s.joint_n[k], s.joint_length[k], (f, f_dot, f_ddot))
            rows = PUSHES[kind](*self._bodies(r, R, v, Omega, k), p)
            out += [(row + n, int(k), push) for n, push in enumerate(rows)]
        return out

    def _phi(self, r: np.ndarray, R: np.ndarray, pushes: list[tuple[int, int, MovingRowRates]]) -> np.ndarray:
        """Return phi of all rows (nrows,); ``pushes`` are the moving ones, as ``_list_moving_rows`` returns them."""
        out = np.zeros(self.nrows)
        for row, _, push in pushes:
            out[row] = push.phi
        out[self.point] = self._gap(r, R, self.pinned)
        if len(self.line.row):
            d, (way, _) = self._gap(r, R, self.line.joint), self._find_line_directions(r, R)
            link = self.line.length > 0.0
            out[self.line.row] = np.where(link, 0.5, 1.0) * np.sum(d * way, axis=1) - 0.5 * self.line.length
        u, n = self._axes(_with_ground(R, np.eye(3)))
        out[self.axis.row] = np.sum(u * n, axis=1)
        return out

    def _gap(self, r: np.ndarray, R: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Return d of the given joints (m, 3) [m], space: from the point of body j to that of body i."""
        at, turned = _with_ground(r, np.zeros(3)), _with_ground(R, np.eye(3))
        d = np.zeros((len(joints), 3), r.dtype)
        for body, arm, sign, *_ in self.ends:
            d += sign * (at[body[joints]] + np.einsum("jab,jb->ja", turned[body[joints]], arm[joints]))
        return d

    def _find_line_directions(self, r: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return, in space, the direction of each line row's force, R_j n or d / L, and its point on body i."""
        s, line, turned = self.system, self.line, _with_ground(R, np.eye(3))
        i, j = s.joint_i[line.joint], s.joint_j[line.joint]
        x = _with_ground(r, np.zeros(3))[i] + np.einsum("jab,jb->ja", turned[i], s.joint_s_i[line.joint])
        n = np.einsum("jab,jb->ja", turned[j], line.n)
        link = line.length > 0.0
        L = np.where(link, line.length, 1.0)[:, None]
        return np.where(link[:, None], self._gap(r, R, line.joint) / L, n), x

    def _axes(self, turned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return u of body i and n of body j of all axis rows, in space.

        ``turned`` are all R, with the ground's last.
        """
        s, axis = self.system, self.axis
        u = np.einsum("jab,jb->ja", turned[s.joint_i[axis.joint]], axis.u)
        return u, np.einsum("jab,jb->ja", turned[s.joint_j[axis.joint]], axis.n)

    def _jacobian(self, r: np.ndarray, R: np.ndarray, pushes: list[tuple[int, int, MovingRowRates]]) -> np.ndarray:
        """Return A (nrows, 6 nb) of phi_dot = A (r_dot, Omega) + phi_t; ``pushes`` are the moving rows."""
        s, turned = self.system, _with_ground(R, np.eye(3))
        A = np.zeros((self.nrows, s.nb, 6), r.dtype)
        torque = _cross(*self._axes(turned))
        way, x = self._find_line_directions(r, R) if len(self.line.row) else (np.zeros((0, 3)),) * 2
        for end, arm, sign, pins, lines, axes in self.ends:
            joints = self.pinned[pins]
            b, k = end[joints][:, None], self.point[pins]
            A[k, b, np.arange(3)] = sign
            # row c of -R hat(s): (s x R^T e_c)
            A[k, b, 3:] = sign * _cross(arm[joints][:, None], turned[end[joints]])
            b, k, f = end[self.line.joint[lines]], self.line.row[lines], sign * way[lines]
            A[k, b, :3] = f
            A[k, b, 3:] = np.einsum("ja,jab->jb", _cross(x[lines] - r[b], f), turned[b])
            b = end[self.axis.joint[axes]]
            A[self.axis.row[axes], b, 3:] = sign * np.einsum("ja,jab->jb", torque[axes], turned[b])
        for row, k, push in pushes:
            for b, sign in ((s.joint_i[k], 1.0), (s.joint_j[k], -1.0)):
                if b != GROUND:
                    moment = push.T + cross(push.x - r[b], push.F)
                    A[row, b] += sign * np.concatenate((push.F, R[b].T @ moment))
        return A.reshape(self.nrows, 6 * s.nb)

    def _gamma(
        self,
        r: np.ndarray,
        R: np.ndarray,
        v: np.ndarray,
        Omega: np.ndarray,
        pushes: list[tuple[int, int, MovingRowRates]],
    ) -> np.ndarray:
        """Return gamma (nrows,), the value of A (r_ddot, Omega_dot) that makes phi_ddot = 0."""
        s = self.system
        turned, omega = _with_ground(R, np.eye(3)), _with_ground(np.einsum("bij,bj->bi", R, Omega), np.zeros(3))
        out = np.zeros(self.nrows, r.dtype)
        bend, rate = np.zeros((2, s.nj, 3), r.dtype)  # the part of d_ddot without v_dot and Omega_dot, and d_dot
        for body, arm, sign, *_ in self.ends:
            w, p = omega[body], np.einsum("jab,jb->ja", turned[body], arm)
            bend += sign * _cross(w, _cross(w, p))
            rate += sign * (_with_ground(v, np.zeros(3))[body] + _cross(w, p))
        out[self.point] = -bend[self.pinned]
        if len(self.line.row):
            j, link = self.line.joint, self.line.length > 0.0
            L, d, (way, _) = np.where(link, self.line.length, 1.0), self._gap(r, R, j), self._find_line_directions(r, R)
            w = omega[s.joint_j[j]]
            n_dot = np.where(link[:, None], 0.0, _cross(w, way))
            turning = 2.0 * np.sum(n_dot * rate[j], axis=1) + np.sum(_cross(w, n_dot) * d, axis=1)
            square = np.where(link, np.sum(rate[j] ** 2, axis=1) / L, 0.0)
            out[self.line.row] = -(np.sum(way * bend[j], axis=1) + turning + square)
        u, n = self._axes(turned)
        w_i, w_j = omega[s.joint_i[self.axis.joint]], omega[s.joint_j[self.axis.joint]]
        u_dot, n_dot = _cross(w_i, u), _cross(w_j, n)
        both = _cross(w_i, u_dot) * n + 2.0 * u_dot * n_dot + u * _cross(w_j, n_dot)
        out[self.axis.row] = -np.sum(both, axis=1)
        for row, k, push in pushes:
            out[row] = -push.acceleration(*self._bodies(r, R, v, Omega, k))
        return out

    def _forces(self, r: np.ndarray, R: np.ndarray, v: np.ndarray, Omega: np.ndarray, t: float) -> np.ndarray:
        """Return f (nb, 6) without users' laws: forces [space], and torques about C less Omega x J Omega [body]."""
        s = self.system
        f = np.zeros((s.nb + 1, 6), r.dtype)
        f[:-1, :3] = s.mass[:, None] * s.gravity
        w = np.einsum("bji,bj->bi", self.principal, Omega)  # avoids rounding of J Omega about an axis of little inertia
        f[:-1, 3:] = np.einsum("bij,bj->bi", self.principal, self.apart * w.take(_YZX, -1) * w.take(_ZXY, -1))
        if len(s.spring_k):
            at, turned = _with_ground(r, np.zeros(3)), _with_ground(R, np.eye(3))
            v_C, spin = _with_ground(v, np.zeros(3)), _with_ground(Omega, np.zeros(3))
            d, d_dot = np.zeros((2, len(s.spring_k), 3), r.dtype)
            for b, p, sign in ((s.spring_i, s.spring_p_i, 1.0), (s.spring_j, s.spring_p_j, -1.0)):
                d += sign * (at[b] + np.einsum("jab,jb->ja", turned[b], p))
                d_dot += sign * (v_C[b] + np.einsum("jab,jb->ja", turned[b], _cross(spin[b], p)))
            length = np.sqrt(np.sum(d * d, axis=1))
            pull = s.spring_k * (length - s.spring_d0) + s.spring_c * np.sum(d * d_dot, axis=1) / length
            F = -(pull / length)[:, None] * d
            for b, p, sign in ((s.spring_i, s.spring_p_i, 1.0), (s.spring_j, s.spring_p_j, -1.0)):
                torque = _cross(p, np.einsum("jab,ja->jb", turned[b], F))
                np.add.at(f, b, sign * np.concatenate((F, torque), axis=1))
        if len(s.load_i):
            Q = R[s.load_i]
            follows = s.load_follows[:, None]
            force = np.where(follows, np.einsum("jab,jb->ja", Q, s.load_force), s.load_force)
            pull = np.where(follows, s.load_force, np.einsum("jab,ja->jb", Q, s.load_force))
            torque = np.where(follows, s.load_torque, np.einsum("jab,ja->jb", Q, s.load_torque))
            factor = evaluate_functions(s.load_factor, np.array([t]))[0].T
            np.add.at(f, s.load_i, factor * np.concatenate((force, torque + _cross(s.load_p, pull)), axis=1))
        if len(s.torsion_k):
            turned, omega = _with_ground(R, np.eye(3)), _with_ground(np.einsum("bij,bj->bi", R, Omega), np.zeros(3))
            u = np.einsum("jab,jb->ja", turned[s.torsion_i], s.torsion_u)
            e, b = (np.einsum("jab,jb->ja", turned[s.torsion_j], s.torsion_n[:, k]) for k in (0, 1))
            x, y = np.sum(u * e, axis=1), np.sum(u * b, axis=1)
            m = (x[:, None] * _cross(u, b) - y[:, None] * _cross(u, e)) / (x * x + y * y)[:, None]
            rate = np.sum(m * (omega[s.torsion_i] - omega[s.torsion_j]), axis=1)
            angle = np.remainder(np.arctan2(y, x) - s.torsion_rest + np.pi, 2.0 * np.pi) - np.pi + s.torsion_wound
            T = -(s.torsion_k * angle + s.torsion_c * rate)[:, None] * m
            for body, sign in ((s.torsion_i, 1.0), (s.torsion_j, -1.0)):
                np.add.at(f[:, 3:], body, sign * np.einsum("jab,ja->jb", turned[body], T))
        return f[:-1]

    def _sum_user_forces(self, y: np.ndarray) -> np.ndarray:
        """Return the sum of users' forces [N] in space and torques [N m] about principal axes, on each body (nb, 6)."""
        here, f = self.states(y[None]), np.zeros((self.system.nb, 6))
        for i, j, law in zip(self.system.user_i, self.system.user_j, self.system.user_law, strict=True):
            F_i, F_j, T_i, T_j = law.evaluate(here, i, j)[0]
            for body, F, T in ((i, F_i, T_i), (j, F_j, T_j)):
                if body != GROUND:
                    # a law gives torques in space; R^T takes them to the given frame of the body
                    f[body] += np.concatenate((F, self.axes[body].T @ here.R[0, body].T @ T))
        return f


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a x b, in a quarter of NumPy's time for a few bodies."""
    return a.take(_YZX, -1) * b.take(_ZXY, -1) - a.take(_ZXY, -1) * b.take(_YZX, -1)


def _with_ground(a: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Append the ground's entry to ``a``, where index -1 finds it."""
    return np.concatenate((a, ground[None]))


def _matrices(q: np.ndarray) -> np.ndarray:
    """Return rotations (nb, 3, 3) of quaternions (x, y, z, w) near unit length, normalised."""
    x, y, z, w = (q / np.sqrt(np.sum(q * q, axis=1))[:, None]).T
    return np.stack(
        (
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - z * w),
            2.0 * (x * z + y * w),
            2.0 * (x * y + z * w),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - x * w),
            2.0 * (x * z - y * w),
            2.0 * (y * z + x * w),
            1.0 - 2.0 * (x * x + y * y),
        ),
        axis=1,
    ).reshape(-1, 3, 3)
