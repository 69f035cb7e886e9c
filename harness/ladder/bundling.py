"""The bundle of a submission: written from its results folder, and read as hostile data."""

import hashlib
import json
import math
import subprocess
import sys
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

from ..bundle.archive import MANIFEST, write_archive
from ..bundle.contents import list_contents
from ..execution.run import Send
from ..files import FileError, parse_json, parse_toml
from ..places import open_whole
from ..results import records, store
from ..results.environment import ROOT
from ..results.records import RunRecord
from ..sandbox.apart import Apart
from ..text import printable
from ..types import Status
from .closing import Closing
from .instances import KINDS, STEPS, Instance, Kind, draw_instances

CHECKER = ROOT / "checker" / "check_bundle.py"
CHECK_LIMIT, CHECK_MEMORY = 60.0, 4000.0  # [s] of CPU time and [MB] for the checker
ABOUT = ("submission", "digest", "seed")  # of its suite.toml
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
    fenced: bool = False  # whether its runs were kept from all that is not theirs, as who ran them says


def write_bundle(folder: Path, path: Path) -> None:
    """The results in ``folder`` as the lossless bundle ``path``."""
    write_archive(path, list_contents(folder, store.newest(store.load(folder).records), lossless=True))


def read_entry(path: Path, kinds: tuple[Kind, ...] = KINDS, closing: Closing | None = None) -> Entry:
    """What a bundle says, and where it cannot be believed: its manifest, its instances, its numbers, its seed."""
    try:
        entry = _read_entry(path, kinds)
    except Exception as error:  # a file of others may lead to any: it costs this entry, and no other
        words = " ".join(str(getattr(error, "strerror", None) or error).split()) or type(error).__name__
        entry = _no_entry(path, f"it is no bundle of a submission: {words}")
    if closing and not entry.forged and (words := closing.complain(entry.digest, entry.seed)):
        return replace(entry, forged=(words,))
    return entry


def _no_entry(path: Path, *why: str) -> Entry:
    return Entry(printable(path.name), printable(path.stem), "", "", (), tuple(map(printable, why)))


def _read_entry(path: Path, kinds: tuple[Kind, ...]) -> Entry:
    with open_whole(path, LARGEST_BUNDLE) as file, zipfile.ZipFile(file) as archive:
        if found := _check_manifest(archive):
            return _no_entry(path, *found)
        about = parse_toml(_read(archive, "suite.toml"), "suite.toml")
        plain = parse_json(_read(archive, "records.json"), "records.json")
    if missing := [name for name in ABOUT if name not in about]:
        return _no_entry(path, f"its suite.toml has no {', '.join(missing)}")
    solver, digest, seed = (str(about[name]) for name in ABOUT)
    if not solver.isidentifier():
        return _no_entry(path, f"its solver has no name of one: {solver[:100]!r}")
    given = tuple(records.from_json(json.dumps(one)) for one in plain)
    found = [f"{r.case}: {words}" for r in given if (words := _check_numbers(r))]
    found += _check_instances(given, solver, draw_instances(digest, seed, kinds))
    found += check_bundle(path)
    fenced = about.get("fenced") is True
    return Entry(printable(path.name), solver, digest, seed, given, tuple(map(printable, found)), fenced)


def _check_manifest(archive: zipfile.ZipFile) -> list[str]:
    """Where a bundle differs from its manifest, a line each."""
    sizes = {m.filename: m.file_size for m in archive.infolist()}
    if len(sizes) != len(archive.infolist()) or MANIFEST not in sizes or sum(sizes.values()) > LARGEST_BUNDLE:
        return [f"a name twice, no {MANIFEST}, or more than {LARGEST_BUNDLE} bytes"]
    lines = _read(archive, MANIFEST).splitlines()
    stated = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
    found = {name: _digest_member(archive, name) for name in sizes if name != MANIFEST}
    return [f"{name} is not as its manifest says" for name in sorted(dict(found.items() ^ stated.items()))]


def _digest_member(archive: zipfile.ZipFile, name: str) -> str:
    with archive.open(name) as member:  # in pieces: it may be as large as a bundle
        return hashlib.file_digest(member, "sha256").hexdigest()  # type: ignore[arg-type]


def _read(archive: zipfile.ZipFile, name: str) -> str:
    if name not in archive.namelist():
        raise FileError(f"it has no {name}")
    if archive.getinfo(name).file_size > LARGEST:
        raise FileError(f"{name} is too large")
    try:
        return archive.read(name).decode()
    except UnicodeDecodeError as error:
        raise FileError(f"{name} is no text in UTF-8: {error.reason} at byte {error.start}") from None


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

    def check(send: Send) -> None:
        done = subprocess.run(line, capture_output=True, text=True, check=False)
        send(json.dumps([done.returncode, (done.stdout or done.stderr)]))

    ended = Apart(check, limit=CHECK_LIMIT, memory=CHECK_MEMORY).wait()
    code, said = json.loads(ended.sent) if ended.sent else (ended.code, "")
    if code < 0 or not ended.sent:
        return [f"the checker {replace(ended, code=code).describe_limit(CHECK_LIMIT, CHECK_MEMORY) or ended.words}"]
    lines = said.strip().splitlines()
    differing = [line for line in lines[1:] if not line.startswith(" ")][:5]  # the first line counts, indented ones add
    return [] if code == 0 else differing or lines or ["it disagrees"]
