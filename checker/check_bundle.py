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
from collections import Counter, defaultdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

Array = np.ndarray
States = dict[str, Array]
NAMES = re.compile(
    r"(bundle|records|runs|ro-crate-metadata|environment(\.[\w-]{1,64})?)\.json|suite\.toml|manifest-sha256\.txt"
    r"|(runs|references|series)/[\w-]{1,64}\.npy|problems/[\w-]{1,64}\.json",
    re.ASCII,
)
MAX_FILES, MAX_BYTES, MAX_JSON, MAX_VALUES, MAX_DIRECTORY = 20_000, 1 << 29, 1 << 24, 3_000_000, 1 << 22
REL, EPS, STEP = 1e-6, 1e-12, 1e-30  # tolerances: of the recorded number, of its terms' size; step of derivatives
SOFT = {"motion", "velocity", "rows"}  # the reasons of `inaccurate`
POSES = {"r": (3,), "R": (3, 3), "v": (3,), "Omega": (3,)}
ENDS = {"j": "joint", "s": "spring", "t": "torsion", "u": "user"}
FIELDS = (  # shapes: numbers of bodies, joints, springs, torsions, loads, user forces, then 3 or 7
    "mass:b inertia:b33 gyration:b gravity:3 start_r:b3 start_R:b33 start_v:b3 start_Omega:b3 joint_i:j joint_j:j "
    "joint_s_i:j3 joint_s_j:j3 joint_u:j3 joint_w:j3 joint_n:j33 joint_length:j joint_motion:j7 joint_points:j "
    "joint_lines:j joint_axes:j joint_moving:j spring_i:s spring_j:s spring_p_i:s3 spring_p_j:s3 spring_k:s "
    "spring_d0:s spring_c:s torsion_i:t torsion_j:t torsion_u:t3 torsion_n:t33 torsion_k:t torsion_rest:t torsion_c:t "
    "load_i:l user_i:u user_j:u"
)
SHAPES = dict(field.split(":") for field in FIELDS.split())


def demand(condition: Any, message: str) -> None:
    """Refuse the bundle unless the condition holds."""
    if not condition:
        raise ValueError(message)


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
        small = len(members) <= MAX_FILES and sum(m.file_size for m in members) <= MAX_BYTES
        demand(small, "more than 512 MB unpacked")
        for member in members:
            name = member.orig_filename
            demand(NAMES.fullmatch(name) and name not in files, f"unexpected or duplicate file {name[:80]!r}")
            demand(member.external_attr >> 28 in {0, 8} and not member.flag_bits & 1, f"{name} is a link or encrypted")
            demand(member.compress_type in {0, 8, 12}, f"{name} is neither stored, deflated nor bzip2")
            with archive.open(member) as stream:
                files[name] = stream.read(member.file_size)
    found = [f"{hashlib.sha256(raw).hexdigest()}  {name}" for name, raw in files.items() if name[0] != "m"]
    lines = files["manifest-sha256.txt"].decode("ascii").splitlines()
    wrong = [name for name, n in (Counter(found) - Counter(lines) | Counter(lines) - Counter(found)).items()]
    demand(not wrong, f"{wrong[:1]!r:.160} differs from the manifest")
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


def read_states(raw: bytes, nb: int, name: str) -> States:
    """Return t, r, R, v, Omega and what is stated of each state, from a matrix of float64; there are no pickles."""
    stream = io.BytesIO(raw)
    demand(np.lib.format.read_magic(stream) == (1, 0), f"{name}: unexpected version")
    shape, by_column, dtype = np.lib.format.read_array_header_1_0(stream)
    fits = len(shape) == 2 and shape[0] == 2 + 18 * nb and 8 * math.prod(shape) == len(raw) - stream.tell()
    demand(fits and dtype == np.dtype("<f8") and not by_column, f"{name}: no matrix of float64 of {nb} bodies")
    rows = np.frombuffer(raw, "<f8", offset=stream.tell()).reshape(shape)
    parts = np.split(rows, np.cumsum([1, 3 * nb, 9 * nb, 3 * nb, 3 * nb]))
    s = {key: part.T.reshape(-1, nb, *POSES[key]) for key, part in zip(POSES, parts[1:], strict=False)}
    demand(rows.size and not (np.diff(rows[0]) <= 0).any(), f"{name}: no times, or not in order")
    return s | {"t": rows[0], "stated": rows[-1]}


def select(s: States, k: Any) -> States:
    """Return the chosen rows."""
    return {key: a[k] for key, a in s.items()}


def join(*parts: States) -> States:
    """Return the rows of all parts."""
    return {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


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


ROWS = (  # kind of joint, its counted rows, which of these, whether turning; phi, phi_dot beside its rate, and where a gap
    # counts 2-|phi|
    *(("", "points", k, False, lambda j, k=k: (j.d[..., k], 0, False)) for k in range(3)),
    ("", "lines", 0, False, lambda j: (np.where(j.link, (dot(j.d, j.d) / j.L - j.L) / 2, dot(j.n1, j.d)), 0, False)),
    ("", "lines", 1, False, lambda j: (dot(j.n2, j.d), 0, False)),
    ("", "lines", 2, False, lambda j: (dot(j.n3, j.d), 0, False)),
    ("", "axes", 0, True, lambda j: (dot(j.u, j.n1), 0, False)),
    ("", "axes", 1, True, lambda j: (dot(j.u, j.n2), 0, False)),
    ("", "axes", 2, True, lambda j: (dot(j.w, j.n2), 0, dot(j.w, j.n1).real < 0)),
    ("driven position", "moving", 0, False, lambda j: (dot(j.n1, j.d) - j.f, 0, False)),
    ("driven distance", "moving", 0, False, lambda j: (norm(j.d) - j.f, 0, False)),
    ("driven angle", "moving", 0, True, lambda j: (dot(j.u, j.ahead), 0, dot(j.u, j.across).real > 0)),
    ("knife edge", "moving", 0, False, lambda j: (0j, dot(j.u.real, j.slip(j.x_i)) - j.f.real, False)),
    ("rolling disc", "moving", 0, False, lambda j: (dot(j.n1, j.low - j.x_j), 0, False)),
    ("rolling disc", "moving", 1, False, lambda j: (0j, dot(j.n2.real, j.slip(j.low)), False)),
    ("rolling disc", "moving", 2, False, lambda j: (0j, dot(j.n3.real, j.slip(j.low)), False)),
    (
        "rack and pinion",
        "moving",
        0,
        False,
        lambda j: (j.L * (angle(j.sine, -dot(j.n2, j.u), -dot(j.n2, j.d) / j.L)), 0, False),
    ),
)


class System:
    """Bodies with all joints and forces at them, and functions of their states."""

    def __init__(self, numbers: dict[str, Array], kinds: Array, bodies: Array) -> None:
        ends = {letter: [numbers[f"{name}_{end}"] for end in "ij"] for letter, name in ENDS.items()}
        own = {letter: np.isin(i, bodies) | np.isin(j, bodies) for letter, (i, j) in ends.items()}
        own |= {"b": bodies, "3": slice(None), "l": np.isin(numbers["load_i"], bodies)}
        new = np.full(len(numbers["mass"]) + 1, -1)  # its last entry is the ground's
        new[bodies] = np.arange(len(bodies))
        for key, letters in SHAPES.items():
            a = numbers[key][own[letters[0]]]
            setattr(self, key, new[a] if letters in ENDS and key.endswith(("_i", "_j")) else a)
        self.bodies, self.kinds, self.rim = bodies, kinds[own["j"]], self.gyration.max()
        self.arms = sum(
            norm(s[i >= 0]).sum() for i, s in ((self.joint_i, self.joint_s_i), (self.joint_j, self.joint_s_j))
        )
        self.stretch = 2 * (self.arms + self.rim) if (self.joint_points > 0).all() else math.inf
        held = [i.min(initial=0) < 0 for letter in "jsu" for i in (new[e[own[letter]]] for e in ends[letter])]
        self.floating = not any(held)  # a torsion at the ground holds no position
        self.begin: States = {"t": np.zeros(1)} | {key: getattr(self, f"start_{key}")[None] for key in POSES}
        self.own_begin = self.relate(self.begin)
        self.initial = self.evaluate(self.begin)

    def relate(self, s: States) -> States:
        """Return the states, relative to the common C if nothing is held at the ground."""
        share = (self.mass / self.mass.sum())[:, None] * self.floating
        return s | {key: s[key] - (share * s[key]).sum(1, keepdims=True) for key in ("r", "v")}

    def motion(self, a: States, b: States) -> Array:
        """Return the root mean square distance of each body's matter, (nt, nb)."""
        D = a["R"] - b["R"]
        half = np.trace(self.inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 2 - self.inertia
        spread = np.einsum("tbij,bjk,tbik->tb", D, half, D) / self.mass
        return np.sqrt(((a["r"] - b["r"]) ** 2).sum(2) + np.maximum(spread, 0))

    def rate(self, s: States) -> Array:
        """Return sqrt(v^2 + w.Jw/m) of each body, (nt, nb)."""
        spin = np.einsum("tbi,bij,tbj->tb", s["Omega"], self.inertia, s["Omega"])
        return np.sqrt(dot(s["v"], s["v"]) + spin / self.mass)

    def differ(self, s: States) -> float:
        """Return the largest difference of the first state from the start."""
        return max(float(np.abs(s[key][0] - self.begin[key][0]).max()) for key in POSES)

    def measure(self, s: States) -> dict[str, Array]:
        """Evaluate states of all bodies in pieces of bounded memory."""
        piece = max(1, 60_000 // max(len(self.bodies), len(self.kinds)))
        s = {key: a[:, self.bodies] if key in POSES else a for key, a in s.items()}
        return join(*(self.evaluate(select(s, slice(k, k + piece))) for k in range(0, len(s["t"]), piece)))

    def evaluate(self, s: States) -> dict[str, Array]:
        """Return energies, scales and norms of rows (nt,); rates by complex steps along the motion."""
        nt, h, own = len(s["t"]), 1j * STEP, self.relate(s)
        W = np.cross(s["Omega"][:, :, None], np.eye(3))  # rows Omega x e_k: the transposed matrix of Omega x
        r = np.concatenate([s["r"] + h * s["v"], np.zeros((nt, 1, 3))], 1)
        R = s["R"] + h * np.einsum("tbij,tbkj->tbik", s["R"], W)
        R = np.concatenate([R, np.broadcast_to(np.eye(3), (nt, 1, 3, 3))], 1)

        def turn(body: Array, a: Array) -> Array:
            return np.einsum("tkij,kj->tki", R[:, body], a)

        def carry(body: Array, x: Array) -> Array:
            arm = np.einsum("tkij,tki->tkj", R[:, body].real, x.real - r[:, body].real)
            return (r[:, body] + np.einsum("tkij,tkj->tki", R[:, body], arm)).imag / STEP

        d = r[:, self.spring_i] + turn(self.spring_i, self.spring_p_i)
        d = (d - r[:, self.spring_j] - turn(self.spring_j, self.spring_p_j)).real
        e, b = (turn(self.torsion_j, self.torsion_n[:, k]) for k in (0, 1))
        u = turn(self.torsion_i, self.torsion_u)
        theta = angle(dot(u, b), dot(u, e), self.torsion_rest).real
        elastic = ((norm(d) - self.spring_d0) ** 2 @ self.spring_k + theta**2 @ self.torsion_k) / 2
        out = {"V": elastic - own["r"] @ self.gravity @ self.mass, "T": self.rate(own) ** 2 @ self.mass / 2}
        out["E"] = elastic - s["r"] @ self.gravity @ self.mass + self.rate(s) ** 2 @ self.mass / 2
        out |= {"speed": self.rate(own).max(1), "reach": self.motion(own, self.own_begin).max(1)}
        out["orthogonality"] = np.linalg.norm(np.swapaxes(s["R"], 2, 3) @ s["R"] - np.eye(3), axis=(2, 3)).max(1)

        i, i2, c, t = self.joint_i, self.joint_j, self.joint_motion.T, (s["t"] + h)[:, None]
        j = SimpleNamespace(u=turn(i, self.joint_u), w=turn(i, self.joint_w), L=self.joint_length)
        j.n1, j.n2, j.n3 = (turn(i2, self.joint_n[:, k]) for k in range(3))
        j.x_i, j.x_j = r[:, i] + turn(i, self.joint_s_i), r[:, i2] + turn(i2, self.joint_s_j)
        j.d, j.link, j.slip = j.x_i - j.x_j, self.kinds == "distance", lambda x: carry(i, x) - carry(i2, x)
        j.f = c[0] + t * (c[1] + t * (c[2] + t * c[3])) + c[4] * np.sin(c[5] * t + c[6])
        j.ahead = j.n1 * np.cos(j.f)[..., None] + j.n2 * np.sin(j.f)[..., None]
        j.across = j.n2 * np.cos(j.f)[..., None] - j.n1 * np.sin(j.f)[..., None]
        m, j.sine = j.n1 - dot(j.n1, j.u)[..., None] * j.u, dot(np.cross(j.n1, j.n2), np.cross(-j.n2, j.u))
        j.low = j.x_i - j.L[:, None] * m / norm(m)[..., None]
        squares = {key: np.zeros(nt) for key in ("phi", "phi_dot", "gap", "gap_rate")}
        for kind, count, k, turning, law in ROWS:
            has = (getattr(self, f"joint_{count}") > k) & ((self.kinds == kind) | (not kind))
            if has.any():
                phi, extra, far = law(j)
                rate, gap = phi.imag / STEP + extra, np.where(far, 2 - np.abs(phi.real), phi.real)
                metres = self.rim if turning else 1
                for key, a in zip(squares, (phi.real, rate, gap * metres, rate * metres), strict=True):
                    squares[key] += (np.where(has, a, 0) ** 2).sum(-1)
        return out | {key: np.sqrt(a) for key, a in squares.items()}


class Problem:
    """The validated numbers of a problem, its mechanisms and its exact motion."""

    def __init__(self, raw: bytes, reference: bytes | None, name: str) -> None:
        data, sizes, numbers = parse_json(raw, name, dict), {"3": 3, "7": 7}, {}
        for key, letters in SHAPES.items():
            value = data["numbers"][key]
            shape = tuple(sizes.setdefault(letter, len(value)) for letter in letters)
            a = np.array(value, float).reshape(shape) if 0 in shape else np.array(value, float)
            demand(a.shape == shape and np.isfinite(a).all(), f"{name}: {key} is not finite or of shape {shape}")
            body = len(letters) == 1 and key.endswith(("_i", "_j"))
            demand(not body or ((a >= -1) & (a < sizes["b"])).all(), f"{name}: {key} beyond the bodies")
            numbers[key] = a.astype(int) if body else a
        self.id, self.nb, kinds = name, sizes["b"], np.array([str(kind)[:40] for kind in data["joint_kinds"]], str)
        sound = 0 < self.nb <= 2000 and max(sizes.values()) <= 50 * self.nb + 50 and (numbers["mass"] > 0).all()
        demand(sound and len(kinds) == sizes["j"], f"{name}: bodies, masses or joint_kinds")
        unknown = set(kinds[numbers["joint_moving"] > 0]) - {row[0] for row in ROWS}
        demand(not unknown, f"{name}: joint kinds {unknown} are not described")
        self.literal_start, self.t_end = data["literal_start"] is True, float(data["t_end_s"])
        demand(0 < self.t_end < math.inf, f"{name}: t_end_s")
        group = np.arange(self.nb)
        for end in ENDS.values():
            for i, j in zip(numbers[f"{end}_i"], numbers[f"{end}_j"], strict=True):
                group[group == group[i]] = group[j] if min(i, j) >= 0 else group[i]
        self.whole = System(numbers, kinds, np.arange(self.nb))
        parts = [np.flatnonzero(group == g) for g in np.unique(group)]
        self.parts = [System(numbers, kinds, part) for part in parts] if len(parts) > 1 else [self.whole]
        self.horizon, self.exact = -math.inf, None
        if reference is not None:
            self.horizon, self.exact = float(data["reference"]["horizon_s"]), read_states(reference, self.nb, name)
            demand(all(np.isfinite(a).all() for a in self.exact.values()), f"{name}: reference not finite")
        forces = any(numbers[key].any() for key in ("spring_c", "torsion_c", "joint_motion"))
        self.has_work = bool(forces or sizes["l"] or sizes["u"] or data["not_serialised"])


class Report:
    """Count what was compared and keep what disagrees."""

    def __init__(self) -> None:
        self.runs, self.numbers, self.run = 0, 0, ""
        self.findings: list[str] = []
        self.undecided: Counter[str] = Counter()

    def compare(self, column: str, recorded: Any, value: Any, slack: float = 0, complete: bool = True) -> None:
        """Compare numbers or words; where the state of a maximum is not kept its value is a lower bound."""
        same = value == recorded
        if isinstance(value, float):
            value, recorded = math.inf if math.isnan(value) else value, float(recorded)
            same = value == recorded or abs(value - recorded) <= REL * abs(recorded) + slack < math.inf
        if not (same or complete) and value < recorded:
            self.undecided[column] += 1
            return
        self.numbers += 1
        if not same:
            self.findings.append(f"{self.run:17} {column:38} {str(recorded)[:48]:>24} {str(value)[:48]:>24}")


def allow(p: Problem, q: System, size: dict[str, float]) -> dict[str, float]:
    """Return the limits of the laws that hold at each time."""
    limits = {"energy": 0.1 * size["energy"], "orthogonality": 1e-3}
    if p.literal_start or not len(q.kinds):
        return limits
    return limits | {"gap": 0.01 * size["gap"], "gap_rate": 0.05 * size["speed"]}


def find_scales(p: Problem, q: System, exact: States | None, s: States) -> tuple[dict[str, Array], dict[str, float]]:
    """Return what a system reaches, and its scales: of exact states, and of those beyond until one breaks a law."""
    m, known = q.measure(s), join(q.initial, q.measure(exact)) if exact else q.initial
    m["energy"] = s["stated"] if p.has_work else m["E"] - (m["E"][0] if s["t"][0] == 0 else q.initial["E"])
    own, late = m | {"T": m["T"] - np.maximum(m["energy"], 0)}, s["t"] > p.horizon * (1 + EPS)
    broken = ~np.isfinite([m[key] for key in known]).all(0)
    while True:
        late[np.logical_or.accumulate(broken)] = False
        most = join(known, select({key: own[key] for key in known}, late))
        size = {key: float(most[key].max()) for key in ("reach", "speed")}
        size["length"] = float(known["reach"].max()) if exact else size["reach"]
        size["energy"], size["gap"] = float(max(most["T"].max(), np.ptp(most["V"]))), min(size["reach"], q.stretch)
        for law, limit in allow(p, q, size).items():
            broken |= ~(np.abs(m[law]) <= limit)
        if not late[np.logical_or.accumulate(broken)].any():
            return m, size


def check_reference(report: Report, p: Problem, e: States) -> None:
    """Demand that the exact motion begins at the start, states sane errors and keeps the laws to them."""
    q, m, stated = p.whole, p.whole.measure(e), e["stated"]
    size, speed = np.abs(e["r"]).max() + q.rim + q.arms, float(q.rate(e).max())
    speed, allowed = max(speed, 1e-9 * size), 1e-9 + 100 * stated.clip(0) / size
    sane = ((stated >= 0) & (stated < 0.1 * size)).all() and 0 <= e["t"][0] and e["t"][-1] <= p.horizon * (1 + EPS)
    report.compare("reference: errors and horizon sane", True, bool(sane))
    weight = m["T"].max() + np.abs(m["E"] - m["T"]).max() + 1e-300
    laws = {
        "phi": m["phi"] / size,
        "phi_dot": m["phi_dot"] / speed,
        "orthogonality": m["orthogonality"],
        "energy": None if p.has_work else (m["E"] - q.initial["E"]) / weight,
        "start": None if e["t"][0] else allowed * q.differ(e) / (1e-9 * (1 + size + speed)),
    }
    for law, defect in laws.items():
        if defect is None:
            report.undecided[f"reference: {law}"] += 1
        else:
            report.compare(f"reference: {law} / allowed", 0, float(np.abs(defect / allowed).max()), 1)


def check_run(report: Report, p: Problem, run: dict[str, Any], rec: dict[str, Any], s: States) -> None:
    """Compare a record with its states: maxima, last values, scales and status."""
    every, e, q, t = run["states"] == "every step", p.exact, p.whole, s["t"]
    get = defaultdict(lambda: math.nan)
    get |= {key: float(x) for key, x in rec.items() if type(x) in {int, float} or x in ("nan", "inf", "-inf")}
    peaks = {key: float(at) for key, at in run["peaks_s"].items()}
    good = np.logical_and.reduce([np.isfinite(s[key]).reshape(len(t), -1).all(1) for key in ("t", *POSES)])

    T, marks = min(p.t_end, p.horizon), [at for key, at in peaks.items() if key.startswith("scale ")]
    whole = (every or p.t_end <= T) and (not e or (len(marks) > 0 and bool(np.isin(marks, e["t"]).all())))
    even = e and (np.abs(e["t"] / T * 2000 - np.round(e["t"] / T * 2000)) < 1e-7) | np.isin(e["t"], marks)
    exact = e and select(e, even & (e["t"] <= T * (1 + EPS)))
    m, size = find_scales(p, q, exact, s)
    big = float(np.abs(s["r"][good]).max(initial=0)) + q.rim + q.arms
    fast, weight = np.nanmax(q.rate(s)) + big, np.nanmax(m["T"] + np.abs(m["E"] - m["T"]))
    rest = size["reach"] < 1e-6 * big
    for key, name in (("length", "length_scale_m"), ("speed", "speed_scale_m_per_s"), ("energy", "energy_scale_J")):
        report.compare(name, rec[name], size[key], 1e-9 * weight * (key == "energy"), whole and not rest)
        size[key] = get[name]
    if p.horizon >= p.t_end or not e:  # the reach is the length
        size["gap"] = min(size["length"], math.inf if rest else q.stretch)
    judged, known, ratio = [(q, m, size)], whole or p.horizon >= p.t_end or not e, np.ones(p.nb)
    if len(p.parts) > 1:
        judged = [(part, *find_scales(p, part, exact, s)) for part in p.parts]
        known = every and whole and not p.has_work and all(one["reach"] > 1e-6 * big for _, _, one in judged)
        for part, _, one in judged:
            ratio[part.bodies] = size["length"] / one["length"]
    limits = [allow(p, part, one) for part, _, one in judged]
    shares = {
        law: np.max([np.abs(m[law]) / limit[law] for (_, m, _), limit in zip(judged, limits)], 0) for law in limits[0]
    }

    columns = {  # values, slack, times
        "phi_{}": (m["phi"], EPS * big, t),
        "phi_dot_{}": (m["phi_dot"], EPS * fast, t),
        "orthogonality_{}": (m["orthogonality"], EPS, t),
        "energy_drift_{}_J": (m["energy"], EPS * weight, t),
    }
    for law in shares.keys() & {"gap", "gap_rate"}:
        if known or (law == "gap_rate" and len(judged) == 1):
            columns[f"{law}_share_{{}}"] = (shares[law], 1e-9, t)
        else:
            report.undecided[f"{law}_share_max"] += 1
    if e:
        k = np.minimum(np.searchsorted(e["t"], t), len(e["t"]) - 1)
        a, x = select(s, e["t"][k] == t), select(e, k[e["t"][k] == t])
        spread = np.linalg.norm(a["R"] - x["R"], axis=(2, 3)).clip(0, math.sqrt(8)) / math.sqrt(8)
        off = {key: a[key] - x[key] for key in ("v", "Omega")}
        errors = {
            "position_error_{}_m": (norm(a["r"] - x["r"]), EPS * big),
            "orientation_error_{}_rad": (2 * np.arcsin(spread), 1e4 * EPS),
            "velocity_error_{}_m_per_s": (norm(off["v"]), EPS * fast),
            "angular_velocity_error_{}_rad_per_s": (norm(off["Omega"]), EPS * (1 + norm(a["Omega"]).max(initial=0))),
            "motion_error_{}_m": (q.motion(a, x) * ratio, EPS * big),
            "rate_error_{}_m_per_s": (q.rate(off) * ratio, EPS * fast),
            "reference_own_error_{}_m": (x["stated"][:, None], 1e-3 * EPS * big),
        }
        columns |= {key: (values.max(1), slack, a["t"]) for key, (values, slack) in errors.items()}
        tenth = np.maximum(np.searchsorted(a["t"], a["t"] / 10, "right") - 1, min(1, len(a["t"]) - 1))
        usable = x["stated"] < np.where(x["stated"] <= 100 * x["stated"][tenth], 1e-3, 1e-9) * size["length"]
        judged_to = a["t"][np.logical_and.accumulate(usable)].max(initial=0)
        report.compare("judged_to_s", rec["judged_to_s"], float(judged_to), 0, every)
    for key, (values, slack, at) in columns.items():
        for which, span in (("max", at <= math.inf), ("judged", at <= get["judged_to_s"])):
            name = key.format(which)
            if name in rec and span.any():
                kept = every or bool(np.isin(peaks.get(name, -1), at))
                report.compare(name, rec[name], float(np.abs(values[span]).max()), slack, kept)
        if (name := key.format("end")) in rec and len(at) and at[-1] == get["t_reached_s"]:
            report.compare(name, rec[name], float(values[-1]), slack)
    E0 = m["E"][0] if t[0] == 0 else q.initial["E"][0]
    report.compare("energy_start_J", rec["energy_start_J"], float(E0), EPS * weight)

    # status: of compared columns, and of recorded ones where the bundle cannot decide
    if rec["claimed"] != "success":
        return report.compare("status of a failure", False, rec["status"] in {"success", "wrong", "inaccurate"})
    length, energy, own = get["length_scale_m"], get["energy_scale_J"], get["reference_own_error_judged_m"]
    tests = {
        "end": abs(get["t_reached_s"] - p.t_end) - 1e-9 * max(p.t_end, 1),
        "start": q.differ(s) - 1e-9 * (1 + length + get["speed_scale_m_per_s"]) if t[0] == 0 else math.nan,
        "finite": 0.5 - good.all(),
        "energy": get["energy_drift_max_J"] - 0.1 * energy,
        "constraint": math.nan if p.literal_start else get["gap_share_max"] - 1,
        "constraint_rate": math.nan if p.literal_start else get["gap_rate_share_max"] - 1,
        "orthogonality": get["orthogonality_max"] - 1e-3,
        "kinematic": get["kinematic_defect"] - 0.5,
        "reaction": get["reaction_error_max_N"] - 10 * (get["reaction_size_N"] + energy / length),
        "motion": get["motion_error_judged_m"] - 0.1 * length - own,
        "velocity": get["rate_error_judged_m_per_s"] - get["speed_scale_m_per_s"],
        "rows": get["motion_between_max_m"] - 0.5 * length - own,
    }
    if len(judged) > 1:
        tests["energy"] = shares["energy"].max() - 1 if known else math.nan
    report.undecided.update(["law invariant", "law truncation", "law kinematic", "law reaction", "law rows"])
    stated = {str(reason["law"]) for reason in parse_json(rec["wrong_because"].encode(), report.run, list)}
    found = {law for law, excess in tests.items() if excess > 0} | (stated & {"invariant", "truncation"})
    found -= {"rows"} if "motion" in found else set()
    report.compare("status", rec["status"], "wrong" if found - SOFT else "inaccurate" if found else "success")
    return report.compare("wrong_because", sorted(stated), sorted(found - SOFT or found))


def check_bundle(path: Path) -> Report:
    """Check all runs of a bundle; any exception says that the file itself is no bundle."""
    report, problems, files = Report(), {}, read_files(path)
    head, rows = (
        parse_json(files["bundle.json"], "bundle.json", dict),
        parse_json(files["records.json"], "records.json", list),
    )
    demand(head["format"] == "mbsbench bundle" and head["version"] == 2, "not a bundle of version 2")
    records = {str(rec["run_id"]): rec for rec in rows}
    for run in parse_json(files["runs.json"], "runs.json", list):
        name, key = str(run["run_id"]), str(run["problem"])
        demand(name in records, f"{name[:40]!r} twice or without a record")
        rec, report.run, report.runs = records.pop(name), key, report.runs + 1
        if run["states"] == "none":
            report.undecided["runs without states"] += 1
            continue
        if key not in problems:
            p = problems[key] = Problem(files[f"problems/{key}.json"], files.get(f"references/{key}.npy"), key)
            if p.exact:
                check_reference(report, p, p.exact)
        report.run, p = name, problems[key]
        check_run(report, p, run, rec, read_states(files[f"runs/{name}.npy"], p.nb, name))
    demand(len(rows) == report.runs, "records.json and runs.json differ")
    return report


def main(paths: list[str]) -> int:
    """Print a table of agreement for each bundle."""
    worst = 0 if paths else 2
    for path in paths:
        try:
            report = check_bundle(Path(path))
        except Exception as error:  # whatever the file may cause
            print(f"{path}: unreadable: {type(error).__name__}: {error}"[:400].encode("unicode_escape").decode())
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
