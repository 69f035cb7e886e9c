"""Check bundles of results: recompute from poses, velocities and the problem's numbers what the records state.

Written from docs/bundle.md alone; it needs NumPy and imports nothing of mbsbench. See README.md.
"""

import hashlib
import io
import json
import math
import re
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray
NAMES = re.compile(
    r"(bundle|records|runs|ro-crate-metadata|environment(\.[\w-]{1,64})?)\.json|suite\.toml|manifest-sha256\.txt"
    r"|runs/[\w-]{1,64}\.npy|problems/[\w-]{1,64}\.json|references/[\w-]{1,64}\.npy",
    re.ASCII,
)
MAX_FILES, MAX_BYTES, MAX_JSON, MAX_VALUES, MAX_DIRECTORY = 20_000, 1 << 29, 1 << 24, 3_000_000, 1 << 22
MAX_BODIES, MAX_STATE_ROWS = 2_000, 4_000_000
REL = 1e-6  # a recorded maximum against the recomputed one, beside roundings of the problem's own size
EPS = 1e-12


class UnreadableBundle(Exception):
    """The file is no bundle that can be judged."""


def demand(condition: Any, message: str) -> None:
    """Refuse the bundle unless the condition holds."""
    if not condition:
        raise UnreadableBundle(message)


# --- reading ---------------------------------------------------------------------------------------------------------


def read_files(path: Path) -> dict[str, bytes]:
    """Return the members of the archive after its directory, sizes, names and digests have been verified."""
    demand(path.is_file(), "not a file")
    size = path.stat().st_size
    demand(22 < size <= MAX_BYTES, f"size of {size} bytes")
    with path.open("rb") as file:
        file.seek(max(0, size - 42))
        tail = file.read()
    demand(tail[-22:-18] == b"PK\x05\x06" and tail[-2:] == b"\0\0" and tail[:4] != b"PK\x06\x07", "not a plain zip file")
    demand(int.from_bytes(tail[-10:-6], "little") <= MAX_DIRECTORY, "the directory of the zip file is too large")
    files: dict[str, bytes] = {}
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        demand(len(members) <= MAX_FILES, f"{len(members)} files")
        demand(sum(member.file_size for member in members) <= MAX_BYTES, "more than 512 MB unpacked")
        for member in members:
            name = member.orig_filename
            demand(NAMES.fullmatch(name), f"unexpected file name {name[:80]!r}")
            demand(name not in files, f"duplicate file {name}")
            demand(member.external_attr >> 28 in {0, 8}, f"{name} is no regular file")
            demand(not member.flag_bits & 1 and member.compress_type in {0, 8, 12, 14}, f"{name} is encrypted")
            with archive.open(member) as stream:
                files[name] = stream.read(member.file_size)
            demand(len(files[name]) == member.file_size, f"{name} is shorter than stated")
    demand("manifest-sha256.txt" in files, "no manifest-sha256.txt")
    stated = {}
    for line in files["manifest-sha256.txt"].decode("ascii").splitlines():
        match = re.fullmatch(r"([0-9a-f]{64})  (\S+)", line)
        demand(match and match[2] not in stated, f"bad line in the manifest: {line[:80]!r}")
        assert match is not None
        stated[match[2]] = match[1]
    other = set(stated) ^ (set(files) - {"manifest-sha256.txt"})
    demand(not other, f"files and manifest differ: {sorted(other)[:3]}")
    for name, digest in stated.items():
        demand(hashlib.sha256(files[name]).hexdigest() == digest, f"{name} differs from its digest in the manifest")
    return files


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse JSON objects with repeated keys."""
    result = dict(pairs)
    demand(len(result) == len(pairs), "JSON with a repeated key")
    return result


def refuse_constant(text: str) -> None:
    """Refuse the constants that JSON does not have."""
    raise UnreadableBundle(f"JSON with {text}")


def parse_json(raw: bytes, name: str, kind: type) -> Any:
    """Parse bounded JSON whose top level is of the kind."""
    demand(len(raw) <= MAX_JSON, f"{name} has {len(raw)} bytes")
    demand(sum(raw.count(c) for c in (b",", b"[", b"{")) <= MAX_VALUES, f"{name} has too many values")
    value = json.loads(raw.decode("utf-8"), object_pairs_hook=unique_keys, parse_constant=refuse_constant)
    demand(isinstance(value, kind), f"{name} is no {kind.__name__}")
    return value


def read_arrays(raw: bytes, layout: Any, name: str) -> dict[str, Array]:
    """Return the named arrays of a vector of float64; no pickles, no overlaps beyond the vector."""
    stream = io.BytesIO(raw)
    demand(np.lib.format.read_magic(stream) == (1, 0), f"{name}: unexpected version")
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    demand(dtype == np.dtype("<f8") and len(shape) == 1, f"{name}: not a vector of float64")
    start = stream.tell()
    demand(shape[0] * 8 == len(raw) - start, f"{name}: shape and size differ")
    vector = np.frombuffer(raw, "<f8", offset=start)
    demand(isinstance(layout, dict) and len(layout) < 1000, f"{name}: no layout")
    arrays, used = {}, 0
    for key, entry in layout.items():
        demand(isinstance(entry, list) and len(entry) == 2 and isinstance(entry[1], list), f"{name}: layout of {key!r}")
        numbers = [entry[0], *entry[1]]
        demand(all(type(n) is int and 0 <= n <= vector.size for n in numbers), f"{name}: layout of {key[:40]!r}")
        count = math.prod(entry[1])
        demand(len(entry[1]) <= 4 and entry[0] + count <= vector.size, f"{name}: {key[:40]!r} passes the end")
        arrays[key], used = vector[entry[0] : entry[0] + count].reshape(entry[1]), used + count
    demand(used == vector.size, f"{name}: its arrays overlap or leave gaps")
    return arrays


def number(value: Any) -> float:
    """Return a number of JSON, where "nan", "inf" and "-inf" are numbers."""
    if isinstance(value, str) and value in {"nan", "inf", "-inf"}:
        return float(value)
    demand(type(value) in {int, float} and abs(value) < 1e300, f"{str(value)[:40]!r} is no number")
    return float(value)


# --- mechanics -------------------------------------------------------------------------------------------------------

FIELDS = (
    "mass:b inertia:b33 gyration:b gravity:3 start_r:b3 start_R:b33 start_v:b3 start_Omega:b3 joint_i:j joint_j:j "
    "joint_s_i:j3 joint_s_j:j3 joint_u:j3 joint_w:j3 joint_n:j33 joint_length:j joint_motion:j7 joint_points:j "
    "joint_lines:j joint_axes:j joint_moving:j spring_i:s spring_j:s spring_p_i:s3 spring_p_j:s3 spring_k:s "
    "spring_d0:s spring_c:s torsion_i:t torsion_j:t torsion_u:t3 torsion_n:t33 torsion_k:t torsion_rest:t torsion_c:t "
    "load_i:l user_i:u user_j:u"
)
POSES = {"r": (3,), "R": (3, 3), "v": (3,), "Omega": (3,)}
States = dict[str, Array]


def dot(a: Array, b: Array) -> Array:
    """Return the product over the last axis."""
    return np.einsum("...k,...k", a, b)


def norm(rows: Array) -> Array:
    """Return the norm over the last axis; zero of no rows."""
    return np.sqrt(dot(rows, rows))


def wrap(x: Array) -> Array:
    """Return the angle within half a turn."""
    return x - 2 * np.pi * np.round(x.real / (2 * np.pi))


def angle(y: Array, x: Array) -> Array:
    """Return atan2 of complex steps."""
    return np.arctan2(y.real, x.real) + 1j * (x.real * y.imag - y.real * x.imag) / np.maximum(abs(x) ** 2 + abs(y) ** 2, 1e-200)


class Problem:
    """The problem's numbers, validated, and the functions of the state that they define."""

    def __init__(self, raw: bytes, vector: bytes | None, name: str) -> None:
        data = parse_json(raw, name, dict)
        numbers = data.get("numbers")
        demand(isinstance(numbers, dict), f"{name}: no numbers")
        sizes = {"3": 3, "7": 7}
        for field in FIELDS.split():
            key, letters = field.split(":")
            demand(isinstance(numbers.get(key), list), f"{name}: no {key}")
            sizes.setdefault(letters[0], len(numbers[key]))
            shape = tuple(sizes[letter] for letter in letters)
            value = np.array(numbers[key], float) if numbers[key] else np.zeros(shape)
            demand(value.shape == shape and np.isfinite(value).all(), f"{name}: {key} is not finite or of shape {shape}")
            whole = letters in "jstlu" and (key[-2:] in {"_i", "_j"} or key.split("_")[1] in {"points", "lines", "axes"})
            setattr(self, key, value.astype(int) if whole or key == "joint_moving" else value)
        self.nb = nb = sizes["b"]
        demand(0 < nb <= MAX_BODIES and sizes["j"] <= 20 * MAX_BODIES, f"{name}: {nb} bodies")
        for key in ("joint_i", "joint_j", "spring_i", "spring_j", "torsion_i", "torsion_j", "load_i", "user_i", "user_j"):
            value = getattr(self, key)
            demand(((value >= -1) & (value < nb)).all(), f"{name}: {key} beyond the bodies")
        demand((self.mass > 0).all() and (np.abs(np.linalg.det(self.start_R) - 1) < 1e-3).all(), f"{name}: mass or start_R")
        self.kinds = np.array([str(kind) for kind in data.get("joint_kinds", [])], dtype="<U40")
        demand(self.kinds.shape == self.joint_i.shape, f"{name}: joint_kinds")
        self.id, self.name, self.literal_start = name, str(data.get("problem"))[:60], data.get("literal_start") is True
        self.t_end = number(data.get("t_end_s"))
        demand(0 < self.t_end < math.inf, f"{name}: t_end_s")
        reference = data.get("reference")
        demand(isinstance(reference, dict) and len(str(reference.get("kind"))) < 20, f"{name}: no reference")
        self.reference_kind, self.horizon = str(reference["kind"]), number(reference.get("horizon_s", 0))
        normal = numbers.get("planar_normal")
        self.normal = None if normal is None else np.array(normal, float).reshape(3)
        self.reference: States = {}
        if vector is not None:
            self.reference = read_states(read_arrays(vector, data.get("reference_arrays"), name), "", nb, name)
            demand(all(np.isfinite(a).all() for a in self.reference.values()), f"{name}: reference not finite")
        user = len(self.user_i) or data.get("not_serialised")
        self.work_zero = not (user or len(self.load_i) or self.spring_c.any() or self.torsion_c.any() or self.joint_motion.any())
        self.has_user = bool(user)
        self.group = self.find_mechanisms()

    def find_mechanisms(self) -> Array:
        """Return the number of each body's mechanism."""
        group = np.arange(self.nb)
        pairs = [(self.joint_i, self.joint_j), (self.spring_i, self.spring_j)]
        pairs += [(self.torsion_i, self.torsion_j), (self.user_i, self.user_j)]
        edges = np.concatenate([np.stack(pair, 1) for pair in pairs])
        for i, j in edges[(edges >= 0).all(1)]:
            group[group == group[i]] = group[j]
        holds = np.concatenate([np.stack(pairs[k], 1) for k in (0, 1, 3)])  # a torsion at the ground holds no position
        self.grounded = np.isin(group, group[holds[(holds < 0).any(1)].max(1)])
        group = np.unique(group, return_inverse=True)[1]
        self.ng = int(group.max()) + 1
        self.member = group[np.maximum(self.joint_i, self.joint_j)]
        self.rim, self.arms = np.zeros((2, self.ng))  # the largest gyration, the sum of arms
        np.maximum.at(self.rim, group, self.gyration)
        for body, point in ((self.joint_i, self.joint_s_i), (self.joint_j, self.joint_s_j)):
            np.add.at(self.arms, group[body[body >= 0]], norm(point[body >= 0]))
        return group

    def evaluate(self, s: States) -> dict[str, Array]:
        """Return energies, norms of rows (nt,), gaps by mechanism (nt, ng); rates by complex steps along the motion."""
        nt, step = len(s["t"]), 1e-30j
        W = np.cross(s["Omega"][:, :, None], np.eye(3))  # rows Omega x e_k: the transposed matrix of Omega x
        still = np.zeros((nt, 1, 3))
        r = np.concatenate([s["r"] + step * s["v"], still], 1)
        R = s["R"] + step * np.einsum("tbij,tbkj->tbik", s["R"], W)
        R = np.concatenate([R, np.broadcast_to(np.eye(3), (nt, 1, 3, 3))], 1)

        def turn(body: Array, a: Array) -> Array:
            return np.einsum("tkij,kj->tki", R[:, body], a)

        def separate(i: Array, j: Array, a: Array, b: Array) -> Array:
            return r[:, i] + turn(i, a) - r[:, j] - turn(j, b)

        def carry(body: Array, x: Array) -> Array:
            arm = np.einsum("tkij,tki->tkj", R[:, body].real, x.real - r[:, body].real)
            return (r[:, body] + np.einsum("tkij,tkj->tki", R[:, body], arm)).imag / step.imag

        spin = np.einsum("tbi,bij,tbj->tb", s["Omega"], self.inertia, s["Omega"])
        d = separate(self.spring_i, self.spring_j, self.spring_p_i, self.spring_p_j).real
        e, b = (turn(self.torsion_j, self.torsion_n[:, k]) for k in (0, 1))
        u = turn(self.torsion_i, self.torsion_u)
        theta = wrap(angle(dot(u, b), dot(u, e)).real - self.torsion_rest)
        energies = (
            (np.arange(self.nb), -self.mass * (s["r"] @ self.gravity)),
            (np.maximum(self.spring_i, self.spring_j), self.spring_k * (norm(d) - self.spring_d0) ** 2 / 2),
            (np.maximum(self.torsion_i, self.torsion_j), self.torsion_k * theta**2 / 2),
        )
        out = {"T": (self.mass * dot(s["v"], s["v"]) + spin) / 2, "V": np.zeros((nt, self.ng))}
        for body, values in energies:
            np.add.at(out["V"], (slice(None), self.group[body]), values)
        out["orthogonality"] = np.linalg.norm(np.swapaxes(s["R"], 2, 3) @ s["R"] - np.eye(3), axis=(2, 3)).max(1)

        i, j, L = self.joint_i, self.joint_j, self.joint_length
        counts = (self.joint_points, self.joint_lines, self.joint_axes, self.joint_moving)
        mask = np.concatenate([np.arange(3) < count[:, None] for count in counts], 1)
        angular = np.zeros((len(i), 12), bool)
        phi, rate, fold = np.zeros((nt, len(i), 12), complex), np.zeros((nt, len(i), 12)), np.zeros((nt, len(i), 12), bool)
        d, u, w = separate(i, j, self.joint_s_i, self.joint_s_j), turn(i, self.joint_u), turn(i, self.joint_w)
        n = [turn(j, self.joint_n[:, k]) for k in range(3)]
        phi[..., :3], angular[:, 6:9] = d, True
        for k, (a, b) in enumerate(((d, n[0]), (d, n[1]), (d, n[2]), (u, n[0]), (u, n[1]), (w, n[1])), 3):
            phi[..., k] = dot(a, b)
        fold[..., 8] = dot(w, n[0]).real < 0
        k = np.flatnonzero((self.kinds == "distance") & (self.joint_lines > 0))
        phi[:, k, 3] = (dot(d, d)[:, k] - L[k] ** 2) / (2 * L[k])
        for kind in np.unique(self.kinds[self.joint_moving > 0]):
            k = np.flatnonzero((self.kinds == kind) & (self.joint_moving > 0))
            D, U, (n1, n2, n3), r_i = d[:, k], u[:, k], (a[:, k] for a in n), L[k]
            c0, c1, c2, c3, a, omega, p = self.joint_motion[k].T
            t = (s["t"] + step)[:, None]
            f = c0 + t * (c1 + t * (c2 + t * c3)) + a * np.sin(omega * t + p)
            x_i = r[:, i[k]] + turn(i[k], self.joint_s_i[k])
            if kind == "driven position":
                phi[:, k, 9] = dot(n1, D) - f
            elif kind == "driven distance":
                phi[:, k, 9] = norm(D) - f
            elif kind == "driven angle":
                cos, sin, angular[k, 9] = np.cos(f)[..., None], np.sin(f)[..., None], True
                phi[:, k, 9] = dot(U, n1 * cos + n2 * sin)
                fold[:, k, 9] = dot(U, n2 * cos - n1 * sin).real > 0
            elif kind == "knife edge":
                rate[:, k, 9] = dot(U.real, carry(i[k], x_i) - carry(j[k], x_i)) - f.real
            elif kind == "rolling disc":
                m = n1 - dot(n1, U)[..., None] * U
                x_i = x_i - r_i[:, None] * m / norm(m)[..., None]
                phi[:, k, 9] = dot(n1, x_i - r[:, j[k]] - turn(j[k], self.joint_s_j[k]))
                slip = carry(i[k], x_i) - carry(j[k], x_i)
                rate[:, k, 10], rate[:, k, 11] = dot(n2.real, slip), dot(n3.real, slip)
            elif kind == "rack and pinion":
                turned = angle(dot(np.cross(n1, n2), np.cross(-n2, U)), dot(-n2, U))
                phi[:, k, 9] = r_i * wrap(turned + dot(n2, D) / r_i)
            else:
                raise UnreadableBundle(f"{self.id}: joint kind {kind!r} is not described")
        rate += phi.imag / step.imag
        phi, rate = phi.real * mask, rate * mask
        out["phi"], out["phi_dot"] = np.sqrt((phi**2).sum((1, 2))), np.sqrt((rate**2).sum((1, 2)))
        weight = np.where(angular, self.rim[self.member][:, None], 1.0)
        opened = np.where(fold & mask, 2 - np.abs(phi), phi)
        for key, rows in (("gap", opened * weight), ("gap_rate", rate * weight)):
            out[key] = np.zeros((nt, self.ng))
            np.add.at(out[key], (slice(None), self.member), (rows**2).sum(2))
            out[key] = np.sqrt(out[key])
        return out

    def relate(self, s: States) -> States:
        """Return states whose mechanisms without a hold at the ground are relative to their common C."""
        s = dict(s)
        for g in np.unique(self.group[~self.grounded]):
            k = np.flatnonzero(self.group == g)
            for key in ("r", "v"):
                s[key] = s[key].copy()
                s[key][:, k] -= np.einsum("b,tbi->ti", self.mass[k], s[key][:, k])[:, None] / self.mass[k].sum()
        return s

    def motion(self, a: States, b: States) -> Array:
        """Return the root mean square distance of each body's matter, (nt, nb)."""
        D = a["R"] - b["R"]
        half = np.trace(self.inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 2 - self.inertia
        spread = np.einsum("tbij,bjk,tbik->tb", D, half, D) / self.mass
        return np.sqrt(((a["r"] - b["r"]) ** 2).sum(2) + np.maximum(spread, 0))

    def rate(self, v: Array, w: Array) -> Array:
        """Return sqrt(v^2 + w.Jw/m) of each body, (nt, nb)."""
        return np.sqrt(dot(v, v) + np.einsum("tbi,bij,tbj->tb", w, self.inertia, w) / self.mass)

    def by_group(self, values: Array) -> Array:
        """Return the largest of each mechanism's bodies, (nt, ng)."""
        return np.stack([values[:, self.group == g].max(1) for g in range(self.ng)], 1)


def read_states(arrays: dict[str, Array], prefix: str, nb: int, name: str) -> States:
    """Return t, r, R, v, Omega of the arrays, with their shapes verified and times in order."""
    demand(all(prefix + key in arrays for key in ("t", *POSES)), f"{name}: no states")
    s = {key: arrays[prefix + key] for key in ("t", *POSES)}
    nt = s["t"].size
    demand(nt * nb <= MAX_STATE_ROWS and s["t"].shape == (nt,), f"{name}: shape of {prefix}t")
    for key, shape in POSES.items():
        demand(s[key].shape == (nt, nb, *shape), f"{name}: {prefix}{key} has shape {s[key].shape}")
    demand((np.diff(s["t"]) > 0).all() or not np.isfinite(s["t"]).all(), f"{name}: times are not in order")
    if not prefix:
        demand(arrays.get("error", np.zeros(0)).shape == (nt,), f"{name}: no stated errors")
        s["error"] = arrays["error"]
    return s


def select(s: States, k: Any) -> States:
    """Return the chosen rows."""
    return {key: a[k] for key, a in s.items()}


def measure(p: Problem, s: States) -> dict[str, Array]:
    """Evaluate the states in pieces of bounded memory."""
    piece = max(1, 60_000 // max(p.nb, len(p.joint_i)))
    parts = [p.evaluate(select(s, slice(k, k + piece))) for k in range(0, len(s["t"]), piece)]
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


# --- judgement -------------------------------------------------------------------------------------------------------


class Report:
    """Count what was compared and keep what disagrees."""

    def __init__(self) -> None:
        self.runs = self.numbers = 0
        self.findings: list[str] = []
        self.undecided: dict[str, int] = {}

    def leave(self, what: str) -> None:
        """Count what the bundle cannot decide."""
        self.undecided[what] = self.undecided.get(what, 0) + 1

    def compare(self, run: str, column: str, recorded: Any, value: Any, slack: float = 0.0, complete: Any = True) -> None:
        """Compare numbers or words; where the state of a maximum is not kept the value is a lower bound."""
        if isinstance(value, float):
            recorded = number(recorded)
            same = abs(value - recorded) <= REL * abs(recorded) + slack or (math.isnan(value) and math.isnan(recorded))
            if not same and not complete and value < recorded:
                return self.leave(column)
        else:
            same = value == recorded
        self.numbers += 1
        if not same:
            self.findings.append(f"{run:17} {column:34} {str(recorded)[:48]:>24} {str(value)[:48]:>24}")
        return None


def find_scales(p: Problem, s: States, m: dict[str, Array], own: Array) -> dict[str, Array]:
    """Return each mechanism's scales over the states; `own` tells those that set its length."""
    start, rel = p.relate({key: getattr(p, f"start_{key}")[None] for key in POSES}), p.relate(s)
    moved = p.by_group(p.motion(rel, start))
    T = np.stack([m["T"][:, p.group == g].sum(1) for g in range(p.ng)], 1)
    gained = np.maximum(T + m["V"] - (T + m["V"])[0], 0)
    pinned = np.array([(p.joint_points[p.member == g] > 0).all() for g in range(p.ng)])
    reach = moved.max(0)
    return {
        "length": moved[own].max(0),
        "speed": p.by_group(p.rate(rel["v"], rel["Omega"])).max(0),
        "energy": np.maximum((T - gained).max(0), np.ptp(m["V"], axis=0)),
        "gap": np.where(pinned, np.minimum(reach, 2 * (p.arms + p.rim)), reach),
    }


def check_reference(report: Report, p: Problem) -> None:
    """Demand that the exact motion begins at the start, states sane errors and keeps the laws to them."""
    e, name = p.reference, p.id
    m = measure(p, e)
    k = e["t"] <= p.horizon * (1 + EPS)
    report.compare(name, "reference within the horizon", True, bool(k.all() and e["t"][0] >= 0))
    size = np.abs(e["r"]).max() + p.rim.max() + p.arms.max()
    speed = p.rate(e["v"], e["Omega"]).max() + 1e-9 * size
    allowed = 1e-9 + 100 * np.maximum(e["error"], 0) / size  # relative
    sane = (e["error"] >= 0).all() and (e["error"] < 0.1 * size).all()
    report.compare(name, "reference: stated errors", True, bool(sane))
    laws = {"phi": m["phi"] / size, "phi_dot": m["phi_dot"] / speed, "orthogonality": m["orthogonality"]}
    if e["t"][0] == 0:
        start = max(float(np.abs(e[key][0] - getattr(p, f"start_{key}")).max()) for key in POSES)
        report.compare(name, "reference: start", 0.0, start, 1e-9 * (1 + size + speed))
        if p.work_zero:
            E = m["T"].sum(1) + m["V"].sum(1)
            laws["energy"] = np.abs(E - E[0]) / (np.abs(m["T"]).sum(1).max() + np.abs(m["V"]).max())
        else:
            report.leave("reference: energy")
    else:
        report.leave("reference: start")
    for law, defect in laws.items():
        report.compare(name, f"reference: {law}", 0.0, float((defect / allowed).max()), 1.0)


def check_run(report: Report, p: Problem, run: dict[str, Any], rec: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Compare a record with its states; maxima, ends, scales, series and the status."""
    name, s = run["run_id"], read_states(arrays, "state_", p.nb, run["run_id"])
    good = np.logical_and.reduce([np.isfinite(a).reshape(len(s["t"]), -1).all(1) for a in s.values()])
    finite, every, s = bool(good.all()), run["states"] == "every step", select(s, good)
    if not len(s["t"]):
        return report.leave("runs without states")
    peaks = {key: number(value) for key, value in run["peaks_s"].items()}
    value = {key: number(x) for key, x in rec.items() if type(x) in {int, float} or x in {"nan", "inf", "-inf"}}
    m, t, e = measure(p, s), s["t"], p.reference
    start: States = {key: getattr(p, f"start_{key}")[None] for key in POSES} | {"t": np.zeros(1)}
    first = select(s, slice(0, 1)) if t[0] == 0 else start
    m0 = measure(p, first)
    E0 = float(m0["T"].sum() + m0["V"].sum())
    size = float(np.abs(s["r"]).max() + p.rim.max() + p.arms.max())
    speed, weight = float(p.rate(s["v"], s["Omega"]).max()), float(m["T"].sum(1).max() + np.abs(m["V"]).sum(1).max())
    series: dict[str, Array] = {key: m[key] for key in ("phi", "phi_dot", "orthogonality")}
    series["energy"] = m["T"].sum(1) + m["V"].sum(1)
    series["drift"] = series["energy"] - E0
    kept = arrays.get("energy_error")
    kept = kept[good] if kept is not None and kept.shape == good.shape else None
    if not p.work_zero:
        series["drift"] = np.full(len(t), np.nan) if kept is None else kept
        report.leave("work")

    def compare_maximum(column: str, values: Array, slack: float, at: Array, complete: bool = every) -> None:
        if len(values) and column in rec:
            held = complete or (column in peaks and bool((at == peaks[column]).any()))
            report.compare(name, column, rec[column], float(values.max()), slack, held)

    # scales: even times of the exact motion, then later steps until a law is broken
    reasons = rec.get("wrong_because") or []
    reasons = parse_json(reasons.encode(), name, list) if isinstance(reasons, str) else reasons
    demand(all(isinstance(x, dict) and isinstance(x.get("law"), str) for x in reasons), f"{name}: wrong_because")
    broken = min([number(x.get("time_s", "nan")) for x in reasons if x["law"] not in SOFT], default=math.inf)
    T = min(p.t_end, p.horizon if e else 0.0)
    marks = np.array([x for key, x in peaks.items() if key.startswith("scale ")])
    later = (t < broken) & ((t > T) if e else np.ones(len(t), bool))
    both, own = select(s, later), np.zeros(int(later.sum()), bool)
    if e:
        even = np.abs(e["t"] / T * 2000 - np.round(e["t"] / T * 2000)) < 1e-7
        even = (even | np.isin(e["t"], marks)) & (e["t"] <= T * (1 + EPS))
        both = {key: np.concatenate([e[key][even], both[key]]) for key in ("t", *POSES)}
        own = np.concatenate([np.ones(int(even.sum()), bool), own])
    both = {key: np.concatenate([start[key], both[key]]) for key in ("t", *POSES)}
    own = np.concatenate([[True], own if e else ~own])
    scales = find_scales(p, both, measure(p, both), own)
    complete = len(marks) > 0 and bool(np.isin(marks, both["t"]).all())
    for column, key in (("length_scale_m", "length"), ("speed_scale_m_per_s", "speed"), ("energy_scale_J", "energy")):
        found, recorded = float(scales[key].max()), value.get(column, math.nan)
        if found < 1e-6 * size and key != "energy":
            report.leave(f"{column} of a rest")
        elif p.ng == 1 or key != "energy":
            report.compare(name, column, recorded, found, 1e-9 * size, complete)
        if p.ng == 1 and math.isfinite(recorded):
            scales["gap"] *= recorded / found if key == "length" and not complete else 1.0
            scales[key] = np.array([recorded])
    with np.errstate(all="ignore"):
        shares = {
            "gap_share_max": (m["gap"] / (0.01 * scales["gap"]), 1e-9),
            "gap_rate_share_max": (m["gap_rate"] / (0.05 * scales["speed"]), 1e-9),
        }
    if not p.literal_start:
        for column, (rows, slack) in shares.items():
            compare_maximum(column, rows.max(1), slack, t, every and complete)
    compare_maximum("phi_max", series["phi"], EPS * size, t)
    compare_maximum("phi_dot_max", series["phi_dot"], EPS * (speed + size), t)
    compare_maximum("orthogonality_max", series["orthogonality"], EPS, t)
    compare_maximum("energy_drift_max_J", np.abs(series["drift"]), EPS * weight, t)
    report.compare(name, "energy_start_J", rec["energy_start_J"], E0, EPS * weight)
    if t[-1] == value.get("t_reached_s"):
        for column, key, slack in (("phi_end", "phi", size), ("phi_dot_end", "phi_dot", speed + size)):
            report.compare(name, column, rec[column], float(series[key][-1]), EPS * slack)
        report.compare(name, "energy_drift_end_J", rec["energy_drift_end_J"], float(series["drift"][-1]), EPS * weight)

    errors: dict[str, Array] = {}
    if e:
        k = np.minimum(np.searchsorted(e["t"], t), len(e["t"]) - 1)
        met = e["t"][k] == t
        a, x, at = select(s, met), select(e, k[met]), t[met]
        ratio = scales["length"].max() / np.where(scales["length"] > 0, scales["length"], 1.0)
        spread = (np.linalg.norm(a["R"] - x["R"], axis=(2, 3)) / math.sqrt(8)).clip(0, 1)
        errors = {
            "position_error_{}_m": norm(a["r"] - x["r"]).max(1, initial=0),
            "orientation_error_{}_rad": 2 * np.arcsin(spread).max(1, initial=0),
            "velocity_error_{}_m_per_s": norm(a["v"] - x["v"]).max(1, initial=0),
            "angular_velocity_error_{}_rad_per_s": norm(a["Omega"] - x["Omega"]).max(1, initial=0),
            "motion_error_{}_m": (p.by_group(p.motion(a, x)) * ratio).max(1, initial=0),
            "rate_error_{}_m_per_s": (p.by_group(p.rate(a["v"] - x["v"], a["Omega"] - x["Omega"])) * ratio).max(1),
        }
        judged = at <= value.get("judged_to_s", math.nan)
        for column, values in errors.items():
            slack = EPS * (size if column.startswith(("p", "m")) else 1 + speed)
            compare_maximum(column.format("max"), values, slack, at, every)
            compare_maximum(column.format("judged"), values[judged], slack, at, every)
            end = column.format("end")
            if end in rec and len(at) and at[-1] == value.get("t_reached_s"):
                report.compare(name, end, rec[end], float(values[-1]), slack)
        if every and len(at):
            report.compare(name, "reference_own_error_m", rec["reference_own_error_m"], float(x["error"].max()), 1e-18)

    named = {"phi_norm": "phi", "phi_dot_norm": "phi_dot", "orthogonality": "orthogonality", "energy": "energy"}
    named |= {"energy_error": "drift"} if p.work_zero else {}
    for key, source in named.items():
        if key in arrays and arrays[key].shape == good.shape and (arrays["t"][good] == t).all():
            slack = EPS * {"p": size + speed, "o": 1.0, "e": weight}[key[0]]
            gap = np.abs(arrays[key][good] - series[source]) - REL * np.abs(series[source])
            report.numbers += len(t) - 1
            worst = int(gap.argmax())
            report.compare(name, f"{key} at {t[worst]:g} s", float(arrays[key][good][worst]), float(series[source][worst]), slack)
    check_status(report, p, rec, value, scales, finite, first if t[0] == 0 else None, {x["law"] for x in reasons})
    return None


SOFT = {"motion", "velocity", "rows"}


def check_status(
    report: Report, p: Problem, rec: dict[str, Any], value: dict[str, float], scales: dict[str, Array], finite: bool,
    first: States | None, recorded: set[str],
) -> None:
    """Derive the status from compared columns, and from recorded ones where the bundle cannot decide."""
    name, status = rec["run_id"], rec["status"]
    if rec["claimed"] != "success":
        report.compare(name, "status", status in {"success", "wrong", "inaccurate"}, False)
        return
    get = lambda column: value.get(column, math.nan)  # noqa: E731
    length, speed, energy = get("length_scale_m"), get("speed_scale_m_per_s"), get("energy_scale_J")
    own = get("reference_own_error_judged_m")
    t_end = get("t_end_s")
    tests = {
        "end": (abs(get("t_reached_s") - t_end), 1e-9 * max(t_end, 1.0)),
        "orthogonality": (get("orthogonality_max"), 1e-3),
        "finite": (0.0 if finite else 2.0, 1.0),
        "energy": (get("energy_share_max"), 1.0) if p.ng > 1 else (get("energy_drift_max_J"), 0.1 * energy),
        "constraint": (math.nan if p.literal_start else get("gap_share_max"), 1.0),
        "constraint_rate": (math.nan if p.literal_start else get("gap_rate_share_max"), 1.0),
        "kinematic": (get("kinematic_defect"), 0.5),
        "reaction": (get("reaction_error_max_N"), 10 * (get("reaction_size_N") + energy / length)),
        "motion": (get("motion_error_judged_m"), 0.1 * length + own),
        "velocity": (get("rate_error_judged_m_per_s"), speed),
        "rows": (get("motion_between_max_m"), 0.5 * length + own),
    }
    if first is None:
        report.leave("start")
    else:
        start = max(float(np.abs(first[key] - getattr(p, f"start_{key}")).max()) for key in POSES)
        tests["start"] = (start, 1e-9 * (1 + length + speed))
    broken = {law for law, (size, limit) in tests.items() if size > limit}
    for law in ("invariant", "truncation", "kinematic", "reaction", "rows"):
        report.leave(law)
    hard = (broken - SOFT) | (recorded & {"invariant", "truncation"})
    expected = "wrong" if hard else "inaccurate" if broken else "success"
    report.compare(name, "status", status, expected)
    report.compare(name, "wrong_because", sorted(recorded), sorted(hard or broken))


def check_files(files: dict[str, bytes]) -> Report:
    """Check all runs of a bundle."""
    report = Report()
    head = parse_json(files.get("bundle.json", b""), "bundle.json", dict)
    demand(head.get("format") == "mbsbench bundle" and head.get("version") == 1, "not a bundle of version 1")
    records: dict[str, dict[str, Any]] = {}
    for rec in parse_json(files.get("records.json", b""), "records.json", list):
        demand(isinstance(rec, dict) and isinstance(rec.get("run_id"), str), "records.json: no run_id")
        demand(rec["run_id"] not in records, f"records.json: {rec['run_id'][:40]!r} twice")
        records[rec["run_id"]] = rec
    problems: dict[str, Problem] = {}
    seen = set()
    for run in parse_json(files.get("runs.json", b""), "runs.json", list):
        demand(isinstance(run, dict) and run.get("run_id") in records, "runs.json: a run without a record")
        name, key = run["run_id"], str(run.get("problem"))
        demand(name not in seen and isinstance(run.get("peaks_s"), dict), f"runs.json: {name} twice, or no peaks_s")
        seen.add(name)
        report.runs += 1
        if run.get("states") == "none":
            report.leave("runs without states")
            continue
        if key not in problems:
            demand(f"problems/{key}.json" in files and f"runs/{name}.npy" in files, f"{name}: no problem or no states")
            raw = files[f"problems/{key}.json"]
            problems[key] = Problem(raw, files.get(f"references/{key}.npy"), key)
            if problems[key].reference:
                check_reference(report, problems[key])
        check_run(report, problems[key], run, records[name], read_arrays(files[f"runs/{name}.npy"], run["arrays"], name))
    demand(seen == set(records), "records.json and runs.json differ")
    return report


def check_bundle(path: Path) -> Report:
    """Check a bundle; whatever is wrong with the file itself raises UnreadableBundle."""
    try:
        with np.errstate(all="ignore"):
            return check_files(read_files(path))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, RecursionError, MemoryError) as error:
        raise UnreadableBundle(f"{type(error).__name__}: {str(error)[:100]}") from None
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise UnreadableBundle(f"{type(error).__name__}: {str(error)[:100]}") from None


def check(path: str | Path) -> list[str]:
    """Return the findings; empty if all agree."""
    try:
        return check_bundle(Path(path)).findings
    except UnreadableBundle as error:
        return [f"unreadable: {error}"]


def main(paths: list[str]) -> int:
    """Print a table of agreement for each bundle."""
    worst = 0 if paths else 2
    for path in paths:
        try:
            report = check_bundle(Path(path))
        except UnreadableBundle as error:
            print(f"{path}: unreadable: {error}".encode("ascii", "backslashreplace").decode())  # noqa: T201
            worst = 2
            continue
        found = report.findings
        print(f"{path}: {report.runs} runs, {report.numbers} numbers compared, {len(found)} disagreements, ", end="")  # noqa: T201
        print(f"{sum(report.undecided.values())} undecided")  # noqa: T201
        if found:
            print(f"{'run':17} {'column':34} {'recorded':>24} {'recomputed':>24}", *found, sep="\n")  # noqa: T201
        print(*(f"  undecided: {what} ({n})" for what, n in sorted(report.undecided.items())), sep="\n")  # noqa: T201
        worst = max(worst, int(bool(found)))
    return worst


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
