"""Check bundles of results, from docs/bundle.md alone: recompute what records state. See README.md."""

import hashlib
import io
import json
import math
import re
import sys
import zipfile
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from laws import (
    EPS,
    LETTERS,
    ROWS,
    SERIES,
    SHAPES,
    Array,
    System,
    between,
    find_kinematic_defect,
    find_truncation,
    follow_top,
    measure_kept,
    norm,
    unpack,
)

NAMES = re.compile(r"((runs|references|series)/[\w-]{1,64}\.npy|(problems/)?[\w.-]{1,64}\.(json|toml|txt))", re.ASCII)
MAX_FILES, MAX_BYTES, MAX_JSON, MAX_VALUES = 20_000, 1 << 29, 1 << 24, 3_000_000
REL = 1e-6  # tolerance, of the recorded number
EVERY = "not every step is kept"
SOFT = {"motion", "velocity", "rows"}  # the reasons of `inaccurate`
LIMITS = {"energy": 0.1, "orthogonality": 1e-3, "gap": 0.01, "gap_rate": 0.05}  # of the scales


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
            name, plain = member.orig_filename, member.external_attr >> 28 in {0, 8}
            demand(NAMES.fullmatch(name) and name not in files, f"unexpected or duplicate file {name[:80]!r}")
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


def read_numbers(raw: bytes, name: str) -> Array:
    """Return the numbers of an NPY file; there are no pickles."""
    demand(raw[:8] == b"\x93NUMPY\1\0" and b"'<f8'" in raw[:128], f"{name}: not an NPY file of float64")
    return np.frombuffer(raw, "<f8", offset=128)


def read_states(raw: bytes, nb: int, name: str) -> Array:
    """Return states, a row each: t, r, R, v, Omega of each body, what is stated of it."""
    states = read_numbers(raw, name).reshape(2 + 18 * nb, -1).T
    demand(len(states) and not (np.diff(states[:, 0]) <= 0).any(), f"{name}: no times, or not in order")
    return states


class Problem:
    """The validated numbers of a problem, its mechanisms and its exact motion."""

    def __init__(self, raw: bytes, reference: bytes | None, name: str) -> None:
        data, sizes, n = parse_json(raw, name), {"2": 2, "3": 3, "7": 7}, {}
        for key, letters in SHAPES.items():
            shape = tuple(sizes.setdefault(letter, len(data["numbers"][key])) for letter in letters)
            a = np.array(data["numbers"][key], float)
            a = a.reshape(shape) if 0 in shape else a
            demand(a.shape == shape and np.isfinite(a).all(), f"{name}: {key} is not finite or of shape {shape}")
            body = len(letters) == 1 and key.endswith(("_i", "_j"))
            demand(not body or ((a >= -1) & (a < sizes["b"])).all(), f"{name}: {key} beyond the bodies")
            n[key] = a.astype(int) if body else a
        self.nb, self.t_end, self.kept = sizes["b"], float(data["t_end_s"]), data["invariants"]
        kinds = np.array([str(kind)[:40] for kind in data["joint_kinds"]], str)
        sound = 0 < self.nb <= 2000 and max(sizes.values()) <= 50 * self.nb + 50 and (n["mass"] > 0).all()
        described = {row[0] for row in ROWS[:-2]}.issuperset(kinds[n["joint_moving"] > 0]) and len(kinds) == sizes["j"]
        demand(sound and described and 0 < self.t_end < math.inf, f"{name}: bodies, masses, joint_kinds or t_end_s")
        self.laws = tuple(LIMITS)[: 4 if sizes["j"] and not data["literal_start"] else 2]
        self.whole, group = System(n, kinds, np.arange(self.nb)), np.arange(self.nb)
        for i, j in np.concatenate([np.stack([n[f"{k}_i"], n[f"{k}_j"]], 1) for k in LETTERS.values()]):
            group[group == group[i]] = group[j] if min(i, j) >= 0 else group[i]
        self.parts = [System(n, kinds, np.flatnonzero(group == g)) for g in np.unique(group)]
        self.horizon, self.exact = -math.inf, self.whole.start[:0]
        if reference is not None:
            self.horizon, self.exact = float(data["reference"]["horizon_s"]), read_states(reference, self.nb, name)
            demand(np.isfinite(self.exact).all(), f"{name}: reference not finite")
        t, T = self.exact[:, 0], min(self.t_end, self.horizon)
        even = np.abs(t / T * 2000 - np.round(t / T * 2000)) < 1e-7
        self.sizing = np.concatenate([self.whole.start, self.exact[even & (t <= T * (1 + EPS))]])
        self.proved = "proved" in str(data["reference"]["route"])
        self.user = bool(sizes["u"] or data["not_serialised"])
        forces = any(n[key].any() for key in ("spring_c", "torsion_c", "joint_motion"))
        self.has_work = bool(forces or sizes["l"] or self.user)

    def find_scales(self, q: System, s: Array, first: float) -> tuple[dict[str, Array], dict[str, float]]:
        """Return what a system reaches, and its scales: of exact states, and beyond until a law is first broken."""
        m, known, late = q.measure(s), q.measure(self.sizing), (s[:, 0] > self.horizon * (1 + EPS)) & (s[:, 0] < first)
        m["energy"] = s[:, -1] if self.has_work else m["E"] - (q.initial if s[0, 0] else m)["E"][0]
        reach, speed, T, V, momentum = (np.append(known[key], m[key][late]) for key in SERIES[:5])
        T[len(known["T"]) :] -= np.maximum(m["energy"][late], 0)  # energy gained was not there to be exchanged
        size = {"reach": reach.max(), "gap_rate": speed.max(), "energy": max(T.max(), np.ptp(V)), "orthogonality": 1.0}
        size |= {"length": (known["reach"] if len(self.exact) else reach).max(), "momentum": momentum.max()}
        return m, size | {"gap": min(reach.max(), q.stretch)}


class Report:
    """What was compared, and what disagrees."""

    def __init__(self) -> None:
        self.run, self.runs, self.numbers, self.findings, self.undecided = "", 0, 0, [], Counter()
        self.rec: dict[str, Any] = {}

    def compare(
        self,
        column: str,
        value: Any,
        slack: float = 0,
        full: bool = True,
        recorded: Any = None,
        why: str = "its states are not kept",
    ) -> None:
        """Compare numbers or words; where the state of a maximum is not kept its value is a lower bound."""
        recorded = self.rec[column] if recorded is None else recorded
        same = value == recorded
        if isinstance(value, float):
            value, recorded = math.inf if math.isnan(value) else value, float(recorded)
            same = value == recorded or abs(value - recorded) <= REL * abs(recorded) + slack < math.inf
        if value is None or not (same or full or value > recorded):
            self.undecided["only a lower bound" if value is not None else why, column] += 1
            return
        self.numbers += 1
        if not same:
            self.findings.append(f"{self.run:17} {column:38} {str(recorded)[:48]:>24} {str(value)[:48]:>24}")


def check_reference(report: Report, p: Problem) -> None:
    """Demand that the exact motion begins at the start, states sane errors and keeps the laws to them."""
    if not len(p.exact):
        return
    t, stated, q, m, (r, R, v, W, _) = p.exact[:, 0], p.exact[:, -1], p.whole, p.whole.measure(p.exact), unpack(p.exact)
    size, speed = np.abs(r).max() + q.rim + q.arms, q.spread(v, W).max()
    allowed, weight = 1e-9 + 100 * stated.clip(0) / size, m["T"].max() + np.abs(m["E"] - m["T"]).max() + 1e-300
    sane = (stated >= 0).all() and (stated < 0.1 * size).all() and t[0] >= 0 and t[-1] <= p.horizon * (1 + EPS)
    report.compare("reference: errors and horizon sane", bool(sane), recorded=True)
    laws = {"phi": m["phi"] / size, "phi_dot": m["phi_dot"] / max(speed, 1e-9 * size)}
    laws |= {"orthogonality": m["orthogonality"], "energy": (m["E"] - q.initial["E"]) / weight}
    if (cosine := follow_top(q, t)) is not None:
        up, arm = q.gravity / np.linalg.norm(q.gravity), q.joint_s_i[0] / np.linalg.norm(q.joint_s_i[0])
        laws["closed form"] = allowed * (R[:, 0] @ arm @ up - cosine) / (REL + 2 * stated / size)
    elif p.proved:
        report.undecided["no closed form here: its motion is proved by others", "reference"] += 1
    laws["start"] = allowed * np.abs(p.exact - q.start)[0, 1:-1].max() / (1e-9 * (1 + size + speed))
    for law, defect in laws.items():
        known = not (p.has_work if law == "energy" else law == "start" and t[0])
        value, why = np.abs(defect / allowed).max() if known else None, "work is done, or no exact start is kept"
        report.compare(f"reference: {law} / allowed", value, 1, recorded=0.0, why=why)


def check_run(report: Report, p: Problem, run: dict[str, Any], s: Array, reactions: Array | None) -> None:
    """Compare a record with its states: maxima, last values, scales and status."""
    every, q, t, rec, test = run["states"] == "every step", p.whole, s[:, 0], report.rec, report.compare
    get = defaultdict(lambda: math.nan)
    get |= {key: float(x) for key, x in rec.items() if type(x) in {int, float} or x in ("nan", "inf", "-inf")}
    good, (r, R, v, W, _) = np.isfinite(s[:, :-1]).all(1), unpack(s)
    peaks = {key: float(at) for key, at in run["peaks_s"].items()}
    m, size = p.find_scales(q, s, first := min((peaks[k] for k in peaks if k.endswith(":first")), default=math.inf))
    big = np.abs(r[good]).max(initial=0) + q.rim + q.arms
    fast, weight = np.nanmax(q.spread(v, W)) + big, np.nanmax(m["T"] + np.abs(m["E"] - m["T"]))
    stated = sorted({str(reason["law"]) for reason in parse_json(rec["wrong_because"].encode(), report.run)})
    if rec["claimed"] == "success" and not good.all():
        return test("status and reason", ("wrong", ["finite"]), recorded=(rec["status"], stated))
    test("energy_start_J", float((q.initial if t[0] else m)["E"][0]), EPS * weight)
    rest, covered, single = size["reach"] < 1e-6 * big, p.horizon >= p.t_end, len(p.parts) == 1
    for key, name in (("length", "length_scale_m"), ("gap_rate", "speed_scale_m_per_s"), ("energy", "energy_scale_J")):
        test(name, size[key], 1e-9 * weight * (key == "energy"), (every or covered) and not rest)
        size[key] = get[name]
    length, speed, energy, own = (
        *(size[k] for k in ("length", "gap_rate", "energy")),
        get["reference_own_error_judged_m"],
    )
    if covered or not len(p.exact):  # the reach is the length
        size |= {"gap": min(length, math.inf if rest else q.stretch), "reach": length}
    parts, known, ratio = [(m, size)], every or covered or not len(p.exact), np.ones(p.nb)
    if not single:
        parts = [p.find_scales(part, s, first) for part in p.parts]
        known = every and not p.has_work and all(one["reach"] > 1e-6 * big for _, one in parts)
    for part, (_, one) in zip(p.parts, parts, strict=True):
        ratio[part.bodies] = length / one["length"]
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
    unexplained = 0.0
    if len(p.exact):
        k = np.minimum(np.searchsorted(p.exact[:, 0], t), len(p.exact) - 1)
        beside, spin = p.exact[k, 0] == t, 1 + np.abs(W[good]).max(initial=0)
        x, at, sure = p.exact[k[beside]], t[beside], p.exact[k[beside], -1]
        r, R, v, W = (a[beside] - b for a, b in zip((r, R, v, W), unpack(x)[:4], strict=True))
        turned = 2 * np.arcsin((np.linalg.norm(R, axis=(2, 3)) / math.sqrt(8)).clip(0, 1))
        spun, comparable = np.linalg.norm(W, axis=(2, 3)) / math.sqrt(2), known or single
        apart, rate = (q.spread(r, R) * ratio).max(1), (q.spread(v, W) * ratio).max(1)
        columns += [
            ("position_error_{}_m", norm(r).max(1), EPS * big, at),
            ("orientation_error_{}_rad", turned.max(1), 1e4 * EPS, at),
            ("velocity_error_{}_m_per_s", norm(v).max(1), EPS * fast, at),
            ("angular_velocity_error_{}_rad_per_s", spun.max(1), EPS * spin, at),
            ("motion_error_{}_m", apart if comparable else None, EPS * big, at),
            ("rate_error_{}_m_per_s", rate if comparable else None, EPS * fast, at),
            ("reference_own_error_{}_m", sure, 1e-3 * EPS * big, at),
        ]
        tenth = np.maximum(np.searchsorted(at, at / 10, "right") - 1, min(1, len(at) - 1))
        usable = sure < np.where(sure <= 100 * sure[tenth], 1e-3, 1e-9) * length
        test("judged_to_s", float(at[np.logical_and.accumulate(usable)].max(initial=0)), 0, every)
        n = np.logical_and.accumulate(usable).sum()
        if n > 1 and rate[:n].max() > 0.01 * speed:
            spin = np.linalg.norm(unpack(s)[4][:n], axis=2).max()
            unexplained = rate[:n].max() / (
                2 * (apart + sure)[:n].max() * (1 / np.median(np.diff(at[:n])) + spin) + 1e-300
            )
    for key, values, slack, at in columns:
        for which, last in (("max", math.inf), ("judged", get["judged_to_s"]), ("end", get["t_reached_s"])):
            name, span = key.format(which), at == last if which == "end" else at <= last
            if name in rec and span.any():
                full = every or which == "end" or bool(np.isin(peaks.get(name, -1), at))
                test(
                    name,
                    None if values is None else float(np.max(values[span] if which == "end" else np.abs(values[span]))),
                    slack,
                    full,
                )

    # laws from step to step, forces of joints, and what is kept
    test("kinematic_defect", find_kinematic_defect(q, s, length) if every and len(s) > 1 else None, 1e-9, why=EVERY)
    for column in filter(peaks.__contains__, ("motion_between_max_m", "reaction_error_max_N", "reaction_size_N")):
        x, y = (a[a[:, 0] == peaks[column]] for a in (p.exact, s))
        value, force = None, column.startswith("reaction")
        if not force and len(x) and (every or run["between"]):
            r, R = (a - b for a, b in zip(between(s, peaks[column]), unpack(x)[:2], strict=True))
            value = q.spread(r, R).max()
        elif force and len(x) and not p.user and (len(y) or column == "reaction_size_N"):
            value = q.accelerate(x)[1]
            if column == "reaction_error_max_N":
                value = value - q.load(y, np.array(run["reaction"], float)[None])
            value = norm(value[..., :3]).max()
        test(column, None if value is None else float(value), 1e-6 * get["reaction_size_N"] if force else EPS * big)
    units = {"J": energy, "m": length, "m/s": speed, "rad/s": speed / size["reach"]}
    units |= {"kg m/s": size["momentum"], "kg m2/s": size["momentum"] * size["reach"]}
    broken, described = False, {str(about["name"]): about for about in p.kept if "quantity" in about}
    for name, drift in parse_json(rec["invariant_drifts"].encode(), report.run).items():
        if (about := described.get(name)) is None:
            test(f"invariant {name}", None, recorded=0, why="its quantity is not described")
            continue
        values = measure_kept(q, s, about)
        scale, away = units[about["unit"]], values - values[0]
        slack = EPS * max(np.nanmax(np.abs(values)), scale)
        for key, value in (("start", values[0]), ("end", away[-1]), ("max", np.abs(away).max())):
            kept = t[0] == 0 and (key != "end" or t[-1] == get["t_reached_s"])
            test(f"invariant {name}: {key}", float(value) if kept else None, slack, every or key != "max", drift[key])
        broken |= float(drift["max"]) > 0.1 * max(scale, abs(float(drift["start"])))

    # status: of compared columns, and of recorded ones where the bundle cannot decide
    if rec["claimed"] != "success":
        return test("status of a failure", rec["status"] in {"success", "wrong", "inaccurate"}, recorded=False)
    moved = np.abs(s - q.start)[0, 1:-1].max() if t[0] == 0 else math.nan
    tests = {
        "end": abs(get["t_reached_s"] - p.t_end) - 1e-9 * max(p.t_end, 1),
        "start": moved - 1e-9 * (1 + length + speed),
        "energy": get["energy_drift_max_J"] - 0.1 * energy if single else shares["energy"].max() - 1 if known else 0,
        "constraint": get["gap_share_max"] - 1,
        "constraint_rate": get["gap_rate_share_max"] - 1,
        "orthogonality": get["orthogonality_max"] - 1e-3,
        "kinematic": get["kinematic_defect"] - 0.5,
        "reaction": get["reaction_error_max_N"] - 10 * (get["reaction_size_N"] + energy / length),
        "invariant": float(broken),
        "motion": get["motion_error_judged_m"] - 0.1 * length - own,
        "velocity": get["rate_error_judged_m_per_s"] - speed,
        "rows": get["motion_between_max_m"] - 0.5 * length - own,
    }
    found = {law for law, excess in tests.items() if excess > 0}
    if not len(p.exact) or found & SOFT:  # only of a motion that is known, and near it
        pass
    elif every and not p.user:
        found |= {"truncation"} if max(find_truncation(q, s, reactions, speed), unexplained) > 1 else set()
    else:
        report.undecided["user forces are code" if p.user else EVERY, "law truncation"] += 1
        found |= {"truncation"} & set(stated)
    found -= {"rows"} if found & {"motion", "velocity"} else set()
    test("status", "wrong" if found - SOFT else "inaccurate" if found else "success")
    return test("wrong_because", sorted(found - SOFT or found), recorded=stated)


def check_table(report: Report, rows: list[dict[str, Any]], records: list[dict[str, Any]]) -> None:
    """Compare every cell with what the records give."""
    keys, kinds = ("problem", "problem_parameters", "solver"), ("success", "inaccurate", "wrong")
    groups = defaultdict(list)
    for rec in records:
        groups[tuple(str(rec[key]) for key in keys)].append(rec)
    demand([tuple(row[key] for key in keys) for row in rows] == sorted(groups), "the table has other rows")
    for row, (key, runs) in zip(rows, sorted(groups.items()), strict=True):
        report.run, report.rec = f"table {key[2]}"[:17], row
        errors = [float(rec["motion_error_judged_m"]) for rec in runs]
        good = [k for k, rec in enumerate(runs) if rec["status"] == "success" and math.isfinite(errors[k])]
        near = [float(runs[k]["cpu_median_s"]) for k in good if errors[k] <= 1e-3 * float(runs[k]["length_scale_m"])]
        cells = {"runs": len(runs), **{kind: sum(rec["status"] == kind for rec in runs) for kind in kinds}}
        cells |= {"least_motion_error_m": min((errors[k] for k in good), default=math.inf)}
        for column, value in (cells | {"least_cpu_s": min(near, default=math.inf)}).items():
            report.compare(column, value)


def check_bundle(path: Path) -> Report:
    """Check all runs of a bundle; an exception says that the file is no bundle."""
    report, problems, files = Report(), {}, read_files(path)
    head, rows, runs, table = (
        parse_json(files[f"{name}.json"], name) for name in ("bundle", "records", "runs", "table")
    )
    demand(head["format"] == "mbsbench bundle" and head["version"] == 3, "not a bundle of version 3")
    report.runs, records = len(runs), {str(rec["run_id"]): rec for rec in rows}
    demand(len(rows) == len(records) == len(runs), "a run twice, or without a record")
    check_table(report, table, rows)
    for run in runs:
        report.run, key = str(run["run_id"]), str(run["problem"])
        report.rec = records.pop(report.run)
        if run["states"] == "none":
            report.undecided["no motion, or too large a state", "run"] += 1
            continue
        if key not in problems:
            problems[key] = Problem(files[f"problems/{key}.json"], files.get(f"references/{key}.npy"), key)
            check_reference(report, problems[key])
        states, reactions = read_states(files[f"runs/{report.run}.npy"], problems[key].nb, report.run), None
        if place := run["arrays"].get("state_reaction"):
            flat = read_numbers(files[f"series/{report.run}.npy"], report.run)
            reactions = flat[place[0] : place[0] + math.prod(place[1])].reshape(place[1])
        check_run(report, problems[key], run, states, reactions)
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
        for why in sorted({why for why, _ in report.undecided}):
            print(
                f"  {why}:", *(f"{what} {n}," for (cause, what), n in sorted(report.undecided.items()) if cause == why)
            )
        worst = max(worst, min(len(report.findings), 1))
    return worst


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
