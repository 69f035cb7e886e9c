"""The true motion of a declared mechanism, by equations of its own: Cartesian coordinates, quaternions, index 1 by SVD.

Nothing of the harness's mechanics and of its solvers is used: rows, forces, their rates and the rank are made here from
what was declared. Each row is one of four: a difference of points along a vector that a body carries, a scalar product
of two vectors that two bodies carry, a driven angle, the teeth of a rack. The rank is that of the start. DOP853 at
1e-12; after every step the state is projected onto rows and their rates.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mbsbench import Joint

from .building import Declared

RTOL, RANK = 1e-12, 1e-8
ROWS = 2000  # of the motion, beside those of the integrator


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b along the last axis, without the checks of NumPy's."""
    a, b = np.broadcast_arrays(a, b)
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((y * w - z * v, z * u - x * w, x * v - y * u), axis=-1)


def turned(R: np.ndarray, a: np.ndarray) -> np.ndarray:
    """R a, body by body."""
    return (R @ a[..., None])[..., 0]


def time_function(f: Any, t: float) -> tuple[float, float, float]:
    """A function of time, its first and its second derivative."""
    p = np.polynomial.Polynomial([*f.polynomial] or [0.0])
    a, w, angle = f.amplitude, f.frequency, f.frequency * t + f.phase
    wave = (a * np.sin(angle), a * w * np.cos(angle), -a * w * w * np.sin(angle))
    return tuple(float(q(t)) + x for q, x in zip((p, p.deriv(1), p.deriv(2)), wave, strict=True))  # type: ignore[return-value]


def matrices(p: np.ndarray) -> np.ndarray:
    """Rotation matrices of unit quaternions (w, x, y, z)."""
    w, x, y, z = np.moveaxis(p, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product of quaternions."""
    real = a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True)
    rest = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + cross(a[..., 1:], b[..., 1:])
    return np.concatenate((real, rest), axis=-1)


@dataclass(frozen=True)
class Motion:
    """Poses and velocities (space) at ``t``, and the sums of the joints' loads on each body: force, moment about C."""

    t: np.ndarray
    r: np.ndarray
    R: np.ndarray
    v: np.ndarray
    w: np.ndarray
    load: np.ndarray


class Equations:
    """Rows and forces of a mechanism; bodies are counted with the ground as the last one."""

    def __init__(self, d: Declared) -> None:
        self.d, self.n = d, len(d.bodies)
        self.mass = np.array([b.mass for b in d.bodies])
        self.J = np.array([b.inertia for b in d.bodies])
        w, V = np.linalg.eigh(self.J)
        self.J_root = np.einsum("bij,bj,bkj->bik", V, w**-0.5, V)
        points: list[tuple[int, int, int, np.ndarray, np.ndarray, np.ndarray]] = []
        angles: list[tuple[int, int, np.ndarray, np.ndarray]] = []
        self.drives: list[Joint] = []
        self.racks: list[Joint] = []
        for joint in d.joints:
            i, j = joint.i % (self.n + 1), joint.j % (self.n + 1)
            s_i, s_j = np.array(joint.s_i, dtype=float), np.array(joint.s_j, dtype=float)
            kind = joint.kind or ("revolute" if joint.axis_i is not None else "spherical")
            if kind in ("revolute", "spherical"):
                points += [(i, j, self.n, s_i, s_j, e) for e in np.eye(3)]
            if kind == "revolute":
                axis_j = np.array(joint.axis_j, dtype=float)
                angles += [(i, j, np.array(joint.axis_i), e) for e in np.linalg.svd(axis_j[None])[2][1:]]
            if kind == "prismatic":
                one, other = (frame_of(*x) for x in ((joint.axis_i, joint.across_i), (joint.axis_j, joint.across_j)))
                points += [(i, j, j, s_i, s_j, other[k]) for k in (1, 2)]
                angles += [(i, j, one[k], other[(k + 1) % 3]) for k in range(3)]
            self.drives += [joint] * (kind == "driven angle")
            self.racks += [joint] * (kind == "rack and pinion")
            assert kind in ("revolute", "spherical", "prismatic", "driven angle", "rack and pinion"), kind
        self.points = [np.array(x) for x in zip(*points, strict=True)]
        self.angles = [np.array(x) for x in zip(*angles, strict=True)] if angles else []
        self.rank = 0
        self.wound = np.array([self._angle(x, d.R, 0.0) - x.rest_angle for x in d.torsions])

    def _angle(self, x: Any, R: np.ndarray, near: float) -> float:
        """From across_j to across_i about the axis of j, within half a turn of ``near``."""
        R = np.concatenate((R, np.eye(3)[None]))
        axis, e, u = R[x.j] @ np.array(x.axis_j), R[x.j] @ np.array(x.across_j), R[x.i] @ np.array(x.across_i)
        angle = np.arctan2(u @ np.cross(axis, e), u @ e)
        return float(angle + 2.0 * np.pi * np.round((near - angle) / (2.0 * np.pi)))

    def rows(self, t: float, r: np.ndarray, R: np.ndarray, v: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, ...]:
        """phi, A (rows, 6 n), the rate that the rows ask for, and the accelerations A (v', w') that they ask for."""
        n = self.n
        r, v, w = (np.concatenate((x, np.zeros((1, 3)))) for x in (r, v, w))
        R = np.concatenate((R, np.eye(3)[None]))
        i, j, k, s_i, s_j, e = self.points
        a, b, e = turned(R[i], s_i), turned(R[j], s_j), turned(R[k], e)
        gap = r[i] + a - r[j] - b
        gap_rate = v[i] + cross(w[i], a) - v[j] - cross(w[j], b)
        m, at = len(i), np.arange(len(i))
        A = np.zeros((m, n + 1, 6))
        A[at, i] += np.concatenate((e, cross(a, e)), axis=1)
        A[at, j] -= np.concatenate((e, cross(b, e)), axis=1)
        A[at, k, 3:] += cross(e, gap)
        rate = cross(w[k], e)
        spin = cross(w[i], cross(w[i], a)) - cross(w[j], cross(w[j], b))
        # d/dt of e x gap has the part of k's own acceleration in A
        bend = np.sum(e * spin + 2.0 * rate * gap_rate + cross(w[k], rate) * gap, axis=1)
        phi, told, asked = [np.sum(e * gap, axis=1)], [np.zeros(m)], [-bend]
        out = [A]
        if self.angles:
            i, j, a, b = self.angles
            a, b = turned(R[i], a), turned(R[j], b)
            A = np.zeros((len(i), n + 1, 6))
            A[np.arange(len(i)), i, 3:] += cross(a, b)
            A[np.arange(len(i)), j, 3:] -= cross(a, b)
            a1, b1 = cross(w[i], a), cross(w[j], b)
            phi.append(np.sum(a * b, axis=1))
            told.append(np.zeros(len(i)))
            asked.append(-np.sum(cross(w[i], a1) * b + 2.0 * a1 * b1 + a * cross(w[j], b1), axis=1))
            out.append(A)
        for x in self.drives:
            f, f1, f2 = time_function(x.motion, t)
            axis, A = R[x.j] @ np.array(x.axis_j), np.zeros((1, n + 1, 6))
            A[0, x.i, 3:] += axis
            A[0, x.j, 3:] -= axis
            phi.append(np.array([self._angle(x, R[:-1], f) - f]))
            told.append(np.array([f1]))
            asked.append(np.array([f2 - cross(w[x.j], axis) @ (w[x.i] - w[x.j])]))
            out.append(A)
        for x in self.racks:  # the rack slides without turning
            axis, e, radius = R[x.j] @ np.array(x.axis_j), R[x.j] @ np.array(x.across_j), x.length
            way = e @ (r[x.i] - r[x.j])
            A = np.zeros((1, n + 1, 6))
            A[0, x.i] += np.concatenate((-e, radius * axis))
            A[0, x.j] += np.concatenate((e, -radius * axis))
            phi.append(np.array([radius * self._angle(x, R[:-1], way / radius) - way]))
            told.append(np.zeros(1))
            asked.append(np.zeros(1))
            out.append(A)
        A = np.concatenate(out)[:, :n].reshape(-1, 6 * n)
        return np.concatenate(phi), A, np.concatenate(told), np.concatenate(asked)

    def forces(
        self, t: float, r: np.ndarray, R: np.ndarray, v: np.ndarray, w: np.ndarray, wound: np.ndarray
    ) -> np.ndarray:
        """Applied forces, and moments about C less the gyroscopic ones (n, 6), all in space."""
        n, d = self.n, self.d
        out = np.zeros((n + 1, 6))
        out[:n, :3] = self.mass[:, None] * d.gravity
        spun = turned(R, turned(self.J, turned(np.swapaxes(R, 1, 2), w)))
        out[:n, 3:] = -cross(w, spun)
        r, v, w = (np.concatenate((x, np.zeros((1, 3)))) for x in (r, v, w))
        R = np.concatenate((R, np.eye(3)[None]))
        for x in d.springs:
            a, b = R[x.i] @ np.array(x.p_i), R[x.j] @ np.array(x.p_j)
            way = r[x.i] + a - r[x.j] - b
            length = np.sqrt(way @ way)
            e = way / length
            speed = e @ (v[x.i] + cross(w[x.i], a) - v[x.j] - cross(w[x.j], b))
            pull = -(x.stiffness * (length - x.rest_length) + x.damping * speed) * e
            out[x.i] += np.concatenate((pull, cross(a, pull)))
            out[x.j] -= np.concatenate((pull, cross(b, pull)))
        for x in d.loads:
            factor = 1.0 if x.factor is None else time_function(x.factor, t)[0]
            frame, arm = (R[x.i] if x.follows else np.eye(3)), R[x.i] @ np.array(x.point)
            force, torque = factor * frame @ np.array(x.force), factor * frame @ np.array(x.torque)
            out[x.i] += np.concatenate((force, torque + cross(arm, force)))
        for x, angle in zip(d.torsions, wound, strict=True):
            axis = R[x.j] @ np.array(x.axis_j)
            torque = -(x.stiffness * angle + x.damping * (axis @ (w[x.i] - w[x.j]))) * axis
            out[x.i, 3:] += torque
            out[x.j, 3:] -= torque
        return out[:n]

    def weigh(self, R: np.ndarray, A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """M^(-1/2) by body (n, 6, 6), and A M^(-1/2)."""
        root = np.zeros((self.n, 6, 6))
        root[:, range(3), range(3)] = (self.mass**-0.5)[:, None]
        root[:, 3:, 3:] = R @ self.J_root @ np.swapaxes(R, 1, 2)
        return root, np.einsum("mbi,bij->mbj", A.reshape(-1, self.n, 6), root).reshape(len(A), -1)

    def least(self, K: np.ndarray, b: np.ndarray) -> np.ndarray:
        """The least x of K x = b, at the rank of the start."""
        size = np.linalg.norm(K, axis=1)
        U, s, V = np.linalg.svd(K / size[:, None], full_matrices=False)
        if not self.rank:
            self.rank = int(np.sum(s > RANK * s[0]))
        k = self.rank
        return V[:k].T @ ((U[:, :k].T @ (b / size)) / s[:k])

    def accelerations(self, t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(v', w') and the joints' loads on the bodies, both (n, 6) in space."""
        r, R, v, w, wound = self.parts(y)
        _, A, _, asked = self.rows(t, r, R, v, w)
        root, K = self.weigh(R, A)
        free = turned(np.swapaxes(root, 1, 2), self.forces(t, r, R, v, w, wound)).reshape(-1)
        held = self.least(K, asked - K @ free)
        inverse = np.linalg.inv(root)
        return turned(root, (free + held).reshape(-1, 6)), turned(inverse, held.reshape(-1, 6))

    def parts(self, y: np.ndarray) -> tuple[np.ndarray, ...]:
        """r, R, v, w, angles of torsional springs."""
        n = self.n
        r, p, v, w, wound = np.split(y, np.cumsum((3 * n, 4 * n, 3 * n, 3 * n)))
        p = p.reshape(n, 4)
        R = matrices(p / np.linalg.norm(p, axis=1, keepdims=True))
        return r.reshape(n, 3), R, v.reshape(n, 3), w.reshape(n, 3), wound

    def start(self) -> np.ndarray:
        """y at the start."""
        p = Rotation.from_matrix(self.d.R).as_quat()[:, [3, 0, 1, 2]]
        return np.concatenate([np.asarray(x).ravel() for x in (self.d.r, p, self.d.v, self.d.w, self.wound)])

    def rate(self, t: float, y: np.ndarray) -> np.ndarray:
        """y'."""
        n = self.n
        p, w = y[3 * n : 7 * n].reshape(n, 4), y[10 * n : 13 * n].reshape(n, 3)
        a, _ = self.accelerations(t, y)
        spin = 0.5 * times(np.concatenate((np.zeros((n, 1)), w), axis=1), p)
        around = np.concatenate((w, np.zeros((1, 3))))
        R = np.concatenate((self.parts(y)[1], np.eye(3)[None]))
        wound = [(R[x.j] @ np.array(x.axis_j)) @ (around[x.i] - around[x.j]) for x in self.d.torsions]
        return np.concatenate((y[7 * n : 10 * n], spin.ravel(), a[:, :3].ravel(), a[:, 3:].ravel(), wound))

    def project(self, t: float, y: np.ndarray) -> np.ndarray:
        """The nearest state, by mass, that satisfies the rows and their rates."""
        n, y = self.n, y.copy()
        for _ in range(3):
            r, R, v, w, _ = self.parts(y)
            phi, A, _, _ = self.rows(t, r, R, v, w)
            root, K = self.weigh(R, A)
            move = turned(root, self.least(K, -phi).reshape(-1, 6))
            y[: 3 * n] += move[:, :3].ravel()
            p = y[3 * n : 7 * n].reshape(n, 4)
            p = times(np.concatenate((np.ones((n, 1)), 0.5 * move[:, 3:]), axis=1), p)
            y[3 * n : 7 * n] = (p / np.linalg.norm(p, axis=1, keepdims=True)).ravel()
        r, R, v, w, _ = self.parts(y)
        _, A, told, _ = self.rows(t, r, R, v, w)
        root, K = self.weigh(R, A)
        move = turned(root, self.least(K, told - A @ np.concatenate((v, w), axis=1).ravel()).reshape(-1, 6))
        y[7 * n : 10 * n] += move[:, :3].ravel()
        y[10 * n : 13 * n] += move[:, 3:].ravel()
        return y


def frame_of(axis: Any, across: Any) -> np.ndarray:
    """axis, across and what is normal to both, as rows."""
    axis, across = np.array(axis, dtype=float), np.array(across, dtype=float)
    return np.array([axis, across, np.cross(axis, across)])
