"""What states of rigid bodies tell by the laws of mechanics, from docs/bundle.md alone, with NumPy alone."""

import math
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

Array = np.ndarray
EPS, STEP, ZERO = 1e-12, 1e-30, np.zeros(3)  # rounding, of the size of terms; step of derivatives
dot, turn = partial(np.einsum, "...k,...k"), partial(np.einsum, "tkij,kj->tki")  # products; directions to space
LETTERS = {"j": "joint", "s": "spring", "t": "torsion", "u": "user"}  # with two ends
FIELDS = {  # shapes: numbers of bodies, joints, springs, torsions, loads, user forces, then 2, 3 or 7
    "": "mass:b inertia:b33 gyration:b gravity:3 start_r:b3 start_R:b33 start_v:b3 start_Omega:b3 user_i:u user_j:u",
    "joint_": "i:j j:j s_i:j3 s_j:j3 u:j3 w:j3 n:j33 length:j motion:j7 points:j lines:j axes:j moving:j",
    "spring_": "i:s j:s p_i:s3 p_j:s3 k:s d0:s c:s",
    "torsion_": "i:t j:t u:t3 n:t23 k:t rest:t c:t",
    "load_": "i:l p:l3 force:l3 torque:l3 follows:l factor:l7",
}
SHAPES = {
    f"{key}{name}"[: -1 - len(name.split(":")[1])]: name.split(":")[1] for key in FIELDS for name in FIELDS[key].split()
}
ALIKE = (  # springs and torsions count as joints of one moving row: their length or angle, less that at rest
    "i:joint_i,spring_i,torsion_i j:joint_j,spring_j,torsion_j s_i:joint_s_i,spring_p_i,0 s_j:joint_s_j,spring_p_j,0 "
    "u:joint_u,0,torsion_u w:joint_w,0,0 n:joint_n,0,torsion_n L:joint_length,spring_d0,torsion_rest "
    "c:joint_motion,0,0 points:joint_points,0,0 lines:joint_lines,0,0 axes:joint_axes,0,0 moving:joint_moving,0,0 "
    "stiff:0,spring_k,torsion_k damp:0,spring_c,torsion_c"
)
SERIES = ("reach", "speed", "T", "V", "momentum", "E", "orthogonality", "phi", "phi_dot", "gap", "gap_rate")


def unpack(s: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return r, R, v, the matrix of Omega x, and Omega."""
    b = s[:, 1:-1].reshape(len(s), -1, 18)
    return b[..., :3], b[..., 3:12].reshape(*b.shape[:2], 3, 3), b[..., 12:15], hat(b[..., 15:]), b[..., 15:]


def norm(a: Array) -> Array:
    """Return the length over the last axis, also of complex steps."""
    return np.sqrt(dot(a, a))


def hat(w: Array) -> Array:
    """Return the matrix of w x."""
    return np.cross(np.eye(3), w[..., None, :])


def exp(w: Array) -> Array:
    """Return the rotation by the angle |w| about w."""
    x, W = norm(w)[..., None, None] / np.pi, hat(w)
    return np.eye(3) + np.sinc(x) * W + np.sinc(x / 2) ** 2 / 2 * W @ W


def log(R: Array) -> Array:
    """Return the rotation vector."""
    a = (R - np.swapaxes(R, -1, -2))[..., [2, 0, 1], [1, 2, 0]] / 2
    sine, cosine = norm(a)[..., None], (np.trace(R, 0, -2, -1)[..., None] - 1) / 2
    return a * np.where(sine > 0, np.arctan2(sine, cosine) / sine, 1)


def field(w: Array, W: Array = ZERO, turned: Array = ZERO) -> tuple[Array, Array]:
    """Return velocity or acceleration (of C, of turning) of a body's matter, with Omega, seen an angle later."""
    return w[..., :3], exp(turned) @ (hat(w[..., 3:]) + hat(W) @ hat(W))


def angle(y: Array, x: Array, less: Array) -> Array:
    """Return atan2 of complex steps, less an angle, within half a turn."""
    rate = (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)
    turned = np.arctan2(y.real, x.real) + 1j * rate - less
    return turned - 2 * np.pi * np.round(turned.real / (2 * np.pi))


def follow(c: Array, t: Array) -> Array:
    """Return the functions of time of seven numbers."""
    return c[:, 0] + t * (c[:, 1] + t * (c[:, 2] + t * c[:, 3])) + c[:, 4] * np.sin(c[:, 5] * t + c[:, 6])


ROWS = (  # kind of joint, its counted rows, which of them, phi; of speeds alone: their rate as a complex step
    *(("", "points", k, lambda j, k=k: j.d[..., k]) for k in range(3)),
    ("", "lines", 0, lambda j: np.where(j.link, (dot(j.d, j.d) / j.L - j.L) / 2, dot(j.n[0], j.d))),
    *(("", "lines", k, lambda j, k=k: dot(j.n[k], j.d)) for k in (1, 2)),
    *(("", "axes", k, lambda j, k=k: dot(j.u, j.n[k])) for k in (0, 1)),
    ("", "axes", 2, lambda j: dot(j.w, j.n[1])),
    ("driven position", "moving", 0, lambda j: dot(j.n[0], j.d) - j.f),
    ("driven distance", "moving", 0, lambda j: norm(j.d) - j.f),
    ("driven angle", "moving", 0, lambda j: dot(j.u, j.n[0]) * np.cos(j.f) + dot(j.u, j.n[1]) * np.sin(j.f)),
    ("knife edge", "moving", 0, lambda j: 1j * STEP * (dot(j.u.real, j.slip(j.x_i)) - j.f.real)),
    ("rolling disc", "moving", 0, lambda j: dot(j.n[0], j.low - j.x_j)),
    *(("rolling disc", "moving", k, lambda j, k=k: 1j * STEP * dot(j.n[k].real, j.slip(j.low))) for k in (1, 2)),
    ("rack and pinion", "moving", 0, lambda j: j.L * angle(j.sine, -dot(j.n[1], j.u), -dot(j.n[1], j.d) / j.L)),
    ("spring", "moving", 0, lambda j: norm(j.d) - j.L),
    ("torsion", "moving", 0, lambda j: angle(dot(j.u, j.n[1]), dot(j.u, j.n[0]), j.L)),
)
FAR = {  # angles whose gaps count 2-|phi|
    ("", "axes", 2): lambda j: dot(j.w, j.n[0]).real < 0,
    ("driven angle", "moving", 0): lambda j: (dot(j.u, j.n[1]) * np.cos(j.f) - dot(j.u, j.n[0]) * np.sin(j.f)).real > 0,
}


class System:
    """Bodies with all joints and forces at them, and functions of their states."""

    def __init__(self, n: dict[str, Array], kinds: Array, bodies: Array) -> None:
        own = {letter: np.isin([n[f"{name}_i"], n[f"{name}_j"]], bodies).any(0) for letter, name in LETTERS.items()}
        own |= {"b": bodies, "3": slice(None), "l": np.isin(n["load_i"], bodies)}
        vars(self).update({key: n[key][own[letters[0]]] for key, letters in SHAPES.items()})
        self.torsion_n = np.concatenate([self.torsion_n, self.torsion_n[:, :1]], 1)  # a joint has three
        self.bodies, self.rim, sizes = bodies, self.gyration.max(), [own[letter].sum() for letter in "jst"]
        for key, names in (both.split(":") for both in ALIKE.split()):
            parts = [vars(self).get(name) for name in names.split(",")]
            like = next(part for part in parts if part is not None)[:0]
            fill = [
                np.zeros((k, *like.shape[1:]), like.dtype) if a is None else a
                for a, k in zip(parts, sizes, strict=True)
            ]
            setattr(self, key, np.concatenate(fill))
        self.kinds = np.array([*kinds[own["j"]], *["spring"] * sizes[1], *["torsion"] * sizes[2]], str)
        self.moving[sizes[0] :] = 1
        self.has = np.array([(getattr(self, at) > k) & ((self.kinds == kind) | (not kind)) for kind, at, k, _ in ROWS])
        self.of, sort = self.place = np.nonzero(self.has.T)  # of rows, joint by joint: their joint, their place in ROWS
        self.joint, turning = self.of < sizes[0], [at == "axes" or kind == "driven angle" for kind, at, *_ in ROWS]
        self.metres = np.where(np.array(turning)[sort], self.rim, 1)[self.joint]
        self.arms = norm(self.joint_s_i[self.joint_i >= 0]).sum() + norm(self.joint_s_j[self.joint_j >= 0]).sum()
        self.stretch = 2 * (self.arms + self.rim) if (self.joint_points > 0).all() else math.inf
        held = [self.joint_i, self.joint_j, self.spring_i, self.spring_j, self.user_i, self.user_j]
        self.floating = np.concatenate(held).min(initial=0) >= 0  # a torsion at the ground holds no position
        start = [n[f"start_{key}"].reshape(len(n["mass"]), -1) for key in ("r", "R", "v", "Omega")]
        self.start = np.concatenate([[0], np.concatenate(start, 1).ravel(), [0]])[None]
        self.initial = self.measure(self.start)

    def spread(self, r: Array, D: Array) -> Array:
        """Return the root mean square of r + Ds over each body's matter s: of a change of poses, of velocities."""
        half = np.trace(self.inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 2 - self.inertia
        return np.sqrt(dot(r, r) + np.maximum(np.einsum("tbij,bjk,tbik->tb", D, half, D) / self.mass, 0))

    def rows(self, t: Array, i: tuple[Array, Array], i2: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return phi of all rows from the complex poses of both ends of joints, and which gaps are half a turn off."""
        j = SimpleNamespace(u=turn(i[1], self.u), w=turn(i[1], self.w), L=self.L, f=follow(self.c, t))
        j.n, j.link = [turn(i2[1], self.n[:, k]) for k in range(3)], self.kinds == "distance"
        j.x_i, j.x_j = i[0] + turn(i[1], self.s_i), i2[0] + turn(i2[1], self.s_j)
        by = "tkij,tklj,tkl->tki"  # R' R^T (x - r)
        j.slip = lambda x: sum(
            f * (r + np.einsum(by, R, R.real, (x - r).real)).imag for f, r, R in ((1 / STEP, *i), (-1 / STEP, *i2))
        )
        j.d, m = j.x_i - j.x_j, j.n[0] - dot(j.n[0], j.u)[..., None] * j.u
        j.low, j.sine = j.x_i - j.L[:, None] * m / norm(m)[..., None], dot(np.cross(*j.n[:2]), np.cross(-j.n[1], j.u))
        phi, far = np.zeros((2, len(t), *self.has.T.shape), complex)
        for k in np.flatnonzero(self.has.any(1)):
            phi[..., k], far[..., k] = ROWS[k][3](j), FAR.get(ROWS[k][:3], lambda j: False)(j)
        return phi[:, *self.place], far[:, *self.place].real > 0

    def move(self, s: Array, ahead: float = 0) -> tuple[Array, Array, list[tuple[Array, Array]]]:
        """Return phi along the motion with its rates, and the poses of both ends: a step ahead at the same rates."""
        (r, R, v, W, _), h, R0 = unpack(s), ahead + 1j * STEP, np.broadcast_to(np.eye(3), (len(s), 1, 3, 3))
        R = R + ahead * R @ W
        r, R = np.concatenate([r + h * v, 0 * R0[..., 0]], 1), np.concatenate([R + 1j * STEP * R @ W, R0], 1)
        ends = [(r[:, b], R[:, b]) for b in (self.i, self.j)]
        return *self.rows(s[:, :1] + h, *ends), ends

    def measure(self, s: Array) -> dict[str, Array]:
        """Return the series of states, in pieces of bounded memory; rates by complex steps along the motion."""
        if len(s) > (piece := max(1, 60_000 // max(len(self.bodies), len(self.kinds)))):
            parts = [self.measure(s[k : k + piece]) for k in range(0, len(s), piece)]
            return {key: np.concatenate([part[key] for part in parts]) for key in SERIES}
        r, R, v, W = (a[:, self.bodies] for a in unpack(s)[:4])
        r0, R0 = (a[:, self.bodies] for a in unpack(self.start)[:2])
        own, own_v, own_r0 = (a - np.average(a, 1, self.mass, keepdims=True) * self.floating for a in (r, v, r0))
        reach, speed, heavy = self.spread(own - own_r0, R - R0), self.spread(own_v, W), own @ self.gravity @ self.mass
        E = self.spread(v, W) ** 2 @ self.mass / 2 - r @ self.gravity @ self.mass
        orthogonality = np.linalg.norm(np.swapaxes(R, 2, 3) @ R - np.eye(3), axis=(2, 3)).max(1)
        phi, far, _ = self.move(s)
        elastic = phi.real**2 @ self.stiff[self.of] / 2
        x, rate, far = phi.real[:, self.joint], phi.imag[:, self.joint] / STEP, far[:, self.joint]
        squares = x, rate, self.metres * np.where(far, 2 - np.abs(x), x), self.metres * rate
        scales = reach.max(1), speed.max(1), speed**2 @ self.mass / 2, elastic - heavy, speed @ self.mass
        return dict(zip(SERIES, [*scales, E + elastic, orthogonality, *map(norm, squares)], strict=True))

    def differentiate(self, s: Array) -> Array:
        """Return A: the rates of all rows by those of each body, v and Omega."""
        row, t, ends = np.arange(len(self.of)), s[:, :1] + 0j, [(r.real, R.real) for r, R in self.move(s)[2]]
        A, still = np.zeros((len(s), len(row), len(self.mass) + 1, 6)), self.rows(t, *ends)[0]
        for e, body in enumerate((self.i, self.j)):
            for k, unit in enumerate(STEP * np.eye(6)):
                moved, (r, R) = list(ends), ends[e]
                moved[e] = r + 1j * unit[:3], R + 1j * R @ hat(unit[3:])
                A[:, row, body[self.of], k] += (self.rows(t, *moved)[0] - still).imag / STEP
        return A[:, :, :-1]

    def load(self, s: Array, reaction: Array) -> Array:
        """Return forces and torques of the joints on bodies."""
        return np.einsum("tr,trbk->tbk", reaction, self.differentiate(s)[:, self.joint])

    def accelerate(self, s: Array) -> tuple[Array, Array]:
        """Return the rates of v and Omega, and the joints' forces and torques on bodies, by the laws of motion."""
        (_, R, _, _, W), phi, A, times, J = (
            unpack(s),
            self.move(s)[0],
            self.differentiate(s),
            "bij,tbj->tbi",
            self.inertia,
        )
        pull = self.stiff[self.of] * phi.real + self.damp[self.of] * phi.imag / STEP
        f = -np.einsum("tr,trbk->tbk", pull, A)
        f[..., :3] += self.mass[:, None] * self.gravity
        f[..., 3:] -= np.cross(W, np.einsum(times, J, W))
        for k, b in enumerate(self.load_i):
            at = follow(self.load_factor[k : k + 1], s[:, :1])[..., None]
            at = at * (np.eye(3) if self.load_follows[k] else R[:, b].swapaxes(1, 2))
            force, torque = at @ self.load_force[k], at @ self.load_torque[k]
            force, torque = np.einsum("tij,tj->ti", R[:, b], force), np.cross(self.load_p[k], force) + torque
            f[:, b] += np.concatenate([force, torque], 1)
        h = 1e-5 / max(1, np.abs(W).max(), np.abs(self.c[:, 5]).max(initial=0))
        drift = (self.move(s, h)[0] - self.move(s, -h)[0]).imag[:, self.joint, None] / (2 * h * STEP)
        least, axes = np.linalg.eigh(J)
        least = np.where(least > EPS * least.max(), least, least.max())  # no joint turns a body without inertia
        root = np.zeros((len(J), 6, 6))
        root[:, range(3), range(3)] = 1 / np.sqrt(self.mass)[:, None]
        root[:, 3:, 3:] = axes / np.sqrt(least)[:, None] @ np.swapaxes(axes, 1, 2)
        B = np.einsum("trbi,bij->trbj", A[:, self.joint], root).reshape(len(s), -1, 6 * len(J))
        x = np.einsum(times, root, f).reshape(len(s), -1, 1)
        a = np.einsum(times, root, (x - np.linalg.pinv(B, 1e-9) @ (drift + B @ x)).reshape(f.shape))
        return a, np.concatenate([self.mass[:, None] * a[..., :3], np.einsum(times, J, a[..., 3:])], 2) - f


def follow_top(q: System, t: Array) -> Array | None:
    """Return the cosine between the arm of a symmetric body on a spherical joint and the vertical, in closed form.

    Its square of the rate is a cubic f; Weierstrass's function of z=t/2^n by its series, then doubled n times.
    """
    arm, size = -q.joint_s_i.sum(0), np.linalg.norm(q.joint_s_i)
    alone = len(q.mass) == 1 and q.kinds.tolist() == ["spherical"] and not len(q.load_i) + len(q.user_i)
    if not (alone and q.joint_i[0] == 0 and size > 0 and q.gravity.any()):
        return None
    e, up, m, J = arm / size, -q.gravity / np.linalg.norm(q.gravity), q.mass[0], q.inertia[0]
    axial, across = e @ J @ e, (np.trace(J) - e @ J @ e) / 2
    if np.abs(J - across * np.eye(3) - (axial - across) * np.outer(e, e)).max() > EPS * np.trace(J):
        return None
    (_, R, _, W, w), heavy = (a[0, 0] for a in unpack(q.start)), m * size * np.linalg.norm(q.gravity)
    I, u, du = across + m * size**2, R @ e @ up, R @ W @ e @ up
    a = (w @ w - (w @ e) ** 2) + 2 * heavy * u / I
    c, d, b = axial * (w @ e) / I, 2 * heavy / I, up @ R @ (w - e * (e @ w)) + axial * (w @ e) / I * u
    f = np.poly1d([d, -(a + c**2), 2 * b * c - d, a - b**2])
    a1, a2, a3 = f.c[:3] / [4, 6, 4]
    g2, g3 = 3 * a2**2 - 4 * a1 * a3, 2 * a1 * a2 * a3 - a2**3 - a1**2 * f.c[3]
    scale = max(abs(g2) ** 0.25, abs(g3) ** (1 / 6))
    n = np.ceil(np.log2(2 * t[t > 0] * scale + EPS)).clip(0)
    z, series = t[t > 0] / 2**n, {2: g2 / 20, 3: g3 / 28}
    for k in range(4, 24):
        series[k] = 3 * sum(series[j] * series[k - j] for j in range(2, k - 1)) / ((2 * k + 1) * (k - 3))
    x = 1 / z**2 + sum(c * z ** (2 * k - 2) for k, c in series.items())
    y = -2 / z**3 + sum((2 * k - 2) * c * z ** (2 * k - 3) for k, c in series.items())
    for k in range(int(n.max(initial=0))):
        slope = (12 * x**2 - g2) / (2 * y)
        twice = slope**2 / 4 - 2 * x
        x, y = np.where(n > k, [twice, -y - slope * (twice - x)], [x, y])
    x, cosine = x - f.deriv(2)(u) / 24, np.full(len(t), u)
    cosine[t > 0] += (-du * y + f.deriv()(u) * x / 2 + f(u) * f.deriv(3)(u) / 24) / (2 * x**2)
    return cosine


def between(s: Array, at: float) -> tuple[Array, Array]:
    """Return poses at a time by the cubics of the steps around it."""
    k = min(max(np.searchsorted(s[:, 0], at, "right") - 1, 0), len(s) - 2)
    (r, R, v, _, W), h = (a[k : k + 2] for a in unpack(s)), s[k + 1, 0] - s[k, 0]
    x, theta, told = (at - s[k, 0]) / h, log(R[0].swapaxes(1, 2) @ R[1]), h / 2 * W.sum(0)
    n = norm(theta)[:, None]
    axis = np.where(n > 0, theta, told) / np.where(n > 0, n, np.maximum(norm(told)[:, None], STEP))
    theta = theta + 2 * np.pi * np.round((dot(told, axis)[:, None] - n) / (2 * np.pi)) * axis  # the nearest turns
    n = norm(theta)[:, None]
    y, twice = np.where((n > 1e-3) & (n < np.pi), n, 1), np.cross(theta, np.cross(theta, W[1]))
    factor = np.where(y == n, 1 / y**2 - (1 + np.cos(y)) / (2 * y * np.sin(y)), 1 / 12)
    shift, turned = (
        x**2 * (3 - 2 * x) * end + h * (x * (1 - x) ** 2 * first - x**2 * (1 - x) * last)
        for end, first, last in ((r[1] - r[0], *v), (theta, W[0], W[1] + np.cross(theta, W[1]) / 2 + factor * twice))
    )
    return r[0] + shift, R[0] @ exp(turned)


def find_kinematic_defect(q: System, s: Array, length: float) -> float:
    """Return how far steps by the mean rates end from the next poses, of the path."""
    (r, R, v, _, W), h = unpack(s), np.diff(s[:, 0])[:, None, None]
    v, W = (v[1:] + v[:-1]) / 2, (W[1:] + W[:-1]) / 2
    off = q.spread(r[:-1] + h * v - r[1:], R[:-1] @ exp(h * W) - R[1:]).sum(0)
    path, told = q.spread(np.diff(r, axis=0), np.diff(R, axis=0)).sum(0), (h[..., 0] * q.spread(v, hat(W))).sum(0)
    return float((off / (np.maximum(path, told) + 0.01 * length)).max())


def find_truncation(q: System, s: Array, reaction: Array | None, speed: float) -> float:
    """Return how far rates, their changes and reactions are off, of what steps leave open."""
    (r, R, v, _, W), h, nb = unpack(s), np.diff(s[:, 0])[:, None, None], len(q.mass)
    k = 1 + np.flatnonzero(norm(W).max(1)[1:-1] * np.maximum(h[:-1], h[1:])[:, 0, 0] < 0.5)
    most = min(max(int(2e8 / (6 * nb * max(q.joint.sum(), 1) ** 2)), 4), 200, len(k))
    k = k[np.unique(np.linspace(0, len(k) - 1, most).round().astype(int))]
    if len(k) < 3 or not speed > 0:
        return 0.0
    (a, load), h1, h2, V, found = q.accelerate(s[k]), h[k - 1], h[k], np.concatenate([v, W], 2), []
    slow, rounded = speed / np.ptp(s[:, 0]), 64 * np.finfo(float).eps / np.minimum(h1, h2)[..., 0]
    steps = ((k - 1, k, h1), (k, k + 1, h2))
    poses = [np.concatenate([r[j] - r[i], log(R[i].swapaxes(2, 3) @ R[j])], 2) / d for i, j, d in steps]
    rates, spins = [(V[j] - V[i]) / d for i, j, d in steps], [w[..., 3:] for w in poses]
    counts = np.maximum(q.spread(*field(a, W[k])).max(1, keepdims=True), slow)
    for (w1, w2), told, (W1, W2), counted, size in (
        (poses, V[k], np.zeros((2, 3)), speed, np.abs(r).max() + q.rim),
        (rates, a, spins, counts, q.spread(*field(V[k])).max()),
    ):
        last, first = field(w2, W2, h2 / 2 * spins[1]), field(w1, W1, -h1 / 2 * spins[0])
        left = q.spread(last[0] - first[0], last[1] - first[1]) + 0.01 * counted + size * rounded
        found.append((q.spread(*field((h2 * w1 + h1 * w2) / (h1 + h2) - told)), left))
    if reaction is not None:
        arm = np.append(q.gyration, 0)
        np.maximum.at(arm, np.append(q.joint_i, q.joint_j), norm(np.concatenate([q.joint_s_i, q.joint_s_j])))
        per = np.repeat(np.stack([np.ones(nb), arm[:nb]], 1), 3, 1)
        before, here, after = (q.load(s[k + d], reaction[k + d]) for d in (-1, 0, 1))
        floor = 0.01 * np.maximum(norm(load / per).max(1, keepdims=True), q.mass * slow)
        found.append((norm((here - load) / per), norm((here - before) / per) + norm((after - here) / per) + floor))
    known = [np.isfinite(off + left).all(1) for off, left in found]
    sums = [(off[good].sum(0), left[good].sum(0)) for (off, left), good in zip(found, known, strict=True)]
    return float(max(np.where(off > 0, off / left, 0).max() for off, left in sums))


def measure_kept(q: System, s: Array, about: dict[str, Any]) -> Array:
    """Return a momentum, a spin or a rate along the motion."""
    (r, R, v, _, W), along = unpack(s), np.array(about["along"], float)
    if about["quantity"] == "rate":
        return W[:, int(about["body"])] @ along
    p, spin = v * q.mass[:, None], np.einsum("tbij,bjk,tbk->tbi", R, q.inertia, W)
    if about["quantity"] == "spin":
        return spin[:, int(about["body"])] @ along
    return (p if about["quantity"] == "momentum" else np.cross(r, p) + spin).sum(1) @ along
