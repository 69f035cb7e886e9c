"""Check bundles of results, from docs/bundle.md alone: recompute what records state. See README.md."""

import hashlib
import io
import json
import math
import re
import sys
import zipfile
from collections import Counter, defaultdict
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

Array = np.ndarray
NAMES = re.compile(r"((runs|references|series)/[\w-]{1,64}\.npy|(problems/)?[\w.-]{1,64}\.(json|toml|txt))", re.ASCII)
MAX_FILES, MAX_BYTES, MAX_JSON, MAX_VALUES = 20_000, 1 << 29, 1 << 24, 3_000_000
REL, EPS, STEP = 1e-6, 1e-12, 1e-30  # tolerances: of the recorded number, of its terms' size; step of derivatives
dot = partial(np.einsum, "...k,...k")  # the product over the last axis
SOFT = {"motion", "velocity", "rows"}  # the reasons of `inaccurate`
LETTERS = {"j": "joint", "s": "spring", "t": "torsion", "u": "user"}  # with two ends
FIELDS = (  # shapes: numbers of bodies, joints, springs, torsions, loads, user forces, then 3 or 7
    "mass:b inertia:b33 gyration:b gravity:3 start_r:b3 start_R:b33 start_v:b3 start_Omega:b3 joint_i:j joint_j:j "
    "joint_s_i:j3 joint_s_j:j3 joint_u:j3 joint_w:j3 joint_n:j33 joint_length:j joint_motion:j7 joint_points:j "
    "joint_lines:j joint_axes:j joint_moving:j spring_i:s spring_j:s spring_p_i:s3 spring_p_j:s3 spring_k:s "
    "spring_d0:s spring_c:s torsion_i:t torsion_j:t torsion_u:t3 torsion_n:t33 torsion_k:t torsion_rest:t torsion_c:t "
    "load_i:l load_p:l3 load_force:l3 load_torque:l3 load_follows:l load_factor:l7 user_i:u user_j:u"
)
SHAPES = dict(field.split(":") for field in FIELDS.split())
LIMITS = {"energy": 0.1, "orthogonality": 1e-3, "gap": 0.01, "gap_rate": 0.05}  # of the scales
SERIES = ("reach", "speed", "T", "V", "momentum", "E", "orthogonality", "phi", "phi_dot", "gap", "gap_rate")
ALIKE = (  # springs and torsions count as joints of one moving row: their length or angle, less that at rest
    "i:joint_i,spring_i,torsion_i j:joint_j,spring_j,torsion_j s_i:joint_s_i,spring_p_i,0 s_j:joint_s_j,spring_p_j,0 "
    "u:joint_u,0,torsion_u w:joint_w,0,0 n:joint_n,0,torsion_n L:joint_length,spring_d0,torsion_rest "
    "c:joint_motion,0,0 points:joint_points,0,0 lines:joint_lines,0,0 axes:joint_axes,0,0 moving:joint_moving,0,0 "
    "stiff:0,spring_k,torsion_k damp:0,spring_c,torsion_c"
)


def demand(condition: Any, message: str) -> None:
    """Refuse the bundle unless the condition holds."""
    if not condition:
        raise ValueError(message)


def read_files(path: Path) -> dict[str, bytes]:
    """Return the members of the archive after its directory, sizes, names and digests have been verified."""
    demand(path.is_file() and path.stat().st_size <= MAX_BYTES, "no file of at most 512 MB")
    packed, files = path.read_bytes(), {}
    demand(packed.count(b"PK\1\2") <= MAX_FILES, "a directory of more than 20,000 files")
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        demand(sum(m.file_size for m in archive.infolist()) <= MAX_BYTES, "more than 512 MB unpacked")
        for member in archive.infolist():
            name = member.orig_filename
            demand(NAMES.fullmatch(name) and name not in files, f"unexpected or duplicate file {name[:80]!r}")
            plain = member.external_attr >> 28 in {0, 8}
            demand(plain and member.compress_type in {0, 8, 12}, f"{name} is a link or packed unusually")
            with archive.open(member) as stream:
                files[name] = stream.read(member.file_size)
    lines = files.pop("manifest-sha256.txt").decode("ascii").splitlines()
    wrong = set(lines) ^ {f"{hashlib.sha256(raw).hexdigest()}  {name}" for name, raw in files.items()}
    demand(not wrong and len(lines) == len(files), f"{sorted(wrong)[:1]!r:.160} differs from the manifest")
    return files


def parse_json(raw: bytes, name: str) -> Any:
    """Parse bounded JSON without repeated keys."""
    demand(len(raw) <= MAX_JSON and sum(map(raw.count, (b",", b"[", b"{"))) <= MAX_VALUES, f"{name} is too large")
    return json.loads(raw, object_pairs_hook=lambda a: dict(a) if len(dict(a)) == len(a) else demand(0, "a key twice"))


def read_states(raw: bytes, nb: int, name: str) -> Array:
    """Return states, a row each: t, r, R, v, Omega of each body, what is stated of it; there are no pickles."""
    demand(raw[:8] == b"\x93NUMPY\1\0" and b"'<f8'" in raw[:128], f"{name}: not an NPY file of float64")
    states = np.frombuffer(raw, "<f8", offset=128).reshape(2 + 18 * nb, -1).T
    demand(len(states) and not (np.diff(states[:, 0]) <= 0).any(), f"{name}: no times, or not in order")
    return states


def hat(w: Array) -> Array:
    """Return the matrix of w x."""
    return np.cross(np.eye(3), w[..., None, :])


def exp(w: Array) -> Array:
    """Return the rotation by the angle |w| about w."""
    x, W = norm(w)[..., None, None] / np.pi, hat(w)
    return np.eye(3) + np.sinc(x) * W + np.sinc(x / 2) ** 2 / 2 * W @ W


def log(R: Array) -> Array:
    """Return the rotation vector of R."""
    a = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1) / 2
    sine = norm(a)[..., None]
    return a * np.where(sine > 0, np.arctan2(sine, (np.trace(R, 0, -2, -1)[..., None] - 1) / 2) / sine, 1)


def unpack(s: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return r, R, v, the matrix of Omega x, and Omega."""
    b = s[:, 1:-1].reshape(len(s), -1, 18)
    return b[..., :3], b[..., 3:12].reshape(*b.shape[:2], 3, 3), b[..., 12:15], hat(b[..., 15:]), b[..., 15:]


def norm(a: Array) -> Array:
    """Return the length over the last axis, also of complex steps."""
    return np.sqrt(dot(a, a))


def angle(y: Array, x: Array, less: Array) -> Array:
    """Return atan2 of complex steps, less an angle, within half a turn."""
    rate = (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)
    turned = np.arctan2(y.real, x.real) + 1j * rate - less
    return turned - 2 * np.pi * np.round(turned.real / (2 * np.pi))


def turn(R: Array, a: Array) -> Array:
    """Return directions of bodies, turned to space."""
    return np.einsum("tkij,kj->tki", R, a)


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
    ("spring", "moving", 0, lambda j: norm(j.d) - j.L),
    ("torsion", "moving", 0, lambda j: angle(dot(j.u, j.n[1]), dot(j.u, j.n[0]), j.L)),
    ("rack and pinion", "moving", 0, lambda j: j.L * angle(j.sine, -dot(j.n[1], j.u), -dot(j.n[1], j.d) / j.L)),
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
        self.bodies, self.rim, ends = bodies, self.gyration.max(), (self.joint_i, self.spring_i, self.torsion_i)
        for key, names in (field.split(":") for field in ALIKE.split()):
            parts = [vars(self).get(name) for name in names.split(",")]
            like = next(part for part in parts if part is not None)
            fill = (np.zeros((len(end), *like.shape[1:]), like.dtype) for end in ends)
            setattr(self, key, np.concatenate([b if a is None else a for a, b in zip(parts, fill, strict=True)]))
        self.kinds = np.array([*kinds[own["j"]], *["spring"] * len(ends[1]), *["torsion"] * len(ends[2])], str)
        self.moving[len(ends[0]) :] = 1
        self.has = np.array([(getattr(self, at) > k) & ((self.kinds == kind) | (not kind)) for kind, at, k, _ in ROWS])
        self.of, self.sort = np.nonzero(self.has.T)  # of rows, joint by joint: their joint, and their place in ROWS
        self.joint = self.of < len(ends[0])
        turning = np.array([at == "axes" or kind == "driven angle" for kind, at, *_ in ROWS])
        self.metres = np.where(turning[self.sort], self.rim, 1)[self.joint]
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
        j = SimpleNamespace(u=turn(i[1], self.u), w=turn(i[1], self.w), L=self.L, link=self.kinds == "distance")
        j.n, c = [turn(i2[1], self.n[:, k]) for k in range(3)], self.c.T
        j.x_i, j.x_j = i[0] + turn(i[1], self.s_i), i2[0] + turn(i2[1], self.s_j)
        j.d, j.f = j.x_i - j.x_j, c[0] + t * (c[1] + t * (c[2] + t * c[3])) + c[4] * np.sin(c[5] * t + c[6])
        by = "tkij,tklj,tkl->tki"  # R' R^T (x - r)
        rate = [lambda x, e=e: (e[0] + np.einsum(by, e[1], e[1].real, (x - e[0]).real)).imag / STEP for e in (i, i2)]
        j.slip = lambda x: rate[0](x) - rate[1](x)
        m, j.sine = j.n[0] - dot(j.n[0], j.u)[..., None] * j.u, dot(np.cross(j.n[0], j.n[1]), np.cross(-j.n[1], j.u))
        j.low = j.x_i - j.L[:, None] * m / norm(m)[..., None]
        phi, far = np.zeros((len(t), *self.has.shape), complex), np.zeros((len(t), *self.has.shape), bool)
        for k in np.flatnonzero(self.has.any(1)):
            phi[:, k], far[:, k] = ROWS[k][3](j), FAR.get(ROWS[k][:3], lambda j: False)(j)
        return phi[:, self.sort, self.of], far[:, self.sort, self.of]

    def move(self, s: Array, ahead: float = 0) -> tuple[Array, Array, list[tuple[Array, Array]]]:
        """Return phi along the motion with its rates, and the poses of both ends: a step ahead at the same rates."""
        (r, R, v, W, _), h = unpack(s), ahead + 1j * STEP
        r = np.concatenate([r + h * v, np.zeros((len(s), 1, 3))], 1)
        R = np.concatenate([R + ahead * R @ W, np.broadcast_to(np.eye(3), (len(s), 1, 3, 3))], 1).astype(complex)
        R[:, :-1] += 1j * STEP * R[:, :-1].real @ W
        ends = [(r[:, b], R[:, b]) for b in (self.i, self.j)]
        return *self.rows(s[:, :1] + h, *ends), ends

    def measure(self, s: Array) -> dict[str, Array]:
        """Return the series of states, in pieces of bounded memory; rates by complex steps along the motion."""
        if len(s) > (piece := max(1, 60_000 // max(len(self.bodies), len(self.kinds)))):
            parts = [self.measure(s[k : k + piece]) for k in range(0, len(s), piece)]
            return {key: np.concatenate([part[key] for part in parts]) for key in SERIES}
        r, R, v, W = (a[:, self.bodies] for a in unpack(s)[:4])
        r0, R0 = (a[:, self.bodies] for a in unpack(self.start)[:2])
        common = (np.average(a, 1, self.mass, keepdims=True) * self.floating for a in (r, v, r0))
        own, own_v, own_r0 = (a - c for a, c in zip((r, v, r0), common, strict=True))
        reach, speed, heavy = self.spread(own - own_r0, R - R0), self.spread(own_v, W), own @ self.gravity @ self.mass
        E = self.spread(v, W) ** 2 @ self.mass / 2 - r @ self.gravity @ self.mass
        orthogonality = np.linalg.norm(np.swapaxes(R, 2, 3) @ R - np.eye(3), axis=(2, 3)).max(1)
        phi, far, _ = self.move(s)
        elastic = (phi.real**2 @ self.stiff[self.of]) / 2
        (x, rate), far = ((a[:, self.joint]) for a in (phi.real, phi.imag / STEP)), far[:, self.joint]
        squares = [x, rate, self.metres * np.where(far, 2 - np.abs(x), x), self.metres * rate]
        scales = reach.max(1), speed.max(1), speed**2 @ self.mass / 2, elastic - heavy, speed @ self.mass
        return dict(zip(SERIES, [*scales, E + elastic, orthogonality, *map(norm, squares)], strict=True))

    def differentiate(self, s: Array) -> Array:
        """Return A: the rates of all rows by those of each body, v and Omega."""
        row, t, ends = np.arange(len(self.of)), s[:, :1] + 0j, [(a.real, b.real) for a, b in self.move(s)[2]]
        A, still = np.zeros((len(s), len(row), len(self.mass) + 1, 6)), self.rows(t, *ends)[0]
        for e, body in enumerate((self.i, self.j)):
            for k, unit in enumerate(1j * STEP * np.eye(6)):
                a, b = ends[e]
                moved = [*ends[:e], (a + unit[:3], b + b @ hat(unit[3:].imag) * 1j), *ends[e + 1 :]]
                A[:, row, body[self.of], k] += (self.rows(t, *moved)[0] - still).imag / STEP
        return A[:, :, :-1]

    def load(self, s: Array, reaction: Array) -> Array:
        """Return forces and torques of the joints on bodies."""
        return np.einsum("tr,trbk->tbk", reaction, self.differentiate(s)[:, self.joint])

    def accelerate(self, s: Array) -> tuple[Array, Array]:
        """Return the rates of v and Omega, and the joints' forces and torques on bodies, by the laws of motion."""
        (_, R, _, _, Omega), phi, A, nb = unpack(s), self.move(s)[0], self.differentiate(s), len(self.mass)
        h = 1e-5 / max(1, np.abs(Omega).max(), np.abs(self.c[:, 5]).max(initial=0))
        drift = (self.move(s, h)[0] - self.move(s, -h)[0]).imag / (2 * h * STEP)
        f = np.zeros((len(s), nb, 6))
        f[..., :3] = self.mass[:, None] * self.gravity
        f[..., 3:] = -np.cross(Omega, np.einsum("bij,tbj->tbi", self.inertia, Omega))
        pull = self.stiff[self.of] * phi.real + self.damp[self.of] * phi.imag / STEP
        f -= np.einsum("tr,trbk->tbk", pull, A)
        c, t = self.load_factor.T, s[:, :1]
        size = c[0] + t * (c[1] + t * (c[2] + t * c[3])) + c[4] * np.sin(c[5] * t + c[6])
        for k, b in enumerate(self.load_i):
            force, torque = ((R[:, b] if self.load_follows[k] else np.eye(3)) @ a[k] * size[:, k : k + 1]
                             for a in (self.load_force, self.load_torque))  # fmt: skip
            body = np.einsum("tij,tni->tnj", R[:, b], np.stack([force, torque], 1))
            f[:, b] += np.concatenate([force, np.cross(self.load_p[k], body[:, 0]) + body[:, 1]], 1)
        A, drift = A[:, self.joint], drift[:, self.joint]
        J, axes = np.linalg.eigh(self.inertia)
        J = np.where(J > EPS * J.max(), J, J.max())  # joints alone turn a body about an axis without inertia
        root = np.zeros((nb, 6, 6))
        root[:, range(3), range(3)] = 1 / np.sqrt(self.mass)[:, None]
        root[:, 3:, 3:] = axes / np.sqrt(J)[:, None] @ np.swapaxes(axes, 1, 2)
        B = np.einsum("trbi,bij->trbj", A, root).reshape(len(s), A.shape[1], 6 * nb)
        x = np.einsum("bij,tbj->tbi", root, f).reshape(len(s), -1, 1)
        x = x - np.linalg.pinv(B, 1e-9) @ (drift[..., None] + B @ x)
        a = np.einsum("bij,tbj->tbi", root, x.reshape(f.shape))
        Ja = np.einsum("bij,tbj->tbi", self.inertia, a[..., 3:])
        return a, np.concatenate([self.mass[:, None] * a[..., :3], Ja], 2) - f


class Problem:
    """The validated numbers of a problem, its mechanisms and its exact motion."""

    def __init__(self, raw: bytes, reference: bytes | None, name: str) -> None:
        data, sizes, numbers = parse_json(raw, name), {"3": 3, "7": 7}, {}
        for key, letters in SHAPES.items():
            value = data["numbers"][key]
            shape = tuple(sizes.setdefault(letter, len(value)) for letter in letters)
            a = np.array(value, float).reshape(shape) if 0 in shape else np.array(value, float)
            demand(a.shape == shape and np.isfinite(a).all(), f"{name}: {key} is not finite or of shape {shape}")
            body = len(letters) == 1 and key.endswith(("_i", "_j"))
            demand(not body or ((a >= -1) & (a < sizes["b"])).all(), f"{name}: {key} beyond the bodies")
            numbers[key] = a.astype(int) if body else a
        self.nb, self.t_end = sizes["b"], float(data["t_end_s"])
        kinds = np.array([str(kind)[:40] for kind in data["joint_kinds"]], str)
        sound = 0 < self.nb <= 2000 and max(sizes.values()) <= 50 * self.nb + 50 and (numbers["mass"] > 0).all()
        described = {row[0] for row in ROWS}.issuperset(kinds[numbers["joint_moving"] > 0]) and len(kinds) == sizes["j"]
        demand(sound and described and 0 < self.t_end < math.inf, f"{name}: bodies, masses, joint_kinds or t_end_s")
        self.laws = tuple(LIMITS)[: 4 if sizes["j"] and not data["literal_start"] else 2]
        self.whole, group = System(numbers, kinds, np.arange(self.nb)), np.arange(self.nb)
        for i, j in np.concatenate([np.stack([numbers[f"{k}_i"], numbers[f"{k}_j"]], 1) for k in LETTERS.values()]):
            group[group == group[i]] = group[j] if min(i, j) >= 0 else group[i]
        self.parts = [System(numbers, kinds, np.flatnonzero(group == g)) for g in np.unique(group)]
        self.horizon, self.exact = -math.inf, self.whole.start[:0]
        if reference is not None:
            self.horizon, self.exact = float(data["reference"]["horizon_s"]), read_states(reference, self.nb, name)
            demand(np.isfinite(self.exact).all(), f"{name}: reference not finite")
        t, T = self.exact[:, 0], min(self.t_end, self.horizon)
        even = np.abs(t / T * 2000 - np.round(t / T * 2000)) < 1e-7
        self.sizing = np.concatenate([self.whole.start, self.exact[even & (t <= T * (1 + EPS))]])
        self.kept, self.user = data["invariants"], sizes["u"] or data["not_serialised"]
        forces = any(numbers[key].any() for key in ("spring_c", "torsion_c", "joint_motion"))
        self.has_work = bool(forces or sizes["l"] or self.user)

    def find_scales(self, q: System, s: Array, first: float) -> tuple[dict[str, Array], dict[str, float]]:
        """Return what a system reaches, and its scales: of exact states, and beyond until a law is first broken."""
        m, known, late = q.measure(s), q.measure(self.sizing), (s[:, 0] > self.horizon * (1 + EPS)) & (s[:, 0] < first)
        m["energy"] = s[:, -1] if self.has_work else m["E"] - (q.initial if s[0, 0] else m)["E"][0]
        reach, speed, T, V, momentum = (np.append(known[key], m[key][late]) for key in SERIES[:5])
        T[len(known["T"]) :] -= np.maximum(m["energy"][late], 0)  # energy gained was not there to be exchanged
        size = {"reach": reach.max(), "gap_rate": speed.max(), "energy": max(T.max(), np.ptp(V)), "orthogonality": 1.0}
        size |= {"momentum": momentum.max()}
        size |= {"length": (known["reach"] if len(self.exact) else reach).max(), "gap": min(reach.max(), q.stretch)}
        return m, size


def between(s: Array, at: float) -> tuple[Array, Array]:
    """Return poses at a time by the cubics of the steps around it."""
    (r, R, v, _, Omega), k = unpack(s), min(max(np.searchsorted(s[:, 0], at, "right") - 1, 0), len(s) - 2)
    h, two, pi = s[k + 1, 0] - s[k, 0], slice(k, k + 2), 2 * np.pi
    x = (at - s[k, 0]) / h
    theta, told = log(R[k].swapaxes(1, 2) @ R[k + 1]), h / 2 * Omega[two].sum(0)
    n, told_n = norm(theta)[:, None], norm(told)[:, None]
    axis = np.where(n > 0, theta / n, np.where(told_n > 0, told / told_n, 0))
    theta = theta + pi * np.round((dot(told, axis)[:, None] - n) / pi) * axis  # the turns nearest to those told
    n = norm(theta)[:, None]
    y = np.where((n > 1e-3) & (n < np.pi), n, 1)
    factor = np.where(y == n, 1 / y**2 - (1 + np.cos(y)) / (2 * y * np.sin(y)), 1 / 12)
    last = Omega[k + 1] + np.cross(theta, Omega[k + 1]) / 2 + factor * np.cross(theta, np.cross(theta, Omega[k + 1]))

    def cubic(end: Array, first: Array, last: Array) -> Array:
        return x**2 * (3 - 2 * x) * end + h * (x * (1 - x) ** 2 * first - x**2 * (1 - x) * last)

    return r[k] + cubic(r[k + 1] - r[k], v[k], v[k + 1]), R[k] @ exp(cubic(theta, Omega[k], last))


def find_kinematic_defect(q: System, s: Array, length: float) -> float:
    """Return how far steps by the mean rates end from the next poses, of the path."""
    (r, R, v, _, W), h = unpack(s), np.diff(s[:, 0])[:, None, None]
    v, W = (v[1:] + v[:-1]) / 2, (W[1:] + W[:-1]) / 2
    off = q.spread(r[:-1] + h * v - r[1:], R[:-1] @ exp(h * W) - R[1:]).sum(0)
    path = np.maximum(q.spread(np.diff(r, axis=0), np.diff(R, axis=0)).sum(0), (h[..., 0] * q.spread(v, hat(W))).sum(0))
    return float((off / (path + 0.01 * length)).max())


def find_truncation(q: System, s: Array, reaction: Array | None, speed: float) -> float:
    """Return how far rates, their changes and reactions are off, of what steps leave open."""
    (r, R, v, _, W), t, nb = unpack(s), s[:, 0], len(q.mass)
    h, spin = np.diff(t), norm(W).max(1)
    k = 1 + np.flatnonzero(spin[1:-1] * np.maximum(h[:-1], h[1:]) < 0.5)
    most = min(max(int(2e8 / (6 * nb * max(q.joint.sum(), 1) ** 2)), 4), 200, len(k))
    k = k[np.unique(np.linspace(0, len(k) - 1, most).round().astype(int))]
    if len(k) < 3 or not speed > 0:
        return 0.0
    a, load = q.accelerate(s[k])
    h1, h2 = h[k - 1, None, None], h[k, None, None]
    slow, rounded = speed / (t[-1] - t[0]), 64 * np.finfo(float).eps / np.minimum(h1, h2)[..., 0]

    def split(w: Array) -> tuple[Array, Array]:
        return w[..., :3], hat(w[..., 3:])

    def field(w: Array, W: Array, angle: Array) -> list[Array]:
        return [w[..., :3], exp(angle) @ (hat(w[..., 3:]) + hat(W) @ hat(W))]

    def ratio(off: Array, left: Array) -> float:
        known = np.isfinite(off + left).all(1)
        off, left = off[known].sum(0), left[known].sum(0)
        return float(np.divide(off, left, out=np.zeros(nb), where=off > 0).max())

    poses = [np.concatenate([(r[j] - r[i]) / d, log(R[i].swapaxes(2, 3) @ R[j]) / d], 2)
             for i, j, d in ((k - 1, k, h1), (k, k + 1, h2))]  # fmt: skip
    V = np.concatenate([v, W], 2)
    rates = [(V[k] - V[k - 1]) / h1, (V[k + 1] - V[k]) / h2]
    turns = -h1 / 2 * poses[0][..., 3:], h2 / 2 * poses[1][..., 3:]
    there = q.spread(*field(a, W[k], 0 * W[k])).max(1, keepdims=True)
    big, fast, found = np.abs(r).max() + q.rim, q.spread(*split(V[k])).max(), []
    for (w1, w2), told, spins, counts, size in (
        (poses, V[k], (0 * W[k], 0 * W[k]), speed, big),
        (rates, a, (poses[0][..., 3:], poses[1][..., 3:]), np.maximum(there, slow), fast),
    ):
        first, last = field(w1, spins[0], turns[0]), field(w2, spins[1], turns[1])
        left = q.spread(last[0] - first[0], last[1] - first[1]) + 0.01 * counts + size * rounded
        found.append(ratio(q.spread(*split((h2 * w1 + h1 * w2) / (h1 + h2) - told)), left))
    if reaction is not None:
        arm = np.append(q.gyration, 0)
        for body, at in ((q.joint_i, q.joint_s_i), (q.joint_j, q.joint_s_j)):
            np.maximum.at(arm, body, norm(at))

        def weigh(load: Array) -> Array:
            return np.sqrt(dot(load[..., :3], load[..., :3]) + dot(load[..., 3:], load[..., 3:]) / arm[:nb] ** 2)

        before, here, after = (q.load(s[k + d], reaction[k + d]) for d in (-1, 0, 1))
        floor = 0.01 * np.maximum(weigh(load).max(1, keepdims=True), q.mass * slow)
        found.append(ratio(weigh(here - load), weigh(here - before) + weigh(after - here) + floor))
    return max(found)


def measure_kept(q: System, s: Array, about: dict[str, Any]) -> Array:
    """Return an invariant along the motion."""
    (r, R, v, _, W), along = unpack(s), np.array(about["along"], float)
    if about["quantity"] == "rate":
        return W[:, int(about["body"])] @ along
    p, spin = v * q.mass[:, None], np.einsum("tbij,bjk,tbk->tbi", R, q.inertia, W)
    if about["quantity"] == "spin":
        return spin[:, int(about["body"])] @ along
    return (p if about["quantity"] == "momentum" else np.cross(r, p) + spin).sum(1) @ along


class Report:
    """What was compared, and what disagrees."""

    def __init__(self) -> None:
        self.run, self.runs, self.numbers, self.findings, self.undecided = "", 0, 0, [], Counter()

    def compare(self, column: str, recorded: Any, value: Any, slack: float = 0, complete: bool = True) -> None:
        """Compare numbers or words; where the state of a maximum is not kept its value is a lower bound."""
        same = value == recorded
        if isinstance(value, float):
            value, recorded = math.inf if math.isnan(value) else value, float(recorded)
            same = value == recorded or abs(value - recorded) <= REL * abs(recorded) + slack < math.inf
        if value is None or not (same or complete or value > recorded):
            self.undecided[column] += 1
            return
        self.numbers += 1
        if not same:
            self.findings.append(f"{self.run:17} {column:38} {str(recorded)[:48]:>24} {str(value)[:48]:>24}")


def check_reference(report: Report, p: Problem) -> None:
    """Demand that the exact motion begins at the start, states sane errors and keeps the laws to them."""
    if not len(p.exact):
        return
    t, stated, q, m = p.exact[:, 0], p.exact[:, -1], p.whole, p.whole.measure(p.exact)
    r, _, v, W, _ = unpack(p.exact)
    size, speed = np.abs(r).max() + q.rim + q.arms, q.spread(v, W).max()
    allowed, weight = 1e-9 + 100 * stated.clip(0) / size, m["T"].max() + np.abs(m["E"] - m["T"]).max() + 1e-300
    sane = (stated >= 0).all() and (stated < 0.1 * size).all() and t[0] >= 0 and t[-1] <= p.horizon * (1 + EPS)
    report.compare("reference: errors and horizon sane", True, bool(sane))
    laws = {"phi": m["phi"] / size, "phi_dot": m["phi_dot"] / max(speed, 1e-9 * size)}
    laws |= {"orthogonality": m["orthogonality"], "energy": (m["E"] - q.initial["E"]) / weight}
    laws["start"] = allowed * np.abs(p.exact - q.start)[0, 1:-1].max() / (1e-9 * (1 + size + speed))
    for law, defect in laws.items():
        known = not (p.has_work if law == "energy" else law == "start" and t[0])
        report.compare(f"reference: {law} / allowed", 0.0, np.abs(defect / allowed).max() if known else None, 1)


def check_run(
    report: Report, p: Problem, run: dict[str, Any], rec: dict[str, Any], s: Array, reactions: Array | None
) -> None:
    """Compare a record with its states: maxima, last values, scales and status."""
    every, q, t = run["states"] == "every step", p.whole, s[:, 0]
    get = defaultdict(lambda: math.nan)
    get |= {key: float(x) for key, x in rec.items() if type(x) in {int, float} or x in ("nan", "inf", "-inf")}
    good, (r, R, v, W, _) = np.isfinite(s[:, :-1]).all(1), unpack(s)
    peaks = {key: float(at) for key, at in run["peaks_s"].items()}
    first = min((at for key, at in peaks.items() if key.endswith(":first")), default=math.inf)
    m, size = p.find_scales(q, s, first)
    big = np.abs(r[good]).max(initial=0) + q.rim + q.arms
    fast, weight = np.nanmax(q.spread(v, W)) + big, np.nanmax(m["T"] + np.abs(m["E"] - m["T"]))
    report.compare("energy_start_J", rec["energy_start_J"], float((q.initial if t[0] else m)["E"][0]), EPS * weight)
    rest, covered, single = size["reach"] < 1e-6 * big, p.horizon >= p.t_end, len(p.parts) == 1
    for key, name in (("length", "length_scale_m"), ("gap_rate", "speed_scale_m_per_s"), ("energy", "energy_scale_J")):
        report.compare(name, rec[name], size[key], 1e-9 * weight * (key == "energy"), (every or covered) and not rest)
        size[key] = get[name]
    if covered or not len(p.exact):  # the reach is the length
        size["gap"] = min(size["length"], math.inf if rest else q.stretch)
    parts, known, ratio = [(m, size)], every or covered or not len(p.exact), np.ones(p.nb)
    if not single:
        parts = [p.find_scales(part, s, first) for part in p.parts]
        known = every and not p.has_work and all(one["reach"] > 1e-6 * big for _, one in parts)
    for part, (_, one) in zip(p.parts, parts, strict=True):
        ratio[part.bodies] = size["length"] / one["length"]
    shares = {law: np.max([np.abs(m[law]) / (LIMITS[law] * size[law]) for m, size in parts], 0) for law in p.laws}

    # maxima over all steps and over the judged ones, and last values
    columns = [  # values, slack, times
        ("phi_{}", m["phi"], EPS * big, t),
        ("phi_dot_{}", m["phi_dot"], EPS * fast, t),
        ("orthogonality_{}", m["orthogonality"], EPS, t),
        ("energy_drift_{}_J", m["energy"], EPS * weight, t),
        ("gap_share_{}", shares.get("gap") if known else None, 1e-9, t),
        ("gap_rate_share_{}", shares.get("gap_rate") if known or single else None, 1e-9, t),
    ]
    if len(p.exact):
        k = np.minimum(np.searchsorted(p.exact[:, 0], t), len(p.exact) - 1)
        beside, spin = p.exact[k, 0] == t, 1 + np.abs(W[good]).max(initial=0)
        x, at, stated = p.exact[k[beside]], t[beside], p.exact[k[beside], -1]
        r, R, v, W = (a[beside] - b for a, b in zip((r, R, v, W), unpack(x)[:4], strict=True))
        turned = 2 * np.arcsin((np.linalg.norm(R, axis=(2, 3)) / math.sqrt(8)).clip(0, 1))
        spun = np.linalg.norm(W, axis=(2, 3)) / math.sqrt(2)
        apart, rate = (q.spread(r, R) * ratio).max(1), (q.spread(v, W) * ratio).max(1)
        columns += [
            ("position_error_{}_m", norm(r).max(1), EPS * big, at),
            ("orientation_error_{}_rad", turned.max(1), 1e4 * EPS, at),
            ("velocity_error_{}_m_per_s", norm(v).max(1), EPS * fast, at),
            ("angular_velocity_error_{}_rad_per_s", spun.max(1), EPS * spin, at),
            ("motion_error_{}_m", apart if known or single else None, EPS * big, at),
            ("rate_error_{}_m_per_s", rate if known or single else None, EPS * fast, at),
            ("reference_own_error_{}_m", stated, 1e-3 * EPS * big, at),
        ]
        tenth = np.maximum(np.searchsorted(at, at / 10, "right") - 1, min(1, len(at) - 1))
        usable = stated < np.where(stated <= 100 * stated[tenth], 1e-3, 1e-9) * get["length_scale_m"]
        judged_to = at[np.logical_and.accumulate(usable)].max(initial=0)
        report.compare("judged_to_s", rec["judged_to_s"], float(judged_to), 0, every)
    for key, values, slack, at in columns:
        for which, last in (("max", math.inf), ("judged", get["judged_to_s"]), ("end", get["t_reached_s"])):
            name, span = key.format(which), at == last if which == "end" else at <= last
            if name in rec and span.any():
                kept = every or which == "end" or bool(np.isin(peaks.get(name, -1), at))
                value = (
                    None if values is None else float(values[span][0] if which == "end" else np.abs(values[span]).max())
                )
                report.compare(name, rec[name], value, slack, kept)

    # laws from step to step, forces of joints, and what is kept
    if every and len(s) > 1:
        report.compare("kinematic_defect", rec["kinematic_defect"], find_kinematic_defect(q, s, get["length_scale_m"]), 1e-9)
    if len(p.exact) and (at := peaks.get("motion_between_max_m")) is not None:
        k = np.searchsorted(p.exact[:, 0], at)
        held = (every or run["between"]) and p.exact[k, 0] == at
        r, R = between(s, at)
        own = unpack(p.exact[k : k + 1])
        report.compare("motion_between_max_m", rec["motion_between_max_m"], float(q.spread(r - own[0], R - own[1]).max()) if held else None, EPS * big)
    for column, part in (("reaction_error_max_N", 1), ("reaction_size_N", 0)):
        if column in peaks:
            x, y = (a[a[:, 0] == peaks[column]] for a in (p.exact, s))
            value = None
            if len(x) and (len(y) or not part) and not p.user:
                load = q.accelerate(x)[1]
                if part:
                    own = reactions[s[:, 0] == peaks[column]] if reactions is not None else np.array([run["reaction"]], float)
                    load = load - q.load(y, own)
                value = float(norm(load[0, :, :3]).max())
            report.compare(column, rec[column], value, 1e-6 * get["reaction_size_N"])
    drifts = parse_json(rec["invariant_drifts"].encode(), report.run)
    named = {str(about["name"]): about for about in p.kept}
    unit = {"J": size["energy"], "m": size["length"], "m/s": size["gap_rate"], "rad/s": size["gap_rate"] / size["reach"]}
    unit |= {"kg m/s": size["momentum"], "kg m2/s": size["momentum"] * size["reach"]}
    broken = False
    for name, drift in drifts.items():
        about = named.get(name)
        if about is None or "quantity" not in about:
            report.compare(f"invariant {name}", 0, None)
            continue
        values = measure_kept(q, s, about)
        away = values - values[0]
        slack = EPS * max(np.nanmax(np.abs(values)), unit[about["unit"]])
        if t[0] == 0:
            report.compare(f"invariant {name}: start", drift["start"], float(values[0]), slack)
        report.compare(f"invariant {name}: max", drift["max"], float(np.abs(away).max()), slack, every)
        if t[-1] == get["t_reached_s"]:
            report.compare(f"invariant {name}: end", drift["end"], float(away[-1]), slack)
        broken |= float(drift["max"]) > 0.1 * max(unit[about["unit"]], abs(float(drift["start"])))

    # status: of compared columns, and of recorded ones where the bundle cannot decide
    if rec["claimed"] != "success":
        return report.compare("status of a failure", False, rec["status"] in {"success", "wrong", "inaccurate"})
    length, energy, own = get["length_scale_m"], get["energy_scale_J"], get["reference_own_error_judged_m"]
    moved = np.abs(s - q.start)[0, 1:-1].max() if t[0] == 0 else math.nan
    tests = {
        "end": abs(get["t_reached_s"] - p.t_end) - 1e-9 * max(p.t_end, 1),
        "start": moved - 1e-9 * (1 + length + get["speed_scale_m_per_s"]),
        "finite": 0.5 - good.all(),
        "energy": get["energy_drift_max_J"] - 0.1 * energy if single else shares["energy"].max() - 1 if known else 0,
        "constraint": get["gap_share_max"] - 1,
        "constraint_rate": get["gap_rate_share_max"] - 1,
        "orthogonality": get["orthogonality_max"] - 1e-3,
        "kinematic": get["kinematic_defect"] - 0.5,
        "reaction": get["reaction_error_max_N"] - 10 * (get["reaction_size_N"] + energy / length),
        "motion": get["motion_error_judged_m"] - 0.1 * length - own,
        "velocity": get["rate_error_judged_m_per_s"] - get["speed_scale_m_per_s"],
        "rows": get["motion_between_max_m"] - 0.5 * length - own,
    }
    soft = {law for law in SOFT if tests[law] > 0}
    if every and len(p.exact) and not p.user:
        x = find_truncation(q, s, reactions, size["gap_rate"])
        tests["truncation"] = x - 1
        if soft: tests["truncation"] = 0
    else:
        report.undecided["law truncation"] += 1
    tests["invariant"] = float(broken)
    stated = {str(reason["law"]) for reason in parse_json(rec["wrong_because"].encode(), report.run)}
    found = {law for law, excess in tests.items() if excess > 0} | (stated & {"truncation"} if "truncation" not in tests else set())
    found -= {"rows"} if found & {"motion", "velocity"} else set()
    report.compare("status", rec["status"], "wrong" if found - SOFT else "inaccurate" if found else "success")
    return report.compare("wrong_because", sorted(stated), sorted(found - SOFT or found))


def check_bundle(path: Path) -> Report:
    """Check all runs of a bundle; an exception says that the file is no bundle."""
    report, problems, files = Report(), {}, read_files(path)
    head, rows, runs = (parse_json(files[f"{name}.json"], name) for name in ("bundle", "records", "runs"))
    demand(head["format"] == "mbsbench bundle" and head["version"] == 3, "not a bundle of version 3")
    report.runs, records = len(runs), {str(rec["run_id"]): rec for rec in rows}
    demand(len(rows) == len(records) == len(runs), "a run twice, or without a record")
    for run in runs:
        report.run, key, rec = str(run["run_id"]), str(run["problem"]), records.pop(str(run["run_id"]))
        if run["states"] == "none":
            report.undecided["runs without states"] += 1
            continue
        if key not in problems:
            problems[key] = Problem(files[f"problems/{key}.json"], files.get(f"references/{key}.npy"), key)
            check_reference(report, problems[key])
        states = read_states(files[f"runs/{report.run}.npy"], problems[key].nb, report.run)
        reactions = None
        if "state_reaction" in run["arrays"]:
            at, shape = run["arrays"]["state_reaction"]
            reactions = np.frombuffer(files[f"series/{report.run}.npy"], "<f8", offset=128)[at : at + math.prod(shape)].reshape(shape)
        check_run(report, problems[key], run, rec, states, reactions)
    return report


def main(paths: list[str]) -> int:
    """Print a table of agreement for each bundle."""
    np.seterr(all="ignore")
    worst = 0 if paths else 2
    for path in paths:
        try:
            report = check_bundle(Path(path))
        except Exception as error:  # whatever the file may cause
            print(f"{path}: unreadable: {type(error).__name__}: {error}"[:400].encode("unicode_escape").decode())
            worst = 2
            continue
        counts = f"{report.runs} runs checked, {report.numbers} numbers compared, {len(report.findings)} disagreements"
        print(f"{path}: {counts}, {report.undecided.total()} undecided", *report.findings, sep="\n")
        print("  undecided:", ", ".join(f"{what} {n}" for what, n in sorted(report.undecided.items())))
        worst = max(worst, min(len(report.findings), 1))
    return worst


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
