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
from .moving_rows import ROW_FUNCTIONS, Body, Joint, MovingRowRates, cross
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
        """Rotate light bodies to principal axes, and tabulate the constant parts of masses and rows."""
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
        """Set ``rows`` as the independent rows in use, with the nonzero blocks of their Jacobian and inverse masses."""
        self.rows = rows
        self.blocks, bodies = list_blocks(self.touched[rows])
        self.weights = self.weight[bodies]

    def pack_state(self, state: State) -> Float[np.ndarray, " coordinates"]:
        """Return ``state`` as a vector of this route, with quaternions and Omega in its body frames."""
        q = Rotation.from_matrix(state.R @ self.axes).as_quat()
        Omega = np.einsum("bi,bij->bj", state.Omega, self.axes)
        return np.concatenate([*(a.ravel() for a in (state.r, q, state.v, Omega)), [state.t]])

    def states(self, y: Float[np.ndarray, "nt coordinates"]) -> States:
        """Convert vectors of this route to states in the given body frames; quaternions are normalised."""
        r, q, v, Omega = self._split_states(y)
        R = Rotation.from_quat(q.reshape(-1, 4)).as_matrix().reshape(*q.shape[:2], 3, 3)
        return States(r, R @ np.swapaxes(self.axes, 1, 2), v, np.einsum("bij,tbj->tbi", self.axes, Omega), y[:, -1])

    def units(self, size: float, speed: float, rate: float) -> Float[np.ndarray, " coordinates"]:
        """Return the scale of each entry of a vector, for tolerances, from a size [m], a speed [m/s] and a rate [1/s].

        The scale of time is infinite.
        """
        return np.repeat([size, 1.0, speed, rate, np.inf], np.array([*np.array([3, 4, 3, 3]) * self.system.nb, 1]))

    def rate(self, y: Float[np.ndarray, " coordinates"]) -> Float[np.ndarray, " coordinates"]:
        """Return the time derivative of the vector y: velocities, quaternion rates, accelerations, and 1 for time."""
        s = self.system
        A, gamma, f, q_dot, v = self._evaluate_terms(y) if self._tape is None else (a[0] for a in self._tape(y[None]))
        if len(s.user_i):
            f = f + self._sum_user_forces(y)
        a = self._solve_accelerations(A, f, gamma)
        return np.concatenate((v, q_dot, a[:, :3].ravel(), a[:, 3:].ravel(), [1.0]))

    def compile(self) -> None:
        """Replace the algebra of ``rate`` by a compiled tape, which takes a tenth of the time."""
        self._tape = Tape(self._evaluate_terms, 13 * self.system.nb + 1)

    def _evaluate_terms(self, y: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return A, gamma, f without user forces, q_dot and r_dot at the vector ``y``: the inputs of ``rate``."""
        r, q, v, Omega = (a[0] for a in self._split_states(y[None]))
        R = _convert_quaternions(q)
        moving_rows = self._evaluate_moving_rows(r, R, v, Omega, y[-1])
        A, gamma = self._assemble_jacobian(r, R, moving_rows), self._evaluate_gamma(r, R, v, Omega, moving_rows)
        vector, w = q[:, :3], q[:, 3:]
        q_dot = 0.5 * np.concatenate((w * Omega + _cross(vector, Omega), -np.sum(vector * Omega, 1)[:, None]), axis=1)
        return A, gamma, self._sum_forces(r, R, v, Omega, y[-1]), q_dot.ravel(), v.ravel()

    def project_state(self, y: Float[np.ndarray, " coordinates"]) -> Float[np.ndarray, " coordinates"]:
        """Return the vector projected onto phi = 0 and phi_dot = 0, with the least change in the mass metric.

        The independent rows, ``rows``, are chosen anew by QR with pivoting.
        """
        s = self.system
        r, q, v, Omega = (a[0].copy() for a in self._split_states(y[None]))
        q /= np.linalg.norm(q, axis=1)[:, None]
        if self.nrows:
            A = self._evaluate_rows(r, _convert_quaternions(q), v, Omega, y[-1])[1]
            scaled = A * np.repeat(np.stack((np.ones(s.nb), 1.0 / s.gyration), axis=1), 3, axis=1).ravel()  # in metres
            scaled /= np.maximum(np.linalg.norm(scaled, axis=1), np.finfo(float).tiny)[:, None]
            _, pivots, order = sl.qr(scaled.T, mode="economic", pivoting=True)
            size = np.abs(np.diag(pivots))
            self._use_rows(np.sort(order[: int(np.sum(size > RANK * size[0]))]))
            for _ in range(SWEEPS):
                phi, A, _ = self._evaluate_rows(r, _convert_quaternions(q), v, Omega, y[-1])
                if np.max(np.abs(phi)) < 1e-15:
                    break
                change = self._solve_accelerations(A, np.zeros((s.nb, 6)), phi)
                r -= change[:, :3]
                q = (Rotation.from_quat(q) * Rotation.from_rotvec(-change[:, 3:])).as_quat()
            both = np.concatenate((v, Omega), axis=1)
            _, A, phi_t = self._evaluate_rows(r, _convert_quaternions(q), v, Omega, y[-1])
            both -= self._solve_accelerations(A, np.zeros((s.nb, 6)), A @ both.ravel() + phi_t)
            v, Omega = both[:, :3], both[:, 3:]
        return np.concatenate([*(a.ravel() for a in (r, q, v, Omega)), y[-1:]])

    def measure_violation(self, y: Float[np.ndarray, " coordinates"]) -> float:
        """Return the largest |phi| [m] of all rows, redundant ones included; 0 without rows.

        Rows of angles are multiplied by the largest radius of gyration.
        """
        r, q, v, Omega = (a[0] for a in self._split_states(y[None]))
        phi = np.abs(self._evaluate_rows(r, _convert_quaternions(q), v, Omega, y[-1])[0])
        phi[self.system.turning_rows] *= np.max(self.system.gyration)
        return float(np.max(phi, initial=0.0))

    def _solve_accelerations(self, A: np.ndarray, f: np.ndarray, required: np.ndarray) -> np.ndarray:
        """Return a (nb, 6) with M a + A^T lam = ``f``, and A a = ``required`` for the rows in use.

        ``A`` and ``required`` have all rows. With light bodies M and A are solved as one matrix, else M is eliminated.
        """
        A, required, n = A[self.rows], required[self.rows], 6 * self.system.nb
        if self.light:
            scaled = 1.0 / np.linalg.norm(A, axis=1)
            A = scaled[:, None] * A
            K = np.block([[sl.block_diag(*self.mass), A.T], [A, np.zeros((len(A), len(A)))]])
            return np.linalg.solve(K, np.concatenate((f.ravel(), scaled * required)))[:n].reshape(-1, 6)
        a = np.matmul(self.weight, f[..., None])[..., 0]
        if len(A):
            WA = multiply_blocks(A, self.weights, self.blocks)
            a -= (np.linalg.solve(A @ WA.T, A @ a.ravel() - required) @ WA).reshape(-1, 6)
        return a

    def _split_states(self, y: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return r, quaternions, r_dot and Omega (nt, nb, 3 or 4), split from vectors ``y`` (nt, 13 nb + 1)."""
        nb = self.system.nb
        r, q, v, Omega = y[:, : 3 * nb], y[:, 3 * nb : 7 * nb], y[:, 7 * nb : 10 * nb], y[:, 10 * nb : 13 * nb]
        return tuple(p.reshape(len(y), nb, -1) for p in (r, q, v, Omega))

    def _evaluate_rows(
        self, r: np.ndarray, R: np.ndarray, v: np.ndarray, Omega: np.ndarray, t: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return phi (nrows,), A (nrows, 6 nb) and phi_t (nrows,) of all rows at poses, velocities and ``t`` [s]."""
        moving_rows = self._evaluate_moving_rows(r, R, v, Omega, t)
        phi_t = np.zeros(self.nrows)
        for row, _, terms in moving_rows:
            phi_t[row] = terms.phi_t
        return self._evaluate_phi(r, R, moving_rows), self._assemble_jacobian(r, R, moving_rows), phi_t

    def _make_bodies(self, r: np.ndarray, R: np.ndarray, v: np.ndarray, Omega: np.ndarray, k: int) -> tuple[Body, Body]:
        """Return bodies i and j of joint ``k`` with pose and velocities in space; the ground is at rest."""
        ends = (self.system.joint_i[k], self.system.joint_j[k])
        ground = Body(np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))
        i, j = (ground if b == GROUND else Body(r[b], R[b], v[b], R[b] @ Omega[b]) for b in ends)
        return i, j

    def _evaluate_moving_rows(
        self, r: np.ndarray, R: np.ndarray, v: np.ndarray, Omega: np.ndarray, t: float
    ) -> list[tuple[int, int, MovingRowRates]]:
        """Evaluate the rows of driven, rolling, knife-edge and rack joints at ``t`` [s] and the motion of all bodies.

        Return for each its index among all rows, the index of its joint, and its phi, force, torque and their rates.
        """
        s, out = self.system, []
        for k, row, kind in zip(*self.moving, strict=True):
            f, f_dot, f_ddot = (a[0, 0] for a in evaluate_functions(s.joint_motion[k : k + 1], np.array([t])))
            p = Joint(s.joint_s_i[k], s.joint_s_j[k], s.joint_u[k], s.joint_n[k], s.joint_length[k], (f, f_dot, f_ddot))
            rows = ROW_FUNCTIONS[kind](*self._make_bodies(r, R, v, Omega, k), p)
            out += [(row + n, int(k), terms) for n, terms in enumerate(rows)]
        return out

    def _evaluate_phi(
        self, r: np.ndarray, R: np.ndarray, moving_rows: list[tuple[int, int, MovingRowRates]]
    ) -> np.ndarray:
        """Return phi of all rows (nrows,); ``moving_rows`` are those of ``_evaluate_moving_rows``."""
        out = np.zeros(self.nrows)
        for row, _, terms in moving_rows:
            out[row] = terms.phi
        out[self.point] = self._evaluate_gap(r, R, self.pinned)
        if len(self.line.row):
            d, (direction, _) = self._evaluate_gap(r, R, self.line.joint), self._find_line_directions(r, R)
            link = self.line.length > 0.0
            out[self.line.row] = np.where(link, 0.5, 1.0) * np.sum(d * direction, axis=1) - 0.5 * self.line.length
        u, n = self._rotate_axes(_append_ground(R, np.eye(3)))
        out[self.axis.row] = np.sum(u * n, axis=1)
        return out

    def _evaluate_gap(self, r: np.ndarray, R: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Return the vectors [m] in space (m, 3) from the point on body j to that on body i of these ``joints``."""
        at, turned = _append_ground(r, np.zeros(3)), _append_ground(R, np.eye(3))
        d = np.zeros((len(joints), 3), r.dtype)
        for body, arm, sign, *_ in self.ends:
            d += sign * (at[body[joints]] + np.einsum("jab,jb->ja", turned[body[joints]], arm[joints]))
        return d

    def _find_line_directions(self, r: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the direction of each line row's force and its point of action on body i [m], both (m, 3) in space.

        The direction is R_j n, or d / L for a distance of length L.
        """
        s, line, turned = self.system, self.line, _append_ground(R, np.eye(3))
        i, j = s.joint_i[line.joint], s.joint_j[line.joint]
        x = _append_ground(r, np.zeros(3))[i] + np.einsum("jab,jb->ja", turned[i], s.joint_s_i[line.joint])
        n = np.einsum("jab,jb->ja", turned[j], line.n)
        link = line.length > 0.0
        L = np.where(link, line.length, 1.0)[:, None]
        return np.where(link[:, None], self._evaluate_gap(r, R, line.joint) / L, n), x

    def _rotate_axes(self, turned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the directions u of body i and n of body j of all axis rows, both (m, 3) in space.

        ``turned`` (nb + 1, 3, 3) are the rotations of all bodies, then of the ground.
        """
        s, axis = self.system, self.axis
        u = np.einsum("jab,jb->ja", turned[s.joint_i[axis.joint]], axis.u)
        return u, np.einsum("jab,jb->ja", turned[s.joint_j[axis.joint]], axis.n)

    def _assemble_jacobian(
        self, r: np.ndarray, R: np.ndarray, moving_rows: list[tuple[int, int, MovingRowRates]]
    ) -> np.ndarray:
        """Return A (nrows, 6 nb) of phi_dot = A (r_dot, Omega) + phi_t; ``moving_rows`` as in ``_evaluate_phi``."""
        s, turned = self.system, _append_ground(R, np.eye(3))
        A = np.zeros((self.nrows, s.nb, 6), r.dtype)
        torque = _cross(*self._rotate_axes(turned))
        direction, x = self._find_line_directions(r, R) if len(self.line.row) else (np.zeros((0, 3)),) * 2
        for end, arm, sign, pins, lines, axes in self.ends:
            joints = self.pinned[pins]
            b, k = end[joints][:, None], self.point[pins]
            A[k, b, np.arange(3)] = sign
            # row c of -R hat(s): (s x R^T e_c)
            A[k, b, 3:] = sign * _cross(arm[joints][:, None], turned[end[joints]])
            b, k, f = end[self.line.joint[lines]], self.line.row[lines], sign * direction[lines]
            A[k, b, :3] = f
            A[k, b, 3:] = np.einsum("ja,jab->jb", _cross(x[lines] - r[b], f), turned[b])
            b = end[self.axis.joint[axes]]
            A[self.axis.row[axes], b, 3:] = sign * np.einsum("ja,jab->jb", torque[axes], turned[b])
        for row, k, terms in moving_rows:
            for b, sign in ((s.joint_i[k], 1.0), (s.joint_j[k], -1.0)):
                if b != GROUND:
                    moment = terms.T + cross(terms.x - r[b], terms.F)
                    A[row, b] += sign * np.concatenate((terms.F, R[b].T @ moment))
        return A.reshape(self.nrows, 6 * s.nb)

    def _evaluate_gamma(
        self,
        r: np.ndarray,
        R: np.ndarray,
        v: np.ndarray,
        Omega: np.ndarray,
        moving_rows: list[tuple[int, int, MovingRowRates]],
    ) -> np.ndarray:
        """Return gamma (nrows,), the value of A (r_ddot, Omega_dot) for which phi_ddot = 0."""
        s = self.system
        turned, omega = _append_ground(R, np.eye(3)), _append_ground(np.einsum("bij,bj->bi", R, Omega), np.zeros(3))
        out = np.zeros(self.nrows, r.dtype)
        centripetal, rate = np.zeros(
            (2, s.nj, 3), r.dtype
        )  # of d: its acceleration without v_dot and Omega_dot; its rate
        for body, arm, sign, *_ in self.ends:
            w, p = omega[body], np.einsum("jab,jb->ja", turned[body], arm)
            centripetal += sign * _cross(w, _cross(w, p))
            rate += sign * (_append_ground(v, np.zeros(3))[body] + _cross(w, p))
        out[self.point] = -centripetal[self.pinned]
        if len(self.line.row):
            j, link = self.line.joint, self.line.length > 0.0
            L, d, (direction, _) = (
                np.where(link, self.line.length, 1.0),
                self._evaluate_gap(r, R, j),
                self._find_line_directions(r, R),
            )
            w = omega[s.joint_j[j]]
            n_dot = np.where(link[:, None], 0.0, _cross(w, direction))
            turning = 2.0 * np.sum(n_dot * rate[j], axis=1) + np.sum(_cross(w, n_dot) * d, axis=1)
            square = np.where(link, np.sum(rate[j] ** 2, axis=1) / L, 0.0)
            out[self.line.row] = -(np.sum(direction * centripetal[j], axis=1) + turning + square)
        u, n = self._rotate_axes(turned)
        w_i, w_j = omega[s.joint_i[self.axis.joint]], omega[s.joint_j[self.axis.joint]]
        u_dot, n_dot = _cross(w_i, u), _cross(w_j, n)
        both = _cross(w_i, u_dot) * n + 2.0 * u_dot * n_dot + u * _cross(w_j, n_dot)
        out[self.axis.row] = -np.sum(both, axis=1)
        for row, k, terms in moving_rows:
            out[row] = -terms.acceleration(*self._make_bodies(r, R, v, Omega, k))
        return out

    def _sum_forces(self, r: np.ndarray, R: np.ndarray, v: np.ndarray, Omega: np.ndarray, t: float) -> np.ndarray:
        """Return f (nb, 6) without user forces: forces [space], and torques about C less Omega x J Omega [body]."""
        s = self.system
        f = np.zeros((s.nb + 1, 6), r.dtype)
        f[:-1, :3] = s.mass[:, None] * s.gravity
        w = np.einsum("bji,bj->bi", self.principal, Omega)  # avoids rounding of J Omega about an axis of little inertia
        f[:-1, 3:] = np.einsum("bij,bj->bi", self.principal, self.apart * w.take(_YZX, -1) * w.take(_ZXY, -1))
        if len(s.spring_k):
            at, turned = _append_ground(r, np.zeros(3)), _append_ground(R, np.eye(3))
            v_C, spin = _append_ground(v, np.zeros(3)), _append_ground(Omega, np.zeros(3))
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
            turned, omega = _append_ground(R, np.eye(3)), _append_ground(np.einsum("bij,bj->bi", R, Omega), np.zeros(3))
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
        """Return the sum of user forces [N, space] and torques [N m, this route's body frame] on each body (nb, 6)."""
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


def _append_ground(a: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Return ``a`` (nb, ...) with the value ``ground`` appended, so that index -1, the ground's, finds it."""
    return np.concatenate((a, ground[None]))


def _convert_quaternions(q: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (nb, 3, 3) of quaternions (x, y, z, w), which need not be of unit length."""
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
