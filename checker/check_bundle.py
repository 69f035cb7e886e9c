"""Check bundles of results from docs/bundle.md alone: recompute what their records state. See README.md."""

import hashlib
import io
import json
import re
import sys
import zipfile
from functools import partial
from pathlib import Path

import numpy as np

NAMES = re.compile(r"((runs|references|series)/[\w-]{1,64}\.npy|(problems/)?[\w.-]{1,64}\.(json|toml|txt))", re.ASCII)
MAX_FILES, MAX_BYTES, MAX_JSON, MAX_VALUES = 20_000, 1 << 29, 1 << 24, 3_000_000
REL, EPS, STEP, ZERO, ONE = 1e-6, 1e-12, 1e-30, np.zeros(3), np.eye(3)  # tolerance, rounding, step of derivatives
LIMITS, SOFT = {"energy": 0.1, "orthogonality": 1e-3, "gap": 0.01, "gap_rate": 0.05}, {"motion", "velocity", "rows"}  # of scales
SHAPES = """mass:b inertia:b33 gyration:b gravity:3 start_r:b3 start_R:b33 start_v:b3 start_Omega:b3 user_i:u user_j:u
 joint_i:j joint_j:j joint_s_i:j3 joint_s_j:j3 joint_u:j3 joint_w:j3 joint_n:j33 joint_length:j joint_motion:j7 joint_k:j joint_c:j
 joint_points:j joint_lines:j joint_axes:j joint_moving:j"""  # for numbers of bodies, user forces and joints
ROWS = {"points": 3, "lines": 3, "axes": 3, "driven position": 1, "driven distance": 1, "driven angle": 1, "spring": 1}
ROWS |= {"knife edge": 1, "rolling disc": 3, "rack and pinion": 1, "torsion": 1, "load": 1}  # the rare ones are from place 13 on
PLACES, HALVES, ANGLES = [(kind, k) for kind in ROWS for k in range(ROWS[kind])], [8, 11], [6, 7, 8, 11]
dot, norm, turn = partial(np.einsum, "...k,...k"), partial(np.linalg.norm, axis=-1), partial(np.einsum, "tkij,kj->tki")
hat = partial(np.einsum, "ijk,...j", np.cross(ONE[:, None], ONE))  # the matrix of w x


def exp(w):  # rotation by the angle |w| about w
    x, W = norm(w)[..., None, None] / np.pi, hat(w)
    return ONE + np.sinc(x) * W + np.sinc(x / 2) ** 2 / 2 * W @ W


def angle(y, x, less=0.0):  # atan2 of complex steps less an angle, within half a turn
    turned = np.arctan2(y.real, x.real) + 1j * (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2) - less
    return turned - 2 * np.pi * np.round(turned.real / (2 * np.pi))


def log(R, near=ZERO, W=0):  # rotation vector, and its rate (W: complex step), of the nearest rotation; of whole turns those near another
    U, _, V = np.linalg.svd(np.where(np.isfinite(R), R, 0))
    a = ((R := U @ V @ (ONE + 1j * STEP * W)) - np.swapaxes(R, -1, -2))[..., [2, 0, 1], [1, 2, 0]] / 2
    sine = np.sqrt(dot(a, a) + 0j)[..., None]
    axis, turned = a / np.where(sine == 0, 1, sine), angle(sine, (np.trace(R, 0, -2, -1)[..., None] - 1) / 2)
    return axis * (turned + 2 * np.pi * np.round((dot(near, axis.real)[..., None] - turned.real) / (2 * np.pi)))


def unpack(s):  # r, R, v, Omega of each body, and the matrix of Omega x
    b = s[:, 1:-1].reshape(len(s), s.shape[1] // 18, 18)
    return b[..., :3], b[..., 3:12].reshape(*b.shape[:2], 3, 3), b[..., 12:15], b[..., 15:], hat(b[..., 15:])


def demand(condition, message):  # or refuse the bundle
    if not condition:
        raise ValueError(message)


def read_files(path):  # members of the archive, parsed after sizes, names and digests have been verified
    sound = path.is_file() and path.stat().st_size <= MAX_BYTES and path.read_bytes().count(b"PK\1\2") <= MAX_FILES
    demand(sound, "no file of at most 512 MB with at most 20,000 members")
    archive, files = zipfile.ZipFile(path), {}
    demand(sum(member.file_size for member in archive.infolist()) <= MAX_BYTES, "more than 512 MB unpacked")
    for member in archive.infolist():
        name, plain = member.orig_filename, member.external_attr >> 28 in {0, 8} and member.compress_type in {0, 8, 12}
        demand(plain and NAMES.fullmatch(name) and name not in files, f"unexpected, duplicate or special file {name[:80]!r}")
        files[name] = archive.open(member).read(member.file_size)
    listed = files.pop("manifest-sha256.txt").decode("ascii").splitlines()
    wrong = set(listed) ^ {f"{hashlib.sha256(raw).hexdigest()}  {name}" for name, raw in files.items()}
    demand(not wrong and len(listed) == len(files), f"{sorted(wrong)[:1]!r:.160} differs from the manifest")
    for name, raw in files.items():
        if name.endswith(".npy"):  # a row each: t; r, R, v, Omega of each body; what is stated
            files[name] = a = np.lib.format.read_array(io.BytesIO(raw), allow_pickle=False).T
            demand(a.dtype == "<f8" and not (a.ndim == 2 and (np.diff(a[:, 0]) <= 0).any()), f"{name}: no numbers, or times not in order")
        elif name.endswith(".json"):
            demand(len(raw) <= MAX_JSON and sum(map(raw.count, (b",", b"[", b"{"))) <= MAX_VALUES, f"{name} is too large")
            files[name] = json.loads(raw, object_pairs_hook=lambda a: dict(a) if len(dict(a)) == len(a) else demand(0, "a key twice"))
    return files


class Problem:  # its validated numbers and exact motion; the laws of mechanics, of states in rows
    def __init__(self, data, exact, name):
        sizes, own, reference = {"3": 3, "7": 7}, vars(self), data["reference"]
        for key, letters in (entry.split(":") for entry in SHAPES.split()):
            a = np.array(data["numbers"][key], float)
            shape = tuple(sizes.setdefault(letter, len(a)) for letter in letters)
            a, body = a.reshape(shape) if 0 in shape else a, letters in "uj" and key.endswith(("_i", "_j"))
            known = a.shape == shape and np.isfinite(a).all() and not (body and ((a < -1) | (a >= sizes["b"])).any())
            demand(known, f"{name}: {key} is not finite, of shape {shape} or beyond the bodies")
            own[key.removeprefix("joint_")] = a.astype(int) if body else a
        self.nb, self.t_end, self.kinds = nb, t_end, kinds = sizes["b"], float(data["t_end_s"]), np.array(data["joint_kinds"], "U40")
        known = 0 < nb <= 2000 and max(sizes.values()) <= 50 * nb + 50 and (self.mass > 0).all() and 0 < t_end < np.inf
        demand(known and set(kinds[self.moving > 0]) <= set(ROWS), f"{name}: bodies, masses, joint_kinds or t_end_s")
        self.of, self.place = np.nonzero(np.transpose([own.get(kind, self.moving * (kinds == kind)) > k for kind, k in PLACES]))  # of rows
        force, torque, load = (kinds == kind for kind in ("spring", "torsion", "load"))
        joint, self.rare, self.whole = ~(force | torque | load), self.place.max(initial=0) > 12, np.ones(nb, bool)
        self.joint, self.pushes, ends = joint[self.of], load[self.of], np.array([[*self.i, *self.user_i], [*self.j, *self.user_j]], int)
        at, group = np.append(self.i, self.j), np.arange(nb)  # mechanisms: bodies that joints and forces join
        for i, j in ends.T:
            group[group == group[i]] = group[j] if min(i, j) >= 0 else group[i]
        self.parts, holds = [group == g for g in np.unique(group)], (ends < 0).any(0) & np.append(joint | force, self.user_i < nb)
        arms, self.arm = norm(np.append(self.s_i, self.s_j, 0)) * np.tile(joint, 2), np.append(self.gyration, 0)
        np.maximum.at(self.arm, at, arms)
        self.held, self.arms = np.isin(np.arange(nb), ends[:, holds]), np.bincount(at + 1, arms, nb + 1)[1:]
        self.loose = np.bincount(at + 1, np.tile(joint & (self.points < 1), 2), nb + 1)[1:] > 0
        self.user, self.invariants = bool(sizes["u"] or data["not_serialised"]), {about["name"]: about for about in data["invariants"]}
        self.has_work, self.rim = bool(self.user or self.c.any() or self.motion.any()), self.gyration.max() + self.arms.sum()
        self.laws = tuple(LIMITS)[: 4 if joint.any() and not data["literal_start"] else 2]
        start = np.concatenate([own[f"start_{key}"].reshape(nb, -1) for key in ("r", "R", "v", "Omega")], 1).ravel()
        self.start, self.horizon, self.route = np.array([[0, *start, 0]]), float(reference["horizon_s"]), str(reference["route"])
        self.exact, self.horizon = (self.start[:0], -np.inf) if exact is None else (exact, self.horizon)
        even = self.exact[:, 0] / min(t_end, self.horizon) * 2000
        self.sizing = np.append(self.start, self.exact[(np.abs(even - np.round(even)) < 1e-7) & (even <= 2000 * (1 + EPS))], 0)

    def spread(self, r, D):  # root mean square of r + Ds over each body's matter s: of a change of poses, of velocities
        half = np.trace(self.inertia, axis1=1, axis2=2)[:, None, None] * ONE / 2 - self.inertia
        return np.sqrt(dot(r, r) + np.maximum(np.einsum("tbij,bjk,tbik->tb", D, half, D) / self.mass, 0))

    def find_rows(self, s, speeds=None, ahead=0.0):  # phi and rates of all rows: a step ahead, or at given speeds of both ends
        r, R, v, w, _ = unpack(np.concatenate([s[:, :-1], np.tile([*ZERO, *ONE.ravel(), *ZERO, *ZERO], (len(s), 1)), s[:, -1:]], 1))
        step, c, t, L, ends = 1j * STEP, self.motion, s[:, :1] + ahead + 1j * STEP * (speeds is None), self.length, []
        f = c[:, 0] + t * (c[:, 1] + t * (c[:, 2] + t * c[:, 3])) + c[:, 4] * np.sin(c[:, 5] * t + c[:, 6])
        for end, b in enumerate((self.i, self.j)):
            V, W = (v[:, b], w[:, b]) if speeds is None else speeds[end]
            ends.append((r[:, b] + (ahead + step) * V, R[:, b] @ (ONE + ahead * hat(W)) @ (ONE + step * hat(W))))
        (r, R), (r_j, R_j) = ends
        u, w, (n1, n2, n3) = turn(R, self.u), turn(R, self.w), (turn(R_j, self.n[:, k]) for k in range(3))
        x, x_j, across = r + turn(R, self.s_i), r_j + turn(R_j, self.s_j), n1 - dot(n1, u)[..., None] * u
        d, low = x - x_j, x - L[:, None] * across / np.sqrt(dot(across, across))[..., None]
        rows = [*np.moveaxis(d, 2, 0), np.where(self.kinds == "distance", (dot(d, d) / L - L) / 2, dot(n1, d)), dot(n2, d), dot(n3, d)]
        rows += [dot(u, n1), dot(u, n2), dot(w, n2), dot(n1, d) - f, np.sqrt(dot(d, d)) - f]
        rows += [dot(u, n1) * np.cos(f) + dot(u, n2) * np.sin(f), np.sqrt(dot(d, d)) - L]
        if self.rare:  # slips of the matter of both bodies at x and at the lowest point; the power of a load
            matter = ([(r + (R @ R.real.swapaxes(2, 3) @ (p - r).real[..., None])[..., 0]).imag for r, R in ends] for p in (x, low))
            slip, low_slip = (1j * (v_i - v_j) for v_i, v_j in matter)
            force, torque = (f.real[..., None] * np.where(L[:, None] > 0, a.real, b) for a, b in ((u, self.u), (w, self.w)))
            rows += [dot(u.real, slip) - step * f.real, dot(n1, low - x_j), dot(n2.real, low_slip), dot(n3.real, low_slip)]
            rows += [L * angle(dot(np.cross(n1, n2), np.cross(u, n2)), -dot(n2, u), -dot(n2, d) / L), angle(dot(u, n2), dot(u, n1), L)]
            rows += [1j * (dot(force, x.imag) + np.sum(hat(torque) @ R.real * R.imag, (2, 3)) / 2)]
        half = np.where(self.kinds == "driven angle", dot(u, n2) * np.cos(f) - dot(u, n1) * np.sin(f), -dot(w, n1)).real > 0
        phi, half = np.array(rows)[self.place, :, self.of].T, half[:, self.of] & np.isin(self.place, HALVES)
        return phi.real, phi.imag / STEP, half  # where its gap is half a turn off

    def measure(self, s, part):  # series of a mechanism, in pieces of bounded memory
        if len(s) > (piece := max(1, 60_000 // max(self.nb, len(self.i)))):
            pieces = [self.measure(s[k : k + piece], part) for k in range(0, len(s), piece)]
            return {key: np.concatenate([one[key] for one in pieces]) for key in pieces[0]}
        (r, R, v, _, W), (r0, R0, *_), ours, m = unpack(s), unpack(self.start), np.append(part, False), self.mass * part
        shared, mine = m / m.sum() * (not (part & self.held).any()), (ours[self.i] | ours[self.j])[self.of]
        own, own_v, own_r0 = (a - (shared @ a)[:, None] for a in (r, v, r0))  # beside the common C of what floats
        (x, rate, half), moved, speed = self.find_rows(s), self.spread(own - own_r0, R - R0), self.spread(own_v, W)
        elastic, high, own_high = x**2 @ (mine * self.k[self.of]) / 2, *(a @ -self.gravity @ m for a in (r, own))
        metres, mine = np.where(np.isin(self.place, ANGLES), self.gyration[part].max(), 1.0), mine & self.joint
        rows = {"phi": x, "phi_dot": rate, "gap": np.where(half, 2 - np.abs(x), x) * metres, "gap_rate": metres * rate}
        bodies = {"reach": moved, "speed": speed, "orthogonality": np.linalg.norm(R.swapaxes(2, 3) @ R - ONE, axis=(2, 3))}
        m = {"T": speed**2 @ m / 2, "V": elastic + own_high, "E": self.spread(v, W) ** 2 @ m / 2 + high + elastic, "momentum": speed @ m}
        return m | {key: a[:, part].max(1) for key, a in bodies.items()} | {key: norm(a[:, mine]) for key, a in rows.items()}

    def find_scales(self, s, first, part):  # and series of a mechanism: of exact states, beyond of the run until a law is broken
        m, known = self.measure(s, part), self.measure(self.sizing, part)
        start, late = (known if s[0, 0] else m)["E"][0], (s[:, 0] > self.horizon * (1 + EPS)) & (s[:, 0] < first)
        m["energy"], keys = s[:, -1] if self.has_work else m["E"] - start, ("reach", "speed", "T", "V", "momentum")
        reach, speed, T, V, momentum = (np.append(known[key], m[key][late]) for key in keys)
        T[len(known["T"]) :] -= np.maximum(m["energy"][late], 0)  # energy gained was not there to be exchanged
        stretch = np.inf if self.loose[part].any() else 2 * (self.arms[part].sum() + self.gyration[part].max())
        size = {"reach": reach.max(), "length": (known["reach"] if len(self.exact) else reach).max(), "stretch": stretch}
        size |= {"gap": min(reach.max(), stretch), "gap_rate": speed.max(), "momentum": momentum.max(), "orthogonality": 1.0}
        return m, size | {"energy": max(T.max(), np.ptp(V)), "energy start": start}

    def differentiate(self, s):  # A: the rates of all rows by those of each body, v and Omega
        A, still = np.zeros((len(s), len(self.of), self.nb + 1, 6)), self.find_rows(s, np.zeros((2, 2, 3)))[1]
        for n, unit in enumerate(np.eye(12).reshape(12, 2, 2, 3)):
            A[:, np.arange(len(self.of)), (self.i, self.j)[n // 6][self.of], n % 6] += self.find_rows(s, unit)[1] - still
        return A[:, :, :-1]

    def accelerate(self, s):  # rates of v and Omega, and the joints' forces and torques on bodies, by the laws of motion
        (*_, w, W), (phi, rate, _), A, n, m = unpack(s), self.find_rows(s), self.differentiate(s), len(s), 6 * self.nb
        f = -np.einsum("tr,trbk->tbk", self.k[self.of] * phi + self.c[self.of] * rate - self.pushes, A)
        f += np.append(f[..., 3:] * 0 + self.mass[:, None] * self.gravity, -np.einsum("tbij,bjk,tbk->tbi", W, self.inertia, w), 2)
        h, M = 1e-5 / max(1, np.abs(w).max(), np.abs(self.motion[:, 5]).max(initial=0)), np.zeros((self.nb, 6, self.nb, 6))
        for b in range(self.nb):
            M[b, :3, b, :3], M[b, 3:, b, 3:] = self.mass[b] * ONE, self.inertia[b]
        drift = (self.find_rows(s, ahead=-h)[1] - self.find_rows(s, ahead=h)[1])[:, self.joint, None] / (2 * h)
        A, M, unit = A[:, self.joint].reshape(n, -1, m), np.tile(M.reshape(m, m), (n, 1, 1)), self.mass.max()
        laws = np.block([[M / unit, A.swapaxes(1, 2)], [A, np.zeros((n, A.shape[1], A.shape[1]))]])
        a = (np.linalg.pinv(laws, 1e-12, hermitian=True) @ np.append(f.reshape(n, m, 1) / unit, drift, 1))[:, :m]
        return a.reshape(f.shape), (M @ a).reshape(f.shape) - f

    def find_top_error(self):  # of the cosine of Lagrange's top to the vertical, u = u1 + (u2-u1) sn^2: its rate squared is a cubic
        (_, R, _, w, _), J, size, g = unpack(np.append(self.start, self.exact, 0)), self.inertia[0], norm(self.s_i[0]), norm(self.gravity)
        w, arm, up, mgl = w[:, 0], -self.s_i[0] / size, -self.gravity / g @ R[:, 0], self.mass[0] * size * g  # in the body
        axial, I = arm @ J @ arm, (np.trace(J) - arm @ J @ arm) / 2 + self.mass[0] * size**2
        u, du, c, d = up @ arm, dot(up, np.cross(w, arm)), axial * (w[0] @ arm) / I, 2 * mgl / I
        a, b = w[0] @ w[0] - (w[0] @ arm) ** 2 + d * u[0], up[0] @ (w[0] - arm * (w[0] @ arm)) + c * u[0]
        u1, u2, u3 = np.sort(np.roots([d, -a - c**2, 2 * b * c - d, a - b**2]).real)
        part, (x, weights), speed = (u2 - u1) / (u3 - u1), np.polynomial.legendre.leggauss(100), np.sqrt(d * (u3 - u1)) / 2
        phase = np.append(np.arcsin(np.copysign(np.sqrt(((u - u1) / max(u2 - u1, STEP)).clip(0, 1)), du)), np.pi / 2)[:, None] / 2
        *z, quarter = (phase / np.sqrt(1 - part * np.sin(phase * (x + 1)) ** 2)) @ weights  # elliptic integrals
        off = np.array(z[1:]) - z[0] - speed * self.exact[:, 0]
        return (off - 2 * quarter * np.round(off / (2 * quarter))) * du[1:] / speed + (u - u.clip(u1, u2))[1:]

    def find_between(self, s, at):  # poses at a time by the cubics of the steps around it
        k = min(max(np.searchsorted(s[:, 0], at, "right") - 1, 0), len(s) - 2)
        (r, R, v, w, W), h = (a[k : k + 2] for a in unpack(s)), s[k + 1, 0] - s[k, 0]
        theta, x = log(R[0].swapaxes(1, 2) @ R[1], h / 2 * w.sum(0), W[1]), (at - s[k, 0]) / h  # beyond half a turn a series:
        rate = np.where(norm(a := theta.real)[:, None] < np.pi, theta.imag / STEP, w[1] + np.cross(a, w[1] / 2 + np.cross(a, w[1]) / 12))
        weights, steps = (x**2 * (3 - 2 * x), h * x * (1 - x) ** 2, h * x**2 * (x - 1)), ((r[1] - r[0], *v), (a, w[0], rate))
        shift, turned = (sum(map(np.multiply, weights, step)) for step in steps)
        return r[0] + shift, R[0] @ exp(turned)

    def field(self, w, W=ZERO, turned=ZERO):  # velocity or acceleration of a body's matter, seen an angle later
        return w[..., :3], exp(turned) @ (hat(w[..., 3:]) + hat(W) @ hat(W))

    def find_truncation(self, s, reaction, speed):  # largest of three sums of errors over sums of what the steps leave open
        (r, R, v, w, _), h, count = unpack(s), np.diff(s[:, 0])[:, None, None], max(self.joint.sum(), 1)
        k = 1 + np.flatnonzero(norm(w).max(1)[1:-1] * np.maximum(h[:-1], h[1:])[:, 0, 0] < 0.5)
        most = min(max(int(2e8 / (6 * self.nb * count**2)), 4), 200, len(k))
        k = k[np.unique(np.linspace(0, len(k) - 1, most).round().astype(int))]
        if len(k) < 3 or not speed > 0:
            return 0.0
        (a, load), h1, h2, V, sums = self.accelerate(s[k]), h[k - 1], h[k], np.append(v, w, 2), []
        slow, rounded = speed / np.ptp(s[:, 0]), 64 * np.finfo(float).eps / np.minimum(h1, h2)[..., 0]
        steps = ((k - 1, k, h1), (k, k + 1, h2))
        poses = [np.append(r[j] - r[i], log(R[i].swapaxes(2, 3) @ R[j]).real, 2) / d for i, j, d in steps]
        rates, spins = [(V[j] - V[i]) / d for i, j, d in steps], [w[..., 3:] for w in poses]
        counts = np.maximum(self.spread(*self.field(a, w[k])).max(1, keepdims=True), slow)
        sides = ((poses, V[k], (ZERO, ZERO), speed, np.abs(r).max() + self.gyration.max()),)
        for (w1, w2), told, (W1, W2), counted, size in (*sides, (rates, a, spins, counts, self.spread(*self.field(V[k])).max())):
            last, first = self.field(w2, W2, h2 / 2 * spins[1]), self.field(w1, W1, -h1 / 2 * spins[0])
            left = self.spread(last[0] - first[0], last[1] - first[1]) + 0.01 * counted + size * rounded
            sums.append((self.spread(*self.field((h2 * w1 + h1 * w2) / (h1 + h2) - told)), left))
        if reaction is not None:
            per = np.repeat(np.stack([np.ones(self.nb), self.arm[:-1]], 1), 3, 1)
            A, pull = self.differentiate, partial(np.einsum, "tr,trbk->tbk")
            before, here, after = (pull(reaction[j], A(s[j])[:, self.joint]) / per for j in (k - 1, k, k + 1))
            left = 0.01 * np.maximum(norm(load / per).max(1, keepdims=True), self.mass * slow)
            sums.append((norm(here - load / per), left + norm(here - before) + norm(after - here)))
        sums = [np.sum([both for both in zip(*pair, strict=True) if np.isfinite(both).all()], 0) for pair in sums]
        return max(np.where(off > 0, off / left, 0).max() for off, left in sums)


class Report:  # what was compared in a bundle, and what disagrees; an exception says that the file is no bundle
    def __init__(self, path):
        self.run, self.rec, self.numbers, self.findings, self.undecided = "", {}, 0, [], []
        files = read_files(path)
        head, records, runs, table = (files[f"{name}.json"] for name in ("bundle", "records", "runs", "table"))
        demand(head["format"] == "mbsbench bundle" and head["version"] == 4, "not a bundle of version 4")
        self.check_table(table, records)
        self.runs, count, records = len(runs), len(records), {rec["run_id"]: rec for rec in records}
        demand(self.runs == len(records) == count, "a run twice, or without a record")
        keys = sorted({str(run["problem"]) for run in runs if run["states"] != "none"})
        problems = {key: Problem(files[f"problems/{key}.json"], files.get(f"references/{key}.npy"), key) for key in keys}
        for self.run in [key for key in keys if len(problems[key].exact)]:
            self.check_reference(problems[self.run])
        for run in runs:
            rec, p, (at, shape) = records.pop(run["run_id"]), problems.get(run["problem"]), run["arrays"].get("state_reaction", (0, None))
            self.run, self.rec = rec["run_id"], {name: float(x) if x in ("nan", "inf", "-inf") else x for name, x in rec.items()}
            if p is None or run["states"] == "none":
                self.undecided.append(("no motion, or too large a state", "run"))
                continue
            reactions = files[f"series/{self.run}.npy"][at:][: int(np.prod(shape))].reshape(shape) if shape else None
            self.check_run(p, run, files[f"runs/{self.run}.npy"], reactions)

    def compare(self, column, value, slack=0.0, full=True, recorded=None, why="its states are not kept"):  # if not full, a bound
        recorded, number = self.rec[column] if recorded is None else recorded, isinstance(value, float)
        value, recorded = (np.inf if np.isnan(value) else value, float(recorded)) if number else (value, recorded)
        same = value == recorded or (number and abs(value - recorded) <= REL * abs(recorded) + slack < np.inf)
        if value is None or (not (same or full) and value <= recorded):
            self.undecided.append((why if value is None else "only a lower bound", column))
        else:
            line, self.numbers = f"{self.run:17} {column:38} {str(recorded)[:48]:>24} {str(value)[:48]:>24}", self.numbers + 1
            self.findings += [] if same else [line]

    def check_table(self, table, records):  # every cell is what the records give
        groups, keys = {}, ("problem", "problem_parameters", "solver")
        for rec in records:
            groups.setdefault(tuple(rec[key] for key in keys), []).append(rec)
        demand([tuple(row[key] for key in keys) for row in table] == sorted(groups), "the table has other rows")
        for self.rec, (key, runs) in zip(table, sorted(groups.items()), strict=True):
            self.run, ended = f"table {key[2]}"[:17], [rec["status"] for rec in runs]
            errors = [float(rec["motion_error_judged_m"]) if rec["status"] == "success" else np.nan for rec in runs]
            near = [float(rec["cpu_median_s"]) for rec, e in zip(runs, errors, strict=True) if e <= 1e-3 * float(rec["length_scale_m"])]
            cells = {kind: ended.count(kind) for kind in ("success", "inaccurate", "wrong")} | {"least_cpu_s": min(near, default=np.inf)}
            cells |= {"runs": len(runs), "least_motion_error_m": min((e for e in errors if e < np.inf), default=np.inf)}
            for column, value in cells.items():
                self.compare(column, value)

    def check_reference(self, p):  # the exact motion begins at the start, states sane errors and keeps the laws to them
        t, stated, m, (r, _, v, _, W) = p.exact[:, 0], p.exact[:, -1], p.measure(p.exact, p.whole), unpack(p.exact)
        size, speed, why = np.abs(r).max() + p.rim, p.spread(v, W).max(), "work is done, or no exact start is kept"
        allowed, weight = 1e-9 + 100 * stated.clip(0) / size, m["T"].max() + np.abs(m["E"] - m["T"]).max() + 1e-300
        sane = (stated >= 0).all() and (stated < 0.1 * size).all() and t[0] >= 0 and t[-1] <= p.horizon * (1 + EPS)
        self.compare("reference: errors and horizon sane", bool(sane and np.isfinite(p.exact).all()), recorded=True)
        laws = {"phi": m["phi"] / size, "phi_dot": m["phi_dot"] / max(speed, 1e-9 * size), "orthogonality": m["orthogonality"]}
        laws["energy"] = None if p.has_work else (m["E"] - p.measure(p.start, p.whole)["E"]) / weight
        laws["start"] = None if t[0] else allowed * np.abs(p.exact - p.start)[0, 1:-1].max() / (1e-9 * (1 + size + speed))
        laws |= {"closed form": allowed * p.find_top_error() / (REL + 2 * stated / size)} if "Lagrange's top" in p.route else {}
        self.undecided += [("no closed form here: others prove its motion", "reference")] if "proved" in p.route and len(laws) < 6 else []
        for law, defect in laws.items():
            self.compare(f"reference: {law} / allowed", None if defect is None else np.abs(defect / allowed).max(), 1, True, 0.0, why)

    def check_run(self, p, run, s, reactions):  # maxima, last values, scales and status of a record are those of its states
        every, t, rec, test, single = run["states"] == "every step", s[:, 0], self.rec, self.compare, len(p.parts) == 1
        good, (r, R, v, w, W), n, peaks = np.isfinite(s[:, :-1]).all(1), unpack(s), len(p.exact), run["peaks_s"]
        stated = sorted({reason["law"] for reason in json.loads(rec["wrong_because"])})
        if rec["claimed"] == "success" and not good.all():
            return test("status and reason", ("wrong", ["finite"]), recorded=(rec["status"], stated))
        first, own = min((at for key, at in peaks.items() if ":first" in key), default=np.inf), rec["reference_own_error_judged_m"]
        (m, size), big = p.find_scales(s, first, p.whole), np.abs(r[good]).max(initial=0) + p.rim
        fast, weight = np.nanmax(p.spread(v, W)) + big, np.nanmax(m["T"] + np.abs(m["E"] - m["T"]))
        test("scales kept", bool(np.isin([peaks[key] for key in peaks if "scale " in key], p.exact[:, 0]).all()) or not n, recorded=True)
        test("energy_start_J", size["energy start"], EPS * weight)
        rest, covered = size["reach"] < 1e-6 * big, p.horizon >= p.t_end
        for key, name in (("length", "length_scale_m"), ("gap_rate", "speed_scale_m_per_s"), ("energy", "energy_scale_J")):
            test(name, size[key], 1e-9 * weight * (key == "energy"), (every or covered) and not rest)
            size[key] = rec[name]
        size |= {"gap": min(size["length"], np.inf if rest else size["stretch"]), "reach": size["length"]} if covered or not n else {}
        length, speed, energy, momentum, reach = (size[key] for key in ("length", "gap_rate", "energy", "momentum", "reach"))
        parts = [(m, size)] if single else [p.find_scales(s, first, part) for part in p.parts]
        known = every or covered or not n if single else every and not p.has_work and all(one["reach"] > 1e-6 * big for _, one in parts)
        ratio = 1 if single else sum(part * length / one["length"] for part, (_, one) in zip(p.parts, parts, strict=True))
        shares = {law: np.max([np.abs(m[law]) / (LIMITS[law] * size[law]) for m, size in parts], 0) for law in p.laws}
        series, unexplained = {"phi": (t, m["phi"], big), "phi_dot": (t, m["phi_dot"], fast), "energy_drift": (t, m["energy"], weight)}, 0
        series |= {"orthogonality": (t, m["orthogonality"], 1), "gap_share": (t, shares.get("gap") if known else None, 1e3)}
        series["gap_rate_share"] = t, shares.get("gap_rate") if known or single else None, 1e3
        if n:
            (at, beside, k), spin = np.intersect1d(t, p.exact[:, 0], return_indices=True), 1 + np.abs(w[good]).max(initial=0)
            (dr, dR, dv, dw, dW), sure = (a - b for a, b in zip(unpack(s[beside]), unpack(p.exact[k]), strict=True)), p.exact[k, -1]
            turned = 2 * np.arcsin((np.linalg.norm(dR, axis=(2, 3)).max(1) / np.sqrt(8)).clip(0, 1))
            apart, rate = (p.spread(dr, dR) * ratio).max(1), (p.spread(dv, dW) * ratio).max(1)
            series |= {"position_error": (at, norm(dr).max(1), big), "velocity_error": (at, norm(dv).max(1), fast)}
            series |= {"orientation_error": (at, turned, 1e4), "angular_velocity_error": (at, norm(dw).max(1), spin)}
            series |= {"motion_error": (at, apart if known or single else None, big), "reference_own_error": (at, sure, 1e-3 * big)}
            series["rate_error"] = at, rate if known or single else None, fast
            tenth = np.maximum(np.searchsorted(at, at / 10, "right") - 1, every and len(at) > 1)
            q = np.logical_and.accumulate(sure < np.where(sure <= 100 * sure[tenth], 1e-3, 1e-9) * length).sum()
            test("judged_to_s", at[:q].max(initial=0), 0, every)
            if q > 1 and rate[:q].max() > 0.01 * speed:
                unexplained = rate[:q].max() / (2 * (apart + sure)[:q].max() * (1 / np.median(np.diff(at[:q])) + norm(w[:q]).max()))
        for stem, (at, values, slack) in series.items():
            for which, last in (("max", np.inf), ("judged", rec["judged_to_s"]), ("end", rec["t_reached_s"])):
                span = at == last if which == "end" else at <= last
                for name in [name for name in rec if re.fullmatch(f"{stem}_{which}(_.*)?", name) and span.any()]:
                    value = None if values is None else values[span].max() if which == "end" else np.abs(values[span]).max()
                    test(name, value, EPS * slack, every or which == "end" or peaks.get(name) in at)
        step, spun = (np.diff(t)[:, None, None] * (a[1:] + a[:-1]) / 2 for a in (v, w))
        off, path = p.spread(r[:-1] + step - r[1:], R[:-1] @ exp(spun) - R[1:]).sum(0), p.spread(r[1:] - r[:-1], R[1:] - R[:-1]).sum(0)
        defect = (off / (np.maximum(path, p.spread(step, hat(spun)).sum(0)) + 0.01 * length)).max()
        test("kinematic_defect", defect if every and len(s) > 1 else None, 1e-9, why="not every step is kept")
        for column in filter(peaks.__contains__, ("motion_between_max_m", "reaction_error_max_N", "reaction_size_N")):
            (x, y), value, between = (a[a[:, 0] == peaks[column]] for a in (p.exact, s)), None, column == "motion_between_max_m"
            if between and len(x) and (every or run["between"]):
                value = p.spread(*map(np.subtract, p.find_between(s, peaks[column]), unpack(x)[:2])).max()
            elif not between and len(x) and not p.user and (len(y) or column == "reaction_size_N"):
                told = 0 if column == "reaction_size_N" else np.tensordot(run["reaction"], p.differentiate(y)[0][p.joint], 1)
                value = norm((p.accelerate(x)[1] - told)[..., :3]).max()
            test(column, value, EPS * big if between else 1e-6 * rec["reaction_size_N"])
        units = {"J": energy, "m": length, "m/s": speed, "rad/s": speed / reach, "kg m/s": momentum, "kg m2/s": momentum * reach}
        mv, spins, broken = v * p.mass[:, None], np.einsum("tbij,bjk,tbk->tbi", R, p.inertia, w), False
        fields = {"spin": spins, "momentum": mv.sum(1)[:, None], "angular momentum": (np.cross(r, mv) + spins).sum(1)[:, None]}
        for name, drift in json.loads(rec["invariant_drifts"]).items():
            about = {"quantity": "", "along": ZERO, "unit": drift["unit"]} | p.invariants.get(name, {})
            values, scale = fields.get(about["quantity"], w)[:, about.get("body", 0)] @ about["along"], units[about["unit"]]
            slack, told, ended = EPS * max(np.nanmax(np.abs(values)), scale), about["quantity"] and t[0] == 0, t[-1] == rec["t_reached_s"]
            for key, x in (("start", values[0]), ("end", values[-1] - values[0]), ("max", np.abs(values - values[0]).max())):
                test(f"invariant {name}: {key}", x if told and (ended or key != "end") else None, slack, every or key != "max", drift[key])
            broken |= float(drift["max"]) > 0.1 * max(scale, abs(float(drift["start"])))
        if rec["claimed"] != "success":  # else of compared columns, and of recorded ones where the bundle cannot decide
            return test("status of a failure", rec["status"] in {"success", "wrong", "inaccurate"}, recorded=False)
        drift = rec["energy_drift_max_J"] / (0.1 * energy) if single else shares["energy"].max() if known else 0
        moved, force = np.abs(s - p.start)[0, 1:-1].max() if t[0] == 0 else np.nan, rec["reaction_size_N"] + energy / length
        excess = {"end": abs(rec["t_reached_s"] - p.t_end) > 1e-9 * max(p.t_end, 1), "start": moved > 1e-9 * (1 + length + speed)}
        excess |= {"energy": drift > 1, "constraint": rec["gap_share_max"] > 1, "constraint_rate": rec["gap_rate_share_max"] > 1}
        excess |= {"orthogonality": rec["orthogonality_max"] > 1e-3, "reaction": rec["reaction_error_max_N"] > 10 * force}
        excess |= {"kinematic": rec["kinematic_defect"] > 0.5, "invariant": broken, "velocity": rec["rate_error_judged_m_per_s"] > speed}
        excess |= {"motion": rec["motion_error_judged_m"] > 0.1 * length + own, "rows": rec["motion_between_max_m"] > 0.5 * length + own}
        found = {law for law, too_much in excess.items() if too_much}
        near, decided, why = n and not found & SOFT, every and not p.user, "user forces are code" if p.user else "not every step is kept"
        self.undecided += [(why, "law truncation")] if near and not decided else []
        off = max(p.find_truncation(s, reactions, speed), unexplained) > 1 if near and decided else near and "truncation" in stated
        found |= {"truncation"} if off else set()
        found -= {"rows"} if found & {"motion", "velocity"} else set()
        test("status", "wrong" if found - SOFT else "inaccurate" if found else "success")
        return test("wrong_because", sorted(found - SOFT or found), recorded=stated)


def main(path):  # print a table of agreement
    np.seterr(all="ignore")
    try:
        report = Report(Path(path))
    except Exception as error:  # whatever the file may cause
        print(f"{path}: unreadable: {type(error).__name__}: {error}"[:400].encode("unicode_escape").decode())
        return 2
    counts = f"{report.runs} runs checked, {report.numbers} numbers compared, {len(report.findings)} disagreements"
    print(f"{path}: {counts}, {len(report.undecided)} undecided", *report.findings, sep="\n")
    for why in sorted({why for why, _ in report.undecided}):
        columns = [what for cause, what in report.undecided if cause == why]
        print(f"  {why}:", *(f"{what} {columns.count(what)}," for what in sorted(set(columns))))
    return min(len(report.findings), 1)


if __name__ == "__main__":
    sys.exit(max(map(main, sys.argv[1:]), default=2))
