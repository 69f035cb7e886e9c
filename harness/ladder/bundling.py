"""The bundle of a submission: written from its results folder, and read as hostile data."""

import hashlib
import json
import math
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path

from ..bundle.archive import MANIFEST, write_archive
from ..bundle.contents import list_contents
from ..files import FileError, parse_json, parse_toml
from ..results import records, store
from ..results.environment import ROOT
from ..results.records import RunRecord
from ..types import Status
from .instances import KINDS, STEPS, Instance, Kind, draw_instances

CHECKER = ROOT / "checker" / "check_bundle.py"
CHECK_LIMIT = 60.0  # [s] of wall time for the checker
CONTROL = {"dt": "dt_s", "rtol": "rtol"}  # columns of records
LARGEST_BUNDLE = 2**30  # [bytes] of all its files
LARGEST = 2**26  # [bytes] of the suite and of all records together


@dataclass(frozen=True)
class Entry:
    """A bundle of the ladder: who, what was run, and why it is no entry (nothing: it is one)."""

    file: str
    solver: str
    digest: str
    seed: str
    records: tuple[RunRecord, ...]
    forged: tuple[str, ...] = ()


def write_bundle(folder: Path, path: Path) -> None:
    """The results in ``folder`` as the lossless bundle ``path``."""
    write_archive(path, list_contents(folder, store.newest(store.load(folder).records), lossless=True))


def read_entry(path: Path, kinds: tuple[Kind, ...] = KINDS) -> Entry:
    """What a bundle says, and where it cannot be believed: its manifest, its instances, its numbers."""
    found = _check_manifest(path)
    if found:
        return Entry(path.name, path.stem, "", "", (), tuple(found))
    try:
        with zipfile.ZipFile(path) as archive:
            texts = [_read(archive, name) for name in ("suite.toml", "records.json")]
        about = parse_toml(texts[0], "suite.toml")
        solver, digest, seed = (str(about[name]) for name in ("submission", "digest", "seed"))
        given = tuple(records.from_json(json.dumps(plain)) for plain in parse_json(texts[1], "records.json"))
    except (FileError, KeyError, TypeError, zipfile.BadZipFile) as error:
        return Entry(path.name, path.stem, "", "", (), (f"it is no bundle of a submission: {error}",))
    found += [f"{r.case}: {words}" for r in given if (words := _check_numbers(r))]
    found += _check_instances(given, solver, draw_instances(digest, seed, kinds))
    found += check_bundle(path)
    return Entry(path.name, solver, digest, seed, given, tuple(found))


def _check_manifest(path: Path) -> list[str]:
    """Where a bundle differs from its manifest, a line each."""
    try:
        with zipfile.ZipFile(path) as archive:
            sizes = {m.filename: m.file_size for m in archive.infolist()}
            if len(sizes) != len(archive.infolist()) or MANIFEST not in sizes or sum(sizes.values()) > LARGEST_BUNDLE:
                return [f"a name twice, no {MANIFEST}, or more than {LARGEST_BUNDLE} bytes"]
            lines = archive.read(MANIFEST).decode().splitlines()
            stated = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
            found = {name: hashlib.sha256(archive.read(name)).hexdigest() for name in sizes if name != MANIFEST}
    except (OSError, ValueError, EOFError, NotImplementedError, zipfile.BadZipFile) as error:
        return [f"not a whole zip file: {error}"]
    return [f"{name} is not as its manifest says" for name in sorted(dict(found.items() ^ stated.items()))]


def _read(archive: zipfile.ZipFile, name: str) -> str:
    if archive.getinfo(name).file_size > LARGEST:
        raise FileError(f"{name} is too large")
    return archive.read(name).decode()


def _check_numbers(r: RunRecord) -> str:
    """What no run can have; empty for others."""
    if r.status not in set(Status):
        return f"no status {r.status!r}"
    if r.control not in STEPS or getattr(r, CONTROL[r.control]) not in STEPS[r.control]:
        return "no setting of the ladder"
    if r.status == Status.SUCCESS and not (
        0.0 <= r.motion_error_max_m < math.inf and 0.0 < r.length_scale_m < math.inf
    ):
        return "a success without an error"
    return "" if 0.0 < r.cpu_median_s < math.inf or r.status != Status.SUCCESS else "a success without a CPU time"


def _check_instances(given: tuple[RunRecord, ...], solver: str, drawn: tuple[Instance, ...]) -> list[str]:
    """Every instance drawn must have been run at every setting, once, and no other."""
    found = [f"{r.case}: a run of {r.solver}" for r in given if r.solver != solver]
    wanted = {(i.problem, json.dumps(dict(i.parameters), sort_keys=True)) for i in drawn}
    have = [(r.problem, json.dumps(json.loads(r.problem_parameters), sort_keys=True), r.dt_s, r.rtol) for r in given]
    if {h[:2] for h in have} != wanted:
        found.append("its instances are not those drawn for its digest and seed")
    if len({str(h) for h in have}) != len(have) or len(have) != len(wanted) * len(next(iter(STEPS.values()))):
        found.append("a run is missing, or there twice")
    return found


def require_checker() -> None:
    """FileError where the checker is not there: without it no bundle can be believed."""
    if not CHECKER.is_file():
        raise FileError(f"bundles cannot be ranked without the independent checker: {CHECKER} is missing; reinstall")


def check_bundle(path: Path) -> list[str]:
    """Where the independent checker disagrees with a bundle, which owes it the states of every success."""
    require_checker()
    line = (sys.executable, str(CHECKER), "--complete", str(path))
    try:
        done = subprocess.run(line, capture_output=True, text=True, timeout=CHECK_LIMIT, check=False)
    except subprocess.TimeoutExpired:
        return ["the checker did not end"]
    lines = (done.stdout or done.stderr).strip().splitlines()
    differing = [line for line in lines[1:] if not line.startswith(" ")][:5]  # the first line counts, indented ones add
    return [] if done.returncode == 0 else differing or lines or ["it disagrees"]
