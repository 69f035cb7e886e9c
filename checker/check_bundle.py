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
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray
States = dict[str, Array]
NAMES = re.compile(
    r"(bundle|records|runs|ro-crate-metadata|environment(\.[\w-]{1,64})?)\.json|suite\.toml|manifest-sha256\.txt"
    r"|(runs|references)/[\w-]{1,64}\.npy|problems/[\w-]{1,64}\.json",
    re.ASCII,
)
MAX_FILES, MAX_BYTES, MAX_JSON, MAX_VALUES, MAX_DIRECTORY = 20_000, 1 << 29, 1 << 24, 3_000_000, 1 << 22
REL, EPS = 1e-6, 1e-12  # tolerances: relative to the recorded number, and to the size of what it is a difference of
SOFT = {"motion", "velocity", "rows"}  # the reasons of `inaccurate`
POSES = {"r": (3,), "R": (3, 3), "v": (3,), "Omega": (3,)}
FIELDS = (  # shapes: numbers of bodies, joints, springs, torsions, loads, pairs of user forces, then 3 or 7
    "mass:b inertia:b33 gyration:b gravity:3 start_r:b3 start_R:b33 start_v:b3 start_Omega:b3 joint_i:j joint_j:j "
    "joint_s_i:j3 joint_s_j:j3 joint_u:j3 joint_w:j3 joint_n:j33 joint_length:j joint_motion:j7 joint_points:j "
    "joint_lines:j joint_axes:j joint_moving:j spring_i:s spring_j:s spring_p_i:s3 spring_p_j:s3 spring_k:s "
    "spring_d0:s spring_c:s torsion_i:t torsion_j:t torsion_u:t3 torsion_n:t33 torsion_k:t torsion_rest:t torsion_c:t "
    "load_i:l user_i:u user_j:u"
)


class UnreadableBundle(Exception):
    """The file is no bundle that can be judged."""


def demand(condition: Any, message: str) -> None:
    """Refuse the bundle unless the condition holds."""
    if not condition:
        raise UnreadableBundle(message)


def read_files(path: Path) -> dict[str, bytes]:
    """Return the members of the archive after its directory, sizes, names and digests have been verified."""
    demand(path.is_file() and 42 < path.stat().st_size <= MAX_BYTES, "no file of 42 bytes to 512 MB")
    with path.open("rb") as file:
        file.seek(-42, 2)
        tail = file.read()
    demand(tail[20:24] == b"PK\5\6" and tail[-2:] == b"\0\0" and tail[:4] != b"PK\6\7", "not a plain zip file")
    demand(int.from_bytes(tail[32:36], "little") <= MAX_DIRECTORY, "the directory of the zip file is too large")
    files: dict[str, bytes] = {}
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        demand(
            len(members) <= MAX_FILES and sum(m.file_size for m in members) <= MAX_BYTES, "more than 512 MB unpacked"
        )
        for member in members:
            name = member.orig_filename
            demand(NAMES.fullmatch(name) and name not in files, f"unexpected or duplicate file {name[:80]!r}")
            demand(member.external_attr >> 28 in {0, 8} and not member.flag_bits & 1, f"{name} is a link or encrypted")
            demand(member.compress_type in {0, 8, 12}, f"{name} is neither stored, deflated nor bzip2")
            with archive.open(member) as stream:
                files[name] = stream.read(member.file_size)
    stated: dict[str, str] = {}
    for line in files.get("manifest-sha256.txt", b"").decode("ascii").splitlines():
        digest, _, name = line.partition("  ")
        demand(name not in stated and name in files, f"the manifest lists {name[:80]!r} twice or without a file")
        stated[name] = digest
    for name in files.keys() - {"manifest-sha256.txt"}:
        demand(hashlib.sha256(files[name]).hexdigest() == stated.get(name), f"{name} differs from the manifest")
    return files


def parse_json(raw: bytes, name: str, kind: type) -> Any:
    """Parse bounded JSON without repeated keys, whose top level is of the kind."""
    demand(len(raw) <= MAX_JSON and sum(map(raw.count, (b",", b"[", b"{"))) <= MAX_VALUES, f"{name} is too large")

    def collect(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        demand(len(dict(pairs)) == len(pairs), f"{name} repeats a key")
        return dict(pairs)

    value = json.loads(raw.decode("utf-8"), object_pairs_hook=collect)
    demand(isinstance(value, kind), f"{name} is no {kind.__name__}")
    return value


def read_arrays(raw: bytes, layout: dict[str, Any], name: str) -> dict[str, Array]:
    """Return the arrays of a vector of float64 that fill it without overlaps; there are no pickles."""
    stream = io.BytesIO(raw)
    demand(np.lib.format.read_magic(stream) == (1, 0), f"{name}: unexpected version")
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    exact = dtype == np.dtype("<f8") and len(shape) == 1 and shape[0] * 8 == len(raw) - stream.tell()
    demand(exact, f"{name}: not a vector of float64 of its size")
    vector, arrays, used = np.frombuffer(raw, "<f8", offset=stream.tell()), {}, 0
    for key, (offset, sizes) in layout.items():
        fits = len(sizes) <= 4 and all(type(n) is int and 0 <= n <= vector.size for n in (offset, *sizes))
        demand(fits and offset + math.prod(sizes) <= vector.size, f"{name}: {key[:40]!r} passes its end")
        arrays[key], used = vector[offset : offset + math.prod(sizes)].reshape(sizes), used + math.prod(sizes)
    demand(used == vector.size, f"{name}: arrays overlap or leave gaps")
    return arrays


def read_states(arrays: dict[str, Array], prefix: str, nb: int, name: str) -> States:
    """Return t, r, R, v, Omega of the arrays, their shapes verified and times in order."""
    s = {key: arrays[prefix + key] for key in ("t", *POSES)} | ({} if prefix else {"error": arrays["error"]})
    for key, a in s.items():
        shape = (s["t"].size, nb, *POSES[key]) if key in POSES else (s["t"].size,)
        demand(a.shape == shape, f"{name}: {prefix}{key} has shape {a.shape}, not {shape}")
    demand(not (np.diff(s["t"]) <= 0).any(), f"{name}: times are not in order")
    return s


def number(value: Any) -> float:
    """Return a number of JSON, where "nan", "inf" and "-inf" are numbers."""
    demand(type(value) in {int, float} or value in ("nan", "inf", "-inf"), f"{str(value)[:40]!r} is no number")
    return float(value)


def select(s: States, k: Any) -> States:
    """Return the chosen rows."""
    return {key: a[k] for key, a in s.items()}


def dot(a: Array, b: Array) -> Array:
    """Return the product over the last axis."""
    return np.einsum("...k,...k", a, b)


def norm(a: Array) -> Array:
    """Return the length over the last axis, also of complex steps."""
    return np.sqrt(dot(a, a))


def angle(y: Array, x: Array, less: Array) -> Array:
    """Return atan2 of complex steps, less an angle, within half a turn."""
    rate = (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)
    turned = np.arctan2(y.real, x.real) + 1j * rate - less
    return turned - 2 * np.pi * np.round(turned.real / (2 * np.pi))


class Problem:
    """The validated numbers of a problem, its exact motion, and functions of the state."""

    def __init__(self, raw: bytes, vector: bytes | None, name: str) -> None:
        data = parse_json(raw, name, dict)
        sizes = {"3": 3, "7": 7}
        for field in FIELDS.split():
            key, letters = field.split(":")
            value = data["numbers"][key]
            shape = tuple(sizes.setdefault(letter, len(value)) for letter in letters)
            value = np.array(value, float).reshape(shape) if 0 in shape else np.array(value, float)
            demand(
                value.shape == shape and np.isfinite(value).all(), f"{name}: {key} is not finite or of shape {shape}"
            )
            body = len(letters) == 1 and key.endswith(("_i", "_j"))
            demand(not body or ((value >= -1) & (value < sizes["b"])).all(), f"{name}: {key} beyond the bodies")
            counts = key in {"joint_points", "joint_lines", "joint_axes", "joint_moving"}
            setattr(self, key, value.astype(int) if body or counts else value)
        self.nb, self.id, self.kinds = sizes["b"], name, np.array([str(kind)[:40] for kind in data["joint_kinds"]])
        demand(
            0 < self.nb <= 2000 and max(sizes.values()) <= 50 * self.nb + 50 and (self.mass > 0).all(),
            f"{name}: bodies or masses",
        )
        demand(len(self.kinds) == sizes["j"], f"{name}: joint_kinds")
        self.literal_start, self.t_end = data["literal_start"] is True, number(data["t_end_s"])
        demand(0 < self.t_end < math.inf, f"{name}: t_end_s")
        self.start: States = {"t": np.zeros(1)} | {key: getattr(self, f"start_{key}")[None] for key in POSES}
        self.reference: States = {}
        if vector is not None:
            self.horizon = number(data["reference"]["horizon_s"])
            self.reference = read_states(read_arrays(vector, data["reference_arrays"], name), "", self.nb, name)
            demand(all(np.isfinite(a).all() for a in self.reference.values()), f"{name}: reference not finite")
        forces = [self.spring_c, self.torsion_c, self.joint_motion]
        self.has_work = sizes["l"] or sizes["u"] or data["not_serialised"] or any(force.any() for force in forces)
        self.find_mechanisms()

    def find_mechanisms(self) -> None:
        """Number each body's mechanism; find those held at the ground, largest gyrations and sums of arms."""
        group, pairs = np.arange(self.nb), ("joint", "spring", "user", "torsion")
        edges = [np.stack([getattr(self, f"{pair}_i"), getattr(self, f"{pair}_j")], 1) for pair in pairs]
        for i, j in np.concatenate(edges):
            if min(i, j) >= 0:
                group[group == group[i]] = group[j]
        self.group = np.unique(group, return_inverse=True)[1]
        holds = np.concatenate(edges[:3])  # a torsion at the ground holds no position
        held = self.group[holds[holds.min(1) < 0].max(1)]
        self.ng, self.floating = int(self.group.max()) + 1, np.setdiff1d(self.group, held)
        self.member = self.group[np.maximum(self.joint_i, self.joint_j)]
        self.rim, self.arms = np.zeros((2, self.ng))
        np.maximum.at(self.rim, self.group, self.gyration)
        for body, point in ((self.joint_i, self.joint_s_i), (self.joint_j, self.joint_s_j)):
            np.add.at(self.arms, self.group[body[body >= 0]], norm(point[body >= 0]))

    def evaluate(self, s: States) -> dict[str, Array]:
        """Return energies, norms of rows (nt,), gaps by mechanism (nt, ng); rates by complex steps along the motion."""
        nt, step = len(s["t"]), 1e-30j
        W = np.cross(s["Omega"][:, :, None], np.eye(3))  # rows Omega x e_k: the transposed matrix of Omega x
        r = np.concatenate([s["r"] + step * s["v"], np.zeros((nt, 1, 3))], 1)
        R = s["R"] + step * np.einsum("tbij,tbkj->tbik", s["R"], W)
        R = np.concatenate([R, np.broadcast_to(np.eye(3), (nt, 1, 3, 3))], 1)

        def turn(body: Array, a: Array) -> Array:
            return np.einsum("tkij,kj->tki", R[:, body], a)

        def separate(i: Array, j: Array, a: Array, b: Array) -> Array:
            return r[:, i] + turn(i, a) - r[:, j] - turn(j, b)

        def carry(body: Array, x: Array) -> Array:
            arm = np.einsum("tkij,tki->tkj", R[:, body].real, x.real - r[:, body].real)
            return (r[:, body] + np.einsum("tkij,tkj->tki", R[:, body], arm)).imag / step.imag

        d = separate(self.spring_i, self.spring_j, self.spring_p_i, self.spring_p_j).real
        e, b = (turn(self.torsion_j, self.torsion_n[:, k]) for k in (0, 1))
        u = turn(self.torsion_i, self.torsion_u)
        theta = angle(dot(u, b), dot(u, e), self.torsion_rest).real
        energies = (
            (np.arange(self.nb), -self.mass * (s["r"] @ self.gravity)),
            (np.maximum(self.spring_i, self.spring_j), self.spring_k * (norm(d) - self.spring_d0) ** 2 / 2),
            (np.maximum(self.torsion_i, self.torsion_j), self.torsion_k * theta**2 / 2),
        )
        out = {"T": self.mass * self.rate(s["v"], s["Omega"]) ** 2 / 2, "V": np.zeros((nt, self.ng))}
        for body, values in energies:
            np.add.at(out["V"], (slice(None), self.group[body]), values)
        out["orthogonality"] = np.linalg.norm(np.swapaxes(s["R"], 2, 3) @ s["R"] - np.eye(3), axis=(2, 3)).max(1)

        i, j, L = self.joint_i, self.joint_j, self.joint_length
        counts = (self.joint_points, self.joint_lines, self.joint_axes, self.joint_moving)
        mask = np.concatenate([np.arange(3) < count[:, None] for count in counts], 1)
        angular = np.zeros((len(i), 12), bool)
        phi, rate, fold = (np.zeros((nt, len(i), 12), kind) for kind in (complex, float, bool))
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
                across = dot(np.cross(n1, n2), np.cross(-n2, U))
                phi[:, k, 9] = r_i * angle(across, -dot(n2, U), -dot(n2, D) / r_i)
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
        for g in self.floating:
            k = self.group == g
            for key in ("r", "v"):
                centre = np.average(s[key][:, k], axis=1, weights=self.mass[k])
                s[key] = np.where(k[:, None], s[key] - centre[:, None], s[key])
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

    def differ(self, s: States) -> float:
        """Return the largest difference of the first state from the start."""
        return max(float(np.abs(s[key][0] - self.start[key][0]).max()) for key in POSES)

    def by_group(self, values: Array) -> Array:
        """Return the largest of each mechanism's bodies, (nt, ng)."""
        return np.stack([values[:, self.group == g].max(1) for g in range(self.ng)], 1)


def measure(p: Problem, s: States) -> dict[str, Array]:
    """Evaluate the states in pieces of bounded memory."""
    piece = max(1, 60_000 // max(p.nb, len(p.joint_i)))
    parts = [p.evaluate(select(s, slice(k, k + piece))) for k in range(0, len(s["t"]), piece)]
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


class Report:
    """Count what was compared and keep what disagrees."""

    def __init__(self) -> None:
        self.runs = self.numbers = 0
        self.findings: list[str] = []
        self.undecided: dict[str, int] = {}

    def compare(
        self, run: str, column: str, recorded: Any, value: Any, slack: float = 0, complete: bool = True
    ) -> None:
        """Compare numbers or words; where the state of a maximum is not kept its value is a lower bound."""
        same = value == recorded
        if isinstance(value, float):
            recorded = number(recorded)
            close = abs(value - recorded) <= REL * abs(recorded) + slack and math.isfinite(recorded)
            same = value == recorded or close or (math.isnan(value) and math.isnan(recorded))
            if not complete and not same and value < recorded:
                return self.leave(column)
        self.numbers += 1
        if not same:
            self.findings.append(f"{run:17} {column:38} {str(recorded)[:48]:>24} {str(value)[:48]:>24}")
        return None

    def leave(self, what: str) -> None:
        """Count what the bundle cannot decide."""
        self.undecided[what] = self.undecided.get(what, 0) + 1


def find_scales(p: Problem, s: States, exact: Array, known: Array) -> dict[str, Array]:
    """Return each mechanism's scales: reach over all states, length over the exact ones, the others over known ones."""
    rel = p.relate(s)
    moved = p.by_group(p.motion(rel, p.relate(p.start)))
    m, rel = measure(p, select(s, known)), select(rel, known)
    T = np.stack([m["T"][:, p.group == g].sum(1) for g in range(p.ng)], 1)
    gained = np.maximum(T + m["V"] - (T + m["V"])[0], 0)
    pinned = [bool((p.joint_points[p.member == g] > 0).all()) for g in range(p.ng)]
    return {
        "length_scale_m": moved[exact].max(0),
        "speed_scale_m_per_s": p.by_group(p.rate(rel["v"], rel["Omega"])).max(0),
        "energy_scale_J": np.maximum((T - gained).max(0), np.ptp(m["V"], axis=0)),
        "gap": np.where(pinned, np.minimum(moved.max(0), 2 * (p.arms + p.rim)), moved.max(0)),
    }


def check_reference(report: Report, p: Problem) -> None:
    """Demand that the exact motion begins at the start, states sane errors and keeps the laws to them."""
    e, m = p.reference, measure(p, p.reference)
    size, speed = np.abs(e["r"]).max() + p.rim.max() + p.arms.max(), p.rate(e["v"], e["Omega"]).max()
    speed = max(speed, 1e-9 * size)
    allowed = 1e-9 + 100 * e["error"].clip(0) / size
    sane = (e["error"] >= 0).all() and (e["error"] < 0.1 * size).all() and e["t"][0] >= 0 and e["t"][-1] <= p.horizon
    report.compare(p.id, "reference: errors and horizon sane", True, bool(sane))
    laws = {"phi": m["phi"] / size, "phi_dot": m["phi_dot"] / speed, "orthogonality": m["orthogonality"]}
    if e["t"][0] == 0:
        report.compare(p.id, "reference: start", 0, p.differ(e), 1e-9 * (1 + size + speed))
    else:
        report.leave("reference: start")
    if not p.has_work:
        E, m0 = m["T"].sum(1) + m["V"].sum(1), p.evaluate(p.start)
        laws["energy"] = (E - m0["T"].sum() - m0["V"].sum()) / (m["T"].sum(1).max() + np.abs(m["V"]).max() + 1e-300)
    else:
        report.leave("reference: energy")
    for law, defect in laws.items():
        report.compare(p.id, f"reference: {law} / allowed", 0, float(np.abs(defect / allowed).max()), 1)


def check_run(report: Report, p: Problem, run: dict[str, Any], rec: dict[str, Any], arrays: dict[str, Array]) -> None:
    """Compare a record with its states: maxima, last values, scales, series and status."""
    name, every, e = rec["run_id"], run["states"] == "every step", p.reference
    s = read_states(arrays, "state_", p.nb, name)
    good = np.logical_and.reduce([np.isfinite(a).reshape(len(a), -1).all(1) for a in s.values()])
    finite, s = bool(good.all()), select(s, good)
    if not len(s["t"]):
        return report.leave("runs without states")
    peaks = {key: number(value) for key, value in run["peaks_s"].items()}
    column = {key: number(x) for key, x in rec.items() if type(x) in {int, float} or x in ("nan", "inf", "-inf")}
    reasons = parse_json(rec["wrong_because"].encode(), name, list)
    m, t, m0 = measure(p, s), s["t"], p.evaluate(select(s, slice(0, 1)) if s["t"][0] == 0 else p.start)
    size = float(np.abs(s["r"]).max() + p.rim.max() + p.arms.max())
    speed, weight = float(p.rate(s["v"], s["Omega"]).max()) + size, float((m["T"].sum(1) + np.abs(m["V"]).sum(1)).max())

    # scales: at even times of the exact motion, and in later steps of the run until it breaks a law
    broken = min((number(x["time_s"]) for x in reasons if x["law"] not in SOFT), default=math.inf)
    T = min(p.t_end, p.horizon) if e else 0.0
    marks = np.array([x for key, x in peaks.items() if key.startswith("scale ")])
    parts = [p.start, select(s, t < broken)]
    if e:
        even = np.abs(e["t"] / T * 2000 - np.round(e["t"] / T * 2000)) < 1e-7
        parts.append(select(e, (even | np.isin(e["t"], marks)) & (e["t"] <= T * (1 + EPS))))
    both = {key: np.concatenate([part[key] for part in parts]) for key in ("t", *POSES)}
    exact = np.ones(len(both["t"]), bool)
    exact[1 : 1 + len(parts[1]["t"])] = not e
    scales = find_scales(p, both, exact, exact | (both["t"] > T * (1 + EPS)))
    complete = bool((every or (p.t_end <= T)) and np.isin(marks, both["t"]).all() and (len(marks) or not e))
    for key in [key for key in scales if key in column]:
        rest = key != "energy_scale_J" and scales[key].max() < 1e-6 * size
        if p.ng == 1 or key != "energy_scale_J":
            report.compare(name, key, rec[key], float(scales[key].max()), 1e-9 * weight, complete and not rest)
        if p.ng == 1:
            scales[key] = np.array([column[key]])

    drift = m["T"].sum(1) + m["V"].sum(1) - m0["T"].sum() - m0["V"].sum()
    if p.has_work:
        drift = arrays["energy_error"][good]
    columns = {  # values, slack, times, whether all are kept
        "phi_{}": (m["phi"], EPS * size, t, every),
        "phi_dot_{}": (m["phi_dot"], EPS * speed, t, every),
        "orthogonality_{}": (m["orthogonality"], EPS, t, every),
        "energy_drift_{}_J": (drift, EPS * weight, t, every),
    }
    if p.ng == 1:
        columns["energy_share_{}"] = (drift / (0.1 * scales["energy_scale_J"]), 1e-9, t, every)
    if not p.literal_start:
        if every and complete:  # otherwise the reach is not known
            columns["gap_share_{}"] = ((m["gap"] / (0.01 * scales["gap"])).max(1), 1e-9, t, True)
        else:
            report.leave("gap_share_max")
        share = (m["gap_rate"] / (0.05 * scales["speed_scale_m_per_s"])).max(1)
        columns["gap_rate_share_{}"] = (share, 1e-9, t, every and complete)
    if e:
        k = np.minimum(np.searchsorted(e["t"], t), len(e["t"]) - 1)
        a, x, at = select(s, e["t"][k] == t), select(e, k[e["t"][k] == t]), t[e["t"][k] == t]
        ratio = scales["length_scale_m"].max() / scales["length_scale_m"]
        spread = np.linalg.norm(a["R"] - x["R"], axis=(2, 3)).clip(0, math.sqrt(8)) / math.sqrt(8)
        v, w = a["v"] - x["v"], a["Omega"] - x["Omega"]
        for key, errors, slack in (
            ("position_error_{}_m", norm(a["r"] - x["r"]), size),
            ("orientation_error_{}_rad", 2 * np.arcsin(spread), 1e4),
            ("velocity_error_{}_m_per_s", norm(v), speed),
            ("angular_velocity_error_{}_rad_per_s", norm(w), 1 + norm(a["Omega"]).max(initial=0)),
            ("motion_error_{}_m", p.by_group(p.motion(a, x)) * ratio, size),
            ("rate_error_{}_m_per_s", p.by_group(p.rate(v, w)) * ratio, speed),
        ):
            columns[key] = (errors.max(1), EPS * slack, at, every)
        columns["reference_own_error_{}_m"] = (x["error"], 1e-3 * EPS * size, at, every)  # the rounding of an estimate
        early, length = e["error"][np.searchsorted(e["t"], at / 10, "right") - 1], scales["length_scale_m"].max()
        usable = (x["error"] < 1e-9 * length) | ((x["error"] < 1e-3 * length) & (x["error"] < 100 * early))
        judged_to = at[np.logical_and.accumulate(usable)].max(initial=0)
        report.compare(name, "judged_to_s", rec["judged_to_s"], float(judged_to), 0, every)
    for key, (values, slack, at, whole) in columns.items():
        for which, span in (("max", at <= math.inf), ("judged", at <= column.get("judged_to_s", -1.0))):
            full = key.format(which)
            if full in rec and span.any():
                held = whole or bool(np.isin(peaks.get(full, -1.0), at))
                report.compare(name, full, rec[full], float(np.abs(values[span]).max()), slack, held)
        if key.format("end") in rec and len(at) and at[-1] == column["t_reached_s"]:
            report.compare(name, key.format("end"), rec[key.format("end")], float(values[-1]), slack)
    report.compare(name, "energy_start_J", rec["energy_start_J"], float(m0["T"].sum() + m0["V"].sum()), EPS * weight)

    # status: of compared columns, and of recorded ones where the bundle cannot decide
    if rec["claimed"] != "success":
        return report.compare(name, "status of a failure", False, rec["status"] in {"success", "wrong", "inaccurate"})
    get = defaultdict(lambda: math.nan, column)
    length, energy, own = get["length_scale_m"], get["energy_scale_J"], get["reference_own_error_judged_m"]
    tests = {
        "end": abs(get["t_reached_s"] - p.t_end) - 1e-9 * max(p.t_end, 1),
        "start": p.differ(s) - 1e-9 * (1 + length + speed) if t[0] == 0 else math.nan,
        "finite": 0.5 - finite,
        "energy": get["energy_share_max"] - 1 if p.ng > 1 else get["energy_drift_max_J"] - 0.1 * energy,
        "constraint": math.nan if p.literal_start else get["gap_share_max"] - 1,
        "constraint_rate": math.nan if p.literal_start else get["gap_rate_share_max"] - 1,
        "orthogonality": get["orthogonality_max"] - 1e-3,
        "kinematic": get["kinematic_defect"] - 0.5,
        "reaction": get["reaction_error_max_N"] - 10 * (get["reaction_size_N"] + energy / length),
        "motion": get["motion_error_judged_m"] - 0.1 * length - own,
        "velocity": get["rate_error_judged_m_per_s"] - get["speed_scale_m_per_s"],
        "rows": get["motion_between_max_m"] - 0.5 * length - own,
    }
    for law in ("invariant", "truncation", "kinematic", "reaction", "rows", *(["start"] if t[0] else [])):
        report.leave(f"law {law}")
    stated = {str(x["law"]) for x in reasons}
    found = {law for law, excess in tests.items() if excess > 0} | (stated & {"invariant", "truncation"})
    found -= {"rows"} if "motion" in found else set()
    report.compare(name, "status", rec["status"], "wrong" if found - SOFT else "inaccurate" if found else "success")
    return report.compare(name, "wrong_because", sorted(stated), sorted(found - SOFT or found))


def check_bundle(path: Path) -> Report:
    """Check all runs of a bundle; whatever is wrong with the file itself raises UnreadableBundle."""
    report, problems, seen = Report(), {}, set()
    try:
        files = read_files(path)
        head = parse_json(files["bundle.json"], "bundle.json", dict)
        demand(head["format"] == "mbsbench bundle" and head["version"] == 1, "not a bundle of version 1")
        rows = parse_json(files["records.json"], "records.json", list)
        records = {str(rec["run_id"]): rec for rec in rows}
        for run in parse_json(files["runs.json"], "runs.json", list):
            name, key = str(run["run_id"]), str(run["problem"])
            demand(name in records and name not in seen, f"{name[:40]!r} twice or without a record")
            seen.add(name)
            if run["states"] == "none":
                report.leave("runs without states")
                continue
            if key not in problems:
                p = Problem(files[f"problems/{key}.json"], files.get(f"references/{key}.npy"), key)
                problems[key] = p
                if p.reference:
                    check_reference(report, p)
            arrays = read_arrays(files[f"runs/{name}.npy"], run["arrays"], name)
            check_run(report, problems[key], run, records[name], arrays)
        demand(len(rows) == len(seen), "records.json and runs.json differ")
    except UnreadableBundle:
        raise
    except (ArithmeticError, AttributeError, LookupError, MemoryError, OSError, EOFError, RuntimeError, SyntaxError,
            TypeError, ValueError, zipfile.BadZipFile, zlib.error) as error:  # fmt: skip
        raise UnreadableBundle(f"{type(error).__name__}: {str(error)[:100]!r}") from None
    report.runs = len(seen)
    return report


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
            print(f"{path}: unreadable: {error}".encode("ascii", "backslashreplace").decode())
            worst = 2
            continue
        counts = f"{report.runs} runs checked, {report.numbers} numbers compared, {len(report.findings)} disagreements"
        print(f"{path}: {counts}, {sum(report.undecided.values())} undecided", *report.findings, sep="\n")
        print("  undecided:", ", ".join(f"{what} {n}" for what, n in sorted(report.undecided.items())))
        worst = max(worst, int(bool(report.findings)))
    return worst


if __name__ == "__main__":
    with np.errstate(all="ignore"):
        sys.exit(main(sys.argv[1:]))
