"""Check bundles of results from docs/bundle.md alone: recompute what their records state. See README.md."""

import hashlib
import io
import json
import re
import signal
import sys
import tomllib
import zipfile
from functools import partial
from pathlib import Path

import numpy as np

NAMES = re.compile(r"((runs|references|series)/[\w-]{1,64}\.npy|(problems/)?[\w.-]{1,64}\.(json|toml|txt))", re.ASCII)
MAX_FILES, MAX_BYTES, MAX_JSON, MAX_VALUES = 20_000, 1 << 30, 1 << 24, 3_000_000
REL, EPS, STEP, ZERO, ONE = 1e-6, 1e-12, 1e-30, np.zeros(3), np.eye(3)  # tolerance, rounding, step of derivatives
LIMITS = {"energy": 0.1, "orthogonality": 1e-3, "gap": 0.01, "gap_rate": 0.05}  # what laws allow, of scales
SOFT = {"motion", "velocity", "rows"}  # laws that an inaccurate motion breaks
SHAPES = """mass:b inertia:b33 gyration:b gravity:3 start_r:b3 start_R:b33 start_v:b3 start_Omega:b3 user_i:u user_j:u
 joint_i:j joint_j:j joint_s_i:j3 joint_s_j:j3 joint_u:j3 joint_w:j3 joint_n:j33 joint_length:j joint_motion:j7
 joint_k:j joint_c:j joint_points:j joint_lines:j joint_axes:j joint_moving:j"""  # by bodies, user forces, joints
ROWS = {"points": 3, "lines": 3, "axes": 3, "driven position": 1, "driven distance": 1, "driven angle": 1, "spring": 1}
ROWS |= {"knife edge": 1, "rolling disc": 3, "rack and pinion": 1, "torsion": 1, "load": 1}  # rare: from place 13 on
PLACES, HALVES, ANGLES = [(kind, k) for kind in ROWS for k in range(ROWS[kind])], [8, 11], [6, 7, 8, 11]
JUDGED = ("success", "inaccurate", "wrong")  # what a claimed success may be
UNFINISHED = {"wall_limit", "cpu_limit", "code_limit", "total_limit", "measure_limit", "suspended"}  # what ends a run
ACCURATE = {"accurate_until_s": 0.1, "accurate_until_1pct_s": 0.01, "accurate_until_0p1pct_s": 0.001}  # of the length
SHARES = {"energy": "energy_share_max", "gap": "gap_share_max", "gap_rate": "gap_rate_share_max"}
SHARES["orthogonality"] = "orthogonality_max"
INSTANTS = ("motion_between_max_m", "reaction_error_max_N", "reaction_size_N")  # maxima at times of their own
COMPARED = ("position_error", "orientation_error", "reference_own_error")  # series against the exact motion
COSTS = ("cpu_min_s", "cpu_q1_s", "cpu_median_s", "cpu_q3_s", "cpu_max_s", "cpu_call_s", "cpu_import_s",
         "cpu_refuses_s", "cpu_process_s", "setup_s", "code_s", "wall_s", "measure_s", "peak_memory_MB", "cpu_limit_s",
         "wall_limit_s", "memory_limit_MB", "repeats", "events", "steps")  # fmt: skip
CLOCK = 0.05  # [s] by which readings of clocks may differ
NEARLY = 0.6, 1.6  # of the fixed step asked for: the median of the steps taken
COMPLETE = "--complete"  # demand of every success all its states, whatever the bundle calls itself
dot, norm, turn = partial(np.einsum, "...k,...k"), partial(np.linalg.norm, axis=-1), partial(np.einsum, "tkij,kj->tki")
hat = partial(np.einsum, "ijk,...j", np.cross(ONE[:, None], ONE))  # the matrix of w x


def exp(w):
    """Return the rotation by the angle |w| about w."""
    x, W = norm(w)[..., None, None] / np.pi, hat(w)
    return ONE + np.sinc(x) * W + np.sinc(x / 2) ** 2 / 2 * W @ W


def angle(y, x, less=0.0):
    """Return atan2 of complex steps less an angle, within half a turn."""
    turned = np.arctan2(y.real, x.real) + 1j * (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2) - less
    return turned - 2 * np.pi * np.round(turned.real / (2 * np.pi))


def log(R, near=ZERO, W=0):
    """Return the rotation vector of the nearest rotation, and its rate (W: complex step).

    Of vectors that differ by whole turns it is the one near another.
    """
    U, _, V = np.linalg.svd(np.where(np.isfinite(R), R, 0))
    a = ((R := U @ V @ (ONE + 1j * STEP * W)) - np.swapaxes(R, -1, -2))[..., [2, 0, 1], [1, 2, 0]] / 2
    sine = np.sqrt(dot(a, a) + 0j)[..., None]
    axis, turned = a / np.where(sine == 0, 1, sine), angle(sine, (np.trace(R, 0, -2, -1)[..., None] - 1) / 2)
    return axis * (turned + 2 * np.pi * np.round((dot(near, axis.real)[..., None] - turned.real) / (2 * np.pi)))


def unpack(s):
    """Return r, R, v, Omega of each body, and the matrix of Omega x, of states in rows."""
    b = s[:, 1:-1].reshape(len(s), s.shape[1] // 18, 18)
    return b[..., :3], b[..., 3:12].reshape(*b.shape[:2], 3, 3), b[..., 12:15], b[..., 15:], hat(b[..., 15:])


def demand(condition, message):
    """Refuse the bundle unless a condition holds."""
    if not condition:
        raise ValueError(message)


def read_files(path):
    """Return the members of the archive, parsed after sizes, names and digests have been verified."""
    sound = path.is_file() and path.stat().st_size <= MAX_BYTES and path.read_bytes().count(b"PK\1\2") <= MAX_FILES
    demand(sound, "no file of at most 1 GiB with at most 20,000 members")
    archive, files = zipfile.ZipFile(path), {}
    demand(sum(member.file_size for member in archive.infolist()) <= MAX_BYTES, "more than 1 GiB unpacked")
    for member in archive.infolist():
        name, plain = member.orig_filename, member.external_attr >> 28 in {0, 8} and member.compress_type in {0, 8, 12}
        demand(
            plain and NAMES.fullmatch(name) and name not in files,
            f"unexpected, duplicate or special file {name[:80]!r}",
        )
        files[name] = archive.open(member).read(member.file_size)
    listed = files.pop("manifest-sha256.txt").decode("ascii").splitlines()
    wrong = set(listed) ^ {f"{hashlib.sha256(raw).hexdigest()}  {name}" for name, raw in files.items()}
    demand(not wrong and len(listed) == len(files), f"{sorted(wrong)[:1]!r:.160} differs from the manifest")
    for name, raw in files.items():
        if name.endswith(".npy"):  # a row each: t; r, R, v, Omega of each body; what is stated
            files[name] = a = np.lib.format.read_array(io.BytesIO(raw), allow_pickle=False).T
            demand(
                a.dtype == "<f8" and not (a.ndim == 2 and (np.diff(a[:, 0]) <= 0).any()),
                f"{name}: no numbers, or times not in order",
            )
        elif name.endswith(".json"):
            demand(
                len(raw) <= MAX_JSON and sum(map(raw.count, (b",", b"[", b"{"))) <= MAX_VALUES, f"{name} is too large"
            )
            files[name] = json.loads(
                raw, object_pairs_hook=lambda a: dict(a) if len(dict(a)) == len(a) else demand(0, "a key twice")
            )
    return files


class Problem:
    """The validated numbers and the exact motion of a problem, and the laws of mechanics for states in rows."""

    def __init__(self, data, exact, name):
        self.kinds, self.t_end = np.array(data["joint_kinds"], "U40"), float(data["t_end_s"])
        self.read_numbers(data["numbers"], name)
        self.place_rows()
        self.read_switches(data)
        self.find_mechanisms()
        self.read_exact(exact, data["reference"])

    def read_numbers(self, numbers, name):
        """Take every number under its name; refuse those that are not finite or not of their shape."""
        sizes, own = {"3": 3, "7": 7}, vars(self)
        for key, letters in (entry.split(":") for entry in SHAPES.split()):
            a = np.array(numbers[key], float)
            shape = tuple(sizes.setdefault(letter, len(a)) for letter in letters)
            a, body = a.reshape(shape) if 0 in shape else a, letters in "uj" and key.endswith(("_i", "_j"))
            known = a.shape == shape and np.isfinite(a).all() and not (body and ((a < -1) | (a >= sizes["b"])).any())
            demand(known, f"{name}: {key} is not finite, of shape {shape} or beyond the bodies")
            own[key.removeprefix("joint_")] = a.astype(int) if body else a
        self.nb, self.user_count, nb = sizes["b"], sizes["u"], sizes["b"]
        sound = 0 < nb <= 2000 and max(sizes.values()) <= 50 * nb + 50
        sound = sound and (self.mass > 0).all() and 0 < self.t_end < np.inf and len(self.kinds) == sizes["j"]
        demand(
            sound and set(self.kinds[self.moving > 0]) <= set(ROWS), f"{name}: bodies, masses, joint_kinds or t_end_s"
        )
        normal = numbers.get("planar_normal")
        self.normal = None if normal is None else np.array(normal, float).reshape(3)

    def place_rows(self):
        """Find the joint and the place in PLACES of each row of phi, and which rows are of joints and of loads."""
        own, moving = vars(self), [self.moving * (self.kinds == kind) for kind, _ in PLACES]
        counts = [own.get(kind, some) > k for (kind, k), some in zip(PLACES, moving, strict=True)]
        self.of, self.place = np.nonzero(np.transpose(counts))
        self.joints, self.rare = ~np.isin(self.kinds, ("spring", "torsion", "load")), self.place.max(initial=0) > 12
        self.joint, self.pushes = self.joints[self.of], (self.kinds == "load")[self.of]

    def read_switches(self, data):
        """Take what turns laws on and off: a literal start, forces that are code, work, invariants."""
        self.literal, self.user = bool(data["literal_start"]), bool(self.user_count or data["not_serialised"])
        self.has_work = bool(self.user or self.c.any() or self.motion.any())
        self.invariants = {about["name"]: about for about in data["invariants"]}
        self.laws = tuple(LIMITS)[: 4 if self.joints.any() and not self.literal else 2]

    def find_mechanisms(self):
        """Find bodies that joints and forces join, which of these are held by the ground, and how far joints reach."""
        nb, arms = self.nb, norm(np.append(self.s_i, self.s_j, 0)) * np.tile(self.joints, 2)
        ends = np.array([[*self.i, *self.user_i], [*self.j, *self.user_j]], int)
        at, group = np.append(self.i, self.j), np.arange(nb)
        for i, j in ends.T:
            group[group == group[i]] = group[j] if min(i, j) >= 0 else group[i]
        self.whole, self.parts = np.ones(nb, bool), [group == g for g in np.unique(group)]
        holds = (ends < 0).any(0) & np.append(self.joints | (self.kinds == "spring"), self.user_i < nb)
        self.held, self.arm = np.isin(np.arange(nb), ends[:, holds]), np.append(self.gyration, 0)
        np.maximum.at(self.arm, at, arms)
        self.arms = np.bincount(at + 1, arms, nb + 1)[1:]
        self.loose = np.bincount(at + 1, np.tile(self.joints & (self.points < 1), 2), nb + 1)[1:] > 0
        self.rim = self.gyration.max() + self.arms.sum()

    def read_exact(self, exact, reference):
        """Take the start and the exact motion, and those of its states that set scales."""
        own = vars(self)
        start = [own[f"start_{key}"].reshape(self.nb, -1) for key in ("r", "R", "v", "Omega")]
        self.start, self.route = np.array([[0, *np.concatenate(start, 1).ravel(), 0]]), str(reference["route"])
        self.horizon = -np.inf if exact is None else float(reference["horizon_s"])
        self.exact = self.start[:0] if exact is None else exact
        even = self.exact[:, 0] / min(self.t_end, self.horizon) * 2000
        sets = (np.abs(even - np.round(even)) < 1e-7) & (even <= 2000 * (1 + EPS))
        self.sizing = np.append(self.start, self.exact[sets], 0)

    def spread(self, r, D):
        """Return the root mean square of r + Ds over the matter s of each body: of changes of poses or velocities."""
        half = np.trace(self.inertia, axis1=1, axis2=2)[:, None, None] * ONE / 2 - self.inertia
        return np.sqrt(dot(r, r) + np.maximum(np.einsum("tbij,bjk,tbik->tb", D, half, D) / self.mass, 0))

    def find_rows(self, s, speeds=None, ahead=0.0):
        """Return phi and its rate of all rows, and which gaps are half a turn off: a step ahead, or at given speeds."""
        r, R, v, w, _ = unpack(
            np.concatenate([s[:, :-1], np.tile([*ZERO, *ONE.ravel(), *ZERO, *ZERO], (len(s), 1)), s[:, -1:]], 1)
        )
        step, c, t, L, ends = 1j * STEP, self.motion, s[:, :1] + ahead + 1j * STEP * (speeds is None), self.length, []
        f = c[:, 0] + t * (c[:, 1] + t * (c[:, 2] + t * c[:, 3])) + c[:, 4] * np.sin(c[:, 5] * t + c[:, 6])
        for end, b in enumerate((self.i, self.j)):
            V, W = (v[:, b], w[:, b]) if speeds is None else speeds[end]
            ends.append((r[:, b] + (ahead + step) * V, R[:, b] @ (ONE + ahead * hat(W)) @ (ONE + step * hat(W))))
        (r, R), (r_j, R_j) = ends
        u, w, (n1, n2, n3) = turn(R, self.u), turn(R, self.w), (turn(R_j, self.n[:, k]) for k in range(3))
        x, x_j, across = r + turn(R, self.s_i), r_j + turn(R_j, self.s_j), n1 - dot(n1, u)[..., None] * u
        d, low = x - x_j, x - L[:, None] * across / np.sqrt(dot(across, across))[..., None]
        rows = [
            *np.moveaxis(d, 2, 0),
            np.where(self.kinds == "distance", (dot(d, d) / L - L) / 2, dot(n1, d)),
            dot(n2, d),
            dot(n3, d),
        ]
        rows += [dot(u, n1), dot(u, n2), dot(w, n2), dot(n1, d) - f, np.sqrt(dot(d, d)) - f]
        rows += [dot(u, n1) * np.cos(f) + dot(u, n2) * np.sin(f), np.sqrt(dot(d, d)) - L]
        if self.rare:  # slips of the matter of both bodies at x and at the lowest point; the power of a load
            matter = (
                [(r + (R @ R.real.swapaxes(2, 3) @ (p - r).real[..., None])[..., 0]).imag for r, R in ends]
                for p in (x, low)
            )
            slip, low_slip = (1j * (v_i - v_j) for v_i, v_j in matter)
            force, torque = (
                f.real[..., None] * np.where(L[:, None] > 0, a.real, b) for a, b in ((u, self.u), (w, self.w))
            )
            rows += [
                dot(u.real, slip) - step * f.real,
                dot(n1, low - x_j),
                dot(n2.real, low_slip),
                dot(n3.real, low_slip),
            ]
            rows += [
                L * angle(dot(np.cross(n1, n2), np.cross(u, n2)), -dot(n2, u), -dot(n2, d) / L),
                angle(dot(u, n2), dot(u, n1), L),
            ]
            rows += [1j * (dot(force, x.imag) + np.sum(hat(torque) @ R.real * R.imag, (2, 3)) / 2)]
        half = (
            np.where(self.kinds == "driven angle", dot(u, n2) * np.cos(f) - dot(u, n1) * np.sin(f), -dot(w, n1)).real
            > 0
        )
        phi, half = np.array(rows)[self.place, :, self.of].T, half[:, self.of] & np.isin(self.place, HALVES)
        return phi.real, phi.imag / STEP, half  # where its gap is half a turn off

    def measure(self, s, part):
        """Return the series of a mechanism, computed in pieces of bounded memory."""
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
        bodies = {
            "reach": moved,
            "speed": speed,
            "orthogonality": np.linalg.norm(R.swapaxes(2, 3) @ R - ONE, axis=(2, 3)),
        }
        m = {
            "T": speed**2 @ m / 2,
            "V": elastic + own_high,
            "E": self.spread(v, W) ** 2 @ m / 2 + high + elastic,
            "momentum": speed @ m,
        }
        return (
            m
            | {key: a[:, part].max(1) for key, a in bodies.items()}
            | {key: norm(a[:, mine]) for key, a in rows.items()}
        )

    def find_scales(self, s, first, part):
        """Return the series of a mechanism and its scales: of exact states, then of the run until a law is broken."""
        m, known = self.measure(s, part), self.measure(self.sizing, part)
        start, late = (known if s[0, 0] else m)["E"][0], (s[:, 0] > self.horizon * (1 + EPS)) & (s[:, 0] < first)
        m["energy"], keys = s[:, -1] if self.has_work else m["E"] - start, ("reach", "speed", "T", "V", "momentum")
        reach, speed, T, V, momentum = (np.append(known[key], m[key][late]) for key in keys)
        T[len(known["T"]) :] -= np.maximum(m["energy"][late], 0)  # energy gained was not there to be exchanged
        stretch = np.inf if self.loose[part].any() else 2 * (self.arms[part].sum() + self.gyration[part].max())
        size = {
            "reach": reach.max(),
            "length": (known["reach"] if len(self.exact) else reach).max(),
            "stretch": stretch,
        }
        size |= {
            "gap": min(reach.max(), stretch),
            "gap_rate": speed.max(),
            "momentum": momentum.max(),
            "orthogonality": 1.0,
        }
        return m, size | {"energy": max(T.max(), np.ptp(V)), "energy start": start}

    def differentiate(self, s):
        """Return A, the rates of all rows by those of each body, v and Omega."""
        A, still = np.zeros((len(s), len(self.of), self.nb + 1, 6)), self.find_rows(s, np.zeros((2, 2, 3)))[1]
        for n, unit in enumerate(np.eye(12).reshape(12, 2, 2, 3)):
            A[:, np.arange(len(self.of)), (self.i, self.j)[n // 6][self.of], n % 6] += (
                self.find_rows(s, unit)[1] - still
            )
        return A[:, :, :-1]

    def accelerate(self, s):
        """Return the rates of v and Omega, and the joints' forces and torques on bodies, by the laws of motion."""
        (*_, w, W), (phi, rate, _), A, n, m = unpack(s), self.find_rows(s), self.differentiate(s), len(s), 6 * self.nb
        f = -np.einsum("tr,trbk->tbk", self.k[self.of] * phi + self.c[self.of] * rate - self.pushes, A)
        f += np.append(
            f[..., 3:] * 0 + self.mass[:, None] * self.gravity, -np.einsum("tbij,bjk,tbk->tbi", W, self.inertia, w), 2
        )
        h, M = (
            1e-5 / max(1, np.abs(w).max(), np.abs(self.motion[:, 5]).max(initial=0)),
            np.zeros((self.nb, 6, self.nb, 6)),
        )
        for b in range(self.nb):
            M[b, :3, b, :3], M[b, 3:, b, 3:] = self.mass[b] * ONE, self.inertia[b]
        drift = (self.find_rows(s, ahead=-h)[1] - self.find_rows(s, ahead=h)[1])[:, self.joint, None] / (2 * h)
        A, M, unit = A[:, self.joint].reshape(n, -1, m), np.tile(M.reshape(m, m), (n, 1, 1)), self.mass.max()
        laws = np.block([[M / unit, A.swapaxes(1, 2)], [A, np.zeros((n, A.shape[1], A.shape[1]))]])
        a = (np.linalg.pinv(laws, 1e-12, hermitian=True) @ np.append(f.reshape(n, m, 1) / unit, drift, 1))[:, :m]
        return a.reshape(f.shape), (M @ a).reshape(f.shape) - f

    def find_top_error(self):
        """Return how far Lagrange's top is from u = u1 + (u2-u1) sn^2, the cosine to the vertical."""
        (_, R, _, w, _), J, size, g = (
            unpack(np.append(self.start, self.exact, 0)),
            self.inertia[0],
            norm(self.s_i[0]),
            norm(self.gravity),
        )
        w, arm, up, mgl = (
            w[:, 0],
            -self.s_i[0] / size,
            -self.gravity / g @ R[:, 0],
            self.mass[0] * size * g,
        )  # in the body
        axial, I = arm @ J @ arm, (np.trace(J) - arm @ J @ arm) / 2 + self.mass[0] * size**2
        u, du, c, d = up @ arm, dot(up, np.cross(w, arm)), axial * (w[0] @ arm) / I, 2 * mgl / I
        a, b = w[0] @ w[0] - (w[0] @ arm) ** 2 + d * u[0], up[0] @ (w[0] - arm * (w[0] @ arm)) + c * u[0]
        u1, u2, u3 = np.sort(np.roots([d, -a - c**2, 2 * b * c - d, a - b**2]).real)
        part, (x, weights), speed = (
            (u2 - u1) / (u3 - u1),
            np.polynomial.legendre.leggauss(100),
            np.sqrt(d * (u3 - u1)) / 2,
        )
        phase = (
            np.append(np.arcsin(np.copysign(np.sqrt(((u - u1) / max(u2 - u1, STEP)).clip(0, 1)), du)), np.pi / 2)[
                :, None
            ]
            / 2
        )
        *z, quarter = (phase / np.sqrt(1 - part * np.sin(phase * (x + 1)) ** 2)) @ weights  # elliptic integrals
        off = np.array(z[1:]) - z[0] - speed * self.exact[:, 0]
        return (off - 2 * quarter * np.round(off / (2 * quarter))) * du[1:] / speed + (u - u.clip(u1, u2))[1:]

    def find_between(self, s, at):
        """Return the poses at a time by the cubics of the steps around it."""
        k = min(max(np.searchsorted(s[:, 0], at, "right") - 1, 0), len(s) - 2)
        (r, R, v, w, W), h = (a[k : k + 2] for a in unpack(s)), s[k + 1, 0] - s[k, 0]
        theta, x = (
            log(R[0].swapaxes(1, 2) @ R[1], h / 2 * w.sum(0), W[1]),
            (at - s[k, 0]) / h,
        )  # beyond half a turn a series:
        rate = np.where(
            norm(a := theta.real)[:, None] < np.pi,
            theta.imag / STEP,
            w[1] + np.cross(a, w[1] / 2 + np.cross(a, w[1]) / 12),
        )
        weights, steps = (
            (x**2 * (3 - 2 * x), h * x * (1 - x) ** 2, h * x**2 * (x - 1)),
            ((r[1] - r[0], *v), (a, w[0], rate)),
        )
        shift, turned = (sum(map(np.multiply, weights, step)) for step in steps)
        return r[0] + shift, R[0] @ exp(turned)

    def field(self, w, W=ZERO, turned=ZERO):
        """Return the velocity or acceleration field of a body's matter, seen an angle later."""
        return w[..., :3], exp(turned) @ (hat(w[..., 3:]) + hat(W) @ hat(W))

    def find_truncation(self, s, reaction, speed):
        """Return the largest of three sums of errors over sums of what the steps leave open."""
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
        for (w1, w2), told, (W1, W2), counted, size in (
            *sides,
            (rates, a, spins, counts, self.spread(*self.field(V[k])).max()),
        ):
            last, first = self.field(w2, W2, h2 / 2 * spins[1]), self.field(w1, W1, -h1 / 2 * spins[0])
            left = self.spread(last[0] - first[0], last[1] - first[1]) + 0.01 * counted + size * rounded
            sums.append((self.spread(*self.field((h2 * w1 + h1 * w2) / (h1 + h2) - told)), left))
        if reaction is not None:
            per = np.repeat(np.stack([np.ones(self.nb), self.arm[:-1]], 1), 3, 1)
            A, pull = self.differentiate, partial(np.einsum, "tr,trbk->tbk")
            before, here, after = (pull(reaction[j], A(s[j])[:, self.joint]) / per for j in (k - 1, k, k + 1))
            left = 0.01 * np.maximum(norm(load / per).max(1, keepdims=True), self.mass * slow)
            sums.append((norm(here - load / per), left + norm(here - before) + norm(after - here)))
        known = [np.array([both for both in zip(*pair, strict=True) if np.isfinite(both).all()]) for pair in sums]
        summed = [pairs.sum(0) for pairs in known if len(pairs)]
        return max((np.where(off > 0, off / left, 0).max() for off, left in summed), default=0.0)


class Run:
    """The states of one run, and the laws by which its record follows from them; ``check`` compares all of it."""

    def __init__(self, report, p, run, rec, states, rows):
        self.report, self.compare, self.claim = report, report.compare, report.claim
        self.p, self.run, self.rec, self.s, self.rows, self.peaks = p, run, rec, states, rows, run["peaks_s"]
        self.t, (self.r, self.R, self.v, self.w, self.W), self.n = states[:, 0], unpack(states), len(p.exact)
        self.every, self.single, self.covered = run["states"] == "every step", len(p.parts) == 1, p.horizon >= p.t_end
        self.good = np.isfinite(states[:, :-1]).all(1)
        self.stated = sorted({reason["law"] for reason in json.loads(rec["wrong_because"])})
        self.first = min((at for key, at in self.peaks.items() if ":first" in key), default=np.inf)
        self.big = np.abs(self.r[self.good]).max(initial=0) + p.rim
        self.compared = False  # whether every step has its exact state

    def check(self):
        """Compare the record with every law, in the order in which they build on each other."""
        self.check_times()
        self.check_steps()
        if self.rec["claimed"] == "success" and not self.good.all():
            found = self.rec["status"], self.stated
            self.compare("status and reason", ("wrong", ["finite"]), recorded=found)
            return
        self.find_sizes()
        self.check_scales()
        self.check_limits()
        self.check_trend()
        self.check_plane()
        series = self.list_series()
        self.check_maxima(series)
        self.check_errors_in_time()
        self.check_peaks(series)
        self.check_first_breaks()
        self.check_kinematics()
        self.check_instants()
        self.check_reaction()
        self.check_invariants()
        self.check_rows(series)
        self.check_status()

    def check_times(self):
        """The run ended at its last state, and its states begin at 0 where all are there."""
        self.compare("t_reached_s", float(self.t[-1]), 0.0, self.every)
        if self.every and self.rec["claimed"] == "success":
            self.claim("time of the first state", self.t[0] == 0 or "start" in self.stated, self.t[0], 0.0)

    def check_steps(self):
        """Steps lie between the states: their number and sizes, the last one aside, and the fixed step asked for."""
        steps, count = np.diff(self.t), float(len(self.t) - 1)
        self.compare("steps", count, 0.0, self.every)
        if not self.every:
            self.claim("states", count != self.rec["steps"], "some steps", "every step")
        whole = steps[:-1] if len(steps) > 1 else steps
        known = self.every and len(whole) > 0
        sizes = {"step_min_s": whole.min, "step_max_s": whole.max, "step_median_s": partial(np.median, whole)}
        sizes["step_ratio"] = lambda: whole.max() / whole.min()
        for column, find in sizes.items():
            self.compare(column, float(find()) if known else None, EPS * self.t[-1] * (column != "step_ratio"))
        if known and self.rec["control"] == "dt":
            asked, middle = self.rec["dt_s"], np.median(whole)  # that many whole steps may not fit into the time
            fits = NEARLY[0] * asked <= middle <= NEARLY[1] * asked
            if self.rec["status"] == "success" and self.rec["suite"] != "refereed":  # whose step is what its user says
                self.claim("dt_s", fits, asked, middle)
            elif not fits:
                self.report.weaken("without success whose steps are not the fixed step asked for")

    def find_sizes(self):
        """Measure the run, and find its scales and those of its mechanisms."""
        p, rec = self.p, self.rec
        self.m, self.size = p.find_scales(self.s, self.first, p.whole)
        self.fast = np.nanmax(p.spread(self.v, self.W)) + self.big
        self.weight = np.nanmax(self.m["T"] + np.abs(self.m["E"] - self.m["T"]))
        self.rest = self.size["reach"] < 1e-6 * self.big
        self.told = dict(self.size)
        for key, column in (
            ("length", "length_scale_m"),
            ("gap_rate", "speed_scale_m_per_s"),
            ("energy", "energy_scale_J"),
        ):
            self.told[key] = rec[column]
        if self.covered or not self.n:
            stretch = np.inf if self.rest else self.size["stretch"]
            self.told |= {"gap": min(rec["length_scale_m"], stretch), "reach": rec["length_scale_m"]}
        moving = [] if self.single else [p.find_scales(self.s, self.first, part) for part in p.parts]
        self.parts = moving or [(self.m, self.told)]
        far = all(one["reach"] > 1e-6 * self.big for _, one in moving)
        whole = self.every or self.covered or not self.n
        self.known = whole if self.single else self.every and not p.has_work and far
        shares = (
            part * rec["length_scale_m"] / one["length"] for part, (_, one) in zip(p.parts, self.parts, strict=True)
        )
        self.ratio = 1 if self.single else sum(shares)
        self.shares = {
            law: np.max([np.abs(m[law]) / (LIMITS[law] * size[law]) for m, size in self.parts], 0) for law in p.laws
        }

    def check_scales(self):
        """Scales are maxima over the exact motion, and beyond its horizon over the run."""
        kept = np.isin([at for key, at in self.peaks.items() if "scale " in key], self.p.exact[:, 0]).all()
        self.claim("scales kept", bool(kept) or not self.n, "their times", "exact states")
        self.compare("energy_start_J", self.size["energy start"], EPS * self.weight)
        full = (self.every or self.covered) and not self.rest
        self.compare("length_scale_m", self.size["length"], 0.0, full)
        self.compare("speed_scale_m_per_s", self.size["gap_rate"], 0.0, full)
        self.compare("energy_scale_J", self.size["energy"], 1e-9 * self.weight, full)

    def check_limits(self):
        """Limits of phi and phi_dot are stated where these are what is judged, and follow from the scales."""
        p, judged = self.p, self.single and len(self.p.laws) > 2 and not (self.p.axes > 0).any()
        judged |= not self.p.joint.any() and self.single and not p.literal
        for column, law in (("phi_limit_m", "gap"), ("phi_dot_limit_m_per_s", "gap_rate")):
            if judged:
                self.compare(column, LIMITS[law] * self.told[law] if self.known else None)
            else:
                self.claim(column, np.isnan(self.rec[column]), self.rec[column], "nan")

    def check_trend(self):
        """The line of least squares through the energy error, and its means over the first and last quarter."""
        t, e, span = self.t, self.m["energy"], np.ptp(self.t)
        known = self.every and len(t) > 2 and np.isfinite(e).all()
        weight = (np.append(np.diff(t), 0) + np.insert(np.diff(t), 0, 0)) / 2
        off = t - (weight @ t) / weight.sum()
        slope = weight * off @ (e - (weight @ e) / weight.sum()) / (weight * off @ off) if known else None
        self.compare("energy_trend_W", slope, EPS * self.weight / span if known else 0.0)
        for column, low, high in (
            ("energy_mean_first_quarter_J", t[0], t[0] + 0.25 * span),
            ("energy_mean_last_quarter_J", t[-1] - 0.25 * span, t[-1]),
        ):
            inside = (t >= low) & (t <= high)
            if known and inside.sum() > 1:
                self.compare(column, np.trapezoid(e[inside], t[inside]) / np.ptp(t[inside]), EPS * self.weight)
            else:
                self.compare(column, None)

    def check_plane(self):
        """A planar motion stays in its plane."""
        if self.p.normal is None:
            self.claim(
                "out_of_plane_max_m", np.isnan(self.rec["out_of_plane_max_m"]), self.rec["out_of_plane_max_m"], "nan"
            )
            return
        away = self.r @ self.p.normal
        self.away = np.abs(away - away[0]).max(1)
        full = self.every or self.peaks.get("out_of_plane_max_m") in self.t
        known = self.every or self.t[0] == 0
        self.compare("out_of_plane_max_m", self.away.max() if known else None, EPS * self.big, full)

    def list_series(self):
        """List what is measured along the states: times, values, and the size of their rounding, by stem of column."""
        p, t, m = self.p, self.t, self.m
        known, single, self.unexplained = self.known, self.single, 0.0
        series = {"phi": (t, m["phi"], self.big), "phi_dot": (t, m["phi_dot"], self.fast)}
        series |= {"energy_drift": (t, m["energy"], self.weight), "orthogonality": (t, m["orthogonality"], 1)}
        series["gap_share"] = t, self.shares.get("gap") if known else None, 1e3
        series["gap_rate_share"] = t, self.shares.get("gap_rate") if known or single else None, 1e3
        self.at, covered = t[:0], t[t <= p.horizon * (1 + EPS)]
        if not self.n:
            return series
        (self.at, beside, k), spin = (
            np.intersect1d(t, p.exact[:, 0], return_indices=True),
            1 + np.abs(self.w[self.good]).max(initial=0),
        )
        differences = zip(unpack(self.s[beside]), unpack(p.exact[k]), strict=True)
        dr, dR, dv, dw, dW = (a - b for a, b in differences)
        self.sure, self.compared = p.exact[k, -1], self.every and len(self.at) == len(covered)
        turned = 2 * np.arcsin((np.linalg.norm(dR, axis=(2, 3)).max(1) / np.sqrt(8)).clip(0, 1))
        self.apart, self.rate = (p.spread(dr, dR) * self.ratio).max(1), (p.spread(dv, dW) * self.ratio).max(1)
        whole = known or single
        for stem, values, slack in (
            ("position_error", norm(dr).max(1), self.big), ("orientation_error", turned, 1e4),
            ("velocity_error", norm(dv).max(1), self.fast), ("angular_velocity_error", norm(dw).max(1), spin),
            ("motion_error", self.apart if whole else None, self.big),
            ("rate_error", self.rate if whole else None, self.fast),
            ("reference_own_error", self.sure, 1e-3 * self.big),
        ):  # fmt: skip
            series[stem] = self.at, values, slack
        return series

    def check_maxima(self, series):
        """The largest, the last and the largest judged value of each series."""
        for stem, (at, values, slack) in series.items():
            for which, last in (("max", np.inf), ("judged", self.rec["judged_to_s"]), ("end", self.rec["t_reached_s"])):
                span = at == last if which == "end" else at <= last
                for name in [name for name in self.rec if re.fullmatch(f"{stem}_{which}(_.*)?", name) and span.any()]:
                    value = (
                        None if values is None else values[span].max() if which == "end" else np.abs(values[span]).max()
                    )
                    whole = self.compared if at is self.at else self.every
                    full = whole or which == "end" or self.peaks.get(name) in at
                    self.compare(name, value, EPS * slack, full)

    def check_errors_in_time(self):
        """Until when a run is compared, its errors are judged, and its motion is followed to 10, 1 and 0.1 %."""
        rec, at = self.rec, self.at
        if not len(at):
            if self.every:
                for column in ("compared_to_s", "judged_to_s", "motion_error_max_m", "reference_horizon_s"):
                    self.claim(column, np.isnan(rec[column]), rec[column], "nan")
            return
        covered = self.t[self.t <= self.p.horizon * (1 + EPS)]
        self.compare("compared_to_s", float(covered[-1]), 0.0, self.every)
        self.claim("exact states", self.compared or not self.report.lossless or not self.every, len(at), len(covered))
        self.compare("reference_own_error_m", self.sure.max(), 1e-15 * self.big, self.compared)
        length, sure = rec["length_scale_m"], self.sure
        tenth = np.maximum(np.searchsorted(at, at / 10, "right") - 1, self.compared and len(at) > 1)
        steady = sure < np.where(sure <= 100 * sure[tenth], 1e-3, 1e-9) * length
        q = np.logical_and.accumulate(steady).sum()
        self.compare("judged_to_s", at[:q].max(initial=0), 0, self.compared)
        if q > 1 and self.rate[:q].max() > 0.01 * rec["speed_scale_m_per_s"]:
            fastest = 1 / np.median(np.diff(at[:q])) + norm(self.w[:q]).max()
            self.unexplained = self.rate[:q].max() / (2 * (self.apart + sure)[:q].max() * fastest)
        for column, level in ACCURATE.items():
            above = ~(self.apart <= level * length + sure)
            until = at[np.argmax(above)] if above.any() else at[-1]
            self.compare(column, float(until) if self.compared and (self.known or self.single) else None)

    def check_peaks(self, series):
        """Where every step is there, each maximum occurred when it is said to have occurred."""
        if not self.every:
            return
        series = dict(series) | {"energy_share": (self.t, self.shares["energy"] if self.known else None, 1e3)}
        if len(row := self.rows.get("eq81_norm", ())) == len(self.t):
            series["eq81"] = self.t, row, 0.0
        if not self.compared:  # without all exact states the errors' maxima may have been elsewhere
            series = {stem: one for stem, one in series.items() if one[0] is not self.at}
        for stem, (at, values, slack) in series.items():
            if stem == "reference_own_error" or values is None or not len(at):
                continue
            stated = {name for name in self.rec if not np.isnan(self.number(name))} | set(self.peaks)
            for name in sorted(name for name in stated if re.fullmatch(f"{stem}_(max|judged)(_.*)?", name)):
                span = at <= (self.rec["judged_to_s"] if f"{stem}_judged" in name else np.inf)
                there, most = at == self.peaks.get(name), np.abs(values[span]).max(initial=0.0)
                value = float(np.abs(values[there]).max()) if there.any() else -1.0
                self.compare(f"at its time: {name}", value, EPS * slack, recorded=np.inf if np.isnan(most) else most)
        for name in ("judged_to_s", "compared_to_s"):
            self.claim(
                f"time {name}",
                not len(self.at) or not self.compared or self.peaks.get(name) == self.rec[name],
                self.peaks.get(name),
                self.rec[name],
            )
        for name in ACCURATE if len(self.at) and self.compared and (self.known or self.single) else ():
            passed = self.rec[name] if name in self.peaks or self.rec[name] != self.at[-1] else None
            self.claim(f"time {name}", self.peaks.get(name) == passed, self.peaks.get(name), passed)
        for name in ("motion_between_max_m", "reaction_error_max_N", "reaction_size_N"):
            self.claim(f"time {name}", np.isfinite(self.rec[name]) <= (name in self.peaks), "none", "a time")

    def number(self, column):
        """Return what a record states if that is a number, else NaN."""
        return value if isinstance(value := self.rec[column], float) else np.nan

    def check_first_breaks(self):
        """Where every step is there, each law was first broken when it is said to have been, or never."""
        for law, values in self.shares.items() if self.every and self.known else ():
            name = f"{SHARES[law]}:first"
            broken = ~(values <= 1)
            at = self.t[np.argmax(broken)] if broken.any() else None
            self.claim(name, self.peaks.get(name) == at, self.peaks.get(name), at)

    def check_kinematics(self):
        """Poses follow velocities from step to step."""
        p, t, length = self.p, self.t, self.rec["length_scale_m"]
        step, spun = (np.diff(t)[:, None, None] * (a[1:] + a[:-1]) / 2 for a in (self.v, self.w))
        off = p.spread(self.r[:-1] + step - self.r[1:], self.R[:-1] @ exp(spun) - self.R[1:]).sum(0)
        path = p.spread(self.r[1:] - self.r[:-1], self.R[1:] - self.R[:-1]).sum(0)
        defect = (off / (np.maximum(path, p.spread(step, hat(spun)).sum(0)) + 0.01 * length)).max()
        known = self.every and len(t) > 1
        self.compare("kinematic_defect", defect if known else None, 1e-9, why="not every step is kept")

    def check_instants(self):
        """The motion between two steps, and the reactions where their error and their size are largest."""
        p, rec, force = self.p, self.rec, self.rec["reaction_size_N"]
        for column in filter(self.peaks.__contains__, INSTANTS):
            exact, own = (a[a[:, 0] == self.peaks[column]] for a in (p.exact, self.s))
            value, between = None, column == "motion_between_max_m"
            here = len(exact) and (between or len(own))
            self.claim(
                f"states of {column}", here or not self.compared, self.peaks[column], "a time whose states are kept"
            )
            if between and len(exact) and (self.every or self.run["between"]):
                poses = p.find_between(self.s, self.peaks[column])
                value = p.spread(*map(np.subtract, poses, unpack(exact)[:2])).max()
            elif not between and len(exact) and not p.user and (len(own) or column == "reaction_size_N"):
                told = (
                    0
                    if column == "reaction_size_N"
                    else np.tensordot(self.run["reaction"], p.differentiate(own)[0][p.joint], 1)
                )
                value = norm((p.accelerate(exact)[1] - told)[..., :3]).max()
            self.compare(column, value, EPS * self.big if between else 1e-6 * force)
        if np.isnan(rec["reaction_error_max_N"]) and p.joint.any() and rec["claimed"] == "success":
            self.report.weaken("without reactions, whose errors nobody can judge")
        elif np.isnan(rec["motion_between_max_m"]) and rec["claimed"] == "success" and self.n:
            self.report.weaken("without a comparison of the motion between steps")

    def check_reaction(self):
        """The reaction beside the states is that of the series; a run that was cut short has none."""
        told, at = self.rows.get("state_reaction"), self.peaks.get("reaction_error_max_N")
        if told is None:
            lacks = self.report.lossless and np.isfinite(self.rec["reaction_error_max_N"])
            self.claim("reactions", not lacks, "an error", "none: no reactions")
        elif not self.rec["claimed"]:
            self.claim("reactions", False, "reactions", "none: steps kept until a run ended have no reactions")
        elif self.every and at in self.t:
            same = np.array_equal(told[self.t == at][0], self.run["reaction"], equal_nan=True)
            self.claim("reaction", same, "another", "that of the series")

    def find_units(self):
        """Return the scale of each unit of an invariant."""
        energy, length, momentum, reach, speed = (
            self.told[key] for key in ("energy", "length", "momentum", "reach", "gap_rate")
        )
        units = {"J": energy, "m": length, "m/s": speed, "rad/s": speed / reach}
        return units | {"kg m/s": momentum, "kg m2/s": momentum * reach}

    def check_invariants(self):
        """Invariants are those of the problem, and drift as the states do."""
        p, drifts, units, self.broken = self.p, json.loads(self.rec["invariant_drifts"]), self.find_units(), False
        if p.invariants:
            self.claim("names of invariants", set(drifts) == set(p.invariants), sorted(drifts), sorted(p.invariants))
        elif drifts:
            self.report.weaken("with invariants that their problem does not describe")
        else:
            self.report.weaken("without invariants")
        spins = np.einsum("tbij,bjk,tbk->tbi", self.R, p.inertia, self.w)
        mv = self.v * p.mass[:, None]
        fields = {"spin": spins, "momentum": mv.sum(1)[:, None]}
        fields["angular momentum"] = (np.cross(self.r, mv) + spins).sum(1)[:, None]
        ended = self.t[-1] == self.rec["t_reached_s"]
        for name, drift in drifts.items():
            about = {"quantity": "", "along": ZERO, "unit": drift["unit"]} | p.invariants.get(name, {})
            self.claim(f"invariant {name}: unit", drift["unit"] == about["unit"], drift["unit"], about["unit"])
            values, scale = (
                fields.get(about["quantity"], self.w)[:, about.get("body", 0)] @ about["along"],
                units.get(about["unit"], 0.0),
            )
            row, known = self.rows.get(f"inv_{name}"), bool(about["quantity"]) and self.t[0] == 0
            if not known and self.every and row is not None and len(row) == len(self.t):
                values, known = row + float(drift["start"]), True
            slack = EPS * max(np.nanmax(np.abs(values)), scale)
            for key, x in (
                ("start", values[0]),
                ("end", values[-1] - values[0]),
                ("max", np.abs(values - values[0]).max()),
            ):
                told = float(x) if known and (ended or key != "end") else None
                self.compare(f"invariant {name}: {key}", told, slack, self.every or key != "max", float(drift[key]))
            self.broken |= float(drift["max"]) > 0.1 * max(scale, abs(float(drift["start"])))

    def check_rows(self, series):
        """The series of a lossless bundle are those of its states; what they state beside is what the record states."""
        rows = {name: a for name, a in self.rows.items() if len(a) == len(self.t)} if self.every else {}
        small, nothing = EPS * self.weight, np.zeros(0)
        known = {"t": (self.t, 0.0), "energy": (self.m["E"], small), "energy_error": (self.m["energy"], small)}
        known |= {"dt": (np.insert(np.diff(self.t), 0, np.nan), 0.0), "orthogonality": (self.m["orthogonality"], EPS)}
        known |= {"phi_norm": (self.m["phi"], EPS * self.big), "phi_dot_norm": (self.m["phi_dot"], EPS * self.fast)}
        known |= {stem: (series[stem][1], EPS * series[stem][2]) for stem in COMPARED if stem in series}
        known |= {"out_of_plane": (self.away, EPS * self.big)} if self.p.normal is not None else {}
        for name, (values, slack) in known.items():
            row = rows.get(name, nothing)[: len(values)]
            off = np.abs(row - values)[np.isfinite(values)] if len(row) == len(values) else nothing
            worst = (
                off.max(initial=0.0) - REL * np.abs(values[np.isfinite(values)]).max(initial=0.0) if len(off) else 0.0
            )
            self.claim(f"series {name}", not len(off) or worst <= slack, "other values", f"off by {worst:.3g}")
        for column, row, k in (("eq81_max_sqrtJ", "eq81_norm", None), ("eq81_end_sqrtJ", "eq81_norm", -1)):
            a = rows.get(row)
            self.compare(
                column, None if a is None else float(a.max() if k is None else a[k]), why="Eq. (81) is not described"
            )
        for name, error in json.loads(self.rec["observable_errors"]).items():
            ours, exact = (rows.get(f"{kind}_{name}") for kind in ("obs", "ref"))
            away = None if ours is None or exact is None else np.abs(ours - exact)[: len(self.at)]
            for key, find in (("max", np.max), ("end", lambda a: a[-1])):
                value = None if away is None or not len(away) else float(find(away))
                slack = EPS * np.abs(exact[np.isfinite(exact)]).max(initial=0) if value is not None else 0.0
                self.compare(
                    f"observable {name}: {key}", value, slack, recorded=float(error[key]), why="observables are code"
                )

    def find_excesses(self):
        """Return value and limit of each law that a claimed success has to keep, by its name."""
        rec, energy, length, speed = self.rec, self.told["energy"], self.told["length"], self.told["gap_rate"]
        force, own = rec["reaction_size_N"] + energy / length, rec["reference_own_error_judged_m"]
        start = np.abs(self.s - self.p.start)[0, 1:-1].max() if self.t[0] == 0 else np.inf if self.every else np.nan
        drift = self.shares["energy"].max() if self.known else 0.0
        return {
            "end": (abs(rec["t_reached_s"] - self.p.t_end), 1e-9 * max(self.p.t_end, 1)),
            "start": (start, 1e-9 * (1 + length + speed)),
            "energy": (rec["energy_drift_max_J"], 0.1 * energy) if self.single else (drift, 1.0),
            "constraint": (rec["gap_share_max"], 1.0),
            "constraint_rate": (rec["gap_rate_share_max"], 1.0),
            "orthogonality": (rec["orthogonality_max"], LIMITS["orthogonality"]),
            "reaction": (rec["reaction_error_max_N"], 10 * force),
            "kinematic": (rec["kinematic_defect"], 0.5),
            "velocity": (rec["rate_error_judged_m_per_s"], speed),
            "motion": (rec["motion_error_judged_m"], 0.1 * length + own),
            "rows": (rec["motion_between_max_m"], 0.5 * length + own),
        }

    def find_broken(self, excesses):
        """Return the names of the laws that are broken, those of a motion that is merely inaccurate among them."""
        found = {law for law, (value, limit) in excesses.items() if value > limit} | (
            {"invariant"} if self.broken else set()
        )
        near, decided = self.n and not found & SOFT, self.every and not self.p.user
        if near and not decided:
            self.report.leave("law truncation", "user forces are code" if self.p.user else "not every step is kept")
        off = near and "truncation" in self.stated
        if near and decided:
            speed = self.told["gap_rate"]
            off = max(self.p.find_truncation(self.s, self.rows.get("state_reaction"), speed), self.unexplained) > 1
        found |= {"truncation"} if off else set()
        return found - ({"rows"} if found & {"motion", "velocity"} else set())

    def check_status(self):
        """The status is what the laws give, of recorded columns where the bundle cannot decide."""
        if self.rec["claimed"] != "success":
            if self.rec["status"] not in JUDGED and abs(self.t[-1] - self.p.t_end) <= 1e-9 * max(self.p.t_end, 1):
                self.report.weaken("called failures though their motion reaches the end")
            return
        excesses = self.find_excesses()
        found = self.find_broken(excesses)
        self.compare("status", "wrong" if found - SOFT else "inaccurate" if found else "success")
        self.compare("wrong_because", sorted(found - SOFT or found), recorded=self.stated)
        for reason in json.loads(self.rec["wrong_because"]):
            law = reason["law"]
            if law in {"kinematic", "motion", "velocity", "rows", "reaction", "orthogonality"} or (
                law == "energy" and self.single
            ):
                for key, value in zip(("value", "limit"), excesses[law], strict=True):
                    self.compare(f"reason {law}: {key}", float(value), recorded=float(reason[key]))


class Report:
    """What was compared in a bundle, what disagrees, what is undecided, and what weakens it.

    An exception says that the file is no bundle. ``complete`` demands of any bundle what a lossless one owes.
    """

    def __init__(self, path, complete=False):
        self.run, self.rec, self.numbers, self.findings, self.undecided, self.weak = "bundle", {}, 0, [], [], []
        self.lacking = []  # runs of its suites
        files = read_files(path)
        head, records, runs, table = (files[f"{name}.json"] for name in ("bundle", "records", "runs", "table"))
        demand(head["format"] == "mbsbench bundle" and head["version"] == 4, "not a bundle of version 4")
        self.runs, count, by_id = len(runs), len(records), {rec["run_id"]: rec for rec in records}
        demand(
            self.runs == len(by_id) == count and set(by_id) == {run["run_id"] for run in runs},
            "a run twice, or without a record",
        )
        self.lossless, self.complete = head["lossless"] is True, complete or head["lossless"] is True
        self.check_head(head, files, runs, records)
        self.check_suites(files, records)
        self.check_table(table, records)
        keys = sorted({str(run["problem"]) for run in runs if run["problem"]})
        problems = {
            key: Problem(files[f"problems/{key}.json"], files.get(f"references/{key}.npy"), key) for key in keys
        }
        for self.run in keys:
            self.check_problem(problems[self.run], files[f"problems/{self.run}.json"])
            if len(problems[self.run].exact):
                self.check_reference(problems[self.run])
        for run in runs:
            plain = by_id[run["run_id"]]
            self.run, self.rec = (
                plain["run_id"],
                {name: float(x) if x in ("nan", "inf", "-inf") else x for name, x in plain.items()},
            )
            self.check_record(run, head["codes"])
            p = problems.get(run["problem"])
            if p is not None:
                self.check_names(p, files[f"problems/{run['problem']}.json"])
            if self.check_evidence(run, p):
                rows = self.read_rows(run, files)
                Run(self, p, run, self.rec, files[f"runs/{self.run}.npy"], rows).check()

    def compare(self, column, value, slack=0.0, full=True, recorded=None, why="its states are not kept"):
        """Compare a recorded value with the computed one; where ``full`` is false, that is a lower bound."""
        recorded, number = self.rec[column] if recorded is None else recorded, isinstance(value, float)
        value, recorded = (np.inf if np.isnan(value) else value, float(recorded)) if number else (value, recorded)
        same = value == recorded or (number and abs(value - recorded) <= REL * abs(recorded) + slack < np.inf)
        if value is None or (not (same or full) and value <= recorded):
            self.leave(column, why if value is None else "only a lower bound")
        else:
            self.claim(column, same, recorded, value)

    def claim(self, what, holds, stated, found):
        """Note a disagreement unless something holds: what is stated, and what was found or is expected."""
        self.numbers += 1
        line = f"{self.run:17} {what[:38]:38} {str(stated)[:48]:>24} {str(found)[:48]:>24}"
        self.findings += [] if holds else [line]

    def leave(self, what, why):
        """Note what the bundle cannot decide, and why."""
        self.undecided.append((why, what))

    def weaken(self, words):
        """Note that less can be said of this run than of others."""
        self.weak.append(words)

    def check_head(self, head, files, runs, records):
        """The bundle says whether it is lossless, of which code its runs are, and holds no file without a run."""
        self.claim("lossless", head["lossless"] in (True, False), head["lossless"], "true or false")
        codes = sorted({str(rec["code"]) for rec in records})
        self.claim("codes", head["codes"] == codes, head["codes"], codes)
        moving = {run["run_id"] for run in runs if run["states"] != "none"}
        claimed = {rec["run_id"] for rec in records if rec["claimed"] == "success" or rec["status"] in JUDGED}
        self.claim("evidence", not claimed or claimed & moving, "no state of any success", "states")
        wanted = {f"runs/{key}.npy" for key in moving}
        wanted |= {f"series/{run['run_id']}.npy" for run in runs if self.lossless and run["problem"]}
        wanted |= {f"problems/{run['problem']}.json" for run in runs if run["problem"]}
        have = {name for name in files if name.startswith(("runs/", "series/", "problems/"))}
        self.claim("files", have == wanted, sorted(have - wanted)[:1], sorted(wanted - have)[:1])
        lone = {
            name for name in files if name.startswith("references/") and f"problems/{name[11:-4]}.json" not in wanted
        }
        self.claim("references", not lone, sorted(lone)[:1], "a problem")

    def check_suites(self, files, records):
        """Suites are TOML; of a suite whose number of runs is known, those that are not here are counted."""
        for name in [name for name in files if name.endswith(".toml")]:
            try:
                about = tomllib.loads(files[name].decode())
                self.claim(name, isinstance(about.get("name", ""), str), "its name", "text")
            except (ValueError, RecursionError):
                self.claim(name, False, "no TOML", "a suite")
        environments = {name[12:-5]: files[name] for name in files if re.fullmatch(r"environment\..*\.json", name)}
        for suite in sorted({str(rec["suite"]) for rec in records}):
            own = [rec for rec in records if rec["suite"] == suite]
            known = [environments.get(rec["environment"], {}).get("suite_runs") for rec in own]
            most = max((n for n in known if isinstance(n, int)), default=0)
            if most > len(own):
                self.lacking.append(f"{most - len(own)} of {most} runs of the suite {suite!r} are not here")
        for rec in records:
            if rec["environment"] not in environments:
                self.weaken("without the packages and the machine of their run")

    def check_table(self, table, records):
        """Every cell of the table is what the records give."""
        groups, keys = {}, ("problem", "problem_parameters", "solver")
        for rec in records:
            groups.setdefault(tuple(rec[key] for key in keys), []).append(rec)
        demand([tuple(row[key] for key in keys) for row in table] == sorted(groups), "the table has other rows")
        for self.rec, (key, runs) in zip(table, sorted(groups.items()), strict=True):
            self.run, ended = f"table {key[2]}"[:17], [rec["status"] for rec in runs]
            errors = [float(rec["motion_error_judged_m"]) if rec["status"] == "success" else np.nan for rec in runs]
            near = [
                float(rec["cpu_median_s"])
                for rec, e in zip(runs, errors, strict=True)
                if e <= 1e-3 * float(rec["length_scale_m"])
            ]
            cells = {kind: ended.count(kind) for kind in JUDGED} | {"least_cpu_s": min(near, default=np.inf)}
            cells |= {"runs": len(runs), "least_motion_error_m": min((e for e in errors if e < np.inf), default=np.inf)}
            for column, value in cells.items():
                self.compare(column, value)
            self.claim("columns", set(self.rec) == {*cells, *keys}, sorted(self.rec), "those of the page")

    def check_problem(self, p, data):
        """What a problem says of itself fits its numbers: names, user forces, gyrations, frame, plane."""
        self.claim("body_names", len(data["body_names"]) == p.nb, len(data["body_names"]), p.nb)
        joints = int(p.joints.sum())
        self.claim("joint_names", len(data["joint_names"]) == joints, len(data["joint_names"]), joints)
        self.claim("joint_kinds", len(data["joint_kinds"]) == len(p.i), len(data["joint_kinds"]), len(p.i))
        forces = [f"user force {k}" for k in range(p.user_count)]
        self.claim("not_serialised", data["not_serialised"] == forces, data["not_serialised"], forces)
        least = np.sqrt(np.trace(p.inertia, axis1=1, axis2=2) / (2 * p.mass))
        self.claim("gyration", (p.gyration >= least * (1 - REL)).all(), p.gyration.min(), least.min())
        frame = np.array(data["numbers"]["frame"], float)
        self.claim(
            "frame", frame.shape == (3, 3) and np.abs(frame.T @ frame - ONE).max() < 1e-9, "no rotation", "a rotation"
        )
        self.claim("planar_normal", p.normal is None or abs(norm(p.normal) - 1) < 1e-9, "its length", 1)
        kind, names = data["reference"]["kind"], [about["name"] for about in data["invariants"]]
        self.claim("reference: kind", kind in ("own", "certified", "computed", "none"), kind, "a kind")
        self.claim("reference: kind", kind != "none" or not len(p.exact), kind, "exact states")
        self.claim("invariants", len(set(names)) == len(names), names, "each once")

    def check_names(self, p, data):
        """What a record says of its problem is what the problem says, its switches included."""
        rec, parameters = self.rec, json.loads(self.rec["problem_parameters"])
        self.claim("problem", data["problem"] == rec["problem"], rec["problem"], data["problem"])
        self.claim("problem_parameters", data["parameters"] == parameters, parameters, data["parameters"])
        self.claim("section", data["section"] == rec["section"], rec["section"], data["section"])
        self.compare("t_end_s", p.t_end)
        literal = bool(parameters.get("literal_start"))
        self.claim("literal_start", data["literal_start"] is literal, data["literal_start"], literal)
        self.claim("reference", p.route == rec["reference"], rec["reference"], p.route)
        horizon, stated = float(data["reference"]["horizon_s"]), rec["reference_horizon_s"]
        self.claim("reference_horizon_s", horizon == stated or np.isnan([horizon, stated]).all(), stated, horizon)
        if rec["claimed"] == "success":
            for words, weak in (
                ("that start as printed, whose joints nobody judges", literal),
                ("with user forces, which are code: work, reactions and truncation are as stated", p.user),
                ("without an exact motion", not len(p.exact)),
            ):  # fmt: skip
                self.weak += [words] if weak else []

    def check_evidence(self, run, p):
        """A claimed success has its states, all of them in a lossless bundle. Return whether there are any."""
        states, claims = run["states"], self.rec["claimed"] == "success" or self.rec["status"] in JUDGED
        self.claim("states", states in ("none", "some steps", "every step"), states, "none, some or every")
        self.claim("problem", bool(run["problem"]) or states == "none", "states", "of a problem")
        if claims and self.complete:
            self.claim("evidence", states == "every step", states, "every step")
        elif claims and states != "every step":
            self.weaken(
                "that claim success without a state"
                if states == "none"
                else "that claim success with the states of some steps"
            )
        if states == "none":
            self.leave("run", "no motion, or too large a state")
        return states != "none" and p is not None

    def read_rows(self, run, files):
        """Return the series of a run by name, after it is sure that they fill their file and nothing else does."""
        if not self.lossless:
            self.claim("arrays", run["arrays"] == {}, sorted(run["arrays"]), "none")
            return {}
        vector, rows, at = files[f"series/{self.run}.npy"], {}, 0
        for name, (offset, shape) in sorted(run["arrays"].items(), key=lambda item: item[1][0]):
            size = int(np.prod(shape))
            demand(
                offset == at and vector.ndim == 1 and at + size <= len(vector),
                f"series of {self.run}: {name} is not in its place",
            )
            rows[name], at = vector[at : at + size].reshape(shape), at + size
        self.claim("series", at == len(vector), at, len(vector))
        self.claim(
            "series_rows",
            self.rec["series_rows"] <= self.rec["steps"] + 1,
            self.rec["series_rows"],
            self.rec["steps"] + 1,
        )
        return rows

    def check_record(self, run, codes):
        """A record is one of this schema, of a code that the bundle names, asked for by a step or a tolerance."""
        rec = self.rec
        self.claim("schema", rec["schema"] == 3, rec["schema"], 3)
        self.claim("code", rec["code"] in codes, rec["code"], codes)
        asked = "dt" if rec["dt_s"] > 0 else "rtol"
        one = (rec["dt_s"] > 0) != (rec["rtol"] > 0)
        self.claim("control", one and rec["control"] == asked, rec["control"], asked)
        self.check_ending(run)
        self.check_costs()

    def check_ending(self, run):
        """How a run ended is told by its status, by what its solver claimed, and by what ended it: these fit."""
        rec, status, claimed, by = self.rec, self.rec["status"], self.rec["claimed"], self.rec["ended_by"]
        if not claimed:
            wanted = {"memory_limit": "memory"} | dict.fromkeys(UNFINISHED, "unfinished")
            self.claim("status", status == wanted.get(by, "crashed"), status, wanted.get(by, "crashed"))
            self.claim("ended_by", by not in ("", "solver"), by, "what ended a solver that claims nothing")
            self.claim("counters", rec["counters"] == "{}", rec["counters"], "none: its solver claims nothing")
        else:
            wanted = JUDGED if claimed == "success" else {claimed, *(["unfinished"] if claimed == "stalled" else [])}
            self.claim("status", status in wanted, status, f"that of {claimed}")
            self.claim("ended_by", by in ("solver", "cpu_limit", "suspended"), by, "solver")
            self.claim(
                "signal and exit_code", rec["signal"] == rec["exit_code"] == 0, (rec["signal"], rec["exit_code"]), 0
            )
        if status == "refused":
            nothing = (
                rec["steps"] == 0 and np.isnan(rec["t_reached_s"]) and run["states"] == "none" and not rec["series"]
            )
            self.claim("refused", nothing, "a motion", "none")
        self.claim("missing_package", status == "refused" or not rec["missing_package"], rec["missing_package"], "none")
        because = status in ("inaccurate", "wrong") and claimed == "success"
        self.claim(
            "wrong_because",
            (rec["wrong_because"] != "[]") == because,
            rec["wrong_because"],
            "reasons" if because else "none",
        )

    def check_costs(self):
        """No cost is below zero, quartiles are in order, and the process took no less than each of its solves.

        Those of a submission are repeats of whole processes, of which that of one is known.
        """
        rec = self.rec
        for column in COSTS:
            self.claim(column, not rec[column] < 0, rec[column], "at least 0")
        ordered = [rec[f"cpu_{name}_s"] for name in ("min", "q1", "median", "q3", "max")]
        known = [x for x in ordered if not np.isnan(x)]
        self.claim("order of CPU times", known == sorted(known), ordered, "min, q1, median, q3, max")
        self.claim("number of CPU times", len(known) in (0, 3, 5), ordered, "all or none")
        process = rec["cpu_process_s"]
        if known and not np.isnan(process):
            elsewhere = rec["suite"] == "ladder" or '"CPU times: ' in str(rec["notes"])
            self.claim("cpu_process_s", elsewhere or known[-1] <= process + CLOCK, process, known[-1])
            self.claim("code_s", not rec["code_s"] > process + CLOCK, rec["code_s"], process)
        if rec["claimed"] == "success" and rec["status"] in JUDGED:
            self.claim("repeats", rec["repeats"] > 0 or not known, rec["repeats"], "at least 1")

    def check_reference(self, p):
        """The exact motion begins at the start, states sane errors and keeps the laws to them."""
        t, stated, m, (r, _, v, _, W) = p.exact[:, 0], p.exact[:, -1], p.measure(p.exact, p.whole), unpack(p.exact)
        size, speed, why = np.abs(r).max() + p.rim, p.spread(v, W).max(), "work is done, or no exact start is kept"
        allowed, weight = 1e-9 + 100 * stated.clip(0) / size, m["T"].max() + np.abs(m["E"] - m["T"]).max() + 1e-300
        sane = (stated >= 0).all() and (stated < 0.1 * size).all() and t[0] >= 0 and t[-1] <= p.horizon * (1 + EPS)
        self.claim("reference: errors and horizon sane", bool(sane and np.isfinite(p.exact).all()), True, False)
        laws = {
            "phi": m["phi"] / size,
            "phi_dot": m["phi_dot"] / max(speed, 1e-9 * size),
            "orthogonality": m["orthogonality"],
        }
        laws["energy"] = None if p.has_work else (m["E"] - p.measure(p.start, p.whole)["E"]) / weight
        laws["start"] = (
            None if t[0] else allowed * np.abs(p.exact - p.start)[0, 1:-1].max() / (1e-9 * (1 + size + speed))
        )
        laws |= (
            {"closed form": allowed * p.find_top_error() / (REL + 2 * stated / size)}
            if "Lagrange's top" in p.route
            else {}
        )
        if "proved" in p.route and len(laws) < 6:
            self.leave("reference", "no closed form here: others prove its motion")
        for law, defect in laws.items():
            worst = None if defect is None else float(np.abs(defect / allowed).max())
            self.compare(f"reference: {law} / allowed", worst, 1, True, 0.0, why)


def main(path, complete=False):
    """Print a table of agreement; return the exit code."""
    np.seterr(all="ignore")
    try:
        report = Report(Path(path), complete)
    except Exception as error:  # whatever the file may cause
        print(plain(f"{path}: unreadable: {type(error).__name__}: {error}"[:400]))
        return 2
    counts = f"{report.runs} runs checked, {report.numbers} numbers compared, {len(report.findings)} disagreements"
    print(plain(f"{path}: {counts}, {len(report.undecided)} undecided"), *map(plain, report.findings), sep="\n")
    print(*(plain(f"  {words}") for words in report.lacking), sep="\n", end="\n" * bool(report.lacking))
    for words in sorted(set(report.weak)):
        print(plain(f"  {report.weak.count(words)} of {report.runs} {words}"))
    for why in sorted({why for why, _ in report.undecided}):
        columns = [what for cause, what in report.undecided if cause == why]
        print(plain(f"  {why}: " + " ".join(f"{what} {columns.count(what)}," for what in sorted(set(columns)))))
    return min(len(report.findings), 1)


def plain(text):
    """Return text without control characters, whatever a bundle holds."""
    return text.encode("unicode_escape").decode()


if __name__ == "__main__":
    if hasattr(signal, "SIGPIPE"):  # a reader that has seen enough ends it without a word
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    paths = [word for word in sys.argv[1:] if word != COMPLETE]
    sys.exit(max((main(path, COMPLETE in sys.argv) for path in paths), default=2))
