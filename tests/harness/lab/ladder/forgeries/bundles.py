"""Bundles that were edited: each edit changes the members of a bundle, and says what must find it."""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mbsbench.harness.lab.bundle.archive import MANIFEST, write_archive
from mbsbench.harness.lab.bundle.crate import METADATA

Members = dict[str, bytes]
Edit = Callable[[Members], object]


def members_of(path: Path) -> Members:
    """All files of a bundle."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write_edited(path: Path, members: Members) -> None:
    """A bundle of these files, with new digests everywhere."""
    own = renamed({name: content for name, content in members.items() if name not in (MANIFEST, METADATA)})
    if METADATA in members:
        crate = json.loads(members[METADATA])
        for entity in crate["@graph"]:
            if entity["@id"] not in own and str(entity["@id"]).startswith(("problems/", "references/")):
                folder = entity["@id"].partition("/")[0]
                entity["@id"] = next((n for n in own if n.startswith(f"{folder}/") and n not in members), entity["@id"])
            if entity["@id"] in own:
                entity["sha256"] = hashlib.sha256(own[entity["@id"]]).hexdigest()
                entity["contentSize"] = str(len(own[entity["@id"]]))
        own[METADATA] = json.dumps(crate, sort_keys=True, separators=(",", ":")).encode()
    write_archive(path, own.items())


def renamed(members: Members) -> Members:
    """Problems and what refers to them, under the digests of their content."""
    out = dict(members)
    for name in [n for n in members if n.startswith("problems/")]:
        plain = json.loads(members[name])
        old = name.removeprefix("problems/").removesuffix(".json")
        text = json.dumps(plain, sort_keys=True, allow_nan=False, separators=(",", ":")).encode()
        new = hashlib.sha256(text).hexdigest()[: len(old)]
        out["runs.json"] = out["runs.json"].replace(old.encode(), new.encode())
        for file in (name, f"references/{old}.npy"):
            if file in out:
                out[file.replace(old, new)] = out.pop(file)
    return out


def write_as_it_is(path: Path, members: Members) -> None:
    """A bundle of these files, digests unchanged."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def all_records(**changes: Any) -> Edit:
    """Columns of every record, or functions of their values."""

    def edit(members: Members) -> None:
        plain = json.loads(members["records.json"])
        for record in plain:
            for name, value in changes.items():
                record[name] = value(record[name]) if callable(value) else value
        members["records.json"] = json.dumps(plain).encode()

    return edit


def list_of_records(change: Callable[[list[dict[str, Any]]], object]) -> Edit:
    """The list of records."""

    def edit(members: Members) -> None:
        plain = json.loads(members["records.json"])
        changed = change(plain)
        members["records.json"] = json.dumps(plain if changed is None else changed).encode()

    return edit


def parameters(**changes: Any) -> Edit:
    """Parameters of the problem of every record, and of the problems themselves."""

    def edit(members: Members) -> None:
        all_records(problem_parameters=lambda text: json.dumps({**json.loads(text), **changes}))(members)
        for name in [n for n in members if n.startswith("problems/")]:
            plain = json.loads(members[name])
            plain["parameters"] |= changes
            members[name] = json.dumps(plain).encode()

    return edit


def about(**changes: str) -> Edit:
    """What the suite says of the submission."""

    def edit(members: Members) -> None:
        lines = dict(line.split(" = ", 1) for line in members["suite.toml"].decode().splitlines())
        lines |= {name: json.dumps(value) for name, value in changes.items()}
        members["suite.toml"] = "".join(f"{name} = {value}\n" for name, value in lines.items()).encode()

    return edit


def change_states(matrix: np.ndarray, array: str, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Replace one quantity of all states in a matrix of a bundle."""
    if array in ("t", "stated"):
        row = 0 if array == "t" else -1
        matrix[row] = change(matrix[row])
        return
    each = matrix[1:-1].T.reshape(matrix.shape[1], -1, 18)
    part = {"r": slice(3), "R": slice(3, 12), "v": slice(12, 15), "Omega": slice(15, 18)}[array]
    shape = (*each.shape[:2], 3, 3) if array == "R" else each[..., part].shape
    each[..., part] = change(each[..., part].reshape(shape)).reshape(each[..., part].shape)
    matrix[1:-1] = each.reshape(len(each), -1).T


def arrays(array: str, change: Callable[[np.ndarray], np.ndarray], *, of: str = "runs") -> Edit:
    """An array of every run, or ``of`` the references."""

    def edit(members: Members) -> None:
        for run in json.loads(members["runs.json"]):
            name = f"runs/{run['run_id']}.npy"
            if of == "references":
                name = f"references/{run['problem']}.npy"
            matrix = np.load(io.BytesIO(members[name]))
            change_states(matrix, array, change)
            file = io.BytesIO()
            np.save(file, matrix)
            members[name] = file.getvalue()
            if of == "references":
                return

    return edit


def numbers(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Edit:
    """A number of every problem, under the digest that belongs to it."""

    def edit(members: Members) -> None:
        for file in [n for n in members if n.startswith("problems/")]:
            plain = json.loads(members[file])
            plain["numbers"][name] = change(np.array(plain["numbers"][name], dtype=float)).tolist()
            members[file] = json.dumps(plain).encode()

    return edit


def twice(plain: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [*plain, plain[-1]]


OLD_DIGESTS: dict[str, Edit] = {
    "a record changed": all_records(status="success", cpu_median_s=1e-6),
    "a state changed": arrays("r", lambda a: 1.001 * a),
    "a reference changed": arrays("r", lambda a: 1.001 * a, of="references"),
    "a file added": lambda m: m.update({"more.json": b"{}"}),
    "a file removed": lambda m: m.pop("runs.json"),
    "the manifest removed": lambda m: m.pop(MANIFEST),
    "the manifest emptied": lambda m: m.update({MANIFEST: b""}),
    "the manifest of another": lambda m: m.update({MANIFEST: b"0" * 64 + b"  records.json\n"}),
}
NEW_DIGESTS: dict[str, Edit] = {
    "another time": parameters(t_end=0.1),
    "an instance without its rotation": parameters(rotation=[0.0, 0.0, 0.0]),
    "an instance in SI": parameters(unit_length=1.0, unit_mass=1.0, unit_time=1.0),
    "an instance of public numbers": parameters(mass=1.0, half_length=0.5, omega_x=5.0, omega_z=3.0),
    "another start": parameters(seed=1),
    "another seed": about(seed="2"),
    "another submission": about(digest="0" * 64),
    "another name": about(submission="somebody_else"),
    "no submission": lambda m: m.update({"suite.toml": b'name = "paper"\n'}),
    "another problem": all_records(problem="free_body"),
    "another solver's runs": all_records(solver="rkmk_dop853"),
    "another setting": all_records(dt_s=1e-5),
    "a run left out": list_of_records(lambda plain: plain[1:]),
    "no run": list_of_records(lambda plain: []),
    "a run twice": list_of_records(twice),
    "a run in place of another": list_of_records(lambda plain: [plain[0], *plain[:-1]]),
    "records that are none": lambda m: m.update({"records.json": b"[1, 2]"}),
    "records that are no JSON": lambda m: m.update({"records.json": b"[NaN]"}),
    "a record of another schema": all_records(schema=99),
    "a status of its own": all_records(status="perfect"),
    "a control of its own": all_records(control="luck"),
    "an error below zero": all_records(motion_error_max_m=-1.0),
    "an error that is none": all_records(motion_error_max_m="nan"),
    "a length of zero": all_records(length_scale_m=0.0),
    "a CPU time of zero": all_records(cpu_median_s=0.0),
    "a CPU time below zero": all_records(cpu_median_s=-1.0),
    "a CPU time that is none": all_records(cpu_median_s="nan"),
    "an error that is text": all_records(motion_error_max_m="small"),
}
OF_A_RUN: dict[str, Edit] = {  # consistent in themselves: our own run of the submission shows them
    "CPU times lowered": all_records(cpu_min_s=1e-4, cpu_median_s=1e-4, cpu_max_s=1e-4, cpu_call_s=1e-4),
    "errors lowered": all_records(motion_error_max_m=1e-12, motion_error_judged_m=1e-12),
    "errors raised, of a rival": all_records(motion_error_max_m=lambda e: 10.0 * e),
    "a success of a failure": all_records(status=lambda s: "success" if s != "success" else "wrong"),
    "scales raised": all_records(length_scale_m=lambda x: 1e3 * float(x), motion_error_max_m=lambda e: 2.0 * e),
}
OF_NUMBERS: dict[str, Edit] = {  # with new digests: only one that computes anew can find it
    "poses shifted": arrays("r", lambda a: a + 0.05),
    "poses turned": arrays("R", lambda a: a[..., ::-1, :]),
    "velocities scaled": arrays("v", lambda a: 1.5 * a),
    "spins scaled": arrays("Omega", lambda a: 1.5 * a),
    "times stretched": arrays("t", lambda a: 1.1 * a),
    "poses without noise": arrays("r", lambda a: np.round(a, 2)),
    "the exact motion shifted": arrays("r", lambda a: a + 0.05, of="references"),
    "the exact motion turned": arrays("R", lambda a: a[..., ::-1, :], of="references"),
    "the exact motion's speed": arrays("v", lambda a: 1.5 * a, of="references"),
    "the exact motion's stated error": arrays("stated", lambda a: a + 1.0, of="references"),
    "a lighter body": numbers("mass", lambda a: 0.5 * a),
    "less gravity": numbers("gravity", lambda a: 0.5 * a),
    "another inertia": numbers("inertia", lambda a: 2.0 * a),
    "a joint elsewhere": numbers("joint_s_i", lambda a: a + 0.1),
    "another start in the numbers": numbers("start_r", lambda a: a + 0.1),
    "errors of motion lowered": all_records(motion_error_max_m=1e-15, motion_error_judged_m=1e-15),
    "errors of position lowered": all_records(position_error_max_m=1e-15, position_error_judged_m=1e-15),
    "drift of energy lowered": all_records(energy_drift_max_J=1e-15, energy_drift_end_J=1e-15),
    "gaps of another motion": all_records(phi_max=1e-3, phi_dot_max=1e-3),
    "a success called wrong": all_records(status="wrong"),
}
