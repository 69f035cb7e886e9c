"""Evaluate route 2: Lagrange's equations in natural coordinates, the position of C and the columns of R (directors).

The mass matrix is constant, rigidity is six constraints a body (d_a . d_b = delta_ab), and a pin is linear in the
coordinates: no angular velocity, no cross product and no gyroscopic term appears in the equations of motion. Rigidity
is eliminated body by body, the joints by S = J H^-1 J^T; redundant rows are reduced to the range of S at the start of a
step. Where a principal inertia is small, J and the mass matrix are solved as one matrix. States are stacked along the
first axis, so that extrapolation evaluates its columns together.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..mechanics.state import State, States
from ..mechanics.system import GROUND, MultibodySystem
from ..mechanics.time_functions import evaluate_functions
from .blocks import find_touched, list_blocks, multiply_blocks
from .director_rows import ROWS, Joint, Row
from .principal import is_light, rotate_to_principal_axes
from .tape import Tape

# share of the largest eigenvalue of S below which one counts as zero; they are squares of singular values. Half and
# twice change no reference of four problems, one of them with redundant rows.
RANK = 1e-11
PAIRS = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])  # pairs of directors: the rigidity constraints
EVEN, SKEW = np.zeros((6, 3, 3)), np.zeros((3, 3, 3))
for _k, (_a, _b) in enumerate(PAIRS):
    EVEN[_k, [_a, _b], [_b, _a]] = 0.5
for _k in range(3):
    SKEW[_k, _k - 2, _k - 1], SKEW[_k, _k - 1, _k - 2] = 1.0, -1.0
# most Newton steps: each doubles the correct digits, so two take a consistent start's 1e-9 to rounding; half and twice
# change no reference of four problems
SWEEPS = 5


@dataclass
class Directors:
    """The equations of route 2 for one system.

    A vector (24 nb + 1) holds r and the directors d_1, d_2, d_3 of each body, then the rates of all these, then t.
    """

    given: MultibodySystem

    def __post_init__(self) -> None:
        """Rotate light bodies to principal axes, and tabulate the constant parts of rows and masses."""
        self.system, self.axes = rotate_to_principal_axes(self.given)
        s = self.system
        self.light = bool(np.any(is_light(s)))
        self.moments = _compute_second_moments(s.regular_inertia)  # singular for a thin disc
        self.pinned, self.point = s.point_rows()
        self.line, self.axis = s.line_rows(), s.axis_rows()
        self.link = self.line.length > 0.0
        self.moving, (self.blocks, self.bodies) = s.moving_rows(), list_blocks(find_touched(s))
        self.nrows = s.nrows
        self.pins = np.zeros((s.nrows, s.nb, 4, 3))  # point rows of J, which are constant
        for body, arm, sign in ((s.joint_i, s.joint_s_i, 1.0), (s.joint_j, s.joint_s_j, -1.0)):
            m = np.flatnonzero(body[self.pinned] != GROUND)
            b, weights = body[self.pinned[m]], np.insert(arm[self.pinned[m]], 0, 1.0, axis=1)
            for c in range(3):
                self.pins[self.point[m, c], b] = sign * weights[:, :, None] * np.eye(3)[c]
        self.range: np.ndarray | None = None  # range of S (rows, rank); found when next needed
        self._tape: Tape | None = None

    def pack_state(self, state: State) -> Float[np.ndarray, " coordinates"]:
        """Return ``state`` as a vector of this route.

        Directors are the columns of R, for a light body its principal axes, in space.
        """
        omega = np.einsum("bij,bj->bi", state.R, state.Omega)
        d = np.swapaxes(state.R @ self.axes, 1, 2)
        d_dot = np.cross(omega[:, None], d)
        place = np.concatenate((state.r[:, None], d), axis=1)
        return np.concatenate((place.ravel(), np.concatenate((state.v[:, None], d_dot), axis=1).ravel(), [state.t]))

    def states(self, z: Float[np.ndarray, "nt coordinates"]) -> States:
        """Convert vectors of this route to states; Omega, in the body frame, is the axial vector of R^T R_dot."""
        x, x_dot = self._split_states(z)
        R = np.swapaxes(x[:, :, 1:], -1, -2)
        W = np.swapaxes(R, -1, -2) @ np.swapaxes(x_dot[:, :, 1:], -1, -2)
        W = 0.5 * (W - np.swapaxes(W, -1, -2))
        Omega = np.stack((W[..., 2, 1], W[..., 0, 2], W[..., 1, 0]), axis=-1)
        R, Omega = R @ np.swapaxes(self.axes, 1, 2), np.einsum("bij,tbj->tbi", self.axes, Omega)
        return States(x[:, :, 0], R, x_dot[:, :, 0], Omega, z[:, -1])

    def units(self, size: float, speed: float, rate: float) -> Float[np.ndarray, " coordinates"]:
        """Return the scale of each entry of a vector, for tolerances, from a size [m], a speed [m/s] and a rate [1/s].

        The scale of time is infinite.
        """
        one = np.repeat([size, 1.0, speed, rate], [3, 9, 3, 9])
        return np.concatenate((np.tile(one[:12], self.system.nb), np.tile(one[12:], self.system.nb), [np.inf]))

    def rate(self, z: Float[np.ndarray, "nt coordinates"]) -> Float[np.ndarray, "nt coordinates"]:
        """Return the time derivative of each vector in ``z``: velocities, accelerations, and 1 for time."""
        nt, nb = len(z), self.system.nb
        J, H, f, required, Z, centripetal = self._evaluate_terms(z) if self._tape is None else self._tape(z)
        if len(self.system.user_i):
            laws = self._sum_user_forces(z)
            f = f + np.concatenate((laws[:, :, :3], _multiply(np.swapaxes(Z, -1, -2), laws[:, :, 3:])), axis=2)
        a = self._solve_accelerations(J, H, f, required)
        a = np.concatenate((a[:, :, :3], centripetal + _multiply(Z, a[:, :, 3:])), axis=2)
        return np.concatenate((z[:, 12 * nb : -1], a.reshape(nt, -1), np.ones((nt, 1))), axis=1)

    def compile(self) -> None:
        """Replace the algebra of ``rate`` by a compiled tape, which takes a tenth of the time."""
        self._tape = Tape(lambda z: tuple(a[0] for a in self._evaluate_terms(z[None])), 24 * self.system.nb + 1)

    def _evaluate_terms(self, z: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return J, H, forces, gamma, Z and centripetal, from which ``rate`` computes the accelerations (r_ddot, w).

        J is the Jacobian of the joints' rows by (r, w), gamma the required value of J (r_ddot, w); forces are without
        user forces. The accelerations of the directors are centripetal + Z w, of which the first keeps the body
        rigid. For H and Z see ``_reduce_rigidity``.
        """
        x, x_dot = self._split_states(z)
        Z, P, H = self._reduce_rigidity(x)
        d_dot = x_dot[:, :, 1:]
        centripetal = _multiply(P, -2.0 * np.sum(d_dot[:, :, PAIRS[:, 0]] * d_dot[:, :, PAIRS[:, 1]], axis=-1))
        rows = self._evaluate_moving_rows(x, x_dot, z[:, -1])
        J, f = self._assemble_jacobian(x, rows), self._sum_forces(x, x_dot, z)
        E_centripetal = np.einsum("nab,tnbx->tnax", self.moments, centripetal.reshape(*centripetal.shape[:2], 3, 3))
        f = np.concatenate(
            (f[:, :, :3], _multiply(np.swapaxes(Z, -1, -2), f[:, :, 3:] - E_centripetal.reshape(centripetal.shape))), 2
        )
        required = self._evaluate_gamma(x_dot, rows) - np.sum(J[..., 3:] * centripetal[:, None], axis=(2, 3))
        return self._convert_jacobian(J, Z), H, f, required, Z, centripetal

    def choose_rows(self) -> None:
        """Let the next evaluation choose the independent rows anew, since their dependence changes as bodies move."""
        self.range = None

    def project_state(self, z: Float[np.ndarray, " coordinates"]) -> Float[np.ndarray, " coordinates"]:
        """Return the vector projected onto rigidity, phi = 0 and phi_dot = 0, by least changes in the mass metric.

        The independent rows are chosen anew.
        """
        self.choose_rows()
        x, x_dot = self._split_states(z[None].copy())
        for _ in range(SWEEPS):
            U, _, Vt = np.linalg.svd(x[:, :, 1:])
            x[:, :, 1:] = U @ Vt
            rows = self._evaluate_moving_rows(x, x_dot, z[-1:])
            phi = self._evaluate_phi(x, rows)
            if np.max(np.abs(phi), initial=0.0) < 1e-15:
                break
            x = x - self._find_change(x, rows, phi).reshape(x.shape)
        P = self._reduce_rigidity(x)[1]
        stretch = sum(np.sum(x[:, :, 1 + PAIRS[:, k]] * x_dot[:, :, 1 + PAIRS[:, 1 - k]], axis=-1) for k in (0, 1))
        flat = x_dot.reshape(1, -1, 12).copy()
        flat[:, :, 3:] -= _multiply(P, stretch)
        if self.nrows:
            rows = self._evaluate_moving_rows(x, x_dot, z[-1:])
            J, speed = self._assemble_jacobian(x, rows), np.zeros((1, self.nrows))
            for k, _, row in rows:
                speed[:, k] = row.speed
            flat = flat - self._find_change(x, rows, np.einsum("tkbi,tbi->tk", J, flat) - speed)
        return np.concatenate((x.ravel(), flat.ravel(), z[-1:]))

    def _split_states(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split vectors ``z`` into positions with directors, and their rates, and return both (nt, nb, 4, 3)."""
        x, x_dot = np.split(z[:, :-1].reshape(len(z), 2, -1, 4, 3), 2, axis=1)
        return x[:, 0], x_dot[:, 0]

    def _reduce_rigidity(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return Z, P and H, which reduce the nine accelerations of a body's directors to three, w.

        With d_a_ddot = Y_ac e_c and e_a . d_b = delta_ab, rigidity determines the symmetric part of Y: P (nt, nb, 9, 6)
        times the second derivatives of d_a . d_b. The skew part is free: Z w, with Z (nt, nb, 9, 3). H (nt, nb, 6, 6)
        is the mass matrix of (r, w) if some body is light, else its inverse.
        """
        nt, s = len(x), self.system
        e = _compute_duals(x[:, :, 1:])
        Z, P = (np.einsum("kac,tncx->tnaxk", parts, e) for parts in (SKEW, EVEN))
        EZ = np.einsum("nab,tnbxk->tnaxk", self.moments, Z).reshape(nt, s.nb, 9, 3)
        Z, P = Z.reshape(nt, s.nb, 9, 3), P.reshape(nt, s.nb, 9, 6)
        turning = np.matmul(np.swapaxes(Z, -1, -2), EZ)
        H = np.zeros((nt, s.nb, 6, 6), x.dtype)
        H[:, :, range(3), range(3)] = s.mass[:, None] if self.light else 1.0 / s.mass[:, None]
        H[:, :, 3:, 3:] = turning if self.light else _compute_duals(turning)  # symmetric: its duals are its inverse
        return Z, P, H

    def _convert_jacobian(self, J: np.ndarray, Z: np.ndarray) -> np.ndarray:
        """Return the Jacobian by (r, w) (nt, nrows, nb, 6) from ``J``, that by (r, directors); ``Z`` as above."""
        return np.concatenate((J[..., :3], np.matmul(J[..., None, 3:], Z[:, None])[..., 0, :]), axis=-1)

    def _find_change(self, x: np.ndarray, rows: list[tuple[int, int, Row]], required: np.ndarray) -> np.ndarray:
        """Return the change of x (nt, nb, 12), least in the mass metric, that the Jacobian maps to ``required``."""
        Z, _, H = self._reduce_rigidity(x)
        a = self._solve_accelerations(
            self._convert_jacobian(self._assemble_jacobian(x, rows), Z),
            H,
            np.zeros((len(x), self.system.nb, 6)),
            required,
        )
        return np.concatenate((a[:, :, :3], _multiply(Z, a[:, :, 3:])), axis=2)

    def _solve_accelerations(self, J: np.ndarray, H: np.ndarray, f: np.ndarray, required: np.ndarray) -> np.ndarray:
        """Return accelerations a (nt, nb, 6) with J a = ``required`` and M a = ``f`` + J^T lam.

        ``H`` is M where some body is light, and then M and J are solved as one matrix; else H is M^-1. Redundant rows
        are reduced to independent combinations.
        """
        nt, rows, n = *required.shape, 6 * self.system.nb
        J = J.reshape(nt, rows, n)
        if self.light:
            scale = 1.0 / np.linalg.norm(J, axis=2)
            V = (
                self._choose_rows(scale[:, :, None] * (J @ np.swapaxes(J, 1, 2)) * scale[:, None])
                if rows
                else np.eye(0)
            )
            B = V.T @ (scale[:, :, None] * J)
            K = np.zeros((nt, n + V.shape[1], n + V.shape[1]))
            for b in range(self.system.nb):
                K[:, 6 * b : 6 * b + 6, 6 * b : 6 * b + 6] = H[:, b]
            K[:, n:, :n], K[:, :n, n:] = B, np.swapaxes(B, 1, 2)
            rhs = np.concatenate((f.reshape(nt, n), (scale * required) @ V), axis=1)
            return np.linalg.solve(K, rhs[..., None])[:, :n].reshape(f.shape)
        a = _multiply(H, f)
        if not rows:
            return a
        required = required - _multiply(J, a.reshape(nt, n))
        JH = multiply_blocks(J, H[:, self.bodies], self.blocks)
        S = JH @ np.swapaxes(J, 1, 2)
        scale = 1.0 / np.sqrt(np.einsum("tkk->tk", S))  # rows of similar size, whatever the masses
        S, required = scale[:, :, None] * S * scale[:, None], scale * required
        V = self._choose_rows(S)
        if V.shape[1] < rows:
            lam = np.linalg.solve(V.T @ S @ V, (required @ V)[..., None])[..., 0] @ V.T
        else:
            lam = np.linalg.solve(S, required[..., None])[..., 0]
        return a + np.matmul((scale * lam)[:, None], JH).reshape(f.shape)

    def _choose_rows(self, S: np.ndarray) -> np.ndarray:
        """Return independent combinations of the rows, as columns (rows, rank), and keep them for the step.

        ``S`` (nt, rows, rows) is J M^-1 J^T, or J J^T, with a unit diagonal. Where nothing is kept, the eigenvectors of
        its first matrix are chosen; the identity if no row is redundant.
        """
        if self.range is None:
            size, vectors = np.linalg.eigh(S[0])
            whole = size[0] > RANK * size[-1]
            self.range = np.eye(len(size)) if whole else vectors[:, size > RANK * size[-1]]
        return self.range

    def _locate_points(self, x: np.ndarray, body: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the positions (nt, n, 3) [m] in space of points ``p`` (n, 3) fixed in bodies, r + sum_a p_a d_a.

        For the ground it is ``p`` itself.
        """
        weights = np.concatenate((np.ones((len(p), 1)), p), axis=1)
        return _replace_ground(np.matmul(weights[:, None], x[:, body])[..., 0, :], body, p)

    def _rotate_directions(self, x: np.ndarray, body: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the directions in space (nt, n, 3), sum_a p_a d_a, of ``p`` (n, 3) fixed in bodies.

        For the ground it is ``p`` itself.
        """
        return _replace_ground(np.matmul(p[:, None], x[:, body, 1:])[..., 0, :], body, p)

    def _evaluate_gap(self, x: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Return the vectors [m] in space (nt, m, 3) from the point on body j to that on body i of these ``joints``."""
        s = self.system
        return self._locate_points(x, s.joint_i[joints], s.joint_s_i[joints]) - self._locate_points(
            x, s.joint_j[joints], s.joint_s_j[joints]
        )

    def _evaluate_gap_rate(self, x_dot: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Return the time derivatives [m/s] of the vectors of ``_evaluate_gap``, from the rates ``x_dot``."""
        s, at_rest = self.system, np.zeros((len(joints), 3))
        ends = (s.joint_i[joints], s.joint_s_i[joints]), (s.joint_j[joints], s.joint_s_j[joints])
        i, j = (_replace_ground(self._locate_points(x_dot, body, p), body, at_rest) for body, p in ends)
        return i - j

    def _rotate_axes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the directions u of body i and n of body j of all axis rows, both (nt, m, 3) in space."""
        s, axis = self.system, self.axis
        return self._rotate_directions(x, s.joint_i[axis.joint], axis.u), self._rotate_directions(
            x, s.joint_j[axis.joint], axis.n
        )

    def _evaluate_moving_rows(self, x: np.ndarray, x_dot: np.ndarray, t: np.ndarray) -> list[tuple[int, int, Row]]:
        """Evaluate the rows of driven, rolling, knife-edge and rack joints at times ``t`` [s].

        Return for each its index among all rows, the index of its joint, and its ``Row``.
        """
        s, nt, out = self.system, len(x), []
        for k, row, kind in zip(*self.moving, strict=True):
            f, f_dot, f_ddot = (a[:, 0] for a in evaluate_functions(s.joint_motion[k : k + 1], t))
            ground = np.broadcast_to(np.eye(4)[:, 1:], (nt, 4, 3)), np.zeros((nt, 4, 3))
            ends = (s.joint_i[k], s.joint_j[k])
            i, j = (ground if b == GROUND else (x[:, b], x_dot[:, b]) for b in ends)
            point_i, point_j = (np.insert(a[k], 0, 1.0) for a in (s.joint_s_i, s.joint_s_j))
            n = np.insert(s.joint_n[k], 0, 0.0, axis=1)
            p = Joint(point_i, point_j, np.insert(s.joint_u[k], 0, 0.0), n, s.joint_length[k], (f, f_dot, f_ddot))
            out += [(row + m, int(k), one) for m, one in enumerate(ROWS[kind](i, j, p))]
        return out

    def _evaluate_phi(self, x: np.ndarray, rows: list[tuple[int, int, Row]]) -> np.ndarray:
        """Return phi of all rows (nt, nrows); ``rows`` are those of ``_evaluate_moving_rows``."""
        out = np.zeros((len(x), self.nrows))
        for k, _, row in rows:
            out[:, k] = row.phi
        out[:, self.point] = self._evaluate_gap(x, self.pinned)
        if len(self.line.row):
            d, n = (
                self._evaluate_gap(x, self.line.joint),
                self._rotate_directions(x, self.system.joint_j[self.line.joint], self.line.n),
            )
            L = np.where(self.link, self.line.length, 1.0)
            distance = (np.sum(d * d, axis=-1) - L**2) / (2.0 * L)
            out[:, self.line.row] = np.where(self.link, distance, np.sum(d * n, axis=-1))
        u, n = self._rotate_axes(x)
        out[:, self.axis.row] = np.sum(u * n, axis=-1)
        return out

    def _assemble_jacobian(self, x: np.ndarray, rows: list[tuple[int, int, Row]]) -> np.ndarray:
        """Return the Jacobian (nt, nrows, nb, 12) of all rows by (r, directors); ``rows`` as in ``_evaluate_phi``."""
        s, axis, line = self.system, self.axis, self.line
        J = np.repeat(self.pins[None], len(x), axis=0).astype(x.dtype)
        u, n = self._rotate_axes(x)
        for body, own, other in ((s.joint_i[axis.joint], axis.u, n), (s.joint_j[axis.joint], axis.n, u)):
            m = np.flatnonzero(body != GROUND)
            J[:, axis.row[m], body[m], 1:] = own[m][:, :, None] * other[:, m][:, :, None]
        if len(line.row):
            i, j = s.joint_i[line.joint], s.joint_j[line.joint]
            d, n = self._evaluate_gap(x, line.joint), self._rotate_directions(x, j, line.n)
            direction = np.where(self.link[:, None], d / np.where(self.link, line.length, 1.0)[:, None], n)
            for body, arm, sign in ((i, s.joint_s_i[line.joint], 1.0), (j, s.joint_s_j[line.joint], -1.0)):
                m = np.flatnonzero(body != GROUND)
                weights = sign * np.insert(arm[m], 0, 1.0, axis=1)
                J[:, line.row[m], body[m]] += weights[:, :, None] * direction[:, m][:, :, None]
            m = np.flatnonzero(j != GROUND)
            J[:, line.row[m], j[m], 1:] += line.n[m][:, :, None] * d[:, m][:, :, None]  # zero for a distance
        for k, joint, row in rows:
            for b, part in ((s.joint_i[joint], row.J_i), (s.joint_j[joint], row.J_j)):
                if b != GROUND:
                    J[:, k, b] += part
        return J.reshape(len(x), self.nrows, s.nb, 12)

    def _evaluate_gamma(self, x_dot: np.ndarray, rows: list[tuple[int, int, Row]]) -> np.ndarray:
        """Return gamma (nt, nrows), the values of J x_ddot for which phi_ddot = 0; zero for rows of points."""
        s, axis, line = self.system, self.axis, self.line
        out = np.zeros((len(x_dot), self.nrows), x_dot.dtype)
        ends = (s.joint_i[axis.joint], axis.u), (s.joint_j[axis.joint], axis.n)
        u, n = (_replace_ground(self._rotate_directions(x_dot, body, p), body, np.zeros_like(p)) for body, p in ends)
        out[:, axis.row] = -2.0 * np.sum(u * n, axis=-1)
        if len(line.row):
            j, d_dot = s.joint_j[line.joint], self._evaluate_gap_rate(x_dot, line.joint)
            n_dot = _replace_ground(self._rotate_directions(x_dot, j, line.n), j, np.zeros_like(line.n))
            square = np.sum(d_dot**2, axis=-1) / np.where(self.link, line.length, 1.0)
            out[:, line.row] = -np.where(self.link, square, 2.0 * np.sum(n_dot * d_dot, axis=-1))
        for k, _, row in rows:
            out[:, k] = row.gamma
        return out

    def _sum_forces(self, x: np.ndarray, x_dot: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the generalised forces (nt, nb, 12) of weights, springs and loads, without user forces.

        A force F [N, space] at the point p of a body acts as F on r and as p_a F on d_a.
        """
        s = self.system
        Q = np.zeros((len(x), s.nb + 1, 4, 3), x.dtype)
        Q[:, :-1, 0] = s.mass[:, None] * s.gravity
        if len(s.spring_k):
            rest = np.zeros_like(s.spring_p_i)
            d = self._locate_points(x, s.spring_i, s.spring_p_i) - self._locate_points(x, s.spring_j, s.spring_p_j)
            speed_i = _replace_ground(self._locate_points(x_dot, s.spring_i, s.spring_p_i), s.spring_i, rest)
            speed_j = _replace_ground(self._locate_points(x_dot, s.spring_j, s.spring_p_j), s.spring_j, rest)
            square = np.sum(d * d, axis=-1)
            along = np.sum(d * (speed_i - speed_j), axis=-1) / square  # d_dot / d
            F = -(s.spring_k * (1.0 - s.spring_d0 / np.sqrt(square)) + s.spring_c * along)[..., None] * d
            for body, p, sign in ((s.spring_i, s.spring_p_i, 1.0), (s.spring_j, s.spring_p_j, -1.0)):
                for k in range(len(body)):
                    Q[:, body[k]] += sign * np.insert(p[k], 0, 1.0)[:, None] * F[:, k, None]
        for k, body in enumerate(s.load_i):
            factor = evaluate_functions(s.load_factor[k : k + 1], z[:, -1])[0]
            F, T = (factor * a for a in self._rotate_load(x, k))
            Q[:, body] += np.insert(s.load_p[k], 0, 1.0)[:, None] * F[:, None]
            Q[:, body, 1:] += _convert_torque(T, x[:, body, 1:])
        for k in range(len(s.torsion_k)):
            self._add_torsional_spring(Q, x, x_dot, k)
        return Q[:, :-1].reshape(len(x), s.nb, 12)

    def _sum_user_forces(self, z: np.ndarray) -> np.ndarray:
        """Return the sum of user forces and torques as generalised forces on r and directors (nt, nb, 12)."""
        s, here, x = self.system, self.states(z), self._split_states(z)[0]
        Q = np.zeros_like(x)
        for i, j, law in zip(s.user_i, s.user_j, s.user_law, strict=True):
            push = law.evaluate(here, i, j)
            for end, body in enumerate((i, j)):
                if body != GROUND:
                    Q[:, body, 0] += push[:, end]
                    Q[:, body, 1:] += _convert_torque(push[:, 2 + end], x[:, body, 1:])
        return Q.reshape(len(x), s.nb, 12)

    def _add_torsional_spring(self, Q: np.ndarray, x: np.ndarray, x_dot: np.ndarray, k: int) -> None:
        """Add the generalised forces of torsional spring ``k`` to ``Q`` (nt, nb + 1, 4, 3) in place.

        They are its moment times the derivatives, by the directors, of its angle atan2(q, p), p = u . e, q = u . b,
        with u on body i, and e, b on body j.
        """
        s = self.system
        (i, j), ends = (s.torsion_i[k], s.torsion_j[k]), []
        for b, a in ((i, s.torsion_u[k]), (j, s.torsion_n[k, 0]), (j, s.torsion_n[k, 1])):
            here = (np.broadcast_to(a, (len(x), 3)), np.zeros((len(x), 3))) if b == GROUND else None
            ends.append(here or (a @ x[:, b, 1:], a @ x_dot[:, b, 1:]))
        (u, u_dot), (e, e_dot), (b, b_dot) = ends
        p, q = np.sum(u * e, axis=-1), np.sum(u * b, axis=-1)
        p_dot, q_dot = np.sum(u_dot * e + u * e_dot, axis=-1), np.sum(u_dot * b + u * b_dot, axis=-1)
        turn = np.arctan2(q, p) - s.torsion_rest[k]
        turn -= 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
        turn += s.torsion_wound[k]
        square = p * p + q * q
        M = -(s.torsion_k[k] * turn + s.torsion_c[k] * (p * q_dot - q * p_dot) / square) / square
        p, q = (M * p)[:, None], (M * q)[:, None]
        Q[:, i, 1:] += s.torsion_u[k][:, None] * (p * b - q * e)[:, None]
        for a, direction in ((s.torsion_n[k, 1], p * u), (s.torsion_n[k, 0], -q * u)):
            Q[:, j, 1:] += a[:, None] * direction[:, None]

    def _rotate_load(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the force [N] and torque [N m] of load ``k`` in space, both (nt, 3), before its factor of time."""
        s, d = self.system, x[:, self.system.load_i[k], 1:]
        both = (s.load_force[k], s.load_torque[k])
        if s.load_follows[k]:
            return tuple(np.einsum("a,tac->tc", a, d) for a in both)  # type: ignore[return-value]
        return tuple(np.broadcast_to(a, (len(x), 3)) for a in both)  # type: ignore[return-value]


def _compute_duals(d: np.ndarray) -> np.ndarray:
    """Return the dual vectors e_a (..., 3, 3) of ``d``, its vectors as rows: e_a . d_b = delta_ab."""
    across = np.cross(d[..., [1, 2, 0], :], d[..., [2, 0, 1], :])
    out: np.ndarray = across / np.sum(across[..., :1, :] * d[..., :1, :], axis=-1, keepdims=True)
    return out


def _multiply(a: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the products of matrices ``a`` (..., m, n) and vectors ``x`` (..., n)."""
    out: np.ndarray = np.matmul(a, x[..., None])[..., 0]
    return out


def _convert_torque(T: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return the forces F_a = T x d_a / 2 on the directors (nt, 3, 3) that replace a torque T: sum d_a x F_a = T."""
    out: np.ndarray = 0.5 * np.cross(T[:, None], d)
    return out


def _compute_second_moments(J: np.ndarray) -> np.ndarray:
    """Return the second moments of mass, the integrals of x x^T dm (nb, 3, 3) [kg m2], from inertia tensors ``J``."""
    own = np.einsum("bii->bi", J)
    others = np.stack((np.roll(own, 1, axis=1), np.roll(own, 2, axis=1)))
    out: np.ndarray = -J
    # the difference of the two larger ones first: no cancellation
    out[:, range(3), range(3)] = 0.5 * (np.max(others, axis=0) - own + np.min(others, axis=0))
    return out


def _replace_ground(values: np.ndarray, body: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """Return ``values`` (nt, n, 3), replaced by ``ground`` where ``body`` is the ground."""
    return np.where((body == GROUND)[:, None], ground, values)
